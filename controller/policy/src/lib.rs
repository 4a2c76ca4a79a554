//! ONNX policies for the 50 Hz tick: one file in, twelve numbers out, nothing allocated on the way.
//!
//! A policy is a multilayer perceptron in ONNX (opset 13 to 20) with one float32 input `[1, n]` or
//! `[batch, n]` and one float32 output `[1, m]`; `n`, `m`, their names, units and physical ranges are
//! a [`PolicySignature`]; the caller hands in all that it flies, and the file says which one it was made for.
//! Observations come in the contract's units (kPa gauge, duty); normalisation is part of the graph; the
//! outputs lie in the contract's ranges (duties in 0..=1, or corrections of them on either side of 0).
//!
//! ```text
//! bytes (once) -> wire scan -> protobuf -> signature -> chain of layers -> kernel
//!    |                                                                       |
//!    sha256                                  tract on the same graph -> compared on probes
//!                                            golden pairs of the file -> compared
//! ```
//!
//! tract parses the file and serves as oracle, nothing more: it allocates on every inference and its
//! rectifiers turn NaN into finite, plausible actions. What runs in the tick is `kernel`, which refuses
//! a non-finite input before it computes and a non-finite output after.
//!
//! | module | does |
//! | --- | --- |
//! | [`policy_signature`] | what a policy must take and give |
//! | `file` | reads at most 16 MiB of a regular file, tells a truncated file from a foreign one |
//! | `content_hash` | whether the bytes are still those that were exported |
//! | `metadata` | the keys of `metadata_props`; golden pairs |
//! | `signature`, `constant`, `node`, `chain` | the graph's outside, weights, nodes; the graph as a chain of layers, or why it is none |
//! | `activation`, `kernel` | the arithmetic, the same bits on every machine |
//! | `oracle`, `probe`, `rounding` | tract, the inputs on which both must agree, and how closely they can |
//! | `policy` | [`Policy::load`] and [`Policy::run`] |
//! | `error`, `golden_problem`, `refused`, `wording` | why a file, its pairs or one inference are refused, and foreign words in messages |
//!
//! Left out: recurrent cells, convolutions and branching graphs (residuals, attention); float16 and
//! quantised weights; weights in side files; signatures over the file (`admission`).

mod activation;
mod chain;
mod constant;
mod content_hash;
mod error;
mod file;
mod golden_problem;
mod graph_signature;
mod kernel;
mod metadata;
mod node;
mod oracle;
mod policy;
pub mod policy_signature;
mod probe;
mod refused;
mod rounding;
mod wording;

pub use chain::SUPPORTED_OPS;
pub use error::{Fault, PolicyError};
pub use file::{Links, MAX_FILE_BYTES, PolicyHash, hash, read};
pub use metadata::Metadata;
pub use policy::{Checks, Policy};
pub use policy_signature::{Channel, PolicySignature};
pub use refused::Refused;
