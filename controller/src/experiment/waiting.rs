//! Words for what an experiment waits for before its first row.

use supervisor::{Condition, Severity, State};

/// What an experiment waits for, in one clause: a session, the end of a venting, rest; and what would keep it from being armed then.
pub fn waits_for(state: State, fault: Option<Condition>, bars_arming: Option<Condition>) -> String {
    let first = match (state, fault) {
        (State::Init | State::Connect, _) => "waiting for a session with the cRIO".to_owned(),
        (State::Vent | State::Fault, Some(condition)) => {
            format!("waiting for standby, vented now ({})", condition.name())
        }
        _ => "waiting for rest, both pressures still, vents open".to_owned(),
    };
    match bars_arming {
        Some(condition) => format!("{first}; at rest it would not be armed ({})", condition.name()),
        None => first,
    }
}

/// The worst that bars arming among the findings of a recorded tick.
pub fn bar_among(findings: u64) -> Option<Condition> {
    let holds =
        |condition: &&Condition| condition.severity() == Severity::BarsArming && findings & 1 << condition.code() != 0;
    Condition::ALL.iter().rev().find(holds).copied()
}

#[cfg(test)]
mod tests {
    use super::*;
    use supervisor::ConditionSet;

    #[test]
    fn rest_state_and_bar_are_named() {
        let rest = waits_for(State::Standby, None, None);
        assert!(rest.contains("for rest") && !rest.contains("armed"), "{rest}");
        let barred = waits_for(State::Standby, None, Some(Condition::NotRecorded));
        assert!(barred.starts_with(&rest) && barred.contains("not be armed (not recorded)"), "{barred}");
        let vented = waits_for(State::Vent, Some(Condition::FramesMissing), None);
        assert!(vented.contains("for standby") && vented.contains("frames missing"), "{vented}");
        assert!(waits_for(State::Connect, Some(Condition::LinkLost), None).contains("session"));
    }

    #[test]
    fn the_bar_is_found_among_all_that_was_found() {
        let mut found = ConditionSet::EMPTY;
        found.insert(Condition::FramesScarce, 12.0);
        found.insert(Condition::PumpOff, 0.0);
        assert_eq!(bar_among(found.code_bits()), None);
        found.insert(Condition::NotRealtime, 0.0);
        assert_eq!(bar_among(found.code_bits()), Some(Condition::NotRealtime));
    }
}
