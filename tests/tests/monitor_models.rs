//! `controller model` changes what the monitor holds readings against, not only what the controller predicts with.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use controller::config::Safety;
use controller::cycle::Cycle;
use handover::Permit;
use model::rig::Rig;
use proto::reference::Reference;
use tests::Folder;
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

#[test]
fn the_monitor_takes_over_the_model_that_is_put_in() {
    let (bench, nominal) = (Rig::builtin("bench").unwrap(), Rig::builtin("dual_pressure").unwrap());
    let folder = Folder::new();
    let file = folder.write("bench.toml", bench.to_toml().unwrap());
    let cycle = Cycle::new(&nominal, None, Reference::paper(), Safety::default(), true).unwrap();
    let mut flight = Flight::new(&bench, cycle, 3);
    largest_sums(&mut flight, 300);
    let before = largest_sums(&mut flight, 700);
    let desk = flight.cycle.duty_source().tracking().models();
    let changing = std::thread::spawn(move || desk.change(&file, &Permit::unlimited()));
    while !changing.is_finished() {
        flight.step();
    }
    let changed = changing.join().unwrap();
    assert!(changed.as_ref().is_ok_and(|new| new.line.contains("is in force")), "{changed:?}");
    // Where in its play the new model's valve stands is known once it has moved through it: 3 s at the most, at any phase.
    largest_sums(&mut flight, 200);
    let after = largest_sums(&mut flight, 700);
    println!("sums over half a second: {before:?} kPa before, {after:?} after");
    for c in 0..2 {
        assert!(after[c] < 0.5 * before[c], "{before:?} {after:?}");
    }
    assert!(flight.cycle.state().is_controlling());
}
