//! Finds the physics missing in a rig's model: where, which, how much better with it, and what to record next if the
//! recordings do not tell.
//!
//! [`run`] goes from recordings to files:
//!
//! | step | module |
//! | --- | --- |
//! | recordings checked, and cut where no run goes through | `recorded` |
//! | recordings, split, noise; fits and free runs of a rig with terms | [`mod@bench`] |
//! | what may be missing: mechanisms at places, with priors | [`candidate`], [`place`] |
//! | the rig's own parameters fitted; terms added, swapped, deleted | [`search`]: [`screen`], [`glance`], then fits |
//! | whether one explanation is better, by more than chance | [`evidence`] |
//! | what a single mechanism explains of the given rig's mismatch | [`alone`] |
//! | where the mismatch lives; missing flows reconstructed | [`locate`] |
//! | how the pump turned, and the answer that goes with it | `turning`, `crank`, `heard`, `answer` |
//! | numbers at an end of their range: widened | `ends` |
//! | a verdict and its rivals; names that do not hold after all | [`judge`], `withheld`, `untold` |
//! | a term without a name | [`unknown`] |
//! | what could be there and would not show; what numbers are off by because of it | [`hidden`], [`unnamed`] |
//! | recordings in pieces of a few seconds | [`pieces`] |
//! | recorded flows into closed volumes | [`closed`] |
//! | pumps that were switched | [`switched`] |
//! | a time span in which the rig was another one; a change that stays | [`event`], `changes` |
//! | the experiment that tells rivals apart | [`experiment`] |
//! | before and after; in words; where | [`figures`], `summary`, `whereabouts` |
//! | what is still unexplained, and where; parameters nobody would believe; what to do next | `unexplained`, `axes`, `doubtful`, `next_step` |
//! | what was found; `diagnosis.json`, `report.html` | `findings`; `files`, [`proto::diagnosis`], `page` |
//!
//! No verdict is better than its recordings: what they do not tell is said, and never guessed.

pub mod alone;
// Recordings for tests are made in one place, which names this crate as its suites do.
#[cfg(test)]
extern crate self as diagnose;
#[cfg(test)]
#[path = "../tests/made/mod.rs"]
mod made;

mod answer;
mod axes;
pub mod bench;
pub mod candidate;
mod changes;
pub mod closed;
mod crank;
mod doubtful;
mod ends;
mod error;
pub mod event;
pub mod evidence;
pub mod experiment;
pub mod figures;
mod files;
mod findings;
pub mod glance;
mod heard;
pub mod hidden;
mod immovable;
pub mod judge;
pub mod locate;
mod much;
mod next_step;
mod page;
pub mod pieces;
pub mod place;
mod recorded;
mod run;
pub mod screen;
pub mod search;
mod summary;
pub mod switched;
mod turning;
mod unexplained;
pub mod unknown;
pub mod unnamed;
pub mod unsettled;
mod untold;
mod whereabouts;
mod withheld;
mod words;

pub use error::DiagnoseError;
pub use files::{NEXT_EXPERIMENT, Outcome, check_out_dir};
pub use proto::diagnosis::{Diagnosis, Verdict};
pub use run::{Request, run, work_out};
