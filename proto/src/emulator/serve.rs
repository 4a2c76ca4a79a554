//! The emulator's thread: its two paces, its sample edge, and the frames between edges.

use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use crate::wire::{Bye, ByeReason, FrameType, RawFrame, TripBits};

use super::crio::Crio;
use super::faults::FaultScript;
use super::link::{Closing, Link, cut};
use super::pace::{Grid, Pace, TICK};
use super::rig::EmulatedPlant;
use super::sensors::Sensors;
use super::watch::{Event, GroundTruth, Statistics, TruthObserver};

/// Longest sleep without a look at the stop flag.
const NAP: Duration = Duration::from_millis(50);
/// A client this long silent makes room for a new one.
const SILENCE: Duration = Duration::from_secs(1);
/// Connections taken between two looks at the time: a flood cannot hold up the edge.
const ACCEPTS_AT_ONCE: usize = 16;

/// Lockstep: the SENSE whose answer is awaited, and since when.
#[derive(Debug, Clone, Copy)]
pub(super) struct Waiting {
    pub(super) tick: u32,
    since: Instant,
}

/// Everything the emulator's thread owns.
pub(super) struct Server {
    pub(super) listener: TcpListener,
    pub(super) sensors: Sensors,
    pub(super) crio: Crio,
    pub(super) pace: Pace,
    pub(super) script: FaultScript,
    pub(super) rig: Box<dyn EmulatedPlant>,
    pub(super) watcher: Box<dyn TruthObserver>,
    pub(super) stop: Arc<AtomicBool>,
    pub(super) published: Arc<Mutex<Statistics>>,
    pub(super) statistics: Statistics,
    pub(super) started: Instant,
    pub(super) link: Option<Link>,
    pub(super) closing: Vec<Closing>,
    pub(super) refuse_until: Option<Instant>,
    /// True between a HELLO and the first edge of its session.
    pub(super) session_is_fresh: bool,
    pub(super) waiting: Option<Waiting>,
}

impl Server {
    /// Serves until it is told to stop.
    pub(super) fn run(mut self) {
        match self.pace {
            Pace::RealTime => self.run_real_time(),
            Pace::Lockstep { wait } => self.run_lockstep(wait),
        }
        if self.crio.session().is_some() {
            self.say_bye(ByeReason::Normal);
        }
        self.end_link();
        self.publish();
    }

    fn run_real_time(&mut self) {
        let mut grid = Grid::starting(Instant::now());
        while !self.stopping() {
            self.serve_until(grid.next(), |_| false);
            self.step();
            self.edge();
            self.statistics.stalled_ticks += u64::from(grid.advance(Instant::now()));
        }
    }

    fn run_lockstep(&mut self, wait: Duration) {
        while !self.stopping() {
            let now = Instant::now();
            // A wait beyond what an Instant can hold never ends.
            let over = self.waiting.and_then(|waiting| waiting.since.checked_add(wait));
            let nap = now + NAP;
            self.serve_until(over.map_or(nap, |over| over.min(nap)), |server| {
                server.session_is_fresh || (server.crio.session().is_some() && server.waiting.is_none())
            });
            if self.crio.session().is_none() {
                self.waiting = None;
                continue;
            }
            if self.session_is_fresh {
                // Time stood still until now.
                self.edge();
                continue;
            }
            if let Some(waiting) = self.waiting {
                if waiting.since.elapsed() < wait {
                    continue;
                }
                self.statistics.waits_over += 1;
            }
            self.step();
            self.edge();
        }
    }

    /// Advances the rig over the tick that ends now, with what is in force now.
    fn step(&mut self) {
        let actuation = self.crio.actuation();
        self.rig.tick(actuation.duty.map(f64::from), actuation.pump_on);
    }

    /// One sample edge: faults of this tick, sensors, the cRIO's rules, SENSE.
    fn edge(&mut self) {
        let driven = self.crio.actuation();
        let pressures_kpa = self.rig.pressures_gauge_kpa();
        self.waiting = None;
        self.session_is_fresh = false;
        self.statistics.edges += 1;
        let mut volts = [f32::NAN; 4];
        let mut session_tick = None;
        if self.crio.session().is_some() {
            self.statistics.senses += 1;
            let tick = self.tick();
            if let Some(refuse) = self.script.link_drop(tick) {
                self.refuse_until = Some(Instant::now() + refuse);
                self.lose_link("the fault script dropped it");
            }
            self.release_outgoing();
            volts = self.sample(pressures_kpa, tick);
            session_tick = self.send_sense(volts, tick);
        }
        self.watcher.tick(&GroundTruth {
            edge: self.statistics.edges - 1,
            session_tick,
            pressures_kpa,
            volts,
            duty: driven.duty,
            pump_on: driven.pump_on,
            state: self.crio.state(),
        });
        self.publish();
    }

    fn sample(&mut self, pressures_kpa: [f64; 2], tick: u64) -> [f32; 4] {
        let (mut positive, mut negative) = (Vec::new(), Vec::new());
        self.script.sensor_faults(0, tick, &mut positive);
        self.script.sensor_faults(1, tick, &mut negative);
        self.sensors.sample(pressures_kpa, [&positive, &negative])
    }

    /// Judges the volts and sends SENSE; gives session and tick, `None` where the link has just gone.
    fn send_sense(&mut self, volts: [f32; 4], tick: u64) -> Option<(u32, u32)> {
        let trips_before = self.crio.trips();
        let missed_before = self.crio.commands_missed();
        self.crio.trip(self.script.trips(tick));
        let clock_ns = self.clock_ns();
        let sequence = self.link.as_mut()?.sequence.advance();
        let sense = self.crio.edge(volts, sequence, clock_ns)?;
        self.statistics.missed += self.crio.commands_missed().saturating_sub(missed_before);
        let new_trips = TripBits::from_bits(sense.trips.bits() & !trips_before.bits());
        if !new_trips.is_empty() {
            self.statistics.count_trips(new_trips);
            self.tell(Event::Tripped { trips: new_trips, tick: sense.tick });
        }
        let arrives = self.send(FrameType::Sense, RawFrame::of(&sense.encode()));
        // A SENSE that the script lost, held back or spoilt has no answer to wait for.
        if matches!(self.pace, Pace::Lockstep { .. }) && arrives && self.link.is_some() {
            self.waiting = Some(Waiting { tick: sense.tick, since: Instant::now() });
        }
        Some((sense.session, sense.tick))
    }

    /// Takes connections and frames until `deadline` or until `early` says so; never leaves a frame
    /// that has come unread at the deadline.
    fn serve_until(&mut self, deadline: Instant, early: impl Fn(&Self) -> bool) {
        loop {
            self.accept();
            self.release_outgoing();
            self.release_incoming();
            self.receive();
            self.closing.retain_mut(Closing::goes_on);
            let now = Instant::now();
            if early(self) || now >= deadline || self.stopping() {
                return;
            }
            self.sleep(deadline.min(now + NAP).saturating_duration_since(now));
        }
    }

    /// Sleeps until a socket has something, a held frame is due, or the time is over.
    fn sleep(&self, longest: Duration) {
        let mut time = longest;
        if self.pace == Pace::RealTime
            && let Some(due) = self.link.as_ref().and_then(Link::next_due)
        {
            time = time.min(due.saturating_sub(self.clock()));
        }
        let timeout =
            Timespec { tv_sec: time.as_secs().try_into().unwrap_or(i64::MAX), tv_nsec: time.subsec_nanos().into() };
        let listener = PollFd::new(&self.listener, PollFlags::IN);
        // An interrupted or failed poll is a short sleep: the caller looks at everything anyway.
        let _ = match self.link.as_ref() {
            Some(link) => poll(&mut [PollFd::new(&link.stream, PollFlags::IN), listener], Some(&timeout)),
            None => poll(&mut [listener], Some(&timeout)),
        };
    }

    fn accept(&mut self) {
        for _ in 0..ACCEPTS_AT_ONCE {
            let Ok((stream, peer)) = self.listener.accept() else { return };
            if self.refuse_until.is_some_and(|until| Instant::now() < until) {
                cut(&stream);
                self.turned_away(peer);
                continue;
            }
            // A daemon that closed its link and came back at once: the end of the old one is unread yet.
            self.receive();
            let silent = self.link.as_ref().is_some_and(|link| link.heard.elapsed() >= SILENCE);
            if silent {
                self.lose_link("the client was silent and a new one came");
            }
            if self.link.is_some() {
                self.turn_away(stream, peer);
                continue;
            }
            // A connection that fails here is gone again: nothing to serve.
            if let Ok(link) = Link::new(stream) {
                self.link = Some(link);
                self.tell(Event::Connected { peer });
            }
        }
    }

    fn turn_away(&mut self, stream: TcpStream, peer: SocketAddr) {
        if let Ok(mut link) = Link::new(stream) {
            let bye = Bye { sequence: 1, clock_ns: self.clock_ns(), session: 0, reason: ByeReason::ProtocolError };
            // Where the newcomer has gone already there is no one to tell.
            let _ = link.write(&bye.encode());
            self.close(link);
        }
        self.turned_away(peer);
    }

    fn turned_away(&mut self, peer: SocketAddr) {
        self.statistics.turned_away += 1;
        self.tell(Event::TurnedAway { peer });
    }

    /// The tick that a frame between two edges belongs to, counted from the emulator's first SENSE.
    pub(super) fn tick(&self) -> u64 {
        self.statistics.senses.saturating_sub(1)
    }

    /// The emulator's time: since its start, or in lockstep the plant's.
    pub(super) fn clock(&self) -> Duration {
        match self.pace {
            Pace::RealTime => self.started.elapsed(),
            Pace::Lockstep { .. } => Duration::from_nanos(self.clock_ns()),
        }
    }

    pub(super) fn clock_ns(&self) -> u64 {
        match self.pace {
            Pace::RealTime => u64::try_from(self.started.elapsed().as_nanos()).unwrap_or(u64::MAX),
            Pace::Lockstep { .. } => self.tick().saturating_mul(crate::wire::TICK_NS),
        }
    }

    /// When a frame held back by `delay` is due, `None` for at once.
    pub(super) fn due(&self, delay: Duration) -> Option<Duration> {
        let delay = match self.pace {
            Pace::RealTime => delay,
            Pace::Lockstep { .. } => {
                TICK.saturating_mul(u32::try_from(delay.as_nanos() / TICK.as_nanos()).unwrap_or(u32::MAX))
            }
        };
        (!delay.is_zero()).then(|| self.clock().saturating_add(delay))
    }

    fn stopping(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    pub(super) fn tell(&mut self, event: Event) {
        self.watcher.event(&event);
    }

    pub(super) fn publish(&self) {
        *self.published.lock().unwrap_or_else(PoisonError::into_inner) = self.statistics;
    }
}
