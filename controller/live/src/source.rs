//! The daemon's stream: connected, read, and connected again when it ends.

use std::io::Read;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use proto::stream::StreamReader;

use crate::hub::Hub;

/// Key, among the facts of a run, of what keeps the daemon from recording; empty while nothing does.
pub const RECORDING_PROBLEM: &str = "recording_problem";
/// Time between two attempts to connect.
const PAUSE: Duration = Duration::from_millis(500);
/// Longest time that a read waits before it looks whether to stop.
const LOOK: Duration = Duration::from_millis(500);

/// Reads the daemon's stream into the hub until told to stop. A daemon that is not there yet, or ends, is waited for; `tell` is given
/// a line whenever that changes.
pub fn follow(socket: &Path, hub: &Arc<Hub>, stop: &AtomicBool, tell: impl Fn(&str)) {
    let mut told = String::new();
    while !stop.load(Ordering::Relaxed) {
        let ended = match UnixStream::connect(socket) {
            Ok(stream) => {
                hub.link(Ok(()));
                tell(&format!("{}: the daemon answers", socket.display()));
                read(stream, hub, stop)
            }
            Err(error) => format!("{}: no daemon answers there ({error}); waiting for it", socket.display()),
        };
        if told != ended && !stop.load(Ordering::Relaxed) {
            tell(&ended);
            told.clone_from(&ended);
        }
        hub.link(Err(ended));
        std::thread::sleep(PAUSE);
    }
}

/// Reads until the stream ends, and says how.
fn read(mut stream: UnixStream, hub: &Hub, stop: &AtomicBool) -> String {
    if let Err(error) = stream.set_read_timeout(Some(LOOK)) {
        return error.to_string();
    }
    let (mut reader, mut bytes) = (StreamReader::default(), vec![0; 64 * 1024]);
    while !stop.load(Ordering::Relaxed) {
        match stream.read(&mut bytes) {
            Ok(0) => return "the daemon ended; waiting for it".to_owned(),
            Ok(read) => reader.push(bytes.get(..read).unwrap_or_default()),
            Err(error) if [std::io::ErrorKind::WouldBlock, std::io::ErrorKind::TimedOut].contains(&error.kind()) => {}
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
            Err(error) => return error.to_string(),
        }
        loop {
            match reader.next() {
                Ok(Some(message)) => hub.take(message),
                Ok(None) => break,
                Err(error) => return error.to_string(),
            }
        }
    }
    "stopped".to_owned()
}

/// Place where the daemon's stream is: beside its operator socket, `controller.sock` and `controller.live.sock`.
pub fn live_socket(control_socket: &Path) -> PathBuf {
    control_socket.with_extension("live.sock")
}
