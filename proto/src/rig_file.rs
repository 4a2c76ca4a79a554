//! Rig files: from what a user writes behind `--rig` to a checked rig, and back to a file.
//!
//! A name of a built-in rig ([`Rig::BUILTIN`]) always means the built-in one, whatever files lie in
//! the current folder: the same command line is the same rig everywhere. A file that happens to be
//! called `dual_pressure` is reached as `./dual_pressure`. Anything else is a path.
//!
//! Errors begin with the path and are one line: `rig.toml: line 20: volumes.positive.volume_l: …`.
//!
//! Left out: comments. [`save`] writes the rig as data, so a file that is read and saved loses them.

use std::io;
use std::path::Path;

use model::rig::{Rig, RigError};

use crate::atomic_file::{self, AtomicFileError};
use crate::regular_file;

/// The largest rig file that is read, in bytes; the built-in ones are 4 kB.
pub const MOST_BYTES: u64 = 1 << 20;

/// Why a rig cannot be had, or not be saved.
#[derive(Debug, thiserror::Error)]
pub enum RigFileError {
    /// No file and no built-in rig of this name.
    #[error("{name}: there is neither a file nor a built-in rig of that name; built in are {}", Rig::BUILTIN.join(", "))]
    Neither {
        /// Name that was asked for.
        name: String,
    },
    /// The file is there and cannot be read.
    #[error("{file}: cannot read the rig: {source}")]
    Read {
        /// The file.
        file: String,
        /// Error of the system.
        source: io::Error,
    },
    /// The file is far larger than any rig.
    #[error("{file}: more than {MOST_BYTES} bytes; that is no rig file")]
    TooLarge {
        /// The file.
        file: String,
    },
    /// Bytes that are not UTF-8.
    #[error("{file}: line {line}: not UTF-8 text; save the file as UTF-8 TOML")]
    NotUtf8 {
        /// The file.
        file: String,
        /// Line, from 1.
        line: usize,
    },
    /// The file is read and the rig in it is wrong.
    #[error("{file}: {problem}")]
    Rig {
        /// The file, or the name of the built-in rig.
        file: String,
        /// Line, key and problem.
        problem: RigError,
    },
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] AtomicFileError),
}

/// Reads a rig by the name of a built-in one or the path of a file, and checks it.
///
/// # Errors
/// One line with the file and what is wrong: neither file nor built-in rig, unreadable, too large, not
/// UTF-8, or the first thing wrong in it, by line and key.
pub fn load(name_or_path: &str) -> Result<Rig, RigFileError> {
    let file = || name_or_path.to_owned();
    let wrong = |problem| RigFileError::Rig { file: file(), problem };
    if Rig::builtin_text(name_or_path).is_some() {
        return Rig::builtin(name_or_path).map_err(wrong);
    }
    let bytes = match regular_file::read(Path::new(name_or_path), MOST_BYTES) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Err(RigFileError::Neither { name: file() }),
        Err(error) if error.kind() == io::ErrorKind::FileTooLarge => {
            return Err(RigFileError::TooLarge { file: file() });
        }
        Err(source) => return Err(RigFileError::Read { file: file(), source }),
    };
    let text = std::str::from_utf8(&bytes).map_err(|error| {
        let sound = bytes.get(..error.valid_up_to()).unwrap_or_default();
        RigFileError::NotUtf8 { file: file(), line: 1 + sound.iter().filter(|byte| **byte == b'\n').count() }
    })?;
    Rig::from_toml(text).map_err(wrong)
}

/// Writes a rig to a file that [`load`] reads back to the same rig: aside, synced, renamed.
///
/// # Errors
/// The rig is unsound, which would only show when the file is read; or the file cannot be written.
pub fn save(path: &Path, rig: &Rig) -> Result<(), RigFileError> {
    let wrong = |problem| RigFileError::Rig { file: path.display().to_string(), problem };
    rig.check().map_err(wrong)?;
    let text = rig.to_toml().map_err(wrong)?;
    Ok(atomic_file::write(path, text.as_bytes())?)
}

/// Gives a rig that came out of a fit its name, with one ending however often it was fitted, and a description with this sentence more.
pub fn rename_fitted(rig: &mut Rig, ending: FitEnding, sentence: &str) {
    let endings = [FitEnding::Extended, FitEnding::Fitted, FitEnding::Identified].map(FitEnding::text);
    let bare = endings.iter().find_map(|ending| rig.name.strip_suffix(ending)).unwrap_or(&rig.name);
    rig.name = format!("{bare}{}", ending.text());
    let before = rig.description.trim_end();
    let separator = match before.chars().last() {
        None => "",
        Some('.' | '!' | '?' | ':') => " ",
        Some(_) => ". ",
    };
    rig.description = format!("{before}{separator}{sentence}");
}

/// Ending of the name of a rig that came out of a fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FitEnding {
    /// Rig with physics that the given one lacks.
    Extended,
    /// Rig with fitted numbers; a search for missing physics added none.
    Fitted,
    /// Rig with fitted numbers, where nothing else was asked.
    Identified,
}

impl FitEnding {
    fn text(self) -> &'static str {
        match self {
            FitEnding::Extended => "_extended",
            FitEnding::Fitted => "_fitted",
            FitEnding::Identified => "_identified",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::rig::DUAL_PRESSURE;
    use std::path::PathBuf;

    struct Folder(PathBuf);

    impl Folder {
        fn new(name: &str) -> Self {
            let folder = std::env::temp_dir().join(format!("rig-file-{}-{name}", std::process::id()));
            std::fs::create_dir_all(&folder).unwrap();
            Folder(folder)
        }

        fn with(&self, name: &str, bytes: &[u8]) -> String {
            let path = self.0.join(name);
            std::fs::write(&path, bytes).unwrap();
            path.to_str().unwrap().to_owned()
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }

    /// The message without the path it must begin with.
    fn problem(path: &str) -> String {
        let message = load(path).unwrap_err().to_string();
        assert!(!message.contains('\n'), "{message}");
        message.strip_prefix(&format!("{path}: ")).unwrap_or_else(|| panic!("no path in {message}")).to_owned()
    }

    #[test]
    fn built_in_names_and_files_both_load() {
        let folder = Folder::new("load");
        let path = folder.with("mine.toml", DUAL_PRESSURE.as_bytes());
        assert_eq!(load(&path).unwrap(), load("dual_pressure").unwrap());
        assert_eq!(load("bench").unwrap().name, "bench");
        // Editors on other systems put a byte-order mark and CRLF.
        let windows = folder.with("bom.toml", format!("\u{feff}{}", DUAL_PRESSURE.replace('\n', "\r\n")).as_bytes());
        assert_eq!(load(&windows).unwrap(), load("dual_pressure").unwrap());
    }

    #[test]
    fn a_file_is_never_taken_for_a_built_in_rig() {
        let folder = Folder::new("shadow");
        let other = DUAL_PRESSURE.replace("volume_l = 0.75", "volume_l = 0.6");
        // With a folder in the path it is a file, without one it is the built-in rig.
        assert_eq!(load(&folder.with("dual_pressure", other.as_bytes())).unwrap().volumes["positive"].volume_l, 0.6);
        assert_eq!(load("dual_pressure").unwrap().volumes["positive"].volume_l, 0.75);
    }

    #[test]
    fn wrong_files_get_one_line_with_path_line_and_key() {
        let folder = Folder::new("wrong");
        let line = 1 + DUAL_PRESSURE.lines().position(|line| line.starts_with("volume_l = 0.75")).unwrap();
        let negative = folder.with("a.toml", DUAL_PRESSURE.replace("volume_l = 0.75", "volume_l = -1.0").as_bytes());
        let text = problem(&negative);
        assert!(text.starts_with(&format!("line {line}: volumes.positive.volume_l: -1 L is outside")), "{text}");
        let latin = folder.with("b.toml", b"format = 1\nname = \"Pr\xFCfstand\"\n");
        assert_eq!(problem(&latin), "line 2: not UTF-8 text; save the file as UTF-8 TOML");
        let large = folder.with("c.toml", &vec![b'#'; MOST_BYTES as usize + 1]);
        assert_eq!(problem(&large), "more than 1048576 bytes; that is no rig file");
        assert!(problem(folder.0.to_str().unwrap()).starts_with("cannot read the rig: "));
        let none = folder.0.join("benhc").to_str().unwrap().to_owned();
        assert_eq!(
            problem(&none),
            "there is neither a file nor a built-in rig of that name; built in are dual_pressure, bench"
        );
        assert!(problem(&folder.with("empty.toml", b"")).contains("format"));
    }

    #[test]
    fn what_is_saved_is_what_is_loaded_and_unsound_rigs_are_not_saved() {
        let folder = Folder::new("save");
        let path = folder.0.join("out.toml");
        let mut rig = load("bench").unwrap();
        save(&path, &rig).unwrap();
        assert_eq!(load(path.to_str().unwrap()).unwrap(), rig);
        rig.volumes["positive"].volume_l = f64::NAN;
        let message = save(&path, &rig).unwrap_err().to_string();
        assert!(message.contains("volumes.positive.volume_l"), "{message}");
        assert_eq!(load(path.to_str().unwrap()).unwrap(), load("bench").unwrap(), "the old file is still whole");
    }

    #[test]
    fn a_fitted_rig_has_one_ending_and_its_description_whole_sentences() {
        let mut rig = Rig::builtin("dual_pressure").unwrap();
        rig.description = "Two chambers ".to_owned();
        rename_fitted(&mut rig, FitEnding::Fitted, "Parameters fitted from a.csv.");
        assert_eq!(rig.name, "dual_pressure_fitted");
        assert_eq!(rig.description, "Two chambers. Parameters fitted from a.csv.");
        rename_fitted(&mut rig, FitEnding::Identified, "Again.");
        assert_eq!(rig.name, "dual_pressure_identified");
        assert_eq!(rig.description, "Two chambers. Parameters fitted from a.csv. Again.");
        rig.description = String::new();
        rename_fitted(&mut rig, FitEnding::Extended, "From b.csv.");
        assert_eq!((rig.name.as_str(), rig.description.as_str()), ("dual_pressure_extended", "From b.csv."));
    }
}
