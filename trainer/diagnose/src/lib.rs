//! Finds the physics missing in a rig's model: where, which, how much better with it, and what to record next if the
//! recordings do not tell.
//!
//! [`run`] goes from recordings to files:
//!
//! | step | module |
//! | --- | --- |
//! | recordings checked, cut where no run goes through, flows into closed volumes | [`recordings`] |
//! | recordings, split, noise; fits and free runs of a rig with terms | [`mod@bench`] |
//! | what may be missing, screened; the rig's own parameters fitted; terms added, swapped, deleted | [`search`] |
//! | where the mismatch lives; missing flows reconstructed | [`locate`] |
//! | how the pump turned, when it was switched | [`pump`] |
//! | whether an explanation is better by more than chance; a verdict and its rivals; names that do not hold; what would not show | [`judge`] |
//! | a time span, or whole recordings, in which the rig was another one; a change that stays | [`event`] |
//! | a term without a name | [`unknown`] |
//! | names upheld or taken back, the kind of rig, what could hide beside it | `decision` |
//! | the experiment that tells rivals apart | [`experiment`] |
//! | before and after, in words, where; what is still unexplained; what to do next; `diagnosis.json`, `report.html` | [`report`], [`proto::diagnosis`] |
//!
//! No verdict is better than its recordings: what they do not tell is said, and never guessed.

// Recordings for tests are made in one place, which names this crate as its suites do.
#[cfg(test)]
extern crate self as diagnose;
#[cfg(test)]
#[path = "../tests/made/mod.rs"]
mod made;

pub mod bench;
mod decision;
mod error;
pub mod event;
pub mod experiment;
pub mod judge;
pub mod locate;
pub mod pump;
pub mod recordings;
pub mod report;
mod run;
pub mod search;
pub mod unknown;

pub use error::DiagnoseError;
pub use proto::diagnosis::{Diagnosis, Verdict};
pub use report::files::{NEXT_EXPERIMENT, Outcome, check_out_dir};
pub use run::{Request, run, work_out};
