//! Units of pressure that a file says of its columns itself.

/// A unit that a file says of a column, by which its numbers were brought to gauge kPa. It may be wrong: what a logger is told to write
/// over a column is not what it measures.
#[derive(Debug, Clone, PartialEq)]
pub struct FileUnit {
    /// The rig's column.
    pub column: String,
    /// The unit, as the file writes it.
    pub text: String,
    /// kPa per unit.
    pub kpa: f64,
}
