//! Recordings as a diagnosis takes them: checked, cut where no run goes through, with the axes that a mismatch may follow.

pub(crate) mod axes;
pub(crate) mod checked;
pub mod closed_volumes;
mod long_gaps;
pub mod pieces;
pub(crate) mod unmovable_pressure;
