//! The eight rigs that are looked ahead on: the model itself and worse ones.

use model::observation::Pair;
use model::rig::Rig;

use crate::actuator_path::Eight;
use model::real::Real;

/// One way in which the rig may be worse than its model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hypothesis {
    /// Ticks by which commands come later than the model has them.
    pub delay_ticks: usize,
    /// Time constant by which a valve's opening follows more slowly, in ms.
    pub lag_ms: f64,
    /// Duty by which valves stand further shut than commanded: backlash, stiction, a spring that has set.
    pub closed_duty: f64,
    /// Share of the model's chamber volumes: a smaller chamber is a faster one.
    pub volume: f64,
    /// Time by which readings lag behind the pressures, in s.
    pub sensor_lag_s: f64,
    /// Error by which the sensors read too low (positive) and too high (negative), in kPa.
    pub reading_error_kpa: Pair,
}

/// The model as it stands.
const NOMINAL: Hypothesis = Hypothesis {
    delay_ticks: 0,
    lag_ms: 0.0,
    closed_duty: 0.0,
    volume: 1.0,
    sensor_lag_s: 0.0,
    reading_error_kpa: [0.0; 2],
};

/// The worst of each, chosen: twice what the published rigs and `bench` have (one tick, 50 ms, 0.03 of duty), ten times
/// the converter's noise (0.06 and 0.006 kPa), and a volume that is a thirtieth short of 1/κ of the model's: gas that is
/// compressed faster than the wall takes up its heat stands κ = 1.4 times as stiff. The last is nearly all at once.
pub const HYPOTHESES: [Hypothesis; 8] = [
    NOMINAL,
    Hypothesis { delay_ticks: 2, ..NOMINAL },
    Hypothesis { lag_ms: 100.0, ..NOMINAL },
    Hypothesis { closed_duty: 0.06, ..NOMINAL },
    Hypothesis { volume: 0.69, reading_error_kpa: [0.6, -0.3], ..NOMINAL },
    Hypothesis { sensor_lag_s: 0.1, ..NOMINAL },
    Hypothesis { delay_ticks: 1, lag_ms: 50.0, closed_duty: 0.03, ..NOMINAL },
    Hypothesis {
        delay_ticks: 2,
        lag_ms: 75.0,
        closed_duty: 0.045,
        volume: 0.75,
        sensor_lag_s: 0.04,
        reading_error_kpa: [0.3, -0.15],
    },
];

/// The model's rig as each hypothesis has it.
pub(crate) fn rigs(model: &Rig) -> Vec<Rig> {
    let rig = |hypothesis: &Hypothesis| {
        let mut rig = model.clone();
        for volume in rig.volumes.values_mut() {
            volume.volume_l *= hypothesis.volume;
        }
        rig
    };
    HYPOTHESES.iter().map(rig).collect()
}

/// A number of every hypothesis, side by side.
pub(crate) fn lanes(number: impl Fn(&Hypothesis) -> f64) -> Eight {
    Eight::from_lanes(|lane| HYPOTHESES.get(lane).map_or(0.0, &number))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The first is the model; every other is worse than it in at least one way and better in none.
    #[test]
    fn the_others_are_worse_than_the_model() {
        assert_eq!(HYPOTHESES[0], NOMINAL);
        for worse in &HYPOTHESES[1..] {
            assert_ne!(*worse, NOMINAL);
            assert!(worse.lag_ms >= 0.0 && worse.closed_duty >= 0.0 && worse.sensor_lag_s >= 0.0);
            assert!(worse.volume <= 1.0 && worse.reading_error_kpa[0] >= 0.0 && worse.reading_error_kpa[1] <= 0.0);
            assert!(worse.delay_ticks <= crate::actuator_path::MOST_DELAY_TICKS);
        }
    }
}
