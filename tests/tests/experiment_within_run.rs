//! `controller experiment` through a running daemon: asked over its socket, played by it, recorded apart and in the run, and
//! the run goes on as before. Emulated cRIO, daemon and operator are processes of their own.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::process::Command;
use std::time::Instant;

use proto::recording::{Recording, TickInput, TickRecord, read_mcap};
use serde_json::Value;
use tests::laboratory::{Laboratory, Plan, SOON};
use tests::programme::{ProgrammeRow, csv, programme};
use tests::{Running, finish, program};

const RUN: u8 = 1;

/// The paper's rig with a mechanism beside behind the cRIO, and a daemon that knows nothing of the mechanism.
fn laboratory(mechanism: &str) -> Laboratory {
    let plan = Plan::new("policy.active = \"fallback\"");
    let rig = plan.folder.write("rig.toml", format!("{}\n{mechanism}", model::rig::DUAL_PRESSURE));
    plan.rig(rig).start()
}

fn experiment(laboratory: &Laboratory, rows: &[ProgrammeRow]) -> Command {
    let file = laboratory.folder.write("e.csv", csv(rows));
    laboratory.command(&["experiment", file.to_str().unwrap()])
}

/// The ticks in which rows were sent are the file's rows, one after the other.
fn check_rows(ticks: &[TickRecord], rows: &[ProgrammeRow]) {
    let sent: Vec<&TickRecord> = ticks.iter().filter(|tick| tick.experiment == 2 && tick.mode == RUN).collect();
    assert_eq!(sent.len(), rows.len());
    for (k, (tick, row)) in sent.iter().zip(rows).enumerate() {
        let is = (tick.tick, tick.u_pos, tick.u_neg, u8::from(tick.pump_on));
        assert_eq!(is, (sent[0].tick + k as u32, row.0, row.1, row.2), "row {k}");
    }
}

#[test]
fn an_armed_daemon_plays_it_and_controls_again() {
    let laboratory = laboratory("");
    laboratory.arm();
    let rows = programme(500);
    let ended = finish(experiment(&laboratory, &rows).arg("--json"));
    let result: Value = serde_json::from_str(&ended.stdout).unwrap_or_else(|e| panic!("{e}: {ended:?}"));
    assert_eq!((ended.status, &result["completed"]), (Some(0), &true.into()), "{ended:?}");
    assert_eq!((&result["rows_played"], &result["played"]["not_applied"]), (&500.into(), &0.into()), "{result}");
    let alone = laboratory.recordings("experiment-");
    assert_eq!(result["recording"], alone[0].to_str().unwrap(), "{result}");
    // It goes on as before: armed again on its reference, which begins anew.
    let status = laboratory.wait_for("armed again", |status| status["state"] == "run");
    assert!(status["status"]["reference_kpa"].is_array(), "{status}");

    // The recording of the experiment alone holds what one without a daemon holds.
    let content = read_mcap(&alone[0]).unwrap();
    check_rows(&content.ticks, &rows);
    assert!(content.ticks.iter().all(|tick| tick.experiment != 0), "nothing of the run around it");
    let names: Vec<&str> = content.attachments.iter().map(|file| file.name.as_str()).collect();
    assert_eq!(names, ["experiment.csv", "model_rig.toml", "controller.toml"]);
    assert_eq!(content.attachments[0].data, csv(&rows).as_bytes());
    assert!(content.events.iter().any(|event| event.message.contains("experiment complete: all 500 rows")));
    let at_rest = |tick: &TickRecord| tick.p_pos_kpa.abs() < 3.0 && tick.p_neg_kpa.abs() < 3.0;
    let first = content.ticks.iter().position(|tick| tick.experiment == 2).unwrap();
    assert!(at_rest(&content.ticks[first]) && at_rest(content.ticks.last().unwrap()), "from rest to rest");
    // As a table it begins a second before the first row.
    let as_read = Recording::read(&alone[0]).unwrap();
    assert_eq!((as_read.rows(), as_read.segments().len()), (content.ticks.len() - first.saturating_sub(50), 1));

    // So does the run's, and it replays to the bit, experiment included.
    let closed = laboratory.close();
    let ticks = closed.ticks();
    check_rows(&ticks, &rows);
    let after = ticks.iter().rposition(|tick| tick.experiment != 0).unwrap();
    assert!(ticks[after..].iter().any(|tick| tick.mode == RUN && tick.ref_pos_kpa.is_finite()));
    assert!(ticks.iter().any(|tick| TickInput::of(tick.inputs).any(|input| input == TickInput::Experiment)));
    let found = closed.check_replay();
    assert_eq!(found["ticks"].as_u64().unwrap(), ticks.len() as u64, "{found}");
    // Alone it lacks what the run around it depended on.
    let alone = &closed.recordings("experiment-")[0];
    let refused = finish(Command::new(program("controller")).arg("replay").arg(alone));
    assert!(refused.status == Some(2) && refused.stderr.contains("recording of its run (run-….mcap)"), "{refused:?}");
}

#[test]
fn a_daemon_that_stands_by_plays_it_and_stands_by_again() {
    let laboratory = laboratory("");
    laboratory.stand_by();
    let copy = laboratory.folder.join("copy.mcap");
    let ended = finish(experiment(&laboratory, &programme(300)).arg("--out").arg(&copy));
    assert!(ended.status == Some(0) && ended.stdout.contains(copy.to_str().unwrap()), "{ended:?}");
    assert_eq!(read_mcap(&copy).unwrap().ticks.iter().filter(|tick| tick.experiment == 2).count(), 300);
    let closed = laboratory.close();
    let ticks = closed.ticks();
    let after = ticks.iter().rposition(|tick| tick.experiment != 0).unwrap();
    assert!(ticks.len() > after + 50 && ticks[after + 1..].iter().all(|tick| tick.mode != RUN), "nobody armed it");
}

#[test]
fn disarm_stops_it_leaving_does_not_and_nothing_comes_between() {
    let laboratory = laboratory("");
    laboratory.arm();
    // 6,000 rows take a lockstep daemon seconds: enough for everything below.
    let client = Running::start(&mut experiment(&laboratory, &programme(6000)));
    laboratory.wait_for("playing", |status| status["experiment"]["phase"] == "playing");
    drop(client);
    for refused in [&["arm"][..], &["swap", "fallback"], &["model", "bench"], &["rollback"]] {
        let ended = laboratory.ask(refused);
        assert!(ended.status == Some(1) && ended.stderr.contains("an experiment is under way"), "{ended:?}");
    }
    let second = finish(&mut experiment(&laboratory, &programme(100)));
    assert!(second.status == Some(1) && second.stderr.contains("an experiment is under way"), "{second:?}");
    let reached = laboratory.status()["experiment"]["reached"].as_u64().unwrap();
    laboratory.wait_for("going on without its client", |status| {
        status["experiment"]["reached"].as_u64().unwrap() > reached + 50
    });
    assert_eq!(laboratory.ask(&["disarm"]).status, Some(0));
    let status = laboratory.wait_for("concluded", |status| status["experiment"]["outcome"].is_object());
    assert_eq!(status["experiment"]["outcome"]["aborted"], "disarmed by the operator", "{status}");
    let content = read_mcap(&laboratory.recordings("experiment-")[0]).unwrap();
    assert!(content.events.iter().any(|event| event.message.starts_with("EXPERIMENT ABORTED after")));
    let closed = laboratory.close();
    let ticks = closed.ticks();
    let last = ticks.iter().rposition(|tick| tick.experiment == 2 && tick.mode == RUN).unwrap();
    assert!(ticks[last + 1..].iter().all(|tick| tick.mode != RUN && tick.u_pos == 1.0), "stopped for good");
    closed.check_replay();
}

/// By the model well below the limit; with a clogged muffler behind the valve, far above.
#[test]
fn over_pressure_aborts_it_and_waits_for_a_person() {
    let clogged = "[[mechanisms]]\nid = \"exhaust_restriction\"\ncomponent = \"valve_pos\"\narea_mm2 = 0.5\n";
    let laboratory = laboratory(clogged);
    laboratory.stand_by();
    let ended = finish(&mut experiment(&laboratory, &[(0.75, 0.85, 1); 1000]));
    let line = ended.stderr.lines().last().unwrap();
    assert!(ended.status == Some(1) && line.contains("above safety.max_pos_kpa"), "{ended:?}");
    // Nothing is armed, by itself or by hand, before a person has looked at it; then everything is as it was.
    let refused = laboratory.ask(&["arm"]);
    assert!(refused.status == Some(1) && refused.stderr.contains("acknowledge"), "{refused:?}");
    // It can be acknowledged once it is over: a clogged vent takes its time.
    let until = Instant::now() + SOON;
    loop {
        let ended = laboratory.ask(&["acknowledge"]);
        if ended.status == Some(0) {
            break;
        }
        println!("{}", ended.stderr);
        assert!(Instant::now() < until, "{ended:?}");
    }
    laboratory.stand_by();
    let closed = laboratory.close();
    let ticks = closed.ticks();
    let over = ticks.iter().find(|tick| tick.p_pos_kpa > 160.0).unwrap();
    assert_eq!((over.experiment, over.u_pos, over.mode), (3, 1.0, 0), "vented in the tick of the reading");
    closed.check_replay();
}

#[test]
fn a_lost_link_aborts_it_and_what_was_recorded_is_kept() {
    let laboratory = laboratory("");
    laboratory.stand_by();
    let client = Running::start(&mut experiment(&laboratory, &programme(6000)));
    laboratory.wait_for("playing", |status| status["experiment"]["phase"] == "playing");
    laboratory.rig.signal("KILL");
    let ended = client.wait(SOON);
    assert!(ended.status == Some(1) && ended.stderr.contains("experiment aborted after"), "{ended:?}");
    let content = read_mcap(&laboratory.recordings("experiment-")[0]).unwrap();
    assert!(content.ticks.iter().any(|tick| tick.experiment == 2));
    assert!(content.events.iter().any(|event| event.message.starts_with("EXPERIMENT ABORTED after")));
    let closed = laboratory.close();
    closed.check_replay();
}

/// A file that is lost is followed by another, which has the rows from there on and is the one that is named.
#[test]
fn a_recording_that_goes_on_in_another_file_is_named_by_it() {
    let laboratory = laboratory("");
    laboratory.stand_by();
    let _client = Running::start(&mut experiment(&laboratory, &programme(6000)));
    laboratory.wait_for("playing", |status| status["experiment"]["phase"] == "playing");
    std::fs::remove_file(&laboratory.recordings("experiment-")[0]).unwrap();
    let status = laboratory.wait_for("concluded", |status| status["experiment"]["outcome"].is_object());
    let outcome = &status["experiment"]["outcome"];
    let problem = outcome["recording_problem"].as_str().unwrap_or_default();
    assert!(outcome["aborted"].is_null() && problem.contains("removed"), "{outcome}");
    let left = laboratory.recordings("experiment-");
    let [file] = left.as_slice() else { panic!("{left:?}") };
    assert_eq!(outcome["recording"], file.to_str().unwrap(), "{outcome}");
    let content = read_mcap(file).unwrap();
    assert!(content.complete);
    assert_eq!(outcome["ticks_recorded"], content.ticks.len(), "{outcome}");
    let last = content.ticks.iter().rfind(|tick| tick.experiment == 2 && tick.mode == RUN).unwrap();
    let row = programme(6000)[5999];
    assert_eq!((last.u_pos, last.u_neg), (row.0, row.1), "up to the last row");
    laboratory.close();
}

#[test]
fn a_daemon_that_is_told_to_end_ends_it_and_finishes_both_recordings() {
    let laboratory = laboratory("");
    laboratory.stand_by();
    let _client = Running::start(&mut experiment(&laboratory, &programme(6000)));
    laboratory.wait_for("playing", |status| status["experiment"]["phase"] == "playing");
    let closed = laboratory.close();
    let content = read_mcap(&closed.recordings("experiment-")[0]).unwrap();
    let last = content.events.last().unwrap();
    assert!(
        last.message.starts_with("EXPERIMENT ABORTED after") && last.message.contains("stopped by hand"),
        "{last:?}"
    );
}

#[test]
fn what_the_model_in_force_forbids_is_refused_as_bad_input_and_nothing_moves() {
    let laboratory = laboratory("");
    laboratory.stand_by();
    let shut = finish(&mut experiment(&laboratory, &[(0.0, 0.0, 1); 500]));
    assert!(shut.status == Some(2) && shut.stderr.contains("passes safety."), "{shut:?}");
    let nobody = finish(
        Command::new(program("controller"))
            .arg("experiment")
            .arg(laboratory.folder.join("e.csv"))
            .args(["--socket", laboratory.folder.join("nobody").to_str().unwrap()]),
    );
    assert!(nobody.status == Some(2) && nobody.stderr.contains("no daemon answers"), "{nobody:?}");
    let closed = laboratory.close();
    let ticks = closed.ticks();
    assert!(ticks.iter().all(|tick| tick.experiment == 0 && tick.mode != RUN));
    assert!(closed.recordings("experiment-").is_empty());
}
