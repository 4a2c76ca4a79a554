//! Rigs for flights that need many ticks and no more than the loop's own accuracy.
//!
//! At steps of 0.25 ms instead of 0.1 the chamber pressures of both built-in rigs are off by at most 0.018 kPa over a minute of
//! random duties (`trainer simulate` with both), a third of the converter's noise, in two fifths of the time. Daemon and rig get
//! the same steps, so that their difference stays what the rigs differ by. What checks the physics itself keeps the paper's.

use std::path::PathBuf;

use model::rig::Rig;

use crate::Folder;

/// Integrator step in ms.
const STEP_MS: f64 = 0.25;

/// A built-in rig at these steps.
///
/// # Panics
/// If there is none of that name.
pub fn coarse(name: &str) -> Rig {
    let mut rig = Rig::builtin(name).expect("a built-in rig");
    rig.integrator.step_ms = STEP_MS;
    rig
}

/// Writes a built-in rig at these steps into a folder, as `NAME.toml`.
///
/// # Panics
/// If it cannot be written.
pub fn write_coarse(name: &str, folder: &Folder) -> PathBuf {
    folder.write(&format!("{name}.toml"), coarse(name).to_toml().expect("a rig that can be written"))
}

/// The line of a configuration by which a daemon believes in `dual_pressure` at these steps, the rig written into the folder; nothing
/// where further lines say what it believes in.
pub fn believed(folder: &Folder, further: &str) -> String {
    if further.contains("rig.file") {
        return String::new();
    }
    format!("rig.file = {:?}\n", write_coarse("dual_pressure", folder))
}
