//! A link that is cut vents the rig within three ticks, and a pressure beyond a limit in the same tick: a hundred times each, a thousand in the
//! thorough tier.
//!
//! In lockstep, without sockets: the daemon's cycle, the cRIO's rules and a rig.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use controller::config::Safety;
use controller::cycle::Cycle;
use controller::cycle::duty_source::ActuatorCommand;
use controller::operator::notice::Notice;
use controller::state::Condition;
use proto::emulator::SensorFault;
use proto::reference::Reference;
use supervisor::Arming;
use tests::coarse_rigs::coarse;
use tests::dice::Dice;
use tests::lockstep::{Flight, Flown};

/// Times that each is tried.
const TIMES: u32 = 100;
/// And in the thorough tier.
const MANY_TIMES: u32 = 1_000;
/// Threads that share them.
const THREADS: u32 = 2;

fn flight(seed: u64) -> Flight {
    let rig = coarse("dual_pressure");
    let cycle = Cycle::new(&rig, None, Reference::paper(), Safety::default(), Arming::Automatic).unwrap();
    Flight::new(&rig, cycle, seed)
}

/// Runs half of so many tries on each of two threads.
fn shared(times: u32, work: impl Fn(&mut Flight, &mut Dice) + Sync) {
    std::thread::scope(|scope| {
        for thread in 0..THREADS {
            let work = &work;
            scope.spawn(move || {
                let (mut flight, mut dice) = (flight(u64::from(thread) + 1), Dice::new(u64::from(thread) + 1));
                for _ in 0..times / THREADS {
                    control(&mut flight, 3 + dice.roll(20));
                    work(&mut flight, &mut dice);
                }
            });
        }
    });
}

/// Flies until so many ticks in a row were under control.
fn control(flight: &mut Flight, ticks: u64) {
    let mut run = 0;
    for _ in 0..500 {
        let flown = flight.step();
        run = if flown.command == ActuatorCommand::VENT { 0 } else { run + 1 };
        if run >= ticks {
            return;
        }
    }
    panic!("never under control: {:?} {:?}", flight.cycle.state(), flight.cycle.conditions());
}

/// Direction that gets through no more.
#[derive(Debug, Clone, Copy)]
enum Cut {
    Both,
    Frames,
    Commands,
}

fn cut(flight: &mut Flight, cut: Cut) -> Flown {
    match cut {
        Cut::Both => flight.cut(),
        Cut::Frames => flight.missing(),
        Cut::Commands => flight.unheard(),
    }
}

fn cuts_vent_within_three_ticks(times: u32) {
    shared(times, |flight, dice| {
        let which = [Cut::Both, Cut::Frames, Cut::Commands][dice.roll(3) as usize];
        let mut vented = None;
        for tick in 1..=3 {
            let flown = cut(flight, which);
            // By the cRIO, whoever has seen to it.
            if flight.applied() == [1.0, 1.0] && vented.is_none() {
                vented = Some(tick);
            }
            if tick == 3 && !matches!(which, Cut::Commands) {
                assert_eq!(flown.command, ActuatorCommand::VENT, "{which:?}");
            }
        }
        assert!(vented.is_some(), "{which:?}: {:?} after three ticks", flight.applied());
        flight.cycle.link_lost(Condition::LinkLost, 0.0, &mut |_| {});
        flight.open();
    });
}

fn pressures_beyond_a_limit_vent_in_the_same_tick(times: u32) {
    shared(times, |flight, dice| {
        let channel = dice.roll(2) as usize;
        let share = dice.share();
        let (reading, cause) = match channel {
            // From 300 kPa on the cRIO trips by itself.
            0 => (160.2 + 130.0 * share, Condition::OverPressure),
            _ => (-95.1 - 5.0 * share, Condition::OverVacuum),
        };
        flight.faults[channel] = vec![SensorFault::Reading(reading)];
        let flown = flight.step();
        assert_eq!(flown.command, ActuatorCommand::VENT, "{reading} kPa");
        let told = |n: &Notice| matches!(n, Notice::Vented { cause: c, .. } if *c == cause);
        assert!(flown.told.iter().any(told), "{reading} kPa: {:?}", flown.told);
        flight.faults[channel].clear();
        // What waited for a person is acknowledged and armed again, once it is vented.
        for _ in 0..40 {
            flight.step();
        }
        flight.cycle.acknowledge();
        for _ in 0..60 {
            flight.step();
            if flight.cycle.can_arm() {
                break;
            }
        }
        assert!(flight.cycle.can_arm(), "{:?} {:?}", flight.cycle.state(), flight.cycle.memory().latched);
        flight.cycle.arm();
    });
}

#[test]
fn cuts_of_the_link_each_vent_within_three_ticks() {
    cuts_vent_within_three_ticks(TIMES);
}

#[test]
fn pressures_beyond_a_limit_each_vent_in_the_same_tick() {
    pressures_beyond_a_limit_vent_in_the_same_tick(TIMES);
}

/// Tests of the thorough tier (docs/testing.md).
mod thorough {
    use super::*;

    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn a_thousand_cuts_of_the_link_each_vent_within_three_ticks() {
        cuts_vent_within_three_ticks(MANY_TIMES);
    }

    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn a_thousand_pressures_beyond_a_limit_each_vent_in_the_same_tick() {
        pressures_beyond_a_limit_vent_in_the_same_tick(MANY_TIMES);
    }
}
