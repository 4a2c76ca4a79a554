//! Identification: the paper's procedure, then a joint refinement of all plant parameters.
//!
//! | file | subject |
//! | --- | --- |
//! | `driven_pump` | what a piston pump moves under recorded pressures |
//! | `weak_form` | valve coefficients by linear least squares |
//! | `check_valves` | check valves by the simplex method around it |
//! | `run` | all of it: quality, starts, refinement, figures on what was kept back |
//! | `combinations` | which combinations of parameters the recordings determine, and which they leave open |
//! | `contradictions` | standard errors where statements contradict one another and only ratios are known |
//! | `words` | tables and plain words |

mod check_valves;
mod combinations;
mod contradictions;
mod driven_pump;
mod run;
mod weak_form;
mod words;

pub use check_valves::{PaperFit, paper_fit};
pub use combinations::{determined, undetermined};
pub use driven_pump::DrivenPump;
pub use run::{Accuracy, Identified, IdentifySettings, Step, no_worse_than, run};
pub use weak_form::ValveRegression;
pub use words::{figures, noise_in_words, not_good, runaway_in_words, table, verdict};
