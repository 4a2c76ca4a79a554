//! Words for what an experiment waits for before its first row.

use supervisor::{Condition, State};

use crate::operator::latched_conditions::LatchedConditions;

/// Reason why an experiment does not begin yet.
#[derive(Debug, Clone, Copy, Default)]
pub struct Obstacles {
    /// Cause of the state.
    pub fault: Option<Condition>,
    /// Conditions that a person must acknowledge.
    pub waiting: LatchedConditions,
    /// The condition for which nothing would be armed at rest.
    pub bars_arming: Option<Condition>,
}

/// One clause on what an experiment waits for: a session, a person, the end of a venting, rest; and what would keep it from being
/// armed then.
pub fn waits_for(state: State, obstacles: Obstacles) -> String {
    let Obstacles { fault, waiting, bars_arming } = obstacles;
    let acknowledged = (!waiting.is_empty()).then(|| format!("`controller acknowledge` ({})", waiting.names()));
    let first = match (state, acknowledged, fault) {
        (State::Init | State::Connect, Some(person), _) => {
            format!("waiting for a session with the cRIO and for {person}")
        }
        (State::Init | State::Connect, None, _) => "waiting for a session with the cRIO".to_owned(),
        (State::Vent | State::Fault, Some(person), _) => format!("waiting for {person}"),
        (State::Vent | State::Fault, None, Some(condition)) => {
            format!("waiting for standby, vented now ({})", condition.name())
        }
        _ => "waiting for rest, both pressures still, vents open".to_owned(),
    };
    match bars_arming {
        Some(condition) => format!("{first}; at rest it would not be armed ({})", condition.name()),
        None => first,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rest_state_and_bar_are_named() {
        let none = Obstacles::default();
        let rest = waits_for(State::Standby, none);
        assert!(rest.contains("for rest") && !rest.contains("armed"), "{rest}");
        let barred = waits_for(State::Standby, Obstacles { bars_arming: Some(Condition::NotRecorded), ..none });
        assert!(barred.starts_with(&rest) && barred.contains("not be armed (not recorded)"), "{barred}");
        let vented = waits_for(State::Vent, Obstacles { fault: Some(Condition::FramesMissing), ..none });
        assert!(vented.contains("for standby") && vented.contains("frames missing"), "{vented}");
        assert!(waits_for(State::Connect, Obstacles { fault: Some(Condition::LinkLost), ..none }).contains("session"));
    }

    #[test]
    fn what_waits_for_a_person_says_so() {
        let tripped = Some(Condition::CrioTripped);
        let waiting = LatchedConditions::of([Condition::CrioTripped, Condition::SensorNegative]);
        for state in [State::Vent, State::Fault, State::Connect] {
            let told = waits_for(state, Obstacles { fault: tripped, waiting, bars_arming: None });
            assert!(
                told.contains("for `controller acknowledge` (cRIO tripped, negative sensor broken)"),
                "{state:?}: {told}"
            );
        }
    }
}
