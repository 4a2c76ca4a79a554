//! Readings outside the range that the rig file states for their sensor.
//!
//! A sensor of −5 … 20 kPa never reads 101: where many readings lie outside, the column holds something else, whatever the rig
//! would do. What it holds is told by which meaning puts the readings inside: columns that were exchanged, a unit that all columns share,
//! a lost sign, a unit of one column.

use model::rig::{Rig, Sensor};
use proto::recording::{FileUnit, Recording};

use super::against_model::Agreed;
use super::counts::{Counts, largest, look_like_counts, samples};
use super::meaning::{AS_WRITTEN, Meaning, lost_sign, said_otherwise};
use super::mend::{exchanged_keys, pressure_key};
use super::{Finding, Severity, Trouble};
use crate::FitError;
use crate::data::Records;

/// Readings may be outside by this share of the range: zeros that are off, lines that ring.
pub(super) const MARGIN: f64 = 0.1;
/// Share of the readings outside from which on it is no loose contact.
pub(super) const MANY: f64 = 0.05;
/// Share of a sensor's range through which readings move where a chamber does anything. Divided by a thousand any reading lies inside.
const STANDS_STILL: f64 = 0.01;

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
                let missing = recording.missing(column).unwrap_or_default();
                let is_missing = |row: &usize| missing.get(*row).copied().unwrap_or(false);
                let rows = (0..values.len()).filter(is_measured).filter(|row| !is_missing(row));
                let values = rows.filter_map(|row| values.get(row)).copied().collect();
                Channel { column, values, file_unit: recording.file_unit(column) }
            })
            .collect();
        if let Some(finding) = first_outside(Counts { rig, run: None }, recording.source(), &channels, &[]) {
            return Err(FitError::Unusable(finding.to_string()));
        }
    }
    Ok(())
}

/// Adds a finding for every recording with readings outside.
pub(super) fn check(rig: &Rig, records: &Records, agreed: &[Agreed], findings: &mut Vec<Finding>) {
    for (record, r) in records.records().iter().enumerate() {
        let channels: Vec<Channel<'_>> = records
            .sensors()
            .iter()
            .enumerate()
            .map(|(channel, column)| {
                let values = samples(records, record, channel).collect();
                Channel { column, values, file_unit: r.file_unit(column) }
            })
            .collect();
        findings.extend(first_outside(Counts { rig, run: Some((records, record)) }, &r.source, &channels, agreed));
    }
}

/// Readings under one column.
struct Channel<'a> {
    column: &'a str,
    values: Vec<f64>,
    /// The unit, other than kPa, that is said of it.
    file_unit: Option<&'a FileUnit>,
}

/// Readings under one column with what the rig file says of their sensor.
struct Judged<'a> {
    column: &'a str,
    values: &'a [f64],
    sensor: &'a Sensor,
    /// The sensor's range, gauge kPa, lower end first.
    range: [f64; 2],
    file_unit: Option<&'a FileUnit>,
}

/// Margin beyond a sensor's range in which readings still count as within.
#[derive(Clone, Copy)]
enum Margin {
    None,
    Wide,
}

/// Readings as they would be under a meaning.
struct Under {
    /// True where they would move through next to nothing of the sensor's range.
    stands_still: bool,
    /// The least of them, from the open air (kPa).
    from_air: f64,
}

impl<'a> Judged<'a> {
    /// `None` for a column without readings, or without a sensor in the rig file.
    fn of(rig: &'a Rig, channel: &'a Channel<'a>) -> Option<Self> {
        let (_, sensor) = rig.sensor_of(channel.column)?;
        let (column, values) = (channel.column, channel.values.as_slice());
        let file_unit = channel.file_unit;
        (!values.is_empty()).then(|| Judged { column, values, sensor, range: range_of(sensor), file_unit })
    }

    /// Share of the readings, as they would be with a meaning, that lie outside the range.
    fn outside(&self, margin: Margin, of: impl Fn(f64) -> Option<f64>) -> f64 {
        let [low, high] = self.range;
        let margin = match margin {
            Margin::None => 0.0,
            Margin::Wide => MARGIN * (high - low),
        };
        let inside = |value: &&f64| of(**value).is_some_and(|kpa| (low - margin..=high + margin).contains(&kpa));
        let count = self.values.iter().filter(inside).count();
        1.0 - count as f64 / self.values.len().max(1) as f64
    }

    /// A reading as it would be with a meaning.
    fn meant(&self, value: f64, meaning: Meaning, atmosphere_kpa: f64) -> Option<f64> {
        meaning.of(value, Some(self.sensor), self.file_unit, atmosphere_kpa)
    }

    fn under(&self, meaning: Meaning, atmosphere_kpa: f64) -> Under {
        let all = self.values.iter().filter_map(|value| self.meant(*value, meaning, atmosphere_kpa));
        let (low, high, from_air) = all
            .fold((f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY), |(low, high, air), p| {
                (low.min(p), high.max(p), air.min(p.abs()))
            });
        Under { stands_still: high - low < STANDS_STILL * (self.range[1] - self.range[0]), from_air }
    }
}

fn range_of(sensor: &Sensor) -> [f64; 2] {
    let [a, b] = sensor.range_kpa_gauge;
    [a.min(b), a.max(b)]
}

fn first_outside(of_counts: Counts<'_>, source: &str, channels: &[Channel<'_>], agreed: &[Agreed]) -> Option<Finding> {
    let rig = of_counts.rig;
    let channels: Vec<Judged<'_>> = channels.iter().filter_map(|channel| Judged::of(rig, channel)).collect();
    let channel = channels.iter().find(|channel| channel.outside(Margin::Wide, Some) > MANY)?;
    let is_agreed = agreed.iter().any(|of| of.source == source && of.column == channel.column);
    let (trouble, reason) = is_agreed
        .then(|| (Trouble::WrongUnit, beyond(rig, channel.column)))
        .or_else(|| swapped(rig, channel, &channels))
        .or_else(|| meant(rig, channel, &channels).map(|meaning| told(of_counts, (channel, &channels), meaning)))
        .or_else(|| counts(of_counts, channel))
        .unwrap_or_else(|| {
            let text = "is it another unit, absolute, or the sensor's volts? Say so in the rig file, [recording] columns, or state the \
                        sensor's true range_kpa_gauge";
            (Trouble::WrongUnit, text.to_owned())
        });
    let mut sorted = channel.values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let median = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    let [low, high] = channel.range;
    Some(Finding {
        source: source.to_owned(),
        column: channel.column.to_owned(),
        severity: Severity::Unusable,
        trouble,
        text: format!("reads {median:.1} (median), outside the sensor's {low} … {high} kPa: {reason}"),
    })
}

/// The meaning that explains the readings of a channel: one that puts those of all channels inside, else a lost sign of this one, else
/// one of this channel alone. Of several that which leaves the readings moving, and the least of them nearest to the open air.
fn meant(rig: &Rig, channel: &Judged<'_>, channels: &[Judged<'_>]) -> Option<Meaning> {
    let atmosphere_kpa = rig.atmosphere.pressure_kpa_abs;
    let inside = |channel: &Judged<'_>, margin: Margin, meaning: Meaning| {
        channel.outside(margin, |value| channel.meant(value, meaning, atmosphere_kpa)) <= MANY
    };
    if channel.file_unit.is_some() && inside(channel, Margin::Wide, AS_WRITTEN) {
        return Some(AS_WRITTEN);
    }
    let best = |fits: &dyn Fn(Meaning) -> bool| {
        let fitting = Meaning::wrong().filter(|meaning| !matches!(meaning, Meaning::Output(_)) && fits(*meaning));
        let judged = fitting.map(|meaning| (meaning, channel.under(meaning, atmosphere_kpa)));
        judged.min_by(|(_, a), (_, b)| a.stands_still.cmp(&b.stands_still).then(a.from_air.total_cmp(&b.from_air)))
    };
    let of_all = best(&|meaning| {
        meaning != Meaning::Unsigned && channels.iter().all(|channel| inside(channel, Margin::None, meaning))
    });
    let unsigned = inside(channel, Margin::None, Meaning::Unsigned).then_some(Meaning::Unsigned);
    let of_this = |margin| best(&move |meaning| inside(channel, margin, meaning)).map(|(meaning, _)| meaning);
    of_all
        .filter(|(_, under)| !under.stands_still)
        .map(|(meaning, _)| meaning)
        .or(unsigned)
        .or_else(|| of_this(Margin::None))
        .or_else(|| of_this(Margin::Wide))
}

/// Whole numbers that no unit brings inside: the counts of a converter, of whatever scale.
fn counts(of_counts: Counts<'_>, channel: &Judged<'_>) -> Option<(Trouble, String)> {
    let readings = || channel.values.iter().copied();
    // Looked at first: converters are told by many free runs.
    if !look_like_counts(readings()) {
        return None;
    }
    Some((Trouble::WrongUnit, of_counts.alone(channel.column, largest(readings()))?))
}

/// Words on what is wrong where the rig would go as far as the readings do.
fn beyond(rig: &Rig, column: &str) -> String {
    let name = rig.sensor_of(column).map_or("", |(name, _)| name);
    format!("the rig would go there, too; state the range that the sensor has, [sensors.{name}] range_kpa_gauge")
}

/// A meaning in words, with the key that says so.
fn told(
    of_counts: Counts<'_>,
    (channel, channels): (&Judged<'_>, &[Judged<'_>]),
    meaning: Meaning,
) -> (Trouble, String) {
    let (trouble, text) = told_alone(of_counts.rig, channel, meaning);
    let text = text + &or_others(of_counts.rig, (channel, channels), meaning);
    let readings = || channel.values.iter().copied();
    let is_counted = look_like_counts(readings());
    (trouble, if is_counted { of_counts.beside(channel.column, largest(readings()), &text) } else { text })
}

/// The other units that put all readings inside, of which ranges tell none from another, where a wrong one is said; empty where there
/// are none.
fn or_others(rig: &Rig, (channel, channels): (&Judged<'_>, &[Judged<'_>]), meaning: Meaning) -> String {
    if channel.file_unit.is_none() || matches!(meaning, AS_WRITTEN | Meaning::Unsigned) {
        return String::new();
    }
    let atmosphere_kpa = rig.atmosphere.pressure_kpa_abs;
    let fits = |meaning: Meaning| {
        let inside =
            |of: &Judged<'_>| of.outside(Margin::None, |value| of.meant(value, meaning, atmosphere_kpa)) <= MANY;
        channels.iter().all(inside) && !channel.under(meaning, atmosphere_kpa).stands_still
    };
    let others = Meaning::wrong().filter(|other| {
        *other != meaning && matches!(other, Meaning::Gauge(..) | Meaning::Absolute(..)) && fits(*other)
    });
    let names: Vec<String> = others.filter_map(|other| other.unit()).map(|unit| format!("unit = \"{unit}\"")).collect();
    if names.is_empty() { String::new() } else { format!("; or {}: ranges alone do not tell", names.join(" or ")) }
}

fn told_alone(rig: &Rig, channel: &Judged<'_>, meaning: Meaning) -> (Trouble, String) {
    let key = pressure_key(rig, channel.column, meaning, channel.file_unit);
    if let Some(said) = channel.file_unit.filter(|_| meaning != Meaning::Unsigned) {
        return (Trouble::WrongUnit, format!("{}; {key}", said_otherwise(said, meaning)));
    }
    match meaning {
        Meaning::AsRead => (Trouble::WrongUnit, key),
        Meaning::Absolute(_, "kPa") => (Trouble::Absolute, format!("the pressure seems to be absolute; {key}")),
        Meaning::Absolute(_, unit) => {
            (Trouble::WrongUnit, format!("the pressure seems to be absolute, in {unit}; {key}"))
        }
        Meaning::Gauge(_, unit) => (Trouble::WrongUnit, format!("the pressure seems to be in {unit}; {key}")),
        Meaning::Output(output) => (Trouble::WrongUnit, format!("these seem to be {}; {key}", output.unit())),
        Meaning::Counts { .. } => {
            (Trouble::WrongUnit, format!("these seem to be the raw counts of a converter; {key}"))
        }
        Meaning::Unsigned => {
            let [low, high] = channel.range;
            let expected = if low + high < 0.0 { -1.0 } else { 1.0 };
            (Trouble::WrongUnit, format!("{}: {key}", lost_sign(expected)))
        }
    }
}

/// Another channel that this one is within the range of, and the other way round.
fn swapped(rig: &Rig, channel: &Judged<'_>, channels: &[Judged<'_>]) -> Option<(Trouble, String)> {
    let fits = |values: &Judged<'_>, range: [f64; 2]| Judged { range, ..*values }.outside(Margin::Wide, Some) <= MANY;
    let other = channels
        .iter()
        .filter(|other| other.column != channel.column)
        .find(|other| fits(channel, other.range) && fits(other, channel.range))?;
    let (one, two) = (channel.column, other.column);
    let keys = exchanged_keys(rig, one, two);
    Some((Trouble::SwappedPressures, format!("the columns {one} and {two} seem to be swapped: {keys}")))
}
