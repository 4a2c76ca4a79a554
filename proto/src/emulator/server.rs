//! The emulated cRIO on a TCP socket: one thread that serves one client and advances the rig.
//!
//! ```no_run
//! use proto::emulator::{Emulator, EmulatorConfig, rig_and_crio};
//! let (rig, crio) = rig_and_crio(&model::rig::Rig::builtin("bench")?)?;
//! let config = EmulatorConfig { crio, ..EmulatorConfig::default() };
//! let emulator = Emulator::bind("127.0.0.1:0", config, Box::new(rig))?.start()?;
//! println!("listening on {}", emulator.local_addr());
//! // ... a daemon connects ...
//! emulator.stop();
//! println!("{:?}", emulator.join()?);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use std::net::{SocketAddr, TcpListener};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

use super::crio::{Crio, CrioConfig};
use super::faults::FaultScript;
use super::pace::Pace;
use super::rig::EmulatedPlant;
use super::sensors::Sensors;
use super::serve::Server;
use super::watch::{NoObserver, Statistics, TruthObserver};

/// Settings of the emulator.
#[derive(Debug, Clone, PartialEq)]
pub struct EmulatorConfig {
    /// Properties of the cRIO.
    pub crio: CrioConfig,
    /// Pace of plant time.
    pub pace: Pace,
    /// Noise of the converter, V RMS; 0 for none.
    pub noise_v_rms: f64,
    /// Seed of the noise.
    pub seed: u64,
    /// Faults made on purpose.
    pub faults: FaultScript,
}

impl Default for EmulatorConfig {
    /// Real time, the noise of an NI 9205, seed 1, no faults.
    fn default() -> Self {
        Self {
            crio: CrioConfig::default(),
            pace: Pace::RealTime,
            noise_v_rms: Sensors::ADC_NOISE_V_RMS,
            seed: 1,
            faults: FaultScript::none(),
        }
    }
}

/// Why the emulator cannot run.
#[derive(Debug, thiserror::Error)]
pub enum EmulatorError {
    /// The address cannot be listened on.
    #[error("cannot listen on {address}: {source}; take another address or port")]
    Bind {
        /// The address asked for.
        address: String,
        /// The system's word.
        source: std::io::Error,
    },
    /// The thread cannot be started.
    #[error("cannot start the emulator's thread: {source}")]
    Thread {
        /// The system's word.
        source: std::io::Error,
    },
    /// The thread, or the rig or watcher in it, panicked.
    #[error("the emulator's thread panicked; its message stands above")]
    Panicked,
}

/// An emulated cRIO that has its address and is not running yet.
pub struct Emulator {
    listener: TcpListener,
    address: SocketAddr,
    config: EmulatorConfig,
    rig: Box<dyn EmulatedPlant>,
    watcher: Box<dyn TruthObserver>,
}

impl Emulator {
    /// Takes an address to listen on, `host:port`; port 0 takes a free one.
    ///
    /// # Errors
    /// [`EmulatorError::Bind`].
    pub fn bind(address: &str, config: EmulatorConfig, rig: Box<dyn EmulatedPlant>) -> Result<Self, EmulatorError> {
        let bind = || {
            let listener = TcpListener::bind(address)?;
            listener.set_nonblocking(true)?;
            let address = listener.local_addr()?;
            Ok((listener, address))
        };
        let (listener, bound) = bind().map_err(|source| EmulatorError::Bind { address: address.to_owned(), source })?;
        Ok(Self { listener, address: bound, config, rig, watcher: Box::new(NoObserver) })
    }

    /// The address it listens on.
    #[must_use]
    pub const fn local_addr(&self) -> SocketAddr {
        self.address
    }

    /// Lets this watcher look on.
    #[must_use]
    pub fn watched_by(mut self, watcher: Box<dyn TruthObserver>) -> Self {
        self.watcher = watcher;
        self
    }

    /// Runs it in a thread of its own.
    ///
    /// # Errors
    /// [`EmulatorError::Thread`].
    pub fn start(self) -> Result<EmulatorHandle, EmulatorError> {
        let stop = Arc::new(AtomicBool::new(false));
        let statistics = Arc::new(Mutex::new(Statistics::default()));
        let server = Server {
            listener: self.listener,
            sensors: Sensors::new(self.config.crio.scales, self.config.noise_v_rms, self.config.seed),
            crio: Crio::new(self.config.crio),
            pace: self.config.pace,
            script: self.config.faults,
            rig: self.rig,
            watcher: self.watcher,
            stop: Arc::clone(&stop),
            published: Arc::clone(&statistics),
            statistics: Statistics::default(),
            started: Instant::now(),
            link: None,
            closing: Vec::new(),
            refuse_until: None,
            session_is_fresh: false,
            waiting: None,
        };
        let thread = std::thread::Builder::new()
            .name("crio-emulator".to_owned())
            .spawn(move || server.run())
            .map_err(|source| EmulatorError::Thread { source })?;
        Ok(EmulatorHandle { address: self.address, stop, statistics, thread: Some(thread) })
    }
}

/// A running emulator; dropping it stops it.
#[derive(Debug)]
pub struct EmulatorHandle {
    address: SocketAddr,
    stop: Arc<AtomicBool>,
    statistics: Arc<Mutex<Statistics>>,
    thread: Option<JoinHandle<()>>,
}

impl EmulatorHandle {
    /// The address it listens on.
    #[must_use]
    pub const fn local_addr(&self) -> SocketAddr {
        self.address
    }

    /// Asks it to stop: BYE to the client, and the thread ends within 50 ms.
    pub fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// True once its thread has ended.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// The counts, as of the last edge or event.
    #[must_use]
    pub fn statistics(&self) -> Statistics {
        *self.statistics.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until it has stopped, and gives the final counts.
    ///
    /// # Errors
    /// [`EmulatorError::Panicked`].
    pub fn join(mut self) -> Result<Statistics, EmulatorError> {
        if let Some(thread) = self.thread.take() {
            thread.join().map_err(|_| EmulatorError::Panicked)?;
        }
        Ok(self.statistics())
    }
}

impl Drop for EmulatorHandle {
    fn drop(&mut self) {
        self.stop();
        if let Some(thread) = self.thread.take() {
            // A panic in the thread has shown its message already.
            let _ = thread.join();
        }
    }
}
