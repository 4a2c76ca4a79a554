//! How much authority a candidate has, and why it loses it.

use model::observation::{CHANNELS, Pair};

use crate::record::Record;
use crate::sequential_test::{SequentialTest, TestVerdict};

/// Least ticks in shadow: the past of ten ticks is full, the integral is where the incumbent's is.
const SHADOW_TICKS: u32 = 250;
/// Ticks that the incumbent's record must hold before anything is held against it: 20 s.
const RECORD_TICKS: u32 = 1000;
/// Authorities of the ramp, as shares of the command.
pub const LEVELS: [f64; 6] = [0.05, 0.1, 0.2, 0.4, 0.7, 1.0];
/// Least ticks on a level: the loop has settled twice.
const LEVEL_TICKS: u32 = 100;
/// Most ticks on a level; a candidate that is still undecided then is not as good as it should be. 60 s.
const MOST_LEVEL_TICKS: u32 = 3000;
/// Ticks in full authority before the way back is given up.
const PROBATION_TICKS: u32 = 500;
/// How fast authority moves, a tick: from nothing to all of it in half a second.
pub const AUTHORITY_PER_TICK: f64 = 0.04;
/// Ticks over which duties' changes and the safety filter's interventions are watched.
const WATCHED_TICKS: u32 = 50;
/// Interventions of the safety filter within them that end it.
const MOST_INTERVENTIONS: u32 = 3;
/// A candidate whose duties change by more than this (RMS a tick, in duty) and by three times the incumbent's hunts.
const CHATTER_DUTY: f64 = 0.025;
/// Errors beyond this many times the incumbent's RMS, and beyond [`WIDE_KPA`], for [`WIDE_TICKS`] end it at once; beyond
/// [`WIDE_WATCHED_KPA`] where an operator went back to what errs more.
const WIDE_RATIO: f64 = 6.0;
const WIDE_KPA: Pair = [2.0, 1.0];
const WIDE_WATCHED_KPA: Pair = [4.0, 3.0];
const WIDE_TICKS: u32 = 10;

/// Where a candidate stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StageNow {
    /// Computed, not used.
    Shadow,
    /// Part of the command; the level's place in [`LEVELS`].
    Ramp(usize),
    /// All of the command, with the way back open.
    Probation,
}

impl StageNow {
    /// The number that events carry: 0 shadow, 1 … 6 ramp, 7 probation.
    pub fn code(self) -> u8 {
        match self {
            StageNow::Shadow => 0,
            StageNow::Ramp(level) => level as u8 + 1,
            StageNow::Probation => LEVELS.len() as u8 + 1,
        }
    }

    /// The stage of a number.
    pub fn of_code(code: u8) -> Self {
        match usize::from(code) {
            0 => StageNow::Shadow,
            level if level <= LEVELS.len() => StageNow::Ramp(level - 1),
            _ => StageNow::Probation,
        }
    }
}

/// Why a candidate loses its authority.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Loss {
    /// It answered something that is not finite.
    NotFinite = 1,
    /// Its errors are worse than the incumbent's in like conditions.
    Worse = 2,
    /// It was not found as good within a minute on a level.
    Undecided = 3,
    /// The safety filter had to bend commands that it had a part in.
    Filtered = 4,
    /// Its duties hunt.
    Hunts = 5,
    /// The pressures went far off.
    FarOff = 6,
    /// An operator took it back.
    Withdrawn = 7,
    /// The rig was vented while it was in full authority.
    Vented = 8,
}

impl Loss {
    /// The loss of a number.
    pub fn of_code(code: u8) -> Option<Self> {
        [
            Loss::NotFinite,
            Loss::Worse,
            Loss::Undecided,
            Loss::Filtered,
            Loss::Hunts,
            Loss::FarOff,
            Loss::Withdrawn,
            Loss::Vented,
        ]
        .into_iter()
        .find(|loss| *loss as u8 == code)
    }

    /// One line for an operator, without the stage.
    pub fn reason(self) -> &'static str {
        match self {
            Loss::NotFinite => "answers something that is not finite",
            Loss::Worse => "its errors are worse than those of what it was to replace, in like conditions",
            Loss::Undecided => "not found as good as what it was to replace within a minute on one level",
            Loss::Filtered => "the safety filter had to bend its commands",
            Loss::Hunts => "its duties hunt",
            Loss::FarOff => "the pressures went far from the reference",
            Loss::Withdrawn => "taken back by an operator",
            Loss::Vented => "the rig was vented while it had authority",
        }
    }
}

/// What a tick showed, once the command was out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shown {
    /// Kinds of the tick.
    pub kinds: [usize; CHANNELS],
    /// Errors in kPa.
    pub error_kpa: Pair,
    /// Changes of the duties.
    pub change_duty: Pair,
    /// Whether the safety filter changed the command.
    pub filtered: bool,
}

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
}

/// What a candidate is held against.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Judged {
    /// The incumbent's errors, besides the rules on hunting, interventions and far-off pressures.
    Compared,
    /// Those rules alone: an operator may go back to what errs more than what controls now.
    Watched,
}

/// Sums over the ticks watched.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Watched {
    ticks: u32,
    interventions: u32,
    changes: Pair,
    wide: [u32; CHANNELS],
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
        Stages { now, judged, ticks: 0, test: SequentialTest::default(), authority: 0.0, watched: Watched::default() }
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
            StageNow::Shadow => 0.0,
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

    /// Judges a tick once its command is out.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn end_tick(&mut self, shown: &Shown, record: &Record) -> Next {
        self.ticks = self.ticks.saturating_add(1);
        if self.now == StageNow::Shadow {
            let known = self.ticks >= SHADOW_TICKS && record.ticks() >= RECORD_TICKS;
            return if known { self.pass(StageNow::Ramp(0)) } else { Next::Stay };
        }
        if let Some(loss) = self.watched.judge(shown, record, self.judged) {
            return Next::Lost(loss);
        }
        for c in (0..CHANNELS).filter(|_| self.judged == Judged::Compared) {
            if let Some(excess) = record.excess(c, shown.kinds[c], shown.error_kpa[c]) {
                self.test.add(c, excess);
            }
        }
        let verdict = self.test.verdict();
        match self.now {
            _ if verdict == TestVerdict::Worse => Next::Lost(Loss::Worse),
            StageNow::Ramp(level) if verdict == TestVerdict::AsGood && self.ticks >= LEVEL_TICKS => {
                let next = if level + 1 < LEVELS.len() { StageNow::Ramp(level + 1) } else { StageNow::Probation };
                self.pass(next)
            }
            StageNow::Ramp(_) if self.ticks >= MOST_LEVEL_TICKS => Next::Lost(Loss::Undecided),
            StageNow::Probation if self.ticks >= PROBATION_TICKS => Next::Active,
            _ => Next::Stay,
        }
    }

    fn pass(&mut self, to: StageNow) -> Next {
        *self = Stages { authority: self.authority, watched: self.watched, ..Stages::at(to, self.judged) };
        Next::Passed(to)
    }
}

impl Watched {
    fn judge(&mut self, shown: &Shown, record: &Record, judged: Judged) -> Option<Loss> {
        self.ticks += 1;
        // After a jump of the reference the slew limit holds anybody back.
        self.interventions += u32::from(shown.filtered && shown.kinds.iter().all(|kind| *kind < 2));
        let rms_kpa = record.rms_kpa();
        let wide_kpa = if judged == Judged::Compared { WIDE_KPA } else { WIDE_WATCHED_KPA };
        for c in 0..CHANNELS {
            self.changes[c] += shown.change_duty[c].powi(2);
            let wide = shown.error_kpa[c].abs() > (WIDE_RATIO * rms_kpa[c]).max(wide_kpa[c]);
            // After a jump of the reference anything may be far off.
            self.wide[c] = if wide && shown.kinds[c] < 2 { self.wide[c] + 1 } else { 0 };
        }
        if self.interventions >= MOST_INTERVENTIONS {
            return Some(Loss::Filtered);
        }
        if self.wide.iter().any(|ticks| *ticks >= WIDE_TICKS) {
            return Some(Loss::FarOff);
        }
        if self.ticks < WATCHED_TICKS {
            return None;
        }
        let hunts = (0..CHANNELS).any(|c| {
            let rms = (self.changes[c] / f64::from(self.ticks)).sqrt();
            rms > CHATTER_DUTY.max(3.0 * record.change_duty(c))
        });
        *self = Watched { wide: self.wide, ..Watched::default() };
        hunts.then_some(Loss::Hunts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record() -> Record {
        let mut record = Record::default();
        for tick in 0..2000 {
            let sign = if tick % 60 < 30 { 1.0 } else { -1.0 };
            record.add([0, 1], [0.3 * sign, 0.2 * sign], [0.002, 0.002]);
        }
        record
    }

    /// Ticks with errors `scale` times the record's, until something comes of it.
    fn run(stages: &mut Stages, scale: f64, change: f64) -> (Vec<Next>, u32) {
        let (mut all, record) = (Vec::new(), record());
        for tick in 0..30_000 {
            stages.begin_tick();
            let sign = if tick % 60 < 30 { 1.0 } else { -1.0 };
            let error_kpa = [0.3 * sign * scale, 0.2 * sign * scale];
            let shown = Shown { kinds: [0, 1], error_kpa, change_duty: [change; 2], filtered: false };
            match stages.end_tick(&shown, &record) {
                Next::Stay => {}
                next => all.push(next),
            }
            if matches!(all.last(), Some(Next::Active | Next::Lost(_))) {
                return (all, tick);
            }
        }
        (all, 30_000)
    }

    #[test]
    fn as_good_a_candidate_goes_all_the_way() {
        let mut stages = Stages::from_shadow();
        let (all, ticks) = run(&mut stages, 1.0, 0.002);
        let mut expected: Vec<Next> = (0..LEVELS.len()).map(|level| Next::Passed(StageNow::Ramp(level))).collect();
        expected.extend([Next::Passed(StageNow::Probation), Next::Active]);
        assert_eq!(all, expected);
        // Six levels, decided after some 900 ticks each: within the ten minutes that are asked for.
        assert!((3_000..30_000).contains(&ticks), "{ticks}");
        assert_eq!(stages.authority(), 1.0);
    }

    #[test]
    fn a_worse_candidate_loses_it_on_the_first_level() {
        for scale in [1.8, 3.0] {
            let (all, _) = run(&mut Stages::from_shadow(), scale, 0.002);
            assert_eq!(all, [Next::Passed(StageNow::Ramp(0)), Next::Lost(Loss::Worse)], "{scale}");
        }
        let (all, _) = run(&mut Stages::from_shadow(), 1.0, 0.04);
        assert_eq!(all.last(), Some(&Next::Lost(Loss::Hunts)));
        let (all, ticks) = run(&mut Stages::straight(), 20.0, 0.002);
        assert_eq!((all.last(), ticks), (Some(&Next::Lost(Loss::FarOff)), WIDE_TICKS - 1));
    }

    #[test]
    fn the_filter_ends_it_at_the_third_intervention() {
        let (mut stages, record) = (Stages::straight(), record());
        let shown = Shown { kinds: [0; 2], error_kpa: [0.0; 2], change_duty: [0.0; 2], filtered: true };
        assert_eq!(stages.end_tick(&shown, &record), Next::Stay);
        assert_eq!(stages.end_tick(&shown, &record), Next::Stay);
        assert_eq!(stages.end_tick(&shown, &record), Next::Lost(Loss::Filtered));
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
