//! Messages to systemd: ready, alive, stopping (`sd_notify(3)`: a datagram to the socket that `NOTIFY_SOCKET` names).

use std::os::linux::net::SocketAddrExt;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};

/// The way to systemd, where this process is a service of `Type=notify`.
#[derive(Debug)]
pub struct Notifier {
    socket: Option<(UnixDatagram, SocketAddr)>,
}

impl Notifier {
    /// The socket that the environment names, if any.
    pub fn from_environment() -> Self {
        let name = std::env::var_os("NOTIFY_SOCKET");
        Notifier { socket: name.and_then(|name| connect(name.as_bytes()).ok()) }
    }

    /// True where somebody waits for word of this process.
    pub fn is_awaited() -> bool {
        Notifier::from_environment().socket.is_some()
    }

    /// A notifier for the socket of this name; one that begins with `@` is in the abstract name space.
    ///
    /// # Errors
    /// If the name is none.
    pub fn to(name: &[u8]) -> std::io::Result<Self> {
        connect(name).map(|socket| Notifier { socket: Some(socket) })
    }

    /// The service is up.
    pub fn ready(&self) {
        self.send(b"READY=1");
    }

    /// The tick went on.
    pub fn beat(&self) {
        self.send(b"WATCHDOG=1");
    }

    /// The service ends.
    pub fn stopping(&self) {
        self.send(b"STOPPING=1");
    }

    fn send(&self, state: &[u8]) {
        if let Some((socket, address)) = &self.socket {
            // Where nobody listens any more there is nobody to tell.
            let _ = socket.send_to_addr(state, address);
        }
    }
}

fn connect(name: &[u8]) -> std::io::Result<(UnixDatagram, SocketAddr)> {
    let address = match name.split_first() {
        Some((b'@', rest)) => SocketAddr::from_abstract_name(rest)?,
        _ => SocketAddr::from_pathname(std::ffi::OsStr::from_bytes(name))?,
    };
    let socket = UnixDatagram::unbound()?;
    // A full queue must not hold up the guard.
    socket.set_nonblocking(true)?;
    Ok((socket, address))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn datagrams_reach_a_socket_by_path_and_by_abstract_name() {
        let number = std::process::id();
        let path = std::env::temp_dir().join(format!("notify-{number}"));
        let _ = std::fs::remove_file(&path);
        let abstract_name = format!("notify-{number}");
        let by_name = SocketAddr::from_abstract_name(abstract_name.as_bytes()).unwrap();
        for (listener, name) in [
            (UnixDatagram::bind(&path).unwrap(), path.as_os_str().as_bytes().to_vec()),
            (UnixDatagram::bind_addr(&by_name).unwrap(), format!("@{abstract_name}").into_bytes()),
        ] {
            let notifier = Notifier::to(&name).unwrap();
            let mut heard = [0; 32];
            for (say, word) in [
                (Notifier::ready as fn(&Notifier), "READY=1"),
                (Notifier::beat, "WATCHDOG=1"),
                (Notifier::stopping, "STOPPING=1"),
            ] {
                say(&notifier);
                let length = listener.recv(&mut heard).unwrap();
                assert_eq!(std::str::from_utf8(&heard[..length]).unwrap(), word);
            }
        }
        let _ = std::fs::remove_file(&path);
    }
}
