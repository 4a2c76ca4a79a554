//! `--rig` and `--refine`: which rig a command runs freely, and how finely.
//!
//! Check valves turn inside steps, where RK4 loses its order. A rig takes such steps again in halves
//! (`integrator.refine_switching`), which keeps 0.1 ms within 0.01 kPa of converged traces; offline a finer step still
//! costs nothing that matters.

use std::sync::Arc;

use clap::Args;
use model::plant::Plant;
use model::rig::Rig;
use proto::rig_file::{self, RigFileError};

use crate::failure::Failure;

#[derive(Debug, Args)]
pub(crate) struct RigChoice {
    /// Rig: a built-in name (dual_pressure, the paper's; bench, as built) or a TOML file. A built-in
    /// name always means the built-in rig; write ./NAME for a file of that name
    #[arg(long, value_name = "RIG", default_value = "dual_pressure")]
    pub(crate) rig: String,
    /// Integrator steps per step of the rig file (0.1 ms in the built-in rigs); 1 is what the daemon's model does
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=100))]
    refine: u32,
}

/// The finest step that a rig may have, in ms.
const FINEST_STEP_MS: f64 = 0.001;

impl RigChoice {
    /// Reads, checks and compiles the rig, with the finer step.
    ///
    /// # Errors
    /// What is wrong with the file or the rig, in one line.
    pub(crate) fn compile(&self) -> Result<(Rig, Arc<Plant<f64>>), Failure> {
        let mut rig = rig_file::load(&self.rig)?;
        rig.integrator.step_ms = refined(rig.integrator.step_ms, self.refine);
        let plant = Plant::new(&rig).map_err(|problem| RigFileError::Rig { file: self.rig.clone(), problem })?;
        Ok((rig, Arc::new(plant)))
    }
}

/// A step cut into at most `refine` equal parts, none finer than a rig may have.
fn refined(step_ms: f64, refine: u32) -> f64 {
    let most = (step_ms / FINEST_STEP_MS * (1.0 + 1e-9)).floor().max(1.0);
    step_ms / f64::from(refine).min(most)
}

#[cfg(test)]
mod tests {
    use super::refined;

    #[test]
    fn steps_are_cut_into_whole_parts_down_to_the_finest() {
        assert_eq!([refined(0.1, 1), refined(0.1, 4), refined(1.0, 100)], [0.1, 0.025, 0.01]);
        // A step that is already fine stays what a rig may have.
        assert_eq!([refined(0.002, 4), refined(0.001, 4)], [0.001, 0.001]);
    }
}
