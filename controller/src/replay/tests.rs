//! Tests of the replay: which inputs came when, and what it keeps and says.

use model::rig::Rig;
use proto::wire::{CrioState, TripBits};
use supervisor::Arming;

use super::*;
use crate::config::Safety;
use crate::cycle::tests::{cycle as armed_by_itself, sense};

#[test]
fn what_was_asked_for_without_a_session_is_told_from_the_rest() {
    use TickInput::{Acknowledge, Arm, Disarm, LinkLost, SessionOpened};
    let between = |all: &[TickInput]| {
        let mut inputs = 0;
        all.iter().for_each(|input| input.append(&mut inputs));
        (0..all.len()).map(|at| is_between_sessions(inputs, at)).collect::<Vec<bool>>()
    };
    assert_eq!(between(&[Arm]), [false]);
    // A trip ends a session behind its tick; a lost link is told.
    assert_eq!(between(&[Acknowledge, SessionOpened, Arm]), [true, false, false]);
    assert_eq!(between(&[Disarm, LinkLost, Disarm, SessionOpened]), [false, false, true, false]);
    // Two sessions in which no tick came.
    let twice = [LinkLost, Acknowledge, SessionOpened, Arm, LinkLost, Disarm, SessionOpened];
    assert_eq!(between(&twice), [false, true, false, false, false, true, false]);
}

/// The tick's queue forgets what is older than 160 s, and a model of a later recording may have run along with older ticks.
#[test]
fn ticks_are_kept_for_models_that_no_recording_has_told_of_yet() {
    let rig = Rig::builtin("dual_pressure").unwrap();
    let reference = Reference::constant(85.0, -72.0);
    let mut cycle = Cycle::new(&rig, None, reference, Safety::default(), Arming::Automatic).unwrap();
    cycle.session_opened();
    let mut replay = Replay { cycle: Some(cycle), ..Replay::new(Vec::new()) };
    for tick in 0..30_u32 {
        // A reading that stands still to the bit would be a frozen sensor's.
        let at_rest = 1.002 + 0.0002 * (tick * 7_919 % 11) as f32;
        let sense = Sense {
            sequence: tick + 1,
            clock_ns: 1 + u64::from(tick) * 20_000_000,
            session: 1,
            tick,
            command_in_force: tick,
            volts: [at_rest, at_rest, f32::NAN, f32::NAN],
            duty: [1.0; 2],
            state: CrioState::Running,
            pump_running: true,
            trips: TripBits::NONE,
            commands_missed: 0,
        };
        let recorded =
            TickRecord { session: 1, tick, sense_present: true, sense: sense.encode(), ..Default::default() };
        replay.tick(&recorded);
    }
    let cycle = replay.cycle.as_ref().unwrap();
    assert!(cycle.duty_source().tracking().models().samples_taken() > 0, "it is armed after half a second");
}

#[test]
fn more_requests_than_a_record_holds_are_told_as_such() {
    let rig = Rig::builtin("dual_pressure").unwrap();
    let reference = Reference::constant(85.0, -72.0);
    let cycle = Cycle::new(&rig, None, reference, Safety::default(), Arming::Manual).unwrap();
    let mut replay = Replay { cycle: Some(cycle), ..Replay::new(Vec::new()) };
    let mut recorded = TickRecord { session: 1, ..Default::default() };
    for _ in 0..5 {
        TickInput::Disarm.append(&mut recorded.inputs);
        TickInput::Acknowledge.append(&mut recorded.inputs);
    }
    replay.tick(&recorded);
    let ended = replay.found().ended.unwrap();
    assert!(ended.starts_with("there were too many requests before this tick to record"), "{ended}");
}

/// The frame that was over the limit is in no record: it queued, and the next one was answered. Its number is missing.
#[test]
fn what_an_overtaken_frame_decided_is_replayed_and_only_where_one_can_have_been() {
    let frame = |tick: u32, volts: f32| Sense {
        pump_running: false,
        ..sense(tick, [volts, 1.002], CrioState::Idle, TripBits::NONE)
    };
    let mut cycle = armed_by_itself();
    let mut records = Vec::new();
    for tick in [0, 1, 2, 4, 5] {
        if tick == 4 {
            // 162 kPa, beyond the limit of 160.
            cycle.overtaken(&frame(3, 1.65));
        }
        let sense = frame(tick, 1.002 + 0.0002 * tick as f32);
        let mut record = TickRecord { session: 1, sense_present: true, sense: sense.encode(), ..TickRecord::default() };
        cycle.observe(&sense, &mut record, &mut |_| ());
        cycle.predict(&mut record);
        cycle.decide(&mut record, &mut |_| ());
        cycle.settle();
        records.push(record);
    }
    let over = 1 << Condition::OverPressure.code();
    assert_eq!(
        records.iter().map(|record| record.findings & over != 0).collect::<Vec<_>>(),
        [false, false, false, true, false]
    );
    let replayed = |records: &[TickRecord]| {
        let mut replay = Replay { cycle: Some(armed_by_itself()), ..Replay::new(Vec::new()) };
        records.iter().for_each(|record| replay.tick(record));
        replay.found()
    };
    let found = replayed(&records);
    assert_eq!((found.ticks, found.differing), (5, 0), "{:?}", found.first);
    // A finding that no frame explains, where none is missing, is what a replay is there to find.
    records.truncate(3);
    records[2].findings |= over;
    assert_eq!(replayed(&records).differing, 1);
}
