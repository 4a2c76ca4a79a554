//! A hidden rig behind the emulated cRIO, as a program: `cargo run --release -p tests --example hidden_crio -- TRUTH HOST:PORT`.
//!
//! `TRUTH` is a truth file of `hidden_rig make`, or `e1` (valve lag 80 ms, warm gas, hysteresis 0.03), `e2` (delay 60 ms,
//! warm gas), or `plain`; a number after a colon (`e1:7`) draws other parameters. It prints `listening on HOST:PORT`, plays
//! in lockstep and stops after the seconds given third (default 60).
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::path::Path;
use std::time::Duration;

use hidden_rig::build_sheet::{BuildSheet, Spread};
use hidden_rig::rng::Draws;
use hidden_rig::run::Rig;
use hidden_rig::truth::Truth;
use proto::emulator::{Emulator, EmulatorConfig, Pace};
use tests::hidden_plant::HiddenPlant;

/// The rig of a truth file, or one of the two that stand in the study of the loop.
fn rig(name: &str) -> Rig {
    let (kind, seed) = name.split_once(':').unwrap_or((name, "1"));
    if !["e1", "e2", "plain"].contains(&kind) {
        return Truth::read(Path::new(name)).unwrap_or_else(|error| panic!("{error}")).rig();
    }
    let seed = seed.parse().expect("a number after the colon");
    let mut sheet = BuildSheet::draw(&mut Draws::new(seed), Spread::AS_BUILT);
    if kind != "plain" {
        // Wool out: gas that warms when it is compressed.
        sheet.wool_w_k = [1.0, 1.0];
    }
    let mut rig = sheet.rig();
    match kind {
        "e1" => {
            use hidden_rig::effects::drive::{Hysteresis, Lag};
            use hidden_rig::effects::{Mechanism, Place};
            let mut draws = Draws::new(seed);
            let mut lag = Lag::draw(&mut draws);
            lag.set_strength(0.08);
            lag.install(Place::Both, &mut rig);
            let mut hysteresis = Hysteresis::draw(&mut draws);
            hysteresis.set_strength(0.03);
            hysteresis.install(Place::Both, &mut rig);
        }
        "e2" => rig.actuation.delay_s = [0.06; 2],
        _ => {}
    }
    rig
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [name, address, rest @ ..] = arguments.as_slice() else { panic!("hidden_crio TRUTH HOST:PORT [SECONDS]") };
    let seconds: u64 = rest.first().map_or(60, |s| s.parse().expect("seconds"));
    let config = EmulatorConfig { pace: Pace::LOCKSTEP, seed: 1, ..EmulatorConfig::default() };
    let emulator = Emulator::bind(address, config, Box::new(HiddenPlant::at_rest(rig(name)))).expect("a free address");
    println!("listening on {}", emulator.local_addr());
    let handle = emulator.start().expect("a thread");
    while handle.statistics().edges < 50 * seconds {
        std::thread::sleep(Duration::from_millis(50));
    }
    handle.stop();
    handle.join().expect("the emulator's own thread");
}
