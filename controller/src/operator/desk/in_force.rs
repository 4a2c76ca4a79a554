//! State, policy, model and reference in force, as operators and live viewers are told.

use std::time::{Duration, Instant};

use proto::stream::DaemonState;

use super::Desk;
use super::answers::one_line;
use crate::operator::running::{ModelIdentity, Running};
use crate::state::{Condition, State};

/// Between two looks for what live viewers are told.
const LOOK: Duration = Duration::from_millis(50);

impl Desk {
    /// The identity of the model in force.
    fn model_in_force(&self) -> ModelIdentity {
        let put_in = self.options.policies.as_ref().and_then(|handle| handle.models.put_in());
        match put_in {
            Some(model) => ModelIdentity { file: model.file.map(|file| one_line(&file)), ..model },
            None => self.options.running.model_identity(),
        }
    }

    /// Names of all that the daemon runs with now.
    pub(super) fn running(&self) -> Running {
        let is_controlled = self.live_status().is_some_and(|status| status.state.is_controlling());
        let configured = self.options.running.model_identity();
        let model = self.model_in_force();
        let mut running = self.options.running.clone();
        running.armed_by = running.armed_by.filter(|_| is_controlled);
        running.configured_model = (configured.sha256 != model.sha256).then_some(configured);
        if let Some(handle) = &self.options.policies {
            (running.policy, running.policy_sha256) = handle.policies.active();
            running.why_fallback = handle.policies.why_fallback();
            running.reach = handle.models.reach().range();
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

    fn daemon_state(&self) -> DaemonState {
        let code = |condition: Option<Condition>| condition.map_or(0, Condition::code);
        let (live, newest) = (self.live_status(), self.newest.map(|shown| shown.status).unwrap_or_default());
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
            recording_free_bytes: self.options.health.free_bytes(),
        }
    }
}
