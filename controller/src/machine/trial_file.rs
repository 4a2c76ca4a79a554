//! Proof that something can be made in a folder: it is made there and removed again.
//!
//! Rights alone prove nothing: the superuser has them everywhere, and still nothing can be made in `/proc` or on a disk that is
//! mounted read-only.

use std::io;
use std::path::{Path, PathBuf};

use rustix::fs::{CWD, FileType, Mode, mknodat};

use crate::machine::clock::now_ns;

/// Makes a file in a folder and removes it again.
///
/// # Errors
/// The system's: no file can be made there.
pub(crate) fn try_file(folder: &Path) -> io::Result<()> {
    let trial = name_in(folder);
    std::fs::OpenOptions::new().write(true).create_new(true).open(&trial)?;
    std::fs::remove_file(&trial)
}

/// Makes a socket's file in a folder, without anybody behind it, and removes it again. Its name may be longer than a socket's
/// address holds.
///
/// # Errors
/// The system's: no socket can be made there.
pub(crate) fn try_socket(folder: &Path) -> io::Result<()> {
    let trial = name_in(folder);
    mknodat(CWD, trial.as_path(), FileType::Socket, Mode::RUSR | Mode::WUSR, 0)?;
    std::fs::remove_file(&trial)
}

/// A name that nobody else uses, and that nobody has left behind either.
fn name_in(folder: &Path) -> PathBuf {
    folder.join(format!(".controller-trial-{}-{}", std::process::id(), now_ns()))
}
