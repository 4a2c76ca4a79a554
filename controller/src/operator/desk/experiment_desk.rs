//! Experiments in a running daemon, as operators ask for them: checked off the tick, played by it, recorded apart.
//!
//! An experiment belongs to nobody's connection: once a tick has taken it, it goes on whether or not the client that asked for
//! it stays. `controller disarm` ends it.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant};

use flight::Noter;
use proto::recording::EventLevel;
use serde::{Deserialize, Serialize};

use super::answers::one_line;
use crate::cycle::duty_source::{ExperimentPhase, ExperimentProgress};
use crate::experiment::experiment_log::{ExperimentLog, Kept, KeptRecording};
use crate::experiment::open_loop_playback::OpenLoopPlayback;
use crate::experiment::playback_report::PlaybackReport;
use crate::experiment::{Experiment, why_aborted};
use crate::machine::clock::now_ns;
use crate::operator::mailbox::OperatorMailbox;
use crate::operator::peer::Peer;

/// Time that the recorder may take to see the last tick of an experiment before its recording is finished without it:
/// after a lost link there is no tick that would show the end.
const LAST_TICKS: Duration = Duration::from_secs(1);

/// An experiment in a running daemon, as those who ask are told.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ExperimentView {
    /// Number in this run, from 1.
    pub number: u64,
    /// The file, as it was named.
    pub file: String,
    /// The model that it was checked on.
    pub model: String,
    /// Rows that it has.
    pub rows: u32,
    /// Rows with the pump off, by lines of the file; absent where it always runs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pump_off: Option<String>,
    /// Least and largest pressure by the model, per channel, in kPa gauge.
    pub forecast_kpa: [[f64; 2]; 2],
    /// Phase; absent once it is over.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub phase: Option<ExperimentPhase>,
    /// Rows that were sent.
    #[serde(default)]
    pub reached: u32,
    /// Outcome, once its recording is finished.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outcome: Option<ExperimentOutcome>,
}

/// Outcome of an experiment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ExperimentOutcome {
    /// Reason why it did not come to its end, in a few words; absent: it did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub aborted: Option<String>,
    /// Recording: the last finished file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recording: Option<PathBuf>,
    /// Problem with the recording, or the reason why there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recording_problem: Option<String>,
    /// Ticks in it, the rest before and after the rows included.
    pub ticks_recorded: u64,
    /// Ticks that could not be kept.
    pub ticks_dropped: u64,
    /// Report of the cRIO.
    pub played: PlaybackReport,
}

/// The experiment that has been begun and is not concluded.
struct UnderWay {
    view: ExperimentView,
    peer: Peer,
    over: Option<Over>,
}

/// An experiment that the tick has handed back.
struct Over {
    since: Instant,
    ending: (EventLevel, String),
    aborted: Option<String>,
    finishing: Option<Receiver<Option<Kept>>>,
}

/// All experiments of a run.
pub(super) struct ExperimentDesk {
    log: ExperimentLog,
    count: u64,
    under_way: Option<UnderWay>,
    last: Option<ExperimentView>,
}

impl ExperimentDesk {
    /// None has been made yet.
    pub(super) fn new(log: ExperimentLog) -> Self {
        ExperimentDesk { log, count: 0, under_way: None, last: None }
    }

    /// Tells whether one is being played: nothing else is done meanwhile.
    pub(super) fn is_playing(&self) -> bool {
        self.under_way.as_ref().is_some_and(|under_way| under_way.over.is_none())
    }

    /// Tells whether another one may begin: none is being played, and the last one's recording is finished.
    pub(super) fn is_free(&self) -> bool {
        self.under_way.is_none()
    }

    /// Makes ready to record an experiment, before the tick is asked for it.
    pub(super) fn expect(&self, experiment: &Experiment) -> Box<OpenLoopPlayback> {
        self.log.expect(experiment);
        Box::new(OpenLoopPlayback::new(experiment.sequence.rows().into(), experiment.forecast.relay))
    }

    /// No tick took it.
    pub(super) fn not_begun(&self) {
        self.log.forget();
    }

    /// A tick took it.
    pub(super) fn begun(&mut self, experiment: &Experiment, peer: Peer) {
        self.count += 1;
        let view = ExperimentView {
            number: self.count,
            file: one_line(experiment.sequence.source()),
            model: experiment.rig.name.clone(),
            rows: u32::try_from(experiment.sequence.rows().len()).unwrap_or(u32::MAX),
            pump_off: experiment.sequence.pump_off(),
            forecast_kpa: experiment.forecast.range_kpa,
            phase: Some(ExperimentPhase::Settling),
            reached: 0,
            outcome: None,
        };
        self.under_way = Some(UnderWay { view, peer, over: None });
    }

    /// The newest experiment of the run, with how far it is.
    pub(super) fn view(&self, progress: Option<ExperimentProgress>) -> Option<ExperimentView> {
        let Some(under_way) = &self.under_way else { return self.last.clone() };
        let mut view = under_way.view.clone();
        if under_way.over.is_none()
            && let Some(progress) = progress
        {
            (view.phase, view.reached) = (Some(progress.phase), progress.reached);
        }
        Some(view)
    }

    /// Looks whether the experiment under way is over, and concludes it; waits for nothing.
    pub(super) fn look(&mut self, mailbox: &OperatorMailbox, notes: &Noter) {
        let Some(under_way) = &mut self.under_way else { return };
        if under_way.over.is_none()
            && let Some(playback) = mailbox.played()
        {
            under_way.view.reached = playback.reached();
            under_way.view.phase = None;
            let aborted = why_aborted(&playback, &under_way.view.file, under_way.view.pump_off.as_deref());
            under_way.over = Some(Over { since: Instant::now(), ending: playback.ending(), aborted, finishing: None });
        }
        let Some(over) = &mut under_way.over else { return };
        let Some(finishing) = &over.finishing else {
            if self.log.has_ended() || over.since.elapsed() > LAST_TICKS {
                over.finishing = Some(close_aside(self.log.clone(), over.ending.clone()));
            }
            return;
        };
        let kept = match finishing.try_recv() {
            Ok(kept) => kept,
            Err(TryRecvError::Empty) => return,
            Err(TryRecvError::Disconnected) => None,
        };
        let outcome = outcome(kept, over.aborted.clone());
        let UnderWay { view, peer, .. } = under_way;
        notes.note(
            now_ns(),
            level(&outcome),
            "operator",
            format!("experiment {} by {peer}: {}", view.file, told(&outcome)),
        );
        view.outcome = Some(outcome);
        self.last = self.under_way.take().map(|under_way| under_way.view);
    }
}

fn level(outcome: &ExperimentOutcome) -> EventLevel {
    let good = outcome.aborted.is_none() && outcome.recording_problem.is_none();
    if good { EventLevel::Info } else { EventLevel::Warning }
}

fn told(outcome: &ExperimentOutcome) -> String {
    let how = outcome.aborted.as_ref().map_or("played to its end".to_owned(), |why| format!("aborted: {why}"));
    match (&outcome.recording, &outcome.recording_problem) {
        (Some(path), None) => format!("{how}; recorded in {}", path.display()),
        (Some(path), Some(problem)) => {
            let (path, ticks) = (path.display(), outcome.ticks_recorded);
            format!("{how}; recorded in {path} with {ticks} ticks, and not all of it: {problem}")
        }
        (None, Some(problem)) => format!("{how}; not recorded apart: {problem}"),
        (None, None) => how,
    }
}

fn outcome(kept: Option<Kept>, aborted: Option<String>) -> ExperimentOutcome {
    let lost = || {
        let recording = KeptRecording::none("its recording was not begun".to_owned());
        Kept { recording, report: PlaybackReport::default() }
    };
    let Kept { recording, report } = kept.unwrap_or_else(lost);
    ExperimentOutcome {
        aborted,
        recording: recording.path,
        recording_problem: recording.problem,
        ticks_recorded: recording.ticks,
        ticks_dropped: recording.ticks_dropped,
        played: report,
    }
}

/// Finishes the recording on a thread of its own, or here where there is none to be had.
fn close_aside(log: ExperimentLog, ending: (EventLevel, String)) -> Receiver<Option<Kept>> {
    let (answer, from) = channel();
    let (elsewhere, last_line) = (log.clone(), ending.clone());
    let sender = answer.clone();
    let started = std::thread::Builder::new().name("experiment".to_owned()).spawn(move || {
        // The daemon may have ended.
        let _ = sender.send(elsewhere.close(last_line));
    });
    if started.is_err() {
        let _ = answer.send(log.close(ending));
    }
    from
}
