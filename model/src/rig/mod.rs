//! A rig as data: volumes, pumps, valves, lines, sources and sensors joined by name, in TOML.
//!
//! Reading does three things: parse (unknown keys are refused), check every number against the range
//! that makes sense for its unit, and check that every join leads somewhere. What comes out is sound;
//! [`crate::plant::Plant`] compiles it once into flat arrays. [`Rig::parameters`] lists its numbers by path, for fits. This module opens no files: callers
//! hand it text, so that the error they print can start with the path.

mod check;
mod error;
mod number;
mod parameters;
mod ranges;
mod read;
mod recording_map;
mod schema;

pub(crate) use check::{names, within};
pub use error::RigError;
pub(crate) use number::numbers;
pub use number::{Number, Numbers};
pub use parameters::Parameter;
pub use recording_map::{Decimal, RecordingMap, Separator, Term, Terms};
pub use schema::{
    ATMOSPHERE, Atmosphere, FlowPump, Gas, Integrator, Line, MechanismInstance, PistonPump, Pump, Rig, Sensor, Source,
    Valve, Volume, WHOLE_RIG,
};

/// The paper's rig, built in under the name `dual_pressure`.
pub const DUAL_PRESSURE: &str = include_str!("../../rigs/dual_pressure.toml");

/// The paper's rig as built on a real bench, built in under the name `bench`.
pub const BENCH: &str = include_str!("../../rigs/bench.toml");

impl Rig {
    /// Names of the rigs that need no file.
    pub const BUILTIN: [&'static str; 2] = ["dual_pressure", "bench"];

    /// Sensor that fills a column of recordings, with its name.
    pub fn sensor_of(&self, column: &str) -> Option<(&str, &Sensor)> {
        self.sensors.iter().find(|(_, sensor)| sensor.column == column).map(|(name, sensor)| (name.as_str(), sensor))
    }

    /// The text of a built-in rig.
    pub fn builtin_text(name: &str) -> Option<&'static str> {
        match name {
            "dual_pressure" => Some(DUAL_PRESSURE),
            "bench" => Some(BENCH),
            _ => None,
        }
    }

    /// Reads and checks a built-in rig.
    ///
    /// # Errors
    /// If `name` is not one of [`Rig::BUILTIN`].
    pub fn builtin(name: &str) -> Result<Rig, RigError> {
        match Self::builtin_text(name) {
            Some(text) => Self::from_toml(text),
            None => {
                Err(RigError::at("", format!("no built-in rig `{name}`; there are {}", Self::BUILTIN.join(" and "))))
            }
        }
    }

    /// Writes the rig as TOML that [`Rig::from_toml`] reads back to the same rig.
    ///
    /// # Errors
    /// If a value cannot be written as TOML; a rig that was read can always be written.
    pub fn to_toml(&self) -> Result<String, RigError> {
        toml::to_string_pretty(self).map_err(|e| RigError::at("", e.to_string()))
    }

    /// The rig without its mechanisms: what it would be if only the paper's physics held.
    pub fn without_mechanisms(&self) -> Rig {
        Rig { mechanisms: Vec::new(), ..self.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn built_in_rigs_survive_writing_and_reading() {
        for name in Rig::BUILTIN {
            let rig = Rig::builtin(name).unwrap();
            assert_eq!(rig.name, name);
            assert_eq!(Rig::from_toml(&rig.to_toml().unwrap()).unwrap(), rig);
        }
    }

    /// Each edit of the paper's rig must be refused with this line number and these words.
    #[test]
    fn bad_files_get_one_clear_line() {
        let cases: [(&str, &str, &[&str]); 16] = [
            ("volume_l = 0.75", "volume_ml = 750.0", &["volume_ml", "volume_l"]),
            ("volume_l = 0.75", "volume_l = -0.75", &["volumes.positive.volume_l", "-0.75", "L"]),
            ("volume_l = 0.75", "volume_l = 750.0", &["volumes.positive.volume_l", "750", "mL"]),
            ("volume_l = 0.75", "volume_l = nan", &["volumes.positive.volume_l", "NaN"]),
            ("volume_l = 0.75", "volume_l = \"big\"", &["volume_l", "string"]),
            ("volume_l = 0.75\n", "", &["volumes.positive", "missing", "volume_l"]),
            ("from = \"positive\"", "from = \"positve\"", &["valves.valve_pos.from", "positve", "positive"]),
            ("to = \"atmosphere\"", "to = \"positive\"", &["valves.valve_pos", "both ends"]),
            ("kind = \"piston\"", "kind = \"pistons\"", &["pistons", "piston"]),
            ("volume = \"negative\"", "volume = \"nowhere\"", &["sensors.sensor_neg.volume", "nowhere"]),
            ("speed_rpm = 3000.0", "speed_rpm = 3000.0\nspeed_hz = 50.0", &["speed_hz"]),
            ("effective_length_mm = 41.0", "effective_length_mm = 39.0", &["effective_length_mm", "40"]),
            ("step_ms = 0.1", "step_ms = 0.3", &["step_ms", "whole number"]),
            ("format = 1", "format = 2", &["format", "1"]),
            ("range_v = [1.0, 5.0]", "range_v = [5.0, 5.0]", &["sensors.sensor_pos.range_v"]),
            (
                "temperature_k = 293.15\n\n[volumes.negative]",
                "temperature_k = 20.0\n\n[volumes.negative]",
                &["temperature_k", "20", "K"],
            ),
        ];
        for (good, bad, words) in cases {
            assert!(DUAL_PRESSURE.contains(good), "the case `{good}` no longer applies");
            let text = DUAL_PRESSURE.replacen(good, bad, 1);
            let error = Rig::from_toml(&text).expect_err(bad);
            let message = error.to_string();
            assert!(error.line.is_some(), "no line in: {message}");
            assert!(!message.contains('\n'), "more than one line: {message}");
            for word in words {
                assert!(message.contains(word), "`{word}` is not in: {message}");
            }
        }
    }

    #[test]
    fn mechanisms_are_checked_too() {
        let with =
            |text: &str| Rig::from_toml(&format!("{DUAL_PRESSURE}\n[[mechanisms]]\n{text}")).unwrap_err().to_string();
        let message = with("id = \"valve_lag\"\ncomponent = \"valve_pos\"\ntime_constant_s = 0.05\n");
        assert!(message.contains("time_constant_s") && message.contains("time_constant_ms"), "{message}");
        let message = with("id = \"valve_lag\"\ncomponent = \"positive\"\ntime_constant_ms = 50.0\n");
        assert!(message.contains("positive") && message.contains("valve"), "{message}");
        let message = with("id = \"valve_magic\"\ncomponent = \"valve_pos\"\n");
        assert!(message.contains("valve_magic") && message.contains("valve_lag"), "{message}");
        let message = with("id = \"valve_hysteresis\"\ncomponent = \"valve_pos\"\nhalf_width_duty = 0.7\n");
        assert!(message.contains("half_width_duty") && message.contains("0.7"), "{message}");
        let lag = "id = \"valve_lag\"\ncomponent = \"valve_pos\"\ntime_constant_ms = 50.0\n";
        let message = with(&format!("{lag}[[mechanisms]]\n{lag}"));
        assert!(message.contains("mechanisms.2") && message.contains("already"), "{message}");
    }
}
