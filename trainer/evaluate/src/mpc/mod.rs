//! Offset-free nonlinear model-predictive control: what an expert would fly.
//!
//! | file | subject |
//! | --- | --- |
//! | `reduced_model` | the plant averaged over a revolution, with delay and lag of the valves |
//! | `estimator` | pressures, disturbances and widths of play by an extended Kalman filter |
//! | `optimizer` | the horizon, by real-time iteration |
//!
//! In a tick: estimate, move what is already on its way through the delay into the horizon, improve the last solution, send
//! the first duty that is free, with the valve's play undone as the fallback does it ([`law::direction`]). Disturbances that
//! the estimator finds hold over the horizon, so that a model that is off leaves no offset. Everything that the rig file states of valves, chambers and
//! sensors is inside; with the nominal file it is an MPC that knows of none of it.
//!
//! Sources: Diehl et al., *J. Process Control* 12 (2002), real-time iteration; Kuntz and Rawlings, arXiv 2412.08104,
//! offset-free nonlinear MPC.

mod estimator;
mod optimizer;
mod reduced_model;

use std::sync::{Arc, Mutex};
use std::time::Instant;

use environment::Controller;
use law::direction::Direction;
use law::foresight::{Foresight, is_told};
use law::{ControlInput, ControlOutput, DutyTerms, TICK_S, saturated};
use model::observation::{AHEAD, ActionTrajectory, CHANNELS, GOALS_AHEAD, Pair};
use model::steady::SteadyMap;

use estimator::{Estimate, Estimator};
use optimizer::{HORIZON, Horizon, Optimizer, Weights};
use reduced_model::{Acting, ReducedModel};

/// q: a squared error of the negative pressure counts nine times one of the positive, as its reference is a third as wide.
const ERROR_WEIGHTS: Pair = [1.0, 9.0];
/// Bandwidth in rad/s that the duties' changes are weighed for where the valves' timing is known, and where it is not: what is
/// not in the model is not to be swung. With `b` kPa/s per duty, `ρ = q (b T)²/(ω T)⁴`.
const BANDWIDTHS_PER_S: [f64; 2] = [12.0, 6.0];
/// Where `b` is taken for that, in kPa gauge.
const WEIGHED_AT_KPA: Pair = [90.0, -72.5];

/// Times of ticks, gathered over flights.
#[derive(Debug, Default)]
pub struct TickTimes {
    micros: Mutex<Vec<f64>>,
}

impl TickTimes {
    /// Median and 99.9th percentile in µs; `None` before any flight.
    pub fn median_and_p999_us(&self) -> Option<(f64, f64)> {
        let mut micros = self.micros.lock().ok()?.clone();
        micros.sort_by(f64::total_cmp);
        let at = |share: f64| micros.get(((micros.len() as f64 * share) as usize).min(micros.len().saturating_sub(1)));
        Some((*at(0.5)?, *at(0.999)?))
    }

    fn add(&self, micros: &mut Vec<f64>) {
        if let Ok(mut all) = self.micros.lock() {
            all.append(micros);
        }
    }
}

/// The controller.
pub struct Mpc {
    model: ReducedModel,
    weights: Weights,
    estimator: Estimator,
    optimizer: Optimizer,
    foresight: Foresight,
    directions: [Direction; CHANNELS],
    gas_k: Pair,
    /// Whole ticks of delay of each channel, and what is left of a tick.
    delays: [(usize, f64); CHANNELS],
    /// Duty that acted last, play taken off.
    before: Pair,
    times: Arc<TickTimes>,
    micros: Vec<f64>,
}

impl Mpc {
    /// For the rig that `map` was made of; times of its ticks go to `times` when it is dropped.
    pub fn new(map: &Arc<SteadyMap>, times: Arc<TickTimes>) -> Self {
        let model = ReducedModel::new(Arc::clone(map));
        let delays = model.timing.map(|timing| {
            let whole = timing.delay_ticks.round().min(HORIZON as f64 - 4.0);
            (whole as usize, timing.delay_ticks - whole)
        });
        let directions =
            map.valve_paths().map(|path| if is_told(&path) { Direction::told(&path) } else { Direction::default() });
        Mpc {
            weights: Weights { error: ERROR_WEIGHTS, change: change_weights(&model) },
            estimator: Estimator::new(&model),
            optimizer: Optimizer::new(),
            foresight: Foresight::new(Arc::clone(map)),
            directions,
            gas_k: map.wall_k(),
            delays,
            before: [1.0; CHANNELS],
            times,
            micros: Vec::new(),
            model,
        }
    }

    /// Goal of a channel this many ticks ahead, in gauge kPa: between ticks on a line, and before the first on the line through the first
    /// two.
    fn goal_at(situation: &ControlInput, c: usize, ticks: f64) -> f64 {
        let goals = &situation.goals_kpa;
        let below = ticks.clamp(0.0, (GOALS_AHEAD - 1) as f64) as usize;
        let share = (ticks - below as f64).min(1.0);
        (1.0 - share) * goals[below][c] + share * goals[below + 1][c]
    }

    /// Goals at the end of the tick before the horizon and of each in it, in chamber kPa; a part of a tick of delay shifts them.
    fn goals(&self, situation: &ControlInput) -> (Pair, [Pair; HORIZON]) {
        let at = |ticks: usize| {
            let goal = std::array::from_fn(|c| Self::goal_at(situation, c, ticks as f64 + self.delays[c].1));
            self.model.map.chamber_kpa(goal)
        };
        (at(0), std::array::from_fn(|k| at(k + 1)))
    }

    /// Change of the duty that the goals ask for from tick to tick; in the first as in the second, since what it asked for
    /// before is past.
    fn asked_change(&self, (mut from_kpa, goals_kpa): (Pair, &[Pair; HORIZON])) -> [Pair; HORIZON] {
        let duties = goals_kpa.map(|goal| {
            let rates = std::array::from_fn(|c| (goal[c] - from_kpa[c]) / TICK_S);
            from_kpa = goal;
            self.model.map.warm_duty_for(goal, rates, self.gas_k).map(|duty| duty.clamp(0.0, 1.0))
        });
        std::array::from_fn(|k| {
            let k = k.max(1);
            std::array::from_fn(|c| duties[k][c] - duties[k - 1][c])
        })
    }

    fn planned(&mut self, situation: &ControlInput, estimate: &Estimate) -> ([DutyTerms; CHANNELS], ActionTrajectory) {
        let (from_kpa, goals_kpa) = self.goals(situation);
        let horizon = Horizon {
            pressures_kpa: estimate.pressures_kpa,
            coil: estimate.flapper,
            before: self.before,
            besides: Acting { flapper: estimate.flapper, disturbance: estimate.disturbance, gas_k: self.gas_k },
            asked_change: self.asked_change((from_kpa, &goals_kpa)),
            goals_kpa,
            given: self.delays.map(|(whole, _)| whole),
        };
        self.optimizer.improve(&self.model, &self.weights, &horizon);
        let acting = &self.optimizer.acting;
        let mut parts = [DutyTerms::default(); CHANNELS];
        let mut directions = self.directions;
        let trajectory = std::array::from_fn(|j| {
            let (_, turning) = self.foresight.duties(situation, j);
            std::array::from_fn(|c| {
                directions[c].follow(turning[c].clamp(0.0, 1.0));
                let free = acting[(self.delays[c].0 + j).min(HORIZON - 1)][c];
                let play = estimate.half_width[c] * directions[c].drive();
                if j == 0 {
                    parts[c] = DutyTerms { feed_forward: free, play, ..DutyTerms::default() };
                    self.directions[c] = directions[c];
                }
                saturated(free + play)
            })
        });
        (parts, ActionTrajectory(trajectory))
    }
}

impl Controller for Mpc {
    fn restart(&mut self, duty: Pair) {
        self.estimator.restart(duty);
        self.optimizer.restart(duty);
        self.directions.iter_mut().for_each(Direction::restart);
        self.foresight.restart();
        self.gas_k = self.model.map.wall_k();
        self.before = duty;
    }

    fn decide(&mut self, situation: &ControlInput, _predicted_kpa: &[Pair; AHEAD]) -> ControlOutput {
        let begun = Instant::now();
        let estimate = self.estimator.observe(self.model.map.chamber_kpa(situation.undelayed_kpa));
        let (parts, trajectory) = self.planned(situation, &estimate);
        self.foresight.advance(situation);
        let rates = self.rates(situation);
        self.gas_k = self.model.map.warmed_k(estimate.pressures_kpa, rates, self.gas_k, TICK_S);
        self.micros.push(begun.elapsed().as_secs_f64() * 1e6);
        ControlOutput { parts, trajectory }
    }

    fn applied(&mut self, duty: Pair) {
        let begun = Instant::now();
        self.before = self.optimizer.acting[0];
        self.optimizer.shift();
        self.estimator.advance(&self.model, duty, self.gas_k);
        if let Some(last) = self.micros.last_mut() {
            *last += begun.elapsed().as_secs_f64() * 1e6;
        }
    }
}

impl Mpc {
    /// Rates of the chambers that the reference has now, in kPa/s.
    fn rates(&self, situation: &ControlInput) -> Pair {
        let goals = &situation.goals_kpa;
        self.model.map.chamber_rates_kpa_per_s(std::array::from_fn(|c| (goals[1][c] - goals[0][c]) / TICK_S))
    }
}

/// ρ of both channels, in kPa² per duty².
fn change_weights(model: &ReducedModel) -> Pair {
    let bandwidth = if model.is_told { BANDWIDTHS_PER_S[0] } else { BANDWIDTHS_PER_S[1] };
    let gain = model.map.sent_gain_kpa_per_s(WEIGHED_AT_KPA, model.map.duty_for(WEIGHED_AT_KPA, [0.0; CHANNELS]));
    std::array::from_fn(|c| ERROR_WEIGHTS[c] * (gain[c] * TICK_S).powi(2) / (bandwidth * TICK_S).powi(4))
}

impl Drop for Mpc {
    fn drop(&mut self) {
        self.times.add(&mut self.micros);
    }
}
