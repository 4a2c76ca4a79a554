//! Faults of a rig.

use std::fmt;

/// One thing wrong with a rig file: where, what, and how to mend it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RigError {
    /// Line in the file, from 1, where it is known.
    pub line: Option<usize>,
    /// Dotted key, such as `volumes.positive.volume_l`; empty where the file as a whole is meant.
    pub key: String,
    /// Fault, and what to write instead.
    pub problem: String,
}

impl RigError {
    /// A problem with the value at `key`.
    pub fn at(key: impl Into<String>, problem: impl Into<String>) -> Self {
        RigError { line: None, key: key.into(), problem: problem.into() }
    }
}

impl fmt::Display for RigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(line) = self.line {
            write!(f, "line {line}: ")?;
        }
        if !self.key.is_empty() {
            write!(f, "{}: ", self.key)?;
        }
        f.write_str(&self.problem)
    }
}

impl std::error::Error for RigError {}
