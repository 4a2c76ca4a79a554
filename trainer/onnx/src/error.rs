//! Reasons why a network is not exported, or not read back: one line each, with the mend.

/// Fault of a network or of what is said about it.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ExportError {
    /// The network takes or gives another number of values than the contract.
    #[error(
        "the network has {found} {side}, observation layout v{contract} has {expected}; train and export with one layout"
    )]
    Width {
        /// `inputs` or `outputs`.
        side: &'static str,
        /// The network's number.
        found: usize,
        /// The contract's number.
        expected: usize,
        /// The contract's version.
        contract: u32,
    },
    /// A feature reads an observation that is not there.
    #[error("feature {feature} reads observation {index}, and there are {inputs}")]
    FeatureIndex {
        /// Place of the feature.
        feature: usize,
        /// Place it reads.
        index: usize,
        /// Observations there are.
        inputs: usize,
    },
    /// No layers.
    #[error("the network has no layers")]
    NoLayers,
    /// A layer that does not take what the one before it gives.
    #[error("layer {layer} takes {found} values and gets {expected}")]
    LayerWidth {
        /// Number of the layer, from 0.
        layer: usize,
        /// Values it takes.
        found: usize,
        /// Values it gets.
        expected: usize,
    },
    /// A list of weights or biases that does not fill its layer.
    #[error("layer {layer} has {found} {what} where {expected} belong")]
    LayerSize {
        /// Number of the layer, from 0.
        layer: usize,
        /// `weights` or `biases`.
        what: &'static str,
        /// Number found.
        found: usize,
        /// Number expected.
        expected: usize,
    },
    /// The output maps are not as many as the last layer's outputs.
    #[error("{found} outputs are mapped, the last layer gives {expected}")]
    OutputMaps {
        /// Maps given.
        found: usize,
        /// Values the last layer gives.
        expected: usize,
    },
    /// NaN or infinite.
    #[error("{what} {place} is {value}; the training diverged: export an earlier checkpoint")]
    NotFinite {
        /// Which list.
        what: &'static str,
        /// Place in it.
        place: usize,
        /// The value.
        value: f32,
    },
    /// An output that can leave its range.
    #[error("output {name} reaches {low} to {high}, observation layout v{contract} lets it be {lowest} to {highest}")]
    OutputRange {
        /// Name.
        name: String,
        /// Where the tanh's lower end is mapped.
        low: f32,
        /// Where its upper end is mapped.
        high: f32,
        /// Lowest allowed.
        lowest: f32,
        /// Highest allowed.
        highest: f32,
        /// The contract's version.
        contract: u32,
    },
    /// An observation or answer of the wrong length.
    #[error("{what} has {found} values, {expected} belong there")]
    RowLength {
        /// Which row.
        what: &'static str,
        /// Values it has.
        found: usize,
        /// Values that belong there.
        expected: usize,
    },
    /// The file would not compute what the caller's network does.
    #[error(
        "golden pair {pair}, output {output}: the network answered {expected}, the exported graph gives {exported}; \
         this is a bug in the export"
    )]
    GoldenDiffers {
        /// Number of the pair, from 0.
        pair: usize,
        /// Place in the output.
        output: usize,
        /// Answer of the pair.
        expected: f32,
        /// Answer of the graph.
        exported: f32,
    },
    /// More pairs than a reader takes.
    #[error("{found} golden pairs are more than {limit}")]
    TooManyGolden {
        /// Pairs given.
        found: usize,
        /// The most that are read.
        limit: usize,
    },
    /// A metadata key of the caller that the export writes itself, or that is given twice.
    #[error("metadata key {key:?} is written already; name it otherwise")]
    KeyTaken {
        /// The key.
        key: String,
    },
}

/// Reason why a policy file is not read back.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ImportError {
    /// The bytes are no ONNX file, or end too early.
    #[error("is no ONNX file, or is damaged; fetch it again")]
    Damaged,
    /// ONNX that this crate did not write.
    #[error("was not written by this trainer ({what}); the controller may fly it, the trainer cannot")]
    Foreign {
        /// Text that tells.
        what: String,
    },
    /// A network that is unsound.
    #[error("{0}")]
    Network(ExportError),
    /// Another answer than the file itself says that the network gives.
    #[error("does not answer as its golden pair {pair} says: a number in it was changed; fetch the file again")]
    Answers {
        /// Number of the pair, from 0.
        pair: usize,
    },
}
