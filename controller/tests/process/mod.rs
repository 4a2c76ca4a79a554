//! The program as a child, with an emulated cRIO of the test's own, in a folder that goes away.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, dead_code, unreachable_pub)]

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use model::rig::Rig;
use proto::emulator::{Emulator, EmulatorConfig, EmulatorHandle, Pace, rig_and_crio};

/// Time between two looks of a wait.
const LOOK: Duration = Duration::from_millis(5);
/// Generous: how long anything may take on a machine that does other things as well.
pub const SOON: Duration = Duration::from_secs(60);

/// Lets one test at a time run: they start whole programs.
pub fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// An emulated cRIO in lockstep with the paper's rig behind it.
pub fn emulated_crio() -> EmulatorHandle {
    let (behind, crio) = rig_and_crio(&Rig::builtin("dual_pressure").unwrap()).unwrap();
    let config = EmulatorConfig { crio, pace: Pace::LOCKSTEP, ..EmulatorConfig::default() };
    Emulator::bind("127.0.0.1:0", config, Box::new(behind)).and_then(Emulator::start).unwrap()
}

/// The program with arguments.
pub fn controller(arguments: &[&str], file: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_controller"));
    command.args(arguments).arg(file);
    command
}

/// A command that runs the program named behind it without real-time rights; `None` after a line that says that the test is
/// skipped.
pub fn without_real_time_rights() -> Option<Command> {
    // Any user may give up limits, but the superuser's capabilities stand above them.
    if rustix::process::getuid().is_root() {
        return with_small_limits_and("-all");
    }
    let mut command = tool("prlimit")?;
    command.args(SMALL_LIMITS);
    Some(command)
}

/// A command of the superuser that runs the program named behind it with these capabilities (as `setpriv` takes them), without
/// priority, and with limits that are too small; `None` after a line that says that the test is skipped.
pub fn with_small_limits_and(capabilities: &str) -> Option<Command> {
    if !rustix::process::getuid().is_root() {
        println!("SKIPPED: only the superuser gives up some capabilities and keeps others");
        return None;
    }
    let mut command = tool("setpriv")?;
    command.arg(format!("--bounding-set={capabilities}")).args(["--inh-caps=-all", "--no-new-privs", "prlimit"]);
    command.args(SMALL_LIMITS);
    Some(command)
}

const SMALL_LIMITS: [&str; 2] = ["--rtprio=0:0", "--memlock=65536:65536"];

fn tool(name: &str) -> Option<Command> {
    let is_there =
        Command::new(name).arg("--version").stdout(Stdio::null()).status().is_ok_and(|status| status.success());
    if !is_there {
        println!("SKIPPED: no {name} here, which takes rights away");
    }
    is_there.then(|| Command::new(name))
}

/// A folder that goes away with its handle.
pub struct Folder(PathBuf);

impl Folder {
    pub fn new() -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        // Short: the path of a Unix socket holds at most 107 bytes.
        let path = std::env::temp_dir().join(format!("ctl-{}-{number}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Folder(path)
    }

    pub fn join(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        std::fs::write(self.join(name), content).unwrap();
        self.join(name)
    }

    /// Names in a subfolder, sorted; empty if it is not there.
    pub fn names(&self, subfolder: &str) -> Vec<String> {
        let entries = std::fs::read_dir(self.join(subfolder)).into_iter().flatten().flatten();
        let mut names: Vec<String> = entries.map(|e| e.file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// End of a child.
#[derive(Debug)]
pub struct Ended {
    pub status: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

/// A child whose output is collected while it runs; killed when dropped.
pub struct Running {
    child: Child,
    said: [Arc<Mutex<String>>; 2],
    readers: Vec<JoinHandle<()>>,
}

impl Running {
    pub fn start(command: &mut Command) -> Self {
        let mut child = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let said: [Arc<Mutex<String>>; 2] = [Arc::default(), Arc::default()];
        let out: Box<dyn Read + Send> = Box::new(child.stdout.take().unwrap());
        let err: Box<dyn Read + Send> = Box::new(child.stderr.take().unwrap());
        let readers = [out, err].into_iter().zip(&said).map(|(from, to)| collect(from, Arc::clone(to))).collect();
        Running { child, said, readers }
    }

    fn said(&self, stream: usize) -> String {
        self.said[stream].lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub fn stderr(&self) -> String {
        self.said(1)
    }

    /// Waits for a line on standard error that holds `text`.
    pub fn line(&self, text: &str) -> String {
        let until = Instant::now() + SOON;
        loop {
            let said = self.stderr();
            let whole = said.rsplit_once('\n').map_or("", |(whole, _)| whole);
            if let Some(line) = whole.lines().find(|line| line.contains(text)) {
                return line.to_owned();
            }
            assert!(Instant::now() < until, "no `{text}` in {said}");
            std::thread::sleep(LOOK);
        }
    }

    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    pub fn signal(&self, name: &str) {
        let kill = format!("kill -{name} {}", self.child.id());
        assert!(Command::new("sh").args(["-c", &kill]).status().unwrap().success(), "{kill}");
    }

    /// Waits for its end.
    pub fn wait(mut self) -> Ended {
        let until = Instant::now() + SOON;
        let status = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status;
            }
            assert!(Instant::now() < until, "still runs; {}", self.stderr());
            std::thread::sleep(LOOK);
        };
        for reader in self.readers.drain(..) {
            let _ = reader.join();
        }
        Ended { status: status.code(), stdout: self.said(0), stderr: self.said(1) }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Runs a command to its end.
pub fn finish(command: &mut Command) -> Ended {
    Running::start(command).wait()
}

fn collect(from: Box<dyn Read + Send>, to: Arc<Mutex<String>>) -> JoinHandle<()> {
    std::thread::spawn(move || {
        let (mut from, mut line) = (BufReader::new(from), Vec::new());
        while from.read_until(b'\n', &mut line).is_ok_and(|n| n > 0) {
            to.lock().unwrap_or_else(PoisonError::into_inner).push_str(&String::from_utf8_lossy(&line));
            line.clear();
        }
    })
}
