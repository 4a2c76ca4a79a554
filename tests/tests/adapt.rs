//! `trainer adapt` beside a stand-in for the daemon on a Unix socket: what it asks for, what it puts back where a step
//! fails, and what it keeps. And a rehearsal against a concealed rig, by name.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod stand_in;

use std::process::Command;
use std::time::Duration;

use proto::recording::TickRecord;
use serde_json::{Value, json};
use stand_in::{GOOD, Manners, StandIn, record, ticked};
use tests::{Folder, Running, Stream, alone, finish, program};

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

/// A policy that is no better than the one it began as is not sent through minutes of examination on the rig.
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

/// The model that was found makes the rig track worse: the flight on it is not flown to its end, the model is put back, and
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

/// A run that is killed puts nothing back: what it said at its beginning is a command that does.
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
