//! Identification: the paper's procedure, then a joint refinement of all plant parameters.
//!
//! | file | subject |
//! | --- | --- |
//! | `driven_pump` | what a piston pump moves under recorded pressures |
//! | `weak_form` | valve coefficients by linear least squares |
//! | `check_valves` | check valves by the simplex method around it |
//! | `run` | all of it: quality, starts, refinement, figures on what was kept back |
//! | `words` | tables and plain words |

mod check_valves;
mod driven_pump;
mod run;
mod weak_form;
mod words;

pub use check_valves::{PaperFit, paper_fit};
pub use driven_pump::DrivenPump;
pub use run::{Accuracy, Identified, IdentifySettings, Step, run};
pub use weak_form::ValveRegression;
pub use words::{determined, figures, not_good, table, undetermined, verdict};
