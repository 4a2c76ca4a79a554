//! Files that are whole or not there: written aside, synced, renamed.
//!
//! The bytes go into a hidden file in the same folder, which is synced and then renamed over the
//! target; at last the folder is synced, so that the new name survives a power cut. A reader sees
//! the old file or the new one, never half of either, and a crash leaves at most a hidden file
//! behind. A process that a signal ends at once calls [`abandon`] before, and leaves none.
//!
//! A device, a pipe or a socket (`/dev/null`, `/dev/stdout`) is written to as it is: a rename would put a
//! file in its place, and it would be gone.
//!
//! Left out: keeping the old file's owner and mode (a rename gives the new file those of this
//! process), and following links to files (such a link is replaced, not what it points to).

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Reason for which a file could not be written.
#[derive(Debug, thiserror::Error)]
#[error("{}: cannot write the file: {step}: {source}", .path.display())]
pub struct AtomicFileError {
    /// The file that was to be written.
    pub path: PathBuf,
    /// The step that failed.
    pub step: AtomicFileStep,
    /// Error of the system.
    pub source: io::Error,
}

/// A step of writing a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum AtomicFileStep {
    /// The path names no file.
    #[error("the path names no file")]
    Name,
    /// Opening the file beside it.
    #[error("creating a file in that folder")]
    Create,
    /// Writing the bytes.
    #[error("writing")]
    Write,
    /// Bringing them to the disk.
    #[error("syncing to disk")]
    Sync,
    /// Giving the file its name.
    #[error("renaming")]
    Rename,
}

/// Writes a file so that it is there whole or not at all.
///
/// # Errors
/// The step that failed, with the path; the target is then what it was before, and nothing is left
/// beside it.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), AtomicFileError> {
    let fail = |step| move |source| AtomicFileError { path: path.to_owned(), step, source };
    if is_no_file(path) {
        return write_through(path, bytes).map_err(fail(AtomicFileStep::Write));
    }
    let aside = aside_path(path).map_err(fail(AtomicFileStep::Name))?;
    let written = begin(&aside).and_then(|file| write_aside(file, &aside, path, bytes));
    if written.is_err() {
        // The first error is the one to tell; a file that cannot be removed is only litter.
        let _ = std::fs::remove_file(&aside);
    }
    being_written().retain(|other| *other != aside);
    written.map_err(|(step, source)| fail(step)(source))
}

/// Creates a file aside, noted as being written from the first moment on.
fn begin(aside: &Path) -> Result<File, (AtomicFileStep, io::Error)> {
    let mut files = being_written();
    let file = OpenOptions::new().write(true).create_new(true).open(aside);
    if file.is_ok() {
        files.push(aside.to_owned());
    }
    file.map_err(|source| (AtomicFileStep::Create, source))
}

/// A hidden file for a moment, from which its maker makes another: written whole, and removed where this is dropped or the process is
/// [`abandon`]ed.
#[derive(Debug)]
pub struct HiddenFile {
    path: PathBuf,
}

impl HiddenFile {
    /// Writes it.
    ///
    /// # Errors
    /// As [`write()`].
    pub fn write(path: PathBuf, bytes: &[u8]) -> Result<Self, AtomicFileError> {
        being_written().push(path.clone());
        let this = HiddenFile { path };
        write(&this.path, bytes)?;
        Ok(this)
    }

    /// The path that it was given.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for HiddenFile {
    fn drop(&mut self) {
        // One that cannot be removed is only litter, and one that could not be written is not there.
        let _ = std::fs::remove_file(&self.path);
        being_written().retain(|other| *other != self.path);
    }
}

/// Removes what every thread is writing aside. No file begins and no writer returns after it, so the process must end right away.
pub fn abandon() {
    let files = being_written();
    // The last first: what is still being written into a hidden file goes before that file, and cannot take its name afterwards.
    for aside in files.iter().rev() {
        // One that has its name by now is whole.
        let _ = std::fs::remove_file(aside);
    }
    // Whoever wrote one waits here until the process is gone, instead of telling that it cannot be renamed.
    std::mem::forget(files);
}

/// Files that are being written aside by this process.
fn being_written() -> MutexGuard<'static, Vec<PathBuf>> {
    static FILES: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());
    FILES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Tells whether a path leads to something that is there and neither a file nor a folder: a device, a pipe, a socket.
pub fn is_no_file(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|about| !about.is_file() && !about.is_dir())
}

/// Writes into what is no file, which can be neither replaced nor synced.
fn write_through(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut target = OpenOptions::new().write(true).open(path)?;
    target.write_all(bytes)?;
    target.flush()
}

/// Renames a file that is already synced, and syncs the folder so that the name is kept.
///
/// # Errors
/// The file cannot be renamed, or the folder cannot be synced.
pub fn rename_synced(from: &Path, to: &Path) -> Result<(), AtomicFileError> {
    let fail = |step| move |source| AtomicFileError { path: to.to_owned(), step, source };
    std::fs::rename(from, to).map_err(fail(AtomicFileStep::Rename))?;
    sync_folder(to).map_err(fail(AtomicFileStep::Sync))
}

fn write_aside(mut file: File, aside: &Path, path: &Path, bytes: &[u8]) -> Result<(), (AtomicFileStep, io::Error)> {
    let step = |step| move |source| (step, source);
    file.write_all(bytes).map_err(step(AtomicFileStep::Write))?;
    file.sync_all().map_err(step(AtomicFileStep::Sync))?;
    drop(file);
    std::fs::rename(aside, path).map_err(step(AtomicFileStep::Rename))?;
    sync_folder(path).map_err(step(AtomicFileStep::Sync))
}

/// A name beside the target that no other process or thread uses.
pub(crate) fn aside_path(path: &Path) -> io::Result<PathBuf> {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let Some(name) = path.file_name() else {
        return Err(io::Error::from(io::ErrorKind::InvalidInput));
    };
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    let mut hidden = std::ffi::OsString::from(".");
    hidden.push(name);
    hidden.push(format!(".{}-{count}.tmp", std::process::id()));
    Ok(path.with_file_name(hidden))
}

fn sync_folder(path: &Path) -> io::Result<()> {
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    File::open(folder)?.sync_all()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("atomic-file-{}-{name}", std::process::id()));
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
    fn writes_and_replaces_and_leaves_nothing_beside() {
        let folder = folder("replace");
        let path = folder.join("a.csv");
        write(&path, b"first").unwrap();
        write(&path, b"second").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"second");
        assert_eq!(names(&folder), ["a.csv"]);
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn a_failed_rename_leaves_the_old_state_and_no_litter() {
        let folder = folder("rename");
        // A folder in the way: the rename fails after everything else went well.
        let path = folder.join("a.csv");
        std::fs::create_dir(&path).unwrap();
        let error = write(&path, b"x").unwrap_err();
        assert_eq!(error.step, AtomicFileStep::Rename);
        assert_eq!(names(&folder), ["a.csv"]);
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn errors_are_one_line_with_the_path() {
        let path = Path::new("/nonexistent-folder/out.csv");
        let message = write(path, b"x").unwrap_err().to_string();
        assert!(message.starts_with("/nonexistent-folder/out.csv: cannot write"), "{message}");
        assert!(!message.contains('\n'));
        let error = write(Path::new("/"), b"x").unwrap_err();
        assert_eq!(error.step, AtomicFileStep::Name);
    }

    #[test]
    fn what_is_no_file_is_written_to_and_stays_what_it_is() {
        let folder = folder("pipe");
        let pipe = folder.join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let reader = std::thread::spawn({
            let pipe = pipe.clone();
            move || std::fs::read(pipe).unwrap()
        });
        write(&pipe, b"through").unwrap();
        assert_eq!(reader.join().unwrap(), b"through");
        assert!(is_no_file(&pipe));
        // A link to a device as well: /dev/stdout is one.
        let link = folder.join("link");
        std::os::unix::fs::symlink("/dev/null", &link).unwrap();
        write(&link, b"gone").unwrap();
        assert!(link.is_symlink() && is_no_file(Path::new("/dev/null")));
        assert_eq!(names(&folder), ["link", "pipe"]);
        std::fs::remove_dir_all(folder).unwrap();
    }

    /// A second Ctrl-C comes while a thread writes: the process ends then and there, with what it wrote last or nothing, and no litter.
    #[test]
    fn a_process_that_ends_at_once_leaves_nothing_beside() {
        const FOLDER: &str = "FOLDER_OF_A_PROCESS_THAT_ENDS_AT_ONCE";
        if let Some(folder) = std::env::var_os(FOLDER) {
            // This is that process.
            let folder = Path::new(&folder).to_owned();
            let (path, hidden) = (folder.join("a.bin"), folder.join(".b.new"));
            std::thread::spawn({
                let path = path.clone();
                move || {
                    loop {
                        write(&path, &[1; 1 << 20]).unwrap();
                    }
                }
            });
            std::thread::spawn(move || {
                loop {
                    drop(HiddenFile::write(hidden.clone(), &[2; 1 << 16]).unwrap());
                }
            });
            while !path.exists() {
                std::thread::sleep(std::time::Duration::from_millis(1));
            }
            std::thread::sleep(std::time::Duration::from_millis(30));
            abandon();
            std::process::exit(0);
        }
        let folder = folder("ends");
        for _ in 0..8 {
            let mut process = std::process::Command::new(std::env::current_exe().unwrap());
            process.args(["--exact", "atomic_file::tests::a_process_that_ends_at_once_leaves_nothing_beside"]);
            assert!(process.env(FOLDER, &folder).output().unwrap().status.success());
            assert_eq!(names(&folder), ["a.bin"]);
        }
        assert_eq!(std::fs::read(folder.join("a.bin")).unwrap(), [1; 1 << 20]);
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn threads_that_write_one_file_leave_one_whole_version() {
        let folder = folder("threads");
        let path = folder.join("a.bin");
        let versions: Vec<Vec<u8>> = (0..4_u8).map(|fill| vec![fill; 100_000]).collect();
        std::thread::scope(|scope| {
            for version in &versions {
                scope.spawn(|| write(&path, version).unwrap());
            }
        });
        assert!(versions.contains(&std::fs::read(&path).unwrap()));
        assert_eq!(names(&folder), ["a.bin"]);
        std::fs::remove_dir_all(folder).unwrap();
    }
}
