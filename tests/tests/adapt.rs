//! `trainer adapt` beside a stand-in for the daemon on a Unix socket: what it asks for, what it puts back where a step
//! fails, and what it keeps. And a rehearsal against a concealed rig, by name.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

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
use tests::{Folder, RunStatus, Running, Stream, alone, finish, program, root};

const SESSION: u32 = 9;
const RUN: u8 = 1;
/// Ticks that pass between two questions to the stand-in.
const STRIDE: u32 = 250;

/// Ticks of the recording that are flown before another model is in force.
const BEFORE: u32 = 3_000;

/// A daemon that answers as told, with a recording of a rig that errs by less with another model, or by more.
struct StandIn {
    folder: Folder,
    out: PathBuf,
    asked: Arc<Mutex<Vec<String>>>,
    /// The experiments that it was asked to play.
    asked_csv: Arc<Mutex<Vec<String>>>,
    /// The reference that it follows.
    followed: Arc<Mutex<String>>,
}

/// How it answers, and whether a policy has been trained already.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Manners {
    is_trained: bool,
    takes_models: bool,
    /// Whether experiments are allowed or asked for.
    experiments: &'static str,
    /// State that a published policy comes to.
    policies_become: &'static str,
    /// Questions after its state in which the rig is vented, until a person has acknowledged and armed.
    vented_for: usize,
    /// Error of the rig on the model that was found, in kPa.
    on_the_model: [f64; 2],
    /// Tick from which on it follows `HOLD.csv`, as an operator has asked it to.
    held_from: Option<u32>,
}

const GOOD: Manners = Manners {
    is_trained: true,
    takes_models: true,
    experiments: "ask",
    policies_become: "active",
    vented_for: 0,
    on_the_model: [0.2, 0.1],
    held_from: None,
};

impl StandIn {
    fn new(manners: Manners) -> Self {
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
    fn adapt(&self, more: &[&str]) -> RunStatus {
        let ended = self.begin(more).wait(Duration::from_secs(120));
        assert_eq!(self.followed(), "operators.csv", "the operator's reference is back at every end: {ended:?}");
        ended
    }

    fn begin(&self, more: &[&str]) -> Running {
        let mut command = Command::new(program("trainer"));
        command.args(["adapt", "--resume"]).arg(&self.out).args(more);
        Running::start(command.arg("--controller").arg(program("controller")))
    }

    /// Name of the file that it follows.
    fn followed(&self) -> String {
        self.followed.lock().unwrap().rsplit('/').next().unwrap().to_owned()
    }

    /// Everything it was asked that changes anything, in order.
    fn changes(&self) -> Vec<String> {
        let asked = self.asked.lock().unwrap();
        asked.iter().filter(|what| !["status", "policies", "reference"].contains(&what.as_str())).cloned().collect()
    }

    fn outcome(&self) -> Value {
        serde_json::from_slice(&std::fs::read(self.out.join("adapt.json")).unwrap()).unwrap()
    }
}

/// A tick of a rig that is off its reference by so much, in kPa.
fn ticked(tick: u32, off: [f64; 2]) -> TickRecord {
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
fn record(path: &Path, ticks: impl Iterator<Item = TickRecord>) {
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
fn diagnosed(out: &Path, config: &Path, operators: &Path, manners: Manners) {
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

fn fit() -> Value {
    json!({"pos_rmse_kpa": 1.0, "neg_rmse_kpa": 1.0, "pos_accuracy": 0.9, "neg_accuracy": 0.9})
}

fn serve(
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

/// What it says of the policy that was published: passed until it was swapped, then what the manners say.
fn entries(manners: Manners, log: &Mutex<Vec<String>>) -> Vec<Value> {
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

#[test]
fn a_model_that_is_refused_leaves_everything_as_it_was() {
    let stand_in = StandIn::new(Manners { takes_models: false, ..GOOD });
    let ended = stand_in.adapt(&[]);
    assert_eq!(ended.status, Some(1), "{ended:?}");
    for words in
        ["predicts worse than the one in force", "model, policy and reference are as they were", "adapt --resume"]
    {
        assert!(ended.stderr.contains(words), "{words}: {}", ended.stderr);
    }
    assert_eq!(stand_in.changes(), ["model rig.toml of found"], "nothing else was asked for");
    assert_eq!(stand_in.folder.names("policies"), Vec::<String>::new());
}

#[test]
fn a_training_that_fails_puts_the_model_back() {
    let stand_in = StandIn::new(Manners { is_trained: false, ..GOOD });
    // Where the run is to be, there is a file.
    std::fs::write(stand_in.out.join("run"), "in the way").unwrap();
    let ended = stand_in.adapt(&[]);
    assert_eq!(ended.status, Some(1), "{ended:?}");
    for words in ["trainer improve", "model, policy and reference are as they were", "adapt --resume"] {
        assert!(ended.stderr.contains(words), "{words}: {}", ended.stderr);
    }
    assert_eq!(stand_in.changes(), ["model rig.toml of found", "model model.toml of before"]);
}

/// Tracking shows too little for a model that foresees better, so an experiment is asked for where it may be: the daemon
/// forbids it, and two narrower ones.
#[test]
fn an_experiment_that_the_daemon_forbids_is_tried_narrower_and_then_left() {
    let stand_in = StandIn::new(Manners { takes_models: false, experiments: "allowed", ..GOOD });
    let ended = stand_in.adapt(&[]);
    assert_eq!(ended.status, Some(1), "{ended:?}");
    assert!(ended.stderr.contains("row 12 would leave the envelope"), "{}", ended.stderr);
    assert_eq!(stand_in.changes(), ["experiment", "experiment", "experiment", "model rig.toml of found"]);
    let spans = |share: usize| {
        let text = &stand_in.asked_csv.lock().unwrap()[share];
        let duties = text.lines().skip(1).map(|line| line.split(',').nth(1).unwrap().parse::<f64>().unwrap());
        duties.clone().fold(f64::MIN, f64::max) - duties.fold(f64::MAX, f64::min)
    };
    assert!(spans(1) < 0.7 * spans(0) && spans(2) < 0.7 * spans(1), "{} {} {}", spans(0), spans(1), spans(2));
}

/// The daemon takes the model and then knows nothing of policies: the model is put back, and going on begins with it again.
#[test]
fn what_fails_behind_the_model_puts_the_model_back() {
    let stand_in = StandIn::new(Manners { policies_become: "unknown", ..GOOD });
    let ended = stand_in.adapt(&[]);
    assert_eq!(ended.status, Some(1), "{ended:?}");
    assert!(ended.stderr.contains("no policies here") && ended.stderr.contains("as they were"), "{}", ended.stderr);
    assert_eq!(stand_in.changes(), ["model rig.toml of found", "model model.toml of before"]);
    let journal: Value = serde_json::from_slice(&std::fs::read(stand_in.out.join("journal.json")).unwrap()).unwrap();
    assert_eq!((&journal["model_line"], journal["flown"].as_array().unwrap().len()), (&Value::Null, 1), "{journal}");
}

#[test]
fn a_policy_that_the_daemon_refuses_leaves_the_model_in_force() {
    let stand_in = StandIn::new(Manners { policies_become: "refused", ..GOOD });
    let ended = stand_in.adapt(&["--json"]);
    assert_eq!(ended.status, Some(0), "{ended:?}");
    assert_eq!(stand_in.changes(), ["model rig.toml of found"], "no swap, and the model stays");
    let outcome = stand_in.outcome();
    assert_eq!((&outcome["kept"], &outcome["is_better"]), (&json!("with the model"), &json!(true)), "{outcome}");
    assert!(outcome["policy"].as_str().unwrap().contains("tracks worse than what controls"), "{outcome}");
    assert_eq!(outcome["interventions"], 2);
    let error = |at: usize| outcome["tracking"][at]["rmse_kpa"][0].as_f64().unwrap();
    assert!((error(0) - 0.5).abs() < 1e-9 && (error(1) - 0.2).abs() < 1e-9, "{outcome}");
}

/// What is no better than what it began as is not sent through minutes of examination on the rig.
#[test]
fn a_training_that_made_nothing_better_publishes_nothing() {
    let stand_in = StandIn::new(GOOD);
    let run = stand_in.out.join("run");
    std::fs::create_dir_all(&run).unwrap();
    std::fs::write(
        run.join("summary.json"),
        json!({"rounds": 12, "kept": {"round": 0, "score_kpa": 0.0795}}).to_string(),
    )
    .unwrap();
    let ended = stand_in.adapt(&["--json"]);
    assert_eq!(ended.status, Some(0), "{ended:?}");
    assert_eq!(stand_in.changes(), ["model rig.toml of found"], "no swap, and the model stays");
    assert_eq!(stand_in.folder.names("policies"), Vec::<String>::new());
    let outcome = stand_in.outcome();
    assert_eq!(outcome["kept"], "with the model", "{outcome}");
    assert!(
        outcome["policy"].as_str().unwrap().starts_with("not published (of 12 rounds of training none"),
        "{outcome}"
    );
}

#[test]
fn a_policy_that_becomes_active_is_kept_where_it_tracks_as_well() {
    let stand_in = StandIn::new(GOOD);
    let ended = stand_in.adapt(&["--json"]);
    assert_eq!(ended.status, Some(0), "{ended:?}");
    assert_eq!(stand_in.changes(), ["model rig.toml of found", "swap adapted"]);
    let outcome = stand_in.outcome();
    assert_eq!((&outcome["kept"], &outcome["policy"]), (&json!("with the policy"), &json!("active")), "{outcome}");
    assert_eq!(outcome["flown"].as_array().unwrap().len(), 3, "{outcome}");
    assert_eq!(stand_in.folder.names("policies").len(), 1);
}

/// The rig was vented since reading and model are apart: the model that was found may be what explains that. It is put in force, no
/// experiment is asked for, a person is, and it goes on once the rig is armed.
#[test]
fn a_rig_that_was_vented_for_what_was_found_is_armed_by_a_person_and_goes_on() {
    let stand_in = StandIn::new(Manners { experiments: "allowed", vented_for: 30, ..GOOD });
    let ended = stand_in.adapt(&["--json"]);
    assert_eq!(ended.status, Some(0), "{ended:?}");
    for words in ["no experiment: the rig was vented (model positive)", "`controller acknowledge`", "this waits for it"]
    {
        assert_eq!(ended.stderr.matches(words).count(), 1, "{words}: {}", ended.stderr);
    }
    assert_eq!(stand_in.changes(), ["model rig.toml of found", "swap adapted"]);
    assert_eq!(stand_in.outcome()["kept"], "with the policy");
}

/// What was found makes the rig track worse: the flight on it is not flown to its end, the model is put back, and
/// nothing is trained.
#[test]
fn a_model_that_tracks_worse_is_taken_back_before_its_flight_is_over() {
    let stand_in = StandIn::new(Manners { on_the_model: [0.9, 0.6], ..GOOD });
    let ended = stand_in.adapt(&["--json"]);
    assert_eq!(ended.status, Some(1), "{ended:?}");
    for words in ["it tracks worse, and is ended", "no policy is trained on it", "kept: before"] {
        assert!(ended.stderr.contains(words), "{words}: {}", ended.stderr);
    }
    assert_eq!(stand_in.changes(), ["model rig.toml of found", "model model.toml of before"]);
    let outcome = stand_in.outcome();
    assert_eq!((&outcome["kept"], &outcome["is_better"]), (&json!("before"), &json!(false)), "{outcome}");
    let ended_after_s = outcome["flown"][1]["ended_after_s"].as_f64().unwrap();
    assert!((10.0..20.0).contains(&ended_after_s), "{outcome}");
}

/// A published policy that is on its way to the rig when the run is stopped: it is taken back, as the model and the
/// reference are.
#[test]
fn a_run_that_is_stopped_on_the_way_leaves_model_policy_and_reference_as_they_were() {
    for (signal, status) in [("INT", 130), ("TERM", 143)] {
        let stand_in = StandIn::new(Manners { policies_become: "ramp", ..GOOD });
        let running = stand_in.begin(&[]);
        running.line(Stream::Err, "out/back-and-forth.csv", Duration::from_secs(120));
        running.signal(signal);
        let ended = running.wait(Duration::from_secs(120));
        assert_eq!(ended.status, Some(status), "{ended:?}");
        assert!(ended.stderr.contains("stopped; model, policy and reference are as they were"), "{}", ended.stderr);
        assert_eq!(stand_in.followed(), "operators.csv", "{ended:?}");
        let changes = stand_in.changes();
        let (_, last) = changes.split_at(changes.len().saturating_sub(2));
        assert!(changes.iter().filter(|change| *change == "swap adapted").count() <= 1, "{changes:?}");
        if changes.contains(&"swap adapted".to_owned()) {
            // By name: a rollback might go further back than to what controlled.
            assert_eq!(last, ["swap fallback", "model model.toml of before"]);
        } else {
            assert_eq!(last, ["model rig.toml of found", "model model.toml of before"]);
        }
    }
}

/// A flight is of one reference: where an operator gives the daemon another, the run ends, his stays, and nothing of that flight counts.
/// Going on puts his back at the end.
#[test]
fn a_reference_that_an_operator_puts_in_during_a_flight_stays_and_ends_the_run() {
    let before = ("while `before` was flown", vec![], 0);
    let later = ("while `with the model` was flown", vec!["model rig.toml of found", "model model.toml of before"], 1);
    for (held_from, (told, changes, flights)) in [(1_600, before), (4_500, later)] {
        let stand_in = StandIn::new(Manners { held_from: Some(held_from), policies_become: "refused", ..GOOD });
        let ended = stand_in.begin(&[]).wait(Duration::from_secs(120));
        assert_eq!(ended.status, Some(1), "{ended:?}");
        for words in
            [told, "by somebody else", "HOLD.csv, no longer ", "nothing of this flight counts", "adapt --resume"]
        {
            assert!(ended.stderr.contains(words), "{words}: {}", ended.stderr);
        }
        assert_eq!(
            (stand_in.followed(), stand_in.changes()),
            ("HOLD.csv".to_owned(), changes.iter().map(|&c| c.to_owned()).collect())
        );
        let journal: Value =
            serde_json::from_slice(&std::fs::read(stand_in.out.join("journal.json")).unwrap()).unwrap();
        assert_eq!(journal["flown"].as_array().unwrap().len(), flights, "{journal}");
        assert_eq!(journal["before"].is_null(), flights == 0, "what has not counted is looked at anew: {journal}");
        if flights > 0 {
            let ended = stand_in.begin(&["--json"]).wait(Duration::from_secs(120));
            assert_eq!((ended.status, stand_in.followed()), (Some(0), "HOLD.csv".to_owned()), "{ended:?}");
        }
    }
}

/// Nobody can put anything back when it is killed: what it said at its beginning is a command that does.
#[test]
fn a_run_that_is_killed_has_said_how_the_reference_is_put_back() {
    let stand_in = StandIn::new(Manners { policies_become: "ramp", ..GOOD });
    let running = stand_in.begin(&[]);
    running.line(Stream::Err, "out/back-and-forth.csv", Duration::from_secs(120));
    let said = running.line(Stream::Err, "Where this is killed: `", Duration::from_secs(1));
    running.signal("KILL");
    running.wait(Duration::from_secs(60));
    // The daemon is asked by a child that has ended or ends with it.
    let command = said.split('`').nth(1).unwrap();
    let arguments: Vec<&str> = command.split(' ').skip(1).collect();
    let ended = finish(Command::new(program("controller")).args(arguments));
    assert_eq!(ended.status, Some(0), "{ended:?}");
    assert_eq!(stand_in.followed(), "operators.csv", "{command}");
}

/// The worst pressures of the whole time, not of the flights along the reference alone.
#[test]
fn the_worst_pressures_are_those_of_experiments_as_well() {
    let stand_in = StandIn::new(Manners { policies_become: "refused", ..GOOD });
    let played = TickRecord { p_pos_kpa: 117.9, p_neg_kpa: -80.8, experiment: 2, ..ticked(500, [0.0; 2]) };
    record(&stand_in.folder.join("recordings/experiment-20260101-000000.mcap"), [played].into_iter());
    let ended = stand_in.adapt(&[]);
    assert_eq!(ended.status, Some(0), "{ended:?}");
    let told = "worst pressures: 117.9 kPa (in control: experiment) and -80.8 kPa (experiment)";
    assert!(ended.stdout.contains(told), "{}", ended.stdout);
    let outcome = stand_in.outcome();
    assert_eq!(outcome["extremes_kpa"], json!([117.9, -80.8]), "{outcome}");
}

/// From differing recordings to a controller that tracks better, in one command:
/// `cargo test --release --workspace --test adapt -- --ignored rehearsal --nocapture`.
#[test]
#[ignore = "a minute and more"]
fn a_rehearsal_ends_with_a_controller_that_tracks_better() {
    let _alone = alone();
    let folder = Folder::new();
    let mut command = Command::new(program("trainer"));
    command.args(["adapt", "--rehearse", "--json", "--seed", "1", "--train-seconds", "30", "--diagnose-seconds", "60"]);
    let ended = Running::start(command.arg("--out").arg(folder.join("out"))).wait(Duration::from_secs(900));
    println!("{}", ended.stderr);
    assert_eq!(ended.status, Some(0), "{ended:?}");
    let outcome: Value = serde_json::from_str(&ended.stdout).unwrap();
    let error = |at: usize, c: usize| outcome["tracking"][at]["rmse_kpa"][c].as_f64().unwrap();
    assert!(error(1, 0) * error(1, 1) < error(0, 0) * error(0, 1), "{outcome}");
    assert!(!outcome["learned"].as_array().unwrap().is_empty(), "{outcome}");
    assert!(folder.join("out/report.html").is_file());
}
