//! Reading a configuration file again: settings that a running daemon takes over, and those that it does not.
//!
//! `SIGHUP` has the file read again. A file that is not sound changes nothing. Of one that is, the recordings' limits
//! and the reference are taken over, the reference only while the rig is not controlled and within the limits that are in
//! force; everything else would change what was checked at the start, and is named as needing a restart.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, channel};

use proto::reference::Reference;

use crate::config::sensor_limits::{ModelRigError, load_within_limits};
use crate::config::{Config, ConfigError, DEFAULT_POLICY, FALLBACK};
use crate::daemon::configured_reference;
use crate::operator::reference_limits::examine;

/// A configuration that was read again, with the reference it names.
#[derive(Debug)]
pub struct Reloaded {
    /// The configuration.
    pub config: Config,
    /// The reference that it names, the paper's where it names none.
    pub reference: Reference,
    /// Name of the reference.
    pub reference_name: String,
}

/// Reason why a configuration is not taken over.
#[derive(Debug, thiserror::Error)]
pub enum ReloadError {
    /// The file is not sound.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The reference is not.
    #[error(transparent)]
    Reference(#[from] proto::reference::ReferenceError),
    /// The rig is not, or its sensors do not show the limits.
    #[error(transparent)]
    Rig(#[from] ModelRigError),
    /// The policy is not there.
    #[error("{}: no such policy; put the file there, or set policy.active to another", .file.display())]
    NoPolicy {
        /// The file looked for.
        file: PathBuf,
    },
    /// The reference goes too far, or is too short to be repeated.
    #[error("reference {name}: {why}")]
    Beyond {
        /// The reference.
        name: String,
        /// Reason, in a clause.
        why: String,
    },
}

/// Reads the file on a thread of its own, so that a file system that hangs holds nobody.
///
/// # Errors
/// If no thread can be started.
pub fn read_aside(file: PathBuf) -> std::io::Result<Receiver<Result<Reloaded, ReloadError>>> {
    let (answer, from) = channel();
    std::thread::Builder::new().name("reload".to_owned()).spawn(move || {
        // Who asked may have gone.
        let _ = answer.send(read(&file));
    })?;
    Ok(from)
}

fn read(file: &std::path::Path) -> Result<Reloaded, ReloadError> {
    let config = Config::read(file)?;
    let (reference, reference_name) = configured_reference(&config.reference)?;
    // By this file's own limits, as the next start judges it. Those in force may be others, and the desk judges by them.
    if let Err(why) = examine(&reference, &config.safety, &config.reference) {
        return Err(ReloadError::Beyond { name: reference_name, why });
    }
    // What only a restart takes over must not keep the daemon from starting then.
    load_within_limits(&config.rig.file, None, config.safety)?;
    let active = config.policy.active.as_str();
    let file = config.policy.active_file();
    if active != FALLBACK && active != DEFAULT_POLICY && !file.is_file() {
        return Err(ReloadError::NoPolicy { file });
    }
    Ok(Reloaded { config, reference, reference_name })
}

/// The tables in which two configurations differ and which a running daemon cannot take over.
pub fn needs_restart(old: &Config, new: &Config) -> Vec<&'static str> {
    let same_folder = old.record.directory == new.record.directory;
    [
        ("link", old.link == new.link),
        ("rig", old.rig == new.rig),
        ("policy", old.policy == new.policy),
        ("record.directory", same_folder),
        ("control", old.control == new.control),
        ("reference.repeat", old.reference.repeat == new.reference.repeat),
        ("reference.learn", old.reference.learn == new.reference.learn),
        ("safety", old.safety == new.safety),
        ("realtime", old.realtime == new.realtime),
    ]
    .into_iter()
    .filter_map(|(name, same)| (!same).then_some(name))
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A rig that a start refuses is refused here too: one that no cRIO samples, though its file is sound.
    #[test]
    fn a_rig_that_cannot_stand_behind_the_wire_is_not_taken_over() {
        let file = |name: &str| std::env::temp_dir().join(format!("reload-{}-{name}.toml", std::process::id()));
        let (rig_file, config_file) = (file("rig"), file("config"));
        let mut rig = model::rig::Rig::builtin("dual_pressure").unwrap();
        rig.integrator.tick_ms = 40.0;
        proto::rig_file::save(&rig_file, &rig).unwrap();
        let text = format!("link.address = \"10.0.0.1:50500\"\nrig.file = \"{}\"\n", rig_file.display());
        std::fs::write(&config_file, text).unwrap();
        let refused = read(&config_file).map(|_| ()).unwrap_err();
        assert!(refused.to_string().contains("integrator.tick_ms: a tick of 40 ms"), "{refused}");
        [rig_file, config_file].iter().for_each(|file| std::fs::remove_file(file).unwrap());
    }

    #[test]
    fn a_limit_beyond_what_its_sensor_shows_is_not_taken_over() {
        let file = |name: &str| std::env::temp_dir().join(format!("reload-{}-{name}.toml", std::process::id()));
        let (rig_file, config_file) = (file("short-rig"), file("short-config"));
        let mut rig = model::rig::Rig::builtin("dual_pressure").unwrap();
        rig.sensors["sensor_pos"].range_kpa_gauge = [0.0, 110.0];
        proto::rig_file::save(&rig_file, &rig).unwrap();
        let text = format!("link.address = \"10.0.0.1:50500\"\nrig.file = \"{}\"\n", rig_file.display());
        std::fs::write(&config_file, &text).unwrap();
        let refused = read(&config_file).map(|_| ()).unwrap_err();
        assert!(refused.to_string().contains("safety.max_pos_kpa = 160 kPa"), "{refused}");
        std::fs::write(&config_file, text + "safety.max_pos_kpa = 108\n").unwrap();
        assert!(read(&config_file).is_ok(), "as that says");
        [rig_file, config_file].iter().for_each(|file| std::fs::remove_file(file).unwrap());
    }

    #[test]
    fn what_was_checked_at_the_start_needs_a_restart() {
        let old = Config::for_address("10.0.0.1:50500");
        let mut new = old.clone();
        new.record.max_minutes = 5;
        new.reference.file = Some("r.csv".into());
        assert!(needs_restart(&old, &new).is_empty());
        new.safety.max_pos_kpa = 120.0;
        new.record.directory = "elsewhere".into();
        assert_eq!(needs_restart(&old, &new), ["record.directory", "safety"]);
    }
}
