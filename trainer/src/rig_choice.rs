//! `--rig` and `--refine`: which rig a command runs freely, and how finely.
//!
//! Check valves turn inside steps, where RK4 loses its order. A rig takes such steps again in halves
//! (`integrator.refine_switching`), which keeps 0.1 ms within 0.01 kPa of converged traces; offline a finer step still
//! costs nothing that matters.
//!
//! Commands without `--refine` read their rig by [`load_for_rows`].

use std::sync::Arc;

use clap::Args;
use free_run::FreeRun;
use free_run::refine::{REFINE, refined};
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
    #[arg(long, value_name = "N", default_value_t = REFINE, value_parser = clap::value_parser!(u32).range(1..=100))]
    refine: u32,
}

impl RigChoice {
    /// Reads, checks and compiles the rig, with the finer step.
    ///
    /// # Errors
    /// The file or the rig is wrong, in one line.
    pub(crate) fn compile(&self) -> Result<(Rig, Arc<Plant<f64>>), Failure> {
        let mut rig = rig_file::load(&self.rig)?;
        rig.integrator.step_ms = refined(rig.integrator.step_ms, self.refine);
        let plant = Plant::new(&rig).map_err(|problem| RigFileError::Rig { file: self.rig.clone(), problem })?;
        Ok((rig, Arc::new(plant)))
    }
}

/// Reads and checks a rig that is to run over the rows of recordings: a built-in one or a file. One whose tick does not go into a
/// row is refused by its file before any recording is read.
///
/// # Errors
/// The file or the rig is wrong, in one line.
pub(crate) fn load_for_rows(file: &str) -> Result<Rig, RigFileError> {
    let rig = rig_file::load(file)?;
    let runs = Plant::new(&rig).and_then(|plant| FreeRun::new(&rig, Arc::new(plant)));
    match runs {
        Ok(_) => Ok(rig),
        Err(problem) => Err(RigFileError::Rig { file: file.to_owned(), problem }),
    }
}
