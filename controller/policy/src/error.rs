//! Reason why a policy file is refused: one line each, with the mend.

use std::io;
use std::path::PathBuf;

use crate::chain::SUPPORTED_OPS;
use crate::file::MAX_FILE_BYTES;
use crate::golden_problem::GoldenProblem;
use crate::refused::Refused;
use crate::wording::{listed, versions};

/// A policy file that must not fly: which file, and why.
#[derive(Debug, thiserror::Error)]
#[error("{}: {fault}", file.display())]
pub struct PolicyError {
    /// The file as the caller named it.
    pub file: PathBuf,
    /// The fault.
    pub fault: Fault,
}

/// Faults of a policy file.
///
/// Names that come from the file are shown quoted and escaped, so that a message stays one line.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Fault {
    /// The file cannot be read.
    #[error("cannot be read ({source}); check the name and the permissions")]
    Unreadable {
        /// Error of the system.
        source: io::Error,
    },
    /// A directory, pipe or device.
    #[error("is not a regular file; name the .onnx file itself")]
    NotRegular,
    /// A symbolic link in a watched directory.
    #[error("is a symbolic link; put the file itself into the directory")]
    Link,
    /// More than [`MAX_FILE_BYTES`].
    #[error("has {bytes} bytes, more than the {limit} a policy may have; export the actor network alone", limit = MAX_FILE_BYTES)]
    TooLarge {
        /// Size of the file.
        bytes: u64,
    },
    /// Nothing in it.
    #[error("is empty; copy or export it again")]
    Empty,
    /// The bytes are no ONNX model.
    #[error(
        "is not an ONNX file (byte {at} starts no field of one); export the policy with trainer export or torch.onnx.export"
    )]
    NotOnnx {
        /// Offset of the first byte that does not fit.
        at: usize,
    },
    /// A field announces more bytes than follow.
    #[error("is cut short: byte {at} announces {announced} bytes and {left} follow; copy it again, whole")]
    Truncated {
        /// Offset of the field.
        at: usize,
        /// Bytes it announces.
        announced: u64,
        /// Bytes that follow.
        left: usize,
    },
    /// The outer frame is sound, something inside is not.
    #[error("is damaged inside ({reason}); copy or export it again")]
    Damaged {
        /// Message of the decoder, on one line.
        reason: String,
    },
    /// A model without a graph.
    #[error("holds no graph; export it again, with the network in it")]
    NoGraph,
    /// No opset, or one that is not known to mean what the kernel computes.
    #[error("uses ONNX opset {found}; export it with opset_version between 13 and 20")]
    Opset {
        /// Version that the file declares for the standard operators, 0 if none.
        found: i64,
    },
    /// More nodes than any policy has.
    #[error("has {found} {what}, more than {limit}; export the actor network alone")]
    TooMany {
        /// Thing of which there is too much.
        what: &'static str,
        /// Number found.
        found: usize,
        /// Number allowed.
        limit: usize,
    },
    /// More than one real input, or none.
    #[error("takes {} inputs{}; a policy takes one, all observations in one tensor", found.len(), listed(found))]
    InputCount {
        /// Their names.
        found: Vec<String>,
    },
    /// More than one output, or none.
    #[error("gives {} outputs{}; a policy gives one: export the mean action alone", found.len(), listed(found))]
    OutputCount {
        /// Their names.
        found: Vec<String>,
    },
    /// The input or output is not float32.
    #[error("{port} {name:?} is {found}; it must be float32")]
    PortType {
        /// `input` or `output`.
        port: &'static str,
        /// Name in the graph.
        name: String,
        /// Type in the graph.
        found: &'static str,
    },
    /// The input or output has no two-dimensional shape with a batch of one (or any).
    #[error("{port} {name:?} has shape {found}; it must be [1, {expected}] or [batch, {expected}] with a fixed width")]
    PortShape {
        /// `input` or `output`.
        port: &'static str,
        /// Name in the graph.
        name: String,
        /// Shape as declared.
        found: String,
        /// Width that the contract asks for.
        expected: usize,
    },
    /// The input has another number of values than the contract.
    #[error(
        "input {name:?} takes {found} values, observation layout v{contract} has {expected}; train and export with the observations of layout v{contract}"
    )]
    InputWidth {
        /// Name in the graph.
        name: String,
        /// Width.
        found: usize,
        /// The contract's width.
        expected: usize,
        /// The contract's version.
        contract: u32,
    },
    /// The output has another number of values than the contract.
    #[error(
        "output {name:?} gives {found} values, observation layout v{contract} has {expected}; train and export with the actions of layout v{contract}"
    )]
    OutputWidth {
        /// Name in the graph.
        name: String,
        /// Width.
        found: usize,
        /// The contract's width.
        expected: usize,
        /// The contract's version.
        contract: u32,
    },
    /// The declared output width is not what the layers compute.
    #[error("output {name:?} is declared with {declared} values and its layers compute {computed}; export it again")]
    OutputDeclaration {
        /// Name in the graph.
        name: String,
        /// Width in the declaration.
        declared: usize,
        /// Width that the layers compute.
        computed: usize,
    },
    /// An operator that the kernel does not have.
    #[error("node {node:?} is a {op}, which is not supported; use only {}", SUPPORTED_OPS.join(", "))]
    UnsupportedOp {
        /// The node's name.
        node: String,
        /// Operator, with the domain where it is not the standard one.
        op: String,
    },
    /// Branches or joins.
    #[error("node {node:?} ({op}) {how}; a policy must be a plain chain of layers")]
    NotAChain {
        /// The node's name.
        node: String,
        /// Operator.
        op: String,
        /// Rule of a chain that it breaks.
        how: &'static str,
    },
    /// A value that no earlier node makes.
    #[error("node {node:?} ({op}) reads {value:?}, which nothing before it makes; export it again")]
    UnknownValue {
        /// The node's name.
        node: String,
        /// Operator.
        op: String,
        /// The value it reads.
        value: String,
    },
    /// Two things in the graph have one name.
    #[error("makes the value {value:?} twice; export it again")]
    DuplicateValue {
        /// The name.
        value: String,
    },
    /// The output is not the end of the chain.
    #[error(
        "output {name:?} is not the last value of the chain, which is {last:?}; export the network from observation to action and nothing else"
    )]
    OutputNotLast {
        /// The declared output.
        name: String,
        /// Place where the chain ends.
        last: String,
    },
    /// A node with the wrong number of inputs or outputs.
    #[error("node {node:?} ({op}) has {found} {side}, which this operator does not take; export it again")]
    Arity {
        /// The node's name.
        node: String,
        /// Operator.
        op: String,
        /// `inputs` or `outputs`.
        side: &'static str,
        /// Number found.
        found: usize,
    },
    /// An attribute that the kernel does not know, or with a value it cannot follow.
    #[error("node {node:?} ({op}) has attribute {attribute:?} {problem}")]
    Attribute {
        /// The node's name.
        node: String,
        /// Operator.
        op: String,
        /// The attribute's name.
        attribute: String,
        /// Problem and mend.
        problem: &'static str,
    },
    /// Operands whose sizes do not meet.
    #[error("node {node:?} ({op}) meets {width} values with a constant of shape {dims:?}; {mend}")]
    Sizes {
        /// The node's name.
        node: String,
        /// Operator.
        op: String,
        /// Width of the running value.
        width: usize,
        /// Shape of the constant.
        dims: Vec<usize>,
        /// Mend that would fit.
        mend: &'static str,
    },
    /// A value divided by a constant zero.
    #[error("node {node:?} divides value {index} by 0; give an input that never varies a deviation of 1")]
    DivisionByZero {
        /// The node's name.
        node: String,
        /// Place in the running value.
        index: usize,
    },
    /// A clip whose bounds are crossed.
    #[error("node {node:?} clips to [{low}, {high}], which is empty; export it again with min below max")]
    ClipBounds {
        /// The node's name.
        node: String,
        /// Lower bound.
        low: f32,
        /// Upper bound.
        high: f32,
    },
    /// A constant of a type that the operator does not take.
    #[error("weight {tensor:?} is {found}; export the policy in float32")]
    WeightType {
        /// Name.
        tensor: String,
        /// Type.
        found: &'static str,
    },
    /// A weight that is NaN or infinite.
    #[error("weight {tensor:?} holds {value} at place {index}; training diverged: export an earlier checkpoint")]
    WeightNotFinite {
        /// Name.
        tensor: String,
        /// Place in row-major order.
        index: usize,
        /// The value.
        value: f64,
    },
    /// A weight whose data do not fill its shape.
    #[error("weight {tensor:?} has shape {dims:?} and {bytes} bytes of data; export it again")]
    WeightSize {
        /// Name.
        tensor: String,
        /// Shape.
        dims: Vec<i64>,
        /// Bytes of data in the file.
        bytes: usize,
    },
    /// Weights in a second file.
    #[error(
        "keeps weight {tensor:?} in another file; export with all weights inside (onnx.save_model(..., save_as_external_data=False))"
    )]
    ExternalWeights {
        /// The weight's name.
        tensor: String,
    },
    /// Weights in sparse form.
    #[error("holds sparse weights; export them dense")]
    SparseWeights,
    /// More arithmetic than the tick can give.
    #[error("needs {operations} operations a tick, more than {limit}; train a smaller network")]
    TooSlow {
        /// Multiply-adds, with an activation counted as 100.
        operations: u64,
        /// The most a policy may need.
        limit: u64,
    },
    /// The file is not the one that its exporter wrote.
    #[error(
        "says sha256 {stated:.16} of itself and has {found:.16}: a byte has changed since it was exported; copy or export it again"
    )]
    ContentHash {
        /// Hash that its metadata state.
        stated: String,
        /// Hash of its bytes.
        found: String,
    },
    /// A file of an exporter that writes a hash, without one.
    #[error(
        "lost the hash of itself that its exporter wrote (metadata key \"content_sha256\"); copy or export it again"
    )]
    ContentHashMissing,
    /// A value in the place of the hash that is none.
    #[error(
        "says {stated:?} of itself where a hash of 64 digits belongs (metadata key \"content_sha256\"); copy or export it again, or leave the key out"
    )]
    ContentHashUnreadable {
        /// Value that its metadata state.
        stated: String,
    },
    /// A hash that is right, without the key that promises it.
    #[error(
        "has its hash (metadata key \"content_sha256\") and not the key \"export_format\" that goes with it; export it with both or neither"
    )]
    ContentHashUnpromised,
    /// A metadata key given twice.
    #[error("metadata key {key:?} stands twice; keep one")]
    MetadataTwice {
        /// The key.
        key: String,
    },
    /// The metadata names a contract that this program does not fly.
    #[error(
        "metadata key \"contract\" is {found:?}; this controller knows {}: retrain, or install the controller that goes with it",
        versions(known)
    )]
    ContractUnknown {
        /// Value that the file states.
        found: String,
        /// Versions that the caller handed in.
        known: Vec<u32>,
    },
    /// The metadata contradict the contract.
    #[error(
        "metadata key {key:?} says {found:?}, observation layout v{contract} says {expected:?}; export with the settings of layout v{contract}"
    )]
    MetadataContradicts {
        /// The key.
        key: &'static str,
        /// Value that the file states.
        found: String,
        /// Value that the contract states.
        expected: String,
        /// The contract's version.
        contract: u32,
    },
    /// Golden pairs that cannot be read.
    #[error("metadata key {key:?}, pair {pair}: {problem}; write comma-separated numbers, pairs parted by semicolons")]
    GoldenUnreadable {
        /// The key.
        key: &'static str,
        /// Number of the pair, from 1.
        pair: usize,
        /// The problem.
        problem: GoldenProblem,
    },
    /// The policy does not reproduce a golden pair.
    #[error(
        "golden pair {pair}, output {output}: the policy gives {ours}, its metadata say {expected}; the weights are not those it was exported with: export it again"
    )]
    GoldenDiffers {
        /// Number of the pair, from 1.
        pair: usize,
        /// Place in the output.
        output: usize,
        /// Value of the kernel.
        ours: f32,
        /// Value that the file states.
        expected: f32,
    },
    /// The kernel gives no action on a golden pair.
    #[error("gives no action on golden pair {pair} ({refused}); its weights overflow: export an earlier checkpoint")]
    GoldenRefused {
        /// Number of the pair, from 1.
        pair: usize,
        /// Refusal of the kernel.
        refused: Refused,
    },
    /// tract cannot load what the kernel can.
    #[error("is refused by the second reader, tract ({reason}); export it again with opset 17")]
    OracleRefused {
        /// Message of tract, on one line.
        reason: String,
    },
    /// Kernel and tract compute different actions.
    #[error(
        "output {output} is {ours} by the controller's kernel and {tract} by tract on probe {probe}, more than rounding explains; keep the file and report it: one of the two is wrong"
    )]
    OracleDiffers {
        /// Number of the probe.
        probe: usize,
        /// Place in the output.
        output: usize,
        /// Value of the kernel.
        ours: f32,
        /// Value of tract.
        tract: f32,
    },
    /// An output leaves what the actuator takes.
    #[error(
        "output {output} reaches {value}; {unit} must lie in [{low}, {high}]: end the graph with Clip, or with Sigmoid or Tanh mapped to that range"
    )]
    OutputRange {
        /// Place in the output.
        output: usize,
        /// The worst value seen.
        value: f32,
        /// The output's unit.
        unit: String,
        /// Lowest allowed.
        low: f32,
        /// Highest allowed.
        high: f32,
    },
    /// The kernel refuses an input of the physical range.
    #[error("gives no action on probe {probe} ({refused}); its weights overflow: export an earlier checkpoint")]
    ProbeRefused {
        /// Number of the probe.
        probe: usize,
        /// Refusal of the kernel.
        refused: Refused,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hostile_name_stays_on_one_line() {
        let fault = Fault::UnsupportedOp { node: "a\nb\u{1b}[31m".into(), op: "Lstm".into() };
        let text = PolicyError { file: "p.onnx".into(), fault }.to_string();
        assert!(text.starts_with("p.onnx: node \"a\\nb\\u{1b}[31m\" is a Lstm"), "{text}");
        assert_eq!(text.lines().count(), 1);
    }
}
