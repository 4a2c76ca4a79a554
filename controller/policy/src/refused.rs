//! Reason why one inference gave no action.

/// One inference that gave no action; the caller flies its fallback this tick.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Refused {
    /// The observation has the wrong length.
    #[error("observation has {found} values, the policy takes {expected}")]
    InputLength {
        /// Values given.
        found: usize,
        /// Values the policy takes.
        expected: usize,
    },
    /// The action buffer has the wrong length.
    #[error("action buffer holds {found} values, the policy gives {expected}")]
    OutputLength {
        /// Places given.
        found: usize,
        /// Values the policy gives.
        expected: usize,
    },
    /// An observation is NaN or infinite.
    #[error("observation {index} is {value}")]
    InputNotFinite {
        /// Place in the observation.
        index: usize,
        /// The value.
        value: f32,
    },
    /// An action is NaN or infinite.
    #[error("action {index} is {value}")]
    OutputNotFinite {
        /// Place in the action.
        index: usize,
        /// The value.
        value: f32,
    },
}
