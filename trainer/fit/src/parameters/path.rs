//! A number of a rig by its dotted key, as it stands in the rig file.
//!
//! `volumes.positive.volume_l`, `valves.valve_neg.input_area_mm2`, `pumps.pump.speed_rpm`; a mechanism is addressed
//! by its id and component, `mechanisms.valve_lag@valve_pos.time_constant_ms`.

use model::rig::{Rig, RigError};
use toml::Value;

/// The number at `path`.
///
/// # Errors
/// There is no such key, or it holds no number.
pub fn value(rig: &Rig, path: &str) -> Result<f64, RigError> {
    let mut tree = tree(rig)?;
    let found = find(&mut tree, path)?;
    found.as_float().or_else(|| found.as_integer().map(|i| i as f64)).ok_or_else(|| RigError::at(path, "no number"))
}

/// Puts a number at `path`.
///
/// # Errors
/// There is no such key, it holds no number, or the value is out of range.
pub fn set_value(rig: &mut Rig, path: &str, value: f64) -> Result<(), RigError> {
    *rig = with_values(rig, [(path, value)])?;
    Ok(())
}

/// The rig with other numbers at some paths; the whole is checked.
pub(crate) fn with_values<'p>(rig: &Rig, values: impl IntoIterator<Item = (&'p str, f64)>) -> Result<Rig, RigError> {
    let mut tree = tree(rig)?;
    for (path, value) in values {
        *find(&mut tree, path)? = Value::Float(value);
    }
    let rig: Rig = tree.try_into().map_err(|e: toml::de::Error| RigError::at("", e.message().trim()))?;
    rig.check()?;
    Ok(rig)
}

fn tree(rig: &Rig) -> Result<Value, RigError> {
    Value::try_from(rig).map_err(|e| RigError::at("", e.to_string()))
}

fn find<'t>(tree: &'t mut Value, path: &str) -> Result<&'t mut Value, RigError> {
    let missing = || RigError::at(path, "the rig has no such parameter");
    let mut at = tree;
    for key in path.split('.') {
        at = match at {
            Value::Table(table) => table.get_mut(key),
            Value::Array(list) => list.iter_mut().enumerate().find(|(i, item)| is_item(item, *i, key)).map(|(_, v)| v),
            _ => None,
        }
        .ok_or_else(missing)?;
    }
    Ok(at)
}

/// Tells whether an item of a list is meant: a mechanism by `id@component`, anything by its number.
fn is_item(item: &Value, index: usize, key: &str) -> bool {
    match key.split_once('@') {
        Some((id, component)) => {
            let has = |name: &str, text: &str| item.get(name).and_then(Value::as_str) == Some(text);
            has("id", id) && has("component", component)
        }
        None => key.parse() == Ok(index),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_found_and_put_where_the_file_has_them() {
        let mut rig = Rig::builtin("bench").unwrap();
        let path = "valves.valve_neg.input_area_mm2";
        assert_eq!(value(&rig, path).unwrap(), rig.valves["valve_neg"].input_area_mm2);
        set_value(&mut rig, path, 8.25).unwrap();
        assert_eq!(rig.valves["valve_neg"].input_area_mm2, 8.25);
        let untouched = Rig { valves: Rig::builtin("bench").unwrap().valves, ..rig.clone() };
        assert_eq!(untouched, Rig::builtin("bench").unwrap(), "nothing else moved");
    }

    #[test]
    fn mechanisms_go_by_id_and_component() {
        let mut rig = Rig::builtin("bench").unwrap();
        let attached = rig.mechanisms.iter().find(|m| m.mechanism.id() == "valve_hysteresis").unwrap().clone();
        let path = format!("mechanisms.valve_hysteresis@{}.half_width_duty", attached.component);
        assert!(value(&rig, &path).unwrap() > 0.0);
        set_value(&mut rig, &path, 0.0123).unwrap();
        assert_eq!(value(&rig, &path).unwrap(), 0.0123);
    }

    #[test]
    fn wrong_keys_and_values_are_refused_by_name() {
        let mut rig = Rig::builtin("dual_pressure").unwrap();
        assert!(value(&rig, "volumes.positive.volume_ml").unwrap_err().to_string().contains("volume_ml"));
        let message = set_value(&mut rig, "volumes.positive.volume_l", -1.0).unwrap_err().to_string();
        assert!(message.contains("volumes.positive.volume_l") && message.contains("-1"), "{message}");
    }
}
