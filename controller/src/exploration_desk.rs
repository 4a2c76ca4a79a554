//! Exploration as operators ask for it: whether it may begin, and what they are told.

use handover::{ExplorationRules, ExplorationShown, StdOrigin};

use crate::clock::now_ns;
use crate::config::FALLBACK;
use crate::mailbox::Status;
use crate::operator_protocol::Switch;
use crate::policy_service::PolicyHandle;
use crate::state::State;

/// Why exploration cannot begin now, one line; `None` where it can. The tick has the last word.
pub fn why_not(status: Option<&Status>, policies: &PolicyHandle) -> Option<String> {
    let Some(status) = status else { return Some("no session with the cRIO".to_owned()) };
    if status.state != State::Run {
        let name = status.state.as_str();
        return Some(format!("it is {name}; exploration needs the rig under control (`controller arm`)"));
    }
    if policies.policies.active().0 == FALLBACK {
        return Some("the fallback controls, which has no distribution to explore; swap to a policy first".to_owned());
    }
    let (_, snapshot) = policies.policies.list();
    let on_its_way = snapshot.candidate.is_some();
    on_its_way.then(|| {
        "a policy is on its way, and is held against what the active one does by itself; wait for its end (`controller policies`)".to_owned()
    })
}

/// What the tick is asked for.
pub fn rules(switch: Switch, seed: Option<u32>, configured: ExplorationRules) -> Option<ExplorationRules> {
    match switch {
        // The clock's lowest bits: which ones they are is in the event and in every answer.
        Switch::On => Some(ExplorationRules { seed: seed.unwrap_or(now_ns() as u32), ..configured }),
        Switch::Off => None,
    }
}

/// What came of it, once the tick has taken it and shown the tick after: what is told, or why not.
pub fn outcome(switch: Switch, status: &Status) -> Option<Result<String, String>> {
    match (switch, &status.exploration) {
        (Switch::Off, None) => Some(Ok("exploration is off".to_owned())),
        (Switch::On, Some(shown)) => Some(Ok(told(shown))),
        (Switch::On, None) | (Switch::Off, Some(_)) => None,
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
