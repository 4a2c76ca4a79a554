//! The tick allocates nothing: counted, not believed.
//!
//! An allocator that counts what this thread asks for stands in for the system's. The cycle is armed, then 500
//! ticks in state RUN, a missing frame among them, must leave the count as it is.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
// A `GlobalAlloc` cannot be written without unsafe code; this one hands everything on to the system's allocator.
#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::hint::black_box;

use controller::config::Safety;
use controller::cycle::Cycle;
use controller::cycle::duty_source::{ActuatorCommand, DutySource};
use controller::experiment::command_sequence::Row;
use controller::experiment::open_loop_playback::OpenLoopPlayback;
use controller::experiment::pump_relay::PumpRelay;
use controller::state::State;
use handover::{Candidate, Command, Haste};
use law::{AfterEnd, RepetitionLearning};
use model::observation::Pair;
use model::predict::{DualPressureRig, Predictor};
use model::rig::Rig;
use proto::recording::TickRecord;
use proto::reference::Reference;
use proto::wire::{CrioState, Mode, Sense, TripBits};
use supervisor::Arming;

thread_local! {
    // Made without allocation and never dropped, so the allocator itself may use it.
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

thread_local! {
    /// Duties that the cRIO says it applies: the last command's.
    static APPLIED: Cell<[f32; 2]> = const { Cell::new([1.0; 2]) };
}

/// Counts what goes through it, frees included: freeing takes the same locks.
struct Counting;

// SAFETY: every call goes to the system's allocator unchanged, which keeps the contract of `GlobalAlloc`.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's promises are those that `System` asks for.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        COUNT.with(|count| count.set(count.get() + 1));
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        // SAFETY: as above.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn counted(work: impl FnOnce()) -> u64 {
    let before = COUNT.with(Cell::get);
    work();
    COUNT.with(Cell::get) - before
}

/// A frame with these pressures (kPa gauge) as the data sheets' volts: 1–5 V for 0 … 1000 and 0 … −101 kPa.
fn sense(tick: u32, kpa: Pair) -> Sense {
    Sense {
        sequence: tick + 1,
        clock_ns: 1 + u64::from(tick) * 20_000_000,
        session: 1,
        tick,
        command_in_force: tick,
        volts: [(1.0 + 0.004 * kpa[0]) as f32, (1.0 - 4.0 / 101.0 * kpa[1]) as f32, f32::NAN, f32::NAN],
        duty: APPLIED.with(Cell::get),
        state: CrioState::Running,
        pump_running: true,
        trips: TripBits::NONE,
        commands_missed: 0,
    }
}

/// One whole tick, from readings to what is sent.
fn answer<H: DutySource>(cycle: &mut Cycle<H>, number: u32, kpa: Pair, notices: &mut u32) -> ActuatorCommand {
    let mut record = TickRecord::default();
    let mut tell = |_| *notices += 1;
    cycle.observe(&sense(number, kpa), &mut record, &mut tell);
    cycle.predict(&mut record);
    let answer = cycle.decide(&mut record, &mut tell);
    cycle.settle();
    APPLIED.with(|applied| applied.set(answer.duty.map(|u| u as f32)));
    black_box(record);
    answer
}

/// One whole tick. The plant is a lag toward pressures that fall with the duties: enough for the law to have work.
fn tick<H: DutySource>(cycle: &mut Cycle<H>, number: u32, kpa: &mut Pair, notices: &mut u32) -> Mode {
    let answer = answer(cycle, number, *kpa, notices);
    let settled =
        [150.6 - 161.5 * answer.duty[0] + 92.9 * answer.duty[1], -108.0 - 2.7 * answer.duty[0] + 48.5 * answer.duty[1]];
    for c in 0..2 {
        kpa[c] += 0.04 * (settled[c] - kpa[c]);
    }
    answer.mode
}

#[test]
fn five_hundred_ticks_in_run_allocate_nothing() {
    let rig = Rig::builtin("dual_pressure").unwrap();
    let mut cycle = Cycle::new(&rig, None, Reference::paper(), Safety::default(), Arming::Automatic).unwrap();
    cycle.session_opened();
    let (mut kpa, mut notices) = ([0.0, 0.0], 0);
    let mut number = 0;
    while cycle.state() != State::Run {
        tick(&mut cycle, number, &mut kpa, &mut notices);
        number += 1;
        assert!(number < 100, "armed by itself within 100 sound frames");
    }

    assert!(counted(|| drop(black_box(Box::new(1)))) >= 2, "the count does not count");
    let mut running = 0;
    let allocations = counted(|| {
        for k in number..number + 500 {
            running += u32::from(tick(&mut cycle, k, &mut kpa, &mut notices) != Mode::Vent);
            if k % 100 == 0 {
                let mut record = TickRecord::default();
                black_box(cycle.frame_missing(6.0, &mut record, &mut |_| notices += 1));
                cycle.settle();
            }
        }
    });
    assert_eq!((running, cycle.state()), (500, State::Run));
    assert_eq!(allocations, 0, "in 500 ticks");
    assert!(kpa[0] > 60.0 && kpa[1] < -50.0, "it flew: {kpa:?}");
    assert!(notices >= 5, "the missing frames were told");

    // Venting, too, must not allocate: it happens in the tick.
    let broken = counted(|| {
        let mut record = TickRecord::default();
        let mut tell = |_| notices += 1;
        cycle.observe(&sense(number + 600, [f64::NAN, -70.0]), &mut record, &mut tell);
        cycle.predict(&mut record);
        assert!(cycle.decide(&mut record, &mut tell).duty == [1.0, 1.0]);
        cycle.settle();
    });
    assert_eq!(broken, 0, "while venting");
    assert!(matches!(cycle.state(), State::Vent | State::Fault));
}

/// A reference that begins again every four seconds, and teaches: flights and the hand-over from one to the next.
#[test]
fn flights_that_teach_allocate_nothing() {
    let rig = Rig::builtin("dual_pressure").unwrap();
    let wave = "time_s,ref_pos_kpa,ref_neg_kpa\n0,85,-70\n1,87,-71\n3,83,-69\n4,85,-70\n";
    let reference = Reference::parse("wave", wave.as_bytes()).unwrap();
    let mut cycle = Cycle::new(&rig, None, reference, Safety::default(), Arming::Automatic).unwrap();
    cycle.duty_source_mut().tracking_mut().repeat(AfterEnd::Repeat, RepetitionLearning::On);
    cycle.session_opened();
    let (mut kpa, mut notices, mut number) = ([0.0, 0.0], 0, 0);
    while number < 2_500 {
        tick(&mut cycle, number, &mut kpa, &mut notices);
        number += 1;
    }
    let allocations = counted(|| {
        while number < 4_000 {
            tick(&mut cycle, number, &mut kpa, &mut notices);
            number += 1;
        }
    });
    assert!(cycle.state() == State::Run && cycle.duty_source().tracking().flights() > Some(4));
    assert_eq!(allocations, 0);
}

/// Policies that come, gain authority, are withdrawn and go: boxes in and boxes out, nothing made or freed in between.
#[test]
fn policies_that_come_and_go_allocate_nothing() {
    let rig = Rig::builtin("dual_pressure").unwrap();
    let shipped = || Candidate::new(controller::daemon::shipped_policy().unwrap().0);
    let mut cycle = Cycle::new(&rig, None, Reference::paper(), Safety::default(), Arming::Automatic).unwrap();
    let policies = cycle.duty_source().tracking().policies();
    cycle.session_opened();
    let (mut kpa, mut notices, mut number) = ([0.0, 0.0], 0, 0);
    while number < 600 {
        tick(&mut cycle, number, &mut kpa, &mut notices);
        number += 1;
    }
    for round in 0..6 {
        // Even rounds are taken back; odd ones are replaced by the next.
        assert!(policies.ask(Command::Try(shipped(), Haste::Straight)).is_ok());
        let allocations = counted(|| {
            for _ in 0..40 {
                tick(&mut cycle, number, &mut kpa, &mut notices);
                number += 1;
            }
            if round % 2 == 0 {
                assert!(policies.ask(Command::Rollback).is_ok());
            }
            for _ in 0..40 {
                tick(&mut cycle, number, &mut kpa, &mut notices);
                number += 1;
            }
        });
        assert_eq!(allocations, 0, "round {round}");
    }
    assert_eq!(cycle.state(), State::Run);
    assert!(policies.sweep() >= 5, "what went came back through the queue");
    let told = std::iter::from_fn(|| policies.event()).count();
    assert!(told >= 10, "{told}");
}

#[test]
fn an_experiment_allocates_nothing_either() {
    let rig = Rig::builtin("dual_pressure").unwrap();
    let rows = vec![Row { duty: [0.8, 0.8], pump_on: true }; 300];
    // Without a relay, for the frames of this test say that the pump runs.
    let mut cycle = Cycle::playing(&rig, rows.into(), PumpRelay::Absent, Safety::default()).unwrap();
    cycle.session_opened();
    let (mut kpa, mut notices, mut running) = ([0.0, 0.0], 0, 0);
    let mut number = 0;
    let allocations = counted(|| {
        while !cycle.is_over() && number < 5_000 {
            running += u32::from(tick(&mut cycle, number, &mut kpa, &mut notices) == Mode::Run);
            number += 1;
        }
    });
    assert_eq!((running, cycle.duty_source().is_complete(), cycle.is_over()), (300, true, true));
    assert_eq!(allocations, 0, "in {number} ticks");
}

/// From control to an experiment and back, in a running daemon's cycle.
#[test]
fn an_experiment_within_a_run_allocates_nothing() {
    let rig = Rig::builtin("dual_pressure").unwrap();
    let mut plant = DualPressureRig::new(&rig).unwrap();
    let mut cycle = Cycle::new(&rig, None, Reference::paper(), Safety::default(), Arming::Automatic).unwrap();
    cycle.session_opened();
    let (mut notices, mut number) = (0, 0);
    let mut step = |cycle: &mut Cycle| {
        // A reading that stands still to the bit would be a frozen sensor's.
        let noise_kpa = 0.05 * (f64::from(number * 7_919 % 11) - 5.0) / 5.0;
        let readings = plant.readings_kpa().map(|kpa| kpa + noise_kpa);
        let answer = answer(cycle, number, readings, &mut notices);
        plant.tick(answer.duty, answer.pump_on);
        number += 1;
        answer.mode
    };
    // Ten seconds of control before it.
    let controlled = (0..600).filter(|_| step(&mut cycle) == Mode::Run).count();
    assert!(controlled > 500, "{controlled}");
    let rows = vec![Row { duty: [0.8, 0.8], pump_on: true }; 300];
    let mut playback = Some(Box::new(OpenLoopPlayback::new(rows.into(), PumpRelay::Absent)));
    let (mut finished, mut after) = (None, 0);
    let mut allocations = counted(|| {
        assert!(cycle.begin_experiment(playback.take().unwrap(), &mut |_| ()).is_ok());
    });
    for _ in 0..3_000 {
        let armed_before = cycle.state() == State::Run;
        let made = counted(|| {
            let mode = step(&mut cycle);
            finished = cycle.take_finished_experiment().or(finished.take());
            after += u32::from(finished.is_some() && mode == Mode::Run);
        });
        // The tick in which the closed loop is armed sets its model up anew, which allocates with or without an experiment.
        let arms = !armed_before && cycle.state() == State::Run && finished.is_some();
        allocations += if arms { 0 } else { made };
    }
    assert!(finished.is_some_and(|playback| playback.is_complete()), "played to its end");
    assert!(after > 500 && cycle.state() == State::Run, "and controlling again: {:?}", cycle.memory());
    assert_eq!(allocations, 0);
}

#[test]
fn a_model_that_has_diverged_begins_anew_without_allocating() {
    let mut predictor = Predictor::new(&Rig::builtin("bench").unwrap()).unwrap();
    predictor.restart([90.0, -70.0], [0.85, 0.83]);
    let allocations = counted(|| {
        predictor.observe([f64::NAN; 2]);
        predictor.advance([0.85, 0.83], true);
        assert!(!predictor.readings_kpa()[0].is_finite());
        predictor.recover([90.0, -70.0]);
        predictor.advance([0.85, 0.83], true);
    });
    assert!(predictor.readings_kpa().iter().all(|kpa| kpa.is_finite()));
    assert_eq!(allocations, 0);
}
