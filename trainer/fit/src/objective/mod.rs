//! How well a rig explains recordings: residuals to be minimised, likelihoods to be compared.
//!
//! | file | subject |
//! | --- | --- |
//! | `problem` | residuals of a rig over arcs, with starts projected out, as a least-squares problem |
//! | `projection` | what of a residual an unknown start could explain, taken out |
//! | `fitted` | a fit: rounds of least squares, scale, uncertainty |
//! | `likelihood` | chi-square, log-likelihoods and errors, whole and block by block |

mod fitted;
mod likelihood;
mod problem;
mod projection;

pub use fitted::{Estimate, FitSettings, Fitted, Shooting, fit, fit_from};
pub use likelihood::{BlockScore, Likelihood, NoiseModel, Score, blocks_of, score};
pub use problem::RigProblem;
