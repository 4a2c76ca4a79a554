//! Traces of a flight: its recording, its figures, and a report that a person looks at.
//!
//! ```text
//!  tick thread                 recorder thread                      when the flight is over
//!  RecordSink::push ──queue──► Recorder ──► flight.mcap ──read──► flight_report ──► report.html
//!                                 └─ observer ──► FlightStatistics ──► live line, table, JSON
//! ```
//!
//! | module | what |
//! | --- | --- |
//! | [`recorder`] | the thread that turns ticks and events into an MCAP file; its failures never reach the tick |
//! | [`rotation`], [`disk`] | one file after another, room on the disk, what of old recordings is kept |
//! | [`sink`] | the tick's end of the queue: bounded, lock-free, counts what it must refuse |
//! | [`duration_histogram`] | times in logarithmic bins of known width, for percentiles without keeping the values |
//! | [`oscillation`] | whether an error repeats itself faster than the reference moves: a sign of a limit cycle |
//! | [`flight_clock`] | seconds of flight from session, tick and arrival |
//! | [`tracking`] | errors and valve movement of one channel |
//! | [`statistics`] | all figures of a flight, tick by tick |
//! | [`summary`] | these figures as data (`--json`) and as a table |
//! | [`verdict`] | what a person should think of them, and one sentence |
//! | [`yardstick`] | what a run is measured by |
//! | [`flight_info`] | what a report says about a flight beside its ticks |
//! | [`flight_report`](mod@flight_report) | the self-contained page with plots |
//!
//! Left out: what the daemon's states and faults are called. They are the daemon's own, so it gives
//! their names as functions.

mod comparison_report;
pub mod disk;
pub mod duration_histogram;
pub mod flight_clock;
pub mod flight_info;
pub mod flight_report;
mod flight_rows;
mod occurrences;
pub mod oscillation;
mod prediction_check;
mod record_error;
pub mod recorder;
mod recorder_state;
mod report_plots;
pub mod rotation;
pub mod sink;
pub mod statistics;
pub mod summary;
mod tape;
mod terminal;
pub mod tracking;
pub mod verdict;
mod wording;
mod writing;
pub mod yardstick;

pub use comparison_report::{ComparedRun, comparison_report};
pub use disk::Retention;
pub use flight_clock::FlightClock;
pub use flight_info::{CodeNames, FlightInfo, FlightNote, NoteTime};
pub use flight_report::flight_report;
pub use record_error::RecordError;
pub use recorder::{Noter, Recorded, Recorder, RecorderHealth, RecorderOptions, RecordingSummary};
pub use rotation::Destination;
pub use sink::{Event, RecordSink};
pub use statistics::{Counterpart, FileState, FlightStatistics, Pacing, StatisticsOptions};
pub use summary::FlightSummary;
pub use verdict::Verdict;
pub use yardstick::{OnWhichRig, RunYardstick};
