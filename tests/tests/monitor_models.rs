//! `controller model` changes what the monitor holds readings against, not only what the controller predicts with.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use controller::config::Safety;
use controller::cycle::Cycle;
use handover::Permit;
use proto::reference::Reference;
use supervisor::Arming;
use tests::Folder;
use tests::coarse_rigs::coarse;
use tests::lockstep::Flight;

/// Largest sum over half a second in a stretch of flight, by channel, kPa.
fn largest_sums(flight: &mut Flight, ticks: u32) -> [f64; 2] {
    let mut largest = [0.0_f64; 2];
    for _ in 0..ticks {
        flight.step();
        let [as_filed, _] = flight.cycle.monitor().figures_kpa();
        for (most, channel) in largest.iter_mut().zip(as_filed) {
            *most = most.max(channel[2].abs());
        }
    }
    largest
}

/// Ticks after which [`swinging`] is where it began.
const PERIOD: u32 = 2_000;

/// The paper's reference without its slope, for ten minutes: how many ticks a change of the model takes depends on the computer, and
/// what is compared is the same phase of the same swing.
fn swinging() -> Reference {
    use std::f64::consts::TAU;
    let row = |k: u32| {
        let t = f64::from(k) / 50.0;
        format!("{t:.2},{:.6},{:.6}\n", 90.0 + 6.0 * (TAU * t / 8.0).sin(), -70.0 + 3.0 * (TAU * t / 10.0).sin())
    };
    let text: String =
        std::iter::once("time_s,ref_pos_kpa,ref_neg_kpa\n".to_owned()).chain((0..30_000).map(row)).collect();
    Reference::parse("swinging", text.as_bytes()).unwrap()
}

#[test]
fn the_monitor_takes_over_the_model_that_is_put_in() {
    let (bench, nominal) = (coarse("bench"), coarse("dual_pressure"));
    let folder = Folder::new();
    let file = folder.write("bench.toml", bench.to_toml().unwrap());
    let cycle = Cycle::new(&nominal, None, swinging(), Safety::default(), Arming::Automatic).unwrap();
    let mut flight = Flight::new(&bench, cycle, 3);
    // A period with the nominal model, from where the rig has settled.
    largest_sums(&mut flight, 300);
    let before = largest_sums(&mut flight, PERIOD);
    let desk = flight.cycle.duty_source().tracking().models();
    let changing = std::thread::spawn(move || desk.change(&file, Safety::default(), &Permit::unlimited()));
    while !changing.is_finished() {
        flight.step();
    }
    let changed = changing.join().unwrap();
    assert!(changed.as_ref().is_ok_and(|new| new.line.contains("is in force")), "{changed:?}");
    // Where in its backlash the new model's valve stands is known once it has moved through it: 3 s at the most, at any phase.
    largest_sums(&mut flight, 200);
    let after = largest_sums(&mut flight, PERIOD);
    println!("sums over half a second: {before:?} kPa before, {after:?} after");
    for c in 0..2 {
        assert!(after[c] < 0.5 * before[c], "{before:?} {after:?}");
    }
    assert!(flight.cycle.state().is_controlling());
}

/// The rig is the same before and after, and so is the duty that holds it: what another model says goes into the integrals.
#[test]
fn another_model_makes_no_bump() {
    let (bench, nominal) = (coarse("bench"), coarse("dual_pressure"));
    let folder = Folder::new();
    let file = folder.write("bench.toml", bench.to_toml().unwrap());
    for by_policy in [None, Some(controller::daemon::shipped_policy().unwrap().0)] {
        let who = by_policy.as_ref().map_or("fallback", |_| "policy");
        let hold = Reference::constant(90.0, -70.0);
        let cycle = Cycle::new(&nominal, by_policy, hold, Safety::default(), Arming::Automatic).unwrap();
        let mut flight = Flight::new(&bench, cycle, 3);
        let step = |flight: &mut Flight| {
            let duty = flight.step().command.duty;
            (duty, flight.true_kpa())
        };
        let mut flown: Vec<_> = (0..1200).map(|_| step(&mut flight)).collect();
        let held = flown.split_off(1000);
        let desk = flight.cycle.duty_source().tracking().models();
        let file = file.clone();
        let changing = std::thread::spawn(move || desk.change(&file, Safety::default(), &Permit::unlimited()));
        let mut after = held.clone();
        while !changing.is_finished() {
            after.push(step(&mut flight));
        }
        let changed = changing.join().unwrap();
        assert!(changed.is_ok(), "{changed:?}");
        after.extend((0..150).map(|_| step(&mut flight)));
        for c in 0..2 {
            let steps = |flown: &[([f64; 2], [f64; 2])]| {
                flown.windows(2).map(|two| (two[1].0[c] - two[0].0[c]).abs()).fold(0.0, f64::max)
            };
            let away = |flown: &[([f64; 2], [f64; 2])]| {
                flown.iter().map(|(_, kpa)| (kpa[c] - [90.0, -70.0][c]).abs()).fold(0.0, f64::max)
            };
            let [before, most] = [steps(&held), steps(&after)];
            let [before_kpa, most_kpa] = [away(&held), away(&after)];
            println!(
                "{who}, channel {c}: steps of {before:.4} and {most:.4}, {before_kpa:.3} and {most_kpa:.3} kPa away"
            );
            if std::env::var_os("TRACE").is_some() {
                for (k, (duty, kpa)) in after.iter().enumerate() {
                    println!("{who} {c} {k} {:.4} {:.3}", duty[c], kpa[c]);
                }
            }
            assert!(most < before + 0.02, "{who}, channel {c}: a step of {most} in duty");
            assert!(most_kpa < before_kpa + 0.5, "{who}, channel {c}: {most_kpa} kPa away");
        }
        assert!(flight.cycle.state().is_controlling());
    }
}
