//! Putting back what an adaptation changed in the daemon: model and policy where it fails, the operator's reference at
//! every end.

use std::path::{Path, PathBuf};
use std::time::Duration;

use proto::reference::Reference;

use crate::AdaptError;
use crate::daemon::FALLBACK;
use crate::in_force::is_named;
use crate::journal::Journal;
use crate::programs::Console;
use crate::run::Adaptation;
use crate::{recorded, worst};

/// Time in which a recording holds the tick of now: it is flushed once a second.
const FLUSHED: Duration = Duration::from_secs(3);

impl Adaptation {
    /// The file that has the operator's reference: one that he has put in since, or his first, unless that is gone or has
    /// changed, then that of the recording.
    pub(crate) fn operators_reference(&self) -> PathBuf {
        let recorded = self.recorded_reference();
        let Some(before) = &self.journal.before else { return recorded };
        let named = |name: &str| self.daemon.config.parent().unwrap_or(Path::new("")).join(name);
        if let Some(since) = self.journal.put_in_since.as_deref().map(named).filter(|since| since.is_file()) {
            return since;
        }
        let own = named(&before.reference);
        let identity = |path: &Path| Reference::read(path).ok().map(|reference| reference.identity());
        let is_same = !before.reference.is_empty() && own.is_file() && identity(&own) == identity(&recorded);
        if is_same { own } else { recorded }
    }

    /// Says once, before the daemon follows a reference of this run, which one it will follow again and how.
    pub(crate) fn tell_of_reference(&mut self, console: &mut dyn Console) {
        if std::mem::replace(&mut self.reference_told, Told::Already) == Told::NotYet {
            console.say(&format!(
                "meanwhile the daemon follows references of this run; yours is put back at every end. Where this is killed: `{}`",
                self.daemon.text(&["reference", &self.operators_reference().to_string_lossy()])
            ));
        }
    }

    /// Has the daemon follow the operator's reference again, where it follows one of this run; one that the operator
    /// has put in since stays.
    pub(crate) fn put_reference_back(&mut self, console: &mut dyn Console) -> Result<(), AdaptError> {
        if self.journal.before.is_none() {
            return Ok(());
        }
        let operators = self.operators_reference();
        let arguments = ["reference", &operators.to_string_lossy()];
        let left = |error: AdaptError| AdaptError::ReferenceLeft {
            command: self.daemon.text(&arguments),
            why: error.to_string(),
        };
        let followed = self.daemon.status(console).map_err(left)?.reference;
        if !self.is_of_this_run(&followed) || is_named(&operators, &followed) {
            return Ok(());
        }
        self.daemon.tell(&arguments, console).map_err(left)?;
        Ok(())
    }

    /// Puts model, policy and reference back, as far as they were changed; whether all is as it was. What cannot be put
    /// back is told: a daemon keeps a model that foresees what it has just seen better than the one before.
    pub(crate) fn put_back(&mut self, console: &mut dyn Console) -> bool {
        let mut console = Unstoppable(console);
        let Some(before) = self.journal.before.clone() else { return true };
        let is_changed = self.journal.model_line.is_some() || self.journal.published.is_some();
        let mut is_restored = self.take_candidate_back(&mut console);
        let named = self.daemon.status(&mut console).map(|status| status.policy).ok();
        let policy = self.taking_over.take().or(named);
        let mut back = Vec::new();
        if self.journal.model_line.is_some() {
            back.push(vec!["model".to_owned(), self.model_before().to_string_lossy().into_owned()]);
        }
        if let Some(policy) = policy.filter(|policy| is_changed && *policy != before.policy) {
            // The policy that was trained on the model goes before it; the fallback follows the model at once, while a
            // policy takes minutes to take over.
            let at = if policy == FALLBACK { back.len() } else { 0 };
            back.insert(at, vec!["swap".to_owned(), before.policy.clone()]);
        }
        for arguments in back {
            let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
            let why = match self.daemon.try_to(&arguments, &mut console) {
                Ok(said) if said.status == Some(0) || said.last_line().contains(CONTROLS_ALREADY) => continue,
                Ok(said) => said.last_line(),
                Err(error) => error.to_string(),
            };
            console.say(&format!("not put back: {why}"));
            is_restored = false;
        }
        if let Err(error) = self.put_reference_back(&mut console) {
            console.say(&error.to_string());
            is_restored = false;
        }
        is_restored
    }

    /// Takes the published policy back where it is on its way to take over: left alone it would do so later; whether
    /// that is done.
    fn take_candidate_back(&self, console: &mut dyn Console) -> bool {
        let Some(name) = self.journal.published.as_ref().filter(|_| self.journal.verdict.is_none()) else {
            return true;
        };
        let is_candidate =
            self.daemon.policy(name, console).is_ok_and(|(state, _)| ON_THE_RIG.contains(&state.as_str()));
        if !is_candidate {
            return true;
        }
        let taken = self.swap_to_incumbent(console);
        if let Err(error) = &taken {
            console.say(&format!("not put back: {error}"));
        }
        taken.is_ok()
    }

    /// Has what controlled when the policy was published control on, or again. It is asked for by name: a rollback would go further back
    /// where the daemon has refused the policy meanwhile.
    pub(crate) fn swap_to_incumbent(&self, console: &mut dyn Console) -> Result<(), AdaptError> {
        let before = || self.journal.before.as_ref().map(|before| before.policy.clone());
        let incumbent = self.journal.incumbent.clone().or_else(before).unwrap_or_else(|| FALLBACK.to_owned());
        match self.daemon.tell(&["swap", &incumbent], console) {
            Err(AdaptError::Failed { said, .. }) if said.contains(CONTROLS_ALREADY) => Ok(()),
            said => said.map(drop),
        }
    }

    /// Puts all back where a step failed, and forgets what was changed, so that going on begins with it again.
    pub(crate) fn restore(&mut self, console: &mut dyn Console) -> bool {
        let is_restored = self.put_back(console);
        if is_restored {
            self.journal.forget_changes();
        }
        self.keep_begun(console);
        is_restored
    }

    /// Adds the worst pressures of this sitting, which is over, to those of the ones before.
    pub(crate) fn note_worst(&mut self, console: &mut dyn Console) {
        let Some(since) = self.journal.since else { return };
        self.wait_for_last_tick(console);
        match worst::since(&self.folders.recordings, &since) {
            Ok(worst) => self.journal.worst = worst::worse_of(self.journal.worst.take(), worst),
            Err(error) => console.say(&format!("the worst pressures of this sitting are not counted: {error}")),
        }
        self.journal.since = None;
        self.keep_begun(console);
    }

    /// Waits until the tick that the daemon is at now is recorded, if it is recorded at all.
    fn wait_for_last_tick(&self, console: &mut dyn Console) {
        let mut console = Unstoppable(console);
        let Ok(status) = self.daemon.status(&mut console) else { return };
        let (session, last) = status.at;
        let recorded = self.wait_for("the end of the recording", FLUSHED, &mut console, |this, _| {
            let ticks = recorded::between(&this.folders.recordings, session, last..last.wrapping_add(1))?;
            Ok((!ticks.is_empty()).then_some(()))
        });
        // A rig that is not controlled may not be recorded either; what is there counts.
        drop(recorded);
    }

    /// Keeps the journal of a run that has one.
    fn keep_begun(&self, console: &mut dyn Console) {
        if Journal::is_in(&self.out)
            && let Err(error) = self.journal.keep(&self.out)
        {
            console.say(&error.to_string());
        }
    }
}

/// Words with which the daemon refuses a swap to what controls.
const CONTROLS_ALREADY: &str = "controls already";

/// States of a policy that is tried on the rig.
const ON_THE_RIG: [&str; 5] = ["shadow", "ramp", "recheck", "retrial", "probation"];

/// State of a thing that is to be said once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Told {
    NotYet,
    Already,
}

/// A console that goes on to the end of what must be done.
pub(crate) struct Unstoppable<'a>(pub(crate) &'a mut dyn Console);

impl Console for Unstoppable<'_> {
    fn step(&mut self, number: usize, of: usize, what: &str) {
        self.0.step(number, of, what);
    }
    fn command(&mut self, command: &str) {
        self.0.command(command);
    }
    fn say(&mut self, text: &str) {
        self.0.say(text);
    }
    fn waiting(&mut self, what: &str, elapsed: Duration, most: Option<Duration>) {
        self.0.waiting(what, elapsed, most);
    }
    fn stop(&self) -> bool {
        false
    }
    fn ask(&mut self, _question: &str) -> bool {
        false
    }
}
