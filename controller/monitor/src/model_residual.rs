//! Residuals of a model summed up: over five ticks, over half a second.
//!
//! A residual is what a tick leaves between the way that a chamber made and the way that its model foresaw
//! (`hypothesis`). One that stands still or drifts while the valves work against it shows in the sum over half a
//! second: with the true pressure D away from the reading the model, set to the reading, sees it fall back by D(1 − e^(−T/τ)),
//! and the reading does not.
//!
//! A model that is a poor one of its rig has residuals of its own. They are recorded: their mean over ten seconds is taken
//! off, and the limits are the wider the more they scatter, within [`Limits`]. What they scatter is recorded for each kind of motion of the
//! references by itself (`reference_motion`): at rest any model is a good one. What it leaves at rest depends on where it rests, so
//! a rest behind a motion is recorded anew.

use model::observation::CHANNELS;

use crate::reference_motion::Motion;

/// Ticks of the middle sum.
pub const SHORT: usize = 5;
/// Ticks of the long sum: half a second.
pub const LONG: usize = 25;
/// Ticks over which the record of the model's errors goes back: 20 s (chosen: a drift of 1 kPa/s is out of bounds before it
/// is taken for the model's own).
const RECORD_TICKS: f64 = 1_000.0;
/// Ticks of record from which on it narrows the limits: 10 s under control, of the same kind of motion.
const ENOUGH_RECORD: f64 = 500.0;
/// Ticks after arming in which the limits are [`ARMING_TIMES`] as wide: 2 s from the atmosphere to the reference, and the
/// half second over which sums go back.
const ARMING_TICKS: u32 = 125;
/// Effects that the model leaves out (lag, backlash, warm gas) move the pressures most while the chambers fill (measured on 6 rigs
/// around `bench`: at most 9.9 kPa in five ticks and 27 kPa in half a second, against 3.4 and 16 kPa later; on a rig whose valves
/// lag by 80 ms and have play, armed again after an experiment, 26.7 kPa; on 16 rigs of which each part is up to 20 % off, 38.5 kPa).
/// A reading that stands is found by a limit of its own.
const ARMING_TIMES: f64 = 5.0;
/// Limits while a quick motion or a jump of the references is felt, in multiples of the widest (measured on 20 rigs around `bench`, steps of 4
/// to 12 kPa and the same at 5 kPa/s behind holds of 10 to 25 s: at most 9.2 kPa in half a second, where the widest is 9).
const MOVING_TIMES: f64 = 1.2;
/// The most that limits are widened for a rig that is slower than its model.
const SLOW_TIMES: f64 = 4.0;
/// Ticks in which they come down from there: 1 s (measured: of 20 rigs around `bench` two leave 9.3 and 9.4 kPa at their
/// beginning, and less from then on).
const NARROWING_TICKS: u32 = 50;
/// Ticks after arming in which no record narrows the limits: 12.5 s, as in a first flight. Play and warm gas then leave more than
/// in the flight before (measured: 5.0 kPa in half a second at 4 s, armed again at once behind a stall, after eleven minutes that
/// had narrowed the limit to that).
const SETTLING_TICKS: u32 = ARMING_TICKS + 500;
/// Limits in multiples of the recorded scatter (chosen; see the figures in `docs/safety.md`).
const TIMES_SCATTER: f64 = 5.0;

/// Limits of residuals, in kPa.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Limit of the sum over five ticks: for a model without errors, and for any.
    pub short_kpa: [f64; 2],
    /// Limit of the sum over half a second: for a model without errors, and for any.
    pub long_kpa: [f64; 2],
    /// Limit of what the model foresees in half a second of a reading that stands (`crate::standing`).
    pub standing_kpa: f64,
}

impl Limits {
    /// The limits of the positive channel. Measured with the nominal model: a drift of 4 kPa/s makes 10 to 14 kPa in half a
    /// second before the true pressure is 15 kPa away, while 6 rigs around `bench` leave 7 kPa in 99 ticks of 100. A reading that stands:
    /// 60 rigs of which each part is up to 20 % off make 24 kPa at the most (up to 30 %: 32 kPa), a sensor that shows half from the
    /// start 38 to 50 kPa.
    pub const POSITIVE: Limits = Limits { short_kpa: [4.0, 8.0], long_kpa: [5.0, 9.0], standing_kpa: 28.0 };
    /// The limits of the negative channel, measured likewise: 20 kPa at 5 kPa away, and 17 kPa before the model's own
    /// error is known. The same rigs make 72 kPa at
    /// the most of a reading that stands.
    pub const NEGATIVE: Limits = Limits { short_kpa: [4.0, 8.0], long_kpa: [8.0, 25.0], standing_kpa: 90.0 };
    /// The limits by channel.
    pub const BY_CHANNEL: [Limits; CHANNELS] = [Limits::POSITIVE, Limits::NEGATIVE];
}

/// Measure by which a reading contradicts its model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Measure {
    /// The sum over five ticks, and not the one over half a second.
    ShortSum,
    /// The sum over half a second, whatever the one over five ticks says.
    LongSum,
    /// Another one than the sums: the reading rests where it should not (`crate::standing`).
    Standing,
}

/// Size by which a reading contradicts its model, and the measure that says so.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Excess {
    pub(crate) kpa: f64,
    pub(crate) by: Measure,
}

/// The record of one channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModelResidual {
    limits: Limits,
    last: [f64; LONG],
    filled: usize,
    mean: f64,
    recorded: f64,
    /// Ticks since the references rest.
    rested: f64,
    scatter: [Scatter; Motion::RECORDS],
    motion: Motion,
    since_armed: u32,
    slow_times: f64,
}

/// Mean squares of the sums over one kind of motion.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Scatter {
    short: f64,
    long: f64,
    ticks: f64,
}

impl ModelResidual {
    /// Nothing seen yet.
    pub fn new(limits: Limits) -> Self {
        ModelResidual {
            limits,
            last: [0.0; LONG],
            filled: 0,
            mean: 0.0,
            recorded: 0.0,
            rested: 0.0,
            scatter: [Scatter::default(); Motion::RECORDS],
            motion: Motion::Recorded(0),
            since_armed: 0,
            slow_times: 1.0,
        }
    }

    /// Begins anew after arming; what is known about the model stays.
    pub fn restart(&mut self) {
        (self.filled, self.since_armed) = (0, 0);
    }

    /// Takes a tick's residual in kPa, of a rig that is as quick as `share` of its model, while such a motion of the references is felt;
    /// answers the sum that is too large, if one is; of two the short one.
    ///
    /// # Real-time
    /// May run in the tick.
    pub(crate) fn push(&mut self, residual_kpa: f64, share: f64, motion: Motion) -> Option<Excess> {
        self.motion = motion;
        // Residuals of a slow rig are those of its model's quickness: the pressures differ by that share of them.
        self.slow_times = (1.0 / share).clamp(1.0, SLOW_TIMES);
        self.since_armed = self.since_armed.saturating_add(1);
        self.last.rotate_right(1);
        self.last[0] = residual_kpa;
        self.filled = (self.filled + 1).min(LONG);
        let (short, long) = (self.excess(SHORT), self.excess(LONG));
        let (narrow, wide) =
            (self.limit(self.limits.short_kpa, |s| s.short), self.limit(self.limits.long_kpa, |s| s.long));
        self.record(residual_kpa, short, long);
        let by = if self.filled >= LONG && long.abs() > wide { Measure::LongSum } else { Measure::ShortSum };
        if self.filled >= SHORT && short.abs() > narrow {
            return Some(Excess { kpa: short, by });
        }
        (by == Measure::LongSum).then_some(Excess { kpa: long, by })
    }

    /// Sum over half a second beyond the recorded mean, in kPa.
    pub(crate) fn long_kpa(&self) -> f64 {
        self.excess(LONG)
    }

    /// Sums over five ticks and half a second beyond the recorded mean, and their limits, in kPa: for the figures.
    pub fn figures_kpa(&self) -> [f64; 4] {
        let [short, long] = [self.limits.short_kpa, self.limits.long_kpa];
        [self.excess(SHORT), self.limit(short, |s| s.short), self.excess(LONG), self.limit(long, |s| s.long)]
    }

    fn excess(&self, ticks: usize) -> f64 {
        let sum: f64 = self.last.iter().take(ticks.min(self.filled)).sum();
        sum - self.mean * ticks.min(self.filled) as f64
    }

    fn limit(&self, [narrowest, most]: [f64; 2], mean_square: impl Fn(&Scatter) -> f64) -> f64 {
        let widest = if self.motion.is_quick() { MOVING_TIMES * most } else { most };
        // Of a model that nothing is known about the worst is assumed, and of a rig that was armed just now.
        let record = match self.motion {
            _ if self.since_armed < SETTLING_TICKS => None,
            Motion::Recorded(0) if self.rested < ENOUGH_RECORD => None,
            Motion::Recorded(place) => self.scatter.get(place),
            Motion::Jump => None,
        };
        let known = record
            .filter(|scatter| scatter.ticks >= ENOUGH_RECORD)
            .map_or(widest, |scatter| (TIMES_SCATTER * mean_square(scatter).sqrt()).clamp(narrowest, widest));
        // What a model leaves while the chambers fill is another thing than what it leaves in flight: no record narrows it.
        let (filling, flying) = (ARMING_TIMES * most, self.slow_times * known);
        let narrowed = f64::from(self.since_armed.saturating_sub(ARMING_TICKS)) / f64::from(NARROWING_TICKS);
        filling + narrowed.min(1.0) * (flying - filling)
    }

    /// The model's record; what is beyond the widest limit is no error of a model.
    fn record(&mut self, residual_kpa: f64, short: f64, long: f64) {
        if self.since_armed < ARMING_TICKS {
            return;
        }
        self.recorded = (self.recorded + 1.0).min(RECORD_TICKS);
        self.rested = if self.motion == Motion::Recorded(0) { (self.rested + 1.0).min(RECORD_TICKS) } else { 0.0 };
        let weight = 1.0 / if self.rested > 0.0 { self.rested } else { self.recorded };
        let [_, most] = self.limits.long_kpa;
        let bounded = |x: f64, most: f64| x.clamp(-most, most);
        self.mean += weight * (bounded(residual_kpa, most / LONG as f64) - self.mean);
        let Motion::Recorded(place) = self.motion else { return };
        if let Some(scatter) = self.scatter.get_mut(place).filter(|_| self.filled >= LONG) {
            scatter.ticks = (scatter.ticks + 1.0).min(RECORD_TICKS);
            scatter.short += (bounded(short, most).powi(2) - scatter.short) / scatter.ticks;
            scatter.long += (bounded(long, most).powi(2) - scatter.long) / scatter.ticks;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pushes a residual for so many ticks; the ticks at which it was found too large.
    fn found(record: &mut ModelResidual, residual_kpa: f64, ticks: u32) -> Vec<u32> {
        (0..ticks).filter(|_| record.push(residual_kpa, 1.0, Motion::Recorded(0)).is_some()).collect()
    }

    /// 1.2 kPa a tick, 30 in half a second, while the chambers fill: no model foresees better, however well it foresees flight.
    #[test]
    fn a_good_record_of_flight_does_not_narrow_the_limits_of_filling() {
        let mut record = ModelResidual::new(Limits::POSITIVE);
        assert_eq!(found(&mut record, 0.01, 2000), Vec::<u32>::new());
        assert!(record.figures_kpa()[3] < 5.1, "narrow by now: {:?}", record.figures_kpa());
        record.restart();
        assert_eq!(found(&mut record, 1.2, 50), Vec::<u32>::new(), "armed again");
        assert_eq!(found(&mut record, 0.0, 150), Vec::<u32>::new(), "and on the reference");
        assert!(!found(&mut record, 1.2, 25).is_empty(), "in flight the same is a wrong sensor");
    }

    /// 7 kPa in half a second, soon after arming: as much as that a rig may leave that has flown well before.
    #[test]
    fn a_good_record_narrows_nothing_while_a_rig_that_was_armed_again_settles() {
        let mut record = ModelResidual::new(Limits::POSITIVE);
        found(&mut record, 0.01, 2000);
        record.restart();
        assert_eq!(found(&mut record, 0.0, 200), Vec::<u32>::new());
        assert_eq!(found(&mut record, 0.28, 25), Vec::<u32>::new(), "4 s after arming");
        found(&mut record, 0.0, 1000);
        assert!(!found(&mut record, 0.28, 25).is_empty(), "in flight");
    }

    /// 7 kPa in half a second: as much as a step may leave on a rig that has rested long; the same of a rig at rest is a wrong sensor.
    #[test]
    fn a_long_rest_does_not_narrow_the_limits_of_a_step() {
        let mut record = ModelResidual::new(Limits::POSITIVE);
        found(&mut record, 0.01, 5000);
        assert!((0..25).all(|_| record.push(0.28, 1.0, Motion::Jump).is_none()));
        assert!((0..25).all(|_| record.push(0.01, 1.0, Motion::Jump).is_none()));
        // What it leaves where it rests from now on is recorded anew.
        assert_eq!(found(&mut record, 0.28, 25), Vec::<u32>::new());
        assert_eq!(found(&mut record, 0.01, 600), Vec::<u32>::new());
        assert!(!found(&mut record, 0.28, 25).is_empty());
    }

    /// More than any model leaves is found while they fill as well: 2 kPa a tick.
    #[test]
    fn what_no_model_leaves_is_found_while_the_chambers_fill() {
        let mut record = ModelResidual::new(Limits::POSITIVE);
        found(&mut record, 0.01, 2000);
        record.restart();
        assert!(!found(&mut record, 2.0, 25).is_empty());
    }

    /// 7 kPa in half a second: as much as a rig with play may leave while noise moves its valves, whose model moves with the noise. What is
    /// left then is recorded by itself, and narrows the limits of exploring at rest alone.
    #[test]
    fn a_long_rest_does_not_narrow_the_limits_of_exploring() {
        const EXPLORED: Motion = Motion::Recorded(3);
        let mut record = ModelResidual::new(Limits::POSITIVE);
        found(&mut record, 0.01, 5000);
        assert!((0..25).all(|_| record.push(0.28, 1.0, EXPLORED).is_none()));
        assert!((0..1000).all(|_| record.push(0.01, 1.0, EXPLORED).is_none()));
        let slow = [0.28, 0.01].map(|kpa| (0..25).all(|_| record.push(kpa, 1.0, Motion::Recorded(4)).is_none()));
        assert_eq!(slow, [true; 2], "and the references move slowly");
        assert!((0..1000).all(|_| record.push(0.01, 1.0, EXPLORED).is_none()));
        assert!((0..25).any(|_| record.push(0.28, 1.0, EXPLORED).is_some()), "a reading that drifts");
    }
}
