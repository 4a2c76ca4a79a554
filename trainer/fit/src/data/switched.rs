//! A pump that was switched while it was recorded.
//!
//! A motor takes a while to stop and to come up (30 ms to some tenths of a second with its rotor and what it drives), and
//! stops at some angle with some gas in its cylinders. The model stops at once. What that is off by at the switch a shut
//! chamber keeps for good (several kPa with the pump off and both valves shut), and it would be taken for what such a hold is
//! made to show, or for other parameters. So a recording is run freely from switch to switch: each piece from its own first
//! pressures, a little after the relay has changed.

use std::ops::Range;

use model::plant::FreeRunStart;
use model::rig::{Pump, Rig};

use super::Records;

/// Rows after a change of the relay that belong to no piece: 0.6 s.
const SWITCHING_ROWS: usize = 30;
/// The least rows of a piece: 1 s.
const LEAST_ROWS: usize = 50;

/// Changes of a pump behind which simulations start anew.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// It was switched within a recording.
    Switched,
    /// It starts where a recording begins.
    Starts,
}

impl Change {
    /// Note on where simulations start anew, and why.
    pub fn note(self) -> &'static str {
        match self {
            Change::Switched => {
                "the pump was switched: simulations start anew 0.6 s after each change, since no motor stops or starts at once"
            }
            Change::Starts => {
                "the pump starts at the beginning of a recording: simulations start 0.6 s later, since no motor starts at once"
            }
        }
    }
}

/// Recordings without the rows in which a pump comes up or stops.
#[derive(Debug, Clone, PartialEq)]
pub struct BehindChanges {
    /// The recordings, cut there.
    pub records: Records,
    /// Which reading of the whole recordings each of theirs was.
    pub places: Vec<usize>,
    /// What they are cut for.
    pub change: Change,
}

impl BehindChanges {
    /// The recordings without what no model has of a pump that is switched or starts; `None` where it is neither, and where the changes
    /// follow on each other so closely that nothing lies between them.
    pub fn of(rig: &Rig, records: &Records) -> Option<Self> {
        let (change, (records, places)) = match pieces(rig, records) {
            Some(cut) => (Change::Switched, cut),
            None => (Change::Starts, started(rig, records)?),
        };
        (!records.records().is_empty()).then_some(BehindChanges { records, places, change })
    }

    /// Weights of the readings that are left, of those of all.
    pub fn taken(&self, weights: &[f64]) -> Vec<f64> {
        self.places.iter().map(|place| weights.get(*place).copied().unwrap_or(0.0)).collect()
    }
}

/// The recordings in pieces between changes of a pump's relay, and which reading each of theirs was; `None` where no pump
/// was switched.
pub fn pieces(rig: &Rig, records: &Records) -> Option<(Records, Vec<usize>)> {
    let mut parts: Vec<(usize, Range<usize>)> = Vec::new();
    let mut switched = false;
    for (record, columns) in records.records().iter().enumerate() {
        let states = records.relays(rig, record);
        let on = |row: usize| states.iter().map(move |state| state.get(row).is_none_or(|on| *on));
        for segment in &columns.segments {
            let mut start = first_row(rig, records, record, segment);
            for row in start + 1..segment.end {
                if on(row).ne(on(row - 1)) {
                    switched = true;
                    parts.push((record, start..row));
                    start = row + SWITCHING_ROWS;
                }
            }
            parts.push((record, start..segment.end));
        }
    }
    parts.retain(|(_, rows)| rows.end >= rows.start + LEAST_ROWS);
    switched.then(|| records.parts(&parts))
}

/// The recordings without the first 0.6 s of those at whose beginning the pump starts, and which reading each of theirs was; `None` where
/// it does in none. What a motor that comes up and the first strokes into empty chambers are off by (several kPa) passes for
/// another volume.
pub fn started(rig: &Rig, records: &Records) -> Option<(Records, Vec<usize>)> {
    let mut parts: Vec<(usize, Range<usize>)> = Vec::new();
    let mut started = false;
    for (record, columns) in records.records().iter().enumerate() {
        for segment in &columns.segments {
            let first = first_row(rig, records, record, segment);
            started |= first > segment.start;
            parts.push((record, first..segment.end));
        }
    }
    started.then(|| records.parts(&parts))
}

/// The first row of a stretch that a run begins at: its own, or that behind the start of a pump.
fn first_row(rig: &Rig, records: &Records, record: usize, segment: &Range<usize>) -> usize {
    let behind = segment.start + SWITCHING_ROWS;
    let stands = |row: usize| {
        let channels = 0..records.layout().channels();
        let at: Vec<f64> = channels.filter_map(|c| records.channel_kpa(record, c).get(row)).copied().collect();
        FreeRunStart::for_readings(&at) == FreeRunStart::AtRest
    };
    let strokes = rig.pumps.values().any(|pump| matches!(pump, Pump::Piston(_)));
    let runs = || records.relays(rig, record).iter().all(|on| on.get(segment.start).is_none_or(|on| *on));
    let starts = strokes && segment.len() >= SWITCHING_ROWS + LEAST_ROWS && stands(segment.start) && !stands(behind);
    if starts && runs() { behind } else { segment.start }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::recording::Recording;
    use proto::recording::csv::{Column, ColumnData};

    #[test]
    fn pieces_lie_between_switches_and_a_pump_that_ran_leaves_a_recording_whole() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let recorded = |on: &dyn Fn(usize) -> f64| {
            let time_s: Vec<f64> = (0..1000).map(|k| 0.02 * k as f64).collect();
            let column = |name: &str, of: &dyn Fn(usize) -> f64| Column {
                name: name.to_owned(),
                data: ColumnData::Numbers((0..1000).map(of).collect()),
            };
            let columns = vec![
                column("u_pos", &|_| 0.8),
                column("u_neg", &|_| 0.8),
                column("p_pos_kpa", &|k| 90.0 + 1e-3 * k as f64),
                column("p_neg_kpa", &|_| -70.0),
                column("pump_on", on),
            ];
            Records::new(&rig, &[Recording::new("made", time_s, columns).unwrap()]).unwrap()
        };
        assert!(pieces(&rig, &recorded(&|_| 1.0)).is_none());
        // Off at row 300, on at 600; the last switch is too near the end for a piece after it.
        let switched = recorded(&|k| if (300..600).contains(&k) || k >= 940 { 0.0 } else { 1.0 });
        let (cut, places) = pieces(&rig, &switched).unwrap();
        let rows: Vec<usize> = cut.records().iter().map(|r| r.time_s.len()).collect();
        assert_eq!(rows, [300, 270, 310]);
        // Rows keep their readings.
        assert_eq!(cut.readings_kpa().len(), places.len());
        let readings = switched.readings_kpa();
        assert!(cut.readings_kpa().iter().zip(&places).all(|(reading, place)| *reading == readings[*place]));
        assert_eq!(cut.records()[1].time_s[0], 0.02 * 330.0);
        let behind = BehindChanges::of(&rig, &switched).unwrap();
        assert_eq!((behind.change, &behind.records), (Change::Switched, &cut));
        assert_eq!(behind.taken(readings), cut.readings_kpa());
        // Switched every half second: nothing lies between.
        assert!(BehindChanges::of(&rig, &recorded(&|k| f64::from(u8::from(k / 25 % 2 == 0)))).is_none());
    }
}
