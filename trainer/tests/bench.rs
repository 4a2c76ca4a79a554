//! `trainer bench`, end to end: its figures are there and hang together, and it simulates what a C program does.

// What fails here fails the test, helper functions included.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod program;

use std::process::Command;

use program::{Folder, elsewhere, sound};

const TICKS: u32 = 300;

#[test]
fn figures_hang_together_and_a_c_program_ends_at_the_same_pressures() {
    // As little as gives every figure: in a debug build a tick takes milliseconds.
    let ticks = TICKS.to_string();
    let said =
        sound(["bench", "--json", "--ticks", &ticks, "--repeats", "1", "--predictions", "100", "--learning", "1"]);
    let value: serde_json::Value = serde_json::from_str(&said).unwrap();
    let figure = |key: &str| value[key].as_f64().unwrap_or_else(|| panic!("no {key} in {value:#}"));
    assert!(figure("ticks_per_s_single") > 0.0 && figure("ticks_per_s_lanes") > 0.0, "{value:#}");
    // CPU time is wall time at most, clocks read a moment apart.
    for speed in ["ticks_per_s_single", "ticks_per_s_lanes"] {
        assert!(figure(&format!("{speed}_cpu")) > 0.99 * figure(speed), "{value:#}");
    }
    let (p50, p999, max) = (figure("mpobs_us_p50"), figure("mpobs_us_p999"), figure("mpobs_us_max"));
    assert!(p50 <= p999 && p999 <= max, "{value:#}");
    // Five ticks take five times one tick; a factor of three for a shared machine and for saving the state.
    let tick_us = 1e6 / figure("ticks_per_s_single_cpu");
    assert!((5.0 / 3.0..15.0).contains(&(p50 / tick_us)), "{p50} µs for five ticks of {tick_us} µs");
    let (updates, share) = (figure("updates_per_s"), figure("updates_share_of_fma"));
    assert!(updates > 0.0 && figure("updates_threads") >= 1.0, "{value:#}");
    // 476 MFLOP an update, against the bound that was measured beside it; nothing beats its bound.
    assert!((updates * 0.47605 / figure("fma_gflop_per_s") - share).abs() < 1e-9 && share < 1.0, "{value:#}");
    for (channel, theirs) in peer() {
        let ours = figure(channel);
        assert!((ours - theirs).abs() <= 0.001, "{channel}: {ours} against {theirs} kPa");
        println!("{channel}: {ours:.5} against {theirs} kPa");
    }
}

/// Final pressures of someone else's C program: the same plant, steps and duties. None, told, without it or a compiler.
fn peer() -> Vec<(&'static str, f64)> {
    let Some(source) = elsewhere("PEER_RK4_C", "shared/peers/simulator/rk4.c") else { return Vec::new() };
    let folder = Folder::new("peer");
    let program = folder.path("rk4");
    let mut cc = Command::new("cc");
    cc.args(["-O3", "-march=native", "-ffast-math", "-o", &program]).arg(&source).arg("-lm");
    match cc.status() {
        Err(error) => {
            println!("skipped: no C compiler: {error}");
            return Vec::new();
        }
        Ok(status) => assert!(status.success(), "cc cannot compile {}", source.display()),
    }
    let output = Command::new(&program).arg(TICKS.to_string()).output().unwrap();
    let line = String::from_utf8(output.stdout).unwrap();
    let pressure = |channel: &str| {
        let word = line.split_whitespace().find_map(|word| word.strip_prefix(&format!("{channel}=")));
        word.unwrap_or_else(|| panic!("no {channel} in {line}")).parse().unwrap()
    };
    ["p_pos_kpa", "p_neg_kpa"].map(|channel| (channel, pressure(channel))).into()
}
