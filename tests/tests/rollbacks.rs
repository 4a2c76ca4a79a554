//! Orders of operators on policies are answered and done whatever becomes of the file that says who did what, and are recorded with their outcome.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::io::Write;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tests::Stream::Err;
use tests::laboratory::{Laboratory, Plan, RECORDINGS, SOCKET, SOON};

/// A daemon that the shipped policy controls, whatever it is worth on the model.
const LINES: &str = "policy.active = \"default\"\npolicy.when_behind = \"fly\"";
/// Between two looks.
const MOMENT: Duration = Duration::from_millis(20);

fn audit(laboratory: &Laboratory) -> PathBuf {
    laboratory.folder.join(RECORDINGS).join("policies.audit.jsonl")
}

/// Waits until the audit file has these words.
fn wait_for_audit(laboratory: &Laboratory, words: &str) {
    let written = || std::fs::read_to_string(audit(laboratory)).unwrap_or_default();
    let until = Instant::now() + SOON;
    while !written().contains(words) {
        assert!(Instant::now() < until, "`{words}` is not in: {}", written());
        std::thread::sleep(MOMENT);
    }
}

/// Puts a pipe that nobody reads in a file's place.
fn put_pipe(file: &Path) {
    let _ = std::fs::remove_file(file);
    assert!(Command::new("mkfifo").arg(file).status().unwrap().success());
}

fn done(laboratory: &Laboratory, arguments: &[&str]) {
    let ended = laboratory.ask(arguments);
    assert_eq!(ended.status, Some(0), "{arguments:?}: {ended:?}");
}

fn in_command(name: &'static str) -> impl Fn(&Value) -> bool {
    move |reply| reply["running"]["policy"] == name
}

#[test]
fn a_pipe_in_place_of_the_audit_file_denies_no_request_and_is_told() {
    let laboratory = Plan::new(LINES).start();
    laboratory.arm();
    put_pipe(&audit(&laboratory));
    done(&laboratory, &["swap", "fallback"]);
    laboratory.wait_for("the fallback", in_command("fallback"));
    done(&laboratory, &["rollback"]);
    laboratory.wait_for("the policy again", in_command("default"));
    let problem = || laboratory.ask_json(&["policies"]).0["policies_problem"].as_str().map(str::to_owned);
    let told = problem().unwrap_or_default();
    assert!(told.contains("policies.audit.jsonl") && told.contains("not a regular file; move it away"), "{told}");
    laboratory.daemon.line(Err, "who did what cannot be written", SOON);
    done(&laboratory, &["disarm"]);

    // What waited is written once it can be.
    std::fs::remove_file(audit(&laboratory)).unwrap();
    laboratory.daemon.line(Err, "the audit file can be written again", SOON);
    wait_for_audit(&laboratory, "\"rollback\"");
    wait_for_audit(&laboratory, "\"swap\"");
    assert!(problem().is_none_or(|told| !told.contains("audit")));
    laboratory.close();
}

#[test]
fn a_daemon_started_beside_a_pipe_in_place_of_the_audit_file_serves_and_ends() {
    let plan = Plan::new(LINES);
    std::fs::create_dir(plan.folder.join(RECORDINGS)).unwrap();
    put_pipe(&plan.folder.join(RECORDINGS).join("policies.audit.jsonl"));
    let laboratory = plan.start();
    laboratory.arm();
    done(&laboratory, &["disarm"]);
    laboratory.close();
}

/// Standing by, so that the order waits for a tick while whoever asked leaves: it is carried out once the rig is armed, and
/// the log says no other.
#[test]
fn a_swap_that_was_handed_over_is_recorded_as_done_although_its_asker_has_left() {
    let laboratory = Plan::new(LINES).start();
    laboratory.stand_by();
    let mut stream = UnixStream::connect(laboratory.folder.join(SOCKET)).unwrap();
    stream.write_all(format!("{}\n", json!({"ask": "swap", "name": "fallback"})).as_bytes()).unwrap();
    // Noted as soon as it is handed over; its answer waits for a tick, some tenths of a second longer.
    wait_for_audit(&laboratory, "\"swap\"");
    drop(stream);
    let line = laboratory.daemon.line(Err, "swap fallback by", SOON);
    let (again, _) = laboratory.ask_json(&["swap", "fallback"]);
    let error = again["error"].as_str().unwrap_or_default();
    assert!(line.contains("done") && error.contains("on its way already"), "{line}: {again}");
    laboratory.arm();
    laboratory.wait_for("the fallback", in_command("fallback"));
    laboratory.close().check_replay();
}

#[test]
fn what_was_answered_as_done_right_before_the_end_stands_in_the_audit_file() {
    let laboratory = Plan::new(LINES).start();
    laboratory.arm();
    done(&laboratory, &["swap", "fallback"]);
    done(&laboratory, &["rollback"]);
    let file = audit(&laboratory);
    let closed = laboratory.close();
    let written = std::fs::read_to_string(file).unwrap();
    assert!(written.contains("\"swap\"") && written.contains("\"rollback\""), "{written}");
    drop(closed);
}
