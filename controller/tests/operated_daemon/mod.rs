//! A daemon in lockstep whose operator is the test, over its real socket and with real signals.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, dead_code, unreachable_pub)]

use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use proto::emulator::EmulatorHandle;
use proto::recording::{McapContent, read_mcap};
use serde_json::{Value, json};

use crate::process::{Folder, Running, SOON, controller, emulated_crio, finish};

/// A request that waits for nothing but the tick, on a busy machine.
pub const AT_ONCE: Duration = Duration::from_secs(2);

/// A configuration in lockstep, with everything in the folder of its file.
pub fn configuration(address: &str) -> String {
    format!(
        "[link]\naddress = \"{address}\"\npacing = \"lockstep\"\n[control]\nsocket = \"s\"\n[realtime]\nenforce = false\n\
         [record]\ndirectory = \"r\"\nmin_free_mib = 16\n"
    )
}

/// An emulated cRIO, the daemon on it, and the test as its operator.
pub struct Laboratory {
    pub folder: Folder,
    pub config: PathBuf,
    pub rig: EmulatorHandle,
    pub daemon: Running,
}

impl Laboratory {
    pub fn new(more: &str) -> Self {
        let rig = emulated_crio();
        let folder = Folder::new();
        let config = folder.write("controller.toml", configuration(&rig.local_addr().to_string()) + more);
        let daemon = Running::start(&mut controller(&["run", "--config"], &config));
        daemon.line("opened");
        let laboratory = Laboratory { folder, config, rig, daemon };
        laboratory.wait_for("armable", |r| r["status"]["can_arm"] == true);
        laboratory
    }

    pub fn connect(&self) -> UnixStream {
        let stream = UnixStream::connect(self.folder.join("s")).unwrap();
        stream.set_read_timeout(Some(SOON)).unwrap();
        stream
    }

    /// Sends bytes as they are and reads the answer.
    pub fn raw(&self, bytes: &[u8]) -> Value {
        let mut stream = self.connect();
        stream.write_all(bytes).unwrap();
        answer(stream)
    }

    pub fn ask(&self, request: &Value) -> Value {
        self.raw(format!("{request}\n").as_bytes())
    }

    pub fn state(&self) -> String {
        self.ask(&json!({"ask": "status"}))["state"].as_str().unwrap().to_owned()
    }

    /// Arms; once more where this machine stalled for so long that the daemon took the order back.
    pub fn arm(&self) {
        let ask = || self.ask(&json!({"ask": "arm"}));
        let mut reply = ask();
        if reply["error"].as_str().is_some_and(|error| error.starts_with("it did not start in time")) {
            reply = ask();
        }
        assert_eq!(reply["ok"], true, "{reply}");
    }

    pub fn wait_for(&self, what: &str, wanted: impl Fn(&Value) -> bool) -> Value {
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
    pub fn disarm_at_once(&self) {
        let begun = Instant::now();
        let ended = finish(&mut controller(&["disarm", "--config"], &self.config));
        assert_eq!(ended.status, Some(0), "{ended:?}");
        assert!(begun.elapsed() < AT_ONCE, "{:?}", begun.elapsed());
        assert_eq!(self.state(), "standby");
    }

    /// Ends both in order; the recording and what the daemon said.
    pub fn close(self) -> (McapContent, String) {
        self.daemon.signal("TERM");
        let daemon = self.daemon.wait();
        assert_eq!(daemon.status, Some(0), "{daemon:?}");
        self.rig.stop();
        let names = self.folder.names("r");
        let last = names.last().expect("a recording");
        (read_mcap(&self.folder.join("r").join(last)).unwrap(), daemon.stderr)
    }
}

/// Reads one answer.
pub fn answer(stream: UnixStream) -> Value {
    let mut line = String::new();
    BufReader::new(stream).read_line(&mut line).unwrap();
    serde_json::from_str(&line).unwrap_or_else(|e| panic!("{e}: {line:?}"))
}

/// Tells whether an event of a recording holds all of these words.
pub fn said(content: &McapContent, words: &[&str]) -> bool {
    content.events.iter().any(|event| words.iter().all(|word| event.message.contains(word)))
}
