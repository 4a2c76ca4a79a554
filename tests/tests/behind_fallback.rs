//! A policy that tracks worse than the fallback on the model in force: the daemon finds out beside the tick, flies the fallback
//! without a bump, says why, and does what an operator or the configuration wants instead. Live viewers see it happen.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::io::Read;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::process::Command;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use proto::recording::{TickRecord, read_mcap};
use proto::stream::{Message, StreamReader};
use serde_json::Value;
use tests::Stream::{Err, Out};
use tests::{Folder, RunStatus, Running, alone, finish, program, root};

/// Generous: how long anything may take on a machine that does other things as well.
const SOON: Duration = Duration::from_secs(120);
/// The largest change of a duty in a tick while one controller decides is 0.025 on the paper's reference.
const CALM_DUTY: f64 = 0.06;

/// A policy that is better than the fallback on `dual_pressure` and passes the trial around `bench`, where the fallback leaves 0.15/0.04 kPa
/// and it 0.34/0.12.
const OLDER: &str = "docs/runs/correction-caps-512k-seed-2/policy.onnx";

struct Laboratory {
    folder: Folder,
    config: PathBuf,
    rig: Running,
    daemon: Running,
}

impl Laboratory {
    /// A daemon with a policy that was trained on poorer models ([`OLDER`]) on the emulated rig `bench`, armed by itself; further
    /// lines of its configuration.
    fn new(model: &str, policy: &str) -> Self {
        let lockstep = ["rig", "--listen", "127.0.0.1:0", "--pace", "lockstep", "--rig", "bench"];
        let rig = Running::start(Command::new(program("trainer")).args(lockstep));
        let address = rig.line(Out, "listening on ", SOON).rsplit_once(' ').unwrap().1.to_owned();
        let folder = Folder::new();
        std::fs::create_dir(folder.join("policies")).unwrap();
        std::fs::copy(root().join(OLDER), folder.join("policies/older.onnx")).unwrap();
        // A hold, so that what a duty does in a tick is the hand-over's doing and not the reference's.
        folder.write("reference.csv", "time_s,ref_pos_kpa,ref_neg_kpa\n0,85,-72\n");
        let config = folder.write(
            "controller.toml",
            format!(
                "[link]\naddress = \"{address}\"\npacing = \"lockstep\"\n[rig]\nfile = \"{model}\"\n\
                 [record]\ndirectory = \"kept\"\nmin_free_mib = 16\n\
                 [control]\nsocket = \"s.sock\"\nauto_arm = true\n[realtime]\nenforce = false\n\
                 [policy]\ndirectory = \"policies\"\nactive = \"older\"\n{policy}"
            ),
        );
        let daemon = Running::start(Command::new(program("controller")).args(["run", "--config"]).arg(&config));
        daemon.line(Err, "opened", SOON);
        Laboratory { folder, config, rig, daemon }
    }

    fn ask(&self, arguments: &[&str]) -> RunStatus {
        finish(Command::new(program("controller")).args(arguments).arg("--config").arg(&self.config))
    }

    fn json(&self, question: &str) -> Value {
        serde_json::from_str(&self.ask(&[question, "--json"]).stdout).unwrap()
    }

    fn wait_for(&self, what: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        let until = Instant::now() + SOON;
        loop {
            let status = self.json("status");
            if wanted(&status) {
                return status;
            }
            if status["status"]["can_arm"] == true {
                self.ask(&["arm"]);
            }
            assert!(Instant::now() < until, "not {what} in {SOON:?}: {status}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Reads the daemon's stream to its end: all tables of policies that viewers were sent.
    fn viewer(&self) -> JoinHandle<Vec<String>> {
        let mut socket = UnixStream::connect(self.folder.join("s.live.sock")).unwrap();
        std::thread::spawn(move || {
            let (mut reader, mut piece, mut tables) = (StreamReader::default(), [0; 1 << 16], Vec::new());
            while let Ok(n @ 1..) = socket.read(&mut piece) {
                reader.push(&piece[..n]);
                while let Ok(Some(message)) = reader.next() {
                    tables.extend(if let Message::Policies(json) = message { Some(json) } else { None });
                }
            }
            tables
        })
    }

    fn close(self) -> Vec<TickRecord> {
        self.daemon.terminate();
        let ended = self.daemon.wait(SOON);
        assert_eq!(ended.status, Some(0), "{ended:?}");
        self.rig.terminate();
        let names = self.folder.names("kept");
        let runs = names.iter().filter(|name| name.ends_with(".mcap"));
        runs.flat_map(|name| read_mcap(&self.folder.join("kept").join(name)).unwrap().ticks).collect()
    }
}

/// The largest change of a duty from tick to tick, but for the ten seconds after each arming: the way from rest.
fn steepest(ticks: &[TickRecord]) -> f64 {
    let (mut armed_for, mut most) = (0, 0.0_f64);
    for pair in ticks.windows(2) {
        armed_for = if pair.iter().all(|tick| tick.state == 1) { armed_for + 1 } else { 0 };
        if armed_for > 500 {
            let step = (pair[1].u_pos - pair[0].u_pos).abs().max((pair[1].u_neg - pair[0].u_neg).abs());
            most = most.max(step);
        }
    }
    most
}

#[test]
fn after_another_model_the_fallback_takes_over_and_an_operator_may_have_it_otherwise() {
    let _alone = alone();
    let laboratory = Laboratory::new("dual_pressure", "");
    let viewer = laboratory.viewer();
    laboratory.wait_for("flown for a while", |status| status["status"]["tick"].as_u64().unwrap_or(0) > 1500);
    assert_eq!(laboratory.json("status")["running"]["policy"], "older", "it is better on the model that it knows");

    let changed = laboratory.ask(&["model", "bench"]);
    assert_eq!(changed.status, Some(0), "{changed:?}");
    let status = laboratory.wait_for("the fallback", |status| status["running"]["policy"] == "fallback");
    let why = status["running"]["why_fallback"].as_str().unwrap();
    assert!(why.starts_with("older is behind the fallback on this model: ") && why.contains(" against "), "{why}");
    laboratory.daemon.line(Err, "policy older on model bench: ", SOON);
    let printed = laboratory.ask(&["policies"]).stdout;
    assert!(printed.contains("behind the fallback on this model: "), "{printed}");
    assert!(laboratory.ask(&["status"]).stdout.contains("fallback   older is behind"));

    // An operator who names it has it.
    assert_eq!(laboratory.ask(&["swap", "older"]).status, Some(0));
    let status = laboratory.wait_for("the policy again", |status| status["running"]["policy"] == "older");
    assert!(status["running"]["why_fallback"].is_null(), "{status}");

    let ticks = laboratory.close();
    // What is exchanged with the model, the width of the play among it, has settled a second after it.
    let model = ticks.iter().position(|tick| tick.swap_id == 1).unwrap() + 50;
    let handed_over = &ticks[model..];
    assert!(handed_over.iter().any(|tick| tick.swap_id == 3), "to the fallback and back");
    assert!(steepest(handed_over) < CALM_DUTY, "no bump: {}", steepest(handed_over));
    let tables = viewer.join().unwrap();
    assert!(tables.len() >= 3, "{tables:?}");
    let told = |words: &[&str]| tables.iter().any(|table| words.iter().all(|word| table.contains(word)));
    assert!(told(&["\"older\"", "\"active\""]) && told(&["\"previous\"", "behind the fallback"]), "{tables:?}");
}

#[test]
fn at_the_start_it_is_found_out_while_the_policy_controls() {
    let _alone = alone();
    let laboratory = Laboratory::new("bench", "");
    laboratory.wait_for("the fallback", |status| status["running"]["policy"] == "fallback");
    let ticks = laboratory.close();
    assert!(ticks.iter().any(|tick| tick.observation_hash != 0 && tick.state == 1), "the policy controlled meanwhile");
    assert!(steepest(&ticks) < CALM_DUTY, "no bump: {}", steepest(&ticks));
}

#[test]
fn the_configuration_may_have_it_fly_and_is_told() {
    let _alone = alone();
    let laboratory = Laboratory::new("bench", "when_behind = \"fly\"\n");
    let line = laboratory.daemon.line(Err, "policy older on model bench: ", SOON);
    assert!(line.contains("it controls all the same"), "{line}");
    let status = laboratory.wait_for("in control", |status| status["state"] == "run");
    assert_eq!(status["running"]["policy"], "older");
    assert!(laboratory.ask(&["policies"]).stdout.contains("behind the fallback"), "and it is shown");
    laboratory.close();
}
