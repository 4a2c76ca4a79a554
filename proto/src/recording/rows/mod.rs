//! Samples of any rate to rows of 20 ms: lost rows bridged, repeated, doubled and unfilled ones taken out, sensors of several rates.

pub(crate) mod asynchronous;
pub(crate) mod doubled;
pub(crate) mod how_read;
pub(crate) mod lost_rows;
pub(crate) mod own_rows;
pub(crate) mod repeated;
pub(crate) mod resample;
pub(crate) mod slower;
pub(crate) mod uneven;
pub(crate) mod unfilled;
