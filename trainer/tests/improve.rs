//! `trainer improve` from the outside: it makes a policy better, the same bytes whatever happens in between.

// What fails here fails the test, helper functions included.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod program;

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use program::{Folder, refused, run, sound};

/// Two rounds of some seconds, on the rig as it is.
const SMALL: &str = "[policy]\ncontract = 2\nfeatures = \"errors\"\nplan = \"fitted\"\nhidden = [32, 32]\n\
    [rig]\ntrained_on = \"RIG\"\nmodel = \"RIG\"\nevaluated_on = [\"RIG\"]\n[environment]\nepisode_s = 4.0\nwarm_up_s = 0.5\ncorrection_duty = 0.06\n\
    [rollouts]\nrounds = 3\nepisodes = 2\nepisode_s = 5.0\nbranch_every_ticks = 40\n";

fn shipped() -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../controller/policies/default.onnx").display().to_string()
}

fn bytes(run: &str, file: &str) -> Vec<u8> {
    std::fs::read(Path::new(run).join(file)).unwrap()
}

fn summary(run: &str) -> serde_json::Value {
    serde_json::from_slice(&bytes(run, "summary.json")).unwrap()
}

#[test]
fn stopping_and_going_on_and_threads_change_no_bit() {
    let folder = Folder::new("improve");
    let config = folder.settings("small.toml", SMALL);
    let straight = folder.path("straight");
    sound(["improve", "--config", &config, "--threads", "1", "--out", &straight]);
    let whole = folder.path("whole");
    let checkpoint = || std::fs::read(Path::new(&whole).join("checkpoint.bin")).ok();
    // Before anything is scored, and again behind that.
    interrupted(&["improve", "--config", &config, "--threads", "2", "--out", &whole], &|| checkpoint().is_some());
    assert!(!Path::new(&whole).join("summary.json").exists(), "nothing is scored yet");
    let began = checkpoint();
    interrupted(&["improve", "--resume", &whole, "--threads", "2"], &|| checkpoint() != began);
    assert!(summary(&whole)["rounds"].as_u64().unwrap() < 3, "{}", summary(&whole));
    assert_eq!(summary(&whole)["evaluated"], serde_json::json!([]), "nothing is run on the paper's reference");
    assert!(bytes(&whole, "policy.onnx").len() > 50);
    sound(["improve", "--resume", &whole, "--threads", "1"]);
    for file in ["policy.bin", "policy.onnx"] {
        assert_eq!(bytes(&straight, file), bytes(&whole, file), "{file}");
    }
    for file in ["settings.toml", "rig.toml", "model.toml", "report.html", "summary.json"] {
        assert!(bytes(&straight, file).len() > 50, "{file}");
    }
    // An end that it is past would stand in its settings, which make the run again.
    let settings = bytes(&straight, "settings.toml");
    let told = refused(["improve", "--resume", &straight, "--rounds", "2"]);
    assert!(told.contains("3 rounds are done already") && told.contains("--rounds 2"), "{told}");
    assert_eq!(bytes(&straight, "settings.toml"), settings, "what was refused is not planned");
}

/// Runs `trainer` and interrupts it as soon as it `is_due`; it was stopped, and its exit status says so.
fn interrupted(args: &[&str], is_due: &dyn Fn() -> bool) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_trainer"))
        .args(args)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let begun = Instant::now();
    while !is_due() {
        assert!(begun.elapsed() < Duration::from_secs(120), "no checkpoint");
        std::thread::sleep(Duration::from_millis(5));
    }
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
}

/// From the fallback's own answers, on the rig that the model is: the negative valve's delay of a tick that its PI loop does not
/// foresee, and noise that it passes on, leave something for a policy, and two rounds find some of it.
#[test]
fn two_rounds_track_better_than_the_fallback() {
    let folder = Folder::new("better");
    let out = folder.path("run");
    let config = folder.settings(
        "settings.toml",
        "[run]\nseed = 3\n[policy]\ncontract = 2\nfeatures = \"errors\"\nplan = \"fitted\"\nhidden = [64, 64]\n\
         [rig]\ntrained_on = \"RIG\"\nmodel = \"RIG\"\nevaluated_on = [\"RIG\"]\n[environment]\nepisode_s = 20.0\nwarm_up_s = 4.0\ncorrection_duty = 0.06\n\
         [rollouts]\nrounds = 2\nepisodes = 2\nepisode_s = 12.0\nlearning_rate = 0.001\n",
    );
    let said = run(["improve", "--config", &config, "--out", &out, "--json"]);
    assert_eq!(said.status, 0, "{}", said.err);
    let summary: serde_json::Value = serde_json::from_str(&said.out).unwrap();
    let kept = summary["kept"]["score_kpa"].as_f64().unwrap();
    let began = summary["curve"][0]["score_kpa"].as_f64().unwrap();
    assert!(kept < 0.97 * began, "{kept} from {began}: {summary}");
    // What it wrote is a policy of ours.
    sound(["export", &out, "--out", &folder.path("again.onnx")]);
}

#[test]
fn what_cannot_be_improved_is_refused_before_any_work() {
    let folder = Folder::new("refused");
    let out = folder.path("out");
    let no_start = refused(["improve", "--config", "paper", "--out", &out]);
    assert!(no_start.contains("--from POLICY"), "{no_start}");
    let text = folder.with("no.onnx", "text");
    let no_policy = refused(["improve", "--from", &text, "--out", &out]);
    assert!(no_policy.contains("no.onnx"), "{no_policy}");
    let wrong = folder.with("wrong.toml", "[rollouts]\nshift = 2.0\n");
    let range = refused(["improve", "--config", &wrong, "--from", &shipped(), "--out", &out]);
    assert!(range.contains("rollouts.shift = 2") && range.contains("wrong.toml"), "{range}");
    assert!(!Path::new(&out).exists(), "nothing is left of what was refused");
    // A run of another command is none of this one's, and the other way round.
    let other = folder.path("trained");
    std::fs::create_dir(&other).unwrap();
    std::fs::write(Path::new(&other).join("checkpoint.bin"), b"DPRUN004 and more").unwrap();
    let told = refused(["improve", "--resume", &other]);
    assert!(told.contains("trainer improve") && told.contains("checkpoint.bin"), "{told}");
}
