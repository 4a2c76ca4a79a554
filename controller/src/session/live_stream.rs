//! The stream that live viewers read: the daemon's ticks, events and state over a Unix socket, one way, off the tick.
//!
//! The recorder's thread hands every tick and event over as it writes it ([`Tap`]), the operators' desk the state as it would
//! answer it; a thread of its own carries them to the viewers. Nobody waits for anybody: where the queue is full its oldest
//! entries go, a viewer that does not read is cut off, and nothing that a viewer sends is ever read. Without a viewer nothing
//! is encoded.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use crossbeam::queue::ArrayQueue;
use flight::{Recorded, RecorderHealth};
use live::source::RECORDING_PROBLEM;
use proto::stream::{self, DaemonState};

use crate::machine::clock::now_ns;

/// Messages that wait for the thread: some 20 s of ticks.
const QUEUE: usize = 1_024;
/// Viewers at a time.
const MOST_VIEWERS: usize = 4;
/// Backlog that a viewer may have before it is cut off (bytes): some 20 s of ticks.
const MOST_BACKLOG: usize = 1 << 20;
/// Between two looks of the thread: half a tick.
const LOOK: Duration = Duration::from_millis(10);

/// Between two looks at whether anything is recorded.
const RECORDING_EVERY: Duration = Duration::from_millis(200);
/// Longest time between two tellings of the state, for it is told although it has not changed.
const STATE_EVERY: Duration = Duration::from_secs(1);

/// Reason why the stream's socket cannot be made.
#[derive(Debug, thiserror::Error)]
#[error("{}: the socket for live viewers cannot be made: {source}; set control.socket to a folder that can be written", .path.display())]
pub struct StreamError {
    /// The socket.
    pub path: PathBuf,
    /// Error of the system.
    pub source: io::Error,
}

/// State that the recorder's thread and the stream's share.
#[derive(Debug)]
struct Shared {
    queue: ArrayQueue<Vec<u8>>,
    viewers: AtomicUsize,
    about: BTreeMap<String, String>,
    /// The recorder's health, once there is a recorder.
    health: OnceLock<RecorderHealth>,
    /// Policies and their stages, JSON; the newest counts.
    policies: Mutex<String>,
    policies_edition: AtomicUsize,
    /// The daemon's state as it was last told, and when.
    state: Mutex<Option<(DaemonState, Instant)>>,
    state_edition: AtomicUsize,
}

impl Shared {
    /// The state as a message, aged until now; nothing before it was first told.
    fn put_state(&self, out: &mut Vec<u8>) {
        let told = self.state.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let Some((state, at)) = told else { return };
        let since_ms = u64::try_from(at.elapsed().as_millis()).unwrap_or(u64::MAX);
        let age_ms = state.age_ms.map(|age_ms| age_ms.saturating_add(since_ms));
        stream::put_state(&DaemonState { age_ms, ..state }, out);
    }
}

/// The recorder's end: sees what passes and hands it on.
#[derive(Debug, Clone)]
pub struct Tap {
    shared: Arc<Shared>,
    /// Wall clock less the daemon's, in ns.
    epoch_ns: i128,
}

impl Tap {
    /// Hands a tick or event on, if somebody looks.
    ///
    /// # Real-time
    /// Not in the tick: it allocates. The recorder's observer calls it.
    pub fn pass(&self, recorded: Recorded<'_>) {
        if self.shared.viewers.load(Ordering::Relaxed) == 0 {
            return;
        }
        let mut message = Vec::with_capacity(1_024);
        match recorded {
            Recorded::Tick(tick) => stream::put_tick(self.unix_ns(tick.receive_ns), tick, &mut message),
            Recorded::Event { at_ns, level, part, message: text } => {
                stream::put_event(self.unix_ns(at_ns), level, part, text, &mut message);
            }
        }
        self.shared.queue.force_push(message);
    }

    /// Tells viewers from now on what keeps the daemon from recording, among the facts of the run.
    pub fn watch_recorder(&self, health: RecorderHealth) {
        // There is one recorder in the life of a stream.
        let _ = self.shared.health.set(health);
    }

    /// Tells viewers which policies there are and how far each has come, as JSON.
    pub fn policies(&self, json: String) {
        *self.shared.policies.lock().unwrap_or_else(PoisonError::into_inner) = json;
        self.shared.policies_edition.fetch_add(1, Ordering::Release);
    }

    /// Tells viewers the daemon's state, where it is another one or has not been told for a second.
    pub fn state(&self, state: DaemonState) {
        let mut told = self.shared.state.lock().unwrap_or_else(PoisonError::into_inner);
        if told.as_ref().is_some_and(|(last, at)| last.says_the_same(&state) && at.elapsed() < STATE_EVERY) {
            return;
        }
        *told = Some((state, Instant::now()));
        self.shared.state_edition.fetch_add(1, Ordering::Release);
    }

    fn unix_ns(&self, monotonic_ns: u64) -> u64 {
        u64::try_from(i128::from(monotonic_ns) + self.epoch_ns).unwrap_or(0)
    }
}

/// The stream's thread and socket.
#[derive(Debug)]
pub struct LiveStream {
    thread: Option<JoinHandle<()>>,
    path: PathBuf,
}

impl LiveStream {
    /// Waits for the thread, which ends once the daemon's stop flag is set, and removes the socket.
    pub fn join(mut self) {
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// The socket goes with its stream, also where a start fails after it was made.
impl Drop for LiveStream {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

/// Makes the socket beside the operator's and serves viewers until `stop` is set; `about` is what each is sent first.
///
/// # Errors
/// The socket cannot be made: the folder is not writable, or something that is no socket bears its name.
pub fn serve(
    control_socket: &Path,
    about: BTreeMap<String, String>,
    stop: Arc<AtomicBool>,
) -> Result<(Tap, LiveStream), StreamError> {
    let path = live::source::live_socket(control_socket);
    let make = |source| StreamError { path: path.clone(), source };
    // What a daemon that was killed left behind goes; what is no socket is somebody else's and stays.
    if std::fs::symlink_metadata(&path).is_ok_and(|about| about.file_type().is_socket()) {
        std::fs::remove_file(&path).map_err(make)?;
    }
    let listener = UnixListener::bind(&path).map_err(make)?;
    std::fs::set_permissions(&path, PermissionsExt::from_mode(0o660)).map_err(make)?;
    listener.set_nonblocking(true).map_err(make)?;
    let shared = Arc::new(Shared {
        queue: ArrayQueue::new(QUEUE),
        viewers: AtomicUsize::new(0),
        about,
        health: OnceLock::new(),
        policies: Mutex::new(String::new()),
        policies_edition: AtomicUsize::new(0),
        state: Mutex::new(None),
        state_edition: AtomicUsize::new(0),
    });
    let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or(Duration::ZERO);
    let epoch_ns = since_1970.as_nanos() as i128 - i128::from(now_ns());
    let tap = Tap { shared: Arc::clone(&shared), epoch_ns };
    let thread = std::thread::Builder::new()
        .name("live".to_owned())
        .spawn(move || carry(&listener, &shared, &stop))
        .map_err(make)?;
    Ok((tap, LiveStream { thread: Some(thread), path }))
}

/// A viewer and what it has not read yet.
struct Viewer {
    socket: UnixStream,
    backlog: Vec<u8>,
    sent: usize,
}

impl Viewer {
    fn new(socket: UnixStream, first: Vec<u8>) -> io::Result<Self> {
        socket.set_nonblocking(true)?;
        Ok(Viewer { socket, backlog: first, sent: 0 })
    }

    /// Sends what it takes now; `false` when it is gone or too far behind.
    fn send(&mut self, more: &[u8]) -> bool {
        self.backlog.extend_from_slice(more);
        while let Some(rest) = self.backlog.get(self.sent..).filter(|rest| !rest.is_empty()) {
            match self.socket.write(rest) {
                Ok(0) => return false,
                Ok(written) => self.sent += written,
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(_) => return false,
            }
        }
        self.backlog.drain(..self.sent);
        self.sent = 0;
        self.backlog.len() <= MOST_BACKLOG
    }
}

fn carry(listener: &UnixListener, shared: &Shared, stop: &AtomicBool) {
    let mut viewers: Vec<Viewer> = Vec::new();
    let (mut edition, mut state_edition) = (0, 0);
    let (mut about, mut recording_looked) = (shared.about.clone(), None::<Instant>);
    let mut ending = false;
    loop {
        // One more round after the end, for the last events.
        let last = std::mem::replace(&mut ending, stop.load(Ordering::Relaxed));
        let mut news = Vec::new();
        if let Some(health) = shared.health.get()
            && recording_looked.is_none_or(|at| at.elapsed() >= RECORDING_EVERY)
        {
            recording_looked = Some(Instant::now());
            let problem = health.why_not_arm().unwrap_or_default();
            if about.get(RECORDING_PROBLEM) != Some(&problem) {
                about.insert(RECORDING_PROBLEM.to_owned(), problem);
                stream::put_about(&about, &mut news);
            }
        }
        while let Ok((socket, _)) = listener.accept() {
            let mut first = Vec::new();
            stream::put_about(&about, &mut first);
            let policies = shared.policies.lock().unwrap_or_else(PoisonError::into_inner).clone();
            if !policies.is_empty() {
                stream::put_policies(&policies, &mut first);
            }
            shared.put_state(&mut first);
            if viewers.len() < MOST_VIEWERS {
                viewers.extend(Viewer::new(socket, first));
            }
        }
        let newest = shared.policies_edition.load(Ordering::Acquire);
        if newest != edition {
            edition = newest;
            let policies = shared.policies.lock().unwrap_or_else(PoisonError::into_inner).clone();
            stream::put_policies(&policies, &mut news);
        }
        let newest = shared.state_edition.load(Ordering::Acquire);
        if newest != state_edition {
            state_edition = newest;
            shared.put_state(&mut news);
        }
        while let Some(message) = shared.queue.pop() {
            news.extend_from_slice(&message);
        }
        viewers.retain_mut(|viewer| viewer.send(&news));
        shared.viewers.store(viewers.len(), Ordering::Relaxed);
        if last {
            return;
        }
        std::thread::sleep(LOOK);
    }
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use proto::recording::{EventLevel, TickRecord};
    use proto::stream::{Message, StreamReader};

    use super::*;

    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("live-stream-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        folder
    }

    fn wait_for(viewers: usize, tap: &Tap) {
        for _ in 0..500 {
            if tap.shared.viewers.load(Ordering::Relaxed) == viewers {
                return;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        panic!("{viewers} viewers did not come");
    }

    #[test]
    fn a_viewer_is_told_about_the_run_and_then_everything() {
        let folder = folder("told");
        let stop = Arc::new(AtomicBool::new(false));
        let about: BTreeMap<String, String> = [("program".to_owned(), "controller".to_owned())].into();
        let (tap, stream) = serve(&folder.join("c.sock"), about.clone(), Arc::clone(&stop)).unwrap();
        tap.pass(Recorded::Tick(&TickRecord::default()));
        let mut viewer = UnixStream::connect(folder.join("c.live.sock")).unwrap();
        wait_for(1, &tap);
        for tick in 0..100 {
            tap.pass(Recorded::Tick(&TickRecord { tick, ..TickRecord::default() }));
        }
        tap.pass(Recorded::Event { at_ns: 5, level: EventLevel::Info, part: "tick", message: "over" });
        stop.store(true, Ordering::Relaxed);
        let (mut bytes, mut reader) = (Vec::new(), StreamReader::default());
        viewer.read_to_end(&mut bytes).unwrap();
        reader.push(&bytes);
        let mut messages = Vec::new();
        while let Some(message) = reader.next().unwrap() {
            messages.push(message);
        }
        stream.join();
        assert_eq!(messages.len(), 102, "nothing from before it looked");
        assert_eq!(messages[0], Message::About(about));
        let ticks: Vec<u32> = messages
            .iter()
            .filter_map(|m| if let Message::Tick { tick, .. } = m { Some(tick.tick) } else { None })
            .collect();
        assert_eq!(ticks, (0..100).collect::<Vec<_>>());
        assert!(matches!(&messages[101], Message::Event(event) if event.message == "over"));
        assert!(!folder.join("c.live.sock").exists());
        std::fs::remove_dir_all(folder).unwrap();
    }

    /// Whoever comes while no tick does is told at once, and how old the newest data has become by then.
    #[test]
    fn the_state_is_told_to_whoever_comes_and_whenever_it_changes() {
        let folder = folder("state");
        let stop = Arc::new(AtomicBool::new(false));
        let (tap, stream) = serve(&folder.join("c.sock"), BTreeMap::new(), Arc::clone(&stop)).unwrap();
        let lost = DaemonState { state: 6, fault: 7, age_ms: Some(2_000), ..DaemonState::default() };
        tap.state(lost.clone());
        let mut viewer = UnixStream::connect(folder.join("c.live.sock")).unwrap();
        wait_for(1, &tap);
        // The same once more within a second is no news, another state is.
        tap.state(DaemonState { age_ms: Some(2_100), ..lost.clone() });
        tap.state(DaemonState { state: 0, fault: 0, ..lost });
        stop.store(true, Ordering::Relaxed);
        let (mut bytes, mut reader) = (Vec::new(), StreamReader::default());
        viewer.read_to_end(&mut bytes).unwrap();
        reader.push(&bytes);
        let mut told = Vec::new();
        while let Some(message) = reader.next().unwrap() {
            if let Message::State(state) = message {
                assert!(state.age_ms >= Some(2_000), "{state:?}");
                told.push((state.state, state.fault));
            }
        }
        stream.join();
        told.dedup();
        assert_eq!(told, [(6, 7), (0, 0)]);
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn a_viewer_that_does_not_read_is_cut_off_and_holds_up_nobody() {
        let folder = folder("stuck");
        let stop = Arc::new(AtomicBool::new(false));
        let (tap, stream) = serve(&folder.join("c.sock"), BTreeMap::new(), Arc::clone(&stop)).unwrap();
        let _stuck = UnixStream::connect(folder.join("c.live.sock")).unwrap();
        wait_for(1, &tap);
        // Twice what the socket and the backlog hold together.
        for tick in 0..6_000 {
            tap.pass(Recorded::Tick(&TickRecord { tick, ..TickRecord::default() }));
            if tick % 500 == 0 {
                std::thread::sleep(Duration::from_millis(30));
            }
        }
        wait_for(0, &tap);
        stop.store(true, Ordering::Relaxed);
        stream.join();
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn a_file_of_that_name_is_left_alone() {
        let folder = folder("file");
        std::fs::write(folder.join("c.live.sock"), "somebody's").unwrap();
        let refused = serve(&folder.join("c.sock"), BTreeMap::new(), Arc::new(AtomicBool::new(false)));
        assert!(refused.unwrap_err().to_string().contains("c.live.sock"));
        assert_eq!(std::fs::read_to_string(folder.join("c.live.sock")).unwrap(), "somebody's");
        std::fs::remove_dir_all(folder).unwrap();
    }
}
