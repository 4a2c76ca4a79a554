//! Tools of tests across programs: the programs themselves as children, folders that go away, waiting for lines.
//!
//! A child is killed when its handle is dropped, so a failed test leaves nothing running. Everything here fails by
//! panicking with what the child said so far: it is the test's own message.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

pub mod coarse_rigs;
pub mod counting_allocator;
pub mod dice;
pub mod fault_table;
pub mod hidden_plant;
pub mod in_process;
pub mod laboratory;
pub mod live_viewer;
pub mod lockstep;
pub mod oracle;
pub mod programme;
pub mod raw_crio;
pub mod scene;
pub mod strange_rigs;
pub mod task;
pub mod unhurried_daemon;
pub mod unknown_rig;

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime};

/// Time between two looks of a wait.
const LOOK: Duration = Duration::from_millis(5);

/// Lets one test at a time run: those in real time must not take each other's CPU.
pub fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The path of `controller` or `trainer`, built from the sources as they are now, in the test's own profile.
///
/// # Panics
/// If it cannot be built.
pub fn program(name: &str) -> PathBuf {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    let folder = BUILT.get_or_init(|| {
        let test = std::env::current_exe().expect("the test's own path");
        // target/<profile>/deps/<test>
        let folder = test.ancestors().nth(2).expect("a test lies in target/<profile>/deps").to_owned();
        let newest = newest_source(&root());
        let stale = |name: &str| {
            let built = std::fs::metadata(folder.join(name)).and_then(|m| m.modified());
            built.map_or(true, |built| built < newest)
        };
        if stale("controller") || stale("trainer") {
            build(&folder);
        }
        folder
    });
    folder.join(name)
}

/// The workspace's folder.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(1).expect("the workspace").to_owned()
}

/// The path of Python 3, or `None` after a line that says that the test is skipped.
pub fn python() -> Option<&'static str> {
    let found = Command::new("python3").arg("--version").stdout(Stdio::null()).status().is_ok_and(|s| s.success());
    if !found {
        println!("SKIPPED: no python3 here, so the independent cRIO cannot run");
    }
    found.then_some("python3")
}

/// A folder that goes away with its handle; what a test that failed had in it stays, and where is said.
#[derive(Debug)]
pub struct Folder(PathBuf);

impl Folder {
    /// A new, empty folder.
    ///
    /// # Panics
    /// If it cannot be made.
    pub fn new() -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        // Short: the path of a Unix socket holds at most 107 bytes.
        let path = std::env::temp_dir().join(format!("pneu-{}-{number}", std::process::id()));
        std::fs::create_dir_all(&path).expect("a temporary folder");
        Folder(path)
    }

    /// Path of an entry in it.
    pub fn join(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// Writes a file in it and answers its path.
    ///
    /// # Panics
    /// If it cannot be written.
    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.join(name);
        std::fs::write(&path, content).expect("a file in a temporary folder");
        path
    }

    /// Names of a subfolder's entries, sorted; empty if it is not there.
    pub fn names(&self, subfolder: &str) -> Vec<String> {
        let entries = std::fs::read_dir(self.join(subfolder)).into_iter().flatten().flatten();
        let mut names: Vec<String> = entries.map(|e| e.file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }
}

impl Default for Folder {
    fn default() -> Self {
        Folder::new()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        if std::thread::panicking() {
            eprintln!("left for a look: {}", self.0.display());
        } else {
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }
}

/// End of a child.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunStatus {
    /// Exit status; `None` if a signal ended it.
    pub status: Option<i32>,
    /// Everything on standard output.
    pub stdout: String,
    /// Everything on standard error.
    pub stderr: String,
}

/// Stream of a child.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stream {
    /// Standard output.
    Out,
    /// Standard error.
    Err,
}

/// A child whose output is collected while it runs.
pub struct Running {
    name: String,
    child: Child,
    said: [Arc<Mutex<String>>; 2],
    readers: Vec<JoinHandle<()>>,
}

impl Running {
    /// Starts it.
    ///
    /// # Panics
    /// If it cannot be started.
    pub fn start(command: &mut Command) -> Self {
        let name = format!("{command:?}");
        let mut child = command
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap_or_else(|e| panic!("{name}: {e}"));
        let said = [Arc::default(), Arc::default()];
        let out: Box<dyn Read + Send> = Box::new(child.stdout.take().expect("piped"));
        let err: Box<dyn Read + Send> = Box::new(child.stderr.take().expect("piped"));
        let readers = [out, err].into_iter().zip(&said).map(|(from, to)| collect(from, Arc::clone(to))).collect();
        Running { name, child, said, readers }
    }

    /// Output so far.
    pub fn said(&self, stream: Stream) -> String {
        self.said[stream as usize].lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Waits for a line that holds `text`.
    ///
    /// # Panics
    /// If it does not come in time.
    pub fn line(&self, stream: Stream, text: &str, within: Duration) -> String {
        self.lines(stream, text, 1, within)
    }

    /// Waits for the `count`-th line that holds `text`.
    ///
    /// # Panics
    /// If it does not come in time.
    pub fn lines(&self, stream: Stream, text: &str, count: usize, within: Duration) -> String {
        let until = Instant::now() + within;
        loop {
            let said = self.said(stream);
            let whole = said.rsplit_once('\n').map_or("", |(whole, _)| whole);
            if let Some(line) = whole.lines().filter(|line| line.contains(text)).nth(count - 1) {
                return line.to_owned();
            }
            assert!(Instant::now() < until, "{}: no `{text}` within {within:?}; {}", self.name, self.everything());
            std::thread::sleep(LOOK);
        }
    }

    /// Sends SIGTERM.
    ///
    /// # Panics
    /// If the shell's `kill` fails.
    pub fn terminate(&self) {
        self.signal("TERM");
    }

    /// The child's number.
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Sends a signal by its name: INT is what Ctrl-C sends.
    ///
    /// # Panics
    /// If the shell's `kill` fails.
    pub fn signal(&self, name: &str) {
        // The shell's own `kill`: no crate and no unsafe code for one signal.
        let kill = format!("kill -{name} {}", self.child.id());
        assert!(Command::new("sh").args(["-c", &kill]).status().expect("sh").success(), "{kill}");
    }

    /// Waits for its end.
    ///
    /// # Panics
    /// If it does not end in time.
    pub fn wait(mut self, within: Duration) -> RunStatus {
        let until = Instant::now() + within;
        let status = loop {
            if let Some(status) = self.child.try_wait().expect("a child can be waited for") {
                break status;
            }
            assert!(Instant::now() < until, "{}: still runs after {within:?}; {}", self.name, self.everything());
            std::thread::sleep(LOOK);
        };
        for reader in self.readers.drain(..) {
            let _ = reader.join();
        }
        RunStatus { status: status.code(), stdout: self.said(Stream::Out), stderr: self.said(Stream::Err) }
    }

    fn everything(&self) -> String {
        format!("stdout:\n{}\nstderr:\n{}", self.said(Stream::Out), self.said(Stream::Err))
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Runs a command to its end, which must come within a minute.
///
/// # Panics
/// If it cannot be started or does not end.
pub fn finish(command: &mut Command) -> RunStatus {
    Running::start(command).wait(Duration::from_secs(60))
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

fn build(folder: &Path) {
    // The whole workspace: with the packages alone their dependencies would have other features and be built anew.
    let mut cargo = Command::new(env!("CARGO"));
    cargo.current_dir(root()).args(["build", "--quiet", "--workspace", "--bins"]);
    if folder.file_name().is_some_and(|name| name == "release") {
        cargo.arg("--release");
    }
    cargo.arg("--target-dir").arg(folder.parent().expect("target/<profile>"));
    assert!(cargo.status().expect("cargo").success(), "controller and trainer cannot be built");
}

/// Time at which a source that the programs are made of last changed.
fn newest_source(workspace: &Path) -> SystemTime {
    ["Cargo.toml", "Cargo.lock", "model", "proto", "controller", "trainer"]
        .iter()
        .map(|name| newest_below(&workspace.join(name)))
        .max()
        .unwrap_or(SystemTime::UNIX_EPOCH)
}

fn newest_below(path: &Path) -> SystemTime {
    let Ok(about) = std::fs::metadata(path) else { return SystemTime::UNIX_EPOCH };
    if about.is_dir() {
        // Tests, benches and examples are no part of a program.
        let skip = ["tests", "benches", "examples", "target", "fuzz"];
        let entries = std::fs::read_dir(path).into_iter().flatten().flatten();
        let parts = entries.filter(|e| !skip.iter().any(|name| e.file_name() == *name));
        return parts.map(|e| newest_below(&e.path())).max().unwrap_or(SystemTime::UNIX_EPOCH);
    }
    let source = path.extension().is_some_and(|e| e == "rs" || e == "toml" || e == "lock");
    if source { about.modified().unwrap_or(SystemTime::UNIX_EPOCH) } else { SystemTime::UNIX_EPOCH }
}
