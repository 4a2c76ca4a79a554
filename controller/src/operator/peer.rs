//! Identity of who asks: the credentials that the kernel gives of the other end of a Unix socket.

use std::fmt;
use std::os::unix::net::UnixStream;
use std::path::Path;

use proto::regular_file;
use rustix::net::sockopt::socket_peercred;

/// The largest list of users or groups that is looked through, in bytes.
const MOST_BYTES: u64 = 4 << 20;

/// The other end of a connection, as the kernel noted it when it connected; a client cannot make it up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Peer {
    /// User and process; `None` if the kernel does not tell.
    identity: Option<(u32, i32)>,
}

impl Peer {
    /// The other end of `stream`.
    pub fn of(stream: &UnixStream) -> Self {
        let credentials = socket_peercred(stream).ok();
        Peer { identity: credentials.map(|c| (c.uid.as_raw(), c.pid.as_raw_nonzero().get())) }
    }
}

/// `alice (uid 1000, pid 4711)`; reads the list of users, so it is not for the tick.
impl fmt::Display for Peer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some((uid, pid)) = self.identity else { return f.write_str("somebody unknown") };
        match user_name(uid) {
            Some(name) => write!(f, "{name} (uid {uid}, pid {pid})"),
            None => write!(f, "uid {uid} (pid {pid})"),
        }
    }
}

/// The user's name where it stands in the list of local users.
pub(crate) fn user_name(uid: u32) -> Option<String> {
    let text = regular_file::read_text(Path::new("/etc/passwd"), MOST_BYTES).ok()?;
    name_of(&text, uid)
}

/// The group's name where it stands in the list of local groups.
pub(crate) fn group_name(gid: u32) -> Option<String> {
    let text = regular_file::read_text(Path::new("/etc/group"), MOST_BYTES).ok()?;
    name_of(&text, gid)
}

/// The name to a number, in lines of a name, a password and the number.
fn name_of(list: &str, wanted: u32) -> Option<String> {
    list.lines().find_map(|line| {
        let mut fields = line.split(':');
        let (name, number) = (fields.next()?, fields.nth(1)?);
        (number.parse() == Ok(wanted)).then(|| name.to_owned())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn users_have_names() {
        let passwd = "root:x:0:0:root:/root:/bin/sh\nbroken line\nalice:x:1000:1000::/home/alice:/bin/sh\n";
        assert_eq!(name_of(passwd, 1000).as_deref(), Some("alice"));
        assert_eq!(name_of(passwd, 7), None);
    }

    #[test]
    fn the_kernel_tells_who_is_at_the_other_end() {
        let (one, _other) = UnixStream::pair().unwrap();
        let text = Peer::of(&one).to_string();
        assert!(text.contains(&format!("pid {}", std::process::id())), "{text}");
    }
}
