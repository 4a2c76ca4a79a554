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

#[cfg(test)]
mod tests {
    use model::rig::Rig;
    use proto::recording::Recording;

    use super::*;

    #[test]
    fn pieces_hold_every_reading_once_and_none_is_short() {
        let rows: String = (0..1_499).map(|k| format!("{:.2},0.8,0.8,{k},-60\n", 0.02 * f64::from(k))).collect();
        let text = format!("time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa\n{rows}");
        let recording = Recording::parse_csv("run.csv", text.as_bytes()).unwrap();
        let records = Records::new(&Rig::builtin("dual_pressure").unwrap(), &[recording]).unwrap();
        let (parts, places) = pieces(&records);
        assert_eq!(parts.records().len(), 7);
        assert!(parts.records().iter().all(|part| part.segments.iter().all(|rows| rows.len() >= PIECE_ROWS)));
        let readings = records.readings_kpa();
        assert_eq!(taken(readings, &places), parts.readings_kpa());
        let mut sorted = places;
        sorted.sort_unstable();
        assert_eq!(sorted, (0..readings.len()).collect::<Vec<_>>());
    }
}
