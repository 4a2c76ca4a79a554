//! Exploration as operators ask for it: whether it may begin, and what they are told.

use handover::{ExplorationRules, ExplorationShown, StdOrigin};

use super::policies::NO_POLICIES;
use super::{Asked, Desk, Step, WITHDRAWN, What};
use crate::config::FALLBACK;
use crate::machine::clock::now_ns;
use crate::operator::mailbox::{Fate, Request, Status, Ticket};
use crate::operator::operator_protocol::Switch;
use crate::policy_service::PolicyHandle;
use crate::state::State;

/// Exploration that the tick is asked to begin or to end.
#[derive(Debug, Clone, Copy)]
pub(super) struct Switching {
    pub(super) ticket: Ticket,
    wanted: Wanted,
}

/// The switch that an operator asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Wanted {
    /// Noise of this seed.
    On { seed: u32 },
    /// None.
    Off,
}

impl Switching {
    pub(super) fn name(self) -> &'static str {
        match self.wanted {
            Wanted::On { .. } => "explore on",
            Wanted::Off => "explore off",
        }
    }
}

impl Desk {
    pub(super) fn begin_exploring(&mut self, switch: Switch, seed: Option<u32>, asked: Asked) -> Step {
        let wanted = match switch {
            // The clock's lowest bits: which ones they are is in the event and in every answer.
            Switch::On => Wanted::On { seed: seed.unwrap_or(now_ns() as u32) },
            Switch::Off => Wanted::Off,
        };
        match self.start_exploring(wanted, asked) {
            Ok(ticket) => asked.pending(What::Explore(Switching { ticket, wanted })),
            Err(why) => self.over("explore", asked.peer, Err(why)),
        }
    }

    pub(super) fn look_at_exploring(&mut self, switching: Switching, asked: Asked) -> Step {
        match self.exploring(switching, asked) {
            Some(outcome) => self.over_saying(switching.name(), asked.peer, outcome),
            None => asked.pending(What::Explore(switching)),
        }
    }

    fn start_exploring(&self, wanted: Wanted, asked: Asked) -> Result<Ticket, String> {
        if wanted != Wanted::Off {
            let Some(handle) = &self.options.policies else { return Err(NO_POLICIES.to_owned()) };
            why_not(self.live_status().as_ref(), handle).map_or(Ok(()), Err)?;
            if let Some(problem) = self.options.health.why_not_arm() {
                return Err(format!("it would not be recorded: {problem}"));
            }
        }
        let rules = match wanted {
            Wanted::On { seed } => Some(ExplorationRules { seed, ..self.options.exploration }),
            Wanted::Off => None,
        };
        self.ask_tick(Request::Explore(rules), asked.since)
    }

    /// Outcome of switching exploration once that is over; `None` while it may still go either way.
    fn exploring(&self, Switching { ticket, wanted }: Switching, asked: Asked) -> Option<Result<String, String>> {
        let late = asked.is_late();
        let fate = self.options.mailbox.fate(ticket);
        let shown = self.newest.filter(|shown| shown.at_ns > asked.at_ns);
        let outcome = shown.and_then(|shown| outcome(wanted, &shown.status));
        match (fate, outcome) {
            (Fate::Taken, Some(outcome)) => Some(outcome),
            (Fate::Waiting | Fate::Taken, _) if !late => None,
            (Fate::Waiting, _) if self.options.mailbox.withdraw(ticket) => {
                Some(Err(format!("no tick took it in time, so it was withdrawn; {}", self.no_session())))
            }
            (Fate::Fell, _) => Some(Err(self.why_fell(asked))),
            (Fate::Withdrawn, _) => Some(Err(WITHDRAWN.to_owned())),
            (Fate::Waiting | Fate::Taken, _) => {
                Some(Err("no policy has all of the command at this moment; `controller policies` tells why".to_owned()))
            }
        }
    }
}

/// Reason why exploration cannot begin now, one line; `None` where it can. The tick has the last word.
fn why_not(status: Option<&Status>, policies: &PolicyHandle) -> Option<String> {
    let Some(status) = status else { return Some("no session with the cRIO".to_owned()) };
    if status.state != State::Run {
        let name = status.state.as_str();
        return Some(format!("it is {name}; exploration needs the rig under control (`controller arm`)"));
    }
    if policies.policies.active().0 == FALLBACK {
        return Some("the fallback controls, which has no distribution to explore; swap to a policy first".to_owned());
    }
    let on_its_way = policies.policies.snapshot().candidate.is_some();
    on_its_way.then(|| {
        "a policy is on its way, and is held against what the active one does by itself; wait for its end (`controller policies`)".to_owned()
    })
}

/// The outcome, once the tick has taken it and shown the tick after: what is told, or why not. What was shown before it was
/// taken tells of the noise before.
fn outcome(wanted: Wanted, status: &Status) -> Option<Result<String, String>> {
    match (wanted, &status.exploration) {
        (Wanted::Off, None) => Some(Ok("exploration is off".to_owned())),
        (Wanted::On { seed }, Some(shown)) if shown.seed == seed => Some(Ok(told(shown))),
        (Wanted::On { .. }, _) | (Wanted::Off, Some(_)) => None,
    }
}

fn told(shown: &ExplorationShown) -> String {
    let ExplorationShown { seed, std_duty, std_from, most_duty } = shown;
    let origin = match std_from {
        StdOrigin::Policy => "as the policy states",
        StdOrigin::Configuration => "by policy.exploration_std, for the policy states none",
    };
    format!(
        "exploring: noise of {:.4}/{:.4} of duty (standard deviation, {origin}), at most {:.4}/{:.4}, seed {seed}; it ends with any fault, disarming, and another policy or model",
        std_duty[0], std_duty[1], most_duty[0], most_duty[1]
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_names_the_seed_that_was_asked_for_and_waits_for_it() {
        let shown = |seed| {
            let shown = ExplorationShown {
                seed,
                std_duty: [0.01; 2],
                std_from: StdOrigin::Configuration,
                most_duty: [0.02; 2],
            };
            Status { exploration: Some(shown), ..Status::default() }
        };
        let on = Wanted::On { seed: 6 };
        assert_eq!(outcome(on, &shown(5)), None, "the noise before is still on");
        assert!(outcome(on, &shown(6)).is_some_and(|told| told.is_ok_and(|line| line.contains("seed 6;"))));
        assert_eq!((outcome(on, &Status::default()), outcome(Wanted::Off, &shown(5))), (None, None));
        assert!(outcome(Wanted::Off, &Status::default()).is_some());
    }
}
