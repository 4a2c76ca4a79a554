//! Diagnosis of what was recorded, with experiments where it needs them and may have them.

use std::path::Path;

use proto::atomic_file;
use proto::diagnosis::{Diagnosis, Verdict};
use proto::recording::TickRecord;

use crate::excitation::{self, Spans};
use crate::journal::diagnosis_in;
use crate::programs::Console;
use crate::run::Adaptation;
use crate::settings::{Experiments, Search};
use crate::{AdaptError, make_folder, recorded};

/// Experiments at most; after two the recordings say what they can.
const MOST_EXPERIMENTS: usize = 2;
/// Shares of the valves' range that an experiment is tried with, where the daemon foresees that more would leave the limits.
const NARROWER: [f64; 3] = [1.0, 0.6, 0.35];
/// Multiples of the noise that a model may leave before another experiment is worth a minute of the rig. Chosen: what is found to its
/// end leaves one or two.
const MOST_LEFT: f64 = 3.0;

/// Tells whether a model leaves much more than noise, on rows that nothing was fitted to or in a fitted recording.
/// Several effects are then in it that one experiment does not part.
fn leaves_much(diagnosis: &Diagnosis) -> bool {
    diagnosis.unexplained.iter().any(|left| left.most_times_noise() > MOST_LEFT)
}

impl Adaptation {
    /// Diagnosis of what was recorded; with an experiment where it needs one and may have it.
    pub(crate) fn diagnose(&mut self, console: &mut dyn Console) -> Result<Diagnosis, AdaptError> {
        if self.journal.recordings.is_empty() {
            let stretches = self.recorded_before(console)?;
            let folder = make_folder(self.recordings_folder())?;
            self.journal.recordings = recorded::write_csv(&folder, &stretches)?;
            self.journal.keep(&self.out)?;
        }
        loop {
            let round = self.journal.experiments.len() + 1;
            let found = self.found_folder(round);
            if self.journal.found.as_ref() != Some(&found) {
                self.diagnose_into(&found, console)?;
                self.journal.found = Some(found.clone());
                self.journal.keep(&self.out)?;
            }
            let diagnosis = diagnosis_in(&found)?;
            console.say(&format!("{}: {}", diagnosis.verdict.as_str(), diagnosis.summary));
            let planned = diagnosis.next_experiment.as_ref().map(|name| found.join(name));
            let goes_on = match planned {
                // Tracking alone shows little of what a lag, a delay or a sticking valve does.
                _ if round == 1 && diagnosis.verdict != Verdict::Adequate => self.excite(console)?,
                Some(csv) if round <= MOST_EXPERIMENTS && self.may_experiment(console)? => {
                    self.experiment(&csv, console)?
                }
                _ if leaves_much(&diagnosis) => self.excite(console)?,
                _ => false,
            };
            if !goes_on {
                return Ok(diagnosis);
            }
        }
    }

    /// Has the daemon move the valves over the range that the reference needs, if it may be driven so and there is one more
    /// experiment to be had; `false` where it was not.
    pub(crate) fn excite(&mut self, console: &mut dyn Console) -> Result<bool, AdaptError> {
        let number = self.journal.experiments.len();
        if number >= MOST_EXPERIMENTS || !self.may_experiment(console)? {
            return Ok(false);
        }
        let path = self.model_before();
        let model = proto::rig_file::load(&path.to_string_lossy())?;
        let spans = Spans::of(&model, &self.reference()?).map_err(|error| AdaptError::file(&path, error))?;
        for share in NARROWER {
            // Vented, it would refuse each; what the recordings gave may be what explains that.
            match self.in_control(console) {
                Err(AdaptError::NotRunning { waits_for, .. }) if !waits_for.is_empty() => {
                    console.say(&format!("no experiment: the rig was vented ({waits_for})"));
                    return Ok(false);
                }
                in_control => in_control?,
            };
            let csv = self.excitation_file(number + 1);
            atomic_file::write(&csv, excitation::programme(&spans.narrowed(share), number).as_bytes())?;
            if self.experiment(&csv, console)? {
                return Ok(true);
            }
        }
        self.journal.experiment_allowed = Some(false);
        self.journal.keep(&self.out)?;
        Ok(false)
    }

    /// Has the daemon play an experiment; `false` where it does not, and the answer is what the recordings gave.
    fn experiment(&mut self, csv: &Path, console: &mut dyn Console) -> Result<bool, AdaptError> {
        let is_played = match self.daemon.experiment(csv, console) {
            Ok(recording) => {
                self.journal.experiments.push(recording);
                true
            }
            Err(AdaptError::Failed { said, .. }) => {
                console.say(&format!("not played: {said}"));
                false
            }
            Err(error) => return Err(error),
        };
        self.journal.keep(&self.out)?;
        Ok(is_played)
    }

    /// Newest stretches under control up to the end of the flight before. On a busy machine a rig in lockstep goes on far behind it before
    /// the daemon answers, and a hold says nothing of what moves.
    fn recorded_before(&self, console: &mut dyn Console) -> Result<Vec<Vec<TickRecord>>, AdaptError> {
        let (session, until) = match self.journal.diagnosed_until() {
            Some(end) => end,
            None => self.daemon.status(console)?.at,
        };
        recorded::stretches(&self.folders.recordings, session, until, self.journal.settings.diagnose_seconds)
    }

    fn diagnose_into(&mut self, found: &Path, console: &mut dyn Console) -> Result<(), AdaptError> {
        let text = |path: &Path| path.to_string_lossy().into_owned();
        let mut arguments = vec!["diagnose".to_owned()];
        if self.journal.settings.search == Search::Quick {
            arguments.push("--quick".to_owned());
        }
        arguments.extend(["--rig".to_owned(), text(&self.model_before())]);
        arguments.extend(self.journal.recordings.iter().chain(&self.journal.experiments).map(|path| text(path)));
        arguments.extend(["--out".to_owned(), text(found)]);
        self.computed(|this, console| this.daemon.programs.trainer(&arguments).done(console), console)?;
        Ok(())
    }

    /// Tells whether the rig may be driven by an experiment: as the command line says, or as the operator answers, once.
    fn may_experiment(&mut self, console: &mut dyn Console) -> Result<bool, AdaptError> {
        if let Some(allowed) = self.journal.experiment_allowed {
            return Ok(allowed);
        }
        if self.journal.settings.experiments == Experiments::Allowed {
            return Ok(true);
        }
        let allowed = console.ask(
            "Tracking alone does not show enough. May the rig be driven by an experiment (two at most, of two minutes at most, within the safety limits)?",
        );
        // Whoever stops everything has not answered: going on asks again.
        if console.stop() {
            return Err(AdaptError::Stopped);
        }
        if !allowed {
            console.say("no experiment; the answer is what the recordings give (--allow-experiment allows it)");
        }
        self.journal.experiment_allowed = Some(allowed);
        self.journal.keep(&self.out)?;
        Ok(allowed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::judging::tests::{START, Said, UNTIL, flown_before, forget};

    /// He is asked again where the run goes on; a No would forbid its experiments for good.
    #[test]
    fn a_ctrl_c_at_the_question_is_no_answer() {
        let mut adaptation = flown_before("asked", "");
        assert!(matches!(
            adaptation.may_experiment(&mut Said::stops_behind(adaptation.out.clone())),
            Err(AdaptError::Stopped)
        ));
        assert_eq!(adaptation.journal.experiment_allowed, None);
        assert!(!adaptation.may_experiment(&mut Said::default()).unwrap());
        assert_eq!(adaptation.journal.experiment_allowed, Some(false), "a No is one");
        forget(&adaptation);
    }

    /// Ticks that were recorded since the flight ended are no part of it, however late the daemon is asked: there is none to ask here.
    #[test]
    fn diagnosis_reads_the_flight_before_and_nothing_behind_it() {
        let mut adaptation = flown_before("diagnosed", "");
        let ends = |adaptation: &Adaptation| {
            let stretches = adaptation.recorded_before(&mut Said::default()).unwrap();
            let [stretch] = &stretches[..] else { panic!("{} stretches", stretches.len()) };
            [stretch[0].tick, stretch[stretch.len() - 1].tick]
        };
        let [first, last] = ends(&adaptation);
        assert!(first <= START && last == UNTIL - 1, "{first} {last}");
        // No more than was asked for, which is its newest part.
        adaptation.journal.settings.diagnose_seconds = 10.0;
        assert_eq!(ends(&adaptation), [UNTIL - 500, UNTIL - 1]);
        // An older program kept no place of the flight: the daemon says where it is, if there is one.
        adaptation.journal.flown[0].recorded = None;
        assert_eq!(adaptation.journal.diagnosed_until(), None);
        forget(&adaptation);
    }
}
