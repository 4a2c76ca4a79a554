//! How much authority a candidate has.

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
/// How fast authority moves, a tick: from nothing to all of it in half a second.
pub const AUTHORITY_PER_TICK: f64 = 0.04;

/// What comes next.
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

    /// The same way from its beginning: what was proved before the rig was vented is proved again, and what needed no proof
    /// needs none.
    #[must_use]
    pub fn anew(&self) -> Self {
        match self.judged {
            Judged::Compared => Stages::from_shadow(),
            Judged::Watched => Stages::straight(),
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
                match self.retrials.grant(level, self.share.explains_errors()) {
                    true => self.pass(StageNow::Retrial),
                    false => Next::Lost(Loss::Worse),
                }
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
mod tests {
    use super::*;
    use crate::conduct::WIDE_TICKS;

    fn record() -> Record {
        let mut record = Record::default();
        (0..2000).for_each(|tick| add(&mut record, tick, 1.0));
        record
    }

    fn add(record: &mut Record, tick: u32, scale: f64) {
        let sign = if tick % 60 < 30 { scale } else { -scale };
        record.add([0, 1], [0.3 * sign, 0.2 * sign], [0.002, 0.002], false);
    }

    /// Ticks with errors `scale` times the record's, until something comes of it; the incumbent errs as it did.
    fn run(stages: &mut Stages, scale: f64, change: f64) -> (Vec<Next>, u32) {
        against(stages, scale, change, 1.0)
    }

    /// The same where the incumbent, measured once more, errs `later` times what it did.
    fn against(stages: &mut Stages, scale: f64, change: f64, later: f64) -> (Vec<Next>, u32) {
        let (mut all, mut record) = (Vec::new(), record());
        for tick in 0..60_000 {
            stages.begin_tick();
            let sign = if tick % 60 < 30 { 1.0 } else { -1.0 };
            let error_kpa = [0.3 * sign * scale, 0.2 * sign * scale];
            let part_duty = [0.1 * stages.authority(); 2];
            let shown = Shown { kinds: [0, 1], error_kpa, change_duty: [change; 2], filtered: false, part_duty };
            if stages.now().measures_incumbent() && stages.incumbent_alone() {
                add(&mut record, tick, later);
            }
            match stages.end_tick(&shown, &record) {
                Next::Stay => {}
                next => all.push(next),
            }
            if matches!(all.last(), Some(Next::Active | Next::Lost(_))) {
                return (all, tick);
            }
        }
        (all, 60_000)
    }

    #[test]
    fn as_good_a_candidate_goes_all_the_way() {
        let mut stages = Stages::from_shadow();
        let (all, ticks) = run(&mut stages, 1.0, 0.002);
        let ramp = |levels: std::ops::Range<usize>| levels.map(StageNow::Ramp);
        let mut expected: Vec<Next> = ramp(0..RECHECKED_LEVEL)
            .chain([StageNow::Recheck])
            .chain(ramp(RECHECKED_LEVEL..LEVELS.len()))
            .chain([StageNow::Probation])
            .map(Next::Passed)
            .collect();
        expected.push(Next::Active);
        assert_eq!(all, expected);
        // Five levels of some 800 ticks, the recheck, and some 3,500 in all of the command: within the ten minutes that are asked for.
        println!("{ticks} ticks");
        assert!((5_000..15_000).contains(&ticks), "{ticks}");
        assert_eq!(stages.authority(), 1.0);
    }

    #[test]
    fn a_worse_candidate_loses_it_on_the_first_level_once_the_incumbent_was_measured_again() {
        for scale in [1.8, 3.0] {
            let (all, _) = run(&mut Stages::from_shadow(), scale, 0.002);
            let again = [Next::Passed(StageNow::Retrial), Next::Passed(StageNow::Ramp(0))];
            let expected: Vec<Next> = [Next::Passed(StageNow::Ramp(0))]
                .into_iter()
                .chain([again; 4].into_iter().flatten())
                .chain([Next::Lost(Loss::Worse)])
                .collect();
            assert_eq!(all, expected, "{scale}");
        }
        let (all, _) = run(&mut Stages::from_shadow(), 1.0, 0.04);
        assert_eq!(all.last(), Some(&Next::Lost(Loss::Hunts)));
        let (all, ticks) = run(&mut Stages::straight(), 20.0, 0.002);
        assert_eq!((all.last(), ticks), (Some(&Next::Lost(Loss::FarOff)), WIDE_TICKS - 1));
    }

    /// The reference costs three times as much from now on, whoever controls: the record says otherwise until it is measured anew.
    #[test]
    fn a_stretch_that_costs_anybody_more_is_not_held_against_a_candidate() {
        let (all, ticks) = against(&mut Stages::from_shadow(), 3.0, 0.002, 3.0);
        println!("{ticks} ticks, {all:?}");
        assert_eq!(all[1..3], [Next::Passed(StageNow::Retrial), Next::Passed(StageNow::Ramp(0))]);
        assert_eq!(all.last(), Some(&Next::Active), "{all:?}");
    }

    #[test]
    fn what_was_as_good_as_an_incumbent_that_still_learned_is_found_out_by_the_recheck() {
        // The record of before is still half of what is known then.
        let (all, _) = against(&mut Stages::from_shadow(), 1.0, 0.002, 0.35);
        assert!(all.contains(&Next::Passed(StageNow::Recheck)), "{all:?}");
        assert_eq!(all.last(), Some(&Next::Lost(Loss::Worse)));
    }

    /// At 5 % of a command that is the incumbent's to a tenth of a per cent: the rig was knocked, or the incumbent errs.
    #[test]
    fn what_a_candidate_had_no_part_in_sends_it_back_to_the_shadow() {
        let record = record();
        for (part, expected) in [(0.0001, Next::Passed(StageNow::Shadow)), (0.01, Next::Lost(Loss::FarOff))] {
            let mut stages = Stages { authority: 0.05, ..Stages::at(StageNow::Ramp(0), Judged::Compared) };
            let far = Shown {
                kinds: [0; 2],
                error_kpa: [5.0, 0.1],
                change_duty: [0.0; 2],
                filtered: false,
                part_duty: [0.0, part],
            };
            let all: Vec<Next> = (0..WIDE_TICKS).map(|_| stages.end_tick(&far, &record)).collect();
            assert_eq!(all.last(), Some(&expected));
        }
    }

    /// A reference out of reach keeps whoever controls far off: the fallback, asked for by an operator, takes over all the same.
    #[test]
    fn what_an_operator_asks_for_takes_over_where_nobody_could_do_better() {
        let (mut stages, record) = (Stages::straight(), Record::default());
        let far =
            Shown { kinds: [0; 2], error_kpa: [5.0, 0.1], change_duty: [0.0; 2], filtered: false, part_duty: [0.0; 2] };
        let nexts: Vec<Next> = (0..PROBATION_TICKS).map(|_| stages.end_tick(&far, &record)).collect();
        assert!(nexts[..nexts.len() - 1].iter().all(|next| *next == Next::Stay), "{nexts:?}");
        assert_eq!(nexts.last(), Some(&Next::Active));
    }

    #[test]
    fn the_filter_ends_it_at_the_third_intervention() {
        let (mut stages, record) = (Stages::straight(), record());
        let shown =
            Shown { kinds: [0; 2], error_kpa: [0.0; 2], change_duty: [0.0; 2], filtered: true, part_duty: [0.1; 2] };
        assert_eq!(stages.end_tick(&shown, &record), Next::Stay);
        assert_eq!(stages.end_tick(&shown, &record), Next::Stay);
        assert_eq!(stages.end_tick(&shown, &record), Next::Lost(Loss::Filtered));
    }

    /// With a part in commands of an incumbent of which the filter bends a burst of ten every ten seconds, a candidate is not to
    /// blame for such bursts; for two thirds of all commands it is.
    #[test]
    fn interventions_that_the_incumbent_draws_by_itself_are_not_the_candidates() {
        let mut record = Record::default();
        for tick in 0..2000 {
            record.add([0, 1], [0.3, 0.2], [0.002, 0.002], tick % 500 < 10);
        }
        assert!((9.0..=10.0).contains(&record.most_bent()), "{}", record.most_bent());
        // Bent in so many of 50 ticks.
        for (bent, is_lost) in [(10, false), (33, true)] {
            let mut stages = Stages { authority: 0.05, ..Stages::at(StageNow::Ramp(0), Judged::Compared) };
            let nexts = (0..100).map(|tick| {
                let filtered = tick % 50 < bent;
                let shown =
                    Shown { kinds: [0; 2], error_kpa: [0.1; 2], change_duty: [0.0; 2], filtered, part_duty: [0.01; 2] };
                stages.end_tick(&shown, &record)
            });
            let nexts: Vec<Next> = nexts.collect();
            assert_eq!(nexts.contains(&Next::Lost(Loss::Filtered)), is_lost, "{bent} of 50");
        }
        for _ in 0..30 * 6000 {
            record.add([0, 1], [0.3, 0.2], [0.002, 0.002], false);
        }
        assert!(record.most_bent() < 1.0, "it is forgotten: {}", record.most_bent());
    }

    #[test]
    fn authority_never_jumps() {
        let mut stages = Stages::straight();
        let mut before = 0.0;
        for _ in 0..100 {
            let now = stages.begin_tick();
            assert!((now - before).abs() <= AUTHORITY_PER_TICK + 1e-12);
            before = now;
        }
        assert_eq!(before, 1.0);
    }
}
