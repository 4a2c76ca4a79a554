//! Reason why the golden pairs in a file's metadata cannot be read.

/// Faults of a golden pair.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GoldenProblem {
    /// Only one of the two keys is there, or they hold different numbers of pairs.
    #[error("golden_input holds {inputs} pairs and golden_output {outputs}")]
    Count {
        /// Pairs in `golden_input`.
        inputs: usize,
        /// Pairs in `golden_output`.
        outputs: usize,
    },
    /// More pairs than are taken.
    #[error("{found} pairs are more than {most}, the most that are taken")]
    TooMany {
        /// Pairs that are there.
        found: usize,
        /// Most that are taken.
        most: usize,
    },
    /// A pair of the wrong width.
    #[error("{found} numbers where {expected} belong")]
    Width {
        /// Numbers found.
        found: usize,
        /// Numbers wanted.
        expected: usize,
    },
    /// Something that is no finite number.
    #[error("{text:?} is no finite number")]
    Number {
        /// Text that stands there.
        text: String,
    },
}
