//! The limit: the best that any controller could do on a rig whose every parameter and whole reference are known.
//!
//! The duties of all ticks are one unknown `u`, flown open loop; the reference's error is brought down by direct
//! shooting with a fixed approximation of the plant's response,
//!
//! ```text
//! δu = argmin ‖e − H δu‖² + λ ‖δu‖²,        u ← sat(u + δu)
//! ```
//!
//! `H` convolves with pulse responses, measured on the rig itself by flying it with and without a pulse in one valve.
//! `H` is never exact (gains change with pressure, play has kinks), but every round flies the true rig, so what
//! comes out is an error that was reached, not estimated. The least squares are solved by conjugate gradients on the
//! normal equations (Hestenes and Stiefel, 1952). The best round counts.
//!
//! What is left is what no duty can undo: limits of the valves, ripple of the pump between the ticks, kinks; flown
//! with noise, the converter's share comes on top.

use law::{ControlInput, ControlOutput, DutyTerms, Fallback, SoftStart, TICK_S};
use model::observation::{AHEAD, ActionTrajectory, CHANNELS, Pair};
use model::rig::Rig;
use model::shown_reference::ShownReference;
use model::steady::SteadyMap;
use proto::reference::Reference;

use environment::closed_loop::FlightPlan;
use environment::{Controller, EnvironmentError, Flown, Score, fly};
use std::sync::Arc;

/// Length of the pulse responses in ticks: 3 s, after which under 5 % of a pulse is left in either chamber.
const TAPS: usize = 150;
/// Size of the pulse in duty; must cross the valve's play to be seen.
const PULSE: f64 = 0.08;
/// Rounds of shooting.
const ROUNDS: usize = 24;
/// λ in kPa² per duty².
const REGULARISATION: f64 = 4.0;
/// Iterations of conjugate gradients.
const ITERATIONS: usize = 60;
/// Largest share of a correction that is applied: play makes full steps overshoot. Halved when a round made it worse.
const SHARE: f64 = 0.7;

/// Duties for every tick.
#[derive(Debug, Clone, PartialEq)]
pub struct OptimalOpenLoop {
    duties: Vec<Pair>,
    tick: usize,
}

impl Controller for OptimalOpenLoop {
    fn restart(&mut self, _duty: Pair) {
        self.tick = 0;
    }

    fn decide(&mut self, _situation: &ControlInput, _predicted_kpa: &[Pair; AHEAD]) -> ControlOutput {
        let duty = self.duties.get(self.tick).or(self.duties.last()).copied().unwrap_or([1.0; CHANNELS]);
        self.tick += 1;
        let parts = duty.map(|u| DutyTerms { feed_forward: u, ..DutyTerms::default() });
        ControlOutput { parts, trajectory: ActionTrajectory::held(duty) }
    }

    fn applied(&mut self, _duty: Pair) {}
}

impl OptimalOpenLoop {
    /// Finds the duties for a rig and a reference; some twenty-five flights.
    ///
    /// # Errors
    /// If the rig cannot be flown.
    pub fn solve(
        map: &Arc<SteadyMap>,
        rig: &Rig,
        reference: &Reference,
        seconds: f64,
    ) -> Result<Self, EnvironmentError> {
        let plan = FlightPlan { rig, model: None, reference, seconds, noise_v_rms: 0.0, seed: 1 };
        let start = fly(&plan, &mut Fallback::new(Arc::clone(map), law::FallbackSettings::default()))?;
        let approach = SoftStart::new(start.ticks.first().map_or([0.0; 2], |t| t.true_kpa), reference.at(0.0));
        let shown_kpa = shown_with_approach(rig, reference, &approach, start.ticks.len());
        let duties: Vec<Pair> = start.ticks.iter().map(|t| t.duty).collect();
        let responses = pulse_responses(&plan, &duties)?;
        let mut best = (cost(&start), duties, start);
        let mut share = SHARE;
        for _ in 0..ROUNDS {
            let (least, now, flown) = &best;
            let error: Vec<Pair> = flown
                .ticks
                .iter()
                .zip(&shown_kpa)
                .map(|(tick, shown_kpa)| std::array::from_fn(|c| shown_kpa[c] - tick.true_kpa[c]))
                .collect();
            let change = least_squares(&responses, &error);
            let tried: Vec<Pair> = now
                .iter()
                .zip(change)
                .map(|(duty, change)| std::array::from_fn(|c| law::saturated(duty[c] + share * change[c])))
                .collect();
            let flown = fly(&plan, &mut OptimalOpenLoop { duties: tried.clone(), tick: 0 })?;
            let reached = cost(&flown);
            if reached < *least {
                best = (reached, tried, flown);
                share = (share * 1.5).min(SHARE);
            } else {
                share *= 0.5;
            }
        }
        Ok(OptimalOpenLoop { duties: best.1, tick: 0 })
    }
}

/// Readings of the rig's sensors, tick by tick, with the chambers on the reference and the approach to it.
fn shown_with_approach(rig: &Rig, reference: &Reference, approach: &SoftStart, ticks: usize) -> Vec<Pair> {
    let mut shown_reference = ShownReference::of(rig);
    let shown = |tick: usize| {
        let time_s = tick as f64 * TICK_S;
        let (goal, offset) = (reference.at(time_s), approach.offset_kpa(time_s));
        shown_reference.next_kpa(1, std::array::from_fn(|c| goal[c] + offset[c]))
    };
    (0..ticks).map(shown).collect()
}

/// Error of the true pressures, the negative one weighted by its third of the positive one's scale.
fn cost(flown: &Flown) -> f64 {
    let score = Score::of(
        &flown
            .ticks
            .iter()
            .map(|t| environment::closed_loop::FlownTick { measured_kpa: t.true_kpa, ..*t })
            .collect::<Vec<_>>(),
    );
    score.rmse_kpa[0] + 3.0 * score.rmse_kpa[1]
}

/// Response of both pressures to one tick of one duty: `[duty][pressure][tap]`, in kPa per duty.
type Responses = [[Vec<f64>; CHANNELS]; CHANNELS];

/// Flies with and without a step in each valve, a third into the flight, and differences the responses.
fn pulse_responses(plan: &FlightPlan<'_>, duties: &[Pair]) -> Result<Responses, EnvironmentError> {
    let at = duties.len() / 3;
    let until = FlightPlan { seconds: (at + TAPS + 1) as f64 * TICK_S, ..*plan };
    let mut held: Vec<Pair> = duties.to_vec();
    // Standing still before and after, the play's state is the same with and without the step but for its own travel.
    let rest = held.get(at).copied().unwrap_or([0.8; CHANNELS]);
    held.iter_mut().skip(at).for_each(|u| *u = rest);
    let base = fly(&until, &mut OptimalOpenLoop { duties: held.clone(), tick: 0 })?;
    let mut responses: Responses = Default::default();
    for (valve, response) in responses.iter_mut().enumerate() {
        // Downwards where the valve is nearly open already.
        let size = if rest[valve] + 2.0 * PULSE > 0.97 { -PULSE } else { PULSE };
        let step = |steps: f64| -> Result<Flown, EnvironmentError> {
            let mut stepped = held.clone();
            stepped.iter_mut().skip(at).for_each(|u| u[valve] = law::saturated(u[valve] + steps * size));
            fly(&until, &mut OptimalOpenLoop { duties: stepped, tick: 0 })
        };
        let (small, large) = (step(1.0)?, step(2.0)?);
        let base_at = |n: usize, c: usize| base.ticks.get(at + n).map_or(0.0, |t| t.true_kpa[c]);
        let value = |flown: &Flown, n: usize, c: usize| flown.ticks.get(at + n).map_or(0.0, |t| t.true_kpa[c]);
        for (c, taps) in response.iter_mut().enumerate() {
            // The second half of a double step is past the play, so the difference of the two is play-free.
            let settled = |n: usize| {
                let past = value(&large, n, c) - value(&small, n, c);
                if past.abs() > 1e-6 { past / size } else { (value(&small, n, c) - base_at(n, c)) / size }
            };
            *taps = (0..TAPS).map(|n| settled(n + 1) - settled(n)).collect();
        }
    }
    Ok(responses)
}

/// Minimises `‖e − H δ‖² + λ ‖δ‖²` by conjugate gradients on the normal equations.
fn least_squares(responses: &Responses, error: &[Pair]) -> Vec<Pair> {
    let count = error.len();
    let mut x = vec![[0.0; CHANNELS]; count];
    let mut residual = transposed(responses, error);
    let mut direction = residual.clone();
    let mut norm = dot(&residual, &residual);
    let enough = norm * 1e-10;
    for _ in 0..ITERATIONS {
        if norm <= enough {
            break;
        }
        let mut image = transposed(responses, &convolved(responses, &direction));
        for (image, direction) in image.iter_mut().zip(&direction) {
            *image = std::array::from_fn(|c| image[c] + REGULARISATION * direction[c]);
        }
        let step = norm / dot(&direction, &image);
        for (((x, residual), direction), image) in x.iter_mut().zip(&mut residual).zip(&direction).zip(&image) {
            for c in 0..CHANNELS {
                x[c] += step * direction[c];
                residual[c] -= step * image[c];
            }
        }
        let next = dot(&residual, &residual);
        for (direction, residual) in direction.iter_mut().zip(&residual) {
            *direction = std::array::from_fn(|c| residual[c] + next / norm * direction[c]);
        }
        norm = next;
    }
    x
}

fn dot(a: &[Pair], b: &[Pair]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a[0] * b[0] + a[1] * b[1]).sum()
}

/// `y[t] = Σ_n h[n] δ[t−1−n]`: a duty acts from the next tick on.
fn convolved(responses: &Responses, input: &[Pair]) -> Vec<Pair> {
    let mut out = vec![[0.0; CHANNELS]; input.len()];
    for (t, value) in input.iter().enumerate() {
        for (n, slot) in out.iter_mut().skip(t + 1).take(TAPS).enumerate() {
            for (response, value) in responses.iter().zip(value) {
                for (slot, taps) in slot.iter_mut().zip(response) {
                    *slot += taps.get(n).copied().unwrap_or(0.0) * value;
                }
            }
        }
    }
    out
}

/// The transpose of [`convolved`].
fn transposed(responses: &Responses, output: &[Pair]) -> Vec<Pair> {
    let mut input = vec![[0.0; CHANNELS]; output.len()];
    for (t, slot) in input.iter_mut().enumerate() {
        for (n, value) in output.iter().skip(t + 1).take(TAPS).enumerate() {
            for (slot, response) in slot.iter_mut().zip(responses) {
                for (value, taps) in value.iter().zip(response) {
                    *slot += taps.get(n).copied().unwrap_or(0.0) * value;
                }
            }
        }
    }
    input
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_transpose_is_one() {
        let taps = |seed: usize| (0..TAPS).map(|n| ((n * 7 + seed) % 11) as f64 / 11.0).collect::<Vec<_>>();
        let responses: Responses = [[taps(1), taps(2)], [taps(3), taps(4)]];
        let signal = |seed: usize| -> Vec<Pair> {
            (0..400).map(|t| [((t * 5 + seed) % 13) as f64, ((t * 3 + seed) % 7) as f64]).collect()
        };
        let (x, y) = (signal(1), signal(2));
        let (one, other) = (dot(&convolved(&responses, &x), &y), dot(&x, &transposed(&responses, &y)));
        assert!((one - other).abs() < 1e-9 * one.abs(), "{one} {other}");
    }

    /// A chamber that follows the approach to a constant reference, behind one lag, against Euler steps of 20 µs.
    #[test]
    fn the_approach_is_shown_through_the_lag_as_well() {
        let lag = "[[mechanisms]]\nid = \"sensor_lag\"\ncomponent = \"sensor_pos\"\ntime_constant_ms = 160.0\n";
        let rig = Rig::from_toml(&format!("{}\n{lag}", model::rig::DUAL_PRESSURE)).unwrap();
        let reference = Reference::constant(80.0, -70.0);
        let approach = SoftStart::new([0.0; CHANNELS], [80.0, -70.0]);
        let shown_kpa = shown_with_approach(&rig, &reference, &approach, 200);
        let (step_s, mut lagged_kpa) = (TICK_S / 1000.0, 0.0);
        for (tick, [pos_kpa, neg_kpa]) in shown_kpa.into_iter().enumerate() {
            let time_s = tick as f64 * TICK_S;
            // Between ticks the shown goal is a straight line, which the approach leaves by 2 Pa.
            assert!((pos_kpa - lagged_kpa).abs() < 0.005, "{time_s} s: {pos_kpa}, {lagged_kpa}");
            assert!(
                (neg_kpa - (-70.0 + approach.offset_kpa(time_s)[1])).abs() < 1e-9,
                "this sensor reads what is there"
            );
            for step in 0..1000 {
                let goal_kpa = 80.0 + approach.offset_kpa(time_s + f64::from(step) * step_s)[0];
                lagged_kpa += step_s / 0.16 * (goal_kpa - lagged_kpa);
            }
        }
    }

    /// On the ideal rig next to nothing is left; on the bench far less than the fallback leaves.
    #[test]
    fn comes_close_to_no_error_at_all() {
        let map = Arc::new(SteadyMap::new(&Rig::builtin("dual_pressure").unwrap()).unwrap());
        for (name, limit) in [("dual_pressure", [0.05, 0.02]), ("bench", [0.15, 0.10])] {
            let rig = Rig::builtin(name).unwrap();
            let reference = Reference::paper();
            let mut solved = OptimalOpenLoop::solve(&map, &rig, &reference, 40.0).unwrap();
            let plan =
                FlightPlan { rig: &rig, model: None, reference: &reference, seconds: 20.0, noise_v_rms: 0.0, seed: 1 };
            let score = Score::of(&fly(&plan, &mut solved).unwrap().ticks);
            println!("{name}: {:?}", score.rmse_kpa);
            assert!(score.rmse_kpa[0] < limit[0] && score.rmse_kpa[1] < limit[1], "{name}: {score:?}");
        }
    }
}
