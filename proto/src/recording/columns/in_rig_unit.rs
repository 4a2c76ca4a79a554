//! A column's numbers in the unit that a rig has them in, by what the file or its map says of them.

use model::rig::{Rig, Sensor, Term};

use super::command_ranges;
use super::units::Unit;
use crate::recording::csv::toml_text;
use crate::recording::logger_file::sheet::Sheet;
use crate::recording::recording_error::RecordingError;
use crate::recording::rows::resample::Kind;

/// A current loop's ends, at which a sensor's range begins and ends (IEC 60381-1).
const LOOP_MA: [f64; 2] = [4.0, 20.0];

/// A unit and how the file or the map writes it.
pub(crate) type Named = (Unit, String);

/// The unit of a term: the map's, or the file's where numbers are taken as they stand.
///
/// # Errors
/// The map's is no unit.
pub(crate) fn of_unit(sheet: &Sheet<'_>, column: usize, term: &Term) -> Result<Option<Named>, RecordingError> {
    if let Some(text) = &term.unit {
        let unit = Unit::parse(text).ok_or_else(|| RecordingError::Unit {
            file: sheet.file.clone(),
            column: term.from.clone(),
            problem: format!("`unit = \"{text}\"` in [recording] is no unit known here; use kPa, Pa, hPa, mbar, bar, psi, mmHg, V, mA, % … or a scale"),
        })?;
        return Ok(Some((unit, text.clone())));
    }
    let written = sheet.columns.get(column).and_then(|column| column.unit.as_ref()).filter(|_| term.is_plain());
    Ok(written.and_then(|text| Some((Unit::parse(text)?, text.clone()))))
}

/// The straight line that leaves a number as it is: scale and offset.
pub(crate) const AS_IT_STANDS: [f64; 2] = [1.0, 0.0];

/// Numbers in the rig's unit.
pub(crate) struct InRigUnit {
    /// By row.
    pub(crate) numbers: Vec<f64>,
    /// Scale and offset that brought them there.
    pub(crate) line: [f64; 2],
    /// A word of it.
    pub(crate) taken: Option<String>,
}

/// Brings numbers to the rig's unit.
///
/// # Errors
/// A unit that the column cannot have, with the key that would scale it.
pub(crate) fn converted(
    sheet: &Sheet<'_>,
    rig: &Rig,
    (name, kind): (&str, Kind),
    term: &Term,
    unit: Option<&Named>,
    mut numbers: Vec<f64>,
) -> Result<InRigUnit, RecordingError> {
    let as_they_stand = |numbers, taken| Ok(InRigUnit { numbers, line: AS_IT_STANDS, taken });
    let Some((unit, text)) = unit else { return as_they_stand(numbers, None) };
    let sensor = rig.sensor_of(name).map(|(_, sensor)| sensor);
    let line = match (kind, unit, sensor) {
        (Kind::Reading, Unit::Gauge(kpa), _) => [*kpa, 0.0],
        (Kind::Reading, Unit::Absolute(kpa), _) => [*kpa, -rig.atmosphere.pressure_kpa_abs],
        (Kind::Reading, Unit::Volt(volt), Some(sensor)) => of_output(sensor, *volt, sensor.range_v),
        (Kind::Reading, Unit::Loop(ma), Some(sensor)) => of_output(sensor, *ma, LOOP_MA),
        (Kind::Command | Kind::Switch, Unit::Share(share), _) => [*share, 0.0],
        // A flow's unit is that of the source's own number; a command's volts are of a scale that nothing tells.
        (Kind::Signal, _, _) => return as_they_stand(numbers, Some(format!("{name} as it stands ({text})"))),
        (Kind::Command | Kind::Switch, Unit::Volt(_) | Unit::Loop(_) | Unit::Other, _)
            if numbers.iter().all(|u| (0.0..=1.0).contains(u)) =>
        {
            return as_they_stand(numbers, Some(format!("{name} as it stands, a share of 1 ({text} is said)")));
        }
        _ => {
            let what = if kind == Kind::Reading { "a pressure" } else { "a command, a share of 1" };
            let of_range =
                if kind == Kind::Reading { None } else { command_ranges::of_unit(name, &term.from, unit, &numbers) };
            let key = of_range.unwrap_or_else(|| {
                format!("[recording] columns.{name} = {{ from = {}, scale = …, offset = … }}", toml_text(&term.from))
            });
            return Err(RecordingError::Unit {
                file: sheet.file.clone(),
                column: term.from.clone(),
                problem: format!("its unit is {text}, and {name} is {what}; say how it is scaled: {key}"),
            });
        }
    };
    let [scale, offset] = line;
    numbers.iter_mut().for_each(|x| *x = scale * *x + offset);
    Ok(InRigUnit { numbers, line, taken: Some(format!("{name} in {text}")) })
}

/// Gauge kPa per unit, and at zero, of a sensor's output over its range.
fn of_output(sensor: &Sensor, per_unit: f64, [from, to]: [f64; 2]) -> [f64; 2] {
    let [p0, p1] = sensor.range_kpa_gauge;
    let slope = (p1 - p0) / (to - from);
    [per_unit * slope, p0 - from * slope]
}
