//! Check that this machine has what a configuration names: a place for the socket, a folder for recordings, a CPU, and an
//! address for the cRIO's name.

use std::io::ErrorKind;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::thread::{CpuSet, sched_getaffinity};

use crate::config::{Config, Record};
use crate::machine::realtime::make_realtime;
use crate::machine::trial_file::{try_file, try_socket};
use crate::operator::socket::{SocketError, check_sockets};
use crate::session::link::LookUp;

/// Time that a name server has to answer. One that is reached answers within a fraction of a second; one that is not is given up
/// by the system after ten, for which nobody who checks a file should wait. Chosen.
const NAMED_WITHIN: Duration = Duration::from_secs(3);
/// Time between two looks whether it has.
const LOOK: Duration = Duration::from_millis(10);

/// Demand of a configuration that this machine cannot meet.
#[derive(Debug, thiserror::Error)]
pub enum MachineError {
    /// The socket cannot be made.
    #[error(transparent)]
    Socket(#[from] SocketError),
    /// A folder is missing or may not be written.
    #[error("{}: {key}: {problem}", .folder.display())]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// The key that names it.
        key: &'static str,
        /// Problem and fix.
        problem: String,
    },
    /// With `auto_arm`: too little room.
    #[error("{}: only {free_mib} MiB free, record.min_free_mib = {min_mib}; make room: with control.auto_arm nothing runs unrecorded", .folder.display())]
    NoRoom {
        /// The folder.
        folder: PathBuf,
        /// Free space (MiB).
        free_mib: u64,
        /// Space that is needed (MiB).
        min_mib: u64,
    },
    /// There is no such CPU.
    #[error("realtime.cpu = {cpu}: this program may use the CPUs {allowed}; choose one of them, or leave the key out")]
    Cpu {
        /// The CPU wanted.
        cpu: usize,
        /// Those allowed.
        allowed: String,
    },
}

/// Looks at everything; the remarks are what a person should know although it works.
///
/// # Errors
/// The first thing that would keep the daemon from starting.
pub fn check(config: &Config) -> Result<Vec<String>, MachineError> {
    let mut remarks = Vec::new();
    check_socket(&config.control.socket, &mut remarks)?;
    check_recordings(&config.record, config.control.auto_arm, &mut remarks)?;
    remarks.extend(unreadable_policies(&config.policy.directory));
    check_cpu(config)?;
    remarks.extend(unknown_name(&config.link.address));
    remarks.extend(refused_realtime(config));
    Ok(remarks)
}

fn check_socket(path: &Path, remarks: &mut Vec<String>) -> Result<(), MachineError> {
    let folder = parent(path);
    let wrong = |problem: &str| MachineError::Folder {
        folder: folder.clone(),
        key: "control.socket",
        problem: problem.to_owned(),
    };
    if !folder.is_dir() {
        return Err(wrong("there is no such folder; make it, or choose another path"));
    }
    if let Err(error) = try_socket(&folder) {
        return Err(wrong(&format!("this user can make no socket there ({error}); mend that, or choose another path")));
    }
    match check_sockets(path) {
        Ok(()) => Ok(()),
        Err(SocketError::InUse { path }) => {
            remarks.push(format!("a controller answers on {} already", path.display()));
            Ok(())
        }
        Err(error) => Err(error.into()),
    }
}

fn check_recordings(record: &Record, auto_arm: bool, remarks: &mut Vec<String>) -> Result<(), MachineError> {
    let folder = record.directory.clone();
    let wrong = |problem: String| MachineError::Folder { folder: folder.clone(), key: "record.directory", problem };
    // It is made when it is needed, below the first folder that is there.
    let mut there = PathBuf::from("/");
    for place in folder.ancestors().map(nearest) {
        if place.is_dir() {
            there = place;
            break;
        }
        match std::fs::symlink_metadata(&place) {
            Ok(_) => return Err(wrong(format!("{} is no folder; choose another", place.display()))),
            // Its own folder is looked at next.
            Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {}
            Err(error) => return Err(wrong(format!("it cannot be made: {error}; choose another"))),
        }
    }
    if let Err(error) = try_file(&there) {
        return Err(wrong(format!(
            "this user can make nothing in {} ({error}); mend that, or choose another",
            there.display()
        )));
    }
    if let Some(free) = flight::disk::free_bytes(&there)
        && free < record.min_free_mib << 20
    {
        let (free_mib, min_mib) = (free >> 20, record.min_free_mib);
        if auto_arm {
            return Err(MachineError::NoRoom { folder, free_mib, min_mib });
        }
        remarks.push(format!(
            "{}: only {free_mib} MiB free, record.min_free_mib = {min_mib}: it will not be armed before there is room",
            there.display()
        ));
    }
    Ok(())
}

/// Remark that no policy can be published, where the folder for them is none or may not be read. One that is not there yet is
/// no trouble.
fn unreadable_policies(folder: &Path) -> Option<String> {
    let error = std::fs::read_dir(nearest(folder)).err().filter(|error| error.kind() != ErrorKind::NotFound)?;
    Some(format!(
        "{}: policy.directory: no policy can be published there ({error}); fix that, or choose another folder",
        folder.display()
    ))
}

/// Remark that no address is known for the cRIO's name, which the daemon would go on asking for; `None` where it has one.
fn unknown_name(address: &str) -> Option<String> {
    if address.parse::<SocketAddr>().is_ok() {
        return None;
    }
    match LookUp::begin(address) {
        Ok(look_up) => not_found(address, look_up),
        Err(error) => Some(error.to_string()),
    }
}

/// Remark on a look-up that finds no address, or does not end in time.
fn not_found(address: &str, look_up: LookUp) -> Option<String> {
    let until = Instant::now() + NAMED_WITHIN;
    while !look_up.is_over() {
        if Instant::now() >= until {
            return Some(format!(
                "{address}: no name server has answered within {:.0} s; check link.address and this machine's network, or write the cRIO's address in numbers",
                NAMED_WITHIN.as_secs_f64()
            ));
        }
        std::thread::sleep(LOOK);
    }
    match look_up.addresses() {
        Ok(found) if found.is_empty() => Some(format!("{address}: the name has no address; check link.address")),
        Ok(_) => None,
        Err(error) => Some(error.to_string()),
    }
}

fn check_cpu(config: &Config) -> Result<(), MachineError> {
    let (Some(cpu), Ok(allowed)) = (config.realtime.cpu, sched_getaffinity(None)) else { return Ok(()) };
    if cpu < CpuSet::MAX_CPU && allowed.is_set(cpu) {
        return Ok(());
    }
    let names: Vec<String> = (0..CpuSet::MAX_CPU).filter(|n| allowed.is_set(*n)).map(|n| n.to_string()).collect();
    Err(MachineError::Cpu { cpu, allowed: names.join(", ") })
}

/// Rights that the machine refuses a thread that asks for what the tick needs; tried on a thread of its own.
fn refused_realtime(config: &Config) -> Vec<String> {
    std::thread::scope(|scope| scope.spawn(|| make_realtime(&config.realtime)).join()).unwrap_or_default()
}

fn parent(path: &Path) -> PathBuf {
    nearest(path.parent().unwrap_or(Path::new("")))
}

/// A path as it is; the current folder where it is empty.
fn nearest(path: &Path) -> PathBuf {
    if path.as_os_str().is_empty() { PathBuf::from(".") } else { path.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::session::link::LinkError;

    fn config(folder: &Path) -> Config {
        let mut config = Config::for_address("127.0.0.1:1");
        config.control.socket = folder.join("s");
        config.record.directory = folder.join("not/yet/there");
        config.record.min_free_mib = 16;
        config
    }

    #[test]
    fn what_the_machine_lacks_is_named_with_its_key() {
        let folder = std::env::temp_dir().join(format!("machine-check-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let sound = config(&folder);
        check(&sound).unwrap();
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 0, "looking leaves nothing behind");
        std::fs::write(folder.join("file"), "x").unwrap();
        std::fs::write(folder.join("fifo.live.sock"), "x").unwrap();
        std::os::unix::fs::symlink(folder.join("nothing"), folder.join("nowhere")).unwrap();
        // The longest name that leaves room for both sockets in this folder ends five bytes before the limit.
        let bytes = folder.as_os_str().len() + "/.sock".len();
        let mut longest = config(&folder);
        longest.control.socket = folder.join(format!("{}.sock", "x".repeat(102 - bytes)));
        assert_eq!(longest.control.socket.as_os_str().len(), 102);
        check(&longest).unwrap();
        let refused = |change: &dyn Fn(&mut Config)| {
            let mut config = config(&folder);
            change(&mut config);
            check(&config).unwrap_err().to_string()
        };
        for (said, words) in [
            (refused(&|c| c.control.socket = folder.join("x".repeat(120))), "107"),
            (refused(&|c| c.control.socket = folder.join("none/s")), "no such folder"),
            (refused(&|c| c.control.socket = folder.join("file")), "no socket"),
            (refused(&|c| c.control.socket = folder.join(format!("{}.sock", "x".repeat(103 - bytes)))), "107"),
            (refused(&|c| c.control.socket = folder.join("fifo.sock")), "fifo.live.sock: this is no socket"),
            (refused(&|c| c.record.directory = folder.join("file")), "record.directory"),
            (refused(&|c| c.record.directory = folder.join("file/below")), "is no folder"),
            (refused(&|c| c.record.directory = folder.join("nowhere/below")), "nowhere is no folder"),
            (refused(&|c| c.record.directory = folder.join("x".repeat(300))), "it cannot be made"),
            // Where nobody can make anything, the superuser neither.
            (refused(&|c| c.record.directory = "/proc/x".into()), "can make nothing in /proc "),
            (
                refused(&|c| c.control.socket = "/proc/y.sock".into()),
                "/proc: control.socket: this user can make no socket",
            ),
            (refused(&|c| c.realtime.cpu = Some(1000)), "realtime.cpu = 1000"),
            (
                refused(&|c| {
                    c.record.min_free_mib = 1 << 40;
                    c.control.auto_arm = true;
                }),
                "nothing runs unrecorded",
            ),
        ] {
            assert!(said.contains(words) && !said.contains('\n'), "`{words}` is not in: {said}");
        }
        let mut config = config(&folder);
        config.record.min_free_mib = 1 << 40;
        assert!(check(&config).unwrap().concat().contains("will not be armed"));
        config.policy.directory = folder.join("file");
        assert!(check(&config).unwrap().concat().contains("file: policy.directory: no policy can be published there"));
        config.policy.directory = folder.join("not yet there");
        assert!(!check(&config).unwrap().concat().contains("policy.directory"));
        std::fs::remove_dir_all(folder).unwrap();
    }

    /// Look-ups of which no name server of this machine knows.
    #[test]
    fn a_look_up_that_finds_no_address_is_told_with_what_to_do() {
        let address = "crio.example:50500";
        let said = |look_up: Result<LookUp, LinkError>| not_found(address, look_up.unwrap());
        let failed = said(LookUp::begin_by(address, || Err(std::io::Error::other("nobody knows it")))).unwrap();
        assert!(failed.contains(address) && failed.contains("nobody knows it"), "{failed}");
        let empty = said(LookUp::begin_by(address, || Ok(Vec::new()))).unwrap();
        assert!(empty.contains("the name has no address; check link.address"), "{empty}");
        // It ends with its sender, behind the assertion.
        let (sender, asked) = std::sync::mpsc::channel::<()>();
        let silent = said(LookUp::begin_by(address, move || {
            let _ = asked.recv();
            Ok(Vec::new())
        }));
        let silent = silent.unwrap();
        assert!(silent.contains("no name server has answered within 3 s; check link.address"), "{silent}");
        drop(sender);
        assert_eq!(said(LookUp::begin_by(address, || Ok(vec![([192, 0, 2, 1], 50_500).into()]))), None);
    }

    /// A name that every machine has, and addresses: nobody is asked on a network.
    #[test]
    fn a_name_with_an_address_is_no_remark() {
        let folder = std::env::temp_dir().join(format!("machine-check-name-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let remarks = |address: &str| {
            let mut config = config(&folder);
            config.link.address = address.to_owned();
            check(&config).unwrap().concat()
        };
        for known in ["localhost:50500", "127.0.0.1:50500", "[::1]:50500"] {
            assert!(!remarks(known).contains("link.address"), "{known}: {}", remarks(known));
        }
        std::fs::remove_dir_all(folder).unwrap();
    }
}
