//! `[recording]`: how files that others wrote name and scale what a rig reads.
//!
//! ```toml
//! [recording]
//! time = "Time"                                          # in s; with a scale where it is not
//! columns.u_pump = { from = "PWM", scale = 0.0039215686 } # 0 … 255 to a duty
//! columns.p_kpa = "Pressure"
//! columns.q_lung = [                                     # a sum of terms
//!     { from = "dp_in", scale = 17.65, root = true },    # a venturi: flow goes with the root of the difference
//!     { from = "dp_out", scale = -17.65, root = true },
//! ]
//! ```
//!
//! A column of the rig is a sum of terms over columns of the file:
//!
//! ```text
//! y = Σ (scale · f(x) + offset),      f(x) = x,  or sign(x) √|x| with `root`
//! ```
//!
//! The root is the law of every flow meter with a throat (ISO 5167: `Q ∝ √Δp`), kept odd for flow that returns. With a
//! `unit` the file's numbers are first brought to the rig's unit. What a file does not tell about itself is said beside
//! the columns:
//!
//! ```toml
//! [recording]
//! separator = ";"          # "," ";" "tab" "blank"; found out where it is left out
//! decimal = ","            # "." or ","; found out where it is left out
//! header_line = 12         # the line that names the columns, from 1; found out where it is left out
//! names = ["t", "u", "p"]  # for a file that has no such line
//! period_ms = 20.0         # for a file that has no column of time: rows so far apart
//! ```
//!
//! This module only states the map; `proto::recording` reads files through it and brings them to the rig's rows.

use std::fmt;

use indexmap::IndexMap;
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{self, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use super::check::names;
use super::error::RigError;
use super::schema::{Pump, Rig, Source};

/// Map from the columns of a file to those of a rig.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordingMap {
    /// Time in s.
    #[serde(default = "time_s")]
    pub time: Terms,
    /// Distance between rows in ms, for files without a column of time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub period_ms: Option<f64>,
    /// Character between cells: `,`, `;`, `tab` or `blank`; found out where it is absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub separator: Option<Separator>,
    /// Decimal mark: `.` or `,`; found out where it is absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub decimal: Option<Decimal>,
    /// Line that names the columns, from 1; found out where it is absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub header_line: Option<u64>,
    /// Names of the columns of files that have no line of names.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub names: Vec<String>,
    /// Columns of the rig (commands, signals, readings of sensors), each by what it is made from; those that are not
    /// here have the same name and unit in the file.
    #[serde(default)]
    pub columns: IndexMap<String, Terms>,
}

/// Character between the cells of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Separator {
    /// A comma.
    #[serde(rename = ",", alias = "comma")]
    Comma,
    /// A semicolon.
    #[serde(rename = ";", alias = "semicolon")]
    Semicolon,
    /// A tab.
    #[serde(rename = "tab", alias = "\t")]
    Tab,
    /// A vertical bar.
    #[serde(rename = "|", alias = "bar")]
    Bar,
    /// A run of blanks.
    #[serde(rename = "blank", alias = " ")]
    Blank,
}

/// Mark between the whole and the broken part of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Decimal {
    /// `0.5`
    #[serde(rename = ".", alias = "point")]
    Point,
    /// `0,5`
    #[serde(rename = ",", alias = "comma")]
    Comma,
}

/// A sum of terms: in a rig file a name, a term, or a list of terms.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Terms(pub Vec<Term>);

/// One column of a file, scaled.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Term {
    /// The column's name in the file.
    pub from: String,
    /// Rig's unit per file's unit (with `root`, per root of it).
    #[serde(default = "one")]
    pub scale: f64,
    /// Added after scaling, in the rig's unit.
    #[serde(default)]
    pub offset: f64,
    /// True where `sign(x) √|x|` is scaled instead of `x`.
    #[serde(default)]
    pub root: bool,
    /// Unit of the file's numbers (`kPa`, `bar abs`, `psi`, `V`, `%`, `ms` …), brought to the rig's before anything else;
    /// absent means as the file says, or the rig's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
}

fn one() -> f64 {
    1.0
}

fn time_s() -> Terms {
    Terms(vec![Term::plain("time_s")])
}

impl Term {
    /// A column as it is.
    pub fn plain(from: &str) -> Self {
        Term { from: from.to_owned(), scale: 1.0, offset: 0.0, root: false, unit: None }
    }

    /// Tells whether numbers are taken as they stand: no scale, no offset, no root.
    pub fn is_plain(&self) -> bool {
        self.scale == 1.0 && self.offset == 0.0 && !self.root
    }

    /// Contribution of a number of the file.
    pub fn of(&self, x: f64) -> f64 {
        let x = if self.root { x.abs().sqrt().copysign(x) } else { x };
        self.scale * x + self.offset
    }
}

impl<'de> Deserialize<'de> for Terms {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        // Not an untagged enum: that would swallow what is wrong inside a term.
        struct Either;
        impl<'de> Visitor<'de> for Either {
            type Value = Terms;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a column's name, { from = \"…\" }, or a list of those")
            }

            fn visit_str<E: de::Error>(self, name: &str) -> Result<Terms, E> {
                Ok(Terms(vec![Term::plain(name)]))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Terms, A::Error> {
                Ok(Terms(vec![Term::deserialize(MapAccessDeserializer::new(map))?]))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<Terms, A::Error> {
                Ok(Terms(Vec::deserialize(SeqAccessDeserializer::new(seq))?))
            }
        }
        deserializer.deserialize_any(Either)
    }
}

impl Default for RecordingMap {
    fn default() -> Self {
        RecordingMap {
            time: time_s(),
            period_ms: None,
            separator: None,
            decimal: None,
            header_line: None,
            names: Vec::new(),
            columns: IndexMap::new(),
        }
    }
}

impl RecordingMap {
    /// Tells whether the table says where the time is, rather than leaving it at `time_s`.
    pub fn names_time(&self) -> bool {
        self.time != time_s()
    }

    pub(super) fn check(&self, rig: &Rig) -> Result<(), RigError> {
        check_terms("recording.time", &self.time)?;
        if let Some(period_ms) = self.period_ms.filter(|ms| !(ms.is_finite() && *ms > 0.0)) {
            return Err(RigError::at("recording.period_ms", format!("{period_ms} ms must be above zero")));
        }
        if self.header_line == Some(0) {
            return Err(RigError::at("recording.header_line", "lines count from 1"));
        }
        if self.separator == Some(Separator::Comma) && self.decimal == Some(Decimal::Comma) {
            return Err(RigError::at("recording.decimal", "a comma cannot both separate cells and stand in numbers"));
        }
        let known = rig.columns();
        for (column, terms) in &self.columns {
            let key = format!("recording.columns.{column}");
            if !known.contains(column) {
                return Err(RigError::at(
                    key,
                    format!("no part of the rig reads or is commanded by it; there are {}", names(known.iter())),
                ));
            }
            check_terms(&key, terms)?;
        }
        Ok(())
    }
}

fn check_terms(key: &str, terms: &Terms) -> Result<(), RigError> {
    if terms.0.is_empty() {
        return Err(RigError::at(key, "an empty list; name at least one column of the file"));
    }
    for term in &terms.0 {
        if term.from.is_empty() {
            return Err(RigError::at(key, "`from` is empty; name a column of the file"));
        }
        if !term.scale.is_finite() || term.scale == 0.0 || !term.offset.is_finite() {
            return Err(RigError::at(
                key,
                format!(
                    "scale {} and offset {} of `{}` must be finite, the scale not zero",
                    term.scale, term.offset, term.from
                ),
            ));
        }
    }
    Ok(())
}

impl Rig {
    /// Every column that the rig takes from recordings: commands, relays, signals, then readings.
    pub fn columns(&self) -> Vec<String> {
        let valves = self.valves.values().map(|valve| Some(&valve.command));
        let pumps = self.pumps.values().map(|pump| match pump {
            Pump::Piston(p) => p.relay.as_ref(),
            Pump::Flow(p) => p.command.as_ref(),
        });
        let sensors = self.sensors.values().map(|sensor| Some(&sensor.column));
        let mut columns: Vec<String> = Vec::new();
        for column in valves.chain(pumps).flatten().cloned().chain(self.signals()).chain(sensors.flatten().cloned()) {
            if !columns.contains(&column) {
                columns.push(column);
            }
        }
        columns
    }

    /// The columns of prescribed pressures and flows.
    pub fn signals(&self) -> Vec<String> {
        let signal = |source: &Source| match source {
            Source::Pressure { signal, .. } | Source::Flow { signal, .. } => signal.clone(),
        };
        self.sources.values().filter_map(signal).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RIG: &str = r#"
format = 1
name = "line"
[gas]
gas_constant_j_per_kg_k = 287.0
heat_capacity_ratio = 1.4
[atmosphere]
pressure_kpa_abs = 101.325
temperature_k = 293.15
[volumes.line]
volume_l = 0.1
temperature_k = 293.15
[pumps.pump]
kind = "flow"
outlet = "line"
command = "u"
flow_l_per_min = 2.0
[sensors.sensor]
volume = "line"
column = "p_kpa"
range_kpa_gauge = [0.0, 100.0]
range_v = [0.0, 5.0]
[recording]
time = { from = "ms", scale = 1e-3 }
columns.u = { from = "PWM", scale = 0.1 }
columns.p_kpa = [{ from = "a", root = true, scale = 3.0, offset = 1.0 }, { from = "b" }]
"#;

    #[test]
    fn a_map_is_read_and_written_again() {
        let rig = Rig::from_toml(RIG).unwrap();
        assert_eq!(Rig::from_toml(&rig.to_toml().unwrap()).unwrap(), rig);
        let map = rig.recording.unwrap();
        let p = &map.columns["p_kpa"].0;
        // 3 √4 + 1, and odd in x.
        assert_eq!([p[0].of(4.0), p[0].of(-4.0), p[1].of(2.5)], [7.0, -5.0, 2.5]);
        let short = Rig::from_toml(&RIG.replace("{ from = \"PWM\", scale = 0.1 }", "\"PWM\"")).unwrap();
        assert_eq!(short.recording.unwrap().columns["u"], Terms(vec![Term::plain("PWM")]));
        let keys = "separator = ';'\ndecimal = ','\nheader_line = 3\nnames = ['a']\nperiod_ms = 10.0\n";
        let told = Rig::from_toml(&RIG.replace("[recording]", &format!("[recording]\n{keys}"))).unwrap();
        let map = told.recording.clone().unwrap();
        assert_eq!((map.separator, map.decimal), (Some(Separator::Semicolon), Some(Decimal::Comma)));
        assert_eq!((map.header_line, map.period_ms, map.names.len()), (Some(3), Some(10.0), 1));
        assert_eq!(Rig::from_toml(&told.to_toml().unwrap()).unwrap(), told);
    }

    #[test]
    fn what_is_wrong_in_a_map_gets_its_line() {
        for (good, bad, words) in [
            ("columns.u =", "columns.v =", ["recording.columns.v", "`u`"]),
            ("scale = 0.1", "scale = 0.0", ["recording.columns.u", "scale"]),
            ("scale = 0.1", "sclae = 0.1", ["sclae", "scale"]),
            ("{ from = \"PWM\", scale = 0.1 }", "[]", ["recording.columns.u", "empty"]),
            ("{ from = \"PWM\", scale = 0.1 }", "7", ["recording.columns.u", "7"]),
            ("[recording]", "[recording]\nperiod_ms = 0.0", ["recording.period_ms", "above zero"]),
            ("[recording]", "[recording]\nheader_line = 0", ["recording.header_line", "from 1"]),
            ("[recording]", "[recording]\nseparator = \"~\"", ["separator", "tab"]),
            ("[recording]", "[recording]\nseparator = \",\"\ndecimal = \",\"", ["recording.decimal", "comma"]),
        ] {
            let error = Rig::from_toml(&RIG.replacen(good, bad, 1)).expect_err(bad);
            let message = error.to_string();
            assert!(error.line.is_some() && words.iter().all(|word| message.contains(word)), "{bad}: {message}");
        }
    }
}
