//! `controller explore on|off` on a running daemon: who may, what is added, what ends it, and that it replays to the bit.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::process::Command;

use proto::recording::{PLANNED_OUTPUTS, POLICY_OUTPUTS, TickInput, TickRecord, read_mcap};
use tests::laboratory::{Laboratory, Plan, RECORDINGS};
use tests::{finish, program, root};

/// The default of `policy.exploration_max_duty`, and of the deviation for a policy that states none: 0.02 of ±0.25.
const MOST_DUTY: f64 = 0.02;
const STD_DUTY: f64 = 0.01;

fn laboratory(policy: &str) -> Laboratory {
    // Exploration ends with the policy, so how the policy stands beside the fallback must not end it in between.
    Plan::new(&format!("policy.active = \"{policy}\"\npolicy.when_behind = \"fly\"")).start()
}

fn check_done(laboratory: &Laboratory, arguments: &[&str]) {
    let ended = laboratory.ask(arguments);
    assert_eq!(ended.status, Some(0), "{arguments:?}: {ended:?}");
}

fn check_refused(laboratory: &Laboratory, words: &str) {
    let ended = laboratory.ask(&["explore", "on"]);
    assert!(ended.status == Some(1) && ended.stderr.contains(words), "{ended:?}");
}

fn explores(tick: &TickRecord) -> bool {
    tick.exploration_pos != 0.0 || tick.exploration_neg != 0.0
}

#[test]
fn noise_is_bounded_recorded_and_replayed_and_ends_with_disarming_and_another_policy() {
    let laboratory = laboratory("default");
    laboratory.stand_by();
    check_refused(&laboratory, "needs the rig under control");
    laboratory.arm();
    let on = laboratory.ask(&["explore", "on", "--seed", "7"]);
    assert!(
        on.status == Some(0) && on.stdout.contains("policy.exploration_std") && on.stdout.contains("seed 7"),
        "{on:?}"
    );
    let shown = laboratory.wait_for("exploring", |reply| reply["status"]["exploration"].is_object());
    let shown = &shown["status"];
    assert_eq!((&shown["exploration"]["seed"], &shown["exploration"]["std_duty"][0]), (&7.into(), &STD_DUTY.into()));
    let since = shown["tick"].as_u64().unwrap();
    laboratory.wait_for("explored for a while", |reply| reply["status"]["tick"].as_u64().unwrap() > since + 1500);
    let off = laboratory.ask(&["explore", "off"]);
    assert!(off.status == Some(0) && off.stdout.contains("exploration is off"), "{off:?}");

    // Whatever else ends it: a disarming, and what is swapped to.
    check_done(&laboratory, &["explore", "on"]);
    check_done(&laboratory, &["disarm"]);
    laboratory.wait_for("off", |reply| reply["status"]["exploration"].is_null());
    laboratory.arm();
    laboratory.wait_for("armed without exploring", |reply| {
        reply["status"]["state"] == "run" && reply["status"]["exploration"].is_null()
    });
    check_done(&laboratory, &["explore", "on"]);
    check_done(&laboratory, &["swap", "fallback"]);
    laboratory.wait_for("off", |reply| reply["status"]["exploration"].is_null());
    check_refused(&laboratory, "");

    let closed = laboratory.close();
    let (files, ticks) = (closed.recordings("run-"), closed.ticks());
    let [file] = &files[..] else { panic!("one file of the run: {files:?}") };
    let explored: Vec<&TickRecord> = ticks.iter().filter(|tick| explores(tick)).collect();
    assert!(explored.len() > 1000, "{}", explored.len());
    assert!(explored.iter().all(|t| t.exploration_pos.abs() <= MOST_DUTY && t.exploration_neg.abs() <= MOST_DUTY));
    let square = |value: fn(&TickRecord) -> f64| {
        (explored.iter().map(|tick| value(tick).powi(2)).sum::<f64>() / explored.len() as f64).sqrt()
    };
    // Cut off at two deviations it keeps 0.9594 of the deviation; a tenth for the number of draws.
    for deviation in [square(|tick| tick.exploration_pos), square(|tick| tick.exploration_neg)] {
        assert!((deviation / (0.9594 * STD_DUTY) - 1.0).abs() < 0.1, "{deviation}");
    }
    // It reaches the command: what the law's correction holds is the answer with the noise, as far as the way to the goal
    // leaves it any authority.
    let reached = explored.iter().filter(|tick| {
        let answered = f64::from(tick.policy_output[0]) + tick.exploration_pos;
        (tick.law_pos.correction - answered).abs() < 1e-6
    });
    assert!(reached.count() * 2 > explored.len(), "half of the ticks are on their reference");
    assert!(explored.iter().all(|tick| tick.mode == 1 && tick.authority == 1.0 && tick.policy_stage == 0));
    for pair in ticks.windows(2).filter(|pair| pair.iter().all(|tick| tick.mode == 1)) {
        let step = (pair[1].u_pos - pair[0].u_pos).abs().max((pair[1].u_neg - pair[0].u_neg).abs());
        assert!(step <= 0.1 + 1e-9, "the slew limit holds: {step}");
    }
    assert!(ticks.iter().any(|tick| TickInput::of(tick.inputs).any(|input| input == TickInput::Explore)));
    let events = read_mcap(file).unwrap().events;
    assert!(events.iter().any(|event| event.message.contains("seed 7")), "the seed is in the log");

    // The swap at the end among it.
    closed.check_replay();
}

/// A policy that learned its plan states a deviation for each number of it, and these are tried as well.
#[test]
fn a_learned_plan_is_explored_recorded_learned_from_and_replayed() {
    let plan = Plan::new("policy.active = \"whole\"\npolicy.directory = \"p\"\npolicy.when_behind = \"fly\"");
    let std = 0.004;
    let stated = format!("exploration_std={}", vec![std.to_string(); POLICY_OUTPUTS].join(","));
    let whole = plan.folder.join("p/whole.onnx");
    std::fs::create_dir_all(plan.folder.join("p")).unwrap();
    let shipped = root().join("controller/policies/default.onnx");
    let export = ["export", "--note", &stated, "--out"];
    let ended = finish(Command::new(program("trainer")).args(export).arg(&whole).arg(shipped));
    assert_eq!(ended.status, Some(0), "{ended:?}");

    let laboratory = plan.start();
    laboratory.arm();
    check_done(&laboratory, &["explore", "on", "--seed", "11"]);
    let since = laboratory.status()["status"]["tick"].as_u64().unwrap();
    laboratory.wait_for("explored for a while", |reply| reply["status"]["tick"].as_u64().unwrap() > since + 1000);
    let closed = laboratory.close();
    closed.check_replay();
    let explored: Vec<TickRecord> = closed.ticks().into_iter().filter(explores).collect();
    for i in 0..PLANNED_OUTPUTS {
        let squares: f64 = explored.iter().map(|tick| f64::from(tick.exploration_plan[i]).powi(2)).sum();
        let deviation = (squares / explored.len() as f64).sqrt();
        assert!((deviation / (0.9594 * std) - 1.0).abs() < 0.1, "{i}: {deviation}");
    }

    // Whoever learns on takes the whole answer for the action, and rebuilds what the policy was shown after it.
    let published = closed.folder.join("out");
    std::fs::create_dir_all(&published).unwrap();
    let mut learn = Command::new(program("trainer"));
    learn.args(["finetune", "--offline", "--json", "--hold-plan", "--updates-per-tick", "1", "--steps", "300"]);
    learn.arg("--recordings").arg(closed.folder.join(RECORDINGS)).arg("--from").arg(&whole);
    let ended = finish(learn.arg("--publish").arg(&published).arg("--out").arg(closed.folder.join("run")));
    let summary: serde_json::Value = serde_json::from_str(&ended.stdout).unwrap_or_else(|e| panic!("{e}: {ended:?}"));
    let tally = &summary["tally"];
    assert_eq!(tally["same_observations"], tally["compared_observations"], "{summary}");
    assert!(tally["compared_observations"].as_u64() > Some(250), "{summary}");
    assert!(tally["left_out"]["not explained by the recorded model"].is_null(), "{summary}");
}

#[test]
fn the_fallback_has_nothing_to_explore() {
    let laboratory = laboratory("fallback");
    laboratory.arm();
    check_refused(&laboratory, "the fallback controls");
    let off = laboratory.ask(&["explore", "off"]);
    assert_eq!(off.status, Some(0), "off is off: {off:?}");
    let ticks = laboratory.close().ticks();
    assert!(!ticks.iter().any(explores));
}
