//! Soft Actor-Critic with CAPS on the CPU: the learning core, no environment and no files.
//!
//! Soft Actor-Critic (Haarnoja et al. 2018) with twin critics, slow targets, a tanh-Gaussian actor and a learned
//! temperature; CAPS (Mysore et al. 2021) as the paper's (8)-(10). Gradients are written by hand and checked against
//! finite differences and against torch in double precision.
//!
//! * [`Learner`] remembers transitions, acts and updates; its whole state goes to bytes and back.
//! * [`Regression`] moves a policy towards answers that it is given.
//! * [`Network`] is the policy by itself, for export and evaluation.
//! * [`FeatureMap`] leads from the raw observation to the network's inputs.
//!
//! Same seed, same bytes: on any number of threads and with any instruction set (see the `kernel` module).

#![allow(clippy::needless_range_loop)] // reason: a loop over lanes reads alike for every array it indexes

mod actor_step;
mod adam;
mod batch;
mod bytes;
mod checkpoint;
mod critic_step;
mod elementary;
mod feature_map;
mod kernel;
mod learner;
mod measure;
mod min_q;
mod network;
mod network_step;
mod parameters;
mod policy_sample;
mod random;
mod regression;
mod replay;
mod settings;
mod trace;
mod warm_start;
mod workers;

pub use checkpoint::CheckpointError;
pub use feature_map::{Feature, FeatureMap};
pub use kernel::{Cpu, InstructionSet};
pub use learner::{Learner, LearnerError, Machine, UpdateReport};
pub use measure::{UpdateSpeed, fma_peak, synthetic_learner, update_speed};
pub use network::{Dense, Network, NetworkError, Workspace};
pub use regression::{Lesson, Moments, Regression};
pub use replay::{Transition, TransitionError};
pub use settings::{Settings, SettingsError, Shape, TemperatureRule};

#[cfg(test)]
mod tests;
