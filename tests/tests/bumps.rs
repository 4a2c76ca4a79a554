//! No change of what controls bumps the valves: the duty of the tick in which it happens, and of each after it, is where it would
//! have been without, within a hundredth.
//!
//! In lockstep, without sockets, on a reference that stands still. Each flight has a twin with the same noise in which nothing
//! happens.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use controller::config::Safety;
use controller::cycle::Cycle;
use controller::cycle::duty_source::ActuatorCommand;
use controller::daemon::shipped_policy;
use handover::{Candidate, Command, Haste};
use proto::emulator::SensorFault;
use proto::reference::Reference;
use proto::wire::Mode;
use supervisor::{Arming, Condition, State};
use tests::coarse_rigs::coarse;
use tests::lockstep::Flight;

/// Step that a change may add to a duty beyond the move of the same tick in the twin's flight.
const BUMP_DUTY: f64 = 0.01;
/// Step that no command exceeds in a tick, whatever happens.
const SLEW_DUTY: f64 = 0.1;
/// Ticks that are flown before anything happens: 12 s, of which three are the way to the reference.
const BEFORE: u32 = 600;
/// Ticks that are looked at from then on: 4 s.
const AFTER: u32 = 200;

/// Event at a tick after [`BEFORE`].
type Event = fn(&mut Flight, u32);

/// Controller that flies at first.
#[derive(Clone, Copy)]
enum Flies {
    Fallback,
    Policy,
}

fn flight(flies: Flies) -> Flight {
    let rig = coarse("dual_pressure");
    let policy = match flies {
        Flies::Fallback => None,
        Flies::Policy => Some(shipped_policy().unwrap().0),
    };
    let cycle =
        Cycle::new(&rig, policy, Reference::constant(85.0, -72.0), Safety::default(), Arming::Automatic).unwrap();
    Flight::new(&rig, cycle, 7)
}

/// Duties of the ticks from [`BEFORE`] on, the one before them first.
fn duties(flies: Flies, event: Event) -> Vec<ActuatorCommand> {
    let mut flight = flight(flies);
    (1..BEFORE).for_each(|_| drop(flight.step()));
    let mut commands = vec![flight.step().command];
    for tick in 0..AFTER {
        event(&mut flight, tick);
        commands.push(flight.step().command);
    }
    commands
}

fn shipped() -> Box<Candidate> {
    Candidate::new(shipped_policy().unwrap().0)
}

fn swap(flight: &mut Flight, candidate: Box<Candidate>) {
    let store = flight.cycle.duty_source().tracking().policies();
    assert!(store.ask(Command::Try(candidate, Haste::Straight)).is_ok());
}

fn jump(flight: &mut Flight, channel: usize, tick: u32) {
    flight.faults[channel] = if tick == 0 { vec![SensorFault::Offset(-15.0)] } else { Vec::new() };
}

/// Frames that are missing, and what the plan was made for.
fn missing(flight: &mut Flight, tick: u32) {
    if tick == 0 {
        flight.missing();
    }
}

const CASES: [(&str, Flies, Event); 9] = [
    ("to the policy", Flies::Fallback, |flight, k| {
        if k == 0 {
            swap(flight, shipped());
        }
    }),
    ("to the fallback", Flies::Policy, |flight, k| {
        if k == 0 {
            swap(flight, Candidate::fallback());
        }
    }),
    ("to the policy and back at once", Flies::Fallback, |flight, k| match k {
        0 => swap(flight, shipped()),
        40 => assert!(flight.cycle.duty_source().tracking().policies().ask(Command::Rollback).is_ok()),
        _ => {}
    }),
    ("another model, the fallback flying", Flies::Fallback, |flight, k| model(flight, k)),
    ("another model, the policy flying", Flies::Policy, |flight, k| model(flight, k)),
    ("HOLD and RUN, the fallback flying", Flies::Fallback, |flight, k| jump(flight, 0, k)),
    ("HOLD and RUN, the policy flying", Flies::Policy, |flight, k| jump(flight, 1, k)),
    ("REVERT and RUN", Flies::Policy, |flight, k| {
        if k == 0 {
            flight.cycle.report(Condition::TrackingPositive, 15.0);
        }
    }),
    ("HOLD, REVERT and RUN", Flies::Policy, |flight, k| {
        jump(flight, 0, k);
        if k == 3 {
            flight.cycle.report(Condition::TrackingPositive, 15.0);
        }
    }),
];

fn model(flight: &mut Flight, tick: u32) {
    let desk = flight.cycle.duty_source().tracking().models();
    desk.follow_replay();
    if tick == 0 {
        desk.repeat(&coarse("bench"), u64::from(BEFORE)).unwrap();
    }
}

#[test]
fn nothing_that_takes_over_moves_a_duty_by_a_hundredth_more_than_the_flight_itself() {
    let mut bumps = Vec::new();
    for (name, flies, event) in CASES {
        let twin = duties(flies, |_, _| ());
        let flown = duties(flies, event);
        let steps = |commands: &[ActuatorCommand], c: usize| -> Vec<f64> {
            commands.windows(2).map(|pair| pair[1].duty[c] - pair[0].duty[c]).collect()
        };
        assert!(flown.iter().all(|command| command.mode != Mode::Vent), "{name}: vented");
        for c in 0..2 {
            let calm = steps(&twin, c).iter().fold(0.0_f64, |most, step| most.max(step.abs()));
            let most = steps(&flown, c).iter().fold(0.0_f64, |most, step| most.max(step.abs()));
            println!("{name}, channel {c}: {most:.4} of duty, {calm:.4} without");
            if most > calm + BUMP_DUTY {
                bumps.push(format!("{name}, channel {c}: {most:.4} of duty, {calm:.4} without"));
            }
        }
    }
    assert!(bumps.is_empty(), "{bumps:#?}");
}

/// Venting that waited for a person: from open vents the duties close no faster than the speed limit.
#[test]
fn arming_after_an_acknowledgement_closes_the_vents_within_the_speed_limit() {
    for flies in [Flies::Fallback, Flies::Policy] {
        let mut flight = flight(flies);
        (0..BEFORE).for_each(|_| drop(flight.step()));
        flight.faults[0] = vec![SensorFault::NotANumber];
        assert_eq!(flight.step().command, ActuatorCommand::VENT);
        flight.faults[0].clear();
        (0..150).for_each(|_| drop(flight.step()));
        flight.cycle.acknowledge();
        (0..60).for_each(|_| drop(flight.step()));
        assert_eq!(flight.cycle.state(), State::Standby);
        flight.cycle.arm();
        let mut before = ActuatorCommand::VENT;
        let mut most = 0.0_f64;
        for tick in 0..AFTER {
            let command = flight.step().command;
            assert_eq!(command.mode, Mode::Run, "{tick}");
            most = (0..2).fold(most, |most, c| most.max((command.duty[c] - before.duty[c]).abs()));
            before = command;
        }
        assert!(most <= SLEW_DUTY + 1e-12, "{most}");
        assert!(before.duty.iter().all(|duty| *duty < 0.95), "they do close: {:?}", before.duty);
        println!("armed: {most:.4} of duty a tick at the most");
    }
}

/// A frame that is missing: the plan is followed, and what decides again goes on from it.
#[test]
fn a_missing_frame_moves_no_duty_by_a_hundredth_more() {
    for flies in [Flies::Fallback, Flies::Policy] {
        let (twin, flown) = (duties(flies, |_, _| ()), duties(flies, missing));
        for c in 0..2 {
            let most = |commands: &[ActuatorCommand]| {
                commands.windows(2).fold(0.0_f64, |most, pair| most.max((pair[1].duty[c] - pair[0].duty[c]).abs()))
            };
            println!("channel {c}: {:.4} of duty, {:.4} without", most(&flown), most(&twin));
            assert!(most(&flown) <= most(&twin) + BUMP_DUTY, "channel {c}: {} and {}", most(&flown), most(&twin));
        }
    }
}
