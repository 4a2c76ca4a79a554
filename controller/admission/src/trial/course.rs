//! The reference of a trial: hold, step, sine, ramp, hold; where the model rests at middling duties.

use std::ops::Range;

use law::TICK_S;
use model::observation::{CHANNELS, GOALS_AHEAD, Pair};
use model::shown_reference::ShownReference;
use model::steady::SteadyMap;

/// Duties at which the model's rests are looked for: the middle, and a place with both vents further shut (higher
/// pressures). Chosen so that rigs with a fifth more or less flow can hold them too.
const MIDDLE_DUTY: Pair = [0.86, 0.86];
const HIGHER_DUTY: Pair = [0.80, 0.82];
/// Pressures to rest at if the model rests nowhere there: where the paper's reference begins.
const OTHERWISE_KPA: [Pair; 2] = [[80.0, -70.0], [88.0, -72.5]];
/// Largest step in kPa: one that takes the rig part of a second.
const STEP_KPA: Pair = [6.0, 2.5];
/// Amplitude of the sine in kPa, and its period in s: the paper's reference moves about as fast.
const SINE_KPA: Pair = [4.0, 1.6];
const SINE_PERIOD_S: f64 = 4.0;

/// Seconds at which parts of the course begin.
const STEP_S: f64 = 6.0;
const SINE_S: f64 = 11.0;
const RAMP_S: f64 = 19.0;
const REST_S: f64 = 22.0;
const END_S: f64 = 28.0;
/// From when on errors count: the rig comes from rest.
const COUNTED_S: f64 = 5.0;
/// Parts of the two holds in which nothing should move any more.
const STILL_S: [Range<f64>; 2] = [8.0..11.0, 24.5..28.0];

/// A reference with what counts of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Course {
    /// One pair for each tick and the fifteen after the end, in kPa gauge.
    reference_kpa: Vec<Pair>,
    /// Readings of the model's sensors with the chambers on it.
    shown_kpa: Vec<Pair>,
    /// Ticks flown.
    pub ticks: usize,
}

impl Course {
    /// The course for the rig that `map` was made of, behind its sensors.
    pub fn new(map: &SteadyMap, mut shown_reference: ShownReference) -> Self {
        let [middle, higher] = match (map.settled_kpa(MIDDLE_DUTY), map.settled_kpa(HIGHER_DUTY)) {
            (Some(middle), Some(higher)) => [middle, higher],
            _ => OTHERWISE_KPA,
        };
        let way: Pair = std::array::from_fn(|c| (higher[c] - middle[c]).clamp(-STEP_KPA[c], STEP_KPA[c]));
        let at = |time_s: f64| -> Pair {
            let stepped: Pair = std::array::from_fn(|c| middle[c] + way[c]);
            std::array::from_fn(|c| match time_s {
                t if t < STEP_S => middle[c],
                t if t < SINE_S => stepped[c],
                t if t < RAMP_S => {
                    stepped[c] - SINE_KPA[c] * (std::f64::consts::TAU * (t - SINE_S) / SINE_PERIOD_S).sin()
                }
                t => stepped[c] - way[c] * ((t - RAMP_S) / (REST_S - RAMP_S)).min(1.0),
            })
        };
        let ticks = (END_S / TICK_S) as usize;
        let reference_kpa: Vec<Pair> = (0..=ticks + GOALS_AHEAD).map(|tick| at(tick as f64 * TICK_S)).collect();
        let shown_kpa = reference_kpa.iter().map(|kpa| shown_reference.next_kpa(1, *kpa)).collect();
        Course { reference_kpa, shown_kpa, ticks }
    }

    /// The reference at a tick, its last value for ever, in kPa gauge.
    pub fn at(&self, tick: usize) -> Pair {
        self.reference_kpa.get(tick).or(self.reference_kpa.last()).copied().unwrap_or([0.0; CHANNELS])
    }

    /// Readings at a tick if the chambers are on the reference, in kPa gauge: what errors are counted from. It is the reference
    /// itself where no sensor of the model is late.
    pub fn shown_at(&self, tick: usize) -> Pair {
        self.shown_kpa.get(tick).or(self.shown_kpa.last()).copied().unwrap_or([0.0; CHANNELS])
    }

    /// Tells whether errors at a tick count.
    pub fn counts(&self, tick: usize) -> bool {
        tick as f64 * TICK_S >= COUNTED_S
    }

    /// Still stretch, of the two, that a tick is in.
    pub fn still(&self, tick: usize) -> Option<usize> {
        STILL_S.iter().position(|stretch| stretch.contains(&(tick as f64 * TICK_S)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::rig::Rig;

    fn course(rig: &Rig) -> Course {
        Course::new(&SteadyMap::new(rig).unwrap(), ShownReference::of(rig))
    }

    #[test]
    fn the_course_is_where_the_model_can_follow() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let (map, course) = (SteadyMap::new(&rig).unwrap(), course(&rig));
        assert_eq!(course.ticks, 1400);
        for tick in 0..course.ticks {
            let duty = map.duty_for(course.at(tick), [0.0; CHANNELS]);
            assert!(duty.iter().all(|u| (0.6..0.97).contains(u)), "tick {tick}: {:?} {duty:?}", course.at(tick));
        }
        let still: Vec<usize> = (0..course.ticks).filter(|t| course.still(*t).is_some()).collect();
        assert_eq!(still.len(), 150 + 175);
        // Nothing moves there.
        assert!(still.windows(2).all(|w| w[1] - w[0] > 1 || course.at(w[0]) == course.at(w[1])));
    }
}
