//! Protocol of the operator's Unix socket: one JSON object per line, asked and answered.
//!
//! `{"ask":"status"}`, `{"ask":"arm"}`, `{"ask":"disarm"}`, `{"ask":"acknowledge"}`,
//! `{"ask":"reference","file":"/abs/path.csv"}`, `{"ask":"explore","switch":"on"}`, `{"ask":"experiment","file":"/abs/path.csv","csv":"…"}`; the answer is
//! `{"ok":true, …}` or `{"ok":false,"error":"one line"}`. A request has to be there whole within [`REQUEST_TIME`] of the
//! connection. The connection belongs to it: who closes it before the answer withdraws the request.

use std::io::{self, Read, Write};
use std::os::unix::fs::MetadataExt;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use socket2::{Domain, SockAddr, Socket, Type};

use crate::model_change::PATIENCE;
use crate::operator::desk::ExperimentView;
use crate::operator::mailbox::Status;
use crate::operator::peer::{group_name, user_name};
use crate::operator::running::Running;
use crate::state::State;

/// Time that a whole request may take to come.
pub const REQUEST_TIME: Duration = Duration::from_millis(1000);
/// Time that a request may take from the tick's next look to its effect.
pub const EFFECT_TIME: Duration = Duration::from_millis(500);
/// Time that what a tick has taken may take to be shown: that the cRIO reports both vents open once they are commanded, or what an
/// acknowledgement released. Some ticks, on a machine that is busy.
pub const ECHO_TIME: Duration = Duration::from_millis(1000);
/// Time that reading and checking a reference may take.
pub const READ_TIME: Duration = Duration::from_millis(1500);
/// Time that whoever puts a reference in, or arms, waits to be told whether the rig reaches it: some tenths of a second are usual, and
/// the order itself is carried out before.
pub const REACH_TIME: Duration = Duration::from_millis(2000);
/// Time that loading a policy, comparing a model or checking an experiment may take: half a minute was seen on two busy
/// cores, and four times that is still a machine that answers.
pub const WORK_TIME: Duration = Duration::from_secs(120);
/// Time from the moment at which the tick is given a model to the answer.
pub const HAND_OVER_TIME: Duration = PATIENCE.saturating_add(EFFECT_TIME);
/// Time that a client waits beyond the last moment at which the daemon answers: for a busy machine.
const CLIENT_SLACK: Duration = Duration::from_millis(1500);
/// Between two tries of a disarming that found no place.
const AGAIN: Duration = Duration::from_millis(10);
/// Bytes that a request may have; a reference of an hour, row by row, is 5 MB.
pub const MOST_REQUEST_BYTES: usize = 8 << 20;
/// Bytes that a socket's path may have; the kernel's address holds one more, a zero.
pub const MOST_PATH_BYTES: usize = 107;
/// Bytes that an answer may have.
const MOST_REPLY_BYTES: u64 = 1 << 20;

/// A question.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "ask", rename_all = "snake_case", deny_unknown_fields)]
pub enum Ask {
    /// Asks for the daemon's state.
    Status {},
    /// Control the pressures.
    Arm {},
    /// Open the vents.
    Disarm {},
    /// Asks which policies are there, and how far they are.
    Policies {},
    /// Send a policy to the rig, or back to it.
    Swap {
        /// Name, or `fallback`.
        name: String,
    },
    /// Take a candidate back, or go back to what controlled before.
    Rollback {},
    /// Put another model behind predictions, feed-forward and safety filter.
    Model {
        /// Absolute path of the rig file, or the name of a built-in rig.
        file: PathBuf,
    },
    /// A person has looked at what was wrong.
    Acknowledge {},
    /// Follow another reference.
    Reference {
        /// Absolute path of the CSV file: its name, and where the daemon reads it if `csv` is not given.
        file: PathBuf,
        /// The file's text, for files that the daemon itself may not read.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        csv: Option<String>,
    },
    /// Add noise to the active policy's answers, or no more.
    Explore {
        /// Switch that begins or ends it.
        switch: Switch,
        /// Seed of the noise; left out, one from the clock.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        seed: Option<u32>,
    },
    /// Play an experiment, and go on afterwards as before.
    Experiment {
        /// Absolute path of the CSV file: its name.
        file: PathBuf,
        /// The file's text.
        csv: String,
    },
}

/// On or off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Switch {
    /// On.
    On,
    /// Off.
    Off,
}

impl Ask {
    /// Time in which the daemon answers once the request is there, whatever comes of it.
    pub fn answer_time(&self) -> Duration {
        match self {
            Ask::Status {} | Ask::Policies {} | Ask::Rollback {} => EFFECT_TIME,
            Ask::Explore { .. } => EFFECT_TIME,
            Ask::Arm {} => EFFECT_TIME + REACH_TIME,
            Ask::Acknowledge {} | Ask::Disarm {} => EFFECT_TIME + ECHO_TIME,
            Ask::Reference { .. } => READ_TIME + EFFECT_TIME + REACH_TIME,
            Ask::Swap { .. } | Ask::Model { .. } | Ask::Experiment { .. } => WORK_TIME + HAND_OVER_TIME,
        }
    }

    /// Time that a client waits for its whole answer: always longer than the daemon takes.
    fn patience(&self) -> Duration {
        REQUEST_TIME + self.answer_time() + CLIENT_SLACK
    }
}

/// An answer.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Reply {
    /// True where it was done.
    pub ok: bool,
    /// Reason for a refusal, one line.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// The state; `connecting` without a session.
    #[serde(default)]
    pub state: State,
    /// The newest status; absent before the first tick.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub status: Option<Status>,
    /// Age of the newest status, in ms; absent before the first tick.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub age_ms: Option<u64>,
    /// Names of what the daemon runs with.
    #[serde(default)]
    pub running: Running,
    /// Account of what was done, one line, where it is not plain.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub done: Option<String>,
    /// Caution about what was done, one line.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remark: Option<String>,
    /// State of the vents as far as it is known, after a disarming.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub venting: Option<Venting>,
    /// All policies, where they were asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub policies: Option<Vec<policy_store::Entry>>,
    /// Problem with the policies' directory, if any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub policies_problem: Option<String>,
    /// The newest experiment of the run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub experiment: Option<ExperimentView>,
    /// True where `error` is about what was sent, not about what the daemon is doing.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub bad_input: bool,
    /// Problem with the recording, if any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recording_problem: Option<String>,
}

/// State of the vents after a disarming, as far as it is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Venting {
    /// Both are commanded open, and the cRIO reports them open.
    Open,
    /// Both are commanded open, and the cRIO does not report it, or the rig does not vent.
    InDoubt,
    /// There is no session: nothing can be commanded, and nothing is reported.
    Unknown,
    /// The rig was disarmed, and somebody has armed it again since.
    ArmedAgain,
}

/// Reason why the socket cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SocketError {
    /// Another daemon is there.
    #[error("{}: another controller answers on this socket; stop it, or set control.socket", .path.display())]
    InUse {
        /// The socket.
        path: PathBuf,
    },
    /// Something else has that name.
    #[error("{}: this is no socket, and it is left alone; set control.socket to another path", .path.display())]
    NotASocket {
        /// File that is in the way.
        path: PathBuf,
    },
    /// The path, or that of the live viewers' socket beside it, has no room in a socket's address.
    #[error(
        "{}: too long for a socket, {} bytes, and {} for the one for live viewers beside it ({}); each may have {MOST_PATH_BYTES}: choose a shorter control.socket",
        .path.display(), .path.as_os_str().len(), .live.as_os_str().len(), .live.file_name().unwrap_or_default().display()
    )]
    LongPath {
        /// The operators' socket.
        path: PathBuf,
        /// The live viewers'.
        live: PathBuf,
    },
    /// It cannot be made.
    #[error("{}: the operator's socket cannot be made: {source}; set control.socket to a place that can be written", .path.display())]
    Make {
        /// The socket.
        path: PathBuf,
        /// Error of the system.
        source: io::Error,
    },
    /// The socket is silent.
    #[error("{}: no controller answers there ({source}); is it running, and is this its control.socket?", .path.display())]
    Silent {
        /// The socket.
        path: PathBuf,
        /// Error of the system.
        source: io::Error,
    },
    /// This user may not connect to the socket.
    #[error("{}: you may not ask the controller there ({source}); {fix}", .path.display())]
    Forbidden {
        /// The socket.
        path: PathBuf,
        /// Error of the system.
        source: io::Error,
        /// Who may, and how to become one of them.
        fix: String,
    },
    /// It closed the connection without an answer.
    #[error("{}: the controller ended the connection without an answer: too many ask at once, or it is ending; look at `controller status`, then ask again", .path.display())]
    Crowded {
        /// The socket.
        path: PathBuf,
    },
    /// The answer is none.
    #[error("{}: the answer makes no sense; is it the same version of controller?", .path.display())]
    Nonsense {
        /// The socket.
        path: PathBuf,
    },
}

/// Connects without waiting: a daemon that is stopped, its queue of connections full, does not hold a client.
pub(crate) fn connect(path: &Path) -> io::Result<UnixStream> {
    let socket = Socket::new(Domain::UNIX, Type::STREAM, None)?;
    socket.set_nonblocking(true)?;
    socket.connect(&SockAddr::unix(path)?)?;
    socket.set_nonblocking(false)?;
    Ok(UnixStream::from(std::os::fd::OwnedFd::from(socket)))
}

/// Connects, and waits so long for a place where others fill the queue.
fn connect_within(path: &Path, time: Duration) -> io::Result<UnixStream> {
    let socket = Socket::new(Domain::UNIX, Type::STREAM, None)?;
    // A connection to a Unix socket waits for its place as long as a write may.
    socket.set_write_timeout(Some(time))?;
    socket.connect(&SockAddr::unix(path)?)?;
    Ok(UnixStream::from(std::os::fd::OwnedFd::from(socket)))
}

/// Tells whether somebody answers on a daemon's socket.
///
/// # Errors
/// If that cannot be found out: no right to connect, or too many who wait.
pub fn is_there(path: &Path) -> Result<bool, SocketError> {
    match connect(path) {
        Ok(_) => Ok(true),
        Err(error) if matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::ConnectionRefused) => Ok(false),
        Err(source) => Err(SocketError::Silent { path: path.to_owned(), source }),
    }
}

/// Asks a running daemon; gives up some time after a daemon that lives would have answered ([`Ask::answer_time`]).
///
/// # Errors
/// If nobody answers, or not sensibly.
pub fn ask(path: &Path, ask: &Ask) -> Result<Reply, SocketError> {
    let until = Instant::now() + ask.patience();
    loop {
        let outcome = ask_once(path, ask, until);
        let again = matches!(outcome, Err(SocketError::Crowded { .. })) && matches!(ask, Ask::Disarm {});
        // Disarming twice is disarming, so it is asked for until it is answered.
        if !again || Instant::now() >= until {
            return outcome;
        }
        std::thread::sleep(AGAIN);
    }
}

/// Asks once, and waits for the answer until then.
fn ask_once(path: &Path, ask: &Ask, until: Instant) -> Result<Reply, SocketError> {
    let silent = |source: io::Error| match source.kind() {
        // The daemon has given the place to somebody else.
        io::ErrorKind::BrokenPipe | io::ErrorKind::ConnectionReset => SocketError::Crowded { path: path.to_owned() },
        io::ErrorKind::PermissionDenied => {
            SocketError::Forbidden { path: path.to_owned(), source, fix: who_may_connect(path) }
        }
        _ => SocketError::Silent { path: path.to_owned(), source },
    };
    let nonsense = || SocketError::Nonsense { path: path.to_owned() };
    let left = until.saturating_duration_since(Instant::now()).max(AGAIN);
    let mut socket = connect_within(path, left.min(REQUEST_TIME)).map_err(silent)?;
    let mut line = serde_json::to_string(ask).map_err(|_| nonsense())?;
    line.push('\n');
    socket.set_write_timeout(Some(REQUEST_TIME)).map_err(silent)?;
    socket.write_all(line.as_bytes()).map_err(silent)?;
    let mut answer = Vec::new();
    let mut piece = [0; 4096];
    while !answer.contains(&b'\n') {
        let left = until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(silent(io::ErrorKind::TimedOut.into()));
        }
        socket.set_read_timeout(Some(left)).map_err(silent)?;
        match socket.read(&mut piece) {
            Ok(0) => break,
            Ok(n) => answer.extend_from_slice(piece.get(..n).unwrap_or_default()),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                return Err(silent(io::ErrorKind::TimedOut.into()));
            }
            Err(error) => return Err(silent(error)),
        }
        if answer.len() as u64 > MOST_REPLY_BYTES {
            return Err(nonsense());
        }
    }
    if answer.is_empty() {
        return Err(SocketError::Crowded { path: path.to_owned() });
    }
    serde_json::from_slice(&answer).map_err(|_| nonsense())
}

/// Clause on who may connect to a socket, and how to become one of them. Where its folder shows nobody else what is in it, the
/// folder's group is told, which is that of the daemon's user too.
fn who_may_connect(path: &Path) -> String {
    let around = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    // Whoever connects writes to the socket, and passes its folder.
    let of_socket = std::fs::metadata(path).map(|place| (place, 0o020));
    let Ok((place, of_group)) = of_socket.or_else(|_| std::fs::metadata(around).map(|place| (place, 0o010))) else {
        return "ask whoever started it for the group of its socket".to_owned();
    };
    // Nobody becomes a member of the superuser's group for this.
    if place.mode() & of_group != 0 && place.gid() != 0 {
        let group = group_name(place.gid()).unwrap_or_else(|| place.gid().to_string());
        format!("its group {group} may: `sudo adduser $USER {group}`, then log in anew")
    } else {
        let owner = user_name(place.uid()).unwrap_or_else(|| place.uid().to_string());
        format!("its owner {owner} alone may: `sudo -u {owner} controller …`")
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    /// A socket, and a folder that shows nobody what is in it.
    #[test]
    fn who_may_not_connect_is_told_who_may() {
        let folder = std::env::temp_dir().join(format!("operator-rights-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let socket = folder.join("s");
        std::fs::write(&socket, "").unwrap();
        let rights = |path: &Path, mode| std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).unwrap();
        let place = std::fs::metadata(&socket).unwrap();
        let user = user_name(place.uid()).unwrap_or_else(|| place.uid().to_string());
        let group = group_name(place.gid()).unwrap_or_else(|| place.gid().to_string());
        let alone = format!("owner {user} alone");
        // Nobody is told to become a member of the superuser's group.
        let join = if place.gid() == 0 { alone.clone() } else { format!("`sudo adduser $USER {group}`, then log in") };
        for (mode, words) in [(0o660, &join), (0o640, &alone), (0o600, &alone)] {
            rights(&socket, mode);
            assert!(who_may_connect(&socket).contains(words), "{mode:o}: {}", who_may_connect(&socket));
        }
        std::fs::remove_file(&socket).unwrap();
        for (mode, words) in [(0o750, &join), (0o740, &alone)] {
            rights(&folder, mode);
            assert!(who_may_connect(&socket).contains(words), "{mode:o}: {}", who_may_connect(&socket));
        }
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn requests_are_one_object_with_known_keys() {
        for (text, ask) in [
            (r#"{"ask":"status"}"#, Ask::Status {}),
            (r#"{"ask":"arm"}"#, Ask::Arm {}),
            (r#"{"ask":"disarm"}"#, Ask::Disarm {}),
            (r#"{"ask":"policies"}"#, Ask::Policies {}),
            (r#"{"ask":"swap","name":"run-7"}"#, Ask::Swap { name: "run-7".into() }),
            (r#"{"ask":"rollback"}"#, Ask::Rollback {}),
            (r#"{"ask":"explore","switch":"off"}"#, Ask::Explore { switch: Switch::Off, seed: None }),
            (r#"{"ask":"explore","switch":"on","seed":7}"#, Ask::Explore { switch: Switch::On, seed: Some(7) }),
            (
                r#"{"ask":"experiment","file":"/e.csv","csv":"x"}"#,
                Ask::Experiment { file: "/e.csv".into(), csv: "x".into() },
            ),
            (r#"{"ask":"model","file":"/r.toml"}"#, Ask::Model { file: "/r.toml".into() }),
            (r#"{"ask":"reference","file":"/r.csv"}"#, Ask::Reference { file: "/r.csv".into(), csv: None }),
        ] {
            assert_eq!(serde_json::from_str::<Ask>(text).unwrap(), ask);
        }
        for text in ["", "arm", "{}", r#"{"ask":"fly"}"#, r#"{"ask":"arm","now":true}"#, r#"{"ask":"reference"}"#] {
            assert!(serde_json::from_str::<Ask>(text).is_err(), "{text}");
        }
    }
}
