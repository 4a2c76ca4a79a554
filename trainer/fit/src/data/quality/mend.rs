//! The key of `[recording]` that gives a column its meaning.

use model::rig::{Rig, Term};
use proto::recording::FileUnit;

use super::meaning::Meaning;

/// Numbers that are no scale any more.
const LEAST_SCALE: f64 = 1e-12;
/// Share of an atmosphere that two statements of it differ by.
const LEFT_OF_ATMOSPHERE: f64 = 0.05;

/// The key that says what a column of pressures holds, `meaning` being what its numbers are and `file_unit` what is said of them.
pub(super) fn pressure_key(rig: &Rig, column: &str, meaning: Meaning, file_unit: Option<&FileUnit>) -> String {
    keyed(rig, column, |term| pressure_says(rig, column, (meaning, file_unit), term))
}

fn pressure_says(
    rig: &Rig,
    column: &str,
    (meaning, file_unit): (Meaning, Option<&FileUnit>),
    term: &Term,
) -> Option<String> {
    let atmosphere_kpa = rig.atmosphere.pressure_kpa_abs;
    let says = match meaning {
        Meaning::AsRead => None,
        Meaning::Absolute(_, "kPa") if file_unit.is_none() => Some(format!("offset = -{}", number(atmosphere_kpa))),
        Meaning::Gauge(..) | Meaning::Absolute(..) => meaning.unit().map(|unit| format!("unit = \"{unit}\"")),
        Meaning::Output(output) => Some(format!("unit = \"{}\"", output.unit())),
        // A scale alone would go with the numbers as they are written.
        Meaning::Unsigned => {
            let said = file_unit.map_or_else(String::new, |said| format!("unit = \"{}\", ", said.text));
            Some(format!("{said}scale = -1.0"))
        }
        Meaning::Counts { .. } => None,
    };
    if let Some(says) = says.filter(|_| term.is_plain()) {
        return Some(says);
    }
    let sensor = rig.sensor_of(column).map(|(_, sensor)| sensor);
    let of = |x: f64| meaning.line(sensor, None, atmosphere_kpa).map(|[scale, offset]| scale * x + offset);
    // What is said of the numbers as they are written takes the place of what was said before.
    let unit = term.unit.clone().filter(|_| file_unit.is_none());
    let bare = Term { unit, ..term.clone() };
    match (of(term.offset), of(term.offset + term.scale)) {
        (Some(at_zero), Some(at_one)) if (at_one - at_zero).abs() > LEAST_SCALE => {
            Some(line(&bare, at_one - at_zero, at_zero))
        }
        _ => None,
    }
}

/// The key that adds so many kPa to a column of pressures; what is left of an atmosphere taken away is none.
pub(super) fn shifted_key(rig: &Rig, column: &str, kpa: f64) -> String {
    keyed(rig, column, |term| {
        let offset = term.offset + kpa;
        let is_left = offset.abs() < LEFT_OF_ATMOSPHERE * kpa.abs();
        Some(line(term, term.scale, if is_left { 0.0 } else { offset }))
    })
}

/// The key that says of a command that its numbers are shares of 1, whatever unit is said of them.
pub(super) fn share_key(rig: &Rig, column: &str) -> String {
    keyed(rig, column, |term| term.is_plain().then(|| "unit = \"1\"".to_owned()))
}

/// The key that multiplies a command.
pub(super) fn multiplied_key(rig: &Rig, column: &str, factor: f64) -> String {
    keyed(rig, column, |term| Some(line(term, factor * term.scale, factor * term.offset)))
}

/// The key that turns a command round: 1 where it is 0.
pub(super) fn inverted_key(rig: &Rig, column: &str) -> String {
    keyed(rig, column, |term| Some(line(term, -term.scale, 1.0 - term.offset)))
}

/// The keys that exchange what two columns are made from.
pub(super) fn exchanged_keys(rig: &Rig, one: &str, other: &str) -> String {
    let plain = |column: &str| only_term(rig, column).filter(Term::is_plain).map(|term| term.from);
    match (plain(one), plain(other)) {
        (Some(of_one), Some(of_other)) => {
            format!("[recording] columns.{one} = \"{of_other}\" and columns.{other} = \"{of_one}\"")
        }
        _ => format!("exchange what [recording] says of columns.{one} and columns.{other}"),
    }
}

/// The only term that a column is made from; `None` where that is a sum.
fn only_term(rig: &Rig, column: &str) -> Option<Term> {
    let map = rig.recording.as_ref();
    match map.and_then(|map| map.columns.get(column)) {
        Some(terms) => match terms.0.as_slice() {
            [only] => Some(only.clone()),
            _ => None,
        },
        None => Some(Term::plain(column)),
    }
}

/// The key that says something of a column's only term; where it is a sum, or nothing can be said, that it is to be mended.
fn keyed(rig: &Rig, column: &str, says: impl Fn(&Term) -> Option<String>) -> String {
    let said = only_term(rig, column).and_then(|term| Some((says(&term)?, term)));
    match said {
        Some((says, term)) => format!("[recording] columns.{column} = {{ from = \"{}\", {says} }}", term.from),
        None => format!("fix [recording] columns.{column}"),
    }
}

/// A straight line of the file's numbers, with what the term says besides.
fn line(term: &Term, scale: f64, offset: f64) -> String {
    let unit = term.unit.as_ref().map_or_else(String::new, |unit| format!("unit = \"{unit}\", "));
    let root = if term.root { ", root = true" } else { "" };
    let offset = if offset == 0.0 { String::new() } else { format!(", offset = {}", number(offset)) };
    format!("{unit}scale = {}{offset}{root}", number(scale))
}

/// A number with a point and no more digits than anyone measures.
fn number(x: f64) -> String {
    let rounded: f64 = format!("{x:.6e}").parse().unwrap_or(x);
    format!("{rounded:?}")
}

impl Meaning {
    /// The unit as `[recording]` knows it; `None` where that is none of a pressure.
    pub(super) fn unit(self) -> Option<String> {
        match self {
            Meaning::Gauge(_, words) => Some(unit(words).to_owned()),
            Meaning::Absolute(_, words) => Some(format!("{} abs", unit(words))),
            _ => None,
        }
    }
}

/// The first of alike units, as `[recording]` knows it.
fn unit(words: &str) -> &str {
    match words {
        "m of water" => "mH2O",
        words => words.split([',', ' ']).next().unwrap_or(words),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_keep_what_the_map_says_already() {
        let text = include_str!("../../../../../model/rigs/dual_pressure.toml");
        let with = |map: &str| Rig::from_toml(&format!("{text}\n[recording]\n{map}")).unwrap();
        let absolute = Meaning::Absolute(1.0, "kPa");
        let key = |map: &str, meaning| pressure_key(&with(map), "p_pos_kpa", meaning, None);
        assert_eq!(
            key("columns.p_pos_kpa = { from = \"hPa\", scale = 0.1 }", absolute),
            "[recording] columns.p_pos_kpa = { from = \"hPa\", scale = 0.1, offset = -101.325 }"
        );
        assert_eq!(
            key("columns.p_pos_kpa = \"P\"", Meaning::Gauge(0.145_038, "psi")),
            "[recording] columns.p_pos_kpa = { from = \"P\", unit = \"psi\" }"
        );
        // Volts of 1 … 5 for 0 … 1000 kPa that were halved: 500 kPa a number, -250 kPa at zero.
        assert_eq!(
            key(
                "columns.p_pos_kpa = { from = \"P\", scale = 2.0 }",
                Meaning::Output(super::super::meaning::Output::Volts)
            ),
            "[recording] columns.p_pos_kpa = { from = \"P\", scale = 500.0, offset = -250.0 }"
        );
        assert_eq!(
            exchanged_keys(&with("columns.u_pos = \"PWM 1\""), "u_pos", "u_neg"),
            "[recording] columns.u_pos = \"u_neg\" and columns.u_neg = \"PWM 1\""
        );
        assert_eq!(
            inverted_key(&with("columns.u_pos = { from = \"PWM\", scale = 0.01 }"), "u_pos"),
            "[recording] columns.u_pos = { from = \"PWM\", scale = -0.01, offset = 1.0 }"
        );
    }
}
