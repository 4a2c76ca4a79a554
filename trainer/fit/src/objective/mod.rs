//! Measures of how well a rig explains recordings: residuals to be minimised, likelihoods to be compared.
//!
//! | file | subject |
//! | --- | --- |
//! | `problem` | residuals of a rig over arcs, with starts projected out, as a least-squares problem |
//! | `projection` | what of a residual an unknown start could explain, taken out |
//! | `stages` | a fit: stages of least squares, from several starts |
//! | `fitted` | its result: values, scale, uncertainty |
//! | `groups` | readings whose residuals may belong together |
//! | `likelihood` | chi-square, log-likelihoods and errors, whole and block by block |

mod fitted;
mod groups;
mod likelihood;
mod problem;
mod projection;
mod stages;

pub use fitted::{Estimate, FAR, Fitted, HeldBy, NINETY, Runaway, profiled};
pub use groups::{by_state, by_time};
pub use likelihood::{BlockScore, Likelihood, NoiseModel, Score, blocks_of, score};
pub use problem::{RigProblem, Sides, difference_step};
pub use projection::Projection;
pub use stages::{FitSettings, Shooting, fit, fit_from};
