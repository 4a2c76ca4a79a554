//! The operator's side of a running daemon, over its real socket and with real signals: many clients, slow clients,
//! clients that leave, files that are none, and a run that always ends.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use proto::emulator::EmulatorHandle;
use proto::recording::{McapContent, read_mcap};
use serde_json::{Value, json};

mod process;
use process::{Folder, Running, SOON, alone, controller, emulated_crio, finish};

/// A request that waits for nothing but the tick, on a busy machine.
const AT_ONCE: Duration = Duration::from_secs(2);

/// A configuration in lockstep, with everything in the folder of its file.
fn configuration(address: &str) -> String {
    format!(
        "[link]\naddress = \"{address}\"\npacing = \"lockstep\"\n[control]\nsocket = \"s\"\n[realtime]\nenforce = false\n\
         [record]\ndirectory = \"r\"\nmin_free_mib = 16\n"
    )
}

struct Laboratory {
    folder: Folder,
    config: PathBuf,
    rig: EmulatorHandle,
    daemon: Running,
}

impl Laboratory {
    fn new(more: &str) -> Self {
        let rig = emulated_crio();
        let folder = Folder::new();
        let config = folder.write("controller.toml", configuration(&rig.local_addr().to_string()) + more);
        let daemon = Running::start(&mut controller(&["run", "--config"], &config));
        daemon.line("opened");
        let laboratory = Laboratory { folder, config, rig, daemon };
        laboratory.wait_for("armable", |r| r["status"]["can_arm"] == true);
        laboratory
    }

    fn connect(&self) -> UnixStream {
        let stream = UnixStream::connect(self.folder.join("s")).unwrap();
        stream.set_read_timeout(Some(SOON)).unwrap();
        stream
    }

    /// Sends bytes as they are and reads the answer.
    fn raw(&self, bytes: &[u8]) -> Value {
        let mut stream = self.connect();
        stream.write_all(bytes).unwrap();
        answer(stream)
    }

    fn ask(&self, request: &Value) -> Value {
        self.raw(format!("{request}\n").as_bytes())
    }

    fn state(&self) -> String {
        self.ask(&json!({"ask": "status"}))["state"].as_str().unwrap().to_owned()
    }

    /// Arms; once more where this machine stalled for so long that the daemon took the order back.
    fn arm(&self) {
        let ask = || self.ask(&json!({"ask": "arm"}));
        let mut reply = ask();
        if reply["error"].as_str().is_some_and(|error| error.starts_with("it did not start in time")) {
            reply = ask();
        }
        assert_eq!(reply["ok"], true, "{reply}");
    }

    fn wait_for(&self, what: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        let until = Instant::now() + SOON;
        loop {
            let reply = self.ask(&json!({"ask": "status"}));
            if wanted(&reply) {
                return reply;
            }
            assert!(Instant::now() < until, "not {what} in {SOON:?}: {reply}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Disarms by the program itself, which must be done at once.
    fn disarm_at_once(&self) {
        let begun = Instant::now();
        let ended = finish(&mut controller(&["disarm", "--config"], &self.config));
        assert_eq!(ended.status, Some(0), "{ended:?}");
        assert!(begun.elapsed() < AT_ONCE, "{:?}", begun.elapsed());
        assert_eq!(self.state(), "standby");
    }

    /// Ends both in order; the recording and what the daemon said.
    fn close(self) -> (McapContent, String) {
        self.daemon.signal("TERM");
        let daemon = self.daemon.wait();
        assert_eq!(daemon.status, Some(0), "{daemon:?}");
        self.rig.stop();
        let names = self.folder.names("r");
        let last = names.last().expect("a recording");
        (read_mcap(&self.folder.join("r").join(last)).unwrap(), daemon.stderr)
    }
}

fn answer(stream: UnixStream) -> Value {
    let mut line = String::new();
    BufReader::new(stream).read_line(&mut line).unwrap();
    serde_json::from_str(&line).unwrap_or_else(|e| panic!("{e}: {line:?}"))
}

fn said(content: &McapContent, words: &[&str]) -> bool {
    content.events.iter().any(|event| words.iter().all(|word| event.message.contains(word)))
}

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

#[test]
fn signals_reload_or_do_nothing_and_the_rig_runs_on() {
    let _alone = alone();
    let laboratory = Laboratory::new("");
    laboratory.arm();
    for name in ["USR1", "USR2", "QUIT", "ALRM", "VTALRM", "PROF", "IO", "TSTP", "TTOU", "TTIN", "XFSZ", "PIPE"] {
        laboratory.daemon.signal(name);
    }
    laboratory.daemon.line("SIGQUIT does nothing");
    assert_eq!(laboratory.state(), "run");
    // A file that is not sound changes nothing and is named by line.
    let text = std::fs::read_to_string(&laboratory.config).unwrap();
    laboratory.folder.write("controller.toml", format!("{text}\n[safty]\n"));
    laboratory.daemon.signal("HUP");
    let line = laboratory.daemon.line("safty");
    assert!(line.contains("controller.toml: line ") && line.contains("stays as it was"), "{line}");
    // One that is sound says what was taken over and what was not.
    let changed =
        text.replace("min_free_mib = 16", "min_free_mib = 17\nmax_minutes = 9") + "\n[safety]\nmax_pos_kpa = 150.0\n";
    laboratory.folder.write("controller.toml", changed);
    laboratory.daemon.signal("HUP");
    let line = laboratory.daemon.line("taken over");
    assert!(line.contains("needs a restart: safety"), "{line}");
    assert_eq!(laboratory.state(), "run", "none of this moved the rig");
    let (content, _) = laboratory.close();
    assert!(content.complete && said(&content, &["taken over"]), "{:?}", content.events);
}

/// A file that is read again does not get a reference past what the daemon was started with, nor an operator's out of the way.
#[test]
fn a_reference_that_is_read_again_is_examined_as_any_other() {
    let _alone = alone();
    let laboratory = Laboratory::new("");
    let reference = |name: &str, rows: &str| {
        laboratory.folder.write(name, format!("time_s,ref_pos_kpa,ref_neg_kpa\n{rows}"));
    };
    reference("high.csv", "0,190,-70\n10,190,-70\n");
    reference("short.csv", "0,85,-70\n0.1,85,-70\n");
    reference("a.csv", "0,85,-93\n10,85,-93\n");
    let text = std::fs::read_to_string(&laboratory.config).unwrap();
    let reload = |more: &str| {
        laboratory.folder.write("controller.toml", format!("{text}{more}"));
        laboratory.daemon.signal("HUP");
    };
    let followed = || laboratory.ask(&json!({"ask": "status"}))["running"]["reference"].clone();
    let named = |name: &str| Value::from(laboratory.folder.join(name).to_str().unwrap());
    let first = followed();

    // Its own file allows it, and the limits of the start do not.
    reload("[safety]\nmax_pos_kpa = 200.0\n[reference]\nfile = \"high.csv\"\n");
    let line = laboratory.daemon.line("high.csv not taken over");
    assert!(line.contains("safety.max_pos_kpa = 160 kPa") && line.contains("restart"), "{line}");
    laboratory.daemon.line("needs a restart: safety");
    // What the next start would refuse is no sound file.
    reload("[reference]\nfile = \"short.csv\"\nrepeat = true\n");
    let line = laboratory.daemon.line("it lasts 0.1 s");
    assert!(line.contains("short.csv") && line.contains("stays as it was"), "{line}");
    assert_eq!(followed(), first);

    reload("[reference]\nfile = \"a.csv\"\n");
    laboratory.daemon.line("a.csv taken over");
    laboratory.daemon.line("2.0 kPa inside the safety envelope");
    assert_eq!(followed(), named("a.csv"));

    // An operator's stays where [reference] is as it was.
    let operators =
        json!({"ask": "reference", "file": "/home/a/o.csv", "csv": "time_s,ref_pos_kpa,ref_neg_kpa\n0,85,-72\n"});
    assert_eq!(laboratory.ask(&operators)["ok"], true);
    reload("[reference]\nfile = \"a.csv\"\nlearn = true\n");
    laboratory.daemon.line("needs a restart: reference.learn");
    // The desk takes them in their order, so with this one it has looked at that one, too.
    reload("");
    let line = laboratory.daemon.line("reference the paper's taken over");
    assert!(!line.contains("not taken over"), "{line}");
    assert_eq!(followed(), "the paper's");
    let (_, stderr) = laboratory.close();
    assert_eq!(stderr.matches("a.csv taken over").count(), 1, "{stderr}");
}

#[test]
fn every_signal_that_ends_the_run_vents_says_goodbye_and_finishes_the_recording() {
    let _alone = alone();
    for name in ["TERM", "INT", "XCPU"] {
        let laboratory = Laboratory::new("");
        laboratory.arm();
        laboratory.daemon.signal(name);
        let daemon = laboratory.daemon.wait();
        assert_eq!(daemon.status, Some(0), "SIG{name}: {daemon:?}");
        let names = laboratory.folder.names("r");
        assert!(names.len() == 1 && !names[0].contains("partial"), "{names:?}");
        assert!(read_mcap(&laboratory.folder.join("r").join(&names[0])).unwrap().complete);
        let mode = std::fs::metadata(laboratory.folder.join("r").join(&names[0])).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o640, "{mode:o}");
    }
}

/// A child with pipes that nobody ever reads.
fn unread(arguments: &[&str], config: &Path) -> Child {
    let mut command = controller(arguments, config);
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

#[test]
fn pipes_that_nobody_reads_hold_neither_the_recording_nor_the_end() {
    let _alone = alone();
    let rig = emulated_crio();
    let folder = Folder::new();
    let config = folder.write("c.toml", configuration(&rig.local_addr().to_string()));
    let mut daemon = unread(&["run", "--config"], &config);
    let socket = folder.join("s");
    let until = Instant::now() + SOON;
    // Each refused request is a line of a hundred characters: far more than a pipe's 64 KiB.
    let mut asked = 0;
    while asked < 2_000 {
        assert!(Instant::now() < until, "{asked} requests");
        let Ok(mut client) = UnixStream::connect(&socket) else {
            std::thread::sleep(Duration::from_millis(20));
            continue;
        };
        client.set_read_timeout(Some(AT_ONCE)).unwrap();
        client.write_all(b"{\"ask\":\"reference\",\"file\":\"/nowhere/at/all\"}\n").unwrap();
        let mut reply = String::new();
        BufReader::new(client).read_to_string(&mut reply).unwrap();
        assert!(reply.contains("\"ok\":false"), "{reply}");
        asked += 1;
    }
    let begun = Instant::now();
    let killed = Command::new("kill").args(["-TERM", &daemon.id().to_string()]).status().unwrap();
    assert!(killed.success());
    let status = loop {
        if let Some(status) = daemon.try_wait().unwrap() {
            break status;
        }
        assert!(begun.elapsed() < Duration::from_secs(20), "SIGTERM does not end it");
        std::thread::sleep(Duration::from_millis(10));
    };
    assert_eq!(status.code(), Some(0));
    println!("ended {:.2} s after SIGTERM", begun.elapsed().as_secs_f64());
    let names = folder.names("r");
    assert!(names.len() == 1 && !names[0].contains("partial"), "{names:?}");
    assert!(read_mcap(&folder.join("r").join(&names[0])).unwrap().complete);
    rig.stop();
}

#[test]
fn a_path_that_is_no_socket_is_left_alone() {
    let _alone = alone();
    let folder = Folder::new();
    let precious = folder.write("precious", "years of work");
    let config = folder.write(
        "c.toml",
        "[link]\naddress = \"127.0.0.1:1\"\n[control]\nsocket = \"precious\"\n[realtime]\nenforce = false\n",
    );
    for command in ["run", "check"] {
        let ended = finish(&mut controller(&[command, "--config"], &config));
        assert_ne!(ended.status, Some(0), "{ended:?}");
        assert!(ended.stderr.contains("precious") && ended.stderr.contains("no socket"), "{ended:?}");
        assert_eq!(std::fs::read_to_string(&precious).unwrap(), "years of work");
    }
}

#[test]
fn without_a_crio_it_says_so_and_leaves_no_recording() {
    let _alone = alone();
    let folder = Folder::new();
    let config = folder.write(
        "c.toml",
        "[link]\naddress = \"127.0.0.1:1\"\n[record]\ndirectory = \"r\"\nmin_free_mib = 16\n[control]\nsocket = \"s\"\n[realtime]\nenforce = false\n",
    );
    let daemon = Running::start(&mut controller(&["run", "--config"], &config));
    daemon.line("trying again");
    daemon.signal("TERM");
    let ended = daemon.wait();
    assert_eq!(ended.status, Some(0), "{ended:?}");
    assert!(ended.stderr.contains("nothing was recorded"), "{ended:?}");
    assert!(folder.names("r").is_empty(), "{:?}", folder.names("r"));
}

#[test]
fn a_configuration_that_is_no_file_is_refused_at_once() {
    let folder = Folder::new();
    let fifo = folder.join("fifo.toml");
    assert!(Command::new("mkfifo").arg(&fifo).status().unwrap().success());
    for path in [fifo.as_path(), Path::new("/dev/zero"), folder.join("").as_path()] {
        for command in ["check", "run", "status"] {
            let ended = finish(&mut controller(&[command, "--config"], path));
            assert_eq!((ended.status, ended.stderr.trim_end().lines().count()), (Some(2), 1), "{ended:?}");
            assert!(ended.stderr.contains("not a regular file"), "{ended:?}");
        }
    }
    let other = folder.write("c.toml", format!("[link]\naddress = \"127.0.0.1:1\"\n[rig]\nfile = {fifo:?}\n"));
    let ended = finish(&mut controller(&["check", "--config"], &other));
    assert!(ended.status == Some(2) && ended.stderr.contains("named pipe"), "{ended:?}");
}
