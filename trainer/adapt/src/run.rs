//! The steps, one after the other, each kept in the journal once it is done.

use std::path::{Path, PathBuf};
use std::time::Duration;

use proto::atomic_file;
use proto::diagnosis::RigKind;
use proto::reference::Reference;

use crate::comparison::{Comparison, is_kept};
use crate::daemon::{Daemon, DaemonStatus, Vented};
use crate::journal::{BEFORE, Before, Journal};
use crate::outcome::Outcome;
use crate::paths::settled;
use crate::programs::{Console, Programs};
use crate::put_back::{Told, Unstoppable};
use crate::recorded::{self, Inside};
use crate::settings::{AdaptSettings, DaemonFolders};
use crate::tracking::Tracking;
use crate::worst::Since;
use crate::{AdaptError, found_in, make_folder};

/// Steps that are told.
const STEPS: usize = 7;
/// Name of the run of what controlled before, on the model that was found.
pub(crate) const WITH_MODEL: &str = "with the model";
/// Name of the run of the fallback on that model, where a policy controlled before.
pub(crate) const FALLBACK_ON_MODEL: &str = "fallback on the model";
/// Name of the run of the policy that was trained on it.
pub(crate) const WITH_POLICY: &str = "with the policy";
/// A rig that may stand still while this machine computes, as that of a rehearsal does.
pub trait Pausable {
    /// Stands still.
    fn pause(&mut self);
    /// Goes on.
    fn go_on(&mut self);
}

/// A rig that goes on.
#[derive(Debug, Clone, Copy)]
pub struct GoesOn;

impl Pausable for GoesOn {
    fn pause(&mut self) {}
    fn go_on(&mut self) {}
}

/// An adaptation.
pub struct Adaptation {
    pub(crate) out: PathBuf,
    pub(crate) journal: Journal,
    pub(crate) daemon: Daemon,
    pub(crate) folders: DaemonFolders,
    pub(crate) rig: Box<dyn Pausable>,
    /// Tick at which the reference that was begun last is over.
    pub(crate) moves_until: u32,
    /// The reference that the daemon was last seen to follow by this run's will or at its beginning, as the daemon names it.
    pub(crate) followed: Option<String>,
    /// Policy that was asked to take over, until it does: in between the daemon names the one before it.
    pub(crate) taking_over: Option<String>,
    /// Says whether it has been told that the daemon follows references of this run meanwhile.
    pub(crate) reference_told: Told,
}

impl Adaptation {
    /// Begins one; its folder is made once the rig has been found to be controlled.
    ///
    /// # Errors
    /// A configuration that cannot be read, a folder that holds an adaptation already.
    pub fn begin(
        settings: AdaptSettings,
        out: &Path,
        programs: Programs,
        rig: Box<dyn Pausable>,
    ) -> Result<Self, AdaptError> {
        found_in::no_adaptation(out)?;
        Self::of(Journal::new(settings), out, programs, rig)
    }

    /// Goes on with one.
    ///
    /// # Errors
    /// A folder that holds none.
    pub fn resume(out: &Path, programs: Programs, rig: Box<dyn Pausable>) -> Result<Self, AdaptError> {
        Self::of(Journal::read(out)?, out, programs, rig)
    }

    fn of(mut journal: Journal, out: &Path, programs: Programs, rig: Box<dyn Pausable>) -> Result<Self, AdaptError> {
        let out = settled(out)?;
        journal.found_again_in(&out);
        let config = journal.settings.config.clone();
        let folders = DaemonFolders::read(&config)?;
        let daemon = Daemon { programs, config };
        Ok(Adaptation {
            out,
            journal,
            daemon,
            folders,
            rig,
            moves_until: 0,
            followed: None,
            taking_over: None,
            reference_told: Told::NotYet,
        })
    }

    /// All steps; model and policy are as they were where one fails, and the daemon follows the operator's reference
    /// again however it ends.
    ///
    /// # Errors
    /// The step that failed; [`AdaptError::NotRestored`] and [`AdaptError::ReferenceLeft`] where the daemon did not
    /// take back what had been changed.
    pub fn go(&mut self, console: &mut dyn Console) -> Result<Outcome, AdaptError> {
        let done = self.steps(console);
        self.rig.go_on();
        let ended = match done {
            Ok(()) => self.put_reference_back(&mut Unstoppable(console)),
            Err(error) => {
                let is_restored = self.restore(console);
                if is_restored && matches!(error, AdaptError::Changed { .. }) {
                    self.journal.forget_before_uncounted();
                }
                self.note_worst(console);
                return Err(if is_restored { error } else { AdaptError::NotRestored(Box::new(error)) });
            }
        };
        self.note_worst(console);
        let outcome = Outcome::of(&self.journal, &self.out)?;
        outcome.write(&self.out)?;
        ended.map(|()| outcome)
    }

    fn steps(&mut self, console: &mut dyn Console) -> Result<(), AdaptError> {
        if self.journal.kept.is_some() {
            console.say("all its steps are done already");
            return Ok(());
        }
        console.step(1, STEPS, "what is there, and how well it tracks");
        let before = self.look(console)?;
        self.fly_before(console)?;
        console.step(2, STEPS, "what the model leaves out");
        loop {
            let diagnosis = self.diagnose(console)?;
            if diagnosis.rig.kind == RigKind::AsGiven {
                self.in_control(console)?;
                console.say("the model explains what was recorded; nothing is changed");
                return self.keep_what(BEFORE, console);
            }
            console.step(3, STEPS, "the model, in the daemon");
            match self.change_model(console) {
                Ok(()) => break,
                // It foresees what was just run worse than the one in force: what was recorded did not show enough.
                Err(AdaptError::Failed { said, .. }) if self.excite(console)? => {
                    console.say(&format!("{said}; asked again with one more experiment"));
                }
                Err(error) => return Err(error),
            }
        }
        console.step(4, STEPS, "what tracks best on this model");
        self.judge_before_again(console)?;
        let Some((mut kept, mut best)) = self.fly_on_the_model(&before, console)? else {
            console.say("on this model nothing tracks as well as what was there, so no policy is trained on it");
            return self.keep_before(WITH_MODEL, console);
        };
        console.step(5, STEPS, "a policy trained on the model");
        if !self.leaves_something(&best, console)? {
            return self.keep_better(&best, kept, console);
        }
        let policy = self.train(&before, console)?;
        if !self.has_learned(console)? {
            return self.keep_better(&best, kept, console);
        }
        console.step(6, STEPS, "the daemon's verdict on the policy");
        let verdict = self.publish(&policy, console)?;
        console.step(7, STEPS, "what came of it");
        if verdict.state == "active" {
            match self.fly_against(WITH_POLICY, kept, console)? {
                Some(after) if is_kept(&after, &best, self.journal.flown(BEFORE).as_ref()) => {
                    (kept, best) = (WITH_POLICY, after);
                }
                _ => {
                    console.say("it tracks worse than without, or gives away what was gained; what controlled before it goes on");
                    self.swap_to_incumbent(console)?;
                    self.wait_until_policy_is_not(&self.journal.published.clone().unwrap_or_default(), console)?;
                }
            }
        } else {
            console.say(&format!("the daemon refused it ({}); the model stays", verdict.why));
        }
        self.keep_better(&best, kept, console)
    }

    /// Keeps what tracks best where that is better than what was there before: what gains nothing is not worth a change
    /// of what controls.
    fn keep_better(&mut self, best: &Tracking, kept: &str, console: &mut dyn Console) -> Result<(), AdaptError> {
        match self.journal.flown(BEFORE).map(|before| Comparison::of(best, &before)) {
            Some(Comparison::Better) | None => return self.keep_what(kept, console),
            Some(Comparison::NoDifferent) => console.say("nothing of it tracks better than what was there"),
            Some(Comparison::Worse) => console.say("nothing of it tracks as well as what was there"),
        }
        self.keep_before(kept, console)
    }

    /// Puts model and policy back, and keeps that; `otherwise` is in control where the daemon does not take them back.
    fn keep_before(&mut self, otherwise: &str, console: &mut dyn Console) -> Result<(), AdaptError> {
        let is_put_back = self.put_back(console);
        if is_put_back {
            console.say("model and policy of before are put back");
        }
        self.keep_what(if is_put_back { BEFORE } else { otherwise }, console)
    }

    /// Notes what controls on which model, and keeps what stands in the newest recording. Nothing is made before the rig
    /// is controlled.
    fn look(&mut self, console: &mut dyn Console) -> Result<Before, AdaptError> {
        let is_found = self.journal.before.is_some() && self.journal.found.is_some();
        let status = if is_found { self.daemon.status(console)? } else { self.in_control(console)? };
        self.journal.since.get_or_insert_with(|| Since::now(status.at));
        self.note_followed(&status);
        if let Some(before) = self.journal.before.clone() {
            self.journal.keep(&self.out)?;
            return Ok(before);
        }
        found_in::no_other_run(Path::new(&status.reference))?;
        let inside = self.inside(console)?;
        if let Some(recorded) = &inside.config {
            found_in::same_rig(&self.daemon.config, recorded)?;
        }
        make_folder(self.out.clone())?;
        self.journal.keep(&self.out)?;
        make_folder(self.before_folder())?;
        atomic_file::write(&self.model_before(), &inside.model)?;
        atomic_file::write(&self.recorded_reference(), &inside.reference)?;
        let published = self.folders.policies.join(format!("{}.onnx", status.policy));
        let policy = std::fs::read(&published).ok().or(inside.policy);
        if let Some(policy) = policy.filter(|_| status.policy != crate::daemon::FALLBACK) {
            atomic_file::write(&self.policy_before(), &policy)?;
        }
        console.say(&format!("{} controls on the model {}", status.policy, status.model));
        let DaemonStatus { policy, model, reference, interventions, at, .. } = status;
        let before = Before { policy, model, reference, interventions, at };
        self.journal.before = Some(before.clone());
        self.journal.keep(&self.out)?;
        Ok(before)
    }

    /// Files in the newest recording, which an armed daemon begins within a second.
    fn inside(&self, console: &mut dyn Console) -> Result<Inside, AdaptError> {
        let what = "no recording in the daemon's folder";
        self.wait_for(what, Duration::from_secs(10), console, |this, _| recorded::newest(&this.folders.recordings))
    }

    /// A daemon that controls. Once another model is in force a rig that vented for the one before is worth a person's look:
    /// what was found may explain it.
    pub(crate) fn in_control(&self, console: &mut dyn Console) -> Result<DaemonStatus, AdaptError> {
        let is_explained = self.journal.model_line.is_some();
        self.daemon.in_control(if is_explained { Vented::WaitsForPerson } else { Vented::Fails }, console)
    }

    pub(crate) fn reference(&self) -> Result<Reference, AdaptError> {
        Ok(Reference::read(&self.recorded_reference())?)
    }

    fn keep_what(&mut self, what: &str, console: &mut dyn Console) -> Result<(), AdaptError> {
        let status = self.daemon.status(console)?;
        if let Some(before) = self.journal.before.as_ref().filter(|before| before.at.0 == status.at.0) {
            self.journal.ticks = u64::from(status.at.1.wrapping_sub(before.at.1));
            self.journal.interventions = status.interventions.checked_sub(before.interventions);
        }
        self.journal.kept = Some(what.to_owned());
        self.journal.keep(&self.out)
    }
}
