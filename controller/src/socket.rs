//! The operator's Unix socket: one JSON object per line, asked and answered.
//!
//! `{"ask":"status"}`, `{"ask":"arm"}`, `{"ask":"disarm"}`, `{"ask":"reference","file":"/abs/path.csv"}`; the
//! answer is `{"ok":true, …}` or `{"ok":false,"error":"one line"}`. Files are read here, never in the tick.

use std::io::{self, BufRead, BufReader, Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use flight::RecorderHealth;
use proto::reference::Reference;
use serde::{Deserialize, Serialize};

use crate::config::Safety;
use crate::mailbox::{OperatorMailbox, Request, Status};
use crate::state::State;

/// Longest line that is read from a client.
const LONGEST_LINE: u64 = 64 * 1024;
/// How long a client may take.
const PATIENCE: Duration = Duration::from_millis(1000);
/// How long arming may take to show.
const EFFECT: Duration = Duration::from_millis(500);

/// A question.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "ask", rename_all = "snake_case", deny_unknown_fields)]
pub enum Ask {
    /// What is it doing?
    Status {},
    /// Control the pressures.
    Arm {},
    /// Open the vents.
    Disarm {},
    /// Follow another reference.
    Reference {
        /// Absolute path of the CSV file.
        file: PathBuf,
    },
}

/// An answer.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Reply {
    /// Whether it was done.
    pub ok: bool,
    /// Why not, one line.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// The state's name.
    #[serde(default)]
    pub state: String,
    /// The newest status; absent before the first tick.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub status: Option<Status>,
    /// What is wrong with the recording, if anything.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recording_problem: Option<String>,
}

/// Why the socket cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SocketError {
    /// Another daemon is there.
    #[error("{}: another controller answers on this socket; stop it, or set control.socket", .path.display())]
    InUse {
        /// The socket.
        path: PathBuf,
    },
    /// It cannot be made.
    #[error("{}: the operator's socket cannot be made: {source}; set control.socket to a place that can be written", .path.display())]
    Make {
        /// The socket.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Nobody answers.
    #[error("{}: no controller answers there ({source}); is it running, and is this its control.socket?", .path.display())]
    Silent {
        /// The socket.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The answer is none.
    #[error("{}: the answer makes no sense; is it the same version of controller?", .path.display())]
    Nonsense {
        /// The socket.
        path: PathBuf,
    },
}

/// What an operator may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum May {
    /// Everything.
    Fly,
    /// Look on and disarm: an experiment is under way.
    OnlyStop,
}

/// The socket's thread.
pub struct Served {
    thread: JoinHandle<()>,
    path: PathBuf,
}

impl Served {
    /// Waits for the thread, which ends once the daemon's stop flag is set, and removes the socket.
    pub fn join(self) {
        let _ = self.thread.join();
        let _ = std::fs::remove_file(&self.path);
    }
}

/// Refuses a socket that another daemon answers on; changes nothing.
///
/// # Errors
/// If one answers.
pub fn check_free(path: &Path) -> Result<(), SocketError> {
    if UnixStream::connect(path).is_ok() {
        return Err(SocketError::InUse { path: path.to_owned() });
    }
    Ok(())
}

/// Makes the socket and answers on it until `stop` is set.
///
/// # Errors
/// If it cannot be made, or another daemon answers on it.
pub fn serve(
    path: &Path,
    mailbox: OperatorMailbox,
    safety: Safety,
    health: RecorderHealth,
    stop: Arc<AtomicBool>,
    may: May,
) -> Result<Served, SocketError> {
    let make = |source| SocketError::Make { path: path.to_owned(), source };
    if path.exists() {
        check_free(path)?;
        // What a daemon that was killed left behind.
        std::fs::remove_file(path).map_err(make)?;
    }
    let listener = UnixListener::bind(path).map_err(make)?;
    // Whoever may write here may vent the rig or start it: owner and group only.
    std::fs::set_permissions(path, PermissionsExt::from_mode(0o660)).map_err(make)?;
    listener.set_nonblocking(true).map_err(make)?;
    let mut desk = Desk { mailbox, safety, health, may, newest: None };
    let thread = std::thread::Builder::new()
        .name("ctl".to_owned())
        .spawn(move || {
            while !stop.load(Ordering::Relaxed) {
                match listener.accept() {
                    Ok((client, _)) => {
                        // A client that goes away in the middle is its own trouble.
                        let _ = desk.serve(&client);
                    }
                    Err(_) => std::thread::sleep(Duration::from_millis(20)),
                }
            }
        })
        .map_err(make)?;
    Ok(Served { thread, path: path.to_owned() })
}

/// Answers clients.
struct Desk {
    mailbox: OperatorMailbox,
    safety: Safety,
    health: RecorderHealth,
    may: May,
    newest: Option<Status>,
}

impl Desk {
    fn serve(&mut self, client: &UnixStream) -> io::Result<()> {
        client.set_nonblocking(false)?;
        client.set_read_timeout(Some(PATIENCE))?;
        client.set_write_timeout(Some(PATIENCE))?;
        let mut line = String::new();
        BufReader::new(client.take(LONGEST_LINE)).read_line(&mut line)?;
        let reply = match serde_json::from_str(&line) {
            Ok(ask) => self.answer(ask),
            Err(error) => self.reply(Err(format!("not a request: {error}"))),
        };
        let mut text = serde_json::to_string(&reply)?;
        text.push('\n');
        let mut client = client;
        client.write_all(text.as_bytes())
    }

    fn answer(&mut self, ask: Ask) -> Reply {
        let outcome = match ask {
            Ask::Status {} => Ok(()),
            Ask::Arm {} | Ask::Reference { .. } if self.may == May::OnlyStop => {
                Err("an experiment is under way; wait for its end, or disarm to stop it".to_owned())
            }
            Ask::Arm {} => self.arm(),
            Ask::Disarm {} => {
                self.ask_for(Request::Disarm, |s| s.state != State::Run.code(), "it still runs; is the cRIO there?")
            }
            Ask::Reference { file } => self.reference(&file),
        };
        self.reply(outcome)
    }

    fn arm(&mut self) -> Result<(), String> {
        let Some(status) = self.status() else { return Err("no session with the cRIO; nothing to arm".to_owned()) };
        if status.state == State::Run.code() {
            return Err("it is armed already".to_owned());
        }
        if !status.can_arm {
            return Err(format!(
                "it is {} and cannot be armed yet; `controller status` tells why",
                State::name(status.state)
            ));
        }
        if let Some(problem) = self.health.error() {
            return Err(format!("the recording has failed ({problem}); mend that and restart before arming"));
        }
        self.ask_for(Request::Arm, |s| s.state == State::Run.code(), "it did not start; `controller status` tells why")
    }

    fn reference(&mut self, file: &Path) -> Result<(), String> {
        let reference = Reference::read(file).map_err(|e| e.to_string())?;
        let [[_, highest], [lowest, _]] = reference.range_kpa();
        if highest > self.safety.max_pos_kpa || lowest < self.safety.min_neg_kpa {
            return Err(format!("{}: it leaves the safety envelope ({lowest:.1} … {highest:.1} kPa)", file.display()));
        }
        self.ask_for(Request::Reference(Box::new(reference)), |_| true, "too many requests wait")
    }

    /// Puts a request to the tick and waits until `done` holds.
    fn ask_for(&mut self, request: Request, done: impl Fn(&Status) -> bool, otherwise: &str) -> Result<(), String> {
        if !self.mailbox.ask(request) {
            return Err("too many requests wait; is the cRIO there?".to_owned());
        }
        let until = Instant::now() + EFFECT;
        while Instant::now() < until {
            std::thread::sleep(Duration::from_millis(20));
            if let Some(status) = self.mailbox.status() {
                self.newest = Some(status);
                if done(&status) {
                    return Ok(());
                }
            }
        }
        Err(otherwise.to_owned())
    }

    fn status(&mut self) -> Option<Status> {
        if let Some(status) = self.mailbox.status() {
            self.newest = Some(status);
        }
        self.newest
    }

    fn reply(&mut self, outcome: Result<(), String>) -> Reply {
        let status = self.status();
        Reply {
            ok: outcome.is_ok(),
            error: outcome.err(),
            state: status.map_or("connecting", |s| State::name(s.state)).to_owned(),
            status,
            recording_problem: self.health.error(),
        }
    }
}

/// Asks a running daemon.
///
/// # Errors
/// If nobody answers, or not sensibly.
pub fn ask(path: &Path, ask: &Ask) -> Result<Reply, SocketError> {
    let silent = |source| SocketError::Silent { path: path.to_owned(), source };
    let nonsense = || SocketError::Nonsense { path: path.to_owned() };
    let mut socket = UnixStream::connect(path).map_err(silent)?;
    socket.set_read_timeout(Some(2 * PATIENCE)).map_err(silent)?;
    let mut line = serde_json::to_string(ask).map_err(|_| nonsense())?;
    line.push('\n');
    socket.write_all(line.as_bytes()).map_err(silent)?;
    let mut answer = String::new();
    BufReader::new(&socket).read_line(&mut answer).map_err(silent)?;
    serde_json::from_str(&answer).map_err(|_| nonsense())
}
