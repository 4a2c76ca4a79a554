//! Duration of a configuration's tick on this machine: run for a while, in lockstep, on an emulated rig.
//!
//! The rig behind the emulated cRIO is the configuration's own model, so the trial also shows what the controller does
//! where the model is right: whether it stays inside the safety envelope. Nothing real is connected, and what was
//! recorded is thrown away.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, PoisonError};

use flight::Recorded;
use flight::duration_histogram::DurationHistogram;
use proto::emulator::{Emulator, EmulatorConfig, EmulatorError, Pace, rig_and_crio};
use supervisor::{ConditionSet, Memory};

use crate::config::{Config, Pacing};
use crate::daemon::{self, DaemonError, Loaded, Options};
use crate::session::pacing::COMMAND_DEADLINE_NS;
use crate::session::run_length::{Begins, RunClock, RunEnd, RunLength};
use crate::state::{Condition, State};

/// Length of the trial, in s of the plant's time: a thousand ticks, so that the slowest in a thousand is among them.
const SECONDS: f64 = 20.0;

/// Reason why there is no trial.
#[derive(Debug, thiserror::Error)]
pub enum TrialError {
    /// The rig cannot stand behind a cRIO.
    #[error("the model cannot be emulated: {0}")]
    Rig(#[from] model::rig::RigError),
    /// The emulated cRIO does not start.
    #[error(transparent)]
    Emulator(#[from] EmulatorError),
    /// The daemon does not.
    #[error(transparent)]
    Daemon(#[from] DaemonError),
    /// A signal ended it.
    #[error("stopped before the {SECONDS} s on the simulated rig were over")]
    Stopped,
}

/// Findings of a trial.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct TickTrial {
    /// Ticks in which the pressures were controlled.
    pub ticks: u64,
    /// Times of these; absent where there were none.
    #[serde(flatten)]
    pub times: Option<TickTimes>,
    /// Time after which a command counts as late, in ms.
    pub deadline_ms: f64,
    /// Ticks after which both vents were opened for a fault.
    pub vented: u64,
    /// The condition that they were first opened for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fault: Option<Condition>,
    /// The condition that last kept the rig from being armed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bars_arming: Option<Condition>,
}

/// Times of ticks.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct TickTimes {
    /// Computation of a tick, frame in hand to command sent, in ms: half of the ticks take less.
    pub p50_ms: f64,
    /// 999 of 1,000 take less.
    pub p999_ms: f64,
    /// The slowest.
    pub max_ms: f64,
}

impl TickTrial {
    /// Tells whether the pressures were controlled, and nothing was vented for a fault.
    pub fn is_good(&self) -> bool {
        self.ticks > 0 && self.vented == 0
    }

    /// Runs a configuration; takes a second or two.
    ///
    /// # Errors
    /// Why it cannot be run.
    pub fn run(config: &Config, loaded: Loaded) -> Result<Self, TrialError> {
        let (behind, crio) = rig_and_crio(&loaded.rig)?;
        let emulated = EmulatorConfig { crio, pace: Pace::LOCKSTEP, ..EmulatorConfig::default() };
        let emulator = Emulator::bind("127.0.0.1:0", emulated, Box::new(behind)).and_then(Emulator::start)?;
        let mut config = config.clone();
        config.link.address = emulator.local_addr().to_string();
        config.link.pacing = Pacing::Lockstep;
        config.control.auto_arm = true;
        config.realtime.enforce = false;
        let seen = Arc::new(Mutex::new(Seen::default()));
        let watcher = Arc::clone(&seen);
        let recording = scratch();
        let options = Options {
            recording: Some(recording.clone()),
            length: RunLength::seconds(SECONDS, Begins::WhenArmedOrSoon, RunClock::Lockstep),
            socket: false,
            extra: Vec::new(),
            config_text: String::new(),
            config_file: None,
            attachments: Vec::new(),
            observer: Box::new(move |recorded| watcher.lock().unwrap_or_else(PoisonError::into_inner).take(recorded)),
            stop: Arc::new(AtomicBool::new(false)),
        };
        let ended = daemon::run(&config, loaded, options);
        for file in [&recording, &proto::recording::unfinished_path(&recording)] {
            let _ = std::fs::remove_file(file);
        }
        emulator.stop();
        let _ = emulator.join();
        if ended?.end == RunEnd::Before {
            return Err(TrialError::Stopped);
        }
        let seen = seen.lock().unwrap_or_else(PoisonError::into_inner);
        Ok(seen.trial())
    }
}

fn scratch() -> PathBuf {
    std::env::temp_dir().join(format!("controller-check-{}.mcap", std::process::id()))
}

#[derive(Default)]
struct Seen {
    times: DurationHistogram,
    vented: u64,
    fault: Option<Condition>,
    bars_arming: Option<Condition>,
}

impl Seen {
    fn take(&mut self, recorded: Recorded<'_>) {
        let Recorded::Tick(tick) = recorded else { return };
        if tick.state == State::Run.code() {
            self.times.add(u64::from(tick.compute_ns));
        } else if tick.fault != 0 {
            self.vented += 1;
            self.fault = self.fault.or(Condition::from_code(tick.fault));
        }
        if tick.state == State::Standby.code() {
            self.bars_arming = Memory::bars_arming(&ConditionSet::from_code_bits(tick.findings));
        }
    }

    fn trial(&self) -> TickTrial {
        let ms = |ns: u64| ns as f64 * 1e-6;
        let times = || {
            Some(TickTimes {
                p50_ms: ms(self.times.percentile_ns(0.5)?),
                p999_ms: ms(self.times.percentile_ns(0.999)?),
                max_ms: ms(self.times.max_ns()?),
            })
        };
        TickTrial {
            ticks: self.times.total(),
            times: times(),
            deadline_ms: ms(COMMAND_DEADLINE_NS),
            vented: self.vented,
            fault: self.fault,
            bars_arming: self.bars_arming,
        }
    }
}

#[cfg(test)]
mod tests {
    use proto::recording::TickRecord;

    use super::*;

    fn standby(conditions: &[Condition]) -> TickRecord {
        let mut found = ConditionSet::EMPTY;
        conditions.iter().for_each(|condition| found.insert(*condition, 0.0));
        TickRecord { state: State::Standby.code(), findings: found.code_bits(), ..TickRecord::default() }
    }

    #[test]
    fn what_keeps_the_rig_from_being_armed_is_named() {
        let mut seen = Seen::default();
        seen.take(Recorded::Tick(&standby(&[Condition::NotRecorded])));
        // The end of the session bars nothing that was not barred before.
        seen.take(Recorded::Tick(&TickRecord { state: State::Connect.code(), ..TickRecord::default() }));
        let trial = seen.trial();
        assert!(!trial.is_good());
        assert_eq!((trial.fault, trial.bars_arming), (None, Some(Condition::NotRecorded)));
        seen.take(Recorded::Tick(&standby(&[])));
        assert_eq!(seen.trial().bars_arming, None, "what is over is no reason");
    }
}
