//! Places of files and folders in the folder of an adaptation.

use std::path::{Path, PathBuf};

use crate::AdaptError;
use crate::journal::Journal;
use crate::run::Adaptation;

/// Name of the reference that goes back and forth.
pub(crate) const BACK_AND_FORTH: &str = "back-and-forth.csv";
/// Name of the folder of the recordings that diagnosis reads.
const RECORDINGS: &str = "recordings";

impl Adaptation {
    /// Folder of what was there before anything was changed.
    pub(crate) fn before_folder(&self) -> PathBuf {
        self.out.join("before")
    }

    /// File of the model that was in force before.
    pub(crate) fn model_before(&self) -> PathBuf {
        self.before_folder().join("model.toml")
    }

    /// File of the operator's reference as it was recorded.
    pub(crate) fn recorded_reference(&self) -> PathBuf {
        self.before_folder().join("reference.csv")
    }

    /// File of the policy that controlled before, where one did.
    pub(crate) fn policy_before(&self) -> PathBuf {
        self.before_folder().join("policy.onnx")
    }

    /// File of the reference that goes back and forth.
    pub(crate) fn back_and_forth_file(&self) -> PathBuf {
        self.out.join(BACK_AND_FORTH)
    }

    /// Folder of the recordings that diagnosis reads.
    pub(crate) fn recordings_folder(&self) -> PathBuf {
        self.out.join(RECORDINGS)
    }

    /// File of the experiment of a number, counted from 1.
    pub(crate) fn excitation_file(&self, number: usize) -> PathBuf {
        self.out.join(format!("excitation-{number}.csv"))
    }

    /// Folder of the diagnosis of a round, counted from 1.
    pub(crate) fn found_folder(&self, round: usize) -> PathBuf {
        self.out.join(if round == 1 { "found".to_owned() } else { format!("found-{round}") })
    }

    /// File of the rig that was found last.
    pub(crate) fn found_rig(&self) -> PathBuf {
        self.journal.found.clone().unwrap_or_default().join("rig.toml")
    }

    /// Folder of the optimum on the model.
    pub(crate) fn optimum_folder(&self) -> PathBuf {
        self.out.join("optimum")
    }

    /// Folder of the training's run.
    pub(crate) fn training_folder(&self) -> PathBuf {
        self.out.join("run")
    }

    /// File of the policy that was trained.
    pub(crate) fn trained_policy(&self) -> PathBuf {
        self.out.join("adapted.onnx")
    }
}

/// Path of a folder from the root, the same from wherever and through whichever link it is named; what is not there yet stays as
/// it is written. The daemon and the journal are told of files by it, and a run may be gone on with from anywhere.
///
/// # Errors
/// The working folder is not known.
pub(crate) fn settled(folder: &Path) -> Result<PathBuf, AdaptError> {
    let written = std::path::absolute(folder).map_err(|error| AdaptError::file(folder, error))?;
    let there = written.ancestors().find_map(|there| Some((there, there.canonicalize().ok()?)));
    Ok(match there {
        // Joined with nothing it would end with a slash.
        Some((there, settled)) if there == written => settled,
        Some((there, settled)) => settled.join(written.strip_prefix(there).unwrap_or(&written)),
        None => written,
    })
}

impl Journal {
    /// Takes its files in the run's folder wherever that is now: it may have been moved or copied, or its journal written by an older
    /// program, whose paths began where it was started.
    pub(crate) fn found_again_in(&mut self, out: &Path) {
        let again = |path: &mut PathBuf, folder: &Path| {
            let there = path.file_name().map(|name| folder.join(name)).filter(|there| there.exists());
            if let Some(there) = there {
                *path = there;
            }
        };
        self.recordings.iter_mut().for_each(|recording| again(recording, &out.join(RECORDINGS)));
        self.found.iter_mut().chain(&mut self.trained).for_each(|path| again(path, out));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::AdaptSettings;

    /// A folder that is named through a link, through its neighbour and from the working folder is one and the same.
    #[test]
    fn a_folder_has_one_path_however_it_is_named() {
        let folder = std::env::temp_dir().join(format!("adapt-paths-{}", std::process::id()));
        std::fs::create_dir_all(folder.join("there/run")).unwrap();
        std::fs::create_dir_all(folder.join("beside")).unwrap();
        std::os::unix::fs::symlink(folder.join("there"), folder.join("link")).unwrap();
        let run = folder.join("there/run").canonicalize().unwrap();
        for named in ["there/run", "link/run", "beside/../there/run", "there/./run"] {
            assert_eq!(settled(&folder.join(named)).unwrap(), run, "{named}");
        }
        assert_eq!(
            settled(&folder.join("link/new/run")).unwrap(),
            folder.canonicalize().unwrap().join("there/new/run")
        );
        assert_eq!(
            settled(Path::new("new")).unwrap(),
            std::env::current_dir().unwrap().canonicalize().unwrap().join("new")
        );
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn a_journal_finds_its_files_where_its_folder_is_now() {
        let out = std::env::temp_dir().join(format!("adapt-moved-{}", std::process::id()));
        std::fs::create_dir_all(out.join("recordings")).unwrap();
        std::fs::create_dir_all(out.join("found-2")).unwrap();
        std::fs::write(out.join("recordings/run-1.csv"), "").unwrap();
        let elsewhere = out.join("recordings/run-1.csv");
        let mut journal = Journal::new(AdaptSettings::new("c.toml".into()));
        journal.recordings =
            vec!["old/recordings/run-1.csv".into(), elsewhere.clone(), "old/recordings/gone.csv".into()];
        (journal.found, journal.trained) = (Some("/nowhere/old/found-2".into()), Some("old/adapted.onnx".into()));
        journal.found_again_in(&out);
        assert_eq!(journal.recordings, [elsewhere.clone(), elsewhere, "old/recordings/gone.csv".into()]);
        assert_eq!(journal.found, Some(out.join("found-2")));
        assert_eq!(journal.trained, Some("old/adapted.onnx".into()), "what is nowhere keeps its name for the message");
        std::fs::remove_dir_all(out).unwrap();
    }
}
