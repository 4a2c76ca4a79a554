//! Stages of a candidate's authority.

use model::observation::CHANNELS;

use crate::conduct::{Finding, Judged, Shown, Watched};
use crate::loss::Loss;
use crate::record::Record;
use crate::retrials::Retrials;
use crate::sequential_test::{SequentialTest, TestVerdict};
use crate::share::Share;
use crate::stage_now::{LAST_LEVEL, LEVELS, RECHECKED_LEVEL, StageNow};

/// Least ticks in shadow: the past of ten ticks is full, the integral is where the incumbent's is.
const SHADOW_TICKS: u32 = 250;
/// Ticks that the incumbent's record must hold before anything is held against it: 40 s.
const RECORD_TICKS: u32 = 2000;
/// Ticks before the incumbent is measured anew: what the candidate did has died away by then, 2 s.
const DIES_AWAY_TICKS: u32 = 100;
/// Ticks in which it is measured, 40 s.
const REMEASURED_TICKS: u32 = 2000;
/// Least ticks on the last level, all of the command.
const LAST_LEVEL_TICKS: u32 = 1000;
/// Least ticks on a level: the loop has settled twice.
const LEVEL_TICKS: u32 = 100;
/// Most ticks on a level; a candidate that is still undecided then is not as good as it should be. Three minutes.
const MOST_LEVEL_TICKS: u32 = 9000;
/// Ticks in full authority before the way back is given up.
const PROBATION_TICKS: u32 = 500;
/// Speed of authority, a tick: from nothing to all of it in half a second.
pub const AUTHORITY_PER_TICK: f64 = 0.04;

/// Next step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Next {
    /// On as it is.
    Stay,
    /// A stage was passed.
    Passed(StageNow),
    /// All are passed.
    Active,
    /// It has lost its authority.
    Lost(Loss),
}

/// A candidate's way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stages {
    now: StageNow,
    judged: Judged,
    ticks: u32,
    test: SequentialTest,
    authority: f64,
    watched: Watched,
    share: Share,
    retrials: Retrials,
}

impl Stages {
    /// From the shadow on.
    pub fn from_shadow() -> Self {
        Stages::at(StageNow::Shadow, Judged::Compared)
    }

    /// Straight into full authority, over half a second: for what has already been active, or by an operator's will.
    pub fn straight() -> Self {
        Stages::at(StageNow::Probation, Judged::Watched)
    }

    /// Straight into all of the command, over half a second, and active with that: for the fallback. It is what every other loss
    /// falls back on, so nothing is held against it and no probation could end otherwise.
    pub fn last_resort() -> Self {
        Stages::at(StageNow::Probation, Judged::Unquestioned)
    }

    /// Way from its beginning: what was proved before the rig was vented is proved again, and what needed no proof
    /// needs none.
    #[must_use]
    pub fn anew(&self) -> Self {
        match self.judged {
            Judged::Compared => Stages::from_shadow(),
            Judged::Watched => Stages::straight(),
            Judged::Unquestioned => Stages::last_resort(),
        }
    }

    fn at(now: StageNow, judged: Judged) -> Self {
        let test = SequentialTest::new(now.rigour());
        Stages {
            now,
            judged,
            ticks: 0,
            test,
            authority: 0.0,
            watched: Watched::default(),
            share: Share::default(),
            retrials: Retrials::default(),
        }
    }

    /// The stage.
    pub fn now(&self) -> StageNow {
        self.now
    }

    /// Ticks in it.
    pub fn ticks(&self) -> u32 {
        self.ticks
    }

    /// The test of this stage.
    pub fn test(&self) -> &SequentialTest {
        &self.test
    }

    /// The candidate's share of the command, 0 … 1.
    pub fn authority(&self) -> f64 {
        self.authority
    }

    /// Moves authority on toward the stage's, at the beginning of a tick.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn begin_tick(&mut self) -> f64 {
        let wanted = match self.now {
            StageNow::Shadow | StageNow::Recheck | StageNow::Retrial => 0.0,
            StageNow::Ramp(level) => LEVELS.get(level).copied().unwrap_or(1.0),
            StageNow::Probation => 1.0,
        };
        let step = (wanted - self.authority).clamp(-AUTHORITY_PER_TICK, AUTHORITY_PER_TICK);
        self.authority = (self.authority + step).clamp(0.0, 1.0);
        if (wanted - self.authority).abs() < 1e-9 {
            // Sums of steps do not meet a level to the last bit; full authority must be all of it.
            self.authority = wanted;
        }
        self.authority
    }

    /// Tells whether what the incumbent does is its own again: nothing of the candidate's share is left in it.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn incumbent_alone(&self) -> bool {
        self.authority == 0.0 && (!self.now.measures_incumbent() || self.ticks >= DIES_AWAY_TICKS)
    }

    /// Judges a tick once its command is out.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn end_tick(&mut self, shown: &Shown, record: &Record) -> Next {
        self.ticks = self.ticks.saturating_add(1);
        if self.judged == Judged::Unquestioned {
            return if self.authority >= 1.0 { Next::Active } else { Next::Stay };
        }
        match self.now {
            StageNow::Shadow if self.ticks >= SHADOW_TICKS && record.ticks() >= RECORD_TICKS => {
                return self.pass(StageNow::Ramp(0));
            }
            StageNow::Recheck if self.has_remeasured() => return self.pass(StageNow::Ramp(RECHECKED_LEVEL)),
            StageNow::Retrial if self.has_remeasured() => return self.pass(StageNow::Ramp(0)),
            StageNow::Shadow | StageNow::Recheck | StageNow::Retrial => return Next::Stay,
            StageNow::Ramp(_) | StageNow::Probation => {}
        }
        match self.watched.judge(shown, record, self.judged) {
            Some(Finding::Fault(loss)) => return Next::Lost(loss),
            // What is not held against the incumbent goes on: it would come back to the same place for ever.
            Some(Finding::NotIts) if self.judged == Judged::Watched => self.watched = Watched::default(),
            Some(Finding::NotIts) => {
                *self = self.with_history(Stages::from_shadow());
                return Next::Passed(self.now);
            }
            None => {}
        }
        self.share.add(shown.part_duty, shown.error_kpa);
        for c in (0..CHANNELS).filter(|_| self.judged == Judged::Compared) {
            if let Some(excess) = record.excess(c, shown.kinds[c], shown.error_kpa[c]) {
                self.test.add(c, excess);
            }
        }
        match self.now {
            StageNow::Ramp(level) if self.test.verdict() == TestVerdict::Worse => {
                let granted = if self.share.explains_errors() {
                    self.retrials.grant_explained(level)
                } else {
                    self.retrials.grant_unexplained(level)
                };
                if granted { self.pass(StageNow::Retrial) } else { Next::Lost(Loss::Worse) }
            }
            _ if self.test.verdict() == TestVerdict::Worse => Next::Lost(Loss::Worse),
            StageNow::Ramp(level) => self.on_level(level),
            StageNow::Probation if self.ticks >= PROBATION_TICKS => Next::Active,
            _ => Next::Stay,
        }
    }

    fn has_remeasured(&self) -> bool {
        self.ticks >= DIES_AWAY_TICKS + REMEASURED_TICKS
    }

    fn on_level(&mut self, level: usize) -> Next {
        let (least, next) = match level + 1 {
            RECHECKED_LEVEL => (LEVEL_TICKS, StageNow::Recheck),
            above if above <= LAST_LEVEL => (LEVEL_TICKS, StageNow::Ramp(above)),
            _ => (LAST_LEVEL_TICKS, StageNow::Probation),
        };
        if self.test.verdict() == TestVerdict::AsGood && self.ticks >= least {
            return self.pass(next);
        }
        if self.ticks >= MOST_LEVEL_TICKS { Next::Lost(Loss::Undecided) } else { Next::Stay }
    }

    fn pass(&mut self, to: StageNow) -> Next {
        *self = Stages { watched: self.watched, ..self.with_history(Stages::at(to, self.judged)) };
        Next::Passed(to)
    }

    /// A stage of the same candidate: authority goes on from where it is, and what it was forgiven is not forgotten.
    fn with_history(&self, stage: Stages) -> Self {
        Stages { authority: self.authority, retrials: self.retrials, ..stage }
    }
}

#[cfg(test)]
mod tests;
