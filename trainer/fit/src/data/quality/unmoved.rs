//! Pressures that something moves in a rig that nothing moves.
//!
//! A rig without pump, source and command can only settle: each pressure stays between those it began with and the open air. A
//! recording that leaves these bounds was moved by what the rig file does not have, and any physics that a search found for it
//! would be made up. A chamber under pressure that is left to itself stays within them, and its leak can be told.

use model::rig::Rig;

use super::{Finding, Severity, Trouble};
use crate::data::{Noise, Records};

/// Samples that say where a stretch begins.
const FIRST: usize = 5;
/// Share of what was recorded at most by which warming air and sensors may leave the bounds …
const SHARE: f64 = 0.05;
/// … and deviations of the noise.
const NOISES: f64 = 10.0;

pub(super) fn check(rig: &Rig, records: &Records, noise: &[Noise], findings: &mut Vec<Finding>) {
    if !rig.pumps.is_empty() || !rig.sources.is_empty() || !records.inputs().is_empty() {
        return;
    }
    for (record, r) in records.records().iter().enumerate() {
        for rows in &r.segments {
            let samples: Vec<usize> = rows.clone().filter(|row| r.is_measured(*row)).collect();
            let of = |channel: usize| -> Vec<f64> {
                let values = records.channel_kpa(record, channel);
                samples.iter().filter_map(|row| values.get(*row)).copied().collect()
            };
            let all: Vec<Vec<f64>> = (0..records.sensors().len()).map(of).collect();
            let begun = all.iter().map(|values| middle(values.get(..FIRST.min(values.len())).unwrap_or_default()));
            let (low, high) = begun.fold((0.0_f64, 0.0_f64), |(low, high), p| (low.min(p), high.max(p)));
            for (channel, values) in all.iter().enumerate() {
                let largest = values.iter().fold(0.0, |most: f64, p| most.max(p.abs()));
                let margin = (SHARE * largest).max(NOISES * noise.get(channel).map_or(0.0, |n| n.sigma_kpa));
                let Some(beyond) = values.iter().find(|p| **p > high + margin || **p < low - margin) else { continue };
                let column = records.sensors().get(channel).cloned().unwrap_or_default();
                let most = values.iter().copied().fold(*beyond, |most, p| if p.abs() > most.abs() { p } else { most });
                findings.push(Finding {
                    source: r.source.clone(),
                    column,
                    severity: Severity::Unusable,
                    trouble: Trouble::NothingMoves,
                    text: format!(
                        "goes to {most:.1} kPa, and nothing in this rig can move a pressure: no pump, no source, no command. Add to the rig \
                         file what moved it (a pump with its command, a source with its signal), or keep only the rows after it"
                    ),
                });
                return;
            }
        }
    }
}

fn middle(values: &[f64]) -> f64 {
    let mut values = values.to_vec();
    let at = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(at, f64::total_cmp).1 }
}
