//! References over the whole reachable range: holds, steps, ramps and sines, alone and together.
//!
//! Places that the rig can hold are found backwards, by drawing duties and asking the averaged model where they
//! settle: the reachable region is no rectangle, since the pump couples both pressures. Between such
//! places the reference ramps or steps; sines are added per channel and shrunk until the averaged model can follow
//! the sum with some duty to spare.

use law::TICK_S;
use model::observation::{CHANNELS, Pair};
use model::steady::SteadyMap;
use rand::{Rng, RngExt as _};

/// Duties between which places are drawn: below, valves are shut; above, nothing is left to act with.
const DUTY: [f64; 2] = [0.55, 0.97];
/// Duties that following a reference may need.
const FOLLOWED: [f64; 2] = [0.3, 0.99];
/// Largest amplitude of a sine in kPa.
const AMPLITUDE_KPA: Pair = [8.0, 4.0];
/// Periods of sines in s.
const PERIOD_S: [f64; 2] = [3.0, 15.0];
/// Length of a ramp or hold in s.
const STRETCH_S: [f64; 2] = [2.0, 15.0];
/// Share of stretches that begin with a step.
const STEPS: f64 = 0.1;
/// Largest step in kPa: one that takes the rig part of a second, not many.
const STEP_KPA: Pair = [8.0, 3.0];
/// Steepest ramp in kPa/s: what the pump still follows with duty to spare.
const RAMP_KPA_PER_S: Pair = [10.0, 4.0];
/// Share of stretches that hold.
const HOLDS: f64 = 0.25;
/// Share of channels with a sine.
const SINES: f64 = 0.7;
/// Shrinking sines once more than this leaves nothing of them.
const SHRINKS: i32 = 12;

/// A place that the rig can hold, in kPa gauge.
pub fn place(map: &SteadyMap, random: &mut impl Rng) -> Pair {
    for _ in 0..100 {
        let duty = std::array::from_fn(|_| random.random_range(DUTY[0]..=DUTY[1]));
        if let Some(settled) = map.settled_kpa(duty) {
            return settled;
        }
    }
    // Every rig that this controller flies holds this: it is where the paper's reference begins.
    [80.0, -70.0]
}

/// Draws a reference of so many ticks.
pub fn draw(map: &SteadyMap, ticks: usize, random: &mut impl Rng) -> Vec<Pair> {
    let places = stretches(map, ticks, random);
    let sines: [(f64, f64, f64); CHANNELS] = std::array::from_fn(|c| {
        let amplitude = random.random_range(0.0..=AMPLITUDE_KPA[c]);
        let period = random.random_range(PERIOD_S[0]..=PERIOD_S[1]);
        let phase = random.random_range(0.0..std::f64::consts::TAU);
        let there: f64 = random.random_range(0.0..1.0);
        (if there < SINES { amplitude } else { 0.0 }, period, phase)
    });
    let with = |share: f64| -> Vec<Pair> {
        let sine = |c: usize, tick: usize| {
            let (amplitude, period, phase) = sines[c];
            share * amplitude * (std::f64::consts::TAU * tick as f64 * TICK_S / period + phase).sin()
        };
        places.iter().enumerate().map(|(tick, at)| std::array::from_fn(|c| at[c] + sine(c, tick))).collect()
    };
    (0..SHRINKS).map(|n| with(0.75_f64.powi(n))).find(|reference| follows(map, reference)).unwrap_or_else(|| with(0.0))
}

/// Holds, steps and ramps between places.
fn stretches(map: &SteadyMap, ticks: usize, random: &mut impl Rng) -> Vec<Pair> {
    let mut reference = Vec::with_capacity(ticks);
    let mut from = place(map, random);
    while reference.len() < ticks {
        let length_s: f64 = random.random_range(STRETCH_S[0]..=STRETCH_S[1]);
        let kind: f64 = random.random_range(0.0..1.0);
        let mut to = if kind < HOLDS { from } else { place(map, random) };
        if kind >= 1.0 - STEPS {
            // On the way to a place that can be held, so that the step's end can be, too.
            let share = (0..CHANNELS).fold(1.0, |share: f64, c| share.min(STEP_KPA[c] / (to[c] - from[c]).abs()));
            to = std::array::from_fn(|c| from[c] + share * (to[c] - from[c]));
            from = to;
        }
        let least_s = (0..CHANNELS).fold(0.0, |s: f64, c| s.max((to[c] - from[c]).abs() / RAMP_KPA_PER_S[c]));
        let length = (length_s.max(least_s) / TICK_S) as usize;
        for n in 0..length {
            let share = n as f64 / length as f64;
            reference.push(std::array::from_fn(|c| from[c] + share * (to[c] - from[c])));
        }
        from = to;
    }
    reference.truncate(ticks);
    reference
}

/// Tells whether the averaged model can follow, steps left aside.
fn follows(map: &SteadyMap, reference: &[Pair]) -> bool {
    reference.windows(2).step_by(5).all(|pair| {
        let [before, after] = pair else { return true };
        let slope: Pair = std::array::from_fn(|c| (after[c] - before[c]) / TICK_S);
        let stepped = slope.iter().any(|s| s.abs() > 50.0);
        let duty = map.duty_for(*before, if stepped { [0.0; CHANNELS] } else { slope });
        duty.iter().all(|u| (FOLLOWED[0]..=FOLLOWED[1]).contains(u))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::draws::{Purpose, stream};
    use model::rig::Rig;

    #[test]
    fn references_cover_the_range_and_can_be_followed() {
        let map = SteadyMap::new(&Rig::builtin("dual_pressure").unwrap()).unwrap();
        let (mut low, mut high) = ([f64::MAX; CHANNELS], [f64::MIN; CHANNELS]);
        let mut followed = 0;
        for episode in 0..100 {
            let reference = draw(&map, 1000, &mut stream(3, Purpose::Reference, episode, 0));
            assert_eq!(reference.len(), 1000);
            followed += usize::from(follows(&map, &reference));
            for c in 0..CHANNELS {
                for at in &reference {
                    low[c] = low[c].min(at[c]);
                    high[c] = high[c].max(at[c]);
                }
            }
        }
        // The paper's experiment spans 76 … 106 and −78 … −67 kPa; training must reach well beyond it.
        assert!(low[0] < 60.0 && high[0] > 125.0 && low[1] < -79.0 && high[1] > -64.0, "{low:?} {high:?}");
        // What is left are ramps across a corner of the region, with no sine to shrink.
        assert!(followed >= 90, "{followed} of 100 can be followed");
    }
}
