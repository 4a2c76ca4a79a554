//! The operator's side of a running daemon, over its real socket: many clients, slow clients, clients that leave, and
//! requests and files that are none. Signals and the end of a run: `signals_and_ends`.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::io::Write;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

mod operated_daemon;
mod process;
use operated_daemon::{AT_ONCE, Laboratory, answer, configuration, said};
use process::{Folder, Running, alone, controller, finish};

#[test]
fn idle_and_slow_clients_hold_nobody_and_who_asked_is_recorded() {
    let _alone = alone();
    let laboratory = Laboratory::new("");
    // More than there are places, and none of them ever says a word.
    let _idle: Vec<UnixStream> = (0..100).map(|_| laboratory.connect()).collect();
    let begun = Instant::now();
    laboratory.arm();
    assert!(begun.elapsed() < AT_ONCE, "{:?}", begun.elapsed());
    let reply = laboratory.ask(&json!({"ask": "status"}));
    let who = reply["running"]["armed_by"].as_str().unwrap();
    assert!(who.contains(&format!("pid {}", std::process::id())), "{reply}");

    // One that sends a byte now and then is cut off after its time, and holds nobody meanwhile.
    let mut slow = laboratory.connect();
    slow.write_all(b"{\"ask\":").unwrap();
    laboratory.disarm_at_once();
    std::thread::sleep(Duration::from_millis(600));
    let _ = slow.write_all(b"\"arm\"");
    std::thread::sleep(Duration::from_millis(600));
    let _ = slow.write_all(b"}\n");
    let reply = answer(slow);
    assert!(reply["ok"] == false && reply["error"].as_str().unwrap().contains("did not come whole"), "{reply}");
    assert_eq!(laboratory.state(), "standby");

    let (content, _) = laboratory.close();
    let pid = format!("pid {}", std::process::id());
    assert!(said(&content, &["arm by", &pid, "done"]), "{:?}", content.events);
    assert!(said(&content, &["disarm by", "done"]), "{:?}", content.events);
}

/// Others ask without a pause, never read, or send half: whoever disarms is answered all the same.
#[test]
fn disarming_is_answered_whoever_else_asks() {
    let _alone = alone();
    let laboratory = Laboratory::new("");
    let path = laboratory.folder.join("s");
    let over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        for bytes in [&b"{\"ask\":\"policies\"}\n"[..], b"{\"ask\":\"status\"}\n", b"{\"ask\":", b""] {
            let (over, path) = (&over, &path);
            scope.spawn(move || {
                while !over.load(Ordering::Relaxed) {
                    // A hundred at once, all of which stay for a while.
                    let mut clients: Vec<UnixStream> =
                        (0..100).filter_map(|_| UnixStream::connect(path).ok()).collect();
                    clients.iter_mut().for_each(|client| drop(client.write_all(bytes)));
                    std::thread::sleep(Duration::from_millis(5));
                }
            });
        }
        for _ in 0..10 {
            let ended = finish(&mut controller(&["disarm", "--config"], &laboratory.config));
            if ended.status != Some(0) {
                over.store(true, Ordering::Relaxed);
            }
            assert_eq!(ended.status, Some(0), "{ended:?}");
        }
        over.store(true, Ordering::Relaxed);
    });
    laboratory.arm();
    laboratory.disarm_at_once();
    laboratory.close();
}

#[test]
fn what_clients_send_is_told_in_one_short_line() {
    let _alone = alone();
    let laboratory = Laboratory::new("");
    let forged = "x\ncontroller: armed at tick 5\u{1b}[2J";
    let long = "y".repeat(2 << 20);
    for name in [forged, &long] {
        for request in [json!({"ask": "swap", "name": name}), json!({"ask": "model", "file": name})] {
            let reply = laboratory.ask(&request);
            let error = reply["error"].as_str().unwrap();
            assert!(reply["ok"] == false && !error.chars().any(char::is_control), "{error:?}");
            assert!(error.chars().count() <= 1001, "{} characters", error.len());
        }
    }
    let (content, stderr) = laboratory.close();
    assert!(!stderr.lines().any(|line| line.starts_with("controller: armed") || line.contains('\u{1b}')), "{stderr}");
    assert!(content.events.iter().all(|event| !event.message.chars().any(char::is_control)));
}

#[test]
fn what_a_client_left_behind_is_never_carried_out() {
    let _alone = alone();
    let laboratory = Laboratory::new("");
    // The daemon stands still while the request comes and the client leaves; then it goes on.
    laboratory.daemon.signal("STOP");
    for _ in 0..20 {
        let mut client = laboratory.connect();
        client.write_all(b"{\"ask\":\"arm\"}\n").unwrap();
    }
    // The program's own client gives up by itself, although nobody takes its connection.
    let begun = Instant::now();
    let ended = finish(&mut controller(&["arm", "--config"], &laboratory.config));
    assert_eq!(ended.status, Some(1), "{ended:?}");
    assert!(ended.stderr.contains("no controller answers"), "{ended:?}");
    assert!(begun.elapsed() < Duration::from_secs(10), "{:?}", begun.elapsed());
    laboratory.daemon.signal("CONT");
    std::thread::sleep(Duration::from_secs(1));
    laboratory.wait_for("in session", |r| r["state"] == "standby");
    let (content, stderr) = laboratory.close();
    assert!(content.ticks.iter().all(|tick| tick.state != 1), "it was armed late: {stderr}");
}

#[test]
fn nothing_that_is_no_request_does_harm() {
    let _alone = alone();
    let laboratory = Laboratory::new("");
    let folder = &laboratory.folder;
    let fifo = folder.join("fifo");
    assert!(Command::new("mkfifo").arg(&fifo).status().unwrap().success());
    let secret = folder.write("secret", "root:$6$secret:19000\nnext,secret\n");
    let reference = |file: &Path| laboratory.ask(&json!({"ask": "reference", "file": file}));
    for (file, word) in [
        (fifo.as_path(), "named pipe"),
        (Path::new("/dev/zero"), "device"),
        (Path::new("/dev/urandom"), "device"),
        (folder.join("").as_path(), "folder"),
        (folder.join("s").as_path(), "socket"),
        (folder.join("none.csv").as_path(), "cannot read"),
        (secret.as_path(), "no reference that can be followed"),
    ] {
        let begun = Instant::now();
        let reply = reference(file);
        let error = reply["error"].as_str().unwrap();
        assert!(reply["ok"] == false && error.contains(word) && !error.contains("$6$"), "{reply}");
        assert!(!error.contains('\n') && begun.elapsed() < AT_ONCE, "{reply}");
    }
    for bytes in [
        &b"\n"[..],
        b"\xff\xfe\n",
        b"{\"ask\":\"fly\"}\n",
        b"{\"ask\":\"arm\",\"force\":true}\n",
        b"[[[[[[[[[[[[\n",
        b"null\n",
    ] {
        let reply = laboratory.raw(bytes);
        assert!(reply["ok"] == false && reply["error"].as_str().unwrap().contains("not a request"), "{reply}");
    }
    // Longer than any request: refused or cut off, and the daemon is none the worse.
    let mut long = laboratory.connect();
    let piece = vec![b'x'; 1 << 20];
    while long.write_all(&piece).is_ok() {}
    drop(long);
    // Half a request, then gone.
    laboratory.connect().write_all(b"{\"ask\":\"arm\"}").unwrap();
    // Nested deeper than a parser's stack would take.
    let deep = laboratory.raw([vec![b'['; 200_000], vec![b'\n']].concat().as_slice());
    assert_eq!(deep["ok"], false);
    assert_eq!(laboratory.state(), "standby");
    laboratory.arm();
    laboratory.disarm_at_once();
    laboratory.close();
}

#[test]
fn a_reference_is_taken_by_its_text_and_kept_away_from_the_limits() {
    let _alone = alone();
    let laboratory = Laboratory::new("");
    let send = |text: &str| laboratory.ask(&json!({"ask": "reference", "file": "/home/a/r.csv", "csv": text}));
    let header = "time_s,ref_pos_kpa,ref_neg_kpa\n";
    let reply = send(&format!("{header}0,85,-72\n1,85,-72\n"));
    assert_eq!((&reply["ok"], &reply["running"]["reference"]), (&true.into(), &"/home/a/r.csv".into()), "{reply}");
    let reply = send(&format!("{header}0,85,-93\n"));
    assert!(
        reply["remark"].as_str().is_some_and(|remark| remark.contains("2.0 kPa inside the safety envelope")),
        "{reply}"
    );
    for (rows, words) in [
        ("0,85,-94.5\n", "only 0.5 kPa inside the safety envelope"),
        ("0,170,-70\n", "leaves the safety envelope"),
        ("0,85,x\n", "line 2, column 3"),
    ] {
        let reply = send(&format!("{header}{rows}"));
        assert!(reply["ok"] == false && reply["error"].as_str().unwrap().contains(words), "{reply}");
    }
    assert_eq!(laboratory.ask(&json!({"ask": "status"}))["status"]["reference_kpa"], Value::Null);
    laboratory.close();
}

#[test]
fn a_lost_crio_is_told_with_the_age_of_the_data() {
    let _alone = alone();
    let laboratory = Laboratory::new("");
    laboratory.arm();
    laboratory.rig.stop();
    let reply = laboratory.wait_for("without a session and with data that age", |r| {
        r["state"] == "connecting" && r["age_ms"].as_u64().is_some_and(|age| age >= 1000)
    });
    assert_eq!(reply["status"]["can_arm"], false);
    let text = finish(&mut controller(&["status", "--config"], &laboratory.config));
    assert!(text.stdout.contains("connecting") && text.stdout.contains("s ago"), "{text:?}");
    let reply = laboratory.ask(&json!({"ask": "arm"}));
    assert!(reply["ok"] == false && reply["error"].as_str().unwrap().contains("no session"), "{reply}");
    // Disarming is always possible, and stands for whatever comes.
    assert_eq!(laboratory.ask(&json!({"ask": "disarm"}))["ok"], true);
    laboratory.daemon.signal("TERM");
    assert_eq!(laboratory.daemon.wait().status, Some(0));
}

/// The monotonic clock began with the machine; data that never came has no age by it.
#[test]
fn before_the_first_data_nothing_has_an_age() {
    let _alone = alone();
    let folder = Folder::new();
    let config = folder.write("controller.toml", configuration("127.0.0.1:9"));
    let daemon = Running::start(&mut controller(&["run", "--config"], &config));
    daemon.line("trying again");
    let status = finish(&mut controller(&["status", "--config"], &config));
    assert!(status.stdout.contains("no data yet") && !status.stdout.contains("s ago"), "{status:?}");
    let armed = finish(&mut controller(&["arm", "--config"], &config));
    assert!(armed.status == Some(1) && armed.stderr.contains("no session with the cRIO yet"), "{armed:?}");
    daemon.signal("TERM");
    assert!(daemon.wait().status.is_some());
}
