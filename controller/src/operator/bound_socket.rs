//! The operators' socket as a file: made where nobody else is, made again where it was taken away, removed at the end.

use std::io;
use std::os::fd::AsFd;
use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::operator::operator_protocol::{MOST_PATH_BYTES, SocketError, connect};

/// Between two looks whether the file is still there.
const LOOK: Duration = Duration::from_secs(1);

/// A socket that is listened on, and its file.
pub(crate) struct BoundSocket {
    listener: UnixListener,
    /// The one before, until whoever had come to it is served.
    before: Option<UnixListener>,
    path: PathBuf,
    /// Device and number of the socket's file: another daemon's socket is not ours to remove.
    file: Option<(u64, u64)>,
    looked: Instant,
    is_told: bool,
}

impl BoundSocket {
    /// Makes the socket, for owner and group only: whoever may write here may vent the rig or start it.
    ///
    /// # Errors
    /// If it cannot be made, another daemon answers on it, or something that is no socket has its name.
    pub(crate) fn bind(path: &Path) -> Result<Self, SocketError> {
        let make = |source| SocketError::Make { path: path.to_owned(), source };
        check_free(path)?;
        if identity(path).is_some() {
            // A socket that nobody answers on: what a daemon that was killed left behind.
            std::fs::remove_file(path).map_err(make)?;
        }
        let listener = UnixListener::bind(path).map_err(make)?;
        std::fs::set_permissions(path, PermissionsExt::from_mode(0o660)).map_err(make)?;
        listener.set_nonblocking(true).map_err(make)?;
        let file = identity(path);
        let (before, looked) = (None, Instant::now());
        Ok(BoundSocket { listener, before, path: path.to_owned(), file, looked, is_told: false })
    }

    /// Takes a client that has come.
    ///
    /// # Errors
    /// The system's, `WouldBlock` where nobody has.
    pub(crate) fn accept(&mut self) -> io::Result<UnixStream> {
        if let Some(before) = &self.before {
            match before.accept() {
                Ok((stream, _)) => return Ok(stream),
                Err(_) => self.before = None,
            }
        }
        Ok(self.listener.accept()?.0)
    }

    /// Makes the socket again where its file was taken away, so that a disarming always finds it; answers a line for a person.
    pub(crate) fn look_after(&mut self) -> Option<String> {
        if self.looked.elapsed() < LOOK {
            return None;
        }
        self.looked = Instant::now();
        if self.file.is_some() && identity(&self.path) == self.file {
            self.is_told = false;
            return None;
        }
        let path = self.path.display();
        match Self::bind(&self.path) {
            Ok(again) => {
                let line = format!("{path}: the operators' socket was taken away; it is made again");
                let old = std::mem::replace(self, again);
                self.before = Some(old.listener);
                Some(line)
            }
            Err(_) if self.is_told => None,
            Err(error) => {
                self.is_told = true;
                Some(format!(
                    "the operators' socket was taken away, and no operator reaches this daemon until it can be made again: {error}; SIGTERM vents and ends it"
                ))
            }
        }
    }

    /// Removes the file, if it is still this socket's.
    pub(crate) fn remove(&self) {
        if self.file.is_some() && self.file == identity(&self.path) {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

impl AsFd for BoundSocket {
    fn as_fd(&self) -> std::os::fd::BorrowedFd<'_> {
        self.listener.as_fd()
    }
}

fn identity(path: &Path) -> Option<(u64, u64)> {
    std::fs::symlink_metadata(path).ok().filter(|about| about.file_type().is_socket()).map(|a| (a.dev(), a.ino()))
}

/// Refuses a place for the operators' socket where a daemon cannot have both its sockets, this one and the live viewers'
/// beside it: a path that is too long, another daemon, something that is no socket. Changes nothing.
///
/// # Errors
/// The first that cannot be used.
pub fn check_sockets(control: &Path) -> Result<(), SocketError> {
    let live = live::source::live_socket(control);
    if [control, &live].iter().any(|path| path.as_os_str().len() > MOST_PATH_BYTES) {
        return Err(SocketError::LongPath { path: control.to_owned(), live });
    }
    check_free(control)?;
    check_free(&live)
}

/// Refuses a path that another daemon answers on, or that is no socket; changes nothing.
///
/// # Errors
/// If it cannot be used.
fn check_free(path: &Path) -> Result<(), SocketError> {
    let Ok(about) = std::fs::symlink_metadata(path) else { return Ok(()) };
    if !about.file_type().is_socket() {
        return Err(SocketError::NotASocket { path: path.to_owned() });
    }
    match connect(path) {
        Ok(_) => Err(SocketError::InUse { path: path.to_owned() }),
        // Its queue of connections is full, so somebody is there.
        Err(error) if error.kind() == io::ErrorKind::WouldBlock => Err(SocketError::InUse { path: path.to_owned() }),
        Err(_) => Ok(()),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// The next look, without waiting for it.
    fn look(socket: &mut BoundSocket) -> Option<String> {
        socket.looked -= LOOK;
        socket.look_after()
    }

    #[test]
    fn what_is_taken_away_is_made_again_and_what_is_not_its_own_is_left_alone() {
        let folder = std::env::temp_dir().join(format!("bound-socket-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join("s");
        let mut socket = BoundSocket::bind(&path).unwrap();
        assert_eq!(look(&mut socket), None);
        // Whoever came before it was taken away is served as well.
        let _early = UnixStream::connect(&path).unwrap();
        std::fs::remove_file(&path).unwrap();
        assert!(look(&mut socket).unwrap().contains("made again"));
        let _late = UnixStream::connect(&path).unwrap();
        assert!(socket.accept().is_ok() && socket.accept().is_ok() && socket.accept().is_err());
        assert_eq!(look(&mut socket), None);

        std::fs::remove_file(&path).unwrap();
        std::fs::write(&path, "mine").unwrap();
        assert!(look(&mut socket).unwrap().contains("no operator reaches"));
        assert_eq!(look(&mut socket), None, "told once");
        socket.remove();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "mine");
        std::fs::remove_file(&path).unwrap();
        assert!(look(&mut socket).unwrap().contains("made again"));
        socket.remove();
        assert!(!path.exists());
        std::fs::remove_dir_all(folder).unwrap();
    }
}
