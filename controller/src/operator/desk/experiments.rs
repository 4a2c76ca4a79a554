//! An experiment as operators ask for it: checked off the tick, then begun by it or not at all.

use std::path::Path;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use proto::recording::attached;

use super::experiment_desk::ExperimentDesk;
use super::{Asked, AtWork, BUSY, Desk, LEFT, May, Step, What};
use crate::config::Safety;
use crate::experiment::Experiment;
use crate::experiment::command_sequence::CommandSequence;
use crate::operator::mailbox::{Fate, Request, Ticket};
use crate::operator::operator_protocol::{Ask, EFFECT_TIME, Switch, WORK_TIME};
use crate::operator::peer::Peer;
use crate::session::session_recorder::attachment;
use crate::state::State;

/// Answered where experiments cannot be played.
const NO_EXPERIMENTS: &str = "experiments cannot be played in this run";
/// Answered to what would come between.
pub(super) const UNDER_WAY: &str = "an experiment is under way; wait for its end, or disarm to stop it";

/// Result of a check: the experiment, or what is wrong with it.
type Checked = Result<Box<Experiment>, String>;

/// An experiment that is being checked.
pub(super) struct Checking {
    from: Receiver<(Checked, AtWork)>,
    name: String,
}

impl Checking {
    fn what(&self) -> String {
        format!("experiment {}", self.name)
    }
}

/// An experiment that the tick is asked to begin.
pub(super) struct Beginning {
    ticket: Ticket,
    experiment: Box<Experiment>,
    /// No other experiment is checked, no policy or model changed, until it has begun.
    _at_work: AtWork,
}

impl Desk {
    /// Looks whether an experiment is over, and concludes it.
    pub fn look_after_experiments(&mut self) {
        if let Some(experiments) = &mut self.experiments {
            experiments.look(&self.options.mailbox, &self.options.notes);
        }
    }

    /// Tells whether an experiment is under way and this would come between: everything but looking on and stopping, and where
    /// something waits for a person after it was stopped, acknowledging.
    pub(super) fn comes_between(&self, ask: &Ask) -> bool {
        let within = self.experiments.as_ref().is_some_and(ExperimentDesk::is_playing);
        match ask {
            Ask::Status {} | Ask::Policies {} | Ask::Disarm {} | Ask::Explore { switch: Switch::Off, .. } => false,
            Ask::Acknowledge {} => self.options.may == May::OnlyStop,
            _ => within || self.options.may == May::OnlyStop,
        }
    }

    pub(super) fn begin_experiment(&mut self, file: &Path, csv: String, asked: Asked) -> Step {
        let name = file.display().to_string();
        match self.start_experiment(&name, csv) {
            Ok(from) => asked.taking(WORK_TIME).pending(What::Checking(Checking { from, name })),
            Err(why) => self.over(&format!("experiment {name}"), asked.peer, Err(why)),
        }
    }

    fn start_experiment(&mut self, name: &str, csv: String) -> Result<Receiver<(Checked, AtWork)>, String> {
        let (Some(experiments), Some(handle)) = (&self.experiments, &self.options.policies) else {
            return Err(NO_EXPERIMENTS.to_owned());
        };
        if !experiments.is_free() {
            return Err("the recording of the last experiment is being finished; try again".to_owned());
        }
        if self.is_working() {
            return Err(BUSY.to_owned());
        }
        self.why_no_experiment().map_or(Ok(()), Err)?;
        let models = handle.models.clone();
        check_aside(name.to_owned(), csv, self.at_work(), move || models.rig(), self.options.safety)
    }

    /// Reason why none can begin now: it begins from standing by or from control, and it is recorded.
    fn why_no_experiment(&self) -> Option<String> {
        let Some(status) = self.live_status() else { return Some(self.no_session()) };
        let ready = status.state == State::Run || status.can_arm;
        if !ready {
            let name = status.state.as_str();
            return Some(format!(
                "it is {name}; an experiment begins while it stands by and can be armed, or controls (`controller status`)"
            ));
        }
        self.options.health.why_not_arm().map(|problem| format!("it would not be recorded: {problem}"))
    }

    pub(super) fn look_at_check(&mut self, checking: Checking, asked: Asked) -> Step {
        let late = asked.is_late();
        // Told at once: the check may go on for a minute.
        if let Some(why) = self.stopped_since(asked) {
            return self.over(&checking.what(), asked.peer, Err(why));
        }
        match checking.from.try_recv() {
            Ok((checked, at_work)) => self.experiment_checked(checked, at_work, &checking.what(), asked),
            Err(TryRecvError::Empty) if !late => asked.pending(What::Checking(checking)),
            Err(_) => {
                let why = format!("it was not checked within {} s", WORK_TIME.as_secs());
                self.over(&checking.what(), asked.peer, Err(why))
            }
        }
    }

    /// The client has left before its experiment was checked.
    pub(super) fn leave_check(&mut self, checking: &Checking, peer: Peer) {
        self.record(&checking.what(), peer, &Err(LEFT.to_owned()));
    }

    fn experiment_checked(&mut self, checked: Checked, at_work: AtWork, what: &str, asked: Asked) -> Step {
        let experiment = match checked {
            Ok(experiment) => experiment,
            Err(why) => {
                self.record(what, asked.peer, &Err(why.clone()));
                let mut reply = self.reply(Err(why));
                reply.bad_input = true;
                return Step::Done(Box::new(reply));
            }
        };
        match self.ask_to_begin(&experiment, asked) {
            Ok(ticket) => {
                asked.taking(EFFECT_TIME).pending(What::Experiment(Beginning { ticket, experiment, _at_work: at_work }))
            }
            Err(why) => {
                self.experiments.iter().for_each(ExperimentDesk::not_begun);
                self.over(what, asked.peer, Err(why))
            }
        }
    }

    fn ask_to_begin(&self, experiment: &Experiment, asked: Asked) -> Result<Ticket, String> {
        self.why_no_experiment().map_or(Ok(()), Err)?;
        let Some(experiments) = &self.experiments else { return Err(NO_EXPERIMENTS.to_owned()) };
        if !experiments.is_free() {
            return Err(UNDER_WAY.to_owned());
        }
        self.ask_tick(Request::Experiment(experiments.expect(experiment)), asked.since)
    }

    pub(super) fn look_at_beginning(&mut self, beginning: Beginning, asked: Asked) -> Step {
        let late = asked.is_late();
        match self.options.mailbox.fate(beginning.ticket) {
            Fate::Waiting if !late => asked.pending(What::Experiment(beginning)),
            _ => self.experiment_settled(&beginning, asked),
        }
    }

    /// The tick has taken the experiment, or never will.
    pub(super) fn experiment_settled(&mut self, beginning: &Beginning, asked: Asked) -> Step {
        let peer = asked.peer;
        let Beginning { ticket, experiment, .. } = beginning;
        let what = format!("experiment {}", experiment.sequence.source());
        if self.options.mailbox.withdraw(*ticket) {
            self.experiments.iter().for_each(ExperimentDesk::not_begun);
            let why = if self.options.mailbox.fate(*ticket) == Fate::Fell {
                self.why_fell(asked)
            } else {
                format!("no tick took it; {}", self.no_session())
            };
            return self.over(&what, peer, Err(why));
        }
        if let Some(experiments) = &mut self.experiments {
            experiments.begun(experiment, peer);
        }
        self.options.notes.attach(attachment(attached::EXPERIMENT, "text/csv", experiment.sequence.bytes()));
        self.over_saying(&what, peer, Ok("the experiment has begun".to_owned()))
    }
}

/// Checks an experiment on a thread of its own: simulating two minutes takes about a second of computing.
///
/// # Errors
/// The system gives no thread.
fn check_aside(
    name: String,
    csv: String,
    at_work: AtWork,
    rig: impl FnOnce() -> model::rig::Rig + Send + 'static,
    safety: Safety,
) -> Result<Receiver<(Checked, AtWork)>, String> {
    let (answer, from) = channel();
    let work = move || {
        let checked = CommandSequence::parse(&name, csv.into_bytes())
            .map_err(|error| error.to_string())
            .and_then(|sequence| Experiment::check(sequence, rig(), safety).map_err(|error| error.to_string()));
        // Who asked may have gone.
        let _ = answer.send((checked.map(Box::new), at_work));
    };
    let started = std::thread::Builder::new().name("experiment".to_owned()).spawn(work);
    started.map(|_| from).map_err(|error| format!("no thread can be started to check it: {error}"))
}
