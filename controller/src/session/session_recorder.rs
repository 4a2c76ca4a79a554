//! A run with its recording: threads started, signals and the disk watched, everything ended in order and in bounded time.
//!
//! | thread | does |
//! | --- | --- |
//! | `tick` | the loop of [`crate::session`]; real-time |
//! | `rec` | recording, figures ([`flight::Recorder`]) |
//! | `guard` | watches the tick, beats systemd's watchdog ([`crate::machine::guard`]) |
//! | `ctl` | the Unix socket ([`crate::operator::socket`]) |
//! | `console` | prints ([`crate::operator::console`]) |
//! | main | signals, a disk that does not answer |

use std::collections::{BTreeMap, HashSet};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::thread::JoinHandle;
use std::time::Duration;

use flight::recorder::Observer;
use flight::{Event, Noter, Recorded, Recorder, RecorderOptions, RecordingSummary};
use handover::ExplorationRules;
use policy_store::{KeepOrder, Voices};
use proto::recording::{Attachment, EventLevel, LogTime, RecordingInfo, VERDICT, rfc3339};
use proto::reference::Reference;

use crate::config::{Config, Pacing};
use crate::cycle::Cycle;
use crate::cycle::duty_source::DutySource;
use crate::experiment::experiment_log::{ExperimentLog, LogSettings};
use crate::experiment::open_loop_playback::OpenLoopPlayback;
use crate::machine::clock::now_ns;
use crate::machine::guard::{self, OnSilence, Pulse};
use crate::machine::realtime::lock_memory;
use crate::machine::signals::Signals;
use crate::machine::systemd::Notifier;
use crate::operator::desk::DeskOptions;
use crate::operator::mailbox::{Status, mailbox};
use crate::operator::running::Running;
use crate::operator::socket::{May, Served, SocketError, check_sockets, serve};
use crate::policy_service::{PolicyHandle, ServiceError};
use crate::replay::run_file::attached;
use crate::session::attribution::StolenTime;
use crate::session::link::LinkError;
use crate::session::live_stream::{self, LiveStream, StreamError, Tap};
use crate::session::recording_folder::{EXPERIMENT_STEM, check_folder, destination};
use crate::session::run_length::{RunEnd, RunLength};
use crate::session::run_watch::Watch;
use crate::session::{Session, run_session};

/// Time that the tick's thread may take to end: it looks at its orders ten times a second, but a name that is being
/// resolved or a cRIO that is being connected to holds it longer.
pub(super) const TICK_END: Duration = Duration::from_secs(3);
/// Time that the file which says who did what may take at the end to be written: a disk that answers needs some ms.
const AUDITED_WITHIN: Duration = Duration::from_secs(1);
/// Age from which a status no longer tells what is, in real time: twelve ticks.
const STALE: Duration = Duration::from_millis(250);
/// And in lockstep, where the cRIO may be a slow simulation.
const STALE_LOCKSTEP: Duration = Duration::from_secs(1);
/// Program and version, as recordings and reports name it.
pub const PROGRAM: &str = concat!("controller ", env!("CARGO_PKG_VERSION"));

/// Reason why a flight cannot start or was not recorded well.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The recording cannot be made.
    #[error(transparent)]
    Record(#[from] flight::RecordError),
    /// There is too little room, and nobody who could be asked.
    #[error("{}: only {free_mib} MiB free, record.min_free_mib = {min_mib}; make room: with control.auto_arm nothing runs unrecorded", .directory.display())]
    NoRoom {
        /// The folder.
        directory: PathBuf,
        /// Free space (MiB).
        free_mib: u64,
        /// Space that is needed (MiB).
        min_mib: u64,
    },
    /// The tick's thread does not end.
    #[error("the tick's thread did not end within {} s (the cRIO may be slow to connect to); the cRIO vents by its time to live", TICK_END.as_secs())]
    Hung,
    /// The folder for recordings cannot be made.
    #[error("{}: cannot be used for recordings: {source}; set record.directory to a folder that can be written", .directory.display())]
    Directory {
        /// The folder.
        directory: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// The operator's socket cannot be made.
    #[error(transparent)]
    Socket(#[from] SocketError),
    /// The socket for live viewers cannot be made.
    #[error(transparent)]
    Stream(#[from] StreamError),
    /// There is no link, for a flight that does not wait for one.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The watched directory cannot be served.
    #[error(transparent)]
    Policies(#[from] ServiceError),
    /// A thread or signal handler cannot be set up.
    #[error("cannot start: {0}")]
    System(#[from] std::io::Error),
    /// The tick's thread ended by a panic.
    #[error("the tick's thread stopped by itself; this is a bug in this program, and the cRIO has vented")]
    Died,
}

/// Settings of a recorded run: what it leaves in its recording, and who sees and ends it.
pub struct SessionRecorder {
    /// Place where the recording goes; by default files named after the time in the configured folder.
    pub file: Option<PathBuf>,
    /// Beginning of such files' names.
    pub stem: &'static str,
    /// The policy's name and hash, where one runs.
    pub policy: Option<(String, String)>,
    /// Entries of the recording about itself, by name.
    pub extra: Vec<(String, String)>,
    /// Files that go into the recording.
    pub attachments: Vec<Attachment>,
    /// Remarks for people at the start.
    pub remarks: Vec<String>,
    /// Words for events.
    pub event_text: fn(&Event) -> String,
    /// Permissions of an operator; `None`: there is no socket.
    pub operator: Option<May>,
    /// Names of what the daemon runs with, for those who ask.
    pub running: Running,
    /// The reference that is followed, where there is one.
    pub followed: Option<Arc<Reference>>,
    /// Starts what serves policies and models beside the tick; `None`: nothing does.
    pub policies: Option<StartPolicies>,
    /// The configuration file, to be read again on `SIGHUP`.
    pub config_file: Option<PathBuf>,
    /// Sees every tick and event, in the recorder's thread.
    pub observer: Observer,
    /// Set to end the run; signals set it too.
    pub stop: Arc<AtomicBool>,
    /// Length of the run.
    pub length: RunLength,
}

/// Starts the service of policies, given where it speaks and what ends it.
pub type StartPolicies = Box<dyn FnOnce(Voices, Arc<AtomicBool>) -> Result<PolicyHandle, ServiceError>>;

/// A file of text for [`SessionRecorder::attachments`].
pub fn attachment(name: &str, media_type: &str, data: impl Into<Vec<u8>>) -> Attachment {
    Attachment { name: name.to_owned(), media_type: media_type.to_owned(), data: data.into() }
}

/// A run that has ended and is recorded.
pub struct Flown<H> {
    /// The recording.
    pub recording: RecordingSummary,
    /// The cycle, as it was at the end.
    pub cycle: Cycle<H>,
    /// End that the run came to.
    pub end: RunEnd,
}

/// Runs a cycle to its end and records it.
///
/// # Errors
/// Why it cannot start, or what was lost at the end.
pub fn fly_recorded<H: DutySource + 'static>(
    config: &Config,
    cycle: Cycle<H>,
    logbook: SessionRecorder,
) -> Result<Flown<H>, SessionError> {
    let stop = Arc::clone(&logbook.stop);
    let signals = Signals::install(&stop)?;
    // Before anything is made: a second daemon leaves nothing behind.
    if logbook.operator.is_some() {
        check_sockets(&config.control.socket)?;
    }
    let SessionRecorder {
        file,
        stem,
        attachments,
        remarks,
        event_text,
        operator,
        running,
        policies,
        config_file,
        observer,
        ..
    } = logbook;
    let mut info = RecordingInfo::new(PROGRAM, now_ns());
    info.log_time = if config.link.pacing == Pacing::Lockstep { LogTime::Tick } else { LogTime::Arrival };
    info.policy = logbook.policy;
    info.extra.extend(logbook.extra);
    let live = match operator {
        Some(_) => Some(live_stream::serve(&config.control.socket, about(&info), Arc::clone(&stop))?),
        None => None,
    };
    let (tap, live) = live.map_or((None, None), |(tap, live)| (Some(tap), Some(live)));
    let experiments = (operator == Some(May::Fly) && policies.is_some()).then(|| {
        let config_file = attachments.iter().find(|file| file.name == attached::CONFIG).cloned();
        let destination = destination(config, EXPERIMENT_STEM);
        ExperimentLog::new(LogSettings { destination, log_time: info.log_time, config: config_file })
    });
    let observer = passing_on(observer, experiments.clone(), tap.clone());
    let options = RecorderOptions::new(event_text).observer(observer);
    let (recorder, sink) = match &file {
        Some(file) => Recorder::start(file, &info, &attachments, options)?,
        None => {
            let destination = destination(config, stem);
            check_folder(&destination, config)?;
            Recorder::start_in(destination, &info, &attachments, options)?
        }
    };
    if let Some(tap) = &tap {
        tap.watch_recorder(recorder.health());
    }
    let memory = lock_memory();
    for remark in remarks {
        recorder.note(now_ns(), EventLevel::Warning, "start", remark);
    }
    let policies = policies.map(|start| start(voices(&recorder, tap.clone()), Arc::clone(&stop))).transpose()?;
    let (mailbox, desk) = mailbox();
    let (reloads, inbox) = channel();
    let desk_options = |may| DeskOptions {
        mailbox: desk.clone(),
        safety: config.safety,
        reference: config.reference.clone(),
        health: recorder.health(),
        notes: recorder.noter(),
        may,
        running: running.clone(),
        followed: logbook.followed.clone(),
        policies: policies.clone(),
        experiments: experiments.clone(),
        viewers: tap.clone(),
        exploration: ExplorationRules {
            seed: 0,
            std_share: config.policy.exploration_std,
            most_duty: config.policy.exploration_max_duty,
        },
        stale: if config.link.pacing == Pacing::Lockstep { STALE_LOCKSTEP } else { STALE },
        reloads: inbox,
    };
    let served = operator.map(|may| serve(&config.control.socket, desk_options(may), Arc::clone(&stop))).transpose()?;
    let speaker = recorder.noter();
    let say = Box::new(move |text: String| speaker.note(now_ns(), EventLevel::Warning, "link", text));
    let pulse = Arc::new(Pulse::default());
    let guard = watch_tick(config, operator, &pulse, &stop, recorder.noter())?;
    let session = Session {
        config: config.clone(),
        cycle,
        sink,
        mailbox,
        stop: Arc::clone(&stop),
        length: logbook.length,
        inputs: 0,
        say,
        pulse,
        stolen: StolenTime::open(),
        memory,
        status: Status::default(),
    };
    let thread = std::thread::Builder::new().name("tick".to_owned()).spawn(move || run_session(session))?;
    Watch::new(config, config_file, &recorder, stem, signals, reloads).until_over(&thread, &stop);
    let ticked = thread.is_finished().then(|| thread.join());
    stop.store(true, Ordering::Relaxed);
    Beside { recorder, served, policies, guard, experiments, live }.end(ticked)
}

/// Result of the tick's thread; `None` where it did not end in its time.
type Ticked<H> = Option<std::thread::Result<Result<(Cycle<H>, RunEnd), LinkError>>>;

/// Parts of a run beside the tick, which end after it.
struct Beside {
    recorder: Recorder,
    served: Option<Served>,
    policies: Option<PolicyHandle>,
    guard: Option<JoinHandle<()>>,
    experiments: Option<ExperimentLog>,
    live: Option<LiveStream>,
}

impl Beside {
    /// Ends them in the order in which they need each other, once the stop flag is set.
    fn end<H: DutySource>(self, mut ticked: Ticked<H>) -> Result<Flown<H>, SessionError> {
        if let Some(served) = self.served {
            served.join();
        }
        if let Some(handle) = &self.policies {
            // Nobody asks any more: what was answered as done stands in the file.
            handle.policies.settle(AUDITED_WITHIN);
        }
        if let Some(guard) = self.guard {
            // It sleeps for 30 ms at most between two looks at the stop flag.
            let _ = guard.join();
        }
        if let Some(Ok(Ok((cycle, _)))) = &ticked
            && let Some((level, text)) = cycle.duty_source().verdict()
        {
            self.recorder.note(now_ns(), level, VERDICT, text);
        }
        let summary = self.recorder.finish();
        if let Some(experiments) = &self.experiments {
            // Where one was being played, its recording ends here, too; where one is being finished, that is waited for.
            let ticked = ticked.as_mut().and_then(|ticked| ticked.as_mut().ok()?.as_mut().ok());
            experiments.close(unfinished(ticked.and_then(|(cycle, _)| cycle.end_experiment())));
        }
        if let Some(live) = self.live {
            live.join();
        }
        let ticked = ticked.ok_or(SessionError::Hung)?.map_err(|_| SessionError::Died)?;
        let recording = summary?;
        if ticked.is_err() && recording.ticks == 0 && !recording.files.is_empty() {
            // There was no link: an empty recording would only puzzle whoever finds it.
            let _ = std::fs::remove_file(&recording.path);
        }
        let (cycle, end) = ticked?;
        Ok(Flown { recording, cycle, end })
    }
}

/// Passes what is recorded on to experiments and live viewers, too, before the run's own observer.
fn passing_on(
    mut observer: Observer,
    experiments: Option<ExperimentLog>,
    viewers: Option<Tap>,
) -> impl FnMut(Recorded<'_>) + Send + 'static {
    move |recorded| {
        if let Some(experiments) = &experiments {
            experiments.pass(recorded);
        }
        if let Some(viewers) = &viewers {
            viewers.pass(recorded);
        }
        observer(recorded);
    }
}

/// Places where the service of policies speaks: the recording and live viewers.
fn voices(recorder: &Recorder, viewers: Option<Tap>) -> Voices {
    let noter = recorder.noter();
    let say = Box::new(move |text| noter.note(now_ns(), EventLevel::Info, "policies", text));
    let show = Box::new(move |json| {
        if let Some(viewers) = &viewers {
            viewers.policies(json);
        }
    });
    Voices { say, show, keep: keeping(recorder.noter()) }
}

/// The last line of an experiment that the end of the run cut short.
fn unfinished(playback: Option<Box<OpenLoopPlayback>>) -> (EventLevel, String) {
    let unknown = || (EventLevel::Error, "EXPERIMENT ABORTED: the daemon ended".to_owned());
    playback.map_or_else(unknown, |playback| playback.ending())
}

/// Puts each order to the tick into the recording, and each policy that comes into it that way once.
fn keeping(notes: Noter) -> KeepOrder {
    let mut known = HashSet::new();
    Box::new(move |order, policy| {
        if let Some(bytes) = policy
            && known.insert(policy::hash(bytes))
        {
            notes.attach_once(attachment(attached::POLICY, "application/onnx", bytes.to_vec()));
        }
        notes.attach(attachment(attached::ORDER, "application/json", order.to_json()));
    })
}

/// Facts that live viewers are sent about a run.
fn about(info: &RecordingInfo) -> BTreeMap<String, String> {
    let mut about = info.extra.clone();
    about.insert("program".to_owned(), info.program.clone());
    about.insert("started".to_owned(), rfc3339(info.started));
    if let Some((name, sha256)) = &info.policy {
        about.insert("policy_name".to_owned(), name.clone());
        about.insert("policy_sha256".to_owned(), sha256.clone());
    }
    about
}

/// Starts the guard where time is real, or where systemd waits for word; a program that an operator serves ends itself where its tick hangs.
fn watch_tick(
    config: &Config,
    operator: Option<May>,
    pulse: &Arc<Pulse>,
    stop: &Arc<AtomicBool>,
    notes: Noter,
) -> std::io::Result<Option<JoinHandle<()>>> {
    let lockstep = config.link.pacing == Pacing::Lockstep;
    // Without a service manager nobody waits for word of a program whose ticks have no deadlines.
    if lockstep && !Notifier::is_awaited() {
        return Ok(None);
    }
    let on_silence = match operator {
        _ if lockstep => OnSilence::Wait,
        Some(_) => OnSilence::Abort,
        None => OnSilence::Tell,
    };
    let say = Box::new(move |text: String| notes.note(now_ns(), EventLevel::Error, "guard", text));
    guard::start(Arc::clone(pulse), on_silence, Arc::clone(stop), say).map(Some)
}
