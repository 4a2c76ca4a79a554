//! Pressures that leave the atmosphere while the relays say that every pump is off.
//!
//! A relay that is wired or logged the other way round (0 is on) is common. On a rig that nothing else drives no model is needed to see
//! it: air goes from chamber to chamber and to the air outside, so that no pressure goes beyond the highest and the lowest that there were
//! when the pumps had come to rest. Rigs with other drives, or with chambers that nobody reads, are left to free runs
//! ([`super::mistaken`]).

use std::ops::Range;

use model::rig::{Pump, Rig};

use super::duties::{Is, inverted};
use super::{Finding, Trouble};
use crate::data::{Noise, Record, Records};

/// Rows with every pump off that are asked for: 1 s.
const ROWS: usize = 50;
/// Rows in which pumps come to rest: 0.5 s. Pressures that there are then bound all later ones.
const REST_ROWS: usize = 25;
/// Share of the largest pressure of the recording, and deviations of the noise, by which one goes beyond these bounds.
const BEYOND: f64 = 0.1;
const NOISES: f64 = 10.0;
/// Readings that do so: 0.2 s.
const LEAST_READINGS: usize = 10;

/// Adds a finding for each relay of a recording whose pressures rise while every pump is said to be off; none of the pumps that are said
/// never to run.
pub(super) fn check(rig: &Rig, records: &Records, noise: &[Noise], findings: &mut Vec<Finding>) {
    let Some(relays) = relays_alone(rig) else { return };
    for (record, r) in records.records().iter().enumerate() {
        let on = records.relays(rig, record);
        let is_off = |row: &usize| on.iter().all(|relay| relay.get(*row) == Some(&false));
        let Some((channel, row)) = off_runs(r, is_off).find_map(|run| driven(records, record, noise, &run)) else {
            continue;
        };
        let column = records.sensors().get(channel).map_or("", String::as_str);
        let kpa = records.channel_kpa(record, channel).get(row).copied().unwrap_or(0.0);
        for relay in &relays {
            findings.retain(|f| f.trouble != Trouble::PumpOff || f.column != *relay);
            let found = inverted(rig, &r.source, relay, Is::Relay);
            let seen = format!(
                "{column} goes to {kpa:.1} kPa at {:.2} s while it says that the pump is off",
                r.elapsed_s(row)
            );
            findings.push(Finding {
                text: format!("{seen}, and nothing else in the rig can do that: {}", found.text),
                ..found
            });
        }
    }
}

/// The relays of all pumps of a rig that nothing else drives, and whose chambers are all read; `None` of other rigs.
fn relays_alone(rig: &Rig) -> Option<Vec<&str>> {
    let is_read = |volume: &String| rig.sensors.values().any(|sensor| sensor.volume == *volume);
    if !rig.sources.is_empty() || rig.pumps.is_empty() || !rig.volumes.keys().all(is_read) {
        return None;
    }
    let relays = rig.pumps.values().map(|pump| match pump {
        Pump::Piston(pump) => pump.relay.as_deref(),
        Pump::Flow(_) => None,
    });
    let mut relays = relays.collect::<Option<Vec<&str>>>()?;
    relays.sort_unstable();
    relays.dedup();
    Some(relays)
}

/// Stretches of rows in which every pump is said to be off.
fn off_runs<'r>(r: &'r Record, is_off: impl Fn(&usize) -> bool + 'r) -> impl Iterator<Item = Range<usize>> + 'r {
    let runs = r.segments.iter().flat_map(move |segment| {
        let rows: Vec<usize> = segment.clone().collect();
        let off = rows.chunk_by(|a, b| is_off(a) == is_off(b)).filter(|run| run.first().is_some_and(&is_off));
        off.filter_map(|run| Some(*run.first()?..*run.last()? + 1)).collect::<Vec<_>>()
    });
    runs.filter(|run| run.len() >= ROWS)
}

/// The channel that goes beyond all pressures that there were when the pumps had come to rest, and the row where it is farthest.
fn driven(records: &Records, record: usize, noise: &[Noise], run: &Range<usize>) -> Option<(usize, usize)> {
    let r = records.records().get(record)?;
    let channels = 0..records.sensors().len();
    let (mut low, mut high) = (0.0_f64, 0.0_f64);
    for channel in channels.clone() {
        for kpa in records.channel_kpa(record, channel).get(run.start..run.start + REST_ROWS)? {
            (low, high) = (low.min(*kpa), high.max(*kpa));
        }
    }
    channels.into_iter().find_map(|channel| {
        let values = records.channel_kpa(record, channel);
        let largest = values.iter().fold(0.0_f64, |largest, kpa| largest.max(kpa.abs()));
        let margin = (BEYOND * largest).max(NOISES * noise.get(channel).map_or(0.0, |n| n.sigma_kpa));
        let beyond = |row: usize| values.get(row).map_or(0.0, |kpa| (kpa - high).max(low - kpa));
        let rows = run.clone().filter(|row| r.is_read(channel, *row) && beyond(*row) > margin);
        let rows: Vec<usize> = rows.collect();
        let farthest = rows.iter().copied().max_by(|a, b| beyond(*a).total_cmp(&beyond(*b)))?;
        (rows.len() >= LEAST_READINGS).then_some((channel, farthest))
    })
}
