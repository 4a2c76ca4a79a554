//! A rig's numbers by path, for fits.
//!
//! A path names one number the way the file does, mechanisms by their place in the list from 0:
//! `atmosphere.pressure_kpa_abs`, `volumes.positive.volume_l`, `pumps.pump.speed_rpm`,
//! `valves.valve_pos.input_area_mm2`, `lines.hose.area_mm2`, `sources.feed.flow_l_per_min`,
//! `mechanisms[2].half_width_duty`, `mechanisms[3].flow_mg_per_s[5]`. What the integrator is set to, crank phases and
//! the ranges of sensors are settings, no parameters.

use indexmap::IndexMap;

use super::error::RigError;
use super::number::{Number, Numbers};
use super::schema::Rig;

/// A number of a rig that a fit may move.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Path, for [`Rig::value`] and [`Rig::set_value`].
    pub path: String,
    /// Unit; empty for a bare number.
    pub unit: &'static str,
    /// Lowest plausible value. A stated value beyond the plausible range widens it.
    pub low: f64,
    /// Highest plausible value.
    pub high: f64,
    /// Value that the rig states.
    pub value: f64,
    /// Standard deviation of what one knows beforehand, as a share of the value; for a mechanism 1, the magnitude itself.
    pub prior_sd: f64,
    /// True where it can be negative (and so cannot be fitted as a logarithm).
    pub signed: bool,
}

/// Something in the rig that holds numbers, with the path in front of their keys.
type Holder<'r> = (String, &'r dyn Numbers);

impl Rig {
    /// All numbers that a fit may move, in the order of the file; mechanisms that are switched off are left out, and
    /// optional keys that were left out (a rigid volume's compliance).
    pub fn parameters(&self) -> Vec<Parameter> {
        let mut parameters = Vec::new();
        for (path, holder) in self.holders() {
            let of_mechanism = path.starts_with("mechanisms[");
            let numbers = holder.numbers();
            for (index, number) in numbers.iter().enumerate() {
                let value = holder.number(index);
                if number.optional && value == 0.0 {
                    continue;
                }
                parameters.push(Parameter {
                    path: format!("{path}.{}", key_of(&numbers, index)),
                    unit: number.unit,
                    low: number.plausible[0].min(value),
                    high: number.plausible[1].max(value),
                    value,
                    prior_sd: if of_mechanism { 1.0 } else { number.prior_sd },
                    signed: number.is_signed(),
                });
            }
        }
        parameters
    }

    /// The number at a path.
    ///
    /// # Errors
    /// If no number of the rig has this path.
    pub fn value(&self, path: &str) -> Result<f64, RigError> {
        let found = self.all_holders().into_iter().find_map(|(prefix, holder)| {
            position(&holder.numbers(), path.strip_prefix(&prefix)?.strip_prefix('.')?)
                .map(|index| holder.number(index))
        });
        found.ok_or_else(|| unknown_path(path))
    }

    /// Changes the number at a path; the rig stays as it was where the new one makes no sound rig.
    ///
    /// # Errors
    /// If no number of the rig has this path, or the value is outside its accepted range or contradicts another.
    pub fn set_value(&mut self, path: &str, value: f64) -> Result<(), RigError> {
        let slot = self.slot(path).ok_or_else(|| unknown_path(path))?;
        let before = std::mem::replace(slot, value);
        let checked = self.check();
        if checked.is_err()
            && let Some(slot) = self.slot(path)
        {
            *slot = before;
        }
        checked
    }

    /// Components that hold parameters.
    fn holders(&self) -> Vec<Holder<'_>> {
        let all = self.all_holders();
        let off = |path: &str| {
            self.mechanisms.iter().enumerate().any(|(n, m)| !m.enabled && path == format!("mechanisms[{n}]"))
        };
        all.into_iter().filter(|(path, _)| !off(path)).collect()
    }

    fn all_holders(&self) -> Vec<Holder<'_>> {
        fn within<'r, T: Numbers>(table: &str, named: &'r IndexMap<String, T>) -> Vec<Holder<'r>> {
            named.iter().map(|(name, holder)| (format!("{table}.{name}"), holder as &dyn Numbers)).collect()
        }
        let mut holders: Vec<Holder<'_>> =
            vec![("gas".to_owned(), &self.gas), ("atmosphere".to_owned(), &self.atmosphere)];
        holders.extend(within("volumes", &self.volumes));
        holders.extend(within("pumps", &self.pumps));
        holders.extend(within("valves", &self.valves));
        holders.extend(within("lines", &self.lines));
        holders.extend(within("sources", &self.sources));
        let mechanisms = self.mechanisms.iter().enumerate();
        holders.extend(mechanisms.map(|(n, m)| (format!("mechanisms[{n}]"), &m.mechanism as &dyn Numbers)));
        holders
    }

    fn slot(&mut self, path: &str) -> Option<&mut f64> {
        // Names may hold dots, so the longest holder that fits is meant.
        let (prefix, index) = self
            .all_holders()
            .into_iter()
            .filter_map(|(prefix, holder)| {
                let index = position(&holder.numbers(), path.strip_prefix(&prefix)?.strip_prefix('.')?)?;
                Some((prefix, index))
            })
            .max_by_key(|(prefix, _)| prefix.len())?;
        let (table, name) = prefix.split_once('.').unwrap_or((prefix.as_str(), ""));
        let holder: &mut dyn Numbers = match table {
            "gas" => &mut self.gas,
            "atmosphere" => &mut self.atmosphere,
            "volumes" => self.volumes.get_mut(name)?,
            "pumps" => self.pumps.get_mut(name)?,
            "valves" => self.valves.get_mut(name)?,
            "lines" => self.lines.get_mut(name)?,
            "sources" => self.sources.get_mut(name)?,
            _ => {
                let n: usize = prefix.strip_prefix("mechanisms[")?.strip_suffix(']')?.parse().ok()?;
                &mut self.mechanisms.get_mut(n)?.mechanism
            }
        };
        holder.number_mut(index)
    }
}

/// The key of number `index`; numbers that share one are told apart by `[n]`.
fn key_of(numbers: &[Number], index: usize) -> String {
    let Some(number) = numbers.get(index) else { return String::new() };
    let shared = numbers.iter().filter(|other| other.key == number.key).count() > 1;
    let before = numbers.iter().take(index).filter(|other| other.key == number.key).count();
    if shared { format!("{}[{before}]", number.key) } else { number.key.to_owned() }
}

fn position(numbers: &[Number], key: &str) -> Option<usize> {
    let bare = key.split('[').next()?;
    (0..numbers.len()).filter(|n| numbers.get(*n).is_some_and(|n| n.key == bare)).find(|n| key_of(numbers, *n) == key)
}

fn unknown_path(path: &str) -> RigError {
    RigError::at(path, "the rig has no such number; `Rig::parameters` lists them all")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::Rig;

    const HOSE: &str = r#"
format = 1
name = "pump and hose"
gas = { gas_constant_j_per_kg_k = 287.0, heat_capacity_ratio = 1.4 }
atmosphere = { pressure_kpa_abs = 101.325, temperature_k = 293.15 }
[volumes."line.1"]
volume_l = 0.1
temperature_k = 293.15
[pumps.pump]
kind = "flow"
outlet = "line.1"
command = "pwm"
flow_l_per_min = 3.0
[lines.hose]
kind = "laminar"
from = "line.1"
to = "atmosphere"
resistance_kpa_s_per_l = 100.0
[sources.feed]
kind = "flow"
to = "line.1"
flow_l_per_min = 0.1
[sensors.gauge]
volume = "line.1"
column = "p_kpa"
range_kpa_gauge = [0.0, 100.0]
range_v = [1.0, 5.0]
"#;

    #[test]
    fn every_parameter_can_be_read_and_moved() {
        let hose = Rig::from_toml(HOSE).unwrap();
        let table = "[[mechanisms]]\nid = \"residual_flow\"\ncomponent = \"positive\"\nflow_mg_per_s = [0.0, 1.0, 2.0]\n\
                     axes = [{ variable = \"duty\", of = \"valve_neg\", knots = [0.0, 0.5, 1.0] }]\n";
        let tabled = Rig::from_toml(&format!("{}\n{table}", crate::rig::DUAL_PRESSURE)).unwrap();
        for rig in [Rig::builtin("dual_pressure").unwrap(), Rig::builtin("bench").unwrap(), hose, tabled] {
            let parameters = rig.parameters();
            assert!(parameters.len() > 8, "{}", rig.name);
            for parameter in &parameters {
                let Parameter { path, low, high, value, .. } = parameter;
                assert!(low <= value && value <= high && low < high, "{parameter:?}");
                assert_eq!(rig.value(path).unwrap().to_bits(), value.to_bits(), "{path}");
                let moved = value * 1.001 + if *value == 0.0 { 1e-3 * high } else { 0.0 };
                let mut other = rig.clone();
                other.set_value(path, moved).unwrap_or_else(|e| panic!("{path}: {e}"));
                assert_eq!(other.value(path).unwrap(), moved);
                assert_ne!(other, rig, "{path}");
                // One number and no other.
                other.set_value(path, *value).unwrap();
                assert_eq!(other, rig, "{path}");
            }
        }
    }

    #[test]
    fn a_value_that_makes_no_sense_changes_nothing() {
        let mut rig = Rig::builtin("bench").unwrap();
        let before = rig.clone();
        let cases = [
            ("volumes.positive.volume_l", -1.0, "volumes.positive.volume_l"),
            ("pumps.pump.rod_length_mm", 19.0, "pumps.pump.rod_length_mm"),
            ("mechanisms[0].half_width_duty", f64::NAN, "mechanisms.1.half_width_duty"),
            ("mechanisms[99].half_width_duty", 0.1, "mechanisms[99].half_width_duty"),
            ("volumes.positive.weight", 0.1, "volumes.positive.weight"),
            ("integrator.step_ms", 0.1, "integrator.step_ms"),
        ];
        for (path, value, key) in cases {
            let error = rig.set_value(path, value).unwrap_err();
            assert_eq!(error.key, key, "{error}");
            assert_eq!(rig, before);
        }
    }

    #[test]
    fn switched_off_mechanisms_hold_no_parameters() {
        let mut rig = Rig::builtin("bench").unwrap();
        let all = rig.parameters().len();
        rig.mechanisms[0].enabled = false;
        assert_eq!(rig.parameters().len(), all - 1);
        assert!(rig.parameters().iter().all(|p| !p.path.starts_with("mechanisms[0]")));
        assert!(rig.value("mechanisms[0].half_width_duty").is_ok(), "it can still be read");
    }
}
