//! Reading a file that has to be one: never a FIFO that waits for a writer, a device without an end, or a folder.
//!
//! Everything that a person or another program names by its path goes through here before it is parsed. What the path
//! leads to is looked at before it is opened (opening a device may act on it), opened without waiting, and looked at
//! again; at most a stated number of bytes is read, also of a file that grows meanwhile.
//!
//! Left out: a file system that does not answer. A caller for whom that matters reads on a thread of its own.

use std::fs::{FileType, Metadata, OpenOptions};
use std::io::{self, Read};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::Path;

use rustix::fs::OFlags;

/// Reads a regular file of at most `most_bytes`.
///
/// # Errors
/// Error of the system; `InvalidInput` with one plain clause for anything that is no regular file; `FileTooLarge` for one
/// that is larger.
pub fn read(path: &Path, most_bytes: u64) -> io::Result<Vec<u8>> {
    check(&std::fs::metadata(path)?, most_bytes)?;
    let file = without_waiting(OpenOptions::new().read(true)).open(path)?;
    let about = file.metadata()?;
    check(&about, most_bytes)?;
    let mut bytes = Vec::with_capacity(usize::try_from(about.len()).unwrap_or(0));
    file.take(most_bytes.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most_bytes { Err(too_large(most_bytes)) } else { Ok(bytes) }
}

/// Has a file opened without waiting: between a look at it and the open a FIFO may have taken its place.
pub fn without_waiting(options: &mut OpenOptions) -> &mut OpenOptions {
    options.custom_flags(OFlags::NONBLOCK.union(OFlags::NOCTTY).bits().cast_signed())
}

/// Reads a regular file of at most `most_bytes` as UTF-8 text.
///
/// # Errors
/// As [`read`]; `InvalidData` for bytes that are not UTF-8, with the line.
pub fn read_text(path: &Path, most_bytes: u64) -> io::Result<String> {
    String::from_utf8(read(path, most_bytes)?).map_err(|error| {
        let sound = error.as_bytes().get(..error.utf8_error().valid_up_to()).unwrap_or_default();
        let line = 1 + sound.iter().filter(|byte| **byte == b'\n').count();
        io::Error::new(io::ErrorKind::InvalidData, format!("line {line} is not UTF-8 text; save the file as UTF-8"))
    })
}

fn check(about: &Metadata, most_bytes: u64) -> io::Result<()> {
    if !about.is_file() {
        let kind = kind_name(about.file_type());
        return Err(io::Error::new(io::ErrorKind::InvalidInput, format!("it is {kind}, not a regular file")));
    }
    if about.len() > most_bytes { Err(too_large(most_bytes)) } else { Ok(()) }
}

fn too_large(most_bytes: u64) -> io::Error {
    let limit =
        if most_bytes >= 1 << 20 { format!("{} MiB", most_bytes >> 20) } else { format!("{} KiB", most_bytes >> 10) };
    io::Error::new(
        io::ErrorKind::FileTooLarge,
        format!("it holds more than {limit}, which is the most that is read here"),
    )
}

fn kind_name(kind: FileType) -> &'static str {
    if kind.is_dir() {
        "a folder"
    } else if kind.is_fifo() {
        "a named pipe"
    } else if kind.is_socket() {
        "a socket"
    } else {
        "a device"
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::{Duration, Instant};

    fn folder(name: &str) -> std::path::PathBuf {
        let path = std::env::temp_dir().join(format!("regular-file-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        path
    }

    #[test]
    fn what_is_no_file_is_refused_at_once() {
        let folder = folder("kinds");
        let fifo = folder.join("fifo");
        let made = std::process::Command::new("mkfifo").arg(&fifo).status().unwrap();
        assert!(made.success());
        let socket = folder.join("socket");
        let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
        let begun = Instant::now();
        for (path, word) in [
            (fifo.as_path(), "named pipe"),
            (Path::new("/dev/zero"), "device"),
            (folder.as_path(), "folder"),
            (socket.as_path(), "socket"),
        ] {
            let error = read(path, 1 << 20).unwrap_err();
            assert!(error.kind() == io::ErrorKind::InvalidInput && error.to_string().contains(word), "{error}");
        }
        // Nothing here waits; the bound is for a machine that is busy.
        assert!(begun.elapsed() < Duration::from_secs(5));
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn a_file_is_read_up_to_its_bound() {
        let folder = folder("bound");
        let path = folder.join("a.txt");
        std::fs::write(&path, "12345").unwrap();
        assert_eq!(read(&path, 5).unwrap(), b"12345");
        assert_eq!(read(&path, 4).unwrap_err().kind(), io::ErrorKind::FileTooLarge);
        assert_eq!(read_text(&path, 5).unwrap(), "12345");
        std::fs::write(&path, b"one\ntwo \xff").unwrap();
        let error = read_text(&path, 100).unwrap_err().to_string();
        assert!(error.contains("line 2"), "{error}");
        // Files below /proc say that they are empty and are not.
        assert!(!read(Path::new("/proc/self/status"), 1 << 20).unwrap().is_empty());
        std::fs::remove_dir_all(folder).unwrap();
    }
}
