//! What is in force, as operators and live viewers are told: state, policy, model, reference.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use model::rig::Rig;
use proto::stream::DaemonState;

use super::answers::one_line;
use super::{Desk, Step};
use crate::operator::operator_protocol::{ModelIdentity, Running};
use crate::state::{Condition, State};

/// Between two looks for what live viewers are told.
const LOOK: Duration = Duration::from_millis(50);

/// The model in force, hashed once for each.
#[derive(Debug)]
pub(super) struct ShownModel {
    /// What is hashed; `None` where models cannot be changed.
    rig: Option<Rig>,
    identity: ModelIdentity,
    /// The file that the change under way was asked for with; at most one is under way.
    asked: Option<PathBuf>,
}

impl ShownModel {
    /// The model that the daemon began with.
    pub(super) fn new(rig: Option<Rig>, running: &Running) -> Self {
        ShownModel { rig, identity: running.model_identity(), asked: None }
    }

    /// The identity of the model that is in force now.
    fn of(&mut self, rig: Rig) -> &ModelIdentity {
        if self.rig.as_ref() != Some(&rig) {
            let file = self.asked.take().unwrap_or_default();
            self.identity = ModelIdentity::of(&rig, &one_line(&file.display().to_string()));
            self.rig = Some(rig);
        }
        &self.identity
    }
}

impl Desk {
    /// Notes that a change of the model is under way, if the request for it was taken up.
    pub(super) fn model_asked(&mut self, file: &Path, step: &Step) {
        if matches!(step, Step::Pending(_)) {
            // The one before it is over by then.
            self.model_in_force();
            self.shown_model.asked = Some(file.to_owned());
        }
    }

    /// The identity of the model in force.
    fn model_in_force(&mut self) -> ModelIdentity {
        match &self.options.policies {
            Some(handle) => self.shown_model.of(handle.models.rig()).clone(),
            None => self.shown_model.identity.clone(),
        }
    }

    /// What the daemon runs with now.
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
        let before = shown.of(rig.clone()).clone();
        assert_eq!((before.name.as_str(), &before.file, before.sha256.len()), ("dual_pressure", &None, 64));
        let mut edited = rig.clone();
        edited.integrator.step_ms = 0.25;
        shown.asked = Some("/etc/m.toml".into());
        assert_eq!(shown.of(rig), &before, "nothing has come into force yet");
        let after = shown.of(edited).clone();
        assert_eq!((after.name.as_str(), after.file.as_deref()), ("dual_pressure", Some("/etc/m.toml")));
        assert_ne!(after.sha256, before.sha256);
    }
}
