//! Recordings cut at their long gaps: a logger that went on the next day, or a clock that was set.
//!
//! Behind such a gap everything begins anew that no sensor shows. Nobody knows where the pump's crank stands after hours, nor how
//! far a sensor has drifted; and a pump's speed that were to keep step through hours would have to be told to a millionth, which a
//! search pays for with as many steps as the gap has turns ([`fit::simulate::tachometer`]).

use std::ops::Range;

use fit::data::Records;

/// Seconds without rows, all gaps of a part together, through which what no sensor shows is carried on.
const CARRIED_ON_S: f64 = 10.0;

/// The recordings in parts that lack no more than 10 s of rows each, every one begun anew, and which reading each of theirs was;
/// `None` where no gap is so long.
pub(crate) fn apart(records: &Records) -> Option<(Records, Vec<usize>)> {
    let mut parts: Vec<(usize, Range<usize>)> = Vec::new();
    let mut cut = false;
    for (record, r) in records.records().iter().enumerate() {
        let mut start = 0;
        let mut lacking_s = 0.0;
        for pair in r.segments.windows(2) {
            let (Some(before), Some(behind)) = (pair.first(), pair.last()) else { continue };
            let at = |row: usize| r.time_s.get(row).copied().unwrap_or(0.0);
            lacking_s += (at(behind.start) - at(before.end.saturating_sub(1))).abs();
            if lacking_s > CARRIED_ON_S {
                parts.push((record, start..behind.start));
                (start, lacking_s, cut) = (behind.start, 0.0, true);
            }
        }
        parts.push((record, start..r.time_s.len()));
    }
    cut.then(|| {
        let (apart, places) = records.parts(&parts);
        (apart.begun_anew(), places)
    })
}

#[cfg(test)]
mod tests {
    use model::rig::Rig;
    use proto::recording::Recording;

    use super::*;
    use crate::recordings::pieces::taken;

    /// Rows 20 ms apart, with a gap of so many seconds before each of some rows.
    fn with_gaps(gaps: &[(u32, f64)]) -> Records {
        let later = |row: u32| gaps.iter().filter(|(before, _)| *before <= row).map(|(_, gap_s)| gap_s).sum::<f64>();
        let rows: String =
            (0..1_500).map(|k| format!("{:.2},0.8,0.8,{k},-60\n", 0.02 * f64::from(k) + later(k))).collect();
        let text = format!("time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa\n{rows}");
        let recording = Recording::parse_csv("run.csv", text.as_bytes()).unwrap();
        Records::new(&Rig::builtin("dual_pressure").unwrap(), &[recording]).unwrap()
    }

    #[test]
    fn behind_a_day_without_rows_a_part_begins_anew() {
        let records = with_gaps(&[(700, 86_400.0), (900, 600.0)]);
        let (parts, places) = apart(&records).unwrap();
        let rows: Vec<usize> = parts.records().iter().map(|part| part.time_s.len()).collect();
        assert_eq!(rows, [700, 200, 600]);
        for part in parts.records() {
            assert_eq!((part.elapsed_s(0), part.before.rows()), (0.0, 0));
            // No part lasts longer than its rows, which is what every search over time goes through.
            let lasts_s = part.elapsed_s(part.time_s.len() - 1);
            assert!(lasts_s < 0.02 * part.time_s.len() as f64, "{lasts_s}");
        }
        assert_eq!(taken(records.readings_kpa(), &places), parts.readings_kpa());
    }

    #[test]
    fn short_gaps_are_carried_through_until_they_add_up() {
        assert!(apart(&with_gaps(&[(700, 2.0), (900, 3.0)])).is_none());
        let (parts, _) = apart(&with_gaps(&[(300, 4.0), (600, 4.0), (900, 4.0), (1_200, 4.0)])).unwrap();
        let rows: Vec<usize> = parts.records().iter().map(|part| part.time_s.len()).collect();
        assert_eq!(rows, [900, 600]);
    }
}
