//! Fits a rig's parameters to recordings.
//!
//! | module | subject |
//! | --- | --- |
//! | [`cores`] | work side by side on the cores that are free |
//! | [`data`] | recordings as numbers; what is wrong with them; which rows are fitted and which are kept back; noise |
//! | [`parameters`] | which numbers of a rig are free, how they are scaled, what is known of them |
//! | [`identify`] | the paper's procedure and the joint refinement, with uncertainties and plain words |
//! | [`least_squares`] | Levenberg-Marquardt, simplex, covariance |
//! | [`objective`] | fits of a rig to recordings; likelihoods |
//! | [`simulate`] | many rigs run over all recordings at once: free runs, windows |
//! | [`wording`] | plain words for numbers: digits, shares, multiples of a noise |
//!
//! Pressures of recordings and simulated readings are gauge kPa throughout (`_kpa`), parameters are in the
//! units of the rig file's keys.

pub mod cores;
pub mod data;
mod error;
pub mod identify;
pub mod least_squares;
pub mod objective;
pub mod parameters;
pub mod simulate;
pub mod wording;

pub use error::FitError;
