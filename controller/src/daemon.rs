//! Puts the daemon together: files read, threads started, everything ended in order.
//!
//! | thread | does |
//! | --- | --- |
//! | `tick` | the loop of [`crate::flying`]; real-time |
//! | `rec` | recording, console ([`flight::Recorder`]) |
//! | `ctl` | the Unix socket ([`crate::socket`]) |
//! | main | waits for signals |

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use flight::{Recorded, Recorder, RecorderOptions, RecordingSummary};
use model::rig::Rig;
use policy::{Contract, Policy};
use proto::recording::{Attachment, EventLevel, LogTime, RecordingInfo, rfc3339};
use proto::reference::Reference;

use crate::clock::now_ns;
use crate::config::{Config, DEFAULT_POLICY, FALLBACK, Pacing};
use crate::cycle::Cycle;
use crate::flying::{Flight, fly};
use crate::notice::sentence;
use crate::panel::panel;
use crate::realtime::lock_memory;

/// Program and version, as recordings and reports name it.
pub const PROGRAM: &str = concat!("controller ", env!("CARGO_PKG_VERSION"));

/// Why the daemon cannot start or did not end well.
#[derive(Debug, thiserror::Error)]
pub enum DaemonError {
    /// The rig cannot be read.
    #[error(transparent)]
    Rig(#[from] proto::rig_file::RigFileError),
    /// The rig cannot be flown.
    #[error("rig {name}: {problem}")]
    Unflyable {
        /// The rig.
        name: String,
        /// Why.
        problem: model::rig::RigError,
    },
    /// The reference cannot be read.
    #[error(transparent)]
    Reference(#[from] proto::reference::ReferenceError),
    /// The policy cannot be loaded.
    #[error(transparent)]
    Policy(#[from] policy::PolicyError),
    /// There is no such policy.
    #[error("{}: no such policy; put the file there, or set policy.active to one of: {known}", .file.display())]
    NoPolicy {
        /// The file looked for.
        file: PathBuf,
        /// The names there are.
        known: String,
    },
    /// The reference leaves the safety envelope.
    #[error(
        "reference {name}: it goes to {worst_kpa:.1} kPa, beyond safety.{key} = {limit_kpa} kPa; change the one or the other"
    )]
    ReferenceBeyond {
        /// The reference.
        name: String,
        /// Its farthest value.
        worst_kpa: f64,
        /// The limit's key.
        key: &'static str,
        /// The limit.
        limit_kpa: f64,
    },
    /// The recording cannot be made.
    #[error(transparent)]
    Record(#[from] flight::RecordError),
    /// The folder for recordings cannot be made.
    #[error("{}: cannot be made: {source}; set record.directory to a folder that can be written", .directory.display())]
    RecordDirectory {
        /// The folder.
        directory: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The operator's socket cannot be made.
    #[error(transparent)]
    Socket(#[from] crate::socket::SocketError),
    /// A thread or signal handler cannot be set up.
    #[error("cannot start: {0}")]
    System(#[from] std::io::Error),
    /// The tick's thread ended by a panic.
    #[error("the tick's thread stopped by itself; this is a bug in this program, and the cRIO has vented")]
    Died,
}

/// What is flown, read and checked.
pub struct Loaded {
    /// The model's rig.
    pub rig: Rig,
    /// Its text, for the recording.
    pub rig_text: String,
    /// The reference.
    pub reference: Reference,
    /// What it is called.
    pub reference_name: String,
    /// The policy, if one flies.
    pub policy: Option<Policy>,
    /// What a person should know about these choices.
    pub remarks: Vec<String>,
}

/// The contracts that policies may meet.
pub fn contracts() -> [Contract; 2] {
    crate::contract::offered()
}

/// Reads and checks everything a configuration names.
///
/// # Errors
/// The first thing that is wrong.
pub fn load(config: &Config) -> Result<Loaded, DaemonError> {
    let mut remarks = Vec::new();
    let rig = proto::rig_file::load(&config.rig.file)?;
    let (reference, reference_name) = match &config.reference.file {
        Some(file) => (Reference::read(file)?, file.display().to_string()),
        None => {
            remarks
                .push("no reference file: following the paper's reference (set reference.file for another)".to_owned());
            (Reference::paper(), "the paper's".to_owned())
        }
    };
    check_reference(config, &reference, &reference_name)?;
    let policy = load_policy(config, &mut remarks)?;
    let rig_text = rig.to_toml().unwrap_or_default();
    Ok(Loaded { rig, rig_text, reference, reference_name, policy, remarks })
}

fn check_reference(config: &Config, reference: &Reference, name: &str) -> Result<(), DaemonError> {
    let [[_, highest], [lowest, _]] = reference.range_kpa();
    let beyond = |worst_kpa, key, limit_kpa| {
        Err(DaemonError::ReferenceBeyond { name: name.to_owned(), worst_kpa, key, limit_kpa })
    };
    if highest > config.safety.max_pos_kpa {
        return beyond(highest, "max_pos_kpa", config.safety.max_pos_kpa);
    }
    if lowest < config.safety.min_neg_kpa {
        return beyond(lowest, "min_neg_kpa", config.safety.min_neg_kpa);
    }
    Ok(())
}

/// The policy that ships with the program; docs/training.md says how it was trained.
const SHIPPED_POLICY: &[u8] = include_bytes!("../policies/default.onnx");

/// Loads and checks the policy that ships with the program, as any other.
///
/// # Errors
/// If this build carries one that this program refuses.
pub fn shipped_policy() -> Result<Policy, DaemonError> {
    let refused = |fault| policy::PolicyError { file: "the shipped policy".into(), fault };
    Ok(Policy::from_bytes("default, as shipped".to_owned(), SHIPPED_POLICY, &contracts()).map_err(refused)?)
}

fn load_policy(config: &Config, remarks: &mut Vec<String>) -> Result<Option<Policy>, DaemonError> {
    let choice = &config.policy;
    if choice.active == FALLBACK {
        return Ok(None);
    }
    let file = choice.directory.join(format!("{}.onnx", choice.active));
    if file.is_file() {
        return Ok(Some(Policy::load(&file, &contracts())?));
    }
    if choice.active == DEFAULT_POLICY {
        remarks.push(format!("no policy at {}: the one that ships with the program flies", file.display()));
        return shipped_policy().map(Some);
    }
    let mut known = vec![FALLBACK.to_owned()];
    for entry in std::fs::read_dir(&choice.directory).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.extension().is_some_and(|e| e == "onnx") {
            known.extend(path.file_stem().map(|stem| stem.to_string_lossy().into_owned()));
        }
    }
    known.sort();
    Err(DaemonError::NoPolicy { file, known: known.join(", ") })
}

/// What a person is told about a place of the reference that the rig cannot hold.
pub fn out_of_reach_text((time_s, [pos, neg]): (f64, [f64; 2])) -> String {
    format!(
        "the reference at {time_s:.2} s ({pos:.1}/{neg:.1} kPa) is out of the rig's reach by its model: a valve would have to open further than it can, or shut further than shut"
    )
}

/// How a flight is run.
pub struct Options {
    /// Where the recording goes; by default a file named after the time in the configured folder.
    pub recording: Option<PathBuf>,
    /// Ends the flight this many seconds after arming.
    pub seconds: Option<f64>,
    /// Whether the operator's socket is served.
    pub socket: bool,
    /// What goes into the recording beside ticks.
    pub extra: Vec<(String, String)>,
    /// The configuration's text, for the recording.
    pub config_text: String,
    /// Sees every tick and event, in the recorder's thread.
    pub observer: Box<dyn FnMut(Recorded<'_>) + Send>,
    /// Set by somebody else to end the flight.
    pub stop: Arc<AtomicBool>,
}

/// Runs the daemon until the flight is over or it is told to stop.
///
/// # Errors
/// Why it cannot start, or what was lost at the end.
pub fn run(config: &Config, loaded: Loaded, options: Options) -> Result<RecordingSummary, DaemonError> {
    for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
        signal_hook::flag::register(signal, Arc::clone(&options.stop))?;
    }
    let Loaded { rig, rig_text, reference, reference_name, policy, remarks } = loaded;
    let unflyable = |problem| DaemonError::Unflyable { name: config.rig.file.clone(), problem };
    let policy_id = policy.as_ref().map(|p| (p.name().to_owned(), p.hash().to_string()));
    let mut cycle = Cycle::new(&rig, policy, reference, config.safety, config.control.auto_arm).map_err(unflyable)?;
    let out_of_reach = cycle.out_of_reach().map(out_of_reach_text);
    if let Some(seconds) = options.seconds {
        cycle.end_after(seconds);
    }
    // Before anything is made: a second daemon leaves no empty recording behind.
    if options.socket {
        crate::socket::check_free(&config.control.socket)?;
    }
    let path = match &options.recording {
        Some(path) => path.clone(),
        None => recording_path(&config.record.directory)?,
    };
    let mut info = RecordingInfo::new(PROGRAM, now_ns());
    info.log_time = if config.link.pacing == Pacing::Lockstep { LogTime::Tick } else { LogTime::Arrival };
    info.policy = policy_id;
    info.extra.extend([("model_rig".to_owned(), rig.name.clone()), ("reference".to_owned(), reference_name)]);
    info.extra.extend(options.extra);
    let file = |name: &str, text: String| Attachment {
        name: name.to_owned(),
        media_type: "application/toml".to_owned(),
        data: text.into_bytes(),
    };
    let attachments = [file("model_rig.toml", rig_text), file("controller.toml", options.config_text)];
    let recorder_options = RecorderOptions::new(sentence).observer(options.observer);
    let (recorder, sink) = Recorder::start(&path, &info, &attachments, recorder_options)?;
    let recorder = Arc::new(recorder);
    for remark in remarks.into_iter().chain(out_of_reach).chain(lock_memory()) {
        recorder.note(now_ns(), EventLevel::Warning, "start", remark);
    }
    let (tick_panel, operator) = panel();
    let socket = if options.socket {
        Some(crate::socket::serve(
            &config.control.socket,
            operator,
            config.safety,
            recorder.health(),
            Arc::clone(&options.stop),
        )?)
    } else {
        None
    };
    let outcome = in_tick_thread(config, cycle, sink, tick_panel, &options.stop, &recorder);
    options.stop.store(true, Ordering::Relaxed);
    if let Some(socket) = socket {
        socket.join();
    }
    let summary = Arc::into_inner(recorder).map(Recorder::finish).transpose()?;
    outcome?;
    summary.ok_or(DaemonError::Died)
}

fn in_tick_thread(
    config: &Config,
    cycle: Cycle,
    sink: flight::RecordSink,
    panel: crate::panel::TickPanel,
    stop: &Arc<AtomicBool>,
    recorder: &Arc<Recorder>,
) -> Result<(), DaemonError> {
    let speaker = Arc::clone(recorder);
    let say = Box::new(move |text: String| speaker.note(now_ns(), EventLevel::Warning, "link", text));
    let flight = Flight { config: config.clone(), cycle, sink, panel, stop: Arc::clone(stop), say };
    let thread = std::thread::Builder::new().name("tick".to_owned()).spawn(move || fly(flight))?;
    thread.join().map_err(|_| DaemonError::Died)
}

/// `flight-YYYYMMDD-HHMMSS.mcap` in the folder, which is made if it is not there.
fn recording_path(directory: &Path) -> Result<PathBuf, DaemonError> {
    std::fs::create_dir_all(directory)
        .map_err(|source| DaemonError::RecordDirectory { directory: directory.to_owned(), source })?;
    let seconds = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or(Duration::ZERO).as_secs();
    let stamp = file_stamp(seconds);
    // A second flight in the same second gets a number.
    let names =
        std::iter::once(format!("flight-{stamp}.mcap")).chain((2..1000).map(|n| format!("flight-{stamp}-{n}.mcap")));
    let free = names.map(|name| directory.join(name)).find(|path| !path.exists());
    Ok(free.unwrap_or_else(|| directory.join("flight.mcap")))
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

    #[test]
    fn a_reference_outside_the_envelope_is_refused() {
        let mut config = Config::for_address("127.0.0.1:1");
        config.safety.max_pos_kpa = 95.0;
        let message = check_reference(&config, &Reference::paper(), "paper").unwrap_err().to_string();
        assert!(message.contains("safety.max_pos_kpa = 95"), "{message}");
        assert!(check_reference(&config, &Reference::constant(90.0, -70.0), "hold").is_ok());
    }
}
