//! Policies beside the tick: what controls from the start is examined, then the watched directory is served.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use admission::{Examiner, Limits, Refusal, SignatureRule};
use handover::StoreEnd;
use model::rig::Rig;
use policy::{Links, Policy, PolicyHash};
use policy_store::{ActivePolicy, Adoption, Examination, PolicyDesk, PolicyStore, StoreSettings, Voices, WhenBehind};

use crate::config::{Config, Safety};
use crate::model_change::ModelDesk;
use crate::policy_signatures::offered;

/// Name of the audit record, in the folder of the recordings.
const AUDIT: &str = "policies.audit.jsonl";

/// Reason why a policy may not control from the start.
#[derive(Debug, thiserror::Error)]
pub enum AdmissionError {
    /// It was refused at a stage.
    #[error("{}: {refusal}; set policy.active to another, or \"fallback\"", .file.display())]
    Refused {
        /// The file.
        file: PathBuf,
        /// Stage and reason.
        refusal: Refusal,
    },
    /// The trial cannot be laid out for the model.
    #[error("rig {name}: {problem}")]
    Rig {
        /// The rig.
        name: String,
        /// Reason.
        problem: model::rig::RigError,
    },
    /// The key is none.
    #[error("policy.public_key: {0}")]
    Key(#[from] admission::signature::KeyError),
}

/// The limits that a trial must keep: those at which the daemon vents.
fn limits(safety: Safety) -> Limits {
    Limits { max_pos_kpa: safety.max_pos_kpa, min_neg_kpa: safety.min_neg_kpa }
}

/// Takes the file that is to control from the start through all stages before the rig.
///
/// # Errors
/// The stage that refused it and why.
pub fn examine_active(config: &Config, rig: &Rig, file: &Path) -> Result<(Policy, Vec<u8>), AdmissionError> {
    let rig_error = |problem| AdmissionError::Rig { name: config.rig.file.clone(), problem };
    let examiner =
        Examiner::new(offered().into(), signature_rule(config)?, rig, limits(config.safety)).map_err(rig_error)?;
    examiner
        .examine_file(file, Links::Follow, examiner.fallback())
        .map(|(admitted, bytes)| (admitted.policy, bytes.to_vec()))
        .map_err(|refusal| AdmissionError::Refused { file: file.to_owned(), refusal })
}

/// Policies and models of a running daemon, for operators.
#[derive(Clone)]
pub struct PolicyHandle {
    /// Policies.
    pub policies: PolicyDesk,
    /// Models.
    pub models: ModelDesk,
}

/// Serves the watched directory for a loop that runs, until `stop` is set.
///
/// # Errors
/// The key cannot be used, or the system gives no thread.
pub fn start(
    config: &Config,
    rig: &Rig,
    active: Option<(String, PolicyHash, Arc<[u8]>)>,
    end: StoreEnd,
    stop: Arc<AtomicBool>,
    voices: Voices,
) -> Result<PolicyStore, ServiceError> {
    let rule = signature_rule(config)?;
    let settings = StoreSettings {
        directory: config.policy.directory.clone(),
        adoption: adoption(config),
        when_behind: when_behind(config),
        audit: config.record.directory.join(AUDIT),
        signatures: offered().into(),
    };
    let active = active
        .filter(|(_, hash, bytes)| policy::hash(bytes) == *hash)
        .map(|(name, _, bytes)| ActivePolicy { name, bytes });
    let safety = config.safety;
    let examiner = Box::new(move |rig: &Rig| {
        let rule = rule.clone();
        Examiner::new(offered().into(), rule, rig, limits(safety)).map_err(|e| format!("rig {}: {e}", rig.name))
    });
    let examination = Examination { model: rig.clone(), examiner };
    Ok(PolicyStore::start(settings, active, end, examination, stop, voices)?)
}

/// Reason why the watched directory cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum ServiceError {
    /// The key is none.
    #[error(transparent)]
    Admission(#[from] AdmissionError),
    /// The system gives no thread.
    #[error("the watched directory of policies cannot be served: {0}")]
    Thread(#[from] std::io::Error),
}

fn signature_rule(config: &Config) -> Result<SignatureRule, AdmissionError> {
    match &config.policy {
        choice if choice.require_signature => Ok(SignatureRule::required(&choice.public_key)?),
        _ => Ok(SignatureRule::None),
    }
}

fn adoption(config: &Config) -> Adoption {
    match config.policy.follow {
        crate::config::Follow::Manual => Adoption::Manual,
        crate::config::Follow::Newest => Adoption::Newest,
    }
}

fn when_behind(config: &Config) -> WhenBehind {
    match config.policy.when_behind {
        crate::config::WhenBehind::Fallback => WhenBehind::Fallback,
        crate::config::WhenBehind::Fly => WhenBehind::Fly,
    }
}
