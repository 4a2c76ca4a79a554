//! An emulated cRIO: the far end of the wire, with a rig behind it, on a real TCP socket.
//!
//! [`Crio`] holds the rules of the protocol as a state machine without socket, thread or clock;
//! [`Sensors`] turns pressures into the volts of an NI 9205; [`Emulator`] puts both on a socket and
//! advances a [`EmulatedPlant`] by one 20 ms tick after the other; [`FaultScript`] spoils frames, links
//! and sensors on purpose. Nothing here knows what the rig is, but for [`rig_and_crio`], which puts
//! the rig of a rig file there.
//!
//! # Time
//! At sample edge k the sensors are sampled and SENSE k goes out. A COMMAND received between edge k
//! and edge k+1 is in force from its receipt on; the rig's step from k to k+1 is computed at edge
//! k+1, as a whole, with the command then in force. What part of the tick had passed when the command
//! came is not resolved: an answer that comes within its tick drives that whole tick.
//!
//! - [`Pace::RealTime`]: edges stand on an absolute 20 ms grid, so the rate does not drift. Where the
//!   host stalls for a whole tick or more, the grid moves on by that many ticks and plant time
//!   stands still meanwhile; the ticks' numbers have no gap, and `stalled_ticks` counts it. Between
//!   sessions the rig goes on with both vents open.
//! - [`Pace::Lockstep`]: edge k+1 comes as soon as the COMMAND that answers SENSE k is there, or it is
//!   known that it will not come (the script lost or spoilt it or its SENSE), or a generous wait is
//!   over. Time stands still between sessions, and the clock in the frames is the plant's, so that
//!   the same answers give the same bytes.
//!
//! From the same state, the same answers, each within its tick, give the same trajectory and the same
//! volts in both paces.
//!
//! # Where the protocol's page leaves something open
//! - *Time to live*: counted in whole ticks without a command that counts. With `ttl` 2, an answer to
//!   SENSE k and none after it, the trip shows in SENSE k+3: ticks k+1 and k+2 were empty. A `ttl` of
//!   0 is taken as 1, above 5 as 5. The watch starts with the first command of a session, for before
//!   it the vents are open anyway, and it also runs in mode vent.
//! - *Mode vent* opens both vents whatever duty the command carries, and reports state 0 with that
//!   command in force. A pump relay follows the command's bit in every mode; it is off without a
//!   command and in a trip. Without a relay the pump always runs.
//! - *A trip* leaves no command in force (sequence number 0). Commands that would count are not
//!   applied, but are not missed either.
//! - *Commands missed*: ticks of the session that ended without a command that counts; stays at 65535.
//! - *Over-pressure* is judged from the volts, as a cRIO must, at the edge, before SENSE goes out: the
//!   SENSE with the reading of 300 kPa or more is the SENSE that reports the trip.
//! - *Broken sensor* (below 0.8 V, above 5.2 V, NaN): three ticks in a row trip with bit 4, because
//!   the over-pressure protection is blind then; [`CrioConfig::broken_sensor_ticks`] changes it.
//! - *A HELLO within a link* opens a new session when its session is a new one; one that repeats an
//!   old sequence number is ignored. Commands must then be newer than that HELLO.
//! - *Link loss or BYE* ends the session: both vents open, at once.
//! - *One client*: while it speaks, another one gets BYE and is closed; after a second of silence the
//!   newcomer takes the place, so that a half-open link does not lock the daemon out.
//! - *A frame that breaks the stream* (magic, version, type, length) is answered with BYE and a close;
//!   a frame with a wrong CRC is dropped and counted.

mod crio;
mod dispatch;
mod fault_outcome;
mod faults;
mod link;
mod pace;
mod rig;
mod sensors;
mod serve;
mod server;
mod watch;

pub use crio::{Actuation, Crio, CrioConfig, Rejection};
pub use faults::{FaultScript, FaultScriptError};
pub use pace::Pace;
pub use rig::{EmulatedPlant, WIRE_V, check_tick, load_for_loop, rig_and_crio};
pub use sensors::{PSE540A_R06, PSE541A_R06, SensorFault, SensorScale, Sensors};
pub use server::{Emulator, EmulatorConfig, EmulatorError, EmulatorHandle};
pub use watch::{Event, GroundTruth, Statistics, TruthObserver, Watched, channel_watcher};
