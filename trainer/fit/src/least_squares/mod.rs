//! Least squares and simplex search, knowing nothing of rigs.
//!
//! | file | subject |
//! | --- | --- |
//! | `levenberg` | Levenberg-Marquardt with a prior, bounds, a robust loss, and several trial steps at once |
//! | `loss` | Gaussian and Student losses |
//! | `linear` | linear least squares with uncertainty |
//! | `nelder_mead` | the simplex method |
//! | `information` | what a Jacobian says: covariance, intervals, combinations that the data do not determine |

mod information;
mod levenberg;
mod linear;
mod loss;
mod nelder_mead;

pub use information::{Direction, Information};
pub use levenberg::{Linearised, Outcome, Problem, Settings, Stop, minimise};
pub use linear::{LinearFit, solve};
pub use loss::Loss;
pub use nelder_mead::{Simplex, nelder_mead};
