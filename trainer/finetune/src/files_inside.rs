//! Files inside a recording that the loop of a daemon is rebuilt from.

use model::rig::Rig;
use proto::emulator::check_tick;
use proto::reference::Reference;

use crate::FinetuneError;

/// `[reference]` of the daemon's configuration, as far as the loop depends on it.
#[derive(Debug, Default, serde::Deserialize)]
#[serde(default)]
pub(crate) struct ChosenReference {
    pub(crate) repeat: bool,
    pub(crate) learn: bool,
}

impl ChosenReference {
    /// Reads it; what is not there is as in a configuration without it.
    pub(crate) fn parse(configuration: &[u8]) -> Self {
        #[derive(Default, serde::Deserialize)]
        #[serde(default)]
        struct Configuration {
            reference: ChosenReference,
        }
        toml::from_str::<Configuration>(&String::from_utf8_lossy(configuration)).unwrap_or_default().reference
    }
}

/// The rig file inside a recording.
pub(crate) fn rig(file: &str, bytes: &[u8]) -> Result<Rig, FinetuneError> {
    let text = String::from_utf8_lossy(bytes);
    let sound = Rig::from_toml(&text).and_then(|rig| check_tick(&rig).map(|()| rig));
    sound.map_err(|problem| FinetuneError::Model { name: format!("{file}, model_rig.toml"), problem })
}

/// The reference inside a recording.
pub(crate) fn parsed_reference(file: &str, bytes: &[u8]) -> Result<Reference, FinetuneError> {
    Ok(Reference::parse(&format!("{file}, reference.csv"), bytes)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Predictions would be of another time than the ticks that are learned from.
    #[test]
    fn a_model_with_another_tick_is_refused_with_its_recording() {
        let mut model = Rig::builtin("dual_pressure").unwrap();
        assert_eq!(rig("run.mcap", model.to_toml().unwrap().as_bytes()).unwrap(), model);
        model.integrator.tick_ms = 10.0;
        let said = rig("run.mcap", model.to_toml().unwrap().as_bytes()).unwrap_err().to_string();
        let problem = "integrator.tick_ms: a tick of 10 ms; the cRIO samples every 20 ms";
        assert_eq!(said, format!("run.mcap, model_rig.toml: {problem}"));
    }
}
