//! The turning of the pump, told by its ripple, and pumps that were switched.

pub(crate) mod answer;
pub(crate) mod crank;
pub(crate) mod ripple;
pub(crate) mod switched;
pub(crate) mod turning;
