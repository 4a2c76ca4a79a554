//! A reading that stands still although it used to scatter.
//!
//! A converter's last bits never stand still on a living sensor: with noise of one step a reading repeats itself in one tick
//! of three, and twenty repeats in a row have a probability of 10⁻⁹. What a sensor without noise does is no matter for this
//! check: it scatters never, so standing still is nothing new; there the model has to tell ([`crate::model_residual`]).

/// Repeats in a row below which nothing is said, in ticks: 0.3 s (chosen).
const FEWEST_REPEATS: u32 = 15;
/// Probability of as many repeats by chance at which the reading counts as frozen (chosen: once in 10⁹ ticks is 231 days).
const CHANCE: f64 = 1e-9;
/// Ticks that the scatter must have been watched for (chosen: four turns among them are no smooth course, and a sensor that
/// stands by for half a second before it is armed is known).
const WATCHED: u32 = 20;
/// Weight of a tick in the scatter's record once that is long enough: one second.
const WEIGHT: f64 = 0.02;
/// Share of the recorded scatter that is counted on: the record of a second is uncertain by a seventh (derived: 50 ticks of
/// two in three).
const CAUTION: f64 = 0.8;
/// Share of ticks in which the reading must have turned round, by steps of two sizes, to count as scattering: the noise of an
/// NI 9205 does in a third of them, a course without noise never (chosen; of 2,000 sensors that froze 3.4 s after they were
/// first read 4 were not known to scatter by then, and none of 40 raised a false alarm in 2·10⁶ ticks).
const TURNS: f64 = 0.05;
/// Share of the changes that must be such turns as well. Less is a pressure on its way, whose changes end where it comes to rest. Measured under
/// control: of the noise of an NI 9205 0.24 to 0.34, in nine ticks of ten at least 0.16; a converter with a sixth of a step of noise had
/// stood still for 19 ticks behind a move of 5 kPa/s, which made it change in each tick.
const TURNS_OF_CHANGES: f64 = 0.15;

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
    /// Share of ticks with a change while it scattered; `None` until it did. On the way to another pressure a reading turns
    /// as little as a smooth course, and its noise has not gone.
    scatter: Option<f64>,
}

impl FrozenReading {
    /// Nothing seen yet.
    pub fn new() -> Self {
        FrozenReading {
            last_v: f32::NAN,
            last_step_v: 0.0,
            repeats: 0,
            watched: 0,
            changes: 0.0,
            turns: 0.0,
            scatter: None,
        }
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
            // Steps of one size only are a reading between two codes of its converter, which may come to lie on one of them
            // without being frozen.
            let turned = step * self.last_step_v < 0.0 && step.abs() != self.last_step_v.abs();
            self.record(1.0, f64::from(u8::from(turned)));
            self.last_step_v = step;
        }
        (self.last_v, self.repeats) = (volts, 0);
        None
    }

    fn record(&mut self, change: f64, turn: f64) {
        self.watched = self.watched.saturating_add(1);
        let weight = WEIGHT.max(1.0 / f64::from(self.watched));
        self.changes += weight * (change - self.changes);
        self.turns += weight * (turn - self.turns);
        if self.watched >= WATCHED && self.turns >= TURNS.max(TURNS_OF_CHANGES * self.changes) {
            // The least that was seen: where the reading lies between two codes matters, and chance is not to be its judge.
            self.scatter = Some(self.scatter.unwrap_or(1.0).min(CAUTION * self.changes));
        }
    }

    /// Repeats that cannot be chance; so many that they never come where the reading does not scatter.
    fn needed(&self) -> u32 {
        let Some(changes) = self.scatter else { return u32::MAX };
        let repeats = CHANCE.ln() / (1.0 - changes.clamp(0.01, 0.99)).ln();
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
    fn a_living_sensor_never_is_frozen_and_a_dead_one_is_soon() {
        let mut reading = FrozenReading::new();
        for (k, volts) in readings(200_000, Sensors::ADC_NOISE_V_RMS).into_iter().enumerate() {
            assert_eq!(reading.push(volts), None, "tick {k}");
        }
        let frozen = (1..100).find(|_| reading.push(1.36).is_some());
        assert!(frozen.is_some_and(|ticks| ticks <= 90), "{frozen:?}");
    }

    #[test]
    fn it_is_known_to_scatter_also_right_after_a_way_to_another_pressure() {
        let mut sensors = Sensors::new([PSE540A_R06, PSE541A_R06], Sensors::ADC_NOISE_V_RMS, 5);
        let mut reading = FrozenReading::new();
        // Half a second at rest, three seconds down to -70 kPa, and it freezes.
        for k in 0..175u32 {
            let kpa = -70.0 * (f64::from(k.saturating_sub(25)) / 150.0);
            assert_eq!(reading.push(sensors.sample([0.0, kpa], [&[], &[]])[1]), None, "tick {k}");
        }
        let frozen = (1..100).find(|_| reading.push(3.77).is_some());
        assert!(frozen.is_some_and(|ticks| ticks <= 60), "{frozen:?}");
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
