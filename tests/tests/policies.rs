//! Policies change while the daemon runs: published into the watched directory, swapped by name, taken back; bad ones are
//! refused and say why. Three processes over real sockets: daemon, emulated cRIO, operator.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

#[path = "../../controller/admission/tests/corpus/mod.rs"]
mod corpus;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use proto::recording::TickRecord;
use serde_json::Value;
use tests::Stream;
use tests::laboratory::{Laboratory, Plan, SOON};

/// The published test vector of minisign: a key, and its signature of the four bytes `test`.
const KEY: &str = "RWQf6LRCGA9i53mlYecO4IzT51TGPpvWucNSCh1CBM0QTaLn73Y7GFO3";
const SIGNATURE: &str = "untrusted comment: signature from minisign secret key\n\
RUQf6LRCGA9i559r3g7V1qNyJDApGip8MfqcadIgT9CuhV3EMhHoN1mGTkUidF/z7SrlQgXdy8ofjb7bNJJylDOocrCo8KLzZwo=\n\
trusted comment: timestamp:1633700835\tfile:test\tprehashed\n\
wLMDjy9FLAuxZ3q4NlEvkgtyhrr0gtTu6KC4KBJdITbbOeAi1zBIYo0v4iTgt8jJpIidRJnp94ABQkJAgAooBQ==\n";

/// A daemon that arms by itself and watches `policies`, with further lines of its configuration.
fn laboratory(lines: &str) -> Laboratory {
    let plan = Plan::new(&format!(
        "control.auto_arm = true\nreference.file = \"beating.csv\"\nreference.repeat = true\n{lines}"
    ));
    std::fs::create_dir(plan.folder.join("policies")).unwrap();
    // Two sines of 8 and 10 s, which meet again after 40 s. The paper's reference is over before a candidate has come to the ramp, and
    // on the hold that follows the fallback errs by its noise alone.
    let wave = |t: f64, period_s: f64| (std::f64::consts::TAU * t / period_s).sin();
    let row = |t: f64| format!("{t:.1},{:.6},{:.6}\n", 90.0 + 6.0 * wave(t, 8.0), -70.0 + 3.0 * wave(t, 10.0));
    let rows: String = (0..=200).map(|k| row(0.2 * f64::from(k))).collect();
    plan.folder.write("beating.csv", format!("time_s,ref_pos_kpa,ref_neg_kpa\n{rows}"));
    plan.start()
}

/// The entry of a policy, once it is as wanted.
fn wait_for(laboratory: &Laboratory, name: &str, what: &str, wanted: impl Fn(&Value) -> bool) -> Value {
    let until = Instant::now() + SOON;
    loop {
        let (reply, status) = laboratory.ask_json(&["policies"]);
        assert_eq!(status, Some(0), "{reply}");
        let entries = reply["policies"].as_array().unwrap();
        let entry = entries.iter().find(|e| e["name"] == name).cloned().unwrap_or_default();
        if wanted(&entry) {
            return entry;
        }
        assert!(Instant::now() < until, "{name} is not {what} in {SOON:?}: {entry}");
        std::thread::sleep(Duration::from_millis(100));
    }
}

fn publish(laboratory: &Laboratory, name: &str, bytes: &[u8]) {
    let part = laboratory.folder.join(&format!("policies/.{name}.part"));
    std::fs::write(&part, bytes).unwrap();
    std::fs::rename(part, policy(laboratory, name)).unwrap();
}

fn policy(laboratory: &Laboratory, name: &str) -> PathBuf {
    laboratory.folder.join(&format!("policies/{name}.onnx"))
}

fn refusal(file: &Path) -> Value {
    let mut name = file.as_os_str().to_owned();
    name.push(".refused.json");
    serde_json::from_slice(&std::fs::read(&name).unwrap_or_else(|e| panic!("{name:?}: {e}"))).unwrap()
}

/// No tick is lost and no duty moves faster than the slew limit, whatever controls.
fn check_ticks(ticks: &[TickRecord]) {
    let run = 1;
    for pair in ticks.windows(2) {
        let [before, after] = pair else { continue };
        if before.session == after.session {
            assert_eq!(after.tick, before.tick.wrapping_add(1), "a tick is missing");
        }
        if before.state == run && after.state == run {
            for (a, b) in [(before.u_pos, after.u_pos), (before.u_neg, after.u_neg)] {
                assert!((a - b).abs() <= 0.1 + 1e-9, "tick {}: from {a} to {b}", after.tick);
            }
        }
    }
}

#[test]
fn a_published_policy_controls_without_a_restart_and_bad_ones_never_do() {
    let laboratory = laboratory("policy.active = \"fallback\"");
    // Before anything is published nothing is there but the fallback.
    assert_eq!(laboratory.ask_json(&["status"]).0["running"]["policy"], "fallback");

    // Bad ones, each refused at its stage, with a file beside it that says why.
    let (_, sound) = corpus::trained().into_iter().find(|(name, _)| name == "default").unwrap();
    let networks = corpus::bad_networks();
    let network = |wanted: &str| networks.iter().find(|(name, _)| name == wanted).unwrap().1.clone();
    publish(&laboratory, "cut", &sound[..sound.len() / 2]);
    publish(&laboratory, "always_0", &network("always_0"));
    publish(&laboratory, "bang", &network("correct_bang_bang"));
    std::fs::write(policy(&laboratory, "text"), "no policy at all").unwrap();
    assert!(Command::new("mkfifo").arg(policy(&laboratory, "pipe")).status().unwrap().success());
    std::os::unix::fs::symlink("/dev/zero", policy(&laboratory, "zero")).unwrap();
    std::fs::write(laboratory.folder.join("policies/half.onnx.tmp"), &sound).unwrap();
    for (name, stage) in
        [("text", "network"), ("always_0", "answers"), ("bang", "trial"), ("pipe", "file"), ("zero", "file")]
    {
        let entry = wait_for(&laboratory, name, "refused", |e| e["state"] == "refused");
        assert_eq!(entry["refusal"]["stage"], stage, "{entry}");
        assert_eq!(refusal(&policy(&laboratory, name))["stage"], stage);
        let (reply, status) = laboratory.ask_json(&["swap", name]);
        assert_eq!(status, Some(1), "{reply}");
        assert!(reply["error"].as_str().unwrap().contains("was refused"), "{reply}");
    }
    let (reply, status) = laboratory.ask_json(&["swap", "nobody"]);
    assert_eq!(status, Some(2), "a name that nobody has is wrong use: {reply}");
    assert!(reply["error"].as_str().unwrap().contains("no policy nobody"), "{reply}");

    // A good one: passed, swapped, through the stages, active.
    publish(&laboratory, "next", &sound);
    let entry = wait_for(&laboratory, "next", "passed", |e| e["state"] == "passed");
    assert!(entry["figures"]["rmse_kpa"][0].as_f64().unwrap() < 1.0, "{entry}");
    let (reply, status) = laboratory.ask_json(&["swap", "next"]);
    assert_eq!(status, Some(0), "{reply}");
    wait_for(&laboratory, "next", "active", |e| e["state"] == "active");
    let status = laboratory.ask_json(&["status"]).0;
    assert_eq!((&status["running"]["policy"], &status["state"]), (&"next".into(), &"run".into()), "{status}");

    // Back to the fallback by name, and to the policy again: it has been active, so half a second is enough.
    assert_eq!(laboratory.ask_json(&["swap", "fallback"]).1, Some(0));
    wait_for(&laboratory, "next", "replaced", |e| e["state"] == "previous");
    assert_eq!(laboratory.ask_json(&["rollback"]).1, Some(0));
    wait_for(&laboratory, "next", "active again", |e| e["state"] == "active");

    let audit = std::fs::read_to_string(laboratory.folder.join("recordings/policies.audit.jsonl")).unwrap();
    let swap = audit.lines().find(|line| line.contains("\"swap\"")).unwrap_or_else(|| panic!("{audit}"));
    assert!(swap.contains("uid"), "who asked is told: {swap}");
    let closed = laboratory.close();
    closed.check_replay();
    let ticks = closed.ticks();
    check_ticks(&ticks);
    assert!(
        ticks.iter().any(|t| t.policy_stage >= 2 && t.authority > 0.0 && t.authority < 1.0),
        "the ramp is recorded"
    );
    assert!(ticks.iter().any(|t| t.swap_id == 1) && ticks.iter().any(|t| t.swap_id == 3), "so is what is in force");
}

/// Trouble with the directory is told, and no longer once it is mended; files that are taken away while they wait leave
/// nothing behind.
#[test]
fn what_was_wrong_with_the_directory_is_over_once_it_is_mended() {
    let laboratory = laboratory("policy.active = \"fallback\"");
    let folder = laboratory.folder.join("policies");
    let problem = |wanted: Option<&str>| {
        let until = Instant::now() + SOON;
        loop {
            let (reply, _) = laboratory.ask_json(&["policies"]);
            let found = reply["policies_problem"].as_str();
            if found.is_some() == wanted.is_some() && found.is_none_or(|f| f.contains(wanted.unwrap_or_default())) {
                return;
            }
            assert!(Instant::now() < until, "{wanted:?}: {reply}");
            std::thread::sleep(Duration::from_millis(100));
        }
    };
    let (_, sound) = corpus::trained().into_iter().find(|(name, _)| name == "default").unwrap();
    for name in ["two words", "fallback"] {
        std::fs::write(policy(&laboratory, name), &sound).unwrap();
        problem(Some("is passed over"));
        std::fs::remove_file(policy(&laboratory, name)).unwrap();
        problem(None);
    }
    let aside = laboratory.folder.join("aside");
    std::fs::rename(&folder, &aside).unwrap();
    std::fs::write(&folder, "no directory").unwrap();
    problem(Some("cannot be read"));
    std::fs::remove_file(&folder).unwrap();
    std::fs::rename(&aside, &folder).unwrap();
    problem(None);

    // More than can be examined at once, taken away again.
    (0..20).for_each(|k| publish(&laboratory, &format!("w{k}"), &sound));
    wait_for(&laboratory, "w19", "waiting", |e| e["state"] == "checking");
    (0..20).for_each(|k| std::fs::remove_file(policy(&laboratory, &format!("w{k}"))).unwrap());
    publish(&laboratory, "next", &sound);
    wait_for(&laboratory, "next", "passed", |e| e["state"] == "passed");
    let (reply, _) = laboratory.ask_json(&["policies"]);
    let refused = reply["policies"].as_array().unwrap().iter().filter(|e| e["state"] == "refused").count();
    assert_eq!(refused, 0, "{reply}");
    assert!(!std::fs::read_dir(&folder).unwrap().flatten().any(|f| f.path().extension().is_some_and(|e| e == "json")));
    laboratory.close();
}

/// As the refusal says: sign it. It is examined again then, without being published anew, and gets as far as its content does.
#[test]
fn a_policy_that_is_signed_after_it_was_published_is_examined_again() {
    let key = format!("policy.require_signature = true\npolicy.public_key = \"{KEY}\"");
    let laboratory = laboratory(&format!("policy.active = \"fallback\"\n{key}"));
    publish(&laboratory, "b", b"test");
    let at = |stage: &str| {
        wait_for(&laboratory, "b", stage, |entry| entry["refusal"]["stage"] == stage)["refusal"]["reason"].to_string()
    };
    assert!(at("signature").contains("minisign -S -m"));
    std::fs::write(laboratory.folder.join("policies/b.onnx.minisig"), SIGNATURE).unwrap();
    let why = at("network");
    assert!(!why.contains("minisig"), "{why}");
    assert_eq!(refusal(&policy(&laboratory, "b"))["stage"], "network");
    laboratory.close();
}

/// `policy.follow = "newest"`: what is published and passes goes on by itself.
#[test]
fn the_newest_is_followed() {
    let laboratory = laboratory("policy.active = \"fallback\"\npolicy.follow = \"newest\"");
    let (_, sound) = corpus::trained().into_iter().find(|(name, _)| name == "default").unwrap();
    publish(&laboratory, "first", &sound);
    wait_for(&laboratory, "first", "on its way", |e| {
        ["shadow", "ramp", "recheck", "retrial", "probation", "active"].iter().any(|state| e["state"] == *state)
    });
    // An operator takes it back, and then the server with the folder is away for a while: that sends nothing on again.
    let (reply, status) = laboratory.ask_json(&["rollback"]);
    assert_eq!(status, Some(0), "{reply}");
    let (folder, away) = (laboratory.folder.join("policies"), laboratory.folder.join("away"));
    std::fs::rename(&folder, &away).unwrap();
    wait_for(&laboratory, "first", "gone", Value::is_null);
    std::fs::rename(&away, &folder).unwrap();
    laboratory.daemon.line(Stream::Err, "policy first: not adopted: it was on the rig in this run", SOON);
    let entry = wait_for(&laboratory, "first", "there", |e| !e.is_null());
    assert_eq!(entry["state"], "passed", "{entry}");
    check_ticks(&laboratory.close().ticks());
}

/// Swaps a thousand times: `cargo test --release -p tests --test policies -- --ignored a_thousand --nocapture`.
#[test]
#[ignore = "takes half an hour"]
fn a_thousand_swaps_lose_no_tick_and_move_no_duty_too_far() {
    swaps(1000);
}

fn swaps(count: usize) {
    // Every swap is the operator's: how a policy stands beside the fallback must add none.
    let laboratory = laboratory("policy.active = \"default\"\npolicy.when_behind = \"fly\"");
    let started = Instant::now();
    for round in 0..count {
        let name = ["fallback", "default"][round % 2];
        let (reply, status) = laboratory.ask_json(&["swap", name]);
        assert_eq!(status, Some(0), "{reply}");
        let other = if round % 2 == 0 { "previous" } else { "active" };
        wait_for(&laboratory, "default", other, |e| e["state"] == other);
    }
    let seconds = started.elapsed().as_secs_f64();
    let closed = laboratory.close();
    closed.check_replay();
    let ticks = closed.ticks();
    check_ticks(&ticks);
    let last = ticks.iter().map(|t| t.swap_id).max().unwrap_or(0) as usize;
    println!("{last} swaps in {} ticks, {seconds:.0} s", ticks.len());
    assert_eq!(last, count);
}

/// Tests of the thorough tier (docs/testing.md).
mod thorough {
    use super::*;

    /// A dozen swaps between two policies that have both been active, under the eyes of the recording.
    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn a_dozen_swaps_lose_no_tick_and_move_no_duty_too_far() {
        swaps(12);
    }

    /// Nothing tells the daemon of a change: it looks, as it must where the folder lies on another machine.
    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn what_a_folder_does_not_tell_is_found_all_the_same() {
        let laboratory = laboratory("policy.active = \"fallback\"");
        let (_, sound) = corpus::trained().into_iter().find(|(name, _)| name == "default").unwrap();
        let file = policy(&laboratory, "slow");
        // A copy that stands still for longer than the folder is read twice, and goes on.
        std::fs::write(&file, &sound[..sound.len() / 3]).unwrap();
        wait_for(&laboratory, "slow", "seen", |e| e["state"] == "checking");
        std::thread::sleep(Duration::from_secs(4));
        let entry = wait_for(&laboratory, "slow", "seen", |_| true);
        assert_eq!(entry["state"], "checking", "half of a file is no policy yet, and not a bad one: {entry}");
        std::fs::OpenOptions::new().append(true).open(&file).unwrap().write_all(&sound[sound.len() / 3..]).unwrap();
        wait_for(&laboratory, "slow", "passed", |e| e["state"] == "passed");
        // Other content of the same length and date, in the same file.
        let date = std::fs::metadata(&file).unwrap().modified().unwrap();
        let mut other = sound.clone();
        other[0] ^= 0xFF;
        std::fs::write(&file, &other).unwrap();
        std::fs::File::options().write(true).open(&file).unwrap().set_modified(date).unwrap();
        wait_for(&laboratory, "slow", "refused", |e| e["state"] == "refused");
        // A sound one renamed over it, and once more while it controls: what is the same is not examined again.
        publish(&laboratory, "slow", &sound);
        wait_for(&laboratory, "slow", "passed", |e| e["state"] == "passed");
        assert!(!laboratory.folder.join("policies/slow.onnx.refused.json").exists());
        assert_eq!(laboratory.ask_json(&["swap", "slow"]).1, Some(0));
        publish(&laboratory, "slow", &sound);
        std::thread::sleep(Duration::from_secs(3));
        let (reply, _) = laboratory.ask_json(&["policies"]);
        let names: Vec<&str> =
            reply["policies"].as_array().unwrap().iter().filter_map(|e| e["name"].as_str()).collect();
        assert_eq!(names, ["fallback", "slow"], "{reply}");
        check_ticks(&laboratory.close().ticks());
    }
}
