//! The recording that an experiment within a run leaves beside the run's own: `experiment-….mcap`, as `controller
//! experiment` leaves one without a daemon.
//!
//! The run's recorder hands every tick over as it writes it ([`ExperimentLog::pass`]); those with a phase of an experiment
//! go to a second recorder with a thread of its own. It is opened by the desk before the tick is asked
//! ([`ExperimentLog::expect`]) and closed by it once the experiment is over ([`ExperimentLog::close`]).

use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::Duration;

use flight::{Destination, RecordError, RecordSink, Recorded, Recorder, RecorderOptions, Retention};
use proto::recording::{Attachment, EventLevel, LogTime, RecordingInfo, TickRecord, VERDICT, read_mcap};

use crate::experiment::Experiment;
use crate::experiment::playback_report::PlaybackReport;
use crate::machine::clock::now_ns;
use crate::operator::notice::sentence;
use crate::replay::run_file::attached;
use crate::session::session_recorder::{PROGRAM, attachment};

/// Size that no experiment reaches, in bytes: two minutes and the rest around them are 5 MB.
const MOST_BYTES: u64 = 256 << 20;
/// Time that none reaches: it rests for a minute and 20 s at most.
const MOST_TIME: Duration = Duration::from_secs(3600);
/// Between two looks for room, in lockstep.
const LOOK: Duration = Duration::from_millis(1);

/// Settings of the recordings of experiments.
#[derive(Debug, Clone)]
pub struct LogSettings {
    /// Place where they go; limits of size and number are not taken from here.
    pub destination: Destination,
    /// Meaning of times in them; ticks in lockstep are waited for, others are counted where the queue is full.
    pub log_time: LogTime,
    /// The configuration's file.
    pub config: Option<Attachment>,
}

/// Records the experiments of a run; may be cloned.
#[derive(Debug, Clone)]
pub struct ExperimentLog {
    settings: Arc<LogSettings>,
    open: Arc<Mutex<Option<Open>>>,
    /// Held while a recording is finished, so that the end of the run waits for it.
    closing: Arc<Mutex<()>>,
}

/// Results that an experiment left.
#[derive(Debug)]
pub struct Kept {
    /// Recording of the experiment.
    pub recording: KeptRecording,
    /// Report of what the cRIO said to each row.
    pub report: PlaybackReport,
}

/// The recording of an experiment, whole or not.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct KeptRecording {
    /// The last finished file; `None` where there is none.
    pub path: Option<PathBuf>,
    /// Reason, in one line, why it lacks something or why there is none; `None`: nothing was lost.
    pub problem: Option<String>,
    /// Ticks in the file.
    pub ticks: u64,
    /// Ticks that could not be kept.
    pub ticks_dropped: u64,
}

impl KeptRecording {
    /// No recording at all.
    pub fn none(why: String) -> Self {
        KeptRecording { problem: Some(why), ..KeptRecording::default() }
    }
}

#[derive(Debug)]
struct Open {
    info: RecordingInfo,
    attachments: Vec<Attachment>,
    report: PlaybackReport,
    recording: Option<Result<Recording, String>>,
    ended: bool,
}

/// A recorder at work.
#[derive(Debug)]
struct Recording {
    recorder: Recorder,
    sink: RecordSink,
}

impl ExperimentLog {
    /// Nothing is recorded yet.
    pub fn new(settings: LogSettings) -> Self {
        let LogSettings { destination, log_time, config } = settings;
        // What is old in the folder is the run's own recorder's to remove.
        let retention = Retention { days: 0, bytes: 0 };
        let destination = Destination { most_bytes: MOST_BYTES, most_time: MOST_TIME, retention, ..destination };
        let settings = Arc::new(LogSettings { destination, log_time, config });
        ExperimentLog { settings, open: Arc::default(), closing: Arc::default() }
    }

    /// Records the next experiment from its first tick on.
    pub fn expect(&self, experiment: &Experiment) {
        let mut info = RecordingInfo::new(PROGRAM, now_ns());
        info.log_time = self.settings.log_time;
        let name = experiment.sequence.source();
        info.extra.extend([
            ("model_rig".to_owned(), experiment.rig.name.clone()),
            ("experiment".to_owned(), name.to_owned()),
            ("command".to_owned(), format!("controller experiment {name}, through the running daemon")),
        ]);
        let mut attachments = vec![
            attachment(attached::EXPERIMENT, "text/csv", experiment.sequence.bytes()),
            attachment(attached::MODEL, "application/toml", experiment.rig.to_toml().unwrap_or_default()),
        ];
        attachments.extend(self.settings.config.clone());
        let report = PlaybackReport::new(experiment.forecast.relay);
        *self.lock() = Some(Open { info, attachments, report, recording: None, ended: false });
    }

    /// Forgets the experiment that was expected: no tick took it.
    pub fn forget(&self) {
        *self.lock() = None;
    }

    /// Takes a tick or event of the run.
    ///
    /// # Real-time
    /// Not in the tick: the recorder's thread calls it.
    pub fn pass(&self, recorded: Recorded<'_>) {
        let mut open = self.lock();
        let Some(open) = open.as_mut().filter(|open| !open.ended) else { return };
        match recorded {
            Recorded::Tick(tick) if tick.experiment != 0 => open.tick(tick, &self.settings),
            Recorded::Tick(_) => open.ended = open.recording.is_some(),
            Recorded::Event { at_ns, level, part, message } => {
                if let Some(Ok(Recording { recorder, .. })) = &open.recording {
                    let part =
                        ["tick", "operator", "link"].into_iter().find(|known| *known == part).unwrap_or("daemon");
                    recorder.note(at_ns, level, part, message);
                }
            }
        }
    }

    /// Tells whether the first tick after the experiment has passed. Never waits: while the recording holds the lock, which may be for
    /// as long as a disk does not answer, it has not.
    pub fn has_ended(&self) -> bool {
        let ended = |open: &Option<Open>| open.as_ref().is_none_or(|open| open.ended);
        match self.open.try_lock() {
            Ok(open) => ended(&open),
            Err(TryLockError::Poisoned(poisoned)) => ended(&poisoned.into_inner()),
            Err(TryLockError::WouldBlock) => false,
        }
    }

    /// Finishes the recording; `ending` is its last line. `None` where no experiment was expected. Takes as long as the
    /// disk does.
    pub fn close(&self, ending: (EventLevel, String)) -> Option<Kept> {
        let _closing = self.closing.lock().unwrap_or_else(PoisonError::into_inner);
        let open = self.lock().take()?;
        let recording = match open.recording {
            None => KeptRecording::none("no tick of it was recorded".to_owned()),
            Some(Err(why)) => KeptRecording::none(why),
            Some(Ok(recording)) => {
                recording.recorder.note(now_ns(), ending.0, VERDICT, ending.1);
                recording.finish()
            }
        };
        Some(Kept { recording, report: open.report })
    }

    fn lock(&self) -> MutexGuard<'_, Option<Open>> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Open {
    fn tick(&mut self, tick: &TickRecord, settings: &LogSettings) {
        self.report.push(tick);
        let (info, attachments) = (&self.info, &self.attachments);
        let recording = self.recording.get_or_insert_with(|| {
            let options = RecorderOptions::new(sentence);
            let started = Recorder::start_in(settings.destination.clone(), info, attachments, options);
            started.map(|(recorder, sink)| Recording { recorder, sink }).map_err(|error| error.to_string())
        });
        let Ok(Recording { sink, .. }) = recording else { return };
        while settings.log_time == LogTime::Tick && sink.room() == 0 {
            std::thread::sleep(LOOK);
        }
        sink.push(tick);
    }
}

impl Recording {
    /// Finishes the files. An error of the recorder is the first since its start, and outlives the disk that was full: the file that
    /// followed may hold every row, so the last that was finished counts.
    fn finish(self) -> KeptRecording {
        let Recording { recorder, sink: _sink } = self;
        let health = recorder.health();
        match recorder.finish() {
            Ok(summary) => KeptRecording {
                path: Some(summary.path),
                problem: None,
                ticks: summary.ticks,
                ticks_dropped: summary.ticks_dropped,
            },
            // Whoever asks a disk that does not answer waits as well, and so would the end of the run.
            Err(error @ RecordError::Hangs { .. }) => KeptRecording::none(error.to_string()),
            Err(error) => {
                let path = health.last_finished();
                let in_it = path.as_deref().and_then(|path| read_mcap(path).ok()).map_or(0, |file| file.ticks.len());
                KeptRecording {
                    path,
                    problem: Some(error.to_string()),
                    ticks: in_it as u64,
                    ticks_dropped: health.ticks_dropped() + health.ticks_lost(),
                }
            }
        }
    }
}
