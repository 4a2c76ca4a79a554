//! A stand-in for the daemon on a Unix socket, for `trainer adapt`: it answers as it is told, and notes what it is asked.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use model::rig::Rig;
use proto::recording::{Attachment, RecordingInfo, RecordingWriter, TickRecord, attached};
use proto::reference::Reference;
use serde_json::{Value, json};
use tests::{Folder, RunStatus, Running, program, root};

pub(crate) const SESSION: u32 = 9;
pub(crate) const RUN: u8 = 1;
/// Ticks that pass between two questions to the stand-in.
pub(crate) const STRIDE: u32 = 250;

/// Ticks of the recording that are flown before another model is in force.
pub(crate) const BEFORE: u32 = 3_000;

/// A daemon that answers as told, with a recording of a rig that errs by less with another model, or by more.
pub(crate) struct StandIn {
    pub(crate) folder: Folder,
    pub(crate) out: PathBuf,
    pub(crate) asked: Arc<Mutex<Vec<String>>>,
    /// The experiments that it was asked to play.
    pub(crate) asked_csv: Arc<Mutex<Vec<String>>>,
    /// The reference that it follows.
    pub(crate) followed: Arc<Mutex<String>>,
}

/// Manners of the stand-in: its answers, and whether a policy has been trained already.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Manners {
    pub(crate) is_trained: bool,
    pub(crate) takes_models: bool,
    /// Rule on experiments: allowed or asked for.
    pub(crate) experiments: &'static str,
    /// State that a published policy comes to.
    pub(crate) policies_become: &'static str,
    /// Questions after its state in which the rig is vented, until a person has acknowledged and armed.
    pub(crate) vented_for: usize,
    /// Error of the rig on the model that was found, in kPa.
    pub(crate) on_the_model: [f64; 2],
    /// Tick from which on it follows `HOLD.csv`, as an operator has asked it to.
    pub(crate) held_from: Option<u32>,
}

pub(crate) const GOOD: Manners = Manners {
    is_trained: true,
    takes_models: true,
    experiments: "ask",
    policies_become: "active",
    vented_for: 0,
    on_the_model: [0.2, 0.1],
    held_from: None,
};

impl StandIn {
    pub(crate) fn new(manners: Manners) -> Self {
        let folder = Folder::new();
        let config = folder.write("c.toml", "[link]\naddress = \"127.0.0.1:1\"\n[control]\nsocket = \"s\"\n");
        std::fs::create_dir(folder.join("recordings")).unwrap();
        let off = |tick| if tick < BEFORE { [0.5, 0.3] } else { manners.on_the_model };
        record(&folder.join("recordings/run-20260101-000000.mcap"), (0..20_000).map(|tick| ticked(tick, off(tick))));
        let operators = folder.write("operators.csv", Reference::constant(85.0, -72.0).to_csv());
        folder.write("HOLD.csv", Reference::constant(80.0, -70.0).to_csv());
        let out = folder.join("out");
        diagnosed(&out, &config, &operators, manners);
        let (asked, asked_csv) = <(Arc<Mutex<Vec<String>>>, Arc<Mutex<Vec<String>>>)>::default();
        let followed = Arc::new(Mutex::new(operators.display().to_string()));
        let listener = UnixListener::bind(folder.join("s")).unwrap();
        let (log, played, follows) = (Arc::clone(&asked), Arc::clone(&asked_csv), Arc::clone(&followed));
        std::thread::spawn(move || serve(&listener, manners, &log, &played, &follows));
        StandIn { folder, out, asked, asked_csv, followed }
    }

    /// Goes on from a diagnosis that is done.
    pub(crate) fn adapt(&self, more: &[&str]) -> RunStatus {
        let ended = self.begin(more).wait(Duration::from_secs(120));
        assert_eq!(self.followed(), "operators.csv", "the operator's reference is back at every end: {ended:?}");
        ended
    }

    pub(crate) fn begin(&self, more: &[&str]) -> Running {
        let mut command = Command::new(program("trainer"));
        command.args(["adapt", "--resume"]).arg(&self.out).args(more);
        Running::start(command.arg("--controller").arg(program("controller")))
    }

    /// Name of the file that it follows.
    pub(crate) fn followed(&self) -> String {
        self.followed.lock().unwrap().rsplit('/').next().unwrap().to_owned()
    }

    /// Everything it was asked that changes anything, in order.
    pub(crate) fn changes(&self) -> Vec<String> {
        let asked = self.asked.lock().unwrap();
        asked.iter().filter(|what| !["status", "policies", "reference"].contains(&what.as_str())).cloned().collect()
    }

    pub(crate) fn outcome(&self) -> Value {
        serde_json::from_slice(&std::fs::read(self.out.join("adapt.json")).unwrap()).unwrap()
    }
}

/// A tick of a rig that is off its reference by so much, in kPa.
pub(crate) fn ticked(tick: u32, off: [f64; 2]) -> TickRecord {
    TickRecord {
        session: SESSION,
        tick,
        state: RUN,
        p_pos_kpa: 85.0 + off[0],
        p_neg_kpa: -72.0 + off[1],
        ref_pos_kpa: 85.0,
        ref_neg_kpa: -72.0,
        ..TickRecord::default()
    }
}

/// A recording of the stand-in.
pub(crate) fn record(path: &Path, ticks: impl Iterator<Item = TickRecord>) {
    let file = |name: &str, text: String| Attachment {
        name: name.to_owned(),
        media_type: "text/plain".to_owned(),
        data: text.into_bytes(),
    };
    let model = Rig::builtin("dual_pressure").unwrap().to_toml().unwrap();
    let files = [file(attached::MODEL, model), file(attached::REFERENCE, Reference::constant(85.0, -72.0).to_csv())];
    let mut writer = RecordingWriter::create(path, &RecordingInfo::new("stand-in", 0), &files).unwrap();
    for tick in ticks {
        writer.write(&tick).unwrap();
    }
    writer.finish().unwrap();
}

/// The folder of an adaptation whose diagnosis is done: a valve's lag was found; and a policy trained, or not yet.
pub(crate) fn diagnosed(out: &Path, config: &Path, operators: &Path, manners: Manners) {
    let found = out.join("found");
    std::fs::create_dir_all(&found).unwrap();
    std::fs::create_dir_all(out.join("before")).unwrap();
    std::fs::write(found.join("rig.toml"), Rig::builtin("bench").unwrap().to_toml().unwrap()).unwrap();
    let diagnosis = json!({
        "verdict": "missing_physics", "summary": "a valve is late", "mechanisms": [], "location": [],
        "fit": {"nominal": fit(), "reidentified": fit(), "extended": fit()}, "rivals": [], "next_experiment": null,
        "notes": [], "rig": {"name": "found", "kind": "extended"}
    });
    std::fs::write(found.join("diagnosis.json"), diagnosis.to_string()).unwrap();
    std::fs::write(out.join("before/model.toml"), Rig::builtin("dual_pressure").unwrap().to_toml().unwrap()).unwrap();
    std::fs::write(out.join("before/reference.csv"), Reference::constant(85.0, -72.0).to_csv()).unwrap();
    let trained = manners.is_trained.then(|| root().join("controller/policies/default.onnx"));
    // A rig that is vented now was not when it ran.
    let tracking =
        json!({"rmse_kpa": [0.5, 0.3], "noise_kpa": [0.06, 0.01], "ticks": 750, "extremes_kpa": [86.0, -73.0]});
    let flown = if manners.vented_for > 0 { json!([{"what": "before", "tracking": tracking}]) } else { json!([]) };
    let journal = json!({
        "settings": {
            "config": config, "fly_seconds": 20.0, "diagnose_seconds": 60.0, "search": "quick", "experiments": manners.experiments,
            "training": "always", "train_rounds": 1, "train_seconds": 60, "verdict_seconds": 30, "seed": 1
        },
        "before": {"policy": "fallback", "model": "dual_pressure", "reference": operators, "interventions": 3, "at": [SESSION, 100]},
        "recordings": ["run-1.csv"], "experiments": [], "experiment_allowed": null, "found": found,
        "model_line": null, "trained": trained, "published": null, "verdict": null, "flown": flown, "kept": null,
        "ticks": 0, "interventions": null
    });
    std::fs::write(out.join("journal.json"), journal.to_string()).unwrap();
}

pub(crate) fn fit() -> Value {
    json!({"pos_rmse_kpa": 1.0, "neg_rmse_kpa": 1.0, "pos_accuracy": 0.9, "neg_accuracy": 0.9})
}

pub(crate) fn serve(
    listener: &UnixListener,
    manners: Manners,
    log: &Mutex<Vec<String>>,
    played: &Mutex<Vec<String>>,
    follows: &Mutex<String>,
) {
    let (mut tick, mut policy, mut held_from) = (100, "fallback".to_owned(), manners.held_from);
    for stream in listener.incoming() {
        let mut stream = stream.unwrap();
        let mut line = String::new();
        // Some only look whether anybody answers.
        if BufReader::new(stream.try_clone().unwrap()).read_line(&mut line).unwrap_or(0) == 0 {
            continue;
        }
        let ask: Value = serde_json::from_str(&line).unwrap();
        let what = ask["ask"].as_str().unwrap().to_owned();
        tick = (tick + STRIDE).min(19_900);
        if held_from.take_if(|from| tick >= *from).is_some() {
            let mut followed = follows.lock().unwrap();
            // The file lies beside the operator's first, and that above the run's folder.
            let folder = Path::new(&*followed).ancestors().find(|folder| folder.join("HOLD.csv").is_file()).unwrap();
            *followed = folder.join("HOLD.csv").display().to_string();
        }
        let file = ask["file"].as_str().unwrap_or_default().rsplit('/').take(2).collect::<Vec<_>>().join(" of ");
        log.lock().unwrap().push(match what.as_str() {
            "model" => format!("model {file}"),
            "swap" if ask["name"].as_str().unwrap().starts_with("adapted") => "swap adapted".to_owned(),
            "swap" => format!("swap {}", ask["name"].as_str().unwrap()),
            _ => what.clone(),
        });
        if what == "reference" {
            ask["file"].as_str().unwrap().clone_into(&mut follows.lock().unwrap());
        }
        if what == "swap" && manners.policies_become == "active" {
            policy = ask["name"].as_str().unwrap().to_owned();
        }
        let mut reply = json!({
            "ok": true, "state": "run", "age_ms": 1,
            "running": {"policy": policy, "model": "dual_pressure", "reference": *follows.lock().unwrap()},
            "status": {
                "state": "run", "session": SESSION, "tick": tick, "can_arm": true, "pressures_kpa": null,
                "reference_kpa": null, "duty": [0.8, 0.8], "deadline_misses": 0, "frames_missed": 0, "slowest_ms": 0.1,
                "filter_interventions": 5
            }
        });
        match what.as_str() {
            "model" if !manners.takes_models => {
                reply = json!({"ok": false, "error": "found/rig.toml: it predicts worse than the one in force"});
            }
            "status" if log.lock().unwrap().iter().filter(|what| *what == "status").count() <= manners.vented_for => {
                reply["state"] = json!("vented");
                reply["status"]["latched"] = json!("model_positive");
            }
            "experiment" => {
                played.lock().unwrap().push(ask["csv"].as_str().unwrap().to_owned());
                reply = json!({"ok": false, "error": "row 12 would leave the envelope"});
            }
            "policies" if manners.policies_become == "unknown" => {
                reply = json!({"ok": false, "error": "no policies here"});
            }
            "policies" => reply["policies"] = json!(entries(manners, log)),
            _ => {}
        }
        // A client that has gone needs no answer.
        let _ = writeln!(stream, "{reply}");
    }
}

/// List of policies after one was published: passed until it was swapped, then what the manners say.
pub(crate) fn entries(manners: Manners, log: &Mutex<Vec<String>>) -> Vec<Value> {
    let swapped = log.lock().unwrap().iter().any(|what| what == "swap adapted");
    let state = if swapped || manners.policies_become == "refused" { manners.policies_become } else { "passed" };
    let refusal = json!({"stage": "trial", "reason": "tracks worse than what controls"});
    // Its name holds the time; the newest file of the folder is meant.
    let mut entry = json!({"state": state, "sha256": ""});
    if state == "refused" {
        entry["refusal"] = refusal;
    }
    (0..120)
        .map(|back| {
            let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap().as_secs();
            let mut entry = entry.clone();
            entry["name"] = json!(format!("adapted-{}", now - back));
            entry
        })
        .collect()
}
