//! A trained policy as one ONNX file: kPa gauge in, duties out, everything a reader needs to trust it inside.
//!
//! ```text
//! observation [batch, n]  ─ MatMul ─ Sub ─ Mul ─►  features       what the network is told, scaled
//!                         ─ Gemm ─ Relu ─ … ─ Gemm ─►  hidden layers and the last one
//!                         ─ Tanh ─ Mul ─ Add ─►  action [batch, 12]
//! ```
//!
//! Opset 17, ir_version 8 (ONNX 1.12); an input and an output of one row or of any number of rows. Weights,
//! normalisation and metadata are all inside; two exports of one network are the same bytes. A file is written only
//! after it was compared with the caller's own answers ([`GoldenPair`]), which it then carries.
//!
//! | module | subject |
//! | --- | --- |
//! | [`network`] | features, dense layers, tanh: what is exported, and an independent forward pass |
//! | [`card`] | what the file says about itself: contract, provenance, golden pairs |
//! | `graph` | the network as ONNX operators |
//! | `seal` | the hash that the file carries of itself |
//! | `read` | the same back from a file that this crate wrote |
//! | `protobuf` | the wire format, as far as ONNX needs it |
//!
//! Left out: reading ONNX that others wrote (the `policy` crate does), other activations and graphs that branch.

pub mod card;
mod error;
mod graph;
pub mod network;
mod protobuf;
mod read;
mod seal;

pub use card::{GoldenPair, Provenance};
pub use error::{ExportError, ImportError};
pub use graph::{INPUT, OUTPUT, to_onnx};
pub use model::ports::{Port, Ports};
pub use network::{Dense, FeatureTerm, OutputMap, PolicyGraph};
pub use read::{Exported, from_onnx};
