//! Obstacles to a new adaptation: its folder is taken, another one was left unfinished, or it is another
//! rig.

use std::path::Path;

use crate::AdaptError;
use crate::journal::Journal;
use crate::paths::BACK_AND_FORTH;

/// Checks that a folder can be given to a new adaptation: it is not there, or empty.
///
/// # Errors
/// It holds an adaptation or anything else, or cannot be read.
pub fn nothing(out: &Path) -> Result<(), AdaptError> {
    no_adaptation(out)?;
    match std::fs::read_dir(out) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(()),
        Err(error) => Err(AdaptError::file(out, format!("is no folder that can be used: {error}"))),
        Ok(mut entries) => match entries.next() {
            None => Ok(()),
            Some(_) => Err(AdaptError::file(out, "is not empty; give --out a new or an empty folder")),
        },
    }
}

/// Checks that a folder holds no adaptation.
pub(crate) fn no_adaptation(out: &Path) -> Result<(), AdaptError> {
    match Journal::is_in(out) {
        false => Ok(()),
        true => Err(AdaptError::file(out, "holds an adaptation already; go on with --resume, or give --out another")),
    }
}

/// Checks that the reference that is followed is no other adaptation's, which was killed: it would be taken for the
/// operator's.
pub(crate) fn no_other_run(reference: &Path) -> Result<(), AdaptError> {
    let folder = reference.parent().unwrap_or(Path::new(""));
    if reference.file_name().is_none_or(|name| name != BACK_AND_FORTH) || !Journal::is_in(folder) {
        return Ok(());
    }
    let problem = format!(
        "is followed for an adaptation that was not ended; `trainer adapt --resume {}` ends it, `controller reference FILE` \
         puts your own reference in its place",
        folder.display()
    );
    Err(AdaptError::file(reference, problem))
}

/// Checks that a configuration means the rig of the daemon that answers on its socket, as that daemon records its own.
pub(crate) fn same_rig(config: &Path, recorded: &[u8]) -> Result<(), AdaptError> {
    let address = |text: &str| {
        let table: toml::Table = toml::from_str(text).ok()?;
        Some(table.get("link")?.get("address")?.as_str()?.to_owned())
    };
    let given = std::fs::read_to_string(config).ok().and_then(|text| address(&text));
    let running = std::str::from_utf8(recorded).ok().and_then(address);
    match (given, running) {
        (Some(given), Some(running)) if given != running => Err(AdaptError::file(
            config,
            format!(
                "link.address is {given}, but the daemon that answers on its control.socket controls {running}; give \
                 --config the configuration that this daemon runs with"
            ),
        )),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::AdaptSettings;

    fn folder(name: &str) -> std::path::PathBuf {
        let folder = std::env::temp_dir().join(format!("adapt-found-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        folder
    }

    #[test]
    fn a_folder_with_anything_in_it_is_not_taken() {
        let folder = folder("taken");
        let said = |path: &Path| nothing(path).map_err(|error| error.to_string());
        assert_eq!(said(&folder), Ok(()));
        assert_eq!(said(&folder.join("new")), Ok(()));
        std::fs::write(folder.join("notes.txt"), "mine").unwrap();
        assert!(said(&folder).unwrap_err().contains("is not empty"));
        assert!(said(&folder.join("notes.txt")).unwrap_err().contains("is no folder"));
        Journal::new(AdaptSettings::new("c.toml".into())).keep(&folder).unwrap();
        assert!(said(&folder).unwrap_err().contains("holds an adaptation already"));
        // A reference of its own that is still followed belongs to it.
        assert!(no_other_run(&folder.join(BACK_AND_FORTH)).is_err());
        assert!(no_other_run(&folder.join("operators.csv")).is_ok());
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn a_configuration_of_another_rig_is_told() {
        let folder = folder("rig");
        let config = folder.join("c.toml");
        std::fs::write(&config, "[link]\naddress = \"10.0.0.1:50500\"\n").unwrap();
        assert!(same_rig(&config, b"[link]\naddress = \"10.0.0.1:50500\"\n").is_ok());
        let told = same_rig(&config, b"[link]\naddress = \"10.0.0.2:50500\"\n").unwrap_err().to_string();
        assert!(told.contains("10.0.0.1:50500") && told.contains("10.0.0.2:50500"), "{told}");
        assert!(same_rig(&config, b"").is_ok(), "a recording that does not say");
        std::fs::remove_dir_all(folder).unwrap();
    }
}
