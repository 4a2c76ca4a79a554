//! Recordings in pieces of a few seconds, each run freely from its own first pressures: what went wrong before is forgotten.

use std::ops::Range;

use fit::data::Records;

/// Rows of a piece, at least: 4 s.
const PIECE_ROWS: usize = 200;

/// The recordings in pieces of `PIECE_ROWS` rows or a little more, and which reading each of theirs was.
pub fn pieces(records: &Records) -> (Records, Vec<usize>) {
    let mut parts: Vec<(usize, Range<usize>)> = Vec::new();
    for (record, r) in records.records().iter().enumerate() {
        for segment in &r.segments {
            let count = (segment.len() / PIECE_ROWS).max(1);
            let at = |k: usize| segment.start + segment.len() * k / count;
            parts.extend((0..count).map(|k| (record, at(k)..at(k + 1))));
        }
    }
    records.parts(&parts)
}

/// Weights of the readings at some places.
pub(crate) fn taken(weights: &[f64], places: &[usize]) -> Vec<f64> {
    places.iter().map(|place| weights.get(*place).copied().unwrap_or(0.0)).collect()
}
