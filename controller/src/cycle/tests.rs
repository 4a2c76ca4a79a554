//! Tests of the cycle: armed, run and vented by what frames say.

use model::rig::Rig;
use proto::reference::Reference;
use proto::wire::{CrioState, TripBits};

use super::*;

/// A frame of this tick, in step with the commands.
pub(crate) fn sense(tick: u32, volts: [f32; 2], state: CrioState, trips: TripBits) -> Sense {
    Sense {
        sequence: tick + 1,
        clock_ns: 1 + u64::from(tick) * 20_000_000,
        session: 1,
        tick,
        command_in_force: tick,
        volts: [volts[0], volts[1], f32::NAN, f32::NAN],
        duty: [1.0; 2],
        state,
        pump_running: true,
        trips,
        commands_missed: 0,
    }
}

/// Answers one frame; the notices it made.
pub(super) fn answer(cycle: &mut Cycle, frame: &Sense) -> (ActuatorCommand, Vec<Notice>) {
    let (mut record, mut told) = (TickRecord::default(), Vec::new());
    cycle.observe(frame, &mut record, &mut |notice| told.push(notice));
    cycle.predict(&mut record);
    let answer = cycle.decide(&mut record, &mut |notice| told.push(notice));
    cycle.settle();
    (answer, told)
}

/// A cycle that arms by itself, in a session.
pub(crate) fn cycle() -> Cycle {
    let rig = Rig::builtin("dual_pressure").unwrap();
    let mut cycle =
        Cycle::new(&rig, None, Reference::constant(85.0, -72.0), Safety::default(), Arming::Automatic).unwrap();
    cycle.session_opened();
    cycle
}

/// Both chambers at rest, as a vented rig is found.
pub(super) const SOUND: [f32; 2] = [1.002, 1.002];

#[test]
fn arms_runs_and_vents_in_the_tick_of_a_fault() {
    for (volts, state, trips, cause) in [
        ([0.0, 3.85], CrioState::Running, TripBits::NONE, Condition::SensorPositive),
        ([1.34, f32::NAN], CrioState::Running, TripBits::NONE, Condition::SensorNegative),
        ([1.65, 3.85], CrioState::Running, TripBits::NONE, Condition::OverPressure),
        ([1.34, 4.8], CrioState::Running, TripBits::NONE, Condition::OverVacuum),
        (SOUND, CrioState::Tripped, TripBits::OVER_PRESSURE, Condition::CrioTripped),
        (SOUND, CrioState::Tripped, TripBits::COMMAND_LOST, Condition::CommandsLost),
    ] {
        let mut cycle = cycle();
        for tick in 0..26 {
            let (answer, _) = answer(&mut cycle, &sense(tick, SOUND, CrioState::Running, TripBits::NONE));
            assert_eq!(answer.mode == Mode::Run, tick >= 24, "tick {tick}");
        }
        let (answer, told) = answer(&mut cycle, &sense(26, volts, state, trips));
        assert_eq!(answer, ActuatorCommand::VENT);
        assert!(matches!(told.as_slice(), [Notice::Vented { cause: c, tick: 26, .. }] if *c == cause), "{told:?}");
    }
}

#[test]
fn a_trip_of_the_crio_is_seen_whatever_vented_before() {
    let mut cycle = cycle();
    answer(&mut cycle, &sense(0, [0.0, 3.85], CrioState::Idle, TripBits::NONE));
    assert_eq!(cycle.state(), State::Vent);
    answer(&mut cycle, &sense(1, SOUND, CrioState::Tripped, TripBits::SENSOR));
    assert_eq!(cycle.memory().cause, Some(Condition::CrioTripped));
    assert!(!cycle.renew_session() && !cycle.may_open_session(), "a person looks first");
    cycle.session_opened();
    assert_eq!(cycle.state(), State::Vent, "and a new session changes nothing about that");
}

#[test]
fn one_missing_frame_follows_the_plan_and_the_second_vents() {
    let mut cycle = cycle();
    for tick in 0..26 {
        answer(&mut cycle, &sense(tick, SOUND, CrioState::Running, TripBits::NONE));
    }
    let (mut record, mut told) = (TickRecord::default(), Vec::new());
    let bridged = cycle.frame_missing(26.0, &mut record, &mut |notice| told.push(notice));
    assert_eq!((bridged.mode, record.tick), (Mode::Hold, 26));
    let vented = cycle.frame_missing(46.0, &mut record, &mut |notice| told.push(notice));
    assert_eq!((vented, record.tick), (ActuatorCommand::VENT, 27));
    assert!(matches!(
        told.as_slice(),
        [Notice::FrameMissed { .. }, Notice::Vented { cause: Condition::FramesMissing, .. }]
    ));
}

#[test]
fn a_stop_passes_through_the_state_function_from_whatever_state() {
    for ticks in [0, 10, 26] {
        let mut cycle = cycle();
        for tick in 0..ticks {
            answer(&mut cycle, &sense(tick, SOUND, CrioState::Running, TripBits::NONE));
        }
        assert_eq!(cycle.state() == State::Run, ticks == 26);
        let mut told = Vec::new();
        for _ in 0..2 {
            cycle.stop(&mut |notice| told.push(notice));
            assert_eq!((cycle.state(), cycle.answer), (State::Stop, ActuatorCommand::VENT));
        }
        assert!(matches!(told.as_slice(), [Notice::Stopped { .. }]), "once: {told:?}");
        // A frame that comes all the same moves nothing.
        let (answer, _) = answer(&mut cycle, &sense(ticks, SOUND, CrioState::Running, TripBits::NONE));
        assert_eq!((cycle.state(), answer), (State::Stop, ActuatorCommand::VENT));
    }
}
