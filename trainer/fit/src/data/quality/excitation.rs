//! Commands that never move, pressures that hardly do, a pump that never runs.

use model::rig::{Pump, Rig};

use super::mend::{multiplied_key, share_key};
use super::readings::range_of;
use super::unmoved::drift_kpa;
use super::{Finding, Severity, Trouble, median};
use crate::data::record::is_on;
use crate::data::{Noise, Record, Records};

/// A duty that varies by less than this (standard deviation) does not excite its valve: half a per cent of duty
/// moves a chamber by about 1 kPa.
const LEAST_DUTY: f64 = 0.005;
/// Pressures that vary by less than this many noise deviations say nothing.
const LEAST_NOISES: f64 = 5.0;
/// A pressure this many noise deviations off the open air, and further than a sensor drifts, is one that a chamber holds.
const HELD_NOISES: f64 = 50.0;
/// A duty that never exceeds this was written in another scale.
const SMALLEST_SCALE: f64 = 0.02;

/// A command is a share of 1 by this much at most above it, for the rounding of its numbers.
const ONE: f64 = 1.001;

/// Words for a command that never exceeds so much: what it seems to be, and the key that says so.
fn divided(rig: &Rig, records: &Records, column: &str, largest: f64) -> String {
    let said = records.records().iter().find_map(|r| r.file_unit(column));
    match said.filter(|said| (0.0..=ONE).contains(&said.written(largest))) {
        Some(said) => {
            let key = share_key(rig, column);
            format!("{}, and the numbers seem to be shares of 1 as they stand: {key}", said.says())
        }
        None => format!("was it divided once too often? {}", multiplied_key(rig, column, 100.0)),
    }
}

pub(super) fn check(rig: &Rig, records: &Records, noise: &[Noise], findings: &mut Vec<Finding>) {
    let everywhere = |severity, trouble, column: &str, text| Finding {
        source: String::new(),
        column: column.to_owned(),
        severity,
        trouble,
        text,
    };
    let duties: Vec<&str> = rig.valves.values().map(|valve| valve.command.as_str()).collect();
    let pumps = rig.pumps.values().filter_map(|pump| match pump {
        Pump::Flow(pump) => pump.command.as_deref(),
        Pump::Piston(_) => None,
    });
    let pumps: Vec<&str> = pumps.collect();
    for column in duties.iter().chain(&pumps).copied() {
        let numbers = || (0..records.records().len()).filter_map(|r| records.input(r, column)).flatten().copied();
        let largest = numbers().fold(0.0, f64::max);
        if largest > 0.0 && largest < SMALLEST_SCALE && deviation(numbers()) > 0.0 {
            findings.push(everywhere(
                Severity::Unusable,
                Trouble::DutyScale,
                column,
                format!("never above {largest:.4}: a duty is a share of 1; {}", divided(rig, records, column, largest)),
            ));
        }
    }
    let mut unmoved = 0;
    for column in &duties {
        let numbers = || (0..records.records().len()).filter_map(|r| records.input(r, column)).flatten().copied();
        let spread = deviation(numbers());
        let scaled_away = findings.iter().any(|f| f.trouble == Trouble::DutyScale && f.column == **column);
        if spread < LEAST_DUTY && !scaled_away {
            unmoved += 1;
            findings.push(everywhere(
                Severity::Doubtful,
                Trouble::NoExcitation,
                column,
                "hardly moves in any recording; what this valve does cannot be told. Record steps or ramps of it"
                    .to_owned(),
            ));
        }
    }
    still_pumps(records, &pumps, findings);
    let switched = records.inputs().iter().filter(|input| !duties.contains(&input.column.as_str())).any(|input| {
        let numbers = (0..records.records().len()).filter_map(|r| records.input(r, &input.column)).flatten();
        deviation(numbers.copied()) > 0.0
    });
    if unmoved == duties.len() && unmoved > 0 && !switched {
        findings.push(everywhere(
            Severity::Unusable,
            Trouble::NoExcitation,
            &duties.join(", "),
            "no command moves in any recording: nothing can be told from them. Are these the commands that were sent? \
             Record steps or ramps of both"
                .to_owned(),
        ));
    }
    let is_left_to_itself = records.inputs().is_empty() && rig.pumps.is_empty() && rig.sources.is_empty();
    let (mut still, mut holds) = (0, false);
    for (channel, column) in records.sensors().iter().enumerate() {
        let sigma = noise.get(channel).map_or(0.0, |n| n.sigma_kpa);
        let spread = (0..records.records().len())
            .map(|record| deviation(records.channel_kpa(record, channel).iter().copied()))
            .fold(0.0, f64::max);
        if spread < LEAST_NOISES * sigma {
            still += 1;
            let level = furthest_level(records, channel);
            let is_off_the_air = level.abs() > (HELD_NOISES * sigma).max(drift_kpa(range_of(rig, column)));
            holds |= is_left_to_itself && is_off_the_air;
            let text = if is_left_to_itself && is_off_the_air {
                format!(
                    "stands at {level:.1} kPa within its noise: what leaks out there shows in a longer recording, if at all"
                )
            } else {
                format!("varies by {spread:.2} kPa, hardly more than its noise; record a wider range")
            };
            findings.push(everywhere(Severity::Doubtful, Trouble::NoExcitation, column, text));
        }
    }
    // A chamber that is left to itself under pressure and holds it is an answer.
    if still == records.sensors().len() && still > 0 && !holds {
        findings.push(everywhere(
            Severity::Unusable,
            Trouble::NoExcitation,
            "",
            "no pressure moves: nothing can be told from these recordings. Record steps over the whole range"
                .to_owned(),
        ));
    }
    for pump in rig.pumps.values() {
        let Pump::Piston(piston) = pump else { continue };
        let Some(relay) = &piston.relay else { continue };
        let on = (0..records.records().len())
            .filter_map(|r| records.input(r, relay))
            .flatten()
            .filter(|level| is_on(**level))
            .count();
        if on == 0 {
            findings.push(everywhere(
                Severity::Doubtful,
                Trouble::PumpOff,
                relay,
                "the pump never runs; its parameters stay as they are".to_owned(),
            ));
        }
    }
}

/// The median, of all recordings', that is furthest from the open air (kPa); 0 where nothing was read.
fn furthest_level(records: &Records, channel: usize) -> f64 {
    let level = |(record, r): (usize, &Record)| {
        let values = records.channel_kpa(record, channel).iter().enumerate();
        let read: Vec<f64> = values.filter(|(row, _)| r.is_read(channel, *row)).map(|(_, p)| *p).collect();
        median(&read)
    };
    let levels = records.records().iter().enumerate().map(level);
    levels.fold(0.0, |furthest, level| if level.abs() > furthest.abs() { level } else { furthest })
}

/// Tells of commands of pumps that stand still.
fn still_pumps(records: &Records, pumps: &[&str], findings: &mut Vec<Finding>) {
    for column in pumps {
        let numbers = || (0..records.records().len()).filter_map(|r| records.input(r, column)).flatten().copied();
        let scaled_away = findings.iter().any(|f| f.trouble == Trouble::DutyScale && f.column == **column);
        if deviation(numbers()) < LEAST_DUTY && !scaled_away {
            let level = numbers().next().unwrap_or(0.0);
            findings.push(Finding {
                source: String::new(),
                column: (*column).to_owned(),
                severity: Severity::Doubtful,
                trouble: Trouble::NoExcitation,
                text: format!(
                    "stands at {level:.2} in all recordings; what this pump does cannot be told apart from what lets air \
                     out. Record steps or ramps of it"
                ),
            });
        }
    }
}

/// Standard deviation; 0 of nothing.
pub(super) fn deviation(numbers: impl Iterator<Item = f64>) -> f64 {
    let (mut n, mut mean, mut squares) = (0.0, 0.0, 0.0);
    for value in numbers {
        n += 1.0;
        let step = value - mean;
        mean += step / n;
        squares += step * (value - mean);
    }
    (squares / f64::max(n, 1.0)).sqrt()
}
