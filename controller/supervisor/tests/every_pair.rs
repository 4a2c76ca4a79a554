//! Every state with every condition, against a table written by hand, and what must never happen over random courses.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use supervisor::condition::Latch;
use supervisor::transition::{GOOD_TICKS_AFTER_HOLD, GOOD_TICKS_AFTER_REVERT, RETURN_PERIOD_TICKS, RETURNS_PER_PERIOD};
use supervisor::{
    Acknowledgement, Actuation, Arming, Condition, ConditionSet, ControlledBy, FRAMES_TO_ARM, Inputs, Integration,
    Memory, Request, Severity, State, Tick, Transition, next,
};

const TICKS: [Tick; 5] = [Tick::Frame, Tick::Missing, Tick::SessionOpened, Tick::LinkGone, Tick::Waiting];
const REQUESTS: [Option<Request>; 6] = [
    None,
    Some(Request::Play),
    Some(Request::Arm),
    Some(Request::Acknowledge),
    Some(Request::Disarm),
    Some(Request::Stop),
];
const ARMINGS: [Arming; 2] = [Arming::Manual, Arming::Automatic];

fn set(conditions: &[Condition]) -> ConditionSet {
    let mut set = ConditionSet::EMPTY;
    for condition in conditions {
        set.insert(*condition, 1.0);
    }
    set
}

/// A memory in which the next sound frame would arm, return or recover.
fn ripe(state: State) -> Memory {
    Memory {
        state,
        sound_frames: FRAMES_TO_ARM,
        good_ticks: 1_000,
        reverted: (state == State::Revert).then_some(Condition::TrackingPositive),
        cause: state.is_vented().then_some(Condition::FramesMissing),
        ..Memory::START
    }
}

fn step(
    memory: &Memory,
    tick: Tick,
    conditions: &ConditionSet,
    request: Option<Request>,
) -> (Memory, supervisor::Action) {
    next(memory, &Inputs { tick, conditions, request, arming: Arming::Manual })
}

/// The state after a frame in which one condition holds; written from the page, not from the code.
fn expected(state: State, severity: Severity) -> State {
    use Severity::{BarsArming, Fault, Hold, Revert, Vent, Warning};
    match (state, severity) {
        (State::Init | State::Connect | State::Stop, Warning | BarsArming | Hold | Revert) => state,
        (State::Stop, _) => State::Stop,
        (_, Fault) | (State::Fault, Vent) => State::Fault,
        (_, Vent) => State::Vent,
        (State::Run | State::Hold | State::Revert, Revert) => State::Revert,
        (State::Run | State::Hold | State::Revert, Hold) => State::Hold,
        // Nothing that counts while controlling: the ripe memory goes on to RUN.
        (State::Run | State::Hold | State::Revert, Warning | BarsArming) => State::Run,
        // Ripe: VENT is left, and FAULT goes by way of VENT, for nothing waits for a person.
        (State::Vent, _) => State::Standby,
        (State::Fault, _) => State::Vent,
        (State::Standby, _) => State::Standby,
    }
}

#[test]
fn every_state_with_every_condition() {
    for state in State::ALL {
        for condition in Condition::ALL {
            let (after, action) = step(&ripe(state), Tick::Frame, &set(&[*condition]), None);
            let context = format!("{state:?} with {condition:?}");
            assert_eq!(after.state, expected(state, condition.severity()), "{context}");
            assert_eq!(action.actuation == Actuation::Vent, !after.state.is_controlling(), "{context}");
            let latches = condition.latch() == Latch::UntilAcknowledged;
            assert_eq!(after.latched.contains(*condition), latches, "{context}");
            assert_eq!(action.integration == Integration::Off, after.state == State::Hold, "{context}");
            let held_in_revert = state == State::Revert && after.state == State::Hold;
            let fallback = after.state == State::Revert || held_in_revert;
            assert_eq!(action.controlled_by == ControlledBy::Fallback, fallback, "{context}");
            if condition.severity() >= Severity::Vent && state != State::Stop {
                assert_eq!(after.cause, Some(*condition), "the worse reason replaces: {context}");
            }
        }
    }
}

#[test]
fn of_every_pair_of_conditions_the_worse_decides_and_is_told_also_while_vented() {
    for first in Condition::ALL {
        for second in Condition::ALL {
            let worse = if first.rank() >= second.rank() { *first } else { *second };
            let (together, together_action) = step(&ripe(State::Run), Tick::Frame, &set(&[*first, *second]), None);
            let (alone, _) = step(&ripe(State::Run), Tick::Frame, &set(&[worse]), None);
            assert_eq!(together.state, alone.state, "{first:?} and {second:?}");
            let in_doubt = [first, second].iter().any(|c| c.severity() == Severity::Hold);
            let still = together_action.integration == Integration::Off;
            assert_eq!(still, in_doubt && together.state.is_controlling(), "{first:?} and {second:?}");
            if first.severity() < Severity::Vent || second.severity() < Severity::Vent {
                continue;
            }
            // One after the other, the second while the first has vented.
            let (vented, _) = step(&ripe(State::Run), Tick::Frame, &set(&[*first]), None);
            let (after, action) = step(&vented, Tick::Frame, &set(&[*second]), None);
            assert_eq!(after.cause, Some(worse), "{first:?} then {second:?}");
            let told = matches!(action.transition, Transition::Vented(c) | Transition::Faulted(c) if c == *second);
            assert_eq!(told, second.rank() > first.rank(), "{first:?} then {second:?}");
            for condition in [first, second] {
                let latches = condition.latch() == Latch::UntilAcknowledged;
                assert_eq!(after.latched.contains(*condition), latches, "{first:?} then {second:?}");
            }
        }
    }
}

/// Whatever comes: vents, arming, latches, trips.
fn check(before: &Memory, inputs: &Inputs<'_>) -> Memory {
    let (after, action) = next(before, inputs);
    let context = || format!("{before:?}\n{inputs:?}\n{after:?}\n{action:?}");
    let in_session = matches!(inputs.tick, Tick::Frame | Tick::Missing);
    if inputs.conditions.worst(Severity::Vent).is_some() || !in_session {
        assert!(!after.state.is_controlling() && action.actuation == Actuation::Vent, "{}", context());
    }
    if after.state.is_controlling() && !before.state.is_controlling() {
        let asked = matches!(inputs.request, Some(Request::Arm | Request::Play));
        let by_itself = inputs.arming == Arming::Automatic && before.may_arm_itself && inputs.request.is_none();
        assert!(before.state == State::Standby && inputs.tick == Tick::Frame && (asked || by_itself), "{}", context());
        assert!(before.latched.is_empty() && after.latched.is_empty(), "{}", context());
        assert!(!inputs.conditions.iter().any(|c| c.severity() == Severity::BarsArming), "{}", context());
    }
    // Leave to arm by itself is given by arming for the reference alone.
    if after.may_arm_itself && !before.may_arm_itself {
        let armed = matches!(action.transition, Transition::Armed(Arming::Manual));
        assert!(armed && inputs.request == Some(Request::Arm), "{}", context());
    }
    for condition in before.latched.iter() {
        let kept = after.latched.contains(condition);
        assert!(kept || inputs.request == Some(Request::Acknowledge), "{condition:?} lost: {}", context());
        // What still holds cannot be acknowledged away; a trip of the cRIO can, for that is what lets a HELLO end it.
        assert!(kept || !inputs.conditions.contains(condition) || condition.bars_session(), "{}", context());
    }
    if before.latched.iter().any(Condition::bars_session) && inputs.request != Some(Request::Acknowledge) {
        assert!(!after.may_open_session() && !action.renew_session, "{}", context());
    }
    if before.state == State::Stop {
        assert_eq!(after.state, State::Stop);
    }
    if inputs.request == Some(Request::Disarm) {
        assert!(!after.state.is_controlling() && !after.may_arm_itself, "{}", context());
    }
    after
}

/// One step from this memory by every tick, request and arming, with nothing and with each condition.
fn in_every_way(before: &Memory) {
    for tick in TICKS {
        for request in REQUESTS {
            for arming in ARMINGS {
                check(before, &Inputs { tick, conditions: &ConditionSet::EMPTY, request, arming });
                for condition in Condition::ALL {
                    check(before, &Inputs { tick, conditions: &set(&[*condition]), request, arming });
                }
            }
        }
    }
}

#[test]
fn what_must_never_happen_does_not_in_any_single_step() {
    for state in State::ALL {
        for latched in
            [None, Some(Condition::OverPressure), Some(Condition::CrioTripped), Some(Condition::VentIneffective)]
        {
            for sound_frames in [0, FRAMES_TO_ARM] {
                for may_arm_itself in [false, true] {
                    // What is latched has taken the leave to arm by itself.
                    if may_arm_itself && latched.is_some() {
                        continue;
                    }
                    let mut before = Memory { sound_frames, may_arm_itself, ..ripe(state) };
                    if let Some(condition) = latched {
                        before.latched.insert(condition, 1.0);
                    }
                    in_every_way(&before);
                }
            }
        }
    }
}

#[test]
fn what_must_never_happen_does_not_over_a_million_random_ticks() {
    // Xorshift: the same course every time.
    let mut word = 0x9E37_79B9_7F4A_7C15u64;
    let mut dice = |sides: usize| {
        word ^= word << 13;
        word ^= word >> 7;
        word ^= word << 17;
        (word >> 20) as usize % sides
    };
    let mut memory = Memory::START;
    let (mut armed, mut faulted) = (0, 0);
    for _ in 0..1_000_000 {
        let tick = match dice(400) {
            0 => Tick::LinkGone,
            1 => Tick::Waiting,
            2..=4 => Tick::SessionOpened,
            5..=20 => Tick::Missing,
            _ => Tick::Frame,
        };
        let mut conditions = ConditionSet::EMPTY;
        while dice(40) == 0 {
            conditions.insert(Condition::ALL[dice(Condition::ALL.len())], 1.0);
        }
        let request = if dice(30) == 0 { REQUESTS[dice(5)] } else { None };
        let inputs = Inputs { tick, conditions: &conditions, request, arming: ARMINGS[dice(2)] };
        let before = memory.state;
        memory = check(&memory, &inputs);
        armed += u32::from(memory.state.is_controlling() && !before.is_controlling());
        faulted += u32::from(memory.state == State::Fault && before != State::Fault);
    }
    assert!(armed > 300 && faulted > 300, "the course must go everywhere: {armed} {faulted}");
}

#[test]
fn arms_when_asked_and_ripe_and_never_late() {
    let mut memory = next(
        &Memory::START,
        &Inputs { tick: Tick::SessionOpened, conditions: &ConditionSet::EMPTY, request: None, arming: Arming::Manual },
    )
    .0;
    let (asked_early, _) = step(&memory, Tick::Frame, &ConditionSet::EMPTY, Some(Request::Arm));
    memory = asked_early;
    for _ in 0..1_000 {
        memory = step(&memory, Tick::Frame, &ConditionSet::EMPTY, None).0;
    }
    assert_eq!(memory.state, State::Standby, "an order that came too early is forgotten");
    let (after, action) = step(&memory, Tick::Frame, &ConditionSet::EMPTY, Some(Request::Arm));
    assert_eq!((after.state, action.transition), (State::Run, Transition::Armed(Arming::Manual)));
    // A missing frame in STANDBY does not begin the count anew; a missing one arms nothing.
    let (missed, _) = step(&memory, Tick::Missing, &set(&[Condition::FrameMissing]), Some(Request::Arm));
    assert_eq!((missed.state, missed.sound_frames), (State::Standby, memory.sound_frames));
}

/// "Sound again, ready to be armed" and "acknowledged, arm when you are ready" hold in the tick that they are said for.
#[test]
fn what_has_recovered_is_armed_in_the_next_tick() {
    let mut waiting = ripe(State::Vent);
    waiting.latched.insert(Condition::CrioTripped, 1.0);
    for (before, request) in [(ripe(State::Vent), None), (waiting, Some(Request::Acknowledge))] {
        let (recovered, action) = step(&before, Tick::Frame, &ConditionSet::EMPTY, request);
        assert_eq!((recovered.state, action.transition), (State::Standby, Transition::Recovered));
        assert!(recovered.can_arm(&ConditionSet::EMPTY), "{request:?}");
        let (armed, _) = step(&recovered, Tick::Frame, &ConditionSet::EMPTY, Some(Request::Arm));
        assert_eq!(armed.state, State::Run, "{request:?}");
    }
}

/// By itself the rig is armed half a second later, so that a cause that comes and goes does not switch pump and valves each time.
#[test]
fn what_has_recovered_arms_itself_half_a_second_later() {
    let automatic = |memory: &Memory| {
        let conditions = &ConditionSet::EMPTY;
        next(memory, &Inputs { tick: Tick::Frame, conditions, request: None, arming: Arming::Automatic })
    };
    let (mut memory, action) = automatic(&ripe(State::Vent));
    assert_eq!(action.transition, Transition::Recovered);
    let mut frames = 0;
    while memory.state == State::Standby {
        memory = automatic(&memory).0;
        frames += 1;
    }
    assert_eq!((memory.state, frames), (State::Run, FRAMES_TO_ARM));
}

#[test]
fn what_bars_arming_does_so_whatever_else_is_wrong() {
    for bar in Condition::ALL.iter().filter(|c| c.severity() == Severity::BarsArming) {
        for other in Condition::ALL {
            let conditions = set(&[*bar, *other]);
            for (request, arming) in [(Some(Request::Arm), Arming::Manual), (None, Arming::Automatic)] {
                let inputs = Inputs { tick: Tick::Frame, conditions: &conditions, request, arming };
                let (after, _) = next(&ripe(State::Standby), &inputs);
                assert!(!after.state.is_controlling(), "{bar:?} with {other:?}");
            }
        }
    }
}

#[test]
fn auto_arm_acts_again_after_link_causes_only() {
    for condition in Condition::ALL.iter().filter(|c| c.severity() >= Severity::Vent) {
        let run = ripe(State::Run);
        let automatic = |memory: &Memory, conditions: &ConditionSet, request| {
            next(memory, &Inputs { tick: Tick::Frame, conditions, request, arming: Arming::Automatic })
        };
        let mut memory = automatic(&run, &set(&[*condition]), None).0;
        for _ in 0..500 {
            memory = automatic(&memory, &ConditionSet::EMPTY, None).0;
        }
        let clears = condition.latch() == Latch::ClearsItself;
        assert_eq!(memory.state.is_controlling(), clears, "{condition:?}");
        if clears {
            continue;
        }
        let (acknowledged, action) = automatic(&memory, &ConditionSet::EMPTY, Some(Request::Acknowledge));
        assert_eq!(action.acknowledgement, Acknowledgement::Cleared, "{condition:?}");
        memory = acknowledged;
        for _ in 0..500 {
            memory = automatic(&memory, &ConditionSet::EMPTY, None).0;
        }
        assert_eq!(memory.state, State::Standby, "acknowledged, and still a person arms: {condition:?}");
        assert!(automatic(&memory, &ConditionSet::EMPTY, Some(Request::Arm)).0.state == State::Run, "{condition:?}");
    }
}

#[test]
fn an_experiment_that_a_lost_link_breaks_off_is_not_followed_by_auto_arm() {
    let go_on = |memory: &Memory, tick, conditions: &ConditionSet, request| {
        next(memory, &Inputs { tick, conditions, request, arming: Arming::Automatic }).0
    };
    for (asked, armed_again) in [(Request::Play, false), (Request::Arm, true)] {
        // An experiment begins by a disarming; the rows alone, too, leave arming to a person.
        let disarmed = go_on(&ripe(State::Run), Tick::Frame, &ConditionSet::EMPTY, Some(Request::Disarm));
        for begun in [disarmed, ripe(State::Standby)] {
            let mut memory = go_on(&begun, Tick::Frame, &ConditionSet::EMPTY, Some(asked));
            assert_eq!(memory.state, State::Run, "{asked:?}");
            memory = go_on(&memory, Tick::LinkGone, &set(&[Condition::LinkLost]), None);
            memory = go_on(&memory, Tick::SessionOpened, &ConditionSet::EMPTY, None);
            for _ in 0..10 * FRAMES_TO_ARM {
                memory = go_on(&memory, Tick::Frame, &ConditionSet::EMPTY, None);
            }
            assert_eq!(memory.state.is_controlling(), armed_again, "{asked:?}");
        }
    }
}

#[test]
fn an_operators_stop_outlives_the_link_and_a_lost_command_does_not_wait() {
    let stopped = set(&[Condition::CrioTripped]);
    let (memory, action) = step(&ripe(State::Run), Tick::Frame, &stopped, None);
    assert!(!action.renew_session);
    let (memory, _) = step(&memory, Tick::LinkGone, &set(&[Condition::LinkLost]), None);
    assert!(!memory.may_open_session(), "a HELLO would undo the stop");
    assert_eq!((memory.state, memory.cause), (State::Connect, Some(Condition::CrioTripped)));
    let (memory, _) = step(&memory, Tick::Waiting, &ConditionSet::EMPTY, Some(Request::Acknowledge));
    assert!(memory.may_open_session());
    // With the link there the acknowledgement is what sends the HELLO.
    let (tripped, _) = step(&ripe(State::Run), Tick::Frame, &stopped, None);
    let (_, action) = step(&tripped, Tick::Frame, &stopped, Some(Request::Acknowledge));
    assert!(action.renew_session && action.acknowledgement == Acknowledgement::Cleared);
    let (_, action) = step(&ripe(State::Run), Tick::Frame, &set(&[Condition::CommandsLost]), None);
    assert!(action.renew_session);
    // Lost commands beside an operator's stop wait as well.
    let both = set(&[Condition::CommandsLost, Condition::CrioTripped]);
    assert!(!step(&ripe(State::Run), Tick::Frame, &both, None).1.renew_session);
}

#[test]
fn what_still_holds_cannot_be_acknowledged() {
    let broken = set(&[Condition::SensorPositive]);
    let (memory, _) = step(&ripe(State::Run), Tick::Frame, &broken, None);
    let (memory, action) = step(&memory, Tick::Frame, &broken, Some(Request::Acknowledge));
    assert_eq!(action.acknowledgement, Acknowledgement::StillHolds(Condition::SensorPositive));
    assert!(memory.latched.contains(Condition::SensorPositive));
}

#[test]
fn hold_and_revert_come_back_and_a_policy_that_refused_does_not() {
    let mut memory = step(&ripe(State::Run), Tick::Missing, &set(&[Condition::FrameMissing]), None).0;
    for tick in 0..GOOD_TICKS_AFTER_HOLD {
        assert_eq!(memory.state, State::Hold, "after {tick} good ticks");
        memory = step(&memory, Tick::Frame, &ConditionSet::EMPTY, None).0;
    }
    assert_eq!(memory.state, State::Run);
    let mut returned = 0;
    for round in 0..=RETURNS_PER_PERIOD {
        memory = step(&memory, Tick::Frame, &set(&[Condition::TrackingPositive]), None).0;
        assert_eq!(memory.state, State::Revert);
        // HOLD within REVERT goes back to REVERT.
        memory = step(&memory, Tick::Missing, &set(&[Condition::FrameMissing]), None).0;
        for _ in 0..GOOD_TICKS_AFTER_HOLD {
            memory = step(&memory, Tick::Frame, &ConditionSet::EMPTY, None).0;
        }
        assert_eq!(memory.state, State::Revert, "round {round}");
        for _ in 0..GOOD_TICKS_AFTER_REVERT {
            let (after, action) = step(&memory, Tick::Frame, &ConditionSet::EMPTY, None);
            returned += u8::from(action.transition == Transition::Returned);
            memory = after;
        }
    }
    assert_eq!((returned, memory.state), (RETURNS_PER_PERIOD, State::Revert), "the fourth time it stays");
    for _ in 0..RETURN_PERIOD_TICKS {
        memory = step(&memory, Tick::Frame, &ConditionSet::EMPTY, None).0;
    }
    assert_eq!(memory.state, State::Run, "and ten minutes later it may again");
    memory = step(&memory, Tick::Frame, &set(&[Condition::PolicyRefused]), None).0;
    for _ in 0..2 * RETURN_PERIOD_TICKS {
        memory = step(&memory, Tick::Frame, &ConditionSet::EMPTY, None).0;
    }
    assert_eq!(memory.state, State::Revert);
}
