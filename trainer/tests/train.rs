//! `trainer train` from the outside: the same bytes whatever happens in between, and plain words when it cannot go on.

// What fails here fails the test, helper functions included.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod program;

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use program::{Folder, refused, run, sound, trainer};

/// A run that is over in a second: small networks, episodes of one second (400 steps).
const SMALL: &str = "[run]\nsteps = 2400\nrandom_steps = 400\nevaluate_every_steps = 1200\n\
    checkpoint_every_steps = 800\nkeep_best = true\n[policy]\nhidden = [32, 32]\nfeatures = \"errors\"\n[sac]\nbatch = 32\nreplay = 2000\n\
    [rig]\ntrained_on = \"RIG\"\nmodel = \"RIG\"\nevaluated_on = [\"RIG\"]\n[environment]\nepisode_s = 1.0\n";

/// Trains with the small settings into `run`, which must end well.
#[track_caller]
fn trained(folder: &Folder, run: &str, more: &[&str]) -> String {
    let (config, out) = (folder.settings("small.toml", SMALL), folder.path(run));
    sound([&["train", "--config", &config, "--out", &out], more].concat());
    out
}

fn policy(run: &str) -> Vec<u8> {
    std::fs::read(Path::new(run).join("policy.bin")).unwrap()
}

#[test]
fn stopping_and_going_on_and_threads_change_no_bit() {
    let folder = Folder::new("resume");
    let straight = trained(&folder, "straight", &["--threads", "1"]);
    // Two thirds into an episode of 400 steps, and between two planned points of the curve.
    let parted = trained(&folder, "parted", &["--threads", "2", "--steps", "1064"]);
    sound(["train", "--resume", &parted, "--steps", "1800", "--threads", "2"]);
    sound(["train", "--resume", &parted, "--steps", "2400", "--threads", "1"]);
    let curve = |run: &str| {
        let text = std::fs::read_to_string(Path::new(run).join("metrics.jsonl")).unwrap();
        let point = |line: &str| {
            let mut point: serde_json::Value = serde_json::from_str(line).unwrap();
            // What the machine did meanwhile.
            for key in ["wall_s", "steps_per_s", "environment_share"] {
                point.as_object_mut().unwrap().remove(key).unwrap();
            }
            point
        };
        text.lines().map(point).collect::<Vec<_>>()
    };
    assert_eq!(curve(&straight), curve(&parted));
    assert_eq!(policy(&straight), policy(&parted));
    let onnx = |run: &str| std::fs::read(Path::new(run).join("policy.onnx")).unwrap();
    assert_eq!(onnx(&straight), onnx(&parted));
    let other = trained(&folder, "other", &["--threads", "1", "--seed", "2"]);
    assert_ne!(policy(&straight), policy(&other));
    for file in ["settings.toml", "rig.toml", "model.toml", "metrics.jsonl", "report.html", "summary.json"] {
        assert!(Path::new(&straight).join(file).metadata().unwrap().len() > 50, "{file}");
    }
}

/// A run that was published without its policy.bin (as those under docs/runs) is the policy that was trained, bit for bit.
#[test]
fn a_published_policy_is_the_one_that_was_trained() {
    let folder = Folder::new("published");
    let run = trained(&folder, "run", &["--threads", "1"]);
    let (before, after) = (folder.path("before.onnx"), folder.path("after.onnx"));
    sound(["export", &run, "--out", &before]);
    std::fs::remove_file(Path::new(&run).join("policy.bin")).unwrap();
    sound(["export", &run, "--out", &after]);
    assert_eq!(std::fs::read(&before).unwrap(), std::fs::read(&after).unwrap());
    let out = folder.path("table");
    let flight = ["--rig", "dual_pressure", "--drawn", "0", "--seconds", "6", "--seeds", "1", "--without-limit"];
    sound([&["evaluate", "ablation", "--runs", &folder.path(""), "--out", &out], flight.as_slice()].concat());
    let settings = Path::new(&run).join("settings.toml");
    let copy = folder.path("copy");
    std::fs::create_dir(&copy).unwrap();
    for file in ["policy.onnx", "settings.toml"] {
        std::fs::copy(Path::new(&run).join(file), Path::new(&copy).join(file)).unwrap();
    }
    let line =
        refused([&["evaluate", "ablation", "--runs", &folder.path(""), "--out", &out], flight.as_slice()].concat());
    assert!(line.contains("once more (seed 1)") && line.contains("take one of the two folders away"), "{line}");
    // Settings that were kept without a policy are named, with the command that trains them anew.
    std::fs::remove_file(Path::new(&copy).join("policy.onnx")).unwrap();
    let told = program::run(
        [&["evaluate", "ablation", "--runs", &folder.path(""), "--out", &out], flight.as_slice()].concat(),
    );
    assert_eq!(told.status, 0, "{}", told.err);
    let line = told.err.lines().find(|line| line.contains("kept without their policies")).unwrap();
    assert!(
        line.contains("copy") && line.contains("trainer train --config") && line.contains("settings.toml"),
        "{line}"
    );
    std::fs::remove_dir_all(&copy).unwrap();
    let text = std::fs::read_to_string(&settings).unwrap();
    std::fs::write(&settings, text.replace("\nseed = ", "\nseed = 7")).unwrap();
    let line = refused(["export", &run, "--out", &after]);
    assert!(line.contains("policy.onnx") && line.contains("seed") && line.contains("two runs"), "{line}");
}

/// Signals at several moments of a long run: within two seconds there is a checkpoint, and going on from it leads to the
/// very policy of a run that was never stopped.
#[test]
fn an_interrupt_keeps_everything_within_two_seconds() {
    let folder = Folder::new("interrupt");
    let config = folder.settings("small.toml", SMALL.replace("episode_s = 1.0", "episode_s = 20.0"));
    let out = folder.path("run");
    let mut args = vec!["train", "--config", &config, "--steps", "400000", "--out", &out];
    let mut reached = 0;
    for (signal, expected, wait_ms) in [("-INT", 130, 300), ("-TERM", 143, 900), ("-INT", 130, 1500)] {
        let mut child = trainer().args(&args).stderr(Stdio::null()).stdout(Stdio::null()).spawn().unwrap();
        let settings = Path::new(&out).join("settings.toml");
        let patience = Instant::now() + Duration::from_secs(60);
        while !settings.exists() && Instant::now() < patience {
            std::thread::sleep(Duration::from_millis(10));
        }
        std::thread::sleep(Duration::from_millis(wait_ms));
        Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
        let asked = Instant::now();
        let status = child.wait().unwrap();
        let took = asked.elapsed();
        assert_eq!(status.code(), Some(expected), "what was stopped before its end is not done: {status}");
        assert!(took < Duration::from_secs(2), "{took:?}");
        let summary = std::fs::read_to_string(Path::new(&out).join("summary.json")).unwrap();
        let steps = serde_json::from_str::<serde_json::Value>(&summary).unwrap()["steps"].as_u64().unwrap();
        assert!(steps >= reached && steps < 400_000, "{steps}");
        reached = steps;
        args = vec!["train", "--resume", &out];
    }
    let until = (reached + 808).to_string();
    sound(["train", "--resume", &out, "--steps", &until]);
    let straight = folder.path("straight");
    sound(["train", "--config", &config, "--out", &straight, "--steps", &until]);
    assert_eq!(policy(&out), policy(&straight));
}

/// A short run has a curve: a point before its first step, the fallback beside it, and a page that shows both.
#[test]
fn a_short_run_has_a_curve_with_the_fallback_in_it() {
    let folder = Folder::new("curve");
    let run = trained(&folder, "run", &["--steps", "480"]);
    let text = std::fs::read_to_string(Path::new(&run).join("metrics.jsonl")).unwrap();
    let steps: Vec<u64> = text
        .lines()
        .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap()["step"].as_u64().unwrap())
        .collect();
    assert_eq!(steps, [0, 480]);
    let summary = std::fs::read_to_string(Path::new(&run).join("summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
    // What the fallback reaches on the ideal rig, docs/performance.md: 0.079/0.013.
    let fallback = summary["fallback"][0]["rmse_kpa"][0].as_f64().unwrap();
    assert!((0.07..0.09).contains(&fallback), "{fallback}");
    let page = std::fs::read_to_string(Path::new(&run).join("report.html")).unwrap();
    assert!(page.contains(&format!("{}, fallback", folder.path("coarse.toml"))));
}

#[test]
fn bad_configuration_is_told_in_one_line_and_leaves_nothing() {
    let folder = Folder::new("bad-training");
    let small = folder.settings("small.toml", SMALL);
    let key = folder.with("key.toml", "[sac]\nlerning_rate = 1e-3\n");
    let nan = folder.with("nan.toml", "[caps]\ntemporal = nan\n");
    let valve_x =
        "[[environment.mechanisms]]\nid = \"valve_lag\"\ncomponent = \"valve_x\"\ntime_constant_ms = [1.0, 2.0]\n";
    let mechanism = folder.with("mechanism.toml", valve_x);
    let valveless =
        folder.with("valveless.toml", without_valves(model::rig::Rig::builtin_text("dual_pressure").unwrap()));
    let out = folder.path("run");
    let told = |args: &[&str], words: &[&str]| {
        let said = refused([&["train"], args].concat());
        assert_eq!(said.lines().count(), 1, "{said}");
        for word in words {
            assert!(said.contains(word), "{args:?}: `{word}` is not in: {said}");
        }
    };
    told(&["--out", &out, "--config", &key], &["key.toml", "line 2", "lerning_rate"]);
    told(&["--out", &out, "--config", &nan], &["caps.temporal", "NaN"]);
    told(&["--out", &out, "--config", &mechanism], &["environment.mechanisms[0]", "valve_x"]);
    told(&["--out", &out, "--config", "no_such"], &["no_such", "correction"]);
    told(&["--out", &out, "--config", &small, "--rig", &valveless], &["valveless", "valve"]);
    told(&["--resume", &out], &["checkpoint.bin", "--resume"]);
    assert!(!Path::new(&out).exists(), "nothing is left behind");
    let old = folder.path("old");
    std::fs::create_dir(&old).unwrap();
    std::fs::write(Path::new(&old).join("policy.onnx"), "an older one").unwrap();
    told(&["--config", &small, "--out", &old], &["old", "policy.onnx", "another folder"]);
    let file = folder.with("file", "");
    told(&["--config", &small, "--out", &format!("{file}/run")], &["file"]);
    told(&["--config", &small, "--out", &out, "--model", "no_such"], &["no_such"]);
    let begun = trained(&folder, "run", &["--steps", "800"]);
    told(&["--config", &small, "--out", &begun], &["run", "--resume"]);
    // An end that it is past would stand in its settings, which make the run again.
    let settings = || std::fs::read_to_string(Path::new(&begun).join("settings.toml")).unwrap();
    let before = settings();
    told(&["--resume", &begun, "--steps", "792"], &["800 steps are done already", "--steps 792", "give 800 or more"]);
    assert!(settings() == before && before.contains("steps = 800\n"), "{before} {}", settings());
    let checkpoint = Path::new(&begun).join("checkpoint.bin");
    let mut bytes = std::fs::read(&checkpoint).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&checkpoint, bytes).unwrap();
    told(&["--resume", &begun], &["checkpoint.bin"]);
}

fn without_valves(text: &str) -> String {
    let mut keep = true;
    let kept = text.lines().filter(|line| {
        if line.starts_with('[') {
            keep = !line.starts_with("[valves");
        }
        keep
    });
    kept.collect::<Vec<_>>().join("\n").replace("name = \"dual_pressure\"", "name = \"valveless\"")
}

/// A file that cannot grow stands in for a full disk: writing fails in the middle of a checkpoint.
#[test]
fn a_full_disk_is_told_and_the_old_checkpoint_is_kept() {
    let folder = Folder::new("full");
    let begun = trained(&folder, "run", &["--steps", "800"]);
    let checkpoint = Path::new(&begun).join("checkpoint.bin");
    let before = std::fs::read(&checkpoint).unwrap();
    let program = env!("CARGO_BIN_EXE_trainer");
    let limited = format!("trap '' XFSZ; ulimit -f 64; exec {program} train --resume {begun} --steps 2400");
    let done = Command::new("sh").args(["-c", &limited]).output().unwrap();
    let said = String::from_utf8_lossy(&done.stderr).into_owned();
    assert_eq!(done.status.code(), Some(1), "{said}");
    let last = said.lines().last().unwrap();
    assert!(last.contains(&begun) && last.contains("writing"), "{said}");
    assert_eq!(std::fs::read(&checkpoint).unwrap(), before);
    let names = std::fs::read_dir(&begun).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned());
    let left: Vec<String> = names.filter(|name| name.contains("tmp") || name.starts_with('.')).collect();
    assert!(left.is_empty(), "{left:?}");
}

/// Tests of the thorough tier (docs/testing.md).
mod thorough {
    use super::*;

    /// Tracking by a policy that starts from nothing: within a few thousand steps it must beat what it started as by far.
    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn a_small_run_learns() {
        let folder = Folder::new("learns");
        let learns = SMALL
            .replace("hidden = [32, 32]", "hidden = [64, 64]")
            .replace("batch = 32", "batch = 64")
            .replace("replay = 2000", "replay = 20000")
            .replace("steps = 2400", "steps = 12000")
            .replace("evaluate_every_steps = 1200", "evaluate_every_steps = 2000")
            .replace("episode_s = 1.0", "episode_s = 5.0\nduty_low = 0.5");
        let (config, out) = (folder.settings("learns.toml", learns), folder.path("run"));
        sound(["train", "--config", &config, "--out", &out]);
        let text = std::fs::read_to_string(Path::new(&out).join("metrics.jsonl")).unwrap();
        let rmse: Vec<f64> = text
            .lines()
            .map(|line| {
                serde_json::from_str::<serde_json::Value>(line).unwrap()["evaluated"][0]["rmse_kpa"][0]
                    .as_f64()
                    .unwrap()
            })
            .collect();
        println!("positive RMSE over the run: {rmse:?} kPa");
        assert!(rmse[rmse.len() - 1] < 0.4 * rmse[0], "{rmse:?}");
    }

    /// A run that starts from a policy of a run, or from the file that was exported from it, starts as that policy; critics
    /// learn first. Those of the run go along with its folder, and a temperature that trying has not yet brought down does not.
    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn a_run_starts_from_a_policy() {
        let folder = Folder::new("from");
        let first = trained(&folder, "first", &["--steps", "1200"]);
        let onnx = Path::new(&first).join("policy.onnx").display().to_string();
        let points = |run: &str| -> Vec<serde_json::Value> {
            let text = std::fs::read_to_string(Path::new(run).join("metrics.jsonl")).unwrap();
            text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
        };
        let figures = |run: &str, line: usize| points(run)[line]["evaluated"].clone();
        let temperature = |run: &str| points(run).last().unwrap()["temperature"].as_f64().unwrap();
        // The best policy is what starts, so the curve begins with what the summary of the first run says.
        let summary = std::fs::read_to_string(Path::new(&first).join("summary.json")).unwrap();
        let kept = serde_json::from_str::<serde_json::Value>(&summary).unwrap()["evaluated"].clone();
        for (name, from) in [("folder", &first), ("file", &onnx)] {
            let config = folder.settings("small.toml", SMALL.replace("hidden = [32, 32]", "hidden = [64, 64]"));
            let out = folder.path(name);
            let said = run(["train", "--config", &config, "--out", &out, "--steps", "480", "--from", from]);
            assert_eq!(said.status, 0, "{}", said.err);
            let start = if name == "folder" { "policy and critics from" } else { "policy from" };
            assert!(said.err.lines().next().unwrap().contains(&format!("{start} {from}")), "{}", said.err);
            assert_eq!(figures(&out, 0), kept, "{name}");
            // 480 steps of warm-up: the critics alone have learned.
            assert_eq!(figures(&out, 1), kept, "{name}");
            // Of the run: what it had come down to at its end, below the mean of its last part; of a file no more than 0.01.
            let (begins_at, mean) = (temperature(&out), temperature(&first));
            let expected = if name == "folder" { 0.8 * mean..mean } else { 0.009_99..0.010_01 };
            assert!(expected.contains(&begins_at), "{name}: {begins_at}, {mean} before");
        }
        // Critics that were taught another reward say nothing about this one.
        let other = SMALL.replace("hidden = [32, 32]", "hidden = [64, 64]") + "\n[environment.reward]\nlast = -0.5\n";
        let config = folder.settings("other.toml", other);
        let said =
            run(["train", "--config", &config, "--out", &folder.path("other"), "--steps", "480", "--from", &first]);
        assert!(said.status == 0 && said.err.contains(&format!("; policy from {first}")), "{}", said.err);
        let told = refused(["train", "--out", &folder.path("x"), "--from", &folder.with("no.onnx", "text")]);
        assert!(told.contains("no.onnx"), "{told}");
    }

    /// Two signals, one right behind the other: the second does not take the checkpoint of the first away.
    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn a_second_interrupt_loses_nothing() {
        let folder = Folder::new("twice");
        let (config, out) = (folder.settings("small.toml", SMALL), folder.path("run"));
        let mut child = trainer()
            .args(["train", "--config", &config, "--steps", "400000", "--out", &out])
            .stderr(Stdio::null())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        let metrics = Path::new(&out).join("metrics.jsonl");
        let patience = Instant::now() + Duration::from_secs(60);
        let points = || std::fs::read_to_string(&metrics).map_or(0, |text| text.lines().count());
        while points() < 2 && Instant::now() < patience {
            std::thread::sleep(Duration::from_millis(5));
        }
        for _ in 0..2 {
            Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
            // Two within one look at the signals would count as one.
            std::thread::sleep(Duration::from_millis(50));
        }
        // It may end by the second signal or by itself; either way nothing is lost, and nothing half-written is left.
        assert_eq!(child.wait().unwrap().code(), Some(130));
        let names = std::fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let aside: Vec<String> = names.filter(|name| name.starts_with('.')).collect();
        assert!(aside.is_empty(), "{aside:?}");
        sound(["train", "--resume", &out, "--steps", "1600"]);
        let straight = trained(&folder, "straight", &["--steps", "1600"]);
        assert_eq!(policy(&out), policy(&straight));
    }
}
