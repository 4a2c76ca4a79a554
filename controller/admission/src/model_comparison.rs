//! Two models on the same minutes of a run: which one foresees what came?
//!
//! Each model runs along with what was measured and sent, as MPObs does, and predicts the readings one and five ticks
//! ahead under the duties that were then really sent; the errors are compared: over all of the run, and second by second. The few
//! seconds in which a rig fills or an experiment jumps hold most of what any model errs, so they alone do not decide which model
//! foresees the run: where many more seconds speak for a model than against it, it may err more over all, unless that is far off.
//!
//! Only seconds in which a pressure moves count for it. While it rests, a model that says that nothing changes foresees it best,
//! however wrong it is: on a hold a sensor's lag of a second that the rig does not have would be preferred to the true rig. So
//! at rest a model is only refused where it is far off.

use model::observation::{AHEAD, CHANNELS, Pair};
use model::predict::Predictor;
use model::rig::{Rig, RigError};
use serde::{Deserialize, Serialize};

/// Ticks at the beginning of a stretch that do not count: what the models remember settles.
const SETTLING_TICKS: usize = 25;
/// Least ticks that count; below them nothing is said.
const LEAST_TICKS: usize = 500;
/// Ticks of a part of a run that is compared by itself: a second.
const PART_TICKS: usize = 50;
/// Most that a new model's errors may be of the old one's over all of a run, and where its seconds speak for it. Chosen.
const MOST_RATIO: f64 = 1.2;
const MOST_RATIO_IF_SPOKEN_FOR: f64 = 2.0;
/// Seconds that speak for a model are so many times those that speak against it. Chosen.
const MANY_MORE: usize = 3;
/// Errors below which all is one, in kPa.
const FLOOR_KPA: Pair = [0.02, 0.01];
/// Seconds in which a pressure must have moved for a comparison to count for it. Chosen.
const LEAST_MOVING_S: usize = 8;
/// By how much the means of fifths of a second must differ for a second to count as one of movement, in kPa: ten times
/// what the converter's noise makes of such means (0.02 and 0.002).
const MOVES_KPA: Pair = [0.2, 0.05];
/// Ticks of such a mean.
const MEAN_TICKS: usize = 10;
/// Errors five ticks ahead that are far off at rest, in kPa: three times what `dual_pressure` errs by on `bench`, where backlash and
/// delay are unknown to it; valves of ten times their area err by tens.
const FAR_OFF_KPA: f64 = 3.0;

/// A tick of a run: what was measured and what was sent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Tick of the cRIO; a jump begins a new stretch.
    pub tick: u32,
    /// Measured pressures, kPa gauge.
    pub measured_kpa: Pair,
    /// Duties that were sent.
    pub duty: Pair,
    /// Request to the pump to run, 1 or 0.
    pub pump_on: bool,
}

/// Root mean square errors of two models' predictions, in kPa.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ModelFigures {
    /// Ticks that were compared.
    pub ticks: usize,
    /// Seconds in which each pressure moved; its other figures are of these, or of all where they are too few.
    pub moving_s: [usize; CHANNELS],
    /// Errors of the model in force, one tick ahead and five.
    pub before_kpa: [Pair; 2],
    /// Errors of the new one.
    pub after_kpa: [Pair; 2],
    /// Seconds in which the new one's error five ticks ahead is clearly less than the old one's …
    pub better_s: [usize; CHANNELS],
    /// … and clearly more.
    pub worse_s: [usize; CHANNELS],
}

impl ModelFigures {
    /// Tells whether a pressure moved for long enough to say anything of the models.
    fn has_moved(&self, channel: usize) -> bool {
        self.moving_s[channel] >= LEAST_MOVING_S
    }

    /// Tells whether neither pressure moved for long enough, so that models are only told apart if they are far off.
    pub fn rested(&self) -> bool {
        (0..CHANNELS).all(|c| !self.has_moved(c))
    }

    /// Reason why the new model must not replace the old one, one line; `None` if it may.
    pub fn refusal(&self) -> Option<String> {
        let worse = |c: usize| {
            let of = |errors: [Pair; 2]| errors[1][c].hypot(FLOOR_KPA[c]);
            let (before, after) = (of(self.before_kpa), of(self.after_kpa));
            let is_spoken_for = self.better_s[c] > MANY_MORE * self.worse_s[c];
            let most = if is_spoken_for { MOST_RATIO_IF_SPOKEN_FOR } else { MOST_RATIO };
            let speaks_against = 2 * self.worse_s[c] > self.moving_s[c];
            let is_too_far = if self.has_moved(c) {
                after > most * before || speaks_against
            } else {
                after > FAR_OFF_KPA && after > most * before
            };
            // A model in force that came to no number stands in nobody's way.
            !after.is_finite() || is_too_far
        };
        let c = (0..CHANNELS).find(|&c| worse(c))?;
        let (seconds, when) = if self.has_moved(c) {
            (self.moving_s[c], "of movement")
        } else {
            ((self.ticks as f64 * 0.02) as usize, "at rest")
        };
        let side = ["positive", "negative"][c];
        Some(format!(
            "foresees the run worse than the model in force: over {seconds} s {when}, five ticks ahead, it errs by {:.3} kPa in the \
             {side} pressure, that one by {:.3}; less in {} seconds, more in {}",
            self.after_kpa[1][c], self.before_kpa[1][c], self.better_s[c], self.worse_s[c]
        ))
    }
}

/// Compares `new` with `old` on a run; `None` where the run is too short to say anything.
///
/// # Errors
/// If one of the rigs cannot be compiled.
pub fn compare(old: &Rig, new: &Rig, run: &[Sample]) -> Result<Option<ModelFigures>, RigError> {
    let (before, after) = (Errors::of(old, run)?, Errors::of(new, run)?);
    Ok((before.ticks >= LEAST_TICKS).then(|| ModelFigures {
        ticks: before.ticks,
        moving_s: before.moving_s(),
        before_kpa: before.rms_kpa(),
        after_kpa: after.rms_kpa(),
        better_s: before.parts_above(&after),
        worse_s: after.parts_above(&before),
    }))
}

/// Seconds that a run must go on without a gap until models can be compared on it; 0 where they can be.
pub fn seconds_lacking(run: &[Sample]) -> usize {
    let unseen = SETTLING_TICKS + AHEAD;
    let count: usize = stretches(run).map(|stretch| stretch.len().saturating_sub(unseen)).sum();
    // What a stretch that is still going on has left to settle counts as well.
    let settling = unseen.saturating_sub(stretches(run).last().map_or(0, <[Sample]>::len));
    if count >= LEAST_TICKS { 0 } else { (LEAST_TICKS - count + settling).div_ceil(PART_TICKS) }
}

/// A predictor that has run along with the newest stretch of a run.
///
/// # Errors
/// If the rig cannot be compiled.
pub fn warmed(rig: &Rig, run: &[Sample]) -> Result<Predictor, RigError> {
    let mut predictor = Predictor::new(rig)?;
    if let Some(newest) = stretches(run).last() {
        run_along(&mut predictor, newest, |_, _| {});
    }
    Ok(predictor)
}

/// Squares of a model's errors over a run, in kPa².
struct Errors {
    /// Ticks that count.
    ticks: usize,
    /// Each second of them.
    parts: Vec<Part>,
}

/// A second of a run.
#[derive(Debug, Clone, Copy, Default)]
struct Part {
    ticks: usize,
    /// Sums of squares, one tick ahead and five.
    sums: [Pair; 2],
    /// Sum of the readings since the last mean was taken.
    reading_sum: Pair,
    /// Least and largest mean of readings, once there is one.
    means: Option<[Pair; 2]>,
}

impl Part {
    fn add(&mut self, measured_kpa: Pair, squares: [Pair; 2]) {
        self.ticks += 1;
        for (sum, square) in self.sums.iter_mut().flatten().zip(squares.iter().flatten()) {
            *sum += square;
        }
        for (sum, reading) in self.reading_sum.iter_mut().zip(measured_kpa) {
            *sum += reading;
        }
        if self.ticks.is_multiple_of(MEAN_TICKS) {
            let mean = self.reading_sum.map(|sum| sum / MEAN_TICKS as f64);
            self.reading_sum = [0.0; CHANNELS];
            let [least, most] = self.means.unwrap_or([mean; 2]);
            self.means =
                Some([std::array::from_fn(|c| least[c].min(mean[c])), std::array::from_fn(|c| most[c].max(mean[c]))]);
        }
    }

    fn moves(&self, channel: usize) -> bool {
        self.means.is_some_and(|[least, most]| most[channel] - least[channel] > MOVES_KPA[channel])
    }
}

impl Errors {
    fn of(rig: &Rig, run: &[Sample]) -> Result<Self, RigError> {
        let mut predictor = Predictor::new(rig)?;
        let mut errors = Errors { ticks: 0, parts: Vec::new() };
        for stretch in stretches(run) {
            let mut at = 0;
            run_along(&mut predictor, stretch, |predicted, ahead| {
                at += 1;
                if at > SETTLING_TICKS && ahead.len() >= AHEAD {
                    let squares = [0, AHEAD - 1].map(|place| {
                        std::array::from_fn(|c| (predicted[place][c] - ahead[place].measured_kpa[c]).powi(2))
                    });
                    errors.add(ahead[0].measured_kpa, squares);
                }
            });
        }
        Ok(errors)
    }

    fn add(&mut self, measured_kpa: Pair, squares: [Pair; 2]) {
        if self.ticks.is_multiple_of(PART_TICKS) {
            self.parts.push(Part::default());
        }
        self.ticks += 1;
        if let Some(part) = self.parts.last_mut() {
            part.add(measured_kpa, squares);
        }
    }

    fn moving_s(&self) -> [usize; CHANNELS] {
        std::array::from_fn(|c| self.parts.iter().filter(|part| part.moves(c)).count())
    }

    /// Over the seconds in which each pressure moved; over all, where it moved for too few.
    fn rms_kpa(&self) -> [Pair; 2] {
        let moving_s = self.moving_s();
        [0, 1].map(|place| {
            std::array::from_fn(|c| {
                let rested = moving_s[c] < LEAST_MOVING_S;
                let moving = self.parts.iter().filter(|part| rested || part.moves(c));
                let (sum, ticks) =
                    moving.fold((0.0, 0), |(sum, ticks), part| (sum + part.sums[place][c], ticks + part.ticks));
                (sum / ticks.max(1) as f64).sqrt()
            })
        })
    }

    /// Seconds of movement in which this model errs clearly more than another.
    fn parts_above(&self, other: &Errors) -> [usize; CHANNELS] {
        std::array::from_fn(|c| {
            let kpa = |part: &Part| (part.sums[1][c] / part.ticks.max(1) as f64).sqrt().hypot(FLOOR_KPA[c]);
            let pairs = self.parts.iter().zip(&other.parts).filter(|(this, _)| this.moves(c));
            pairs.filter(|(this, that)| kpa(this) > MOST_RATIO * kpa(that)).count()
        })
    }
}

/// Runs a predictor along a stretch; `seen` gets each tick's predictions and the samples that follow it.
fn run_along(predictor: &mut Predictor, stretch: &[Sample], mut seen: impl FnMut(&[Pair; AHEAD], &[Sample])) {
    let Some(first) = stretch.first() else { return };
    predictor.restart(first.measured_kpa, first.duty);
    for (at, sample) in stretch.iter().enumerate() {
        predictor.observe(sample.measured_kpa);
        let ahead = stretch.get(at + 1..).unwrap_or_default();
        // What was sent at τ … τ+4 leads to what was read at τ+1 … τ+5.
        let plan = std::array::from_fn(|j| stretch.get(at + j).or(stretch.last()).map_or(sample.duty, |s| s.duty));
        if ahead.len() >= AHEAD {
            seen(&predictor.predict(&plan, sample.pump_on), ahead);
        }
        predictor.advance(sample.duty, sample.pump_on);
    }
}

/// Parts of a run without a gap.
fn stretches(run: &[Sample]) -> impl Iterator<Item = &[Sample]> {
    run.chunk_by(|a, b| b.tick == a.tick.wrapping_add(1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::predict::DualPressureRig;

    /// A run of `bench` with duties that move, in two stretches.
    fn run(ticks: u32) -> Vec<Sample> {
        let mut plant = DualPressureRig::new(&Rig::builtin("bench").unwrap()).unwrap();
        (0..ticks)
            .map(|t| {
                let duty = [0.85 + 0.08 * (0.05 * f64::from(t)).sin(), 0.85 + 0.06 * (0.037 * f64::from(t)).cos()];
                let sample = Sample {
                    tick: t + 9 * u32::from(t > 400),
                    measured_kpa: plant.readings_kpa(),
                    duty,
                    pump_on: true,
                };
                plant.tick(duty, true);
                sample
            })
            .collect()
    }

    #[test]
    fn the_rig_itself_is_the_better_model_and_a_wrong_one_is_refused() {
        let (bench, nominal) = (Rig::builtin("bench").unwrap(), Rig::builtin("dual_pressure").unwrap());
        let run = run(1200);
        let better = compare(&nominal, &bench, &run).unwrap().unwrap();
        println!("{better:?}");
        assert!(better.refusal().is_none());
        assert!((0..2).all(|c| better.after_kpa[1][c] < 0.5 * better.before_kpa[1][c]), "{better:?}");
        assert!((0..2).all(|c| better.better_s[c] > 10 && better.worse_s[c] == 0), "{better:?}");
        // The other way round it is worse, and one of another size is much worse.
        assert!(compare(&bench, &nominal, &run).unwrap().unwrap().refusal().is_some());
        let mut large = nominal.clone();
        large.volumes.values_mut().for_each(|v| v.volume_l *= 4.0);
        let refused = compare(&bench, &large, &run).unwrap().unwrap().refusal().unwrap();
        assert!(refused.contains("worse than the model in force"), "{refused}");
    }

    /// A rig that fills in the minute that is compared: the model that is better all the time may be worse there.
    #[test]
    fn a_second_of_filling_does_not_speak_for_a_minute() {
        let figures = |all: f64, better: usize, worse: usize| ModelFigures {
            ticks: 3000,
            moving_s: [60; CHANNELS],
            before_kpa: [[0.2, 0.2], [0.58, 0.58]],
            after_kpa: [[0.2, 0.2], [0.58 * all, 0.58 * all]],
            better_s: [better; 2],
            worse_s: [worse; 2],
        };
        assert!(figures(1.38, 40, 3).refusal().is_none(), "better in most seconds");
        assert!(figures(1.38, 12, 3).refusal().is_none(), "better in most seconds that tell, and the rest is rest");
        assert!(figures(2.1, 40, 3).refusal().is_some(), "far off where it is");
        assert!(figures(1.38, 0, 3).refusal().is_some(), "no better anywhere");
        assert!(figures(1.38, 8, 6).refusal().is_some(), "about as often worse as better");
        assert!(figures(1.0, 10, 31).refusal().is_some(), "worse in most seconds");
        assert!(figures(f64::NAN, 40, 3).refusal().is_some());
        let before_is_none = ModelFigures { before_kpa: [[f64::NAN; CHANNELS]; 2], ..figures(1.0, 0, 0) };
        assert!(before_is_none.refusal().is_none(), "whatever foresees at all is better");
    }

    /// On a hold a model that says that nothing changes foresees best; it is not taken for the rig.
    #[test]
    fn a_hold_says_nothing() {
        let (bench, nominal) = (Rig::builtin("bench").unwrap(), Rig::builtin("dual_pressure").unwrap());
        let lag = "\n[[mechanisms]]\nid = \"sensor_lag\"\ncomponent = \"sensor_pos\"\ntime_constant_ms = 1000.0\n";
        let late = Rig::from_toml(&(nominal.to_toml().unwrap() + lag)).unwrap();
        let mut plant = DualPressureRig::new(&bench).unwrap();
        plant.start_from([90.0, -72.0], [0.88, 0.86]);
        let held: Vec<Sample> = (0..3000)
            .map(|tick| {
                let sample = Sample { tick, measured_kpa: plant.readings_kpa(), duty: [0.88, 0.86], pump_on: true };
                plant.tick([0.88, 0.86], true);
                sample
            })
            .skip(1500)
            .collect();
        for (old, new) in [(&nominal, &late), (&late, &bench), (&nominal, &bench)] {
            let figures = compare(old, new, &held).unwrap().unwrap();
            assert!(figures.refusal().is_none() && figures.rested(), "{figures:?}");
        }
        // What is far off shows at rest as well.
        let mut wide = nominal.clone();
        wide.valves.values_mut().for_each(|valve| {
            valve.input_area_mm2 *= 10.0;
            valve.pressure_area_mm2_per_n *= 10.0;
            valve.spring_area_mm2 *= 10.0;
        });
        let refused = compare(&nominal, &wide, &held).unwrap().unwrap().refusal().unwrap();
        assert!(refused.contains("s at rest"), "{refused}");
        // While it moves the rig itself is taken for the late one, and not the other way round.
        let moving = run(1200);
        assert!(compare(&late, &bench, &moving).unwrap().unwrap().refusal().is_none());
        let late = compare(&bench, &late, &moving).unwrap().unwrap();
        assert!(late.refusal().is_some() && !late.rested(), "{late:?}");
    }

    #[test]
    fn a_short_run_says_nothing() {
        let nominal = Rig::builtin("dual_pressure").unwrap();
        assert_eq!(compare(&nominal, &nominal, &run(300)).unwrap(), None);
        // In each stretch the first 25 ticks settle, and the last five have nothing ahead; one ends after 401.
        assert_eq!([0, 300, 410, 559].map(|ticks| seconds_lacking(&run(ticks))), [11, 5, 3, 1]);
        assert!(compare(&nominal, &nominal, &run(561)).unwrap().is_some() && seconds_lacking(&run(561)) == 0);
        assert!(warmed(&nominal, &[]).is_ok());
    }
}
