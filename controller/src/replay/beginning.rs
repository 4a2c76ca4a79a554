//! The beginning of a recorded run: its part, and the cycle that the daemon began with.

use model::rig::Rig;
use policy::{Policy, PolicyError};
use proto::emulator::rig_and_crio;
use proto::reference::Reference;

use super::replay_error::ReplayError;
use super::run_file::{RunFile, attached};
use crate::config::Config;
use crate::cycle::Cycle;
use crate::daemon::contracts;
use crate::experiment::pump_relay::PumpRelay;

/// The error of a recording that does not hold the beginning of its run.
pub(super) fn no_beginning(run: &RunFile) -> ReplayError {
    match run.content.notes.first() {
        // A first part has nothing before it that could be given.
        Some(note) if run.part() == 1 => ReplayError::Damaged { note: note.clone() },
        _ => ReplayError::NoBeginning { file: run.path.display().to_string() },
    }
}

/// The cycle as it was when the recorded daemon began, and the relay of its model's pump.
pub(super) fn cycle(run: &RunFile) -> Result<(Cycle, PumpRelay), ReplayError> {
    let file = run.path.display().to_string();
    let damaged = |note: &String| ReplayError::Damaged { note: note.clone() };
    let missing = |name| match run.content.notes.first() {
        _ if run.is_damaged_inside(name) => ReplayError::DamagedInside { file: file.clone(), name },
        _ if run.is_experiment_alone() => ReplayError::ExperimentAlone { file: file.clone() },
        Some(note) => damaged(note),
        None => ReplayError::Missing { file: file.clone(), name },
    };
    // They say whether a policy was in control.
    if let Some(note) = run.content.notes.first().filter(|_| run.content.metadata.is_empty()) {
        return Err(damaged(note));
    }
    let inside = |name| run.attachment(name).ok_or_else(|| missing(name));
    let text = |name| Ok::<_, ReplayError>(String::from_utf8_lossy(inside(name)?).into_owned());
    let config = Config::parse(&text(attached::EFFECTIVE)?, std::path::Path::new(attached::EFFECTIVE))?;
    let model = |source| ReplayError::Model { file: file.clone(), name: attached::MODEL, source };
    let rig = Rig::from_toml(&text(attached::MODEL)?).map_err(model)?;
    let reference = Reference::parse(attached::REFERENCE, inside(attached::REFERENCE)?)?;
    let policy = match run.content.metadata.get("policy_sha256") {
        None => None,
        Some(expected) => {
            let name = run.content.metadata.get("policy_name").cloned().unwrap_or_default();
            let refused = |fault| PolicyError { file: attached::POLICY.into(), fault };
            let policy = Policy::from_bytes(name, inside(attached::POLICY)?, &contracts()).map_err(refused)?;
            let found = policy.hash().to_string();
            if found != *expected {
                return Err(ReplayError::OtherPolicy { file: file.clone(), found, expected: expected.clone() });
            }
            Some(policy)
        }
    };
    let (_, crio) = rig_and_crio(&rig).map_err(model)?;
    let mut cycle = Cycle::new(&rig, policy, reference, config.safety, config.control.arming()).map_err(model)?;
    cycle.duty_source_mut().tracking_mut().repeat(config.reference.after_end(), config.reference.learning());
    Ok((cycle, PumpRelay::of(&crio)))
}
