//! Names of what a daemon runs with: policy, model and reference, as operators are answered.

use model::rig::Rig;
use serde::{Deserialize, Serialize};

use crate::reach::Reach;

/// A model by its name, where it comes from, and what it is.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ModelIdentity {
    /// The name that it has of itself.
    pub name: String,
    /// The file that it was read from; absent for a built-in one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// SHA-256 of the model as recordings hold it, comments left out.
    #[serde(default)]
    pub sha256: String,
}

impl ModelIdentity {
    /// The identity of a rig that was read by the name of a built-in one or from a file.
    ///
    /// # Real-time
    /// Not in the tick: it writes the rig out and hashes it.
    pub fn of(rig: &Rig, name_or_file: &str) -> Self {
        let file = Rig::builtin_text(name_or_file).is_none().then(|| name_or_file.to_owned());
        // A rig that was read can be written.
        let sha256 = policy::hash(rig.to_toml().unwrap_or_default().as_bytes()).to_string();
        ModelIdentity { name: rig.name.clone(), file, sha256 }
    }
}

/// Things that the daemon runs with, by name.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Running {
    /// Policy, or `fallback`.
    pub policy: String,
    /// SHA-256 of the policy's file; empty for the fallback.
    #[serde(default)]
    pub policy_sha256: String,
    /// The model behind the predictions.
    pub model: String,
    /// The file that it was read from; absent for a built-in one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model_file: Option<String>,
    /// SHA-256 of the model as recordings hold it, comments left out.
    #[serde(default)]
    pub model_sha256: String,
    /// The rig that the configuration names, where another model is in force.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub configured_model: Option<ModelIdentity>,
    /// The reference that is followed once armed.
    pub reference: String,
    /// Range of the pressures that the rig can hold, by the model in force; absent where that is not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reach: Option<Reach>,
    /// The reason why the fallback controls in place of a policy, one line.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub why_fallback: Option<String>,
    /// Name of who armed the rig, while it is armed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub armed_by: Option<String>,
}

impl Running {
    /// These names with this model in force.
    #[must_use]
    pub fn on_model(self, model: ModelIdentity) -> Self {
        Running { model: model.name, model_file: model.file, model_sha256: model.sha256, ..self }
    }

    /// The model in force.
    pub fn model_identity(&self) -> ModelIdentity {
        let (name, file, sha256) = (self.model.clone(), self.model_file.clone(), self.model_sha256.clone());
        ModelIdentity { name, file, sha256 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_is_hashed_and_named_by_its_file_where_it_has_one() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let before = ModelIdentity::of(&rig, "dual_pressure");
        assert_eq!((before.name.as_str(), &before.file, before.sha256.len()), ("dual_pressure", &None, 64));
        let running = Running::default().on_model(before.clone());
        assert_eq!(running.model_identity(), before, "nothing has come into force yet");
        let mut edited = rig.clone();
        edited.integrator.step_ms = 0.25;
        let after = ModelIdentity::of(&edited, "/etc/m.toml");
        assert_eq!((after.name.as_str(), after.file.as_deref()), ("dual_pressure", Some("/etc/m.toml")));
        assert_ne!(after.sha256, before.sha256);
        let moved = ModelIdentity::of(&rig, "/etc/n.toml");
        assert_eq!((moved.sha256, moved.file.as_deref()), (before.sha256, Some("/etc/n.toml")));
    }
}
