//! A daemon's configuration read again, and its end: signals, pipes that nobody reads, and paths at which it must not begin.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::io::{BufReader, Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use proto::recording::read_mcap;
use rustix::process::Signal;
use serde_json::{Value, json};
use signal_hook::consts::{SIGALRM, SIGHUP, SIGPIPE, SIGQUIT, SIGUSR1};

mod operated_daemon;
mod process;
use operated_daemon::{AT_ONCE, Laboratory, configuration, said};
use process::{Folder, Running, SOON, alone, controller, emulated_crio, finish};

#[test]
fn signals_reload_or_do_nothing_and_the_rig_runs_on() {
    let _alone = alone();
    let laboratory = Laboratory::new("");
    laboratory.arm();
    // By its number: not every shell has a name for it.
    let stack_fault = Signal::STKFLT.as_raw().to_string();
    let named = ["USR1", "USR2", "QUIT", "ALRM", "VTALRM", "PROF", "IO", "TSTP", "TTOU", "TTIN", "XFSZ", "PIPE"];
    for name in named.into_iter().chain([stack_fault.as_str()]) {
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
    assert!(said(&content, &["stopping at tick"]), "the end shows as the state it is: {:?}", content.events);
}

/// Signals that a process has handlers for, one bit each: bit 0 is signal 1.
fn handled(pid: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigCgt:"));
    mask.map_or(0, |mask| u64::from_str_radix(mask.trim(), 16).unwrap())
}

/// Examining a policy takes seconds, in which a closed terminal or `systemctl reload` must not end the start; an order to end does.
#[test]
fn signals_that_come_while_it_starts_end_nothing_but_the_orders_to_end() {
    let _alone = alone();
    let rig = emulated_crio();
    let folder = Folder::new();
    let address = rig.local_addr().to_string();
    let config = folder.write("c.toml", configuration(&address) + "[policy]\nactive = \"own\"\n");
    std::fs::create_dir(folder.join("policies")).unwrap();
    std::fs::copy(concat!(env!("CARGO_MANIFEST_DIR"), "/policies/default.onnx"), folder.join("policies/own.onnx"))
        .unwrap();
    let sent = [("HUP", SIGHUP), ("USR1", SIGUSR1), ("QUIT", SIGQUIT), ("ALRM", SIGALRM), ("PIPE", SIGPIPE)];
    let all = sent.iter().fold(0, |mask, (_, number)| mask | 1_u64 << (number - 1));
    let starting = || {
        let daemon = Running::start(&mut controller(&["run", "--config"], &config));
        let until = Instant::now() + SOON;
        // Handlers are registered one after the other.
        while handled(daemon.pid()) & all != all {
            assert!(Instant::now() < until, "{}", daemon.stderr());
            std::thread::sleep(Duration::from_millis(1));
        }
        assert_eq!(daemon.stderr(), "", "it has started before it was ready for signals");
        daemon
    };
    let daemon = starting();
    for (name, _) in sent {
        daemon.signal(name);
    }
    daemon.line("opened");
    daemon.line("SIGUSR1 does nothing");
    daemon.line("configuration read again");
    daemon.signal("TERM");
    let ended = daemon.wait();
    assert_eq!(ended.status, Some(0), "{ended:?}");

    for name in ["TERM", "INT", "XCPU", "PWR"] {
        let daemon = starting();
        daemon.signal(name);
        let ended = daemon.wait();
        assert_eq!((ended.status, ended.stderr.as_str()), (None, ""), "SIG{name} ends it at once: {ended:?}");
    }
    rig.stop();
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
    for name in ["TERM", "INT", "XCPU", "PWR"] {
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
