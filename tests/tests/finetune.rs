//! `trainer finetune` on recordings of the daemon: the observations that the policy was shown, to the bit; the same policy
//! from the same recordings, however they were learned from; and beside a daemon that takes what is published.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use serde_json::Value;
use tests::Stream::Err;
use tests::laboratory::Plan;
use tests::{Folder, Running, finish, program, root};

/// Generous: how long anything may take on a machine that does other things as well.
const SOON: Duration = Duration::from_secs(300);

fn shipped() -> PathBuf {
    root().join("controller/policies/default.onnx")
}

/// A folder of recordings with one flight of the demo in lockstep.
fn recorded(folder: &Folder, arguments: &[&str]) -> PathBuf {
    let out = folder.join("recordings");
    let mut command = Command::new(program("controller"));
    command.args(["demo", "--fast", "--out"]).arg(&out).args(arguments);
    let ended = Running::start(&mut command).wait(SOON);
    assert!(out.join("flight.mcap").is_file(), "{ended:?}");
    out
}

/// A run on those recordings: small, two updates a tick.
fn finetune(folder: &Folder, recordings: &Path, out: &str, more: &[&str]) -> Value {
    let publish = folder.join(&format!("{out}-published"));
    std::fs::create_dir_all(&publish).unwrap();
    let mut command = Command::new(program("trainer"));
    command.args(["finetune", "--offline", "--json"]);
    let has = |key: &str| more.contains(&key);
    let small = ["--updates-per-tick", "2", "--warm-up", "100"];
    command.args(if has("--warm-up") { &[][..] } else { &small });
    command.arg("--recordings").arg(recordings).arg("--publish").arg(&publish).arg("--out").arg(folder.join(out));
    command.args(more);
    if !has("--from") {
        command.arg("--from").arg(shipped());
    }
    json(&mut command)
}

fn resume(folder: &Folder, out: &str, steps: &str) -> Value {
    let mut command = Command::new(program("trainer"));
    json(command.args(["finetune", "--offline", "--json", "--steps", steps, "--resume"]).arg(folder.join(out)))
}

fn json(command: &mut Command) -> Value {
    let ended = Running::start(command).wait(SOON);
    assert_eq!(ended.status, Some(0), "{ended:?}");
    serde_json::from_str(&ended.stdout).unwrap_or_else(|error| panic!("{error}: {ended:?}"))
}

fn policy(folder: &Folder, out: &str) -> Vec<u8> {
    std::fs::read(folder.join(out).join("policy.onnx")).unwrap()
}

/// Two runs that differ in their seed publish into one folder: neither replaces what the other has published. And a run
/// that is over tells the same figures when it is gone on with, and cannot be planned to end before where it stands.
#[test]
fn two_runs_publish_side_by_side_and_a_finished_one_tells_its_figures_again() {
    let folder = Folder::new();
    let recordings = recorded(&folder, &["--seconds", "14", "--policy", "fallback"]);
    let publish = folder.join("published");
    std::fs::create_dir(&publish).unwrap();
    let learn = |out: &str, seed: &str| {
        let mut command = Command::new(program("trainer"));
        command.args(["finetune", "--offline", "--json", "--hold-plan", "--updates-per-tick", "1", "--warm-up", "100"]);
        command.args(["--steps", "400", "--seed", seed, "--from"]).arg(shipped()).arg("--recordings").arg(&recordings);
        json(command.arg("--publish").arg(&publish).arg("--out").arg(folder.join(out)))
    };
    let (first, second) = (learn("one", "1"), learn("other", "2"));
    assert_ne!(first["last_published"], second["last_published"], "{first} {second}");
    assert_eq!(folder.names("published").len(), 2);
    for (run, summary) in [("one", &first), ("other", &second)] {
        let name = summary["last_published"].as_str().unwrap();
        assert_eq!(
            std::fs::read(publish.join(name)).unwrap(),
            std::fs::read(folder.join(run).join("policy.onnx")).unwrap()
        );
    }

    let again = resume(&folder, "one", "400");
    for figure in ["last_published", "published", "steps", "steps_planned", "updates"] {
        assert_eq!(again[figure], first[figure], "{figure}: {again} {first}");
    }
    for channel in 0..2 {
        let [now, then] = [&again, &first].map(|summary| summary["rmse_kpa"][channel].as_f64().unwrap());
        assert!(then > 0.0 && (now - then).abs() < 1e-9, "{again} {first}");
        // Measured: 0.25/0.05 kPa; with the approach in it several kPa.
        assert!(then < 1.0 && second["rmse_kpa"][channel] == first["rmse_kpa"][channel], "{first} {second}");
    }
    // Of 400 ticks the first 250 are the approach.
    assert_eq!((&first["rmse_over_s"], &again["rmse_over_s"]), (&Value::from(3.0), &Value::from(3.0)), "{first}");
    let mut shorter = Command::new(program("trainer"));
    shorter.args(["finetune", "--offline", "--steps", "150", "--resume"]).arg(folder.join("one"));
    let ended = finish(&mut shorter);
    assert_eq!(ended.status, Some(2), "{ended:?}");
    assert!(ended.stderr.contains("400 ticks have been learned from already"), "{}", ended.stderr);
    let settings = std::fs::read_to_string(folder.join("one/finetune.toml")).unwrap();
    assert!(settings.contains("steps = 400"), "what was refused is not planned: {settings}");
}

/// Flights of the fallback count as a policy that corrects nothing; those of a vented rig are left out.
#[test]
fn the_fallback_is_learned_from_and_faults_part_the_trajectory() {
    let folder = Folder::new();
    let faults = folder.write(
        "faults.toml",
        "[[fault]]\nkind = \"sensor\"\nsensor = \"positive\"\neffect = \"broken_wire\"\nticks = [300, 301]\n",
    );
    let demo = ["--seconds", "9", "--policy", "fallback", "--faults", faults.to_str().unwrap()];
    let recordings = recorded(&folder, &demo);
    let summary = finetune(&folder, &recordings, "out", &[]);
    let (ticks, steps) = (summary["tally"]["ticks"].as_u64().unwrap(), summary["steps"].as_u64().unwrap());
    let vented = summary["tally"]["left_out"]["not running"].as_u64().unwrap();
    assert!(steps > 150 && vented > 100 && steps + vented <= ticks, "{summary}");
    assert_eq!(summary["tally"]["left_out"].get("not explained by the recorded model"), None, "{summary}");
}

#[test]
fn nothing_to_learn_and_wrong_folders_are_told_in_a_line() {
    let folder = Folder::new();
    let run = |recordings: &Path, publish: &Path| {
        let mut command = Command::new(program("trainer"));
        command.args(["finetune", "--offline", "--from"]).arg(shipped()).arg("--recordings").arg(recordings);
        finish(command.arg("--publish").arg(publish).arg("--out").arg(folder.join("run")))
    };
    let empty = folder.join("empty");
    std::fs::create_dir(&empty).unwrap();
    let ended = run(&empty, &folder.join("nowhere"));
    assert_eq!(ended.status, Some(2), "{ended:?}");
    assert!(ended.stderr.contains("nowhere: is no folder"), "{}", ended.stderr);
    let ended = run(&empty, &empty);
    assert_eq!(ended.status, Some(1), "{ended:?}");
    assert!(ended.stderr.contains("no tick to learn from in 0 ticks"), "{}", ended.stderr);
    assert!(!folder.join("run").exists(), "no empty run is left behind");
    std::fs::write(empty.join("run-1.csv"), "time_s,u_pos,u_neg\n").unwrap();
    let ended = run(&empty, &empty);
    assert_eq!(ended.status, Some(1), "{ended:?}");
    for words in ["*.mcap", "but CSV files"] {
        assert!(ended.stderr.contains(words), "{words}: {}", ended.stderr);
    }
}

/// Beside a daemon in lockstep: it follows the recording that is being written, the daemon takes in what it publishes, a
/// SIGTERM leaves a checkpoint, and the recordings alone come to the same policy.
#[test]
fn beside_a_daemon_it_follows_publishes_stops_and_comes_to_the_same_offline() {
    let plan = Plan::new("control.auto_arm = true");
    std::fs::create_dir(plan.folder.join("policies")).unwrap();
    let laboratory = plan.start();
    let folder = &laboratory.folder;
    let arguments =
        ["--updates-per-tick", "1", "--warm-up", "100", "--publish-every", "300", "--steps", "100000", "--hold-plan"];
    let mut command = Command::new(program("trainer"));
    command.args(["finetune", "--out"]).arg(folder.join("beside")).arg("--from").arg(shipped()).args(arguments);
    command.arg("--recordings").arg(folder.join("recordings")).arg("--publish").arg(folder.join("policies"));
    let beside = Running::start(&mut command);
    let said = beside.line(Err, "-000300.onnx", SOON);
    let name = said.rsplit('/').next().unwrap().trim_end_matches(".onnx").to_owned();
    laboratory.daemon.line(Err, &name, SOON);
    beside.terminate();
    let ended = beside.wait(SOON);
    assert_eq!(ended.status, Some(143), "{ended:?}");
    assert!(ended.stdout.contains("go on with"), "{}", ended.stdout);
    let folder = laboratory.close().folder;

    let offline =
        ["--updates-per-tick", "1", "--warm-up", "100", "--publish-every", "300", "--steps", "300", "--hold-plan"];
    finetune(&folder, &folder.join("recordings"), "again", &offline);
    let read = |path: &str| std::fs::read(folder.join(path)).unwrap();
    // The same policy from the same settings has the same name.
    assert_eq!(read(&format!("again-published/{name}.onnx")), read(&format!("policies/{name}.onnx")));
}

/// Tests of the thorough tier (docs/testing.md).
mod thorough {
    use super::*;

    /// From a run's folder its transitions are remembered beside the rig's, also by whoever goes on later.
    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn what_a_run_remembers_goes_along_in_one_sitting_or_two() {
        let folder = Folder::new();
        let recordings = recorded(&folder, &["--seconds", "14", "--policy", "fallback"]);
        let run = folder.join("run");
        let mut train = Command::new(program("trainer"));
        let small = "[run]\nsteps = 800\nrandom_steps = 400\n[rig]\nevaluated_on = [\"dual_pressure\"]\n\
                     [policy]\ncontract = 2\nhidden = [32, 32]\n[sac]\nbatch = 128\nreplay = 2000\n[environment]\nepisode_s = 1.0\n";
        train.args(["train", "--config"]).arg(folder.write("small.toml", small)).arg("--out").arg(&run);
        let ended = Running::start(&mut train).wait(SOON);
        assert_eq!(ended.status, Some(0), "{ended:?}");
        let from = run.to_string_lossy().into_owned();
        let learn = |out: &str, steps: &str| {
            finetune(&folder, &recordings, out, &["--from", &from, "--steps", steps, "--hold-plan", "--threads", "1"])
        };
        let summary = learn("straight", "300");
        // A whole batch is there from the first tick on.
        assert_eq!((&summary["steps"], &summary["updates"]), (&Value::from(300), &Value::from(600)), "{summary}");
        learn("parted", "170");
        resume(&folder, "parted", "300");
        assert_eq!(policy(&folder, "straight"), policy(&folder, "parted"), "two sittings");
        let settings = std::fs::read_to_string(folder.join("straight/settings.toml")).unwrap();
        assert!(settings.contains("critics_from = "), "{settings}");
    }

    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn a_flight_gives_its_observations_to_the_bit_and_one_policy_in_one_sitting_or_two() {
        let folder = Folder::new();
        // Of what ships four hundred steps beside fresh critics make a policy 1.54 times worse, which the trial refuses.
        let start = root().join("docs/runs/default/start.onnx").display().to_string();
        let recordings = recorded(&folder, &["--seconds", "14", "--policy", &start]);
        let learn = |out: &str, steps: &str, threads: &str| {
            let more = ["--from", &start, "--steps", steps, "--threads", threads, "--hold-plan"];
            finetune(&folder, &recordings, out, &more)
        };
        let summary = learn("straight", "400", "1");
        let tally = &summary["tally"];
        assert!(tally["compared_observations"].as_u64().unwrap() >= 400, "{summary}");
        assert_eq!(tally["same_observations"], tally["compared_observations"], "{summary}");
        assert_eq!((&summary["joined"], &summary["steps"]), (&Value::from(0), &Value::from(400)), "{summary}");
        assert_eq!(
            summary["updates"],
            Value::from(2 * (400 - 127)),
            "updates begin with the first whole batch: {summary}"
        );

        learn("parted", "230", "2");
        assert_ne!(policy(&folder, "straight"), policy(&folder, "parted"));
        resume(&folder, "parted", "400");
        assert_eq!(policy(&folder, "straight"), policy(&folder, "parted"), "two sittings");
        let with_settings = |out: &str| std::fs::read(folder.join(out).join("policy.bin")).unwrap();
        assert!(
            with_settings("straight") == with_settings("parted"),
            "its settings name the length that was planned last"
        );
        assert_ne!(policy(&folder, "straight"), std::fs::read(&start).unwrap());

        let published = folder.join("straight-published").join(summary["last_published"].as_str().unwrap());
        assert!(published.to_string_lossy().ends_with("-000400.onnx"), "{}", published.display());
        let ended = finish(Command::new(program("controller")).arg("check-policy").arg(&published));
        assert_eq!(ended.status, Some(0), "{ended:?}");
        let graph = onnx_file::from_onnx(&std::fs::read(published).unwrap()).unwrap();
        assert_eq!(graph.metadata["method"], "finetune");
        assert_eq!((graph.metadata["steps"].as_str(), graph.metadata["rig"].as_str()), ("400", "dual_pressure"));
    }
}
