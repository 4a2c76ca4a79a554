//! Units that are said of a column.

/// A unit that a file or its map says of a column, by which its numbers were brought to the rig's: gauge kPa, shares of 1. It may be wrong: what a logger is
/// told to write over a column is not what it measures.
#[derive(Debug, Clone, PartialEq)]
pub struct FileUnit {
    /// The rig's column.
    pub column: String,
    /// The unit, as it is written.
    pub text: String,
    /// Rig's unit per number.
    pub scale: f64,
    /// Rig's unit at zero: not nought of an absolute pressure and of what a sensor puts out.
    pub zero: f64,
    /// Place where it is said.
    pub by: UnitSource,
}

/// Place where a unit is said.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum UnitSource {
    /// In the file itself.
    File,
    /// In the rig file's `[recording]`.
    Map,
}

impl FileUnit {
    /// The number that one in the rig's unit was made from.
    pub fn written(&self, read: f64) -> f64 {
        (read - self.zero) / self.scale
    }

    /// Words for who says which unit: `the file says psi`.
    pub fn says(&self) -> String {
        let who = match self.by {
            UnitSource::File => "the file",
            UnitSource::Map => "the rig file",
        };
        format!("{who} says {}", self.text)
    }
}
