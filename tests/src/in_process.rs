//! The daemon within the test's own process, so that its threads can be watched; otherwise as `controller run` runs it.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use controller::config::Config;
use controller::daemon::{self, DaemonError, Flight, Options};
use controller::operator::socket::{Ask, Reply, ask};
use controller::session::run_length::RunLength;
use flight::{Recorded, RecordingSummary};

use crate::task::tasks_named;

/// Time that anything may take on a machine that does other things as well.
const PATIENCE: Duration = Duration::from_secs(60);

/// A daemon at work.
pub struct Daemon {
    thread: JoinHandle<Result<Flight, DaemonError>>,
    stop: Arc<AtomicBool>,
    socket: PathBuf,
    /// Threads called tick that were there before it.
    others: Vec<i32>,
}

impl Daemon {
    /// Starts it with this configuration.
    ///
    /// # Panics
    /// If the configuration is refused.
    pub fn start(config: &Path, observer: impl FnMut(Recorded<'_>) + Send + 'static) -> Self {
        let text = std::fs::read_to_string(config).expect("a configuration");
        let config = Config::read(config).expect("a sound configuration");
        let loaded = daemon::load(&config).unwrap_or_else(|e| panic!("{e}"));
        let stop = Arc::new(AtomicBool::new(false));
        let options = Options {
            recording: None,
            length: RunLength::ENDLESS,
            socket: true,
            extra: Vec::new(),
            config_text: text,
            attachments: Vec::new(),
            config_file: None,
            observer: Box::new(observer),
            stop: Arc::clone(&stop),
        };
        let socket = config.control.socket.clone();
        let others = tasks_named("tick");
        let thread = std::thread::spawn(move || daemon::run(&config, loaded, options));
        Daemon { thread, stop, socket, others }
    }

    /// The number of the tick's thread.
    ///
    /// # Panics
    /// If there is none in time, or more than one.
    pub fn tick_task(&self) -> i32 {
        let until = Instant::now() + PATIENCE;
        while Instant::now() < until {
            let mut tasks = tasks_named("tick");
            tasks.retain(|task| !self.others.contains(task));
            if let [task] = tasks[..] {
                return task;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        panic!("threads called tick: {:?}", tasks_named("tick"));
    }

    /// Asks it; `None` while nobody answers.
    pub fn ask(&self, question: &Ask) -> Option<Reply> {
        ask(&self.socket, question).ok()
    }

    /// Tells whether it has ended, which only a fault of its own makes it do before it is told to.
    pub fn is_over(&self) -> bool {
        self.thread.is_finished()
    }

    /// Socket.
    pub fn socket(&self) -> &Path {
        &self.socket
    }

    /// Ends it.
    ///
    /// # Panics
    /// If a thread of it has panicked or the recording was lost.
    pub fn end(self) -> RecordingSummary {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().expect("no panic").unwrap_or_else(|e| panic!("{e}")).recording
    }
}
