//! Places for results: refused before the work where they cannot be written, replaced as a whole or left as a whole.
//!
//! A search of minutes must not end at a folder that nobody may write. [`check_folder`] and [`check_file`] put a probe of the
//! size that will be needed beside the place and take it away again: that tells a missing right, a read-only disk, a full one and
//! a quota in one go, which looking at modes does not.
//!
//! [`replace`] writes the files of one answer into a folder: first all of them aside, synced; then the marker of the old answer
//! goes, then the old files that the new answer has not, then the new ones get their names, the marker last. Whoever stops it
//! while it writes leaves the old answer as it was; between the first and the last name lie some renames, and a folder
//! without its marker holds no answer.

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::{Component, Path, PathBuf};

use crate::atomic_file::{self, AtomicFileError};

/// Why results cannot go to a place.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// A folder is asked for, and something else is there.
    #[error("{}: this is a file, and results need a folder; give --out another name", .0.display())]
    NoFolder(PathBuf),
    /// A file is asked for, and a folder is there.
    #[error("{}: this is a folder, and the result is one file; give --out the name of a file", .0.display())]
    NoFile(PathBuf),
    /// The folder of a file is not there.
    #[error("{}: the folder {} is not there; make it, or give --out another place", .file.display(), .folder.display())]
    NoSuchFolder {
        /// The file that was asked for.
        file: PathBuf,
        /// The folder that it would stand in.
        folder: PathBuf,
    },
    /// It cannot be written.
    #[error("{}: nothing can be written here: {source}; give --out another place, or make room", .path.display())]
    Unwritable {
        /// The place that was asked for.
        path: PathBuf,
        /// Error of the system.
        source: io::Error,
    },
    /// A file of the results cannot be written.
    #[error(transparent)]
    Write(#[from] AtomicFileError),
    /// An older file cannot be taken away.
    #[error("{}: an older result cannot be removed: {source}", .path.display())]
    Remove {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        source: io::Error,
    },
}

/// Checks that a folder can hold `bytes` of results, and makes none.
///
/// # Errors
/// It is no folder, or nothing can be written there.
pub fn check_folder(folder: &Path, bytes: u64) -> Result<(), OutputError> {
    if folder.exists() && !folder.is_dir() {
        return Err(OutputError::NoFolder(folder.to_owned()));
    }
    probe(folder, folder, bytes)
}

/// Checks that a file of `bytes` can be written, and writes none.
///
/// # Errors
/// It is a folder, its folder is not there, or nothing can be written there.
pub fn check_file(file: &Path, bytes: u64) -> Result<(), OutputError> {
    if file.is_dir() || file.file_name().is_none() {
        return Err(OutputError::NoFile(file.to_owned()));
    }
    if atomic_file::is_no_file(file) {
        // A probe would go into it, or beside it where there is no disk. That it may be written is all there is to ask.
        let writable = rustix::fs::access(file, rustix::fs::Access::WRITE_OK);
        return writable.map_err(|source| OutputError::Unwritable { path: file.to_owned(), source: source.into() });
    }
    let folder = file.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !folder.exists() {
        return Err(OutputError::NoSuchFolder { file: file.to_owned(), folder: folder.to_owned() });
    }
    // It is written under a longer name first.
    let aside = atomic_file::aside_path(file).unwrap_or_default();
    takes_name(&aside).map_err(|source| OutputError::Unwritable { path: file.to_owned(), source })?;
    probe(file, folder, bytes)
}

/// Tells whether two paths lead to one file that is there, by whatever links.
pub fn same_file(one: &Path, other: &Path) -> bool {
    match (one.canonicalize(), other.canonicalize()) {
        (Ok(one), Ok(other)) => one == other,
        _ => false,
    }
}

/// Writes `bytes` beside where `asked` is to be, in the nearest folder above that is there, and removes them.
fn probe(asked: &Path, folder: &Path, bytes: u64) -> Result<(), OutputError> {
    let there = folder.ancestors().find(|above| above.exists()).unwrap_or(Path::new("."));
    // The empty path above a relative one is the folder we are in.
    let there = if there.as_os_str().is_empty() { Path::new(".") } else { there };
    let unwritable = |source| OutputError::Unwritable { path: asked.to_owned(), source };
    if !there.is_dir() {
        return Err(unwritable(io::Error::from(io::ErrorKind::NotADirectory)));
    }
    let names = asked.components().filter_map(|component| match component {
        Component::Normal(name) => Some(there.join(name)),
        _ => None,
    });
    for name in names.chain([asked.to_owned()]) {
        takes_name(&name).map_err(unwritable)?;
    }
    let aside = there.join(format!(".probe-{}.tmp", std::process::id()));
    let written = fill(&aside, bytes);
    // A probe that cannot be removed is only litter, and the first error is the one to tell.
    let _ = std::fs::remove_file(&aside);
    written.map_err(unwritable)
}

/// Refuses a path that is too long for its disk, or a name in it, whether or not anything is there.
fn takes_name(path: &Path) -> io::Result<()> {
    match path.symlink_metadata() {
        Err(error) if error.kind() == io::ErrorKind::InvalidFilename => Err(error),
        _ => Ok(()),
    }
}

fn fill(path: &Path, bytes: u64) -> io::Result<()> {
    static CHUNK: [u8; 1 << 16] = [0; 1 << 16];
    let mut file = OpenOptions::new().write(true).create(true).truncate(true).open(path)?;
    let mut left = bytes;
    while left > 0 {
        let now = left.min(CHUNK.len() as u64) as usize;
        file.write_all(CHUNK.get(..now).unwrap_or(&CHUNK))?;
        left -= now as u64;
    }
    file.flush()
}

/// A file of an answer: its name, and what is in it; `None` where the answer has none and an older one must go.
pub type OutputFile<'a> = (&'a str, Option<&'a [u8]>);

/// Replaces the files of an older answer in `folder`, which is made if need be. The last of `files` is the marker: where it is, the
/// answer is whole.
///
/// # Errors
/// A file cannot be written (the older answer is then as it was) or an older one not be removed.
pub fn replace(folder: &Path, files: &[OutputFile<'_>]) -> Result<(), OutputError> {
    std::fs::create_dir_all(folder).map_err(|source| OutputError::Unwritable { path: folder.to_owned(), source })?;
    let aside = |name: &str| folder.join(format!(".{name}.{}.new", std::process::id()));
    let staged = stage(files, aside);
    if let Err(error) = staged {
        for (name, _) in files {
            let _ = std::fs::remove_file(aside(name));
        }
        return Err(error);
    }
    if let Some((marker, _)) = files.last() {
        remove(&folder.join(marker))?;
    }
    for (name, _) in files.iter().filter(|(_, text)| text.is_none()) {
        remove(&folder.join(name))?;
    }
    // The folder is synced with each name; that the old marker is gone before is synced here.
    File::open(folder)
        .and_then(|folder| folder.sync_all())
        .map_err(|source| OutputError::Unwritable { path: folder.to_owned(), source })?;
    for (name, _) in files.iter().filter(|(_, text)| text.is_some()) {
        atomic_file::rename_synced(&aside(name), &folder.join(name))?;
    }
    Ok(())
}

fn stage(files: &[OutputFile<'_>], aside: impl Fn(&str) -> PathBuf) -> Result<(), OutputError> {
    for (name, text) in files {
        if let Some(text) = text {
            atomic_file::write(&aside(name), text)?;
        }
    }
    Ok(())
}

fn remove(path: &Path) -> Result<(), OutputError> {
    match std::fs::remove_file(path) {
        Err(source) if source.kind() != io::ErrorKind::NotFound => {
            Err(OutputError::Remove { path: path.to_owned(), source })
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("output-{}-{name}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(&folder).unwrap();
        folder
    }

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).unwrap();
        let mut names: Vec<String> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_place_is_checked_and_left_as_it_was() {
        let folder = folder("checked");
        check_folder(&folder, 100_000).unwrap();
        check_folder(&folder.join("not/yet/there"), 100_000).unwrap();
        check_file(&folder.join("rig.toml"), 100_000).unwrap();
        assert!(names(&folder).is_empty());
        std::fs::write(folder.join("file"), "x").unwrap();
        assert!(matches!(check_folder(&folder.join("file"), 1), Err(OutputError::NoFolder(_))));
        assert!(matches!(check_folder(&folder.join("file/below"), 1), Err(OutputError::Unwritable { .. })));
        assert!(matches!(check_file(&folder, 1), Err(OutputError::NoFile(_))));
        let nowhere = folder.join("not/there.csv");
        assert!(matches!(check_file(&nowhere, 1), Err(OutputError::NoSuchFolder { .. })));
        check_file(Path::new("/dev/null"), 1 << 40).unwrap();
        std::fs::remove_dir_all(&folder).unwrap();
    }

    /// A probe beside the place has a short name: that of the place itself was found too long by the writing, behind the work.
    #[test]
    fn names_that_are_too_long_are_told_before_the_work() {
        let folder = folder("long-names");
        // 255 bytes are the most on the disks of today.
        let long = "x".repeat(300);
        for place in [folder.join(&long), folder.join("not/yet").join(&long).join("there")] {
            assert!(matches!(check_folder(&place, 1), Err(OutputError::Unwritable { .. })), "{}", place.display());
        }
        check_folder(&folder.join("x".repeat(250)), 1).unwrap();
        // The name under which a file is written first is longer than its own.
        for (length, fits) in [(300, false), (250, false), (200, true)] {
            let file = folder.join("x".repeat(length));
            assert_eq!(check_file(&file, 1).is_ok(), fits, "{length}");
            assert_eq!(atomic_file::write(&file, b"x").is_ok(), fits, "{length}");
        }
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn a_full_disk_is_told_before_the_work() {
        // A device that is always full; a folder of that kind needs rights that a test has not.
        let full = Path::new("/dev/full");
        if full.exists() {
            assert!(fill(full, 1 << 16).is_err());
        }
    }

    #[test]
    fn an_older_answer_goes_as_a_whole() {
        let folder = folder("replaced");
        replace(&folder, &[("rig.toml", Some(b"old")), ("next.csv", Some(b"old")), ("answer.json", Some(b"old"))])
            .unwrap();
        std::fs::write(folder.join("run.csv"), "the user's own").unwrap();
        replace(&folder, &[("rig.toml", Some(b"new")), ("next.csv", None), ("answer.json", Some(b"new"))]).unwrap();
        assert_eq!(names(&folder), ["answer.json", "rig.toml", "run.csv"]);
        assert_eq!(std::fs::read(folder.join("rig.toml")).unwrap(), b"new");
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn what_cannot_be_written_leaves_the_older_answer_as_it_was() {
        let folder = folder("kept");
        replace(&folder, &[("rig.toml", Some(b"old")), ("next.csv", Some(b"old")), ("answer.json", Some(b"old"))])
            .unwrap();
        // A name below a file cannot be written.
        let failed = replace(&folder, &[("rig.toml", Some(b"new")), ("next.csv", None), ("rig.toml/x", Some(b"new"))]);
        assert!(failed.is_err());
        assert_eq!(names(&folder), ["answer.json", "next.csv", "rig.toml"]);
        assert_eq!(std::fs::read(folder.join("rig.toml")).unwrap(), b"old");
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
