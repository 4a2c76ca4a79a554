//! A cRIO that is configured by its name, and a name server that does not answer: the daemon stays what it is meanwhile.
//!
//! In a network and mount namespace of its own, where the only name server is a socket that nobody answers on. Where the system
//! allows no such namespace, or has no python3, the test says so and is passed over.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

mod process;
use process::{Folder, Running, SOON, alone, controller, finish};

/// Becomes the program that its arguments name, beside a name server that notes that it was asked and answers nobody. It ends
/// with the program.
const SILENT_NAME_SERVER: &str = r#"
import fcntl, os, socket, struct, subprocess, sys
folder, program = sys.argv[1], sys.argv[2:]
for name, text in [("resolv.conf", "nameserver 127.0.0.1\n"), ("nsswitch.conf", "hosts: dns\n")]:
    if os.path.exists("/etc/" + name):
        with open(folder + "/" + name, "w") as file:
            file.write(text)
        subprocess.run(["mount", "--bind", folder + "/" + name, "/etc/" + name], check=True)
server = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
SIOCSIFFLAGS, UP = 0x8914, 1
fcntl.ioctl(server, SIOCSIFFLAGS, struct.pack("16sh14x", b"lo", UP))
server.bind(("127.0.0.1", 53))
parent = os.getpid()
if os.fork() == 0:
    os.close(1)
    os.close(2)
    server.settimeout(0.1)
    while os.getppid() == parent:
        try:
            server.recv(512)
            open(folder + "/asked", "w").close()
        except socket.timeout:
            pass
    os._exit(0)
os.execv(program[0], program)
"#;

/// A program in the namespace.
fn unshared(arguments: &[&str]) -> Command {
    let mut command = Command::new("unshare");
    command.args(["--map-root-user", "--net", "--mount"]).args(arguments);
    command
}

/// Tells whether a namespace with a name server of its own can be had here; says so where it cannot.
fn can_be_tried() -> bool {
    let may = |arguments: &[&str]| unshared(arguments).stderr(Stdio::null()).status().is_ok_and(|s| s.success());
    let can = may(&["mount", "--bind", "/etc/hosts", "/etc/resolv.conf"]) && may(&["python3", "-c", "pass"]);
    if !can {
        eprintln!("passed over: no namespace with a name server of its own can be had here, or no python3");
    }
    can
}

/// The controller with this command, beside a silent name server, and the file of a configuration that names its cRIO.
fn beside_it(folder: &Folder, command: &str) -> (Running, PathBuf) {
    let config = folder.write(
        "c.toml",
        "link.address = \"crio.example:50500\"\npolicy.active = \"fallback\"\ncontrol.socket = \"s\"\n\
         realtime.enforce = false\n",
    );
    let running = Running::start(
        unshared(&["python3", "-c", SILENT_NAME_SERVER])
            .arg(folder.join(""))
            .args([env!("CARGO_BIN_EXE_controller"), command, "--config"])
            .arg(&config),
    );
    (running, config)
}

/// Looking up a name costs `check` a few seconds and no more, and is no reason to refuse the file.
#[test]
fn a_check_waits_a_few_seconds_for_a_name_server() {
    if !can_be_tried() {
        return;
    }
    let _alone = alone();
    let folder = Folder::new();
    let (checked, _) = beside_it(&folder, "check");
    let ended = checked.wait();
    assert!(folder.join("asked").exists(), "{ended:?}");
    assert!(ended.stderr.contains("crio.example:50500: no name server has answered within 3 s"), "{ended:?}");
    assert!(ended.stdout.contains("sound") && ended.status == Some(0), "{ended:?}");
    assert!(ended.stdout.contains("sound but for what is remarked above"), "{ended:?}");
}

#[test]
fn the_end_does_not_wait_for_a_name_server() {
    if !can_be_tried() {
        return;
    }
    let _alone = alone();
    let folder = Folder::new();
    let (daemon, config) = beside_it(&folder, "run");
    let until = Instant::now() + SOON;
    while !folder.join("asked").exists() {
        assert!(Instant::now() < until, "nobody asked for the name: {}", daemon.stderr());
        std::thread::sleep(Duration::from_millis(5));
    }
    let status = finish(&mut controller(&["status", "--config"], &config));
    assert!(status.stdout.contains("connecting"), "{status:?}");
    // A server that does not answer is asked twice, for 5 s each; the daemon gives its tick's thread up after 3 s, with status 1.
    daemon.signal("TERM");
    let ended = daemon.wait();
    assert_eq!(ended.status, Some(0), "{ended:?}");
    assert!(!ended.stderr.contains("did not end"), "{ended:?}");
}
