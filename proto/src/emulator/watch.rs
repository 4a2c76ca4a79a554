//! Watching the emulator from outside: the truth of every tick, events, and counts.
//!
//! A [`TruthObserver`] is called in the emulator's thread and must return quickly; [`channel_watcher`] hands
//! everything to another thread through a bounded channel and drops, and counts, what finds no room,
//! so that a slow onlooker never holds the emulator up.

use std::fmt;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use crate::wire::{ByeReason, CrioState, HelloRefusal, TripBits, WireError};

use super::crio::Rejection;

/// The truth at one sample edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroundTruth {
    /// Edges since the emulator started.
    pub edge: u64,
    /// The session and its tick, `None` without a session.
    pub session_tick: Option<(u32, u32)>,
    /// True pressures at this edge: positive, negative, kPa gauge.
    pub pressures_kpa: [f64; 2],
    /// Volts as SENSE reports them, NaN without a session.
    pub volts: [f32; 4],
    /// Duty that drove the rig in the step that ended at this edge.
    pub duty: [f32; 2],
    /// True where the pump ran in the step that ended at this edge.
    pub pump_on: bool,
    /// State from this edge on.
    pub state: CrioState,
}

/// Something that happened, to be shown to a person.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// A client connected.
    Connected {
        /// Address.
        peer: SocketAddr,
    },
    /// A client was turned away because another one is being served, or the script says so.
    TurnedAway {
        /// Address.
        peer: SocketAddr,
    },
    /// A session was opened.
    SessionOpened {
        /// The session.
        session: u32,
        /// The daemon's name for itself.
        name: String,
    },
    /// A HELLO was refused.
    HelloRefused(HelloRefusal),
    /// A COMMAND was not applied.
    Rejected(Rejection),
    /// A frame came damaged; the link is closed where the damage is fatal.
    Damaged(WireError),
    /// A frame came that a daemon does not send, or none of its kind was due.
    Unexpected(&'static str),
    /// The cRIO tripped.
    Tripped {
        /// Why.
        trips: TripBits,
        /// Tick of the session.
        tick: u32,
    },
    /// The daemon said BYE.
    Bye(ByeReason),
    /// The link is gone.
    LinkLost(&'static str),
}

impl fmt::Display for Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Connected { peer } => write!(f, "client {peer} connected"),
            Self::TurnedAway { peer } => write!(f, "client {peer} turned away"),
            Self::SessionOpened { session, name } => write!(f, "session {session:08X} opened by {name:?}"),
            Self::HelloRefused(refusal) => write!(f, "HELLO refused: {refusal}"),
            Self::Rejected(rejection) => write!(f, "{rejection}"),
            Self::Damaged(error) => write!(f, "{error}"),
            Self::Unexpected(what) => f.write_str(what),
            Self::Tripped { trips, tick } => write!(f, "tripped at tick {tick}: {trips}; both vents open"),
            Self::Bye(reason) => write!(f, "the daemon said BYE: {reason}"),
            Self::LinkLost(why) => write!(f, "link lost: {why}; both vents open"),
        }
    }
}

/// Looks on; called in the emulator's thread, so it must be quick.
pub trait TruthObserver: Send {
    /// One sample edge passed.
    fn tick(&mut self, _truth: &GroundTruth) {}
    /// Something happened.
    fn event(&mut self, _event: &Event) {}
}

/// Item that a channel watcher hands over.
#[derive(Debug, Clone, PartialEq)]
pub enum Watched {
    /// One sample edge passed.
    Tick(GroundTruth),
    /// Something happened.
    Event(Event),
}

/// A watcher that hands everything to a channel of this capacity, the channel's end, and the count
/// of what found no room.
#[must_use]
pub fn channel_watcher(capacity: usize) -> (Box<dyn TruthObserver>, Receiver<Watched>, Arc<AtomicU64>) {
    let (sender, receiver) = sync_channel(capacity);
    let dropped = Arc::new(AtomicU64::new(0));
    (Box::new(ChannelObserver { sender, dropped: Arc::clone(&dropped) }), receiver, dropped)
}

struct ChannelObserver {
    sender: SyncSender<Watched>,
    dropped: Arc<AtomicU64>,
}

impl ChannelObserver {
    fn hand_over(&self, watched: Watched) {
        if self.sender.try_send(watched).is_err() {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }
}

impl TruthObserver for ChannelObserver {
    fn tick(&mut self, truth: &GroundTruth) {
        self.hand_over(Watched::Tick(*truth));
    }

    fn event(&mut self, event: &Event) {
        self.hand_over(Watched::Event(event.clone()));
    }
}

/// A watcher that looks away.
pub(super) struct NoObserver;

impl TruthObserver for NoObserver {}

/// Counts since the emulator started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Statistics {
    /// Sample edges, sessions or not.
    pub edges: u64,
    /// SENSE frames made (a script may have lost some of them on the way out).
    pub senses: u64,
    /// Sessions opened.
    pub sessions: u64,
    /// Clients turned away.
    pub turned_away: u64,
    /// HELLOs refused.
    pub hellos_refused: u64,
    /// COMMANDs that counted and were applied.
    pub commands_taken: u64,
    /// COMMANDs not applied: no session, or another one.
    pub rejected_session: u64,
    /// COMMANDs not applied: sequence not newer.
    pub rejected_sequence: u64,
    /// COMMANDs not applied: duty not finite or out of range.
    pub rejected_duty: u64,
    /// COMMANDs not applied: tripped.
    pub rejected_tripped: u64,
    /// Frames that came damaged.
    pub damaged: u64,
    /// Ticks of sessions that ended without a COMMAND that counts.
    pub missed: u64,
    /// Trips by over-pressure.
    pub trips_over_pressure: u64,
    /// Trips by lost commands.
    pub trips_command_lost: u64,
    /// Trips by a broken sensor.
    pub trips_sensor: u64,
    /// Trips by an operator's stop.
    pub trips_operator: u64,
    /// Links that ended without a BYE.
    pub links_lost: u64,
    /// Frames that the script lost, delayed, corrupted or repeated.
    pub frames_spoilt: u64,
    /// Real time: whole ticks the host stalled, in which plant time stood still.
    pub stalled_ticks: u64,
    /// Lockstep: ticks ended by the longest wait instead of an answer.
    pub waits_over: u64,
}

impl Statistics {
    /// COMMANDs not applied, for whatever reason.
    #[must_use]
    pub const fn rejected(&self) -> u64 {
        self.rejected_session + self.rejected_sequence + self.rejected_duty + self.rejected_tripped
    }

    pub(super) const fn count_rejection(&mut self, rejection: &Rejection) {
        match rejection {
            Rejection::Session { .. } => self.rejected_session += 1,
            Rejection::Sequence { .. } => self.rejected_sequence += 1,
            Rejection::Duty { .. } => self.rejected_duty += 1,
            Rejection::Tripped { .. } => self.rejected_tripped += 1,
        }
    }

    pub(super) const fn count_trips(&mut self, trips: TripBits) {
        self.trips_over_pressure += trips.contains(TripBits::OVER_PRESSURE) as u64;
        self.trips_command_lost += trips.contains(TripBits::COMMAND_LOST) as u64;
        self.trips_sensor += trips.contains(TripBits::SENSOR) as u64;
        self.trips_operator += trips.contains(TripBits::OPERATOR_STOP) as u64;
    }
}
