//! The columns that a rig asks of a file: found, brought to the rig's units, checked.

mod command_ranges;
pub(crate) mod file_unit;
mod in_rig_unit;
pub(crate) mod units;

use std::borrow::Cow;

use model::rig::{Pump, RecordingMap, Rig, Term, Terms};

use self::file_unit::{FileUnit, UnitSource};
use self::in_rig_unit::{AS_IT_STANDS, converted, of_unit};
use crate::recording::csv::{CsvError, TIME_COLUMN, toml_text};
use crate::recording::logger_file::sheet::Sheet;
use crate::recording::recording_error::RecordingError;
use crate::recording::rows::resample::Kind;
use crate::recording::rows::slower;
use crate::recording::table::rules::{LEAST_READING_KPA, below_vacuum};

/// A command may be so far beyond 0 … 1, by the rounding of a scale such as 0.00392; it is cut off there.
const ROUNDING: f64 = 1e-3;

/// Numbers that loggers write for no reading, beyond any pressure: the round numbers are those of data acquisition programs, the last the
/// least that 16 bits hold.
const NO_READING: [f64; 6] = [-999.0, -999.9, -9999.0, -99_999.0, -999_999.0, -32_768.0];
/// Size from which on any number says so: instruments write 9.9E37 for what is beyond their range and 9.91E37 for nothing (SCPI), others
/// 1E30, 1E38 or the most that a float holds.
const BEYOND_ALL: f64 = 1e30;
/// Pressure beyond which such a number lies in every unit (kPa).
const MOST_READING_KPA: f64 = 1e9;
/// Readings that go further up than down by so much do not go below the atmosphere: what they do is scatter about it.
const MOSTLY_ABOVE: f64 = 10.0;

/// A column that a rig asks for.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Asked {
    pub(super) name: String,
    pub(super) kind: Kind,
    /// The case of a file without it.
    pub(super) default: Presence,
}

/// Duty of a column to be there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Presence {
    /// It must.
    Needed,
    /// The rig knows what to take where it is not.
    Optional,
}

/// Every column that a rig takes from recordings, commands first.
pub(super) fn asked(rig: &Rig) -> Vec<Asked> {
    let signals = rig.signals();
    let relays: Vec<&str> = rig
        .pumps
        .values()
        .filter_map(|pump| match pump {
            Pump::Piston(pump) => pump.relay.as_deref(),
            Pump::Flow(_) => None,
        })
        .collect();
    let readings: Vec<&str> = rig.sensors.values().map(|sensor| sensor.column.as_str()).collect();
    let of = |name: String| {
        let kind = if readings.contains(&name.as_str()) {
            Kind::Reading
        } else if signals.contains(&name) {
            Kind::Signal
        } else if relays.contains(&name.as_str()) {
            Kind::Switch
        } else {
            Kind::Command
        };
        // Readings: a file of commands alone may be simulated from rest; who compares asks for them. Relays are closed.
        let default = if matches!(kind, Kind::Reading | Kind::Switch) { Presence::Optional } else { Presence::Needed };
        Asked { name, kind, default }
    };
    rig.columns().into_iter().map(of).collect()
}

/// Tells whether a column of the map is made from the rig's own names alone, its own or one that it is exchanged with: then the map says
/// how, whoever wrote the file.
fn is_of_own_names(rig: &Rig, terms: &Terms) -> bool {
    terms.0.iter().all(|term| rig.columns().contains(&term.from))
}

/// Whose names a file has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Naming {
    /// The rig's: `time_s` and all that the map would make from others.
    Own,
    /// A logger's, which the map gives their meaning.
    Foreign,
}

/// Tells whose names a file has.
///
/// # Errors
/// A name stands twice.
pub(super) fn naming(sheet: &Sheet<'_>, rig: &Rig, map: &RecordingMap) -> Result<Naming, CsvError> {
    let mut all = sheet.find(TIME_COLUMN)?.is_some();
    let from_others = |name: &&String| map.columns.get(*name).is_some_and(|terms| !is_of_own_names(rig, terms));
    for name in rig.columns().iter().filter(from_others) {
        all = all && sheet.find(name)?.is_some();
    }
    Ok(if all { Naming::Own } else { Naming::Foreign })
}

/// A column in the rig's unit.
#[derive(Debug)]
pub(super) struct Made {
    pub(super) numbers: Vec<f64>,
    /// The units that were taken, in words.
    pub(super) taken: Vec<String>,
    /// The places in the file that it was made from.
    pub(super) from: Vec<usize>,
    /// A command's numbers as they stand in the file, where the map or a unit scales them.
    pub(super) written: Option<Vec<f64>>,
    /// The unit that the file or its map says of these numbers, where that is not the rig's.
    pub(super) file_unit: Option<FileUnit>,
}

/// The terms of which a column of the rig is the sum: the map's, or the column of its own name; `None` where the file does not have it and
/// the rig does without.
fn terms_of<'m>(
    sheet: &Sheet<'_>,
    rig: &Rig,
    map: &'m RecordingMap,
    naming: Naming,
    (name, kind, presence): (&str, Kind, Presence),
) -> Result<Option<Cow<'m, [Term]>>, CsvError> {
    let own_term = || Cow::Owned(vec![Term::plain(name)]);
    let asked = map.columns.get(name).filter(|terms| naming == Naming::Foreign || is_of_own_names(rig, terms));
    Ok(match asked.map(|terms| terms.0.as_slice()) {
        Some(terms) if !all_there(sheet, terms)? && sheet.find(name)?.is_some() => Some(own_term()),
        Some(terms) => Some(Cow::Borrowed(terms)),
        None if presence == Presence::Optional && is_nowhere(sheet, name, kind)? => None,
        None => Some(own_term()),
    })
}

/// Says whether a file lacks a column, or has one of a relay without anything in any row.
fn is_nowhere(sheet: &Sheet<'_>, name: &str, kind: Kind) -> Result<bool, CsvError> {
    let is_blank = |at: usize| kind == Kind::Switch && slower::blank(sheet, at).iter().all(|blank| *blank);
    Ok(sheet.find(name)?.is_none_or(is_blank))
}

/// The kinds of all columns that a rig asks for, and the places in the file that each is made from; what the file lacks is left out.
pub(super) fn places(
    sheet: &Sheet<'_>,
    rig: &Rig,
    map: &RecordingMap,
    naming: Naming,
) -> Result<Vec<(Kind, Vec<usize>)>, CsvError> {
    let mut all = Vec::new();
    for Asked { name, kind, default } in asked(rig) {
        let Some(terms) = terms_of(sheet, rig, map, naming, (&name, kind, default))? else { continue };
        let places = terms.iter().map(|term| sheet.find(&term.from)).collect::<Result<Vec<_>, _>>()?;
        all.push((kind, places.into_iter().flatten().collect()));
    }
    Ok(all)
}

/// Makes a column of the rig; `None` where the file does not have it and the rig does without.
///
/// # Errors
/// A column that is needed and not there, a cell that is no number, a unit that cannot be.
pub(super) fn made(
    sheet: &Sheet<'_>,
    rig: &Rig,
    map: &RecordingMap,
    naming: Naming,
    (name, kind, presence): (&str, Kind, Presence),
) -> Result<Option<Made>, RecordingError> {
    let Some(terms) = terms_of(sheet, rig, map, naming, (name, kind, presence))? else { return Ok(None) };
    let terms = &*terms;
    let mut made =
        Made { numbers: vec![0.0; sheet.rows()], taken: Vec::new(), from: Vec::new(), written: None, file_unit: None };
    for term in terms {
        let Some(at) = sheet.find(&term.from)? else { return Err(missing(sheet, name, &term.from)) };
        let numbers = match kind {
            Kind::Reading => slower::readings(sheet, at),
            Kind::Command | Kind::Switch => {
                let read = if kind == Kind::Switch { slower::switches } else { slower::commands };
                read(sheet, at).map(|(numbers, held)| {
                    made.taken.extend(held.then(|| format!("{name} held where its cells are blank")));
                    numbers
                })
            }
            Kind::Signal => slower::signals(sheet, at),
        };
        let numbers = numbers.map_err(|error| text_column(sheet, &term.from, error))?;
        let markers = if kind == Kind::Reading { markers(&numbers) } else { Vec::new() };
        let unit = of_unit(sheet, at, term)?;
        if matches!((kind, terms), (Kind::Command | Kind::Switch, [_])) && (unit.is_some() || !term.is_plain()) {
            made.written = Some(numbers.clone());
        }
        let in_rig_unit = converted(sheet, rig, (name, kind), term, unit.as_ref(), numbers)?;
        made.taken.extend(in_rig_unit.taken);
        // What a sum of columns or a scale makes of a unit is no number of the file any more.
        if let (Kind::Reading | Kind::Command, Some((_, text)), [only]) = (kind, &unit, terms)
            && only.is_plain()
            && in_rig_unit.line != AS_IT_STANDS
        {
            let [scale, zero] = in_rig_unit.line;
            let by = if only.unit.is_some() { UnitSource::Map } else { UnitSource::File };
            made.file_unit = Some(FileUnit { column: name.to_owned(), text: text.clone(), scale, zero, by });
        }
        made.from.push(at);
        for (row, (slot, x)) in made.numbers.iter_mut().zip(in_rig_unit.numbers).enumerate() {
            *slot += term.of(x);
            // No pressure: the row has none.
            if markers.contains(&row) && !(LEAST_READING_KPA..MOST_READING_KPA).contains(slot) {
                *slot = f64::NAN;
            }
        }
    }
    Ok(Some(made))
}

/// Rows in which the logger wrote its number for no reading, where they are few.
fn markers(numbers: &[f64]) -> Vec<usize> {
    let rows: Vec<usize> =
        (0..numbers.len()).filter(|row| numbers.get(*row).copied().is_some_and(is_no_reading)).collect();
    if 3 * rows.len() < numbers.len() { rows } else { Vec::new() }
}

/// Tells whether a number is one that loggers write for no reading.
fn is_no_reading(number: f64) -> bool {
    number.abs() >= BEYOND_ALL || NO_READING.contains(&number)
}

/// The error of a column whose first cell is no number: of a whole column of text, or of a row that the logger had nothing for.
fn text_column(sheet: &Sheet<'_>, name: &str, error: CsvError) -> RecordingError {
    match &error {
        CsvError::NotANumber { line, cell, .. } if sheet.lines.first() == Some(line) && !cell.is_empty() => {
            RecordingError::TextCells {
                file: sheet.file.clone(),
                column: name.to_owned(),
                line: *line,
                cell: cell.clone(),
            }
        }
        _ => error.into(),
    }
}

fn all_there(sheet: &Sheet<'_>, terms: &[Term]) -> Result<bool, CsvError> {
    let mut all = true;
    for term in terms {
        all = all && sheet.find(&term.from)?.is_some();
    }
    Ok(all)
}

/// The error of a column that is not there, with the key that would name another.
fn missing(sheet: &Sheet<'_>, name: &str, from: &str) -> RecordingError {
    let mend = if name == from {
        format!("where it has another name say so in the rig file: [recording] columns.{name} = \"…\"")
    } else {
        format!("the rig file's [recording] columns.{name} asks for it")
    };
    RecordingError::NotMapped {
        file: sheet.file.clone(),
        line: sheet.header_line,
        column: from.to_owned(),
        found: sheet.listed(),
        mend: sheet.mend_of_missing(mend),
    }
}

/// Refuses what a column of this kind cannot hold.
///
/// # Errors
/// The first number that is out of range, with its line and the key that would help.
pub(super) fn check(
    sheet: &Sheet<'_>,
    rig: &Rig,
    (name, kind): (&str, Kind),
    made: &Made,
) -> Result<(), RecordingError> {
    let Made { numbers, from, .. } = made;
    let [low, high] = match kind {
        Kind::Command | Kind::Switch => [-ROUNDING, 1.0 + ROUNDING],
        Kind::Reading => [LEAST_READING_KPA, f64::MAX],
        Kind::Signal => return Ok(()),
    };
    // A blank cell of a slower channel is no reading.
    let is_wrong = |number: f64| {
        (!number.is_nan() && !(low..=high).contains(&number))
            || (kind == Kind::Switch && number.min((number - 1.0).abs()).abs() > ROUNDING)
    };
    let Some(row) = numbers.iter().position(|number| is_wrong(*number)) else { return Ok(()) };
    // A unit that is said of them may be wrong, and another be right: only what the rig would do tells which.
    if kind == Kind::Reading && made.file_unit.is_some() && are_many(numbers, is_wrong) {
        return Ok(());
    }
    let value = numbers.get(row).copied().unwrap_or(0.0);
    let at = from.first().copied().unwrap_or(0);
    let title = sheet.columns.get(at).map_or_else(String::new, |column| column.title.clone());
    // A key goes by the rig's own name where the file has it, whatever unit stands behind it there.
    let from_name = if matches!(sheet.find(name), Ok(Some(own)) if own == at) { name } else { title.as_str() };
    let hint = match kind {
        Kind::Reading => of_reading(rig, (name, from_name), value, made),
        Kind::Switch => command_ranges::of_relay(name, from_name, made.written.as_ref().unwrap_or(numbers)),
        _ => match &made.written {
            Some(written) => command_ranges::of_scaled(name, from_name, numbers, written),
            None => command_ranges::hint(name, from_name, numbers),
        },
    };
    Err(CsvError::OutOfRange {
        file: sheet.file.clone(),
        line: sheet.lines.get(row).copied().unwrap_or(0),
        position: at + 1,
        column: title,
        value,
        low: if kind == Kind::Reading { LEAST_READING_KPA } else { 0.0 },
        high: if kind == Kind::Reading { f64::MAX } else { 1.0 },
        hint,
    }
    .into())
}

/// One reading of so many below any vacuum is no loose contact.
const MANY: usize = 20;

/// Tells whether many of a column's numbers are wrong.
fn are_many(numbers: &[f64], is_wrong: impl Fn(f64) -> bool) -> bool {
    MANY * numbers.iter().filter(|number| is_wrong(**number)).count() > numbers.len()
}

/// Likely kind of a reading below any vacuum, and the key that says so.
fn of_reading(rig: &Rig, (name, title): (&str, &str), value: f64, made: &Made) -> String {
    let key = |rest: &str| format!("[recording] columns.{name} = {{ from = {}, {rest} }}", toml_text(title));
    if is_no_reading(value) {
        return "; it seems to be what the logger writes for no reading: leave out rows without a reading".to_owned();
    }
    let Some((_, sensor)) = rig.sensor_of(name) else {
        return below_vacuum(value).to_owned();
    };
    let [one, other] = sensor.range_kpa_gauge;
    let (low, high) = (one.min(other), one.max(other));
    let finite = || made.numbers.iter().copied().filter(|x| x.is_finite());
    let (least, most) = finite().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, m), x| (l.min(x), m.max(x)));
    // A sensor that goes further up than any vacuum, and readings that would be within it with the other sign.
    if high > -LEAST_READING_KPA && -least <= 1.1 * high && most < 0.1 * high && low > LEAST_READING_KPA {
        return format!(
            "; the sign seems to be turned round, above the atmosphere is positive: {}",
            key("scale = -1.0")
        );
    }
    if most > MOSTLY_ABOVE * -least {
        let units = [("Pa", 1e-3), ("mbar", 0.1), ("mmHg", 0.133_322)];
        let likely = units.iter().find(|(_, kpa)| (0.02 * high..=1.1 * high).contains(&(kpa * most)));
        return match likely {
            Some((unit, _)) => {
                format!("; with readings up to {most} it seems to be {unit}: {}", key(&format!("unit = \"{unit}\"")))
            }
            None => format!("; with readings up to {most} it seems to be another unit: {}", key("unit = \"…\"")),
        };
    }
    format!("{}: {}", below_vacuum(value), key("unit = \"…\""))
}
