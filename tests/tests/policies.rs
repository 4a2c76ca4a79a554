//! Policies change while the daemon runs: published into the watched directory, swapped by name, taken back; bad ones are
//! refused and say why. Three processes over real sockets: daemon, emulated cRIO, operator.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

#[path = "../../controller/admission/tests/corpus/mod.rs"]
mod corpus;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use proto::recording::read_mcap;
use serde_json::Value;
use tests::Stream::{Err, Out};
use tests::{Folder, Running, alone, finish, program};

/// Generous: how long anything may take on a machine that does other things as well.
const SOON: Duration = Duration::from_secs(120);

struct Laboratory {
    folder: Folder,
    config: PathBuf,
    rig: Running,
    daemon: Running,
}

impl Laboratory {
    /// A daemon in lockstep with an emulated rig, armed by itself, `[policy]` as given.
    fn new(policy: &str) -> Self {
        let lockstep = ["rig", "--listen", "127.0.0.1:0", "--pace", "lockstep"];
        let rig = Running::start(Command::new(program("trainer")).args(lockstep));
        let address = rig.line(Out, "listening on ", SOON).rsplit_once(' ').unwrap().1.to_owned();
        let folder = Folder::new();
        std::fs::create_dir(folder.join("policies")).unwrap();
        let config = folder.write(
            "controller.toml",
            format!(
                "[link]\naddress = \"{address}\"\npacing = \"lockstep\"\n[record]\ndirectory = \"recordings\"\nmin_free_mib = 16\n\
                 [control]\nsocket = \"s\"\nauto_arm = true\n[realtime]\nenforce = false\n[policy]\n{policy}"
            ),
        );
        let daemon = Running::start(Command::new(program("controller")).args(["run", "--config"]).arg(&config));
        daemon.line(Err, "opened", SOON);
        Laboratory { folder, config, rig, daemon }
    }

    fn ask(&self, arguments: &[&str]) -> (Value, Option<i32>) {
        let mut command = Command::new(program("controller"));
        let ended = finish(command.args(arguments).args(["--json", "--config"]).arg(&self.config));
        let reply = serde_json::from_str(&ended.stdout).unwrap_or_else(|e| panic!("{arguments:?}: {e}: {ended:?}"));
        (reply, ended.status)
    }

    /// The entry of a policy, once it is as wanted.
    fn wait_for(&self, name: &str, what: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        let until = Instant::now() + SOON;
        loop {
            let (reply, status) = self.ask(&["policies"]);
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

    fn publish(&self, name: &str, bytes: &[u8]) {
        let part = self.folder.join(&format!("policies/.{name}.part"));
        std::fs::write(&part, bytes).unwrap();
        std::fs::rename(part, self.policy(name)).unwrap();
    }

    fn policy(&self, name: &str) -> PathBuf {
        self.folder.join(&format!("policies/{name}.onnx"))
    }

    /// Ends both and answers the ticks of the recording.
    fn close(self) -> Vec<proto::recording::TickRecord> {
        self.daemon.terminate();
        let ended = self.daemon.wait(SOON);
        assert_eq!(ended.status, Some(0), "{ended:?}");
        self.rig.terminate();
        self.rig.wait(SOON);
        let names = self.folder.names("recordings");
        let recordings: Vec<&String> = names.iter().filter(|name| name.ends_with(".mcap")).collect();
        recordings
            .iter()
            .flat_map(|name| read_mcap(&self.folder.join("recordings").join(name)).unwrap().ticks)
            .collect()
    }
}

fn refusal(file: &Path) -> Value {
    let mut name = file.as_os_str().to_owned();
    name.push(".refused.json");
    serde_json::from_slice(&std::fs::read(&name).unwrap_or_else(|e| panic!("{name:?}: {e}"))).unwrap()
}

/// No tick is lost and no duty moves faster than the slew limit, whatever controls.
fn check_ticks(ticks: &[proto::recording::TickRecord]) {
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
    let _alone = alone();
    let laboratory = Laboratory::new("active = \"fallback\"\n");
    // Before anything is published nothing is there but the fallback.
    assert_eq!(laboratory.ask(&["status"]).0["running"]["policy"], "fallback");

    // Bad ones, each refused at its stage, with a file beside it that says why.
    let (_, sound) = corpus::trained().into_iter().find(|(name, _)| name == "default").unwrap();
    let networks = corpus::bad_networks();
    let network = |wanted: &str| networks.iter().find(|(name, _)| name == wanted).unwrap().1.clone();
    laboratory.publish("cut", &sound[..sound.len() / 2]);
    laboratory.publish("always_0", &network("always_0"));
    laboratory.publish("bang", &network("correct_bang_bang"));
    std::fs::write(laboratory.policy("text"), "no policy at all").unwrap();
    assert!(Command::new("mkfifo").arg(laboratory.policy("pipe")).status().unwrap().success());
    std::os::unix::fs::symlink("/dev/zero", laboratory.policy("zero")).unwrap();
    std::fs::write(laboratory.folder.join("policies/half.onnx.tmp"), &sound).unwrap();
    for (name, stage) in
        [("text", "network"), ("always_0", "answers"), ("bang", "trial"), ("pipe", "file"), ("zero", "file")]
    {
        let entry = laboratory.wait_for(name, "refused", |e| e["state"] == "refused");
        assert_eq!(entry["refusal"]["stage"], stage, "{entry}");
        assert_eq!(refusal(&laboratory.policy(name))["stage"], stage);
        let (reply, status) = laboratory.ask(&["swap", name]);
        assert_eq!(status, Some(1), "{reply}");
        assert!(reply["error"].as_str().unwrap().contains("was refused"), "{reply}");
    }
    let (reply, status) = laboratory.ask(&["swap", "nobody"]);
    assert_eq!(status, Some(1));
    assert!(reply["error"].as_str().unwrap().contains("no policy nobody"), "{reply}");

    // A good one: passed, swapped, through the stages, active.
    laboratory.publish("next", &sound);
    let entry = laboratory.wait_for("next", "passed", |e| e["state"] == "passed");
    assert!(entry["figures"]["rmse_kpa"][0].as_f64().unwrap() < 1.0, "{entry}");
    let (reply, status) = laboratory.ask(&["swap", "next"]);
    assert_eq!(status, Some(0), "{reply}");
    laboratory.wait_for("next", "active", |e| e["state"] == "active");
    let status = laboratory.ask(&["status"]).0;
    assert_eq!((&status["running"]["policy"], &status["state"]), (&"next".into(), &"run".into()), "{status}");

    // Back to the fallback by name, and to the policy again: it has been active, so half a second is enough.
    assert_eq!(laboratory.ask(&["swap", "fallback"]).1, Some(0));
    laboratory.wait_for("next", "replaced", |e| e["state"] == "previous");
    assert_eq!(laboratory.ask(&["rollback"]).1, Some(0));
    laboratory.wait_for("next", "active again", |e| e["state"] == "active");

    let audit = std::fs::read_to_string(laboratory.folder.join("recordings/policies.audit.jsonl")).unwrap();
    let swap = audit.lines().find(|line| line.contains("\"swap\"")).unwrap_or_else(|| panic!("{audit}"));
    assert!(swap.contains("uid"), "who asked is told: {swap}");
    let ticks = laboratory.close();
    check_ticks(&ticks);
    assert!(
        ticks.iter().any(|t| t.policy_stage >= 2 && t.authority > 0.0 && t.authority < 1.0),
        "the ramp is recorded"
    );
    assert!(ticks.iter().any(|t| t.swap_id == 1) && ticks.iter().any(|t| t.swap_id == 3), "so is what is in force");
}

/// `policy.follow = "newest"`: what is published and passes goes on by itself.
#[test]
fn the_newest_is_followed() {
    let _alone = alone();
    let laboratory = Laboratory::new("active = \"fallback\"\nfollow = \"newest\"\n");
    let (_, sound) = corpus::trained().into_iter().find(|(name, _)| name == "default").unwrap();
    laboratory.publish("first", &sound);
    laboratory.wait_for("first", "on its way", |e| {
        ["shadow", "ramp", "probation", "active"].iter().any(|state| e["state"] == *state)
    });
    check_ticks(&laboratory.close());
}

/// Thirty swaps between two policies that have both been active, under the eyes of the recording.
#[test]
fn thirty_swaps_lose_no_tick_and_move_no_duty_too_far() {
    swaps(30);
}

/// The same a thousand times: `cargo test --release -p tests --test policies -- --ignored a_thousand --nocapture`.
#[test]
#[ignore = "takes half an hour"]
fn a_thousand_swaps_lose_no_tick_and_move_no_duty_too_far() {
    swaps(1000);
}

fn swaps(count: usize) {
    let _alone = alone();
    let laboratory = Laboratory::new("active = \"default\"\n");
    let started = Instant::now();
    for round in 0..count {
        let name = ["fallback", "default"][round % 2];
        let (reply, status) = laboratory.ask(&["swap", name]);
        assert_eq!(status, Some(0), "{reply}");
        let other = if round % 2 == 0 { "previous" } else { "active" };
        laboratory.wait_for("default", other, |e| e["state"] == other);
    }
    let seconds = started.elapsed().as_secs_f64();
    let ticks = laboratory.close();
    check_ticks(&ticks);
    let last = ticks.iter().map(|t| t.swap_id).max().unwrap_or(0) as usize;
    println!("{last} swaps in {} ticks, {seconds:.0} s", ticks.len());
    assert_eq!(last, count);
}
