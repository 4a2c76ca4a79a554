//! A policy improved by rollouts: what its answers are worth is tried out in simulation instead of being learned.
//!
//! Along a flight of the policy some ticks are branched. In a branch the answers of the next [`RolloutSettings::shift_ticks`]
//! ticks are shifted by `±ε k_j`, half a sine; everything else, the rig, its noise, the policy that answers to what comes of it, is
//! the same. What the branches cost beyond the flight gives slope and curvature of the cost along that shift:
//!
//! ```text
//! J = Σ_{τ ≤ H} Σ_c [ 2 (√(1 + (e_c/s_c)²) − 1) + ρ (Δa_c)² ]
//! g = (J⁺ − J⁻)/2ε          h = (J⁺ + J⁻ − 2 J⁰)/ε²
//! â_j = a_j − clamp(g/max(h, h̄), ±M) k_j,         h̄: upper quartile of |h| in the round
//! ```
//!
//! The network is then moved towards `â` by weighted least squares ([`sac::Regression`]). As both branches and the flight share their noise, their difference
//! is that of the answers alone, where a critic would have to find a hundredth in the scatter of all that happens.
//! The policy answers within the branches, so the slope is that of the closed loop, play of the valves included.
//!
//! Sources: policy improvement by rollout with common random numbers (Bertsekas, *Rollout, Policy Iteration and Distributed
//! Reinforcement Learning*, 2020; Glasserman and Yao, *Management Science* 38 (1992)); the gradient through the answers is
//! that of Silver et al., ICML 2014.
//!
//! | file | subject |
//! | --- | --- |
//! | `probe` | flights and their branches |
//! | `lessons` | which answers the network is to give, and giving them |
//! | `run` | rounds, which policy is kept, going on |
//! | `outcome` | figures, and the policy that is kept |
//! | `files` | the checkpoint |
//! | `report` | the page |

mod files;
mod lessons;
mod outcome;
mod probe;
mod report;
mod run;

pub use outcome::{RolloutSummary, Round};
pub use run::{RolloutCallback, RolloutRun};

#[cfg(doc)]
use crate::settings::RolloutSettings;
