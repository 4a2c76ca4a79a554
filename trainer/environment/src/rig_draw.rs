//! Rigs drawn around a nominal one (domain randomisation; Tobin et al., IROS 2017).

use std::collections::BTreeMap;

use model::rig::{MechanismInstance, Pump, Rig, RigError};
use rand::{Rng, RngExt as _};

use crate::EnvironmentError;
use crate::settings::{DomainRandomization, EnvironmentSettings, MechanismDraw};

/// Draws rigs of one structure.
#[derive(Debug, Clone)]
pub struct RigDraw {
    nominal: Rig,
    spread: DomainRandomization,
    mechanisms: Vec<MechanismDraw>,
}

impl RigDraw {
    /// Draws around `nominal`, as the settings say.
    ///
    /// # Errors
    /// If a mechanism, a component or a range is not one of the rig's, by name.
    pub fn new(nominal: &Rig, settings: &EnvironmentSettings) -> Result<Self, EnvironmentError> {
        let draw = RigDraw {
            nominal: nominal.clone(),
            spread: settings.spread.clone(),
            mechanisms: settings.mechanisms.clone(),
        };
        // Both ends of every range must make a sound rig; everything between then does.
        for share in [0.0, 1.0] {
            for (n, mechanism) in draw.mechanisms.iter().enumerate() {
                let key = format!("environment.mechanisms[{n}]");
                let setting = |problem: String| EnvironmentError::Setting { key: key.clone(), problem };
                let attached = attached(mechanism, |[low, high]| low + share * (high - low)).map_err(setting)?;
                let mut rig = nominal.clone();
                rig.mechanisms.push(attached);
                rig.check().map_err(|error| setting(error.to_string()))?;
            }
        }
        Ok(draw)
    }

    /// The rig that is drawn around.
    pub fn nominal(&self) -> &Rig {
        &self.nominal
    }

    /// Draws a rig.
    ///
    /// # Errors
    /// If parameters and mechanisms together make no sound rig.
    pub fn draw(&self, random: &mut impl Rng) -> Result<Rig, EnvironmentError> {
        let mut rig = self.nominal.clone();
        let mut vary = |value: &mut f64, percent: f64| {
            // Drawn even where nothing is spread, so that one spread does not move the draws of the next.
            let share: f64 = random.random_range(-1.0..=1.0);
            *value *= 1.0 + 0.01 * percent * share;
        };
        for volume in rig.volumes.values_mut() {
            vary(&mut volume.volume_l, self.spread.volumes_percent);
        }
        for valve in rig.valves.values_mut() {
            vary(&mut valve.input_area_mm2, self.spread.valves_percent);
            vary(&mut valve.pressure_area_mm2_per_n, self.spread.valves_percent);
            vary(&mut valve.spring_area_mm2, self.spread.valves_percent);
        }
        for pump in rig.pumps.values_mut() {
            if let Pump::Piston(piston) = pump {
                vary(&mut piston.inlet_check_area_mm2, self.spread.check_valves_percent);
                vary(&mut piston.outlet_check_area_mm2, self.spread.check_valves_percent);
            }
        }
        let mut fates = BTreeMap::new();
        for mechanism in &self.mechanisms {
            let presence_draw = match mechanism.none {
                0.0 => 1.0,
                _ => *fates.entry(&mechanism.component).or_insert_with(|| random.random_range(0.0..1.0)),
            };
            let drawn = attached(mechanism, |[low, high]| {
                let share: f64 = random.random_range(0.0..=1.0);
                if presence_draw < mechanism.none { low } else { low + share * (high - low) }
            });
            let sound = drawn.map_err(|problem| RigError::at("mechanisms", problem));
            rig.mechanisms.push(sound.map_err(EnvironmentError::rig(&self.nominal))?);
        }
        rig.name = format!("{} (drawn)", self.nominal.name);
        rig.check().map_err(EnvironmentError::rig(&self.nominal))?;
        Ok(rig)
    }
}

/// A mechanism with every parameter chosen from its range, through the same reader as rig files.
fn attached(draw: &MechanismDraw, mut choose: impl FnMut([f64; 2]) -> f64) -> Result<MechanismInstance, String> {
    let mut table = toml::Table::new();
    table.insert("id".into(), draw.id.clone().into());
    table.insert("component".into(), draw.component.clone().into());
    for (name, range) in &draw.ranges {
        table.insert(name.clone(), choose(*range).into());
    }
    table.try_into().map_err(|error: toml::de::Error| error.message().trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::draws::{Purpose, stream};

    fn settings() -> EnvironmentSettings {
        toml::from_str(
            "[spread]\nvolumes_percent = 5.0\nvalves_percent = 4.0\n\
             [[mechanisms]]\nid = \"valve_hysteresis\"\ncomponent = \"valve_pos\"\nhalf_width_duty = [0.01, 0.05]\n",
        )
        .unwrap()
    }

    #[test]
    fn draws_stay_within_their_ranges_and_fill_them() {
        let nominal = Rig::builtin("dual_pressure").unwrap();
        let draw = RigDraw::new(&nominal, &settings()).unwrap();
        let mut widths = Vec::new();
        for episode in 0..200 {
            let rig = draw.draw(&mut stream(1, Purpose::Rig, episode, 0)).unwrap();
            let ratio = rig.volumes["positive"].volume_l / nominal.volumes["positive"].volume_l;
            assert!((0.95..=1.05).contains(&ratio), "{ratio}");
            let model::mechanism::Mechanism::ValveHysteresis(m) = &rig.mechanisms[0].mechanism else { panic!() };
            widths.push(m.half_width_duty);
        }
        let (low, high) = widths.iter().fold((1.0_f64, 0.0_f64), |(l, h), w| (l.min(*w), h.max(*w)));
        // The extremes of 200 uniform draws lie within 2.5 % of the ends but for one case in 150.
        assert!((0.01..0.011).contains(&low) && (0.049..=0.05).contains(&high), "{low} … {high}");
    }

    #[test]
    fn some_valves_have_nothing_of_their_mechanisms_and_then_of_all_of_them() {
        let nominal = Rig::builtin("dual_pressure").unwrap();
        let settings: EnvironmentSettings = toml::from_str(
            "[[mechanisms]]\nid = \"valve_hysteresis\"\ncomponent = \"valve_neg\"\nnone = 0.25\nhalf_width_duty = [0.0, 0.05]\n\
             [[mechanisms]]\nid = \"command_delay\"\ncomponent = \"valve_neg\"\nnone = 0.25\ndelay_ms = [0.0, 40.0]\n",
        )
        .unwrap();
        settings.check().unwrap();
        let draw = RigDraw::new(&nominal, &settings).unwrap();
        let mut plain = 0;
        for episode in 0..400 {
            use model::mechanism::Mechanism::{CommandDelay, ValveHysteresis};
            let rig = draw.draw(&mut stream(1, Purpose::Rig, episode, 0)).unwrap();
            let [ValveHysteresis(play), CommandDelay(delay)] = [0, 1].map(|n| &rig.mechanisms[n].mechanism) else {
                panic!()
            };
            assert_eq!(play.half_width_duty == 0.0, delay.delay_ms == 0.0);
            plain += usize::from(play.half_width_duty == 0.0);
        }
        // 100 of 400 expected; the binomial's standard deviation is 8.7.
        assert!((70..=130).contains(&plain), "{plain}");
    }

    #[test]
    fn a_wrong_component_or_parameter_is_named() {
        let nominal = Rig::builtin("dual_pressure").unwrap();
        for (find, replace, word) in
            [("valve_pos", "valve_left", "valve_left"), ("half_width_duty", "half_width", "half_width")]
        {
            let mut settings = settings();
            let draw = &mut settings.mechanisms[0];
            draw.component = draw.component.replace(find, replace);
            draw.ranges = draw.ranges.iter().map(|(k, v)| (k.replace(find, replace), *v)).collect();
            let message = RigDraw::new(&nominal, &settings).unwrap_err().to_string();
            assert!(message.starts_with("environment.mechanisms[0]") && message.contains(word), "{message}");
        }
    }
}
