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

/// This many lines of zeros.
pub(crate) fn zeroed(lines: usize) -> Vec<Line> {
    vec![Line::ZERO; lines]
}

/// Lines that hold this many floats.
pub(crate) const fn lines_for(floats: usize) -> usize {
    floats.div_ceil(WIDTH)
}
