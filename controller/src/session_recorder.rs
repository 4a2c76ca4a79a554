//! A flight with its recording: file made, threads started, everything ended in order.
//!
//! | thread | does |
//! | --- | --- |
//! | `tick` | the loop of [`crate::session`]; real-time |
//! | `rec` | recording, console ([`flight::Recorder`]) |
//! | `ctl` | the Unix socket ([`crate::socket`]) |
//! | main | waits |

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use flight::recorder::Observer;
use flight::{Event, Recorder, RecorderOptions, RecordingSummary};
use proto::recording::{Attachment, EventLevel, LogTime, RecordingInfo, VERDICT, rfc3339};

use crate::clock::now_ns;
use crate::config::{Config, Pacing};
use crate::cycle::Cycle;
use crate::duty_source::DutySource;
use crate::link::LinkError;
use crate::mailbox::mailbox;
use crate::realtime::lock_memory;
use crate::run_length::RunLength;
use crate::session::{Session, run_session};
use crate::socket::{May, SocketError, check_free, serve};

/// Program and version, as recordings and reports name it.
pub const PROGRAM: &str = concat!("controller ", env!("CARGO_PKG_VERSION"));

/// Why a flight cannot start or was not recorded well.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The recording cannot be made.
    #[error(transparent)]
    Record(#[from] flight::RecordError),
    /// The folder for recordings cannot be made.
    #[error("{}: cannot be made: {source}; set record.directory to a folder that can be written", .directory.display())]
    Directory {
        /// The folder.
        directory: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The operator's socket cannot be made.
    #[error(transparent)]
    Socket(#[from] SocketError),
    /// There is no link, for a flight that does not wait for one.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// A thread or signal handler cannot be set up.
    #[error("cannot start: {0}")]
    System(#[from] std::io::Error),
    /// The tick's thread ended by a panic.
    #[error("the tick's thread stopped by itself; this is a bug in this program, and the cRIO has vented")]
    Died,
}

/// What a flight leaves in its recording, and who sees and ends it.
pub struct SessionRecorder {
    /// Where the recording goes; by default a file named after the time in the configured folder.
    pub file: Option<PathBuf>,
    /// How such a file's name begins.
    pub stem: &'static str,
    /// The policy's name and hash, where one flies.
    pub policy: Option<(String, String)>,
    /// What the recording says about itself, by name.
    pub extra: Vec<(String, String)>,
    /// Files that go into the recording.
    pub attachments: Vec<Attachment>,
    /// What a person should know at the start.
    pub remarks: Vec<String>,
    /// Words for events.
    pub event_text: fn(&Event) -> String,
    /// What an operator may do; `None`: there is no socket.
    pub operator: Option<May>,
    /// Sees every tick and event, in the recorder's thread.
    pub observer: Observer,
    /// Set to end the flight; signals set it too.
    pub stop: Arc<AtomicBool>,
    /// How long the run lasts.
    pub length: RunLength,
}

/// A file of text for [`SessionRecorder::attachments`].
pub fn attachment(name: &str, media_type: &str, data: impl Into<Vec<u8>>) -> Attachment {
    Attachment { name: name.to_owned(), media_type: media_type.to_owned(), data: data.into() }
}

/// Flies a cycle to its end and records it.
///
/// # Errors
/// Why it cannot start, or what was lost at the end.
pub fn fly_recorded<H: DutySource + 'static>(
    config: &Config,
    cycle: Cycle<H>,
    logbook: SessionRecorder,
) -> Result<(RecordingSummary, Cycle<H>), SessionError> {
    let SessionRecorder {
        file,
        stem,
        policy,
        extra,
        attachments,
        remarks,
        event_text,
        operator,
        observer,
        stop,
        length,
    } = logbook;
    for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    // Before anything is made: a second daemon leaves no empty recording behind.
    if operator.is_some() {
        check_free(&config.control.socket)?;
    }
    let path = match file {
        Some(file) => file,
        None => recording_path(&config.record.directory, stem)?,
    };
    let mut info = RecordingInfo::new(PROGRAM, now_ns());
    info.log_time = if config.link.pacing == Pacing::Lockstep { LogTime::Tick } else { LogTime::Arrival };
    info.policy = policy;
    info.extra.extend(extra);
    let options = RecorderOptions::new(event_text).observer(observer);
    let (recorder, sink) = Recorder::start(&path, &info, &attachments, options)?;
    let recorder = Arc::new(recorder);
    for remark in remarks.into_iter().chain(lock_memory()) {
        recorder.note(now_ns(), EventLevel::Warning, "start", remark);
    }
    let (mailbox, desk) = mailbox();
    let served = operator
        .map(|may| serve(&config.control.socket, desk, config.safety, recorder.health(), Arc::clone(&stop), may))
        .transpose()?;
    let speaker = Arc::clone(&recorder);
    let say = Box::new(move |text: String| speaker.note(now_ns(), EventLevel::Warning, "link", text));
    let flight = Session { config: config.clone(), cycle, sink, mailbox, stop: Arc::clone(&stop), length, say };
    let thread = std::thread::Builder::new().name("tick".to_owned()).spawn(move || run_session(flight))?;
    let flown = thread.join();
    stop.store(true, Ordering::Relaxed);
    if let Some(served) = served {
        served.join();
    }
    if let Ok(Ok(cycle)) = &flown
        && let Some((level, text)) = cycle.duty_source().verdict()
    {
        recorder.note(now_ns(), level, VERDICT, text);
    }
    let summary = Arc::into_inner(recorder).map(Recorder::finish).transpose()?;
    let cycle = flown.map_err(|_| SessionError::Died)?;
    let summary = summary.ok_or(SessionError::Died)?;
    if cycle.is_err() && summary.ticks == 0 {
        // There was no link: an empty recording would only puzzle whoever finds it.
        let _ = std::fs::remove_file(&summary.path);
    }
    Ok((summary, cycle?))
}

/// `STEM-YYYYMMDD-HHMMSS.mcap` in the folder, which is made if it is not there.
fn recording_path(directory: &Path, stem: &str) -> Result<PathBuf, SessionError> {
    std::fs::create_dir_all(directory)
        .map_err(|source| SessionError::Directory { directory: directory.to_owned(), source })?;
    let seconds = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or(Duration::ZERO).as_secs();
    let stamp = file_stamp(seconds);
    // A second flight in the same second gets a number.
    let names =
        std::iter::once(format!("{stem}-{stamp}.mcap")).chain((2..1000).map(|n| format!("{stem}-{stamp}-{n}.mcap")));
    let free = names.map(|name| directory.join(name)).find(|path| !path.exists());
    Ok(free.unwrap_or_else(|| directory.join(format!("{stem}.mcap"))))
}

/// UTC date and time for a file name, from seconds since 1970: RFC 3339 without its separators and milliseconds.
fn file_stamp(seconds: u64) -> String {
    let text = rfc3339(UNIX_EPOCH + Duration::from_secs(seconds));
    let whole = text.split('.').next().unwrap_or_default();
    whole.replace(['-', ':'], "").replace('T', "-")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_are_dates() {
        assert_eq!(file_stamp(0), "19700101-000000");
        assert_eq!(file_stamp(951_782_400), "20000229-000000");
        assert_eq!(file_stamp(1_795_219_199), "20261120-235959");
    }
}
