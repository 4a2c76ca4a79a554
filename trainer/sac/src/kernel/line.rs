//! The unit of memory: 16 floats in one cache line.

/// Floats in a line.
pub(crate) const WIDTH: usize = 16;
/// Samples in a panel: two lines for each feature.
pub(crate) const LANES: usize = 2 * WIDTH;

/// One cache line of floats.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(64))]
pub(crate) struct Line(pub(crate) [f32; WIDTH]);

impl Line {
    pub(crate) const ZERO: Self = Self([0.0; WIDTH]);
}

/// Lines that hold this many floats.
pub(crate) const fn lines_for(floats: usize) -> usize {
    floats.div_ceil(WIDTH)
}

/// Lines from one block of 16 inputs to the next in a layer of so many rows.
///
/// A tile takes 12 lines of each block. Were blocks 64 lines apart, or a divisor or multiple of that, these would all
/// compete for the same few sets of the first-level cache, whose sets repeat every 64 lines, and drive out the panel.
pub(crate) const fn row_step(rows: usize) -> usize {
    if rows < 64 { rows } else { rows + (64 + 12 - rows % 64) % 64 }
}
