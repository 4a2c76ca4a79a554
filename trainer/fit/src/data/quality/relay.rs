//! Pressures that leave the atmosphere while the relays say that every pump is off.
//!
//! A relay that is wired or logged the other way round (0 is on) is common. On a rig that nothing else drives no model is needed to see
//! it: air goes from chamber to chamber and to the air outside, so that no pressure goes beyond the highest and the lowest that there were
//! when the pumps had come to rest. Rigs with other drives, with several relays (of which any may be the one), or with chambers that nobody
//! reads, are left to free runs ([`super::mistaken`]).

use std::ops::Range;

use model::rig::{Pump, Rig};

use super::duties::{Is, inverted};
use super::readings::range_of;
use super::unmoved::margin_kpa;
use super::{Finding, Trouble};
use crate::data::{Noise, Record, Records};

/// Rows with every pump off that are asked for: 1 s.
const ROWS: usize = 50;
/// Rows in which pumps come to rest: 0.5 s. Pressures that there are then bound all later ones.
const REST_ROWS: usize = 25;
/// Share of the largest pressure of the recording by which one goes beyond these bounds.
const BEYOND: f64 = 0.1;
/// Readings that do so: 0.2 s.
const LEAST_READINGS: usize = 10;

/// Adds a finding for the relay of a recording whose pressures rise while every pump is said to be off, in place of one that says that
/// none ever runs.
pub(super) fn check(rig: &Rig, records: &Records, noise: &[Noise], findings: &mut Vec<Finding>) {
    let Some(relay) = only_relay(rig) else { return };
    for (record, r) in records.records().iter().enumerate() {
        let on = records.relays(rig, record);
        let is_off = |row: &usize| on.iter().all(|relay| relay.get(*row) == Some(&false));
        let Some((channel, row)) = off_runs(r, is_off).find_map(|run| driven(rig, records, record, noise, &run)) else {
            continue;
        };
        let column = records.sensors().get(channel).map_or("", String::as_str);
        let kpa = records.channel_kpa(record, channel).get(row).copied().unwrap_or(0.0);
        findings.retain(|f| f.trouble != Trouble::PumpOff || f.column != relay);
        let found = inverted(rig, &r.source, relay, Is::Relay);
        let seen =
            format!("{column} goes to {kpa:.1} kPa at {:.2} s while it says that the pump is off", r.elapsed_s(row));
        findings.push(Finding {
            text: format!("{seen}, and nothing else in the rig can do that: {}", found.text),
            ..found
        });
    }
}

/// The one relay of all pumps of a rig that nothing else drives, and whose chambers are all read; `None` of other rigs.
fn only_relay(rig: &Rig) -> Option<&str> {
    let is_read = |volume: &String| rig.sensors.values().any(|sensor| sensor.volume == *volume);
    if !rig.sources.is_empty() || rig.pumps.is_empty() || !rig.volumes.keys().all(is_read) {
        return None;
    }
    let mut relays = rig.pumps.values().map(|pump| match pump {
        Pump::Piston(pump) => pump.relay.as_deref(),
        Pump::Flow(_) => None,
    });
    let one = relays.next()??;
    relays.all(|relay| relay == Some(one)).then_some(one)
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
fn driven(rig: &Rig, records: &Records, record: usize, noise: &[Noise], run: &Range<usize>) -> Option<(usize, usize)> {
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
        let range = records.sensors().get(channel).and_then(|column| range_of(rig, column));
        let margin = margin_kpa(values, BEYOND, noise.get(channel), range);
        let beyond = |row: usize| values.get(row).map_or(0.0, |kpa| (kpa - high).max(low - kpa));
        let rows = run.clone().filter(|row| r.is_read(channel, *row) && beyond(*row) > margin);
        let rows: Vec<usize> = rows.collect();
        let farthest = rows.iter().copied().max_by(|a, b| beyond(*a).total_cmp(&beyond(*b)))?;
        (rows.len() >= LEAST_READINGS).then_some((channel, farthest))
    })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use model::plant::{Plant, Simulation};
    use proto::recording::Recording;
    use proto::recording::csv::{Column, ColumnData};

    use super::*;
    use crate::data::noise::noise;
    use crate::data::quality::Quality;

    fn recording(source: &str, columns: Vec<(&str, Vec<f64>)>) -> Recording {
        let time_s: Vec<f64> = (0..columns[0].1.len()).map(|k| 0.02 * k as f64).collect();
        let columns =
            columns.into_iter().map(|(name, c)| Column { name: name.to_owned(), data: ColumnData::Numbers(c) });
        Recording::new(source, time_s, columns.collect()).unwrap()
    }

    /// A rig at rest with its pump off whose readings drift by `kpa` over 20 s, with noise of 0.01 kPa.
    fn at_rest(kpa: f64) -> Recording {
        let drift = |sign: f64| -> Vec<f64> {
            let noise = |k: usize| 0.01 * ((k * 7919 % 1000) as f64 / 1000.0 * 37.0).sin();
            (0..1000).map(|k| sign * kpa * k as f64 / 1000.0 + noise(k)).collect()
        };
        let still = |level: f64| vec![level; 1000];
        recording(
            "zero.csv",
            vec![
                ("u_pos", still(0.7)),
                ("u_neg", still(0.7)),
                ("pump_on", still(0.0)),
                ("p_pos_kpa", drift(1.0)),
                ("p_neg_kpa", drift(-1.0)),
            ],
        )
    }

    /// A sensor that warms up at rest, or a barometer that rises, has no pump behind it.
    #[test]
    fn a_drift_at_rest_is_no_inverted_relay() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let told = |kpa: f64| {
            let records = Records::new(&rig, &[at_rest(kpa)]).unwrap();
            let mut findings = Vec::new();
            check(&rig, &records, &noise(&records), &mut findings);
            findings.iter().map(|f| (f.column.clone(), f.trouble)).collect::<Vec<_>>()
        };
        for kpa in [0.3, -0.3, 1.0] {
            assert_eq!(told(kpa), [], "{kpa}");
        }
        assert_eq!(told(30.0), [("pump_on".to_owned(), Trouble::InvertedDuty)]);
    }

    /// One of two relays is logged the other way round: that one is told and the sound one is not.
    #[test]
    fn of_two_relays_the_sound_one_is_not_accused() {
        let second = model::rig::DUAL_PRESSURE
            .split("[pumps.pump]")
            .nth(1)
            .and_then(|rest| rest.split("\n[").next())
            .map(|pump| format!("\n[pumps.second]{}\n", pump.replace("\"pump_on\"", "\"second_on\"")))
            .unwrap();
        let rig = Rig::from_toml(&(model::rig::DUAL_PRESSURE.to_owned() + &second)).unwrap();
        assert_eq!(only_relay(&rig), None);
        let plant = Arc::new(Plant::<f64>::new(&rig).unwrap());
        let names: Vec<&str> = plant.inputs().iter().map(|input| input.column.as_str()).collect();
        let mut simulation = Simulation::new(Arc::clone(&plant));
        let is_on = |row: usize, name: &str| match name {
            "pump_on" => (row / 300).is_multiple_of(2),
            // From rest, for a pump that goes on alone behind the other does not go beyond what both did.
            _ => !(row / 450).is_multiple_of(2),
        };
        let command = |row: usize, name: &str| match name {
            "u_pos" => 0.70 + 0.05 * ((row / 150) % 3) as f64,
            "u_neg" => 0.72 + 0.05 * ((row / 110) % 4) as f64,
            relay => f64::from(u8::from(is_on(row, relay))),
        };
        let logged = |inverted: &str, row: usize, name: &str| {
            let level = command(row, name);
            if name == inverted { 1.0 - level } else { level }
        };
        let mut readings = [Vec::new(), Vec::new()];
        for row in 0..1800 {
            let noise = 0.1 * ((row * 7919 % 1000) as f64 / 1000.0 * 37.0).sin();
            readings.iter_mut().zip(simulation.readings_kpa()).for_each(|(all, kpa)| all.push(kpa + noise));
            simulation.tick(&names.iter().map(|name| command(row, name)).collect::<Vec<_>>());
        }
        for inverted in ["pump_on", "second_on"] {
            let commands = names.iter().map(|name| (*name, (0..1800).map(|row| logged(inverted, row, name)).collect()));
            let pressures = ["p_pos_kpa", "p_neg_kpa"].into_iter().zip(readings.clone());
            let recordings = [recording("two.csv", commands.chain(pressures).collect())];
            let records = Records::new(&rig, &recordings).unwrap();
            let found = Quality::of(&rig, &records, &noise(&records)).unwrap().findings;
            let accused: Vec<&str> =
                found.iter().filter(|f| f.trouble == Trouble::InvertedDuty).map(|f| f.column.as_str()).collect();
            assert_eq!(accused, [inverted], "{found:?}");
        }
    }
}
