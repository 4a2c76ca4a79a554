//! Puts an experiment together: a sequence checked, foreseen, played once on the rig, and recorded.
//!
//! The link, the tick, the watch, the recorder are the daemon's ([`crate::session::session_recorder`], [`crate::cycle`]); only what is
//! steered for is another ([`crate::experiment::open_loop_playback`]). The recording holds the rest before the rows and the rest
//! after them, too, with the commands that were then in force.

pub mod command_sequence;
pub mod experiment_log;
pub mod open_loop_playback;
pub mod playback_report;
pub mod preflight_simulation;
pub mod pump_relay;
pub mod settling;
pub mod stopped;
pub mod waiting;

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, PoisonError};

use flight::{Recorded, RecordingSummary};
use model::rig::Rig;
use proto::recording::PERIOD_S;

use crate::config::sensor_limits::{ModelRigError, load_within_limits};
use crate::config::{Config, Safety};
use crate::cycle::Cycle;
use crate::experiment::command_sequence::{CommandSequence, CommandSequenceError};
use crate::experiment::open_loop_playback::OpenLoopPlayback;
use crate::experiment::playback_report::PlaybackReport;
use crate::experiment::preflight_simulation::{Forecast, ForecastError, preflight_simulation};
use crate::experiment::pump_relay::PumpRelay;
use crate::experiment::stopped::Stopped;
use crate::operator::notice::sentence_of_one_session;
use crate::operator::running::ModelIdentity;
use crate::operator::socket::{May, Running};
use crate::replay::run_file::attached;
use crate::session::recording_folder::EXPERIMENT_STEM;
use crate::session::run_length::RunLength;
use crate::session::session_recorder::{Flown, SessionError, SessionRecorder, attachment, fly_recorded};

/// Reason why an experiment cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// The sequence is no good.
    #[error(transparent)]
    CommandSequence(#[from] CommandSequenceError),
    /// The rig cannot be read, or its sensors do not show the configuration's limits.
    #[error(transparent)]
    Rig(#[from] ModelRigError),
    /// The rig cannot be flown.
    #[error("rig {name}: {problem}")]
    Unflyable {
        /// The rig.
        name: String,
        /// Reason.
        problem: model::rig::RigError,
    },
    /// The model says that it must not be played.
    #[error(transparent)]
    Forecast(#[from] ForecastError),
    /// It cannot start or was not recorded well.
    #[error(transparent)]
    SessionRecorder(#[from] SessionError),
}

/// An experiment that is fit to be played.
pub struct Experiment {
    /// The sequence.
    pub sequence: CommandSequence,
    /// The model's rig.
    pub rig: Rig,
    /// Forecast of the model.
    pub forecast: Forecast,
}

/// Settings by which it is played.
pub struct Options {
    /// Place where the recording goes; by default a file named after the time in the configured folder.
    pub recording: Option<PathBuf>,
    /// The command line, for the recording.
    pub command: String,
    /// The configuration's text, for the recording.
    pub config_text: String,
    /// Sees every tick and event, in the recorder's thread.
    pub observer: Box<dyn FnMut(Recorded<'_>) + Send>,
    /// Set by somebody else to end it.
    pub stop: Arc<AtomicBool>,
}

/// Outcome.
#[derive(Debug, Clone, PartialEq)]
pub struct Played {
    /// The recording.
    pub recording: RecordingSummary,
    /// Rows of the sequence.
    pub rows: u32,
    /// One past the last row that was sent.
    pub reached: u32,
    /// Reason why it did not come to its end, in a few words; `None`: it did.
    pub aborted: Option<String>,
    /// Report of the cRIO.
    pub witness: PlaybackReport,
}

impl Experiment {
    /// Reads a sequence and the configuration's rig, and checks the one on the other; nothing is connected.
    ///
    /// # Errors
    /// The first thing that is wrong, or when and how far the model leaves the safety envelope.
    pub fn load(config: &Config, csv: &Path) -> Result<Self, ExperimentError> {
        let sequence = CommandSequence::read(csv)?;
        let rig = load_within_limits(&config.rig.file, Some("rig.file"), config.safety)?;
        Self::check(sequence, rig, config.safety)
    }

    /// Checks a sequence on the model's rig: the envelope, and whether a pump that it switches can be switched.
    ///
    /// # Errors
    /// When and how far the model leaves the safety envelope, or which rows need the pump off.
    pub fn check(sequence: CommandSequence, rig: Rig, safety: Safety) -> Result<Self, ExperimentError> {
        let forecast = preflight_simulation(&rig, &sequence, safety)?;
        if forecast.relay == PumpRelay::Absent
            && let Some(stretches) = sequence.pump_off()
        {
            let (file, rig) = (sequence.source().to_owned(), rig.name);
            return Err(CommandSequenceError::NoRelay { file, stretches, rig }.into());
        }
        Ok(Experiment { sequence, rig, forecast })
    }

    /// Plays it and records it.
    ///
    /// # Errors
    /// Why it cannot start, or what of the recording was lost; what stops it on the way is no error but
    /// [`Played::aborted`].
    pub fn run(self, config: &Config, options: Options) -> Result<Played, ExperimentError> {
        let unflyable = |problem| ExperimentError::Unflyable { name: config.rig.file.clone(), problem };
        let rows = self.sequence.rows().into();
        let cycle = Cycle::playing(&self.rig, rows, self.forecast.relay, config.safety).map_err(unflyable)?;
        let witness = Arc::new(Mutex::new(PlaybackReport::new(self.forecast.relay)));
        let (seen, mut observer) = (Arc::clone(&witness), options.observer);
        let name = self.sequence.source().to_owned();
        let logbook = SessionRecorder {
            policies: None,
            file: options.recording,
            stem: EXPERIMENT_STEM,
            policy: None,
            extra: vec![
                ("model_rig".to_owned(), self.rig.name.clone()),
                ("experiment".to_owned(), name.clone()),
                ("command".to_owned(), options.command),
            ],
            attachments: vec![
                attachment(attached::EXPERIMENT, "text/csv", self.sequence.bytes()),
                attachment(attached::MODEL, "application/toml", self.rig.to_toml().unwrap_or_default()),
                attachment(attached::CONFIG, "application/toml", options.config_text),
            ],
            remarks: Vec::new(),
            event_text: sentence_of_one_session,
            operator: Some(May::OnlyStop),
            running: Running { reference: name, ..Running::default() }
                .on_model(ModelIdentity::of(&self.rig, &config.rig.file)),
            followed: None,
            config_file: None,
            observer: Box::new(move |recorded| {
                if let Recorded::Tick(tick) = recorded {
                    seen.lock().unwrap_or_else(PoisonError::into_inner).push(tick);
                }
                observer(recorded);
            }),
            stop: options.stop,
            length: RunLength::ENDLESS,
        };
        let Flown { recording, cycle, .. } = fly_recorded(config, cycle, logbook)?;
        let playing = cycle.duty_source();
        let witness = witness.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let (rows, reached) = (playing.rows(), playing.reached());
        let pump_off = self.sequence.pump_off();
        let aborted = why_aborted(playing, self.sequence.source(), pump_off.as_deref());
        Ok(Played { recording, rows, reached, aborted, witness })
    }
}

/// Reason why a sequence did not come to its end, with what would mend it; `None`: it did. `pump_off`: its rows with the pump
/// off, as [`CommandSequence::pump_off`] names them.
pub fn why_aborted(playing: &OpenLoopPlayback, file: &str, pump_off: Option<&str>) -> Option<String> {
    if playing.is_complete() {
        return None;
    }
    let why = playing.why_stopped().map_or("stopped by hand".to_owned(), |why| why.to_string());
    let needs = match (playing.why_stopped(), pump_off) {
        (Some(Stopped::PumpRuns), Some(stretches)) => format!("; {file} needs the pump off in {stretches}"),
        (Some(Stopped::PumpRuns), None) => {
            "; leave `relay` out under the pump in the rig file, then the experiment starts with the pump running"
                .to_owned()
        }
        _ => String::new(),
    };
    Some(why + &needs)
}

impl Played {
    /// Seconds of the sequence that were played.
    pub fn seconds(&self) -> f64 {
        f64::from(self.reached) * PERIOD_S
    }
}
