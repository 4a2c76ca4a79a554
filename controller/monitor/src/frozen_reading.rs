//! A reading that stands still although it used to scatter.
//!
//! A converter's last bits never stand still on a living sensor: with noise of one step a reading repeats itself in one tick
//! of three, and twenty repeats in a row have a probability of 10⁻⁹. What a sensor without noise does is no matter for this
//! check: it scatters never, so standing still is nothing new; there the model has to tell ([`crate::model_residual`]).

/// Repeats in a row below which nothing is said, in ticks: 0.3 s (chosen).
const FEWEST_REPEATS: u32 = 15;
/// Probability of as many repeats by chance at which the reading counts as frozen (chosen: once in 10⁹ ticks is 231 days).
const CHANCE: f64 = 1e-9;
/// Ticks that the scatter must have been watched for.
const WATCHED: u32 = 100;
/// Share of the weight that one tick has in the scatter's record.
const WEIGHT: f64 = 0.02;
/// Share of ticks in which the reading must have turned round to count as scattering: noise does in about half of them, a
/// smooth course hardly ever (chosen).
const TURNS: f64 = 0.15;

/// Watches one voltage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrozenReading {
    last_v: f32,
    last_step_v: f32,
    repeats: u32,
    watched: u32,
    /// Share of ticks in which the reading changed, and in which it turned round.
    changes: f64,
    turns: f64,
}

impl FrozenReading {
    /// Nothing seen yet.
    pub fn new() -> Self {
        FrozenReading { last_v: f32::NAN, last_step_v: 0.0, repeats: 0, watched: 0, changes: 0.0, turns: 0.0 }
    }

    /// Takes a voltage; answers for how many ticks it has stood still once that cannot be chance.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn push(&mut self, volts: f32) -> Option<u32> {
        if volts == self.last_v {
            self.repeats = self.repeats.saturating_add(1);
            return (self.repeats >= self.needed()).then_some(self.repeats);
        }
        let step = volts - self.last_v;
        if step.is_finite() {
            // A frozen stretch that came to its end says nothing about how the reading scatters: only short ones count.
            for _ in 0..self.repeats.min(FEWEST_REPEATS) {
                self.record(0.0, 0.0);
            }
            let turned = step * self.last_step_v < 0.0;
            self.record(1.0, f64::from(u8::from(turned)));
            self.last_step_v = step;
        }
        (self.last_v, self.repeats) = (volts, 0);
        None
    }

    fn record(&mut self, change: f64, turn: f64) {
        self.watched = self.watched.saturating_add(1);
        self.changes += WEIGHT * (change - self.changes);
        self.turns += WEIGHT * (turn - self.turns);
    }

    /// Repeats that cannot be chance; so many that they never come where the reading does not scatter.
    fn needed(&self) -> u32 {
        if self.watched < WATCHED || self.turns < TURNS {
            return u32::MAX;
        }
        let repeats = CHANCE.ln() / (1.0 - self.changes.min(0.99)).ln();
        FEWEST_REPEATS.max(repeats.ceil() as u32)
    }
}

impl Default for FrozenReading {
    fn default() -> Self {
        FrozenReading::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::emulator::{PSE540A_R06, PSE541A_R06, Sensors};

    /// Readings of the emulated converter at a pressure that moves slowly.
    fn readings(count: u32, noise_v_rms: f64) -> Vec<f32> {
        let mut sensors = Sensors::new([PSE540A_R06, PSE541A_R06], noise_v_rms, 5);
        (0..count).map(|k| sensors.sample([90.0 + (f64::from(k) / 500.0).sin(), -70.0], [&[], &[]])[0]).collect()
    }

    #[test]
    fn a_living_sensor_never_is_frozen_and_a_dead_one_is_within_half_a_second() {
        let mut reading = FrozenReading::new();
        for (k, volts) in readings(200_000, Sensors::ADC_NOISE_V_RMS).into_iter().enumerate() {
            assert_eq!(reading.push(volts), None, "tick {k}");
        }
        let frozen = (1..100).find(|_| reading.push(1.36).is_some());
        assert!(frozen.is_some_and(|ticks| ticks <= 27), "{frozen:?}");
    }

    #[test]
    fn without_noise_standing_still_is_nothing_new() {
        let mut reading = FrozenReading::new();
        for volts in readings(5_000, 0.0) {
            assert_eq!(reading.push(volts), None);
        }
        assert!((0..1_000).all(|_| reading.push(1.36).is_none()));
    }
}
