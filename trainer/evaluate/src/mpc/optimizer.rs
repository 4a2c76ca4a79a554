//! The optimal duties over the horizon, by real-time iteration.
//!
//! ```text
//! min Σ_k |P(k) − r(k)|²_q + ρ |Δw(k) − Δw_r(k)|²,     0 ≤ w ≤ 1
//! ```
//!
//! `w_r` is the duty at which the model follows the reference: changes that the reference asks for cost nothing.
//!
//! One tick does [`ITERATIONS`] Gauss–Newton steps from the last tick's solution moved on by one: the plant is linearised along it, a
//! Riccati recursion gives the step and the feedback, and a roll-out of the nonlinear plant takes it (iterative LQR). Duties at a
//! limit that the step would push further out are held there (Tassa, Mansard, Todorov, *ICRA* 2014). Duties that a delay
//! has already sent on their way are given.

use model::observation::{CHANNELS, Pair};
use nalgebra::{SMatrix, SVector};

use super::reduced_model::{Acting, ReducedModel};

/// Ticks that are looked ahead.
pub(crate) const HORIZON: usize = 14;
/// Steps of Gauss–Newton a tick.
const ITERATIONS: usize = 2;
/// States: pressures, coils, the duties before.
const STATES: usize = 3 * CHANNELS;
/// Added to the curvature of duties, so that a stage whose duty does nothing has an answer.
const LEAST_CURVATURE: f64 = 1e-6;

type StateMatrix = SMatrix<f64, STATES, STATES>;
type StateVector = SVector<f64, STATES>;
type InputMatrix = SMatrix<f64, STATES, CHANNELS>;
type Feedback = SMatrix<f64, CHANNELS, STATES>;

/// Weights of the optimum.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Weights {
    /// q: of a squared error in kPa², a bare number a channel.
    pub(crate) error: Pair,
    /// ρ: of a squared change of duty in kPa² per duty².
    pub(crate) change: Pair,
}

/// Where the horizon begins, and what is given in it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Horizon {
    /// Chambers in kPa gauge.
    pub(crate) pressures_kpa: Pair,
    /// Coils, play taken off, in duty.
    pub(crate) coil: Pair,
    /// The duties that acted last.
    pub(crate) before: Pair,
    /// State that acts besides; its flapper is not read.
    pub(crate) besides: Acting,
    /// Goals at the end of each tick, in kPa gauge.
    pub(crate) goals_kpa: [Pair; HORIZON],
    /// By how much the reference changes the duty that it asks for from the tick before, in duty.
    pub(crate) asked_change: [Pair; HORIZON],
    /// Number of each channel's first duties that are given.
    pub(crate) given: [usize; CHANNELS],
}

/// The optimizer and its last solution.
#[derive(Debug, Clone)]
pub(crate) struct Optimizer {
    /// Duties that act in each tick.
    pub(crate) acting: [Pair; HORIZON],
    states: [StateVector; HORIZON + 1],
    feedback: [(SVector<f64, CHANNELS>, Feedback); HORIZON],
}

impl Optimizer {
    pub(crate) fn new() -> Self {
        Optimizer {
            acting: [[1.0; CHANNELS]; HORIZON],
            states: [StateVector::zeros(); HORIZON + 1],
            feedback: [(SVector::zeros(), Feedback::zeros()); HORIZON],
        }
    }

    /// Begins from duties that are the same in all ticks.
    pub(crate) fn restart(&mut self, duty: Pair) {
        self.acting = [duty; HORIZON];
    }

    /// Moves the solution on by a tick.
    pub(crate) fn shift(&mut self) {
        self.acting.rotate_left(1);
        self.acting[HORIZON - 1] = self.acting[HORIZON - 2];
    }

    /// Improves the solution for a horizon; bounded, allocation-free.
    pub(crate) fn improve(&mut self, model: &ReducedModel, weights: &Weights, horizon: &Horizon) {
        self.roll_out(model, horizon, false);
        for _ in 0..ITERATIONS {
            self.recur(model, weights, horizon);
            self.roll_out(model, horizon, true);
        }
    }

    fn acting_at(model: &ReducedModel, horizon: &Horizon, state: &StateVector, duty: Pair) -> Acting {
        let flapper = std::array::from_fn(|c| {
            let share = model.timing[c].mean_share;
            (1.0 - share) * state[CHANNELS + c] + share * duty[c]
        });
        Acting { flapper, ..horizon.besides }
    }

    /// Rolls the plant out under the solution, or, `stepping`, under what the recursion makes of it.
    fn roll_out(&mut self, model: &ReducedModel, horizon: &Horizon, stepping: bool) {
        let mut state = StateVector::zeros();
        for c in 0..CHANNELS {
            state[c] = horizon.pressures_kpa[c];
            state[CHANNELS + c] = horizon.coil[c];
            state[2 * CHANNELS + c] = horizon.before[c];
        }
        for k in 0..HORIZON {
            if stepping {
                let (open, closed) = &self.feedback[k];
                let step = open + closed * (state - self.states[k]);
                for c in 0..CHANNELS {
                    self.acting[k][c] = (self.acting[k][c] + step[c]).clamp(0.0, 1.0);
                }
            }
            self.states[k] = state;
            let duty = self.acting[k];
            let acting = Self::acting_at(model, horizon, &state, duty);
            let pressures = model.step([state[0], state[1]], &acting);
            for c in 0..CHANNELS {
                let keeps = model.timing[c].keeps;
                state[c] = pressures[c];
                state[CHANNELS + c] = keeps * state[CHANNELS + c] + (1.0 - keeps) * duty[c];
                state[2 * CHANNELS + c] = duty[c];
            }
        }
        self.states[HORIZON] = state;
    }

    /// The Riccati recursion from the last tick to the first.
    fn recur(&mut self, model: &ReducedModel, weights: &Weights, horizon: &Horizon) {
        let (mut curvature, mut slope) = (StateMatrix::zeros(), StateVector::zeros());
        for k in (0..HORIZON).rev() {
            // The error at the end of the tick.
            for c in 0..CHANNELS {
                curvature[(c, c)] += weights.error[c];
                slope[c] += weights.error[c] * (self.states[k + 1][c] - horizon.goals_kpa[k][c]);
            }
            let (a, b) = self.linearised(model, horizon, k);
            let mut inputs = b.transpose() * curvature * b;
            let mut cross = b.transpose() * curvature * a;
            let mut gradient = b.transpose() * slope;
            for c in 0..CHANNELS {
                let change = self.acting[k][c] - self.states[k][2 * CHANNELS + c] - horizon.asked_change[k][c];
                inputs[(c, c)] += weights.change[c] + LEAST_CURVATURE;
                cross[(c, 2 * CHANNELS + c)] -= weights.change[c];
                gradient[c] += weights.change[c] * change;
            }
            let held: [bool; CHANNELS] = std::array::from_fn(|c| {
                let (duty, push) = (self.acting[k][c], gradient[c]);
                k < horizon.given[c] || (duty <= 0.0 && push > 0.0) || (duty >= 1.0 && push < 0.0)
            });
            let (mut free_inputs, mut free_cross, mut free_gradient) = (inputs, cross, gradient);
            for c in (0..CHANNELS).filter(|c| held[*c]) {
                for other in 0..CHANNELS {
                    (free_inputs[(c, other)], free_inputs[(other, c)]) = (0.0, 0.0);
                }
                free_inputs[(c, c)] = 1.0;
                free_cross.row_mut(c).fill(0.0);
                free_gradient[c] = 0.0;
            }
            let inverse = free_inputs.try_inverse().unwrap_or_else(SMatrix::zeros);
            let open = -(inverse * free_gradient);
            let closed = -(inverse * free_cross);
            let (mut own, mut own_slope) = (a.transpose() * curvature * a, a.transpose() * slope);
            for c in 0..CHANNELS {
                let change = self.acting[k][c] - self.states[k][2 * CHANNELS + c] - horizon.asked_change[k][c];
                own[(2 * CHANNELS + c, 2 * CHANNELS + c)] += weights.change[c];
                own_slope[2 * CHANNELS + c] -= weights.change[c] * change;
            }
            slope = own_slope + closed.transpose() * (inputs * open + gradient) + cross.transpose() * open;
            curvature =
                own + closed.transpose() * inputs * closed + closed.transpose() * cross + cross.transpose() * closed;
            curvature = (curvature + curvature.transpose()) * 0.5;
            self.feedback[k] = (open, closed);
        }
    }

    /// The plant's derivatives by state and by duty in tick `k`.
    fn linearised(&self, model: &ReducedModel, horizon: &Horizon, k: usize) -> (StateMatrix, InputMatrix) {
        let state = &self.states[k];
        let acting = Self::acting_at(model, horizon, state, self.acting[k]);
        let slopes = model.slopes([state[0], state[1]], &acting);
        let (mut a, mut b) = (StateMatrix::zeros(), InputMatrix::zeros());
        for c in 0..CHANNELS {
            let timing = &model.timing[c];
            for j in 0..CHANNELS {
                a[(c, j)] = slopes.by_pressure[c][j];
            }
            a[(c, CHANNELS + c)] = slopes.by_flapper[c] * (1.0 - timing.mean_share);
            a[(CHANNELS + c, CHANNELS + c)] = timing.keeps;
            b[(c, c)] = slopes.by_flapper[c] * timing.mean_share;
            b[(CHANNELS + c, c)] = 1.0 - timing.keeps;
            b[(2 * CHANNELS + c, c)] = 1.0;
        }
        (a, b)
    }
}
