//! Rigs drawn around a given one: how a controller does on a bench that nobody has measured.
//!
//! Every volume and every coefficient of valves and check valves within ±[`PARAMETERS`], every mechanism's magnitude
//! between [`MECHANISMS`] of its own, uniformly, each by itself. The draws depend on seed and number only.

use environment::draws::{Purpose, stream};
use environment::{DomainRandomization, EnvironmentError, EnvironmentSettings, RigDraw};
use model::rig::{MechanismInstance, Rig, RigError};
use rand::{Rng, RngExt as _};

/// Distance to which parameters are drawn, in percent.
pub const PARAMETERS: f64 = 3.0;
/// Between which multiples of its own a mechanism's magnitude is drawn.
pub const MECHANISMS: [f64; 2] = [0.5, 1.5];

/// Draws `count` rigs around `rig`.
///
/// # Errors
/// If a drawn rig is unsound.
pub fn rigs_around(rig: &Rig, count: usize, seed: u64) -> Result<Vec<Rig>, EnvironmentError> {
    let settings = EnvironmentSettings {
        spread: DomainRandomization {
            volumes_percent: PARAMETERS,
            valves_percent: PARAMETERS,
            check_valves_percent: PARAMETERS,
            ..DomainRandomization::default()
        },
        ..EnvironmentSettings::default()
    };
    let draw = RigDraw::new(rig, &settings)?;
    (0..count)
        .map(|n| {
            let mut random = stream(seed, Purpose::Rig, n as u64, 0);
            let mut drawn = draw.draw(&mut random)?;
            let error = |error| EnvironmentError::Rig { name: rig.name.clone(), error };
            for attached in &mut drawn.mechanisms {
                *attached = scaled(attached, &mut random).map_err(error)?;
            }
            drawn.check().map_err(error)?;
            drawn.name = format!("{} drawn #{}", rig.name, n + 1);
            Ok(drawn)
        })
        .collect()
}

/// Mechanism with every number times a drawn factor.
fn scaled(attached: &MechanismInstance, random: &mut impl Rng) -> Result<MechanismInstance, RigError> {
    let unsound = |problem: String| RigError::at("mechanisms", problem);
    let mut table = toml::Table::try_from(attached).map_err(|e| unsound(e.to_string()))?;
    for (_, value) in table.iter_mut() {
        if let toml::Value::Float(number) = value {
            *number *= random.random_range(MECHANISMS[0]..=MECHANISMS[1]);
        }
    }
    table.try_into().map_err(|e: toml::de::Error| unsound(e.message().to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::mechanism::Mechanism;

    #[test]
    fn draws_are_around_the_rig_and_never_the_rig_itself() {
        let bench = Rig::builtin("bench").unwrap();
        let rigs = rigs_around(&bench, 20, 1).unwrap();
        for (n, rig) in rigs.iter().enumerate() {
            let ratio = rig.volumes["positive"].volume_l / bench.volumes["positive"].volume_l;
            assert!((0.97..=1.03).contains(&ratio) && ratio != 1.0, "{ratio}");
            assert_eq!(rig.mechanisms.len(), bench.mechanisms.len());
            let Mechanism::ValveHysteresis(play) = &rig.mechanisms[0].mechanism else { panic!("the first is play") };
            assert!((0.015..=0.045).contains(&play.half_width_duty), "{}", play.half_width_duty);
            assert!(rigs[..n].iter().all(|other| other.mechanisms != rig.mechanisms));
        }
        assert_eq!(rigs, rigs_around(&bench, 20, 1).unwrap());
    }
}
