//! The folder that recordings of a run go to, with its limits: as configured, and tried before anything is made.

use std::path::Path;
use std::time::Duration;

use flight::{Destination, Retention};

use super::session_recorder::SessionError;
use crate::config::Config;
use crate::machine::clock::now_ns;
use crate::machine::trial_file::try_file;

/// Stems of all recordings that the daemon makes.
const STEMS: [&str; 3] = ["run", EXPERIMENT_STEM, "flight"];
/// Stem of recordings of experiments.
pub(crate) const EXPERIMENT_STEM: &str = "experiment";

/// The folder for recordings and its limits, as configured.
pub(super) fn destination(config: &Config, stem: &'static str) -> Destination {
    let record = &config.record;
    Destination {
        directory: record.directory.clone(),
        stem,
        stems: &STEMS,
        most_bytes: record.max_mib << 20,
        most_time: Duration::from_secs(record.max_minutes * 60),
        min_free_bytes: record.min_free_mib << 20,
        retention: Retention { days: record.keep_days, bytes: record.keep_gib << 30 },
        clock: now_ns,
    }
}

/// Makes the folder and tries to write there; with `auto_arm`, for which nobody asks, there must be room as well.
pub(super) fn check_folder(to: &Destination, config: &Config) -> Result<(), SessionError> {
    try_folder(&to.directory).map_err(|source| SessionError::Directory { directory: to.directory.clone(), source })?;
    match flight::disk::free_bytes(&to.directory) {
        Some(free) if config.control.auto_arm && free < to.min_free_bytes => Err(SessionError::NoRoom {
            directory: to.directory.clone(),
            free_mib: free >> 20,
            min_mib: to.min_free_bytes >> 20,
        }),
        _ => Ok(()),
    }
}

/// Makes a folder if it is not there, and tries to write in it.
fn try_folder(directory: &Path) -> std::io::Result<()> {
    flight::disk::make_folder(directory)?;
    try_file(directory)
}
