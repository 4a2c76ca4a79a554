//! Readings outside the range that the rig file states for their sensor.
//!
//! A sensor of −5 … 20 kPa never reads 101: where many readings lie outside, the column holds something else, whatever the rig
//! would do. What it holds is told by which meaning puts the readings inside, and the least of them nearest to the open air.

use model::rig::{Rig, Sensor};
use proto::recording::Recording;

use super::meaning::{Meaning, lost_sign};
use super::{Finding, Severity, Trouble};
use crate::FitError;
use crate::data::Records;

/// Readings may be outside by this share of the range: zeros that are off, lines that ring.
const MARGIN: f64 = 0.1;
/// Share of the readings outside from which on it is no loose contact.
const MANY: f64 = 0.05;

/// Refuses recordings whose readings lie outside their sensors' ranges; columns that a recording does not have are passed over.
///
/// # Errors
/// The first such column, with what it seems to hold.
pub fn within_ranges(rig: &Rig, recordings: &[Recording]) -> Result<(), FitError> {
    for recording in recordings {
        let columns = rig.sensors.values().filter_map(|s| Some((s.column.as_str(), recording.column(&s.column)?)));
        let channels: Vec<Channel<'_>> = columns
            .map(|(column, values)| {
                let measured = recording.measured();
                let is_measured = |row: &usize| measured.is_none_or(|m| m.get(*row).copied().unwrap_or(true));
                let rows = (0..values.len()).filter(is_measured);
                Channel { column, values: rows.filter_map(|row| values.get(row)).copied().collect() }
            })
            .collect();
        if let Some(finding) = first_outside(rig, recording.source(), &channels) {
            return Err(FitError::Unusable(finding.to_string()));
        }
    }
    Ok(())
}

/// Adds a finding for every recording with readings outside.
pub(super) fn check(rig: &Rig, records: &Records, findings: &mut Vec<Finding>) {
    for (record, r) in records.records().iter().enumerate() {
        let channels: Vec<Channel<'_>> = records
            .sensors()
            .iter()
            .enumerate()
            .map(|(channel, column)| {
                let values = records.channel_kpa(record, channel).iter().enumerate();
                let values = values.filter(|(row, _)| r.is_measured(*row)).map(|(_, value)| *value).collect();
                Channel { column, values }
            })
            .collect();
        findings.extend(first_outside(rig, &r.source, &channels));
    }
}

/// What was read under one column.
struct Channel<'a> {
    column: &'a str,
    values: Vec<f64>,
}

impl Channel<'_> {
    /// Share of the readings, as they would be with a meaning, that lie outside a range.
    fn outside(&self, [low, high]: [f64; 2], of: impl Fn(f64) -> Option<f64>) -> f64 {
        let margin = MARGIN * (high - low);
        let inside = |value: &&f64| of(**value).is_some_and(|kpa| (low - margin..=high + margin).contains(&kpa));
        let count = self.values.iter().filter(inside).count();
        1.0 - count as f64 / self.values.len().max(1) as f64
    }
}

fn range_of(sensor: &Sensor) -> [f64; 2] {
    let [a, b] = sensor.range_kpa_gauge;
    [a.min(b), a.max(b)]
}

fn first_outside(rig: &Rig, source: &str, channels: &[Channel<'_>]) -> Option<Finding> {
    let sensor = |column: &str| rig.sensors.values().find(|sensor| sensor.column == column);
    channels.iter().find_map(|channel| {
        let range = range_of(sensor(channel.column)?);
        if channel.values.is_empty() || channel.outside(range, Some) <= MANY {
            return None;
        }
        let (trouble, reason) = meant(rig, channel, range)
            .or_else(|| swapped(rig, channel, channels))
            .unwrap_or_else(|| {
                let text = "is it another unit, absolute, or the sensor's volts? Say so in the rig file, [recording] columns, or state the \
                            sensor's true range_kpa_gauge";
                (Trouble::WrongUnit, text.to_owned())
            });
        let mut sorted = channel.values.clone();
        sorted.sort_by(f64::total_cmp);
        let median = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
        Some(Finding {
            source: source.to_owned(),
            column: channel.column.to_owned(),
            severity: Severity::Unusable,
            trouble,
            text: format!(
                "reads {median:.1} (median), outside the sensor's {} … {} kPa: {reason}",
                range[0], range[1]
            ),
        })
    })
}

/// The meaning under which readings lie inside, the least of them nearest to the open air.
fn meant(rig: &Rig, channel: &Channel<'_>, range: [f64; 2]) -> Option<(Trouble, String)> {
    let sensor = rig.sensors.values().find(|sensor| sensor.column == channel.column)?;
    let atmosphere_kpa = rig.atmosphere.pressure_kpa_abs;
    let of = |meaning: Meaning| move |value: f64| meaning.of(value, Some(sensor), atmosphere_kpa);
    let from_air = |meaning: Meaning| {
        let all = channel.values.iter().filter_map(|value| of(meaning)(*value)).map(f64::abs);
        all.fold(f64::INFINITY, f64::min)
    };
    let meaning = Meaning::wrong()
        .filter(|meaning| *meaning != Meaning::Volts && channel.outside(range, of(*meaning)) <= MANY)
        .min_by(|a, b| from_air(*a).total_cmp(&from_air(*b)))?;
    let column = channel.column;
    let key = |rest: &str| format!("[recording] columns.{column} = {{ from = \"…\", {rest} }}");
    Some(match meaning {
        Meaning::Absolute(_, "kPa") => (
            Trouble::Absolute,
            format!("the pressure seems to be absolute; {}", key(&format!("offset = -{atmosphere_kpa:.1}"))),
        ),
        Meaning::Absolute(_, unit) => (
            Trouble::WrongUnit,
            format!(
                "the pressure seems to be absolute, in {unit}; {}",
                key(&format!("unit = \"{} abs\"", first(unit)))
            ),
        ),
        Meaning::Gauge(_, unit) => (
            Trouble::WrongUnit,
            format!("the pressure seems to be in {unit}; {}", key(&format!("unit = \"{}\"", first(unit)))),
        ),
        Meaning::Unsigned => {
            let expected = if range[0] + range[1] < 0.0 { -1.0 } else { 1.0 };
            (Trouble::WrongUnit, format!("{}: {}", lost_sign(expected), key("scale = -1.0")))
        }
        Meaning::Volts => return None,
    })
}

/// The first unit of a list of alike ones.
fn first(units: &str) -> &str {
    units.split([',', ' ']).next().unwrap_or(units)
}

/// Another channel that this one is within the range of, and the other way round.
fn swapped(rig: &Rig, channel: &Channel<'_>, channels: &[Channel<'_>]) -> Option<(Trouble, String)> {
    let range = |column: &str| rig.sensors.values().find(|sensor| sensor.column == column).map(range_of);
    let own = range(channel.column)?;
    let other = channels.iter().filter(|other| other.column != channel.column).find(|other| {
        range(other.column)
            .is_some_and(|theirs| channel.outside(theirs, Some) <= MANY && other.outside(own, Some) <= MANY)
    })?;
    let (one, two) = (channel.column, other.column);
    Some((Trouble::SwappedPressures, format!("the columns {one} and {two} seem to be swapped")))
}
