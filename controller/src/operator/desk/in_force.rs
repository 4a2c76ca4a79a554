//! State, policy, model and reference in force, as operators and live viewers are told.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use model::rig::Rig;
use proto::stream::DaemonState;

use super::Desk;
use super::answers::one_line;
use crate::operator::running::{ModelIdentity, Running};
use crate::state::{Condition, State};

/// Between two looks for what live viewers are told.
const LOOK: Duration = Duration::from_millis(50);

/// The model in force, hashed once for each.
#[derive(Debug)]
pub(super) struct ShownModel {
    /// The rig that is hashed, and the file that it was put in by; `None` where models cannot be changed.
    hashed: Option<(Rig, Option<PathBuf>)>,
    identity: ModelIdentity,
}

impl ShownModel {
    /// The model that the daemon began with.
    pub(super) fn new(rig: Option<Rig>, running: &Running) -> Self {
        ShownModel { hashed: rig.map(|rig| (rig, None)), identity: running.model_identity() }
    }

    /// The identity of the model that is in force now.
    fn of(&mut self, in_force: (Rig, Option<PathBuf>)) -> &ModelIdentity {
        if self.hashed.as_ref() != Some(&in_force) {
            let (rig, file) = &in_force;
            let file = file.clone().unwrap_or_default();
            self.identity = ModelIdentity::of(rig, &one_line(&file.display().to_string()));
            self.hashed = Some(in_force);
        }
        &self.identity
    }
}

impl Desk {
    /// The identity of the model in force.
    fn model_in_force(&mut self) -> ModelIdentity {
        match &self.options.policies {
            Some(handle) => self.shown_model.of(handle.models.in_force()).clone(),
            None => self.shown_model.identity.clone(),
        }
    }

    /// Names of all that the daemon runs with now.
    pub(super) fn running(&mut self) -> Running {
        let is_controlled = self.live_status().is_some_and(|status| status.state.is_controlling());
        let configured = self.options.running.model_identity();
        let model = self.model_in_force();
        let mut running = self.options.running.clone();
        running.armed_by = running.armed_by.filter(|_| is_controlled);
        running.configured_model = (configured.sha256 != model.sha256).then_some(configured);
        if let Some(handle) = &self.options.policies {
            (running.policy, running.policy_sha256) = handle.policies.active();
            running.why_fallback = handle.policies.why_fallback();
        }
        running.on_model(model)
    }

    /// Tells live viewers the state, as an operator would be answered it.
    pub fn tell_viewers(&mut self) {
        let Some(viewers) = self.options.viewers.clone() else { return };
        if self.viewers_told.is_some_and(|at| at.elapsed() < LOOK) {
            return;
        }
        self.viewers_told = Some(Instant::now());
        self.refresh();
        viewers.state(self.daemon_state());
    }

    fn daemon_state(&mut self) -> DaemonState {
        let code = |condition: Option<Condition>| condition.map_or(0, Condition::code);
        let (live, newest) = (self.live_status(), self.newest.map(|(status, _)| status).unwrap_or_default());
        let state = live.map_or(State::Connect, |status| status.state);
        let running = self.running();
        DaemonState {
            state: state.code(),
            fault: code(newest.fault),
            waits: code(newest.latched),
            session: if state == State::Connect { 0 } else { newest.session },
            age_ms: self.age_ms(),
            policy: running.policy,
            policy_sha256: running.policy_sha256,
            model: running.model,
            model_sha256: running.model_sha256,
            reference: running.reference,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_is_hashed_anew_and_named_by_its_file_where_another_comes_into_force() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let running = Running::default().on_model(ModelIdentity::of(&rig, "dual_pressure"));
        let mut shown = ShownModel::new(Some(rig.clone()), &running);
        let before = shown.of((rig.clone(), None)).clone();
        assert_eq!((before.name.as_str(), &before.file, before.sha256.len()), ("dual_pressure", &None, 64));
        let mut edited = rig.clone();
        edited.integrator.step_ms = 0.25;
        assert_eq!(shown.of((rig.clone(), None)), &before, "nothing has come into force yet");
        let after = shown.of((edited, Some("/etc/m.toml".into()))).clone();
        assert_eq!((after.name.as_str(), after.file.as_deref()), ("dual_pressure", Some("/etc/m.toml")));
        assert_ne!(after.sha256, before.sha256);
        let moved = shown.of((rig, Some("/etc/n.toml".into()))).clone();
        assert_eq!((moved.sha256, moved.file.as_deref()), (before.sha256, Some("/etc/n.toml")));
    }
}
