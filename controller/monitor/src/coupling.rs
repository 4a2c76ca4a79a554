//! The reading that is wrong where one contradicts its model: the pump carries gas from one chamber into the other.
//!
//! Each model is set to both readings in every tick. A negative reading that is off by D makes the pump of the model deliver another
//! amount into the positive chamber, so the residuals of both channels show it, and the positive channel, whose limits are the
//! narrower, may show it first. A positive reading that is off leaves hardly anything in the negative channel. So of a wrong
//! reading in channel c, and of a leak or a valve there, the sums R of half a second are
//!
//! ```text
//! R of the other channel between 0 and κ R of c        κ: what is left there of a constant error in c, by the model
//! ```
//!
//! (0 where the reading just moves off or the chamber leaks, κ R where it stands off). The channel that is named is the one from which
//! the other lies less far outside of this, in shares of the widest limits.

use model::observation::{CHANNELS, Pair};
use model::predict::Predictor;
use model::rig::{Rig, RigError};

use crate::model_residual::Limits;
use crate::monitor_models::{HELD_DUTY, HELD_KPA};

/// Error of a reading, in kPa to either side (chosen: the size at which wrong sensors are found).
const ERROR_KPA: f64 = 5.0;
/// Ticks in which valves and pump of the model settle before it is looked at, and ticks over which the effect is summed up: some
/// revolutions of any pump.
const SETTLING_TICKS: usize = 10;
const SUMMED_TICKS: usize = 50;

/// Effect of an error in either reading on the residual of the other channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Coupling {
    /// By channel: what a constant error of its reading leaves in the other channel, for each kPa that it leaves in its own.
    per_own: Pair,
}

impl Coupling {
    /// Coupling of a rig's chambers, by its model.
    ///
    /// # Errors
    /// If the rig cannot be flown.
    ///
    /// # Real-time
    /// Allocates and simulates some seconds; not for the tick.
    pub(crate) fn of(rig: &Rig) -> Result<Self, RigError> {
        let mut model = Predictor::new(rig)?;
        let per_own = std::array::from_fn(|c| {
            let mut left = |error_kpa: f64| {
                let mut readings_kpa = HELD_KPA;
                readings_kpa[c] += error_kpa;
                left_by_kpa(&mut model, readings_kpa)
            };
            let (above, below) = (left(ERROR_KPA), left(-ERROR_KPA));
            let of = |channel: usize| above[channel] - below[channel];
            let share = of(1 - c) / of(c);
            // A model that comes to no numbers there says nothing of it.
            if share.is_finite() { share } else { 0.0 }
        });
        Ok(Coupling { per_own })
    }

    /// Channel whose reading, chamber or valve explains the sums of both residuals better, for one whose sum passed its limit; of several
    /// hypotheses the one that explains most counts.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub(crate) fn named(self, found: usize, sums_kpa: impl Iterator<Item = Pair> + Clone) -> usize {
        let unexplained =
            |by: usize| sums_kpa.clone().map(|sums| self.unexplained(by, sums)).fold(f64::INFINITY, f64::min);
        let other = 1 - found;
        if unexplained(other) < unexplained(found) { other } else { found }
    }

    /// Part of the other channel's sum that an error in channel `by` does not explain, as a share of its widest limit.
    fn unexplained(self, by: usize, sums_kpa: Pair) -> f64 {
        let most = self.per_own[by] * sums_kpa[by];
        let sum = sums_kpa[1 - by];
        let [_, widest_kpa] = Limits::BY_CHANNEL[1 - by].long_kpa;
        (sum - sum.clamp(most.min(0.0), most.max(0.0))).abs() / widest_kpa
    }
}

/// Sums of what such readings, constant, leave of the model in each channel, kPa.
fn left_by_kpa(model: &mut Predictor, readings_kpa: Pair) -> Pair {
    model.restart(readings_kpa, HELD_DUTY);
    let mut sums = [0.0; CHANNELS];
    for tick in 0..SETTLING_TICKS + SUMMED_TICKS {
        model.observe(readings_kpa);
        if tick >= SETTLING_TICKS {
            for (sum, left) in sums.iter_mut().zip(model.added_kpa()) {
                *sum += left;
            }
        }
        model.advance(HELD_DUTY, true);
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    const POSITIVE: usize = 0;
    const NEGATIVE: usize = 1;

    fn named(rig: &str, found: usize, sums_kpa: Pair) -> usize {
        Coupling::of(&Rig::builtin(rig).unwrap()).unwrap().named(found, std::iter::once(sums_kpa))
    }

    /// Less gas in the negative chamber, less for the positive one; the other way nothing but what leaks past the cylinders' valves.
    /// The figures of `dual_pressure` are those of `docs/safety.md`, good to 0.02.
    #[test]
    fn a_negative_reading_acts_on_the_positive_channel_and_hardly_the_other_way_round() {
        for rig in ["dual_pressure", "bench"] {
            let Coupling { per_own: [positive, negative] } = Coupling::of(&Rig::builtin(rig).unwrap()).unwrap();
            assert!((-0.6..-0.2).contains(&negative) && positive.abs() < 0.15, "{rig}: {positive} {negative}");
            if rig == "dual_pressure" {
                assert!((negative + 0.36).abs() < 0.02 && (positive + 0.10).abs() < 0.02, "{positive} {negative}");
            }
        }
    }

    /// Sums as flights on `bench` left them with the nominal model, at the tick in which the positive channel's passed its limit.
    #[test]
    fn sums_that_drifting_sensors_left_name_the_sensor() {
        for (sums_kpa, sensor) in [
            ([8.9, -24.1], NEGATIVE),
            ([9.0, -23.2], NEGATIVE),
            ([-9.1, 19.4], NEGATIVE),
            ([-9.1, -4.3], POSITIVE),
            ([10.0, -5.3], POSITIVE),
            ([-9.0, 0.2], POSITIVE),
        ] {
            assert_eq!(named("dual_pressure", POSITIVE, sums_kpa), sensor, "{sums_kpa:?}");
        }
    }

    #[test]
    fn a_leak_shows_in_its_own_channel_alone_and_is_named_there() {
        assert_eq!(named("dual_pressure", NEGATIVE, [0.0, 25.0]), NEGATIVE);
        assert_eq!(named("dual_pressure", POSITIVE, [-9.0, 0.0]), POSITIVE);
    }
}
