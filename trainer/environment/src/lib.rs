//! The rig as a learning problem.
//!
//! | module | subject |
//! | --- | --- |
//! | [`settings`] | everything that can be chosen, as TOML |
//! | [`draws`] | random numbers, one stream for each purpose |
//! | [`rig_draw`] | rigs drawn around a nominal one: parameters and mechanisms |
//! | [`reference_draw`] | references over the reachable range |
//! | [`reward`] | the paper's reward |
//! | [`env`] | eight rigs side by side, each with its reference, noise and law: what a learner acts on |
//! | [`closed_loop`] | one rig, one controller, one reference: what a table's row is made of |
//! | [`score`] | tracking error, action change, hunting |
//! | [`plan_check`] | whether the plan that MPObs rolls ahead is what is then done |
//!
//! A tick runs exactly as in the daemon: measure, predict (MPObs), observe, decide, limit, apply; the same
//! [`law::PolicyLaw`] flies here and there. Everything is a function of a seed and an episode's number, so that
//! a training can stop between two episodes and go on as if it had not.

pub mod closed_loop;
pub mod draws;
pub mod plan_check;
pub mod reference_draw;
pub mod reward;
pub mod rig_draw;
pub mod score;
pub mod settings;
pub mod vector_env;

pub use closed_loop::{Controller, Flown, fly, fly_while};
pub use rig_draw::RigDraw;
pub use score::Score;
pub use settings::{DomainRandomization, EnvironmentSettings, MechanismDraw, RewardSettings};
pub use vector_env::{SIDE_BY_SIDE, Step, VectorEnv};

use model::rig::{Rig, RigError};
use proto::emulator::SensorScale;

/// Reason why an environment cannot be made or an episode cannot begin.
#[derive(Debug, thiserror::Error)]
pub enum EnvironmentError {
    /// The rig does not compile, lacks a port, or a drawn one is unsound.
    #[error("rig `{name}`: {error}")]
    Rig {
        /// The rig's name.
        name: String,
        /// Fault.
        error: RigError,
    },
    /// A setting is out of its range.
    #[error("{key}: {problem}")]
    Setting {
        /// The key in the configuration.
        key: String,
        /// Fault and its mend.
        problem: String,
    },
}

impl EnvironmentError {
    fn rig(rig: &Rig) -> impl Fn(RigError) -> EnvironmentError + '_ {
        |error| EnvironmentError::Rig { name: rig.name.clone(), error }
    }
}

/// The scales of the positive and the negative sensor of a rig.
///
/// # Errors
/// If a sensor is missing.
pub fn sensor_scales(rig: &Rig) -> Result<[SensorScale; 2], EnvironmentError> {
    let scale = |column: &str| {
        let (_, sensor) = rig.sensor_of(column).ok_or_else(|| EnvironmentError::Rig {
            name: rig.name.clone(),
            error: RigError::at("sensors", format!("no sensor uses column `{column}`; this controller needs it")),
        })?;
        let ([low_kpa, high_kpa], [low_v, high_v]) = (sensor.range_kpa_gauge, sensor.range_v);
        let per_v = (high_kpa - low_kpa) / (high_v - low_v);
        let at = |volts: f64| low_kpa + per_v * (volts - low_v);
        Ok(SensorScale { at_1v_kpa: at(1.0), at_5v_kpa: at(5.0) })
    };
    Ok([scale("p_pos_kpa")?, scale("p_neg_kpa")?])
}
