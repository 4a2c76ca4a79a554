//! Puts the daemon together: everything that a configuration names is read and checked, then flown
//! ([`crate::session::session_recorder`]).

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use flight::{Recorded, RecordingSummary};
use model::rig::Rig;
use policy::{Policy, PolicySignature};
use proto::recording::Attachment;
use proto::reference::Reference;

use crate::config::sensor_limits::{ModelRigError, load_within_limits};
use crate::config::{Config, DEFAULT_POLICY, FALLBACK, ReferenceChoice};
use crate::cycle::Cycle;
use crate::operator::notice::sentence;
use crate::operator::reference_limits::examine;
use crate::operator::running::ModelIdentity;
use crate::operator::socket::{May, Running};
use crate::policy_service::{self, PolicyHandle};
use crate::replay::run_file::attached;
use crate::session::run_length::{RunEnd, RunLength};
use crate::session::session_recorder::{Flown, SessionError, SessionRecorder, StartPolicies, attachment, fly_recorded};

pub use crate::session::session_recorder::PROGRAM;

/// Reason why the daemon cannot start or did not end well.
#[derive(Debug, thiserror::Error)]
pub enum DaemonError {
    /// The rig cannot be read, or its sensors do not show the configuration's limits.
    #[error(transparent)]
    Rig(#[from] ModelRigError),
    /// The rig cannot be flown.
    #[error("rig {name}: {problem}")]
    Unflyable {
        /// The rig.
        name: String,
        /// Reason.
        problem: model::rig::RigError,
    },
    /// The reference cannot be read.
    #[error(transparent)]
    Reference(#[from] proto::reference::ReferenceError),
    /// The policy cannot be loaded.
    #[error(transparent)]
    Policy(#[from] policy::PolicyError),
    /// The policy was refused at one of the stages before the rig.
    #[error(transparent)]
    Admission(#[from] policy_service::AdmissionError),
    /// There is no such policy.
    #[error("{}: no such policy; put the file there, or set policy.active to one of: {known}", .file.display())]
    NoPolicy {
        /// The file looked for.
        file: PathBuf,
        /// The names there are.
        known: String,
    },
    /// The reference comes too near to the safety envelope, leaves it, or is too short to be repeated.
    #[error("reference {name}: {why}")]
    ReferenceBeyond {
        /// The reference.
        name: String,
        /// Place, limit or key, and the fix.
        why: String,
    },
    /// The flight cannot start or was not recorded well.
    #[error(transparent)]
    SessionRecorder(#[from] SessionError),
}

/// Things that are flown, read and checked.
pub struct Loaded {
    /// The model's rig.
    pub rig: Rig,
    /// Text of the rig file, for the recording.
    pub rig_text: String,
    /// The reference.
    pub reference: Reference,
    /// Name of the reference.
    pub reference_name: String,
    /// The policy, if one flies.
    pub policy: Option<Policy>,
    /// The policy's file, for the recording.
    pub policy_bytes: Option<Vec<u8>>,
    /// Remarks on these choices, for people.
    pub remarks: Vec<String>,
}

/// Name of the paper's reference in recordings.
pub const PAPERS_REFERENCE: &str = "the paper's";

/// The contracts that policies may meet.
pub fn contracts() -> [PolicySignature; 2] {
    crate::policy_signatures::offered()
}

/// Reads and checks everything a configuration names.
///
/// # Errors
/// The first thing that is wrong.
pub fn load(config: &Config) -> Result<Loaded, DaemonError> {
    let mut remarks = Vec::new();
    let rig = load_within_limits(&config.rig.file, None, config.safety)?;
    let (reference, reference_name) = configured_reference(&config.reference)?;
    if config.reference.file.is_none() {
        remarks.push("no reference file: following the paper's reference (set reference.file for another)".to_owned());
    }
    let chosen = load_policy(config, &rig, &mut remarks)?;
    check_reference(config, &reference, &reference_name, &mut remarks)?;
    let rig_text = rig.to_toml().unwrap_or_default();
    let (policy, policy_bytes) = chosen.map_or((None, None), |(policy, bytes)| (Some(policy), Some(bytes)));
    Ok(Loaded { rig, rig_text, reference, reference_name, policy, policy_bytes, remarks })
}

/// Reads the reference that a configuration names, the paper's where it names none, with what it is called.
///
/// # Errors
/// The file cannot be read, or is no reference.
pub fn configured_reference(choice: &ReferenceChoice) -> Result<(Reference, String), proto::reference::ReferenceError> {
    match &choice.file {
        Some(file) => Ok((Reference::read(file)?, file.display().to_string())),
        None => Ok((Reference::paper(), PAPERS_REFERENCE.to_owned())),
    }
}

fn check_reference(
    config: &Config,
    reference: &Reference,
    name: &str,
    remarks: &mut Vec<String>,
) -> Result<(), DaemonError> {
    let told = examine(reference, &config.safety, &config.reference)
        .map_err(|why| DaemonError::ReferenceBeyond { name: name.to_owned(), why })?;
    remarks.extend(told.into_iter().map(|remark| format!("reference {name}: {remark}")));
    Ok(())
}

/// The policy that ships with the program; docs/training-results.md says how it was trained.
const SHIPPED_POLICY: &[u8] = include_bytes!("../policies/default.onnx");

/// Loads and checks the policy that ships with the program, as any other.
///
/// # Errors
/// If this build carries one that this program refuses.
pub fn shipped_policy() -> Result<(Policy, Vec<u8>), DaemonError> {
    let refused = |fault| policy::PolicyError { file: "the shipped policy".into(), fault };
    let policy = Policy::from_bytes("default, as shipped".to_owned(), SHIPPED_POLICY, &contracts()).map_err(refused)?;
    Ok((policy, SHIPPED_POLICY.to_vec()))
}

/// Loads and checks a policy, and keeps its file for the recording.
///
/// # Errors
/// The file cannot be read, or is refused.
pub fn policy_file(file: &Path) -> Result<(Policy, Vec<u8>), policy::PolicyError> {
    let (policy, bytes) = (Policy::load(file, &contracts())?, std::fs::read(file).unwrap_or_default());
    // What was checked is what is kept: a file that changed in between is loaded from the bytes that are kept.
    let name = policy.name().to_owned();
    let same = Policy::from_bytes(name, &bytes, &contracts());
    Ok((same.map_err(|fault| policy::PolicyError { file: file.to_owned(), fault })?, bytes))
}

fn load_policy(
    config: &Config,
    rig: &Rig,
    remarks: &mut Vec<String>,
) -> Result<Option<(Policy, Vec<u8>)>, DaemonError> {
    let choice = &config.policy;
    if choice.active == FALLBACK {
        return Ok(None);
    }
    let file = choice.active_file();
    if file.is_file() {
        return Ok(Some(policy_service::examine_active(config, rig, &file)?));
    }
    if choice.active == DEFAULT_POLICY {
        remarks.push(format!("no policy at {}: the one that ships with the program runs", file.display()));
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

/// Settings of a flight.
pub struct Options {
    /// Place where the recording goes; by default a file named after the time in the configured folder.
    pub recording: Option<PathBuf>,
    /// Length of the run.
    pub length: RunLength,
    /// True where the operator's socket is served.
    pub socket: bool,
    /// Entries of the recording beside ticks.
    pub extra: Vec<(String, String)>,
    /// The configuration's text, for the recording.
    pub config_text: String,
    /// Other files that go into the recording.
    pub attachments: Vec<Attachment>,
    /// The configuration's file, to be read again on `SIGHUP`.
    pub config_file: Option<PathBuf>,
    /// Sees every tick and event, in the recorder's thread.
    pub observer: Box<dyn FnMut(Recorded<'_>) + Send>,
    /// Set by somebody else to end the flight.
    pub stop: Arc<AtomicBool>,
}

/// A flight that has ended.
#[derive(Debug)]
pub struct Flight {
    /// The recording.
    pub recording: RecordingSummary,
    /// End that the run came to.
    pub end: RunEnd,
}

/// Runs the daemon until the flight is over or it is told to stop.
///
/// # Errors
/// Why it cannot start, or what was lost at the end.
pub fn run(config: &Config, loaded: Loaded, options: Options) -> Result<Flight, DaemonError> {
    let Loaded { rig, rig_text, reference, reference_name, policy, policy_bytes, mut remarks } = loaded;
    let mut attachments = options.attachments;
    attachments.push(attachment(attached::MODEL, "application/toml", rig_text));
    attachments.push(attachment(attached::CONFIG, "application/toml", options.config_text));
    attachments.push(attachment(attached::EFFECTIVE, "application/toml", config.to_toml()));
    attachments.push(attachment(attached::REFERENCE, "text/csv", reference.to_csv()));
    let unflyable = |problem| DaemonError::Unflyable { name: config.rig.file.clone(), problem };
    let policy_id = policy.as_ref().map(|p| (p.name().to_owned(), p.hash().to_string()));
    let active = policy.as_ref().zip(policy_bytes.as_ref()).map(|(policy, bytes)| {
        // An operator calls it what the configuration does.
        (config.policy.active.clone(), policy.hash(), Arc::from(bytes.as_slice()))
    });
    attachments.extend(policy_bytes.map(|bytes| attachment(attached::POLICY, "application/onnx", bytes)));
    let followed = Some(Arc::new(reference.clone()));
    let mut cycle = Cycle::new(&rig, policy, reference, config.safety, config.control.arming()).map_err(unflyable)?;
    cycle.duty_source_mut().tracking_mut().repeat(config.reference.after_end(), config.reference.learning());
    remarks.extend(cycle.duty_source().tracking().beyond_reach());
    let (policy_name, policy_sha256) = policy_id.clone().unwrap_or_else(|| (FALLBACK.to_owned(), String::new()));
    let running =
        Running { policy: policy_name, policy_sha256, reference: reference_name.clone(), ..Running::default() }
            .on_model(ModelIdentity::of(&rig, &config.rig.file));
    let policies: Option<StartPolicies> = options.socket.then(|| {
        let (config, rig, end, models) = (
            config.clone(),
            rig.clone(),
            cycle.duty_source().tracking().policies(),
            cycle.duty_source().tracking().models(),
        );
        let start: StartPolicies = Box::new(move |voices, stop| {
            let store = policy_service::start(&config, &rig, active, end, stop, voices)?;
            Ok(PolicyHandle { policies: store.desk(), models })
        });
        start
    });
    let mut extra = vec![("model_rig".to_owned(), rig.name.clone()), ("reference".to_owned(), reference_name)];
    extra.extend(options.extra);
    let logbook = SessionRecorder {
        file: options.recording,
        stem: "run",
        policy: policy_id,
        extra,
        attachments,
        remarks,
        event_text: sentence,
        operator: options.socket.then_some(May::Fly),
        running,
        followed,
        policies,
        config_file: options.config_file,
        observer: options.observer,
        stop: options.stop,
        length: options.length,
    };
    let Flown { recording, end, .. } = fly_recorded(config, cycle, logbook)?;
    Ok(Flight { recording, end })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reference_outside_the_envelope_is_refused() {
        let mut config = Config::for_address("127.0.0.1:1");
        config.safety.max_pos_kpa = 95.0;
        let mut remarks = Vec::new();
        let message = check_reference(&config, &Reference::paper(), "paper", &mut remarks).unwrap_err().to_string();
        assert!(message.contains("safety.max_pos_kpa = 95"), "{message}");
        assert!(check_reference(&config, &Reference::constant(90.0, -70.0), "hold", &mut remarks).is_ok());
        assert!(remarks.is_empty());
        assert!(check_reference(&config, &Reference::constant(93.0, -70.0), "near", &mut remarks).is_ok());
        assert!(remarks.concat().contains("2.0 kPa inside"), "{remarks:?}");
    }
}
