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
/// The least rows of a piece that a change of the relay ends or begins: 1 s.
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
    /// Place of each of their readings among those of the whole recordings.
    pub places: Vec<usize>,
    /// Change that they are cut at.
    pub change: Change,
}

impl BehindChanges {
    /// The recordings without what no model has of a pump that is switched or starts; `None` where it is neither, and where the changes
    /// follow on each other so closely that nothing lies between them.
    pub fn of(rig: &Rig, records: &Records) -> Option<Self> {
        let (change, parts) = parts(rig, records)?;
        let (records, places) = records.parts(&parts);
        (!records.records().is_empty()).then_some(BehindChanges { records, places, change })
    }
}

/// Parts of the recordings (index and rows) between changes of their pumps, and the change that tells most; `None` where there is none.
/// A gap alone makes no part: runs go through it, and what is in one part shares its rows out as one recording.
fn parts(rig: &Rig, records: &Records) -> Option<(Change, Vec<(usize, Range<usize>)>)> {
    let mut parts = Vec::new();
    let mut told = None;
    for (record, columns) in records.records().iter().enumerate() {
        let mut start = 0;
        let mut before = None;
        for (row, change) in changes(rig, records, record) {
            if told != Some(Change::Switched) {
                told = Some(change);
            }
            parts.extend(part(start..row, [before, Some(change)]).map(|rows| (record, rows)));
            start = row + SWITCHING_ROWS;
            before = Some(change);
        }
        parts.extend(part(start..columns.time_s.len(), [before, None]).map(|rows| (record, rows)));
    }
    told.map(|change| (change, parts))
}

/// Rows between two changes, if they are enough: what a change of the relay leaves has a least length, and no other part.
fn part(rows: Range<usize>, between: [Option<Change>; 2]) -> Option<Range<usize>> {
    let least = if between.contains(&Some(Change::Switched)) { LEAST_ROWS } else { 1 };
    (rows.end >= rows.start + least).then_some(rows)
}

/// Rows of a recording at which a pump changes, in order. What a motor that comes up and the first strokes into empty chambers are off by
/// (several kPa) passes for another volume, so a start is one where a stretch begins with it. A relay that is another behind a gap
/// was switched within it.
fn changes(rig: &Rig, records: &Records, record: usize) -> Vec<(usize, Change)> {
    let Some(columns) = records.records().get(record) else { return Vec::new() };
    let states = records.relays(rig, record);
    let on = |row: usize| states.iter().map(move |state| state.get(row).is_none_or(|on| *on));
    let switched = (1..columns.time_s.len()).filter(|row| on(*row).ne(on(row - 1)));
    let starts = columns.segments.iter().filter(|segment| begins_with_a_start(rig, records, record, segment));
    let starts = starts.map(|segment| (segment.start, Change::Starts));
    // A row is a switch before it is a start.
    let mut changes: Vec<(usize, Change)> = switched.map(|row| (row, Change::Switched)).chain(starts).collect();
    changes.sort_by_key(|(row, _)| *row);
    changes.dedup_by_key(|(row, _)| *row);
    changes
}

/// Tells whether the pump starts where a stretch begins.
fn begins_with_a_start(rig: &Rig, records: &Records, record: usize, segment: &Range<usize>) -> bool {
    let behind = segment.start + SWITCHING_ROWS;
    let stands = |row: usize| {
        let channels = 0..records.layout().channels();
        let at: Vec<f64> = channels.filter_map(|c| records.channel_kpa(record, c).get(row)).copied().collect();
        FreeRunStart::for_readings(&at) == FreeRunStart::AtRest
    };
    let strokes = rig.pumps.values().any(|pump| matches!(pump, Pump::Piston(_)));
    let runs = || records.relays(rig, record).iter().all(|on| on.get(segment.start).is_none_or(|on| *on));
    let starts = strokes && segment.len() >= SWITCHING_ROWS + LEAST_ROWS && stands(segment.start) && !stands(behind);
    starts && runs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::{Role, Split};
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
        assert!(BehindChanges::of(&rig, &recorded(&|_| 1.0)).is_none());
        // Off at row 300, on at 600; the last switch is too near the end for a piece after it.
        let switched = recorded(&|k| if (300..600).contains(&k) || k >= 940 { 0.0 } else { 1.0 });
        let BehindChanges { records: cut, places, change } = BehindChanges::of(&rig, &switched).unwrap();
        assert_eq!(change, Change::Switched);
        let rows: Vec<usize> = cut.records().iter().map(|r| r.time_s.len()).collect();
        assert_eq!(rows, [300, 270, 310]);
        // Rows keep their readings.
        assert_eq!(cut.readings_kpa().len(), places.len());
        let readings = switched.readings_kpa();
        assert!(cut.readings_kpa().iter().zip(&places).all(|(reading, place)| *reading == readings[*place]));
        assert_eq!(cut.records()[1].time_s[0], 0.02 * 330.0);
        // Switched every half second: nothing lies between.
        assert!(BehindChanges::of(&rig, &recorded(&|k| f64::from(u8::from(k / 25 % 2 == 0)))).is_none());
    }

    /// Rows of a recording: a minute.
    const ROWS: usize = 3000;

    /// A recording of rows 20 ms apart with a second left out before each of some rows.
    fn recorded(source: &str, gaps: &[usize], columns: [&dyn Fn(usize) -> f64; 2]) -> Recording {
        let missing = |k: usize| gaps.iter().filter(|row| **row <= k).count();
        let time_s: Vec<f64> = (0..ROWS).map(|k| 0.02 * k as f64 + missing(k) as f64).collect();
        let column = |name: &str, of: &dyn Fn(usize) -> f64| Column {
            name: name.to_owned(),
            data: ColumnData::Numbers((0..ROWS).map(of).collect()),
        };
        let [p_pos_kpa, on] = columns;
        let columns = vec![
            column("u_pos", &|_| 0.8),
            column("u_neg", &|_| 0.8),
            column("p_pos_kpa", p_pos_kpa),
            column("p_neg_kpa", &|k| -0.8 * p_pos_kpa(k)),
            column("pump_on", on),
        ];
        Recording::new(source, time_s, columns).unwrap()
    }

    /// Gaps make no recordings of their own: by their number the rows would be shared out as if there were many.
    #[test]
    fn a_recording_with_a_start_and_four_gaps_stays_one() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let gaps = [600, 1200, 1800, 2400];
        let of = |stood: &dyn Fn(usize) -> bool| {
            let p_pos_kpa = |k: usize| if stood(k) { 0.0 } else { 90.0 + 1e-3 * k as f64 };
            let records = Records::new(&rig, &[recorded("made", &gaps, [&p_pos_kpa, &|_| 1.0])]).unwrap();
            assert_eq!(records.records()[0].segments.len(), 5);
            BehindChanges::of(&rig, &records).unwrap()
        };
        let rows = |behind: &BehindChanges| -> Vec<usize> {
            behind.records.records().iter().map(|r| r.time_s.len()).collect()
        };
        let begun = of(&|k| k < 10);
        assert_eq!((begun.change, rows(&begun)), (Change::Starts, vec![ROWS - SWITCHING_ROWS]));
        assert_eq!(begun.records.records()[0].segments.len(), 5);
        assert_eq!(begun.records.records()[0].time_s[0], 0.02 * SWITCHING_ROWS as f64);
        // It stood in a gap, and starts behind it.
        let again = of(&|k| (1200..1210).contains(&k));
        assert_eq!((again.change, rows(&again)), (Change::Starts, vec![1200, ROWS - 1200 - SWITCHING_ROWS]));
    }

    /// Only what is cut at a relay lies in pieces, of which nothing is validation data, and only there is a short stretch left out.
    #[test]
    fn a_recording_with_gaps_beside_a_switched_one_stays_whole_and_has_validation_data() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let p_pos_kpa = |k: usize| 90.0 + 1e-3 * k as f64;
        let recordings = [
            recorded("whole", &[], [&p_pos_kpa, &|_| 1.0]),
            recorded("gaps", &[1500, 1530], [&p_pos_kpa, &|_| 1.0]),
            recorded("switched", &[], [&p_pos_kpa, &|k| f64::from(u8::from(k < 1500))]),
            // Off before the gap and on behind it.
            recorded("within", &[1500], [&p_pos_kpa, &|k| f64::from(u8::from(k >= 1500))]),
        ];
        let behind = BehindChanges::of(&rig, &Records::new(&rig, &recordings).unwrap()).unwrap();
        assert_eq!(behind.change, Change::Switched);
        let records = behind.records.records();
        let rows: Vec<(&str, usize)> = records.iter().map(|r| (r.source.as_str(), r.time_s.len())).collect();
        let cut = 1500 - SWITCHING_ROWS;
        assert_eq!(
            rows,
            [("whole", ROWS), ("gaps", ROWS), ("switched", 1500), ("switched", cut), ("within", 1500), ("within", cut)]
        );
        let split = Split::of(&behind.records);
        for record in 0..records.len() {
            let is_held_out = split.of_role(Role::HeldOut).any(|stretch| stretch.record == record);
            assert_eq!(is_held_out, record < 2, "{record}");
        }
    }
}
