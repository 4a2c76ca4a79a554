//! Rigs with a payload: an artificial muscle that hangs on both chambers and changes their volumes.

use model::rig::{MechanismInstance, Rig, RigError};

/// The rig with a hyperbaric/vacuum muscle that carries `payload_kg`.
///
/// # Errors
/// If the rig has no such chambers.
pub fn loaded(rig: &Rig, payload_kg: f64) -> Result<Rig, RigError> {
    let mut table = toml::Table::new();
    table.insert("id".into(), "actuator_load".into());
    table.insert("component".into(), "positive".into());
    table.insert("vacuum".into(), "negative".into());
    table.insert("payload_kg".into(), payload_kg.into());
    let attached: MechanismInstance =
        table.try_into().map_err(|e: toml::de::Error| RigError::at("mechanisms", e.message().to_owned()))?;
    let mut loaded = rig.clone();
    loaded.mechanisms.push(attached);
    loaded.name = format!("{} with {payload_kg} kg", rig.name);
    loaded.check()?;
    Ok(loaded)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_muscle_hangs_on_both_chambers_or_the_rig_is_refused() {
        let bench = Rig::builtin("bench").unwrap();
        let heavy = loaded(&bench, 20.0).unwrap();
        assert_eq!(heavy.mechanisms.len(), bench.mechanisms.len() + 1);
        assert!(loaded(&bench, f64::NAN).is_err());
        let mut other = bench.clone();
        let chamber = other.volumes.shift_remove("negative").unwrap();
        other.volumes.insert("vacuum".into(), chamber);
        assert!(loaded(&other, 5.0).is_err());
    }
}
