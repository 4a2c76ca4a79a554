//! A laboratory: an emulated rig, the daemon on it and an operator, three processes of one machine over real sockets.
//!
//! [`Plan`] says what differs from one to the next and lays out the folder, [`Plan::start`] makes a [`Laboratory`] of it, in
//! which the test is the operator, and [`Laboratory::close`] leaves what was recorded.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use controller::config::Pacing;
use model::rig::Rig;
use proto::recording::{TickRecord, read_mcap};
use serde_json::Value;

use crate::Stream::{Err, Out};
use crate::coarse_rigs::{believed, write_coarse};
use crate::{Folder, RunStatus, Running, finish, program};

/// Generous: how long anything may take on a machine that does other things as well.
pub const SOON: Duration = Duration::from_secs(120);
/// The socket's name in the folder.
pub const SOCKET: &str = "s.sock";
/// The recordings' folder in the folder.
pub const RECORDINGS: &str = "recordings";

/// Generous: how long the replay of one tick may take on such a machine.
const REPLAY_OF_A_TICK: Duration = Duration::from_millis(2);
/// Time between two questions of a wait.
const LOOK: Duration = Duration::from_millis(20);

/// Plan of a laboratory, and the folder in which the daemon will run.
pub struct Plan {
    /// Whatever the daemon is to find beside its configuration is put here.
    pub folder: Folder,
    rig: OsString,
    pacing: Pacing,
    lines: String,
}

impl Plan {
    /// The rig `bench` in coarse steps and in lockstep, a daemon that needs to be armed; `lines` of its configuration, as `table.key = value`.
    pub fn new(lines: &str) -> Self {
        Plan { folder: Folder::new(), rig: "bench".into(), pacing: Pacing::Lockstep, lines: lines.to_owned() }
    }

    /// Another rig behind the cRIO: a built-in name, which is taken in coarse steps, or a file.
    #[must_use]
    pub fn rig(self, rig: impl Into<OsString>) -> Self {
        Plan { rig: rig.into(), ..self }
    }

    /// A tick every 20 ms, as on a rig.
    #[must_use]
    pub fn in_real_time(self) -> Self {
        Plan { pacing: Pacing::Realtime, ..self }
    }

    /// Starts the rig, then the daemon, and waits for their session.
    ///
    /// # Panics
    /// If one does not start, or they do not meet in time.
    pub fn start(self) -> Laboratory {
        let Plan { folder, mut rig, pacing, lines } = self;
        if let Some(name) = rig.to_str().filter(|name| Rig::builtin_text(name).is_some()) {
            rig = write_coarse(name, &folder).into();
        }
        let believed = believed(&folder, &lines);
        let (rig, address) = emulated_rig(&rig, pacing);
        let pacing = match pacing {
            Pacing::Realtime => "realtime",
            Pacing::Lockstep => "lockstep",
        };
        let config = folder.write(
            "controller.toml",
            format!(
                "{believed}link.address = \"{address}\"\nlink.pacing = \"{pacing}\"\nrecord.directory = \"{RECORDINGS}\"\n\
                 record.min_free_mib = 16\ncontrol.socket = \"{SOCKET}\"\n{lines}\n"
            ),
        );
        let daemon = Running::start(&mut controller(&["run"], &config));
        daemon.line(Err, "opened", SOON);
        Laboratory { daemon, rig, config, folder }
    }
}

/// A daemon at work on an emulated rig.
pub struct Laboratory {
    /// `controller run`.
    pub daemon: Running,
    /// `trainer rig`.
    pub rig: Running,
    /// The daemon's configuration.
    pub config: PathBuf,
    /// Place where both run.
    pub folder: Folder,
}

impl Laboratory {
    /// An operator's command to this daemon.
    pub fn command(&self, arguments: &[&str]) -> Command {
        controller(arguments, &self.config)
    }

    /// Asks as an operator does.
    ///
    /// # Panics
    /// If no answer comes.
    pub fn ask(&self, arguments: &[&str]) -> RunStatus {
        finish(&mut self.command(arguments))
    }

    /// Asks with `--json`: the answer and the exit status.
    ///
    /// # Panics
    /// If the answer is no JSON.
    pub fn ask_json(&self, arguments: &[&str]) -> (Value, Option<i32>) {
        let ended = finish(self.command(arguments).arg("--json"));
        let reply = serde_json::from_str(&ended.stdout).unwrap_or_else(|e| panic!("{arguments:?}: {e}: {ended:?}"));
        (reply, ended.status)
    }

    /// The whole answer to `controller status`.
    ///
    /// # Panics
    /// If the daemon does not answer.
    pub fn status(&self) -> Value {
        let (reply, status) = self.ask_json(&["status"]);
        assert_eq!((status, &reply["ok"]), (Some(0), &true.into()), "{reply}");
        reply
    }

    /// Asks for the status until it is as wanted.
    ///
    /// # Panics
    /// If it is not in time.
    pub fn wait_for(&self, what: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        let until = Instant::now() + SOON;
        loop {
            let status = self.status();
            if wanted(&status) {
                return status;
            }
            assert!(Instant::now() < until, "not {what} in {SOON:?}: {status}");
            std::thread::sleep(LOOK);
        }
    }

    /// Waits until the rig stands by and can be armed.
    ///
    /// # Panics
    /// If it cannot in time.
    pub fn stand_by(&self) {
        self.wait_for("standing by", |reply| reply["status"]["can_arm"] == true);
    }

    /// Arms as soon as it can be.
    ///
    /// # Panics
    /// If it is refused again and again.
    pub fn arm(&self) {
        // Between the status and the asking many ticks pass in lockstep, and the rig may have something to say in one of them.
        let until = Instant::now() + SOON;
        loop {
            self.stand_by();
            let ended = self.ask(&["arm"]);
            if ended.status == Some(0) {
                return;
            }
            assert!(Instant::now() < until, "{ended:?}");
        }
    }

    /// Recordings whose names begin so, in order.
    pub fn recordings(&self, stem: &str) -> Vec<PathBuf> {
        recordings(&self.folder, RECORDINGS, stem)
    }

    /// Ends both, the daemon first.
    ///
    /// # Panics
    /// If one does not end in time, or the daemon not well.
    pub fn close(self) -> Closed {
        self.daemon.terminate();
        let daemon = self.daemon.wait(SOON);
        assert_eq!(daemon.status, Some(0), "{daemon:?}");
        self.rig.terminate();
        Closed { daemon, rig: self.rig.wait(SOON), folder: self.folder }
    }
}

/// Things that a laboratory leaves.
pub struct Closed {
    /// End of the daemon: a good one.
    pub daemon: RunStatus,
    /// End of the rig.
    pub rig: RunStatus,
    /// Place where both ran.
    pub folder: Folder,
}

impl Closed {
    /// Recordings whose names begin so, in order.
    pub fn recordings(&self, stem: &str) -> Vec<PathBuf> {
        recordings(&self.folder, RECORDINGS, stem)
    }

    /// The ticks of the run, from all of its files.
    ///
    /// # Panics
    /// If a recording cannot be read.
    pub fn ticks(&self) -> Vec<TickRecord> {
        ticks(&self.recordings("run-"))
    }

    /// Replays the run from all of its files, and answers what was found.
    ///
    /// # Panics
    /// As [`check_replay`].
    pub fn check_replay(&self) -> Value {
        check_replay(&self.recordings("run-"))
    }
}

/// Replays a run from all of its files, and answers what was found.
///
/// # Panics
/// If a bit differs, or a tick was not compared.
pub fn check_replay(files: &[PathBuf]) -> Value {
    let ticks = ticks(files).len();
    let mut command = Command::new(program("controller"));
    let replay = Running::start(command.args(["replay", "--json"]).args(files));
    let ended = replay.wait(SOON + REPLAY_OF_A_TICK * u32::try_from(ticks).unwrap_or(u32::MAX));
    assert_eq!(ended.status, Some(0), "{ended:?}");
    let found: Value = serde_json::from_str(&ended.stdout).unwrap_or_else(|e| panic!("{e}: {ended:?}"));
    assert_eq!(found["ticks"], ticks, "{found}");
    found
}

/// An emulated cRIO with a rig behind it, a built-in name or a file, and the address that it listens on.
///
/// # Panics
/// If it does not start.
pub fn emulated_rig(rig: &OsStr, pacing: Pacing) -> (Running, String) {
    let pace = match pacing {
        Pacing::Realtime => "real",
        Pacing::Lockstep => "lockstep",
    };
    let mut command = Command::new(program("trainer"));
    command.args(["rig", "--listen", "127.0.0.1:0", "--pace", pace, "--rig"]).arg(rig);
    let rig = Running::start(&mut command);
    let address = rig.line(Out, "listening on ", SOON).rsplit_once(' ').expect("an address").1.to_owned();
    (rig, address)
}

/// `controller` with arguments, for a configuration.
fn controller(arguments: &[&str], config: &Path) -> Command {
    let mut command = Command::new(program("controller"));
    command.args(arguments).arg("--config").arg(config);
    command
}

/// Ticks of these recordings.
fn ticks(files: &[PathBuf]) -> Vec<TickRecord> {
    let read = |file: &PathBuf| read_mcap(file).unwrap_or_else(|e| panic!("{}: {e}", file.display())).ticks;
    files.iter().flat_map(read).collect()
}

/// Recordings in a subfolder whose names begin so, in order.
pub fn recordings(folder: &Folder, subfolder: &str, stem: &str) -> Vec<PathBuf> {
    let names = folder.names(subfolder);
    let is_one = |name: &&String| name.starts_with(stem) && name.ends_with(".mcap");
    names.iter().filter(is_one).map(|name| folder.join(subfolder).join(name)).collect()
}
