//! A cRIO whose every frame a test can spoil: the protocol's rules and a plant behind a real TCP socket, one step at a time.
//!
//! It steps when the test says so, so that a test in lockstep hangs on no clock: SENSE goes out, the answer comes in, the
//! plant moves on by one tick.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::{Duration, Instant};

use model::rig::Rig;
use proto::emulator::{Crio, EmulatedPlant, SensorFault, Sensors, rig_and_crio};
use proto::wire::{ByeReason, COMMAND_LENGTH, Command, CrioState, Frame, FrameReader, Sense, TICK_NS, TripBits};

use crate::coarse_rigs::coarse;

/// Time that anything may take on a machine that does other things as well.
const PATIENCE: Duration = Duration::from_secs(20);
/// Time that an answer which nobody reads is waited for; the daemon gives up a silent link after five seconds.
const UNREAD_PATIENCE: Duration = Duration::from_secs(1);
/// Time between two looks for it.
const UNREAD_LOOK: Duration = Duration::from_micros(100);
/// Room for answers in the socket; the kernel doubles it.
const UNREAD_BYTES: usize = 4096;

/// Result of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Answer {
    /// A command.
    Command(Command),
    /// The daemon said BYE.
    Bye(ByeReason),
    /// The daemon closed the link.
    Closed,
    /// Nothing came in time.
    Silence,
}

/// The cRIO and the rig behind it.
pub struct RawCrio {
    listener: TcpListener,
    link: Option<(TcpStream, FrameReader)>,
    crio: Crio,
    plant: Box<dyn EmulatedPlant>,
    sensors: Sensors,
    sequence: u32,
    /// Ticks since the first session began.
    pub clock_ticks: u64,
    /// Faults of the two sensors.
    pub faults: [Vec<SensorFault>; 2],
    /// Duties of valves that no longer move, by channel.
    pub stuck_duty: [Option<f64>; 2],
    /// HELLOs that came.
    pub hellos: u32,
    /// Bytes of answers that lie unread.
    unread: usize,
}

impl RawCrio {
    /// A cRIO with one of the built-in rigs behind it, in coarse steps.
    ///
    /// # Panics
    /// If it cannot listen.
    pub fn new(rig: &str) -> Self {
        RawCrio::with_rig(&coarse(rig))
    }

    /// A cRIO with this rig behind it.
    ///
    /// # Panics
    /// If it cannot listen.
    pub fn with_rig(rig: &Rig) -> Self {
        let (plant, config) = rig_and_crio(rig).expect("a sound rig");
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        listener.set_nonblocking(true).expect("a socket");
        // Little room for answers, so that one that no longer reads is one soon; what is accepted inherits it.
        rustix::net::sockopt::set_socket_recv_buffer_size(&listener, UNREAD_BYTES).expect("a socket");
        RawCrio {
            listener,
            link: None,
            sensors: Sensors::new(config.scales, Sensors::ADC_NOISE_V_RMS, 11),
            crio: Crio::new(config),
            plant: Box::new(plant),
            sequence: 0,
            clock_ticks: 0,
            faults: [Vec::new(), Vec::new()],
            stuck_duty: [None; 2],
            hellos: 0,
            unread: 0,
        }
    }

    /// Address at which it listens.
    ///
    /// # Panics
    /// If the socket has no address.
    pub fn address(&self) -> SocketAddr {
        self.listener.local_addr().expect("an address")
    }

    /// True pressures, kPa gauge.
    pub fn true_kpa(&self) -> [f64; 2] {
        self.plant.pressures_gauge_kpa()
    }

    /// The state that it reports.
    pub fn reported_state(&self) -> CrioState {
        self.crio.state()
    }

    /// Commands that it applies now: duties of both valves, and whether the pump runs.
    pub fn applied(&self) -> ([f32; 2], bool) {
        let actuation = self.crio.actuation();
        (actuation.duty, actuation.pump_on)
    }

    /// Trips it, as its operator's button does.
    pub fn trip(&mut self, bits: TripBits) {
        self.crio.trip(bits);
    }

    /// Waits for a HELLO and answers it; `false` if none comes in this time.
    pub fn open_within(&mut self, patience: Duration) -> bool {
        let until = Instant::now() + patience;
        while Instant::now() < until {
            if let Ok((stream, _)) = self.listener.accept() {
                let _ = stream.set_nodelay(true);
                let _ = stream.set_nonblocking(false);
                let _ = stream.set_read_timeout(Some(Duration::from_millis(50)));
                self.link = Some((stream, FrameReader::new()));
            }
            if let Some(Frame::Hello(hello)) = self.next_frame() {
                self.hellos += 1;
                self.sequence += 1;
                let answer = self.crio.hello(&hello, self.sequence, self.clock_ns()).expect("a HELLO that fits");
                self.write(&answer.encode());
                return true;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        false
    }

    /// Waits for a session.
    ///
    /// # Panics
    /// If none comes.
    pub fn open(&mut self) {
        assert!(self.open_within(PATIENCE), "no HELLO came");
    }

    /// Cuts the link without a word.
    pub fn cut(&mut self) {
        (self.link, self.unread) = (None, 0);
        self.crio.end_session();
    }

    /// Sends bytes as they are.
    pub fn write(&mut self, bytes: &[u8]) {
        if let Some((stream, _)) = &mut self.link {
            // Where the daemon has closed already the next read says so.
            let _ = stream.write_all(bytes);
        }
    }

    /// The SENSE of this tick as a sound cRIO would send it; `None` without a session.
    pub fn sense(&mut self) -> Option<Sense> {
        let kpa = self.plant.pressures_gauge_kpa();
        let volts = self.sensors.sample(kpa, [&self.faults[0], &self.faults[1]]);
        self.sequence += 1;
        self.crio.edge(volts, self.sequence, self.clock_ns())
    }

    /// One tick: SENSE, spoilt as the test likes, its answer, the plant.
    pub fn step(&mut self, spoil: impl FnOnce(&mut Sense)) -> Answer {
        if let Some(mut sense) = self.sense() {
            spoil(&mut sense);
            self.write(&sense.encode());
        }
        let answer = self.answer(PATIENCE);
        self.advance();
        answer
    }

    /// One tick in which the answer is looked at and obeyed, and left lying in the socket: a cRIO that no longer reads, and lives.
    /// Where no further answer comes, because there is no room for one, it falls silent: `false`.
    pub fn step_without_reading(&mut self) -> bool {
        if let Some(sense) = self.sense() {
            self.write(&sense.encode());
        }
        let until = Instant::now() + UNREAD_PATIENCE;
        let mut lying = vec![0; 16 * UNREAD_BYTES];
        while let Some((stream, _)) = &self.link {
            let count = stream.peek(&mut lying).unwrap_or(0);
            if count > self.unread {
                self.unread = count;
                let last = count - count % COMMAND_LENGTH;
                if let Ok(Frame::Command(command)) = Frame::decode(&lying[last - COMMAND_LENGTH..last]) {
                    let _ = self.crio.command(&command);
                }
                self.advance();
                return true;
            }
            if Instant::now() >= until {
                break;
            }
            std::thread::sleep(UNREAD_LOOK);
        }
        false
    }

    /// One tick of the plant under what is in force.
    pub fn advance(&mut self) {
        let actuation = self.crio.actuation();
        let mut duty = actuation.duty.map(f64::from);
        for (duty, stuck) in duty.iter_mut().zip(self.stuck_duty) {
            *duty = stuck.unwrap_or(*duty);
        }
        self.plant.tick(duty, actuation.pump_on);
        self.clock_ticks += 1;
    }

    /// Takes in what has come by now, without waiting.
    pub fn take_what_came(&mut self) {
        if let Some((stream, _)) = &self.link {
            let _ = stream.set_nonblocking(true);
        }
        while let Some(frame) = self.next_frame() {
            match frame {
                Frame::Command(command) => drop(self.crio.command(&command)),
                Frame::Bye(_) => self.cut(),
                _ => {}
            }
        }
        if let Some((stream, _)) = &self.link {
            let _ = stream.set_nonblocking(false);
        }
    }

    /// Waits for the next command, BYE or the end of the link.
    pub fn answer(&mut self, patience: Duration) -> Answer {
        let until = Instant::now() + patience;
        loop {
            match self.next_frame() {
                Some(Frame::Command(command)) => {
                    let _ = self.crio.command(&command);
                    return Answer::Command(command);
                }
                Some(Frame::Bye(bye)) => {
                    self.cut();
                    return Answer::Bye(bye.reason);
                }
                Some(_) => {}
                None if self.link.is_none() => return Answer::Closed,
                None if Instant::now() >= until => return Answer::Silence,
                None => {}
            }
        }
    }

    fn next_frame(&mut self) -> Option<Frame> {
        let (stream, reader) = self.link.as_mut()?;
        if let Ok(Some(received)) = reader.next_frame() {
            return Some(received.frame);
        }
        let mut bytes = [0; 2048];
        match stream.read(&mut bytes) {
            Ok(0) => self.cut(),
            Ok(count) => {
                reader.push(&bytes[..count]);
                if let Ok(Some(received)) = reader.next_frame() {
                    return Some(received.frame);
                }
            }
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) => {}
            Err(_) => self.cut(),
        }
        None
    }

    fn clock_ns(&self) -> u64 {
        1_000_000 + self.clock_ticks * TICK_NS
    }
}
