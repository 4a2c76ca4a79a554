//! The stages that a policy passes on this machine before it may touch the rig.
//!
//! | stage | asks |
//! | --- | --- |
//! | `file` | a regular file of at most 16 MiB, no link |
//! | `signature` | where `policy.require_signature` says so: a minisign signature beside it |
//! | `network` | ONNX, contract, operators, finite weights, hash of itself, golden pairs, agreement with a second program, time of an inference (crate `policy`) |
//! | `answers` | whether its answers depend on what it is told |
//! | `trial` | sixteen simulated rigs: envelope, limit cycles, tracking beside fallback and incumbent |
//!
//! The stages after them are on the rig: shadow, authority ramp, probation (crate `controller`). Nothing here may
//! run in the tick: it allocates, reads files and takes seconds.

pub mod answers;
mod draw;
pub mod examination;
pub mod model_comparison;
pub mod signature;
pub mod signatures;
pub mod standing;
pub mod trial;

pub use answers::Answers;
pub use examination::{Admitted, Examiner, Refusal, Stage};
pub use signature::SignatureRule;
pub use standing::Standing;
pub use trial::{Limits, Tally, Trial, TrialFigures};
