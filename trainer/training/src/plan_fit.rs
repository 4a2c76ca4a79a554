//! The plan of a policy made true: outputs for the next five ticks tied to what is then applied.
//!
//! Rewards say hardly anything about outputs 2 … 11, the plan that MPObs rolls ahead, and where nothing else is paid for
//! they take the exploration that the duties of now need. So with `policy.plan = "fitted"` the actor answers the duties of
//! now alone; in training its plan is to hold them. At the end rows for later are fitted to runs of the very policy:
//!
//! ```text
//! min_w  Σ_τ a_τ² (y_τ − w · φ_τ)² + λ ‖w − w₀‖²,     y_τ = atanh[(u_{τ+j} − base_{τ,j}) / (a_τ L)]
//! ```
//!
//! `φ` is the last hidden layer and 1, `u_{τ+j}` the duty applied `j` ticks later, `base` what the plan counts from (the
//! fallback's plan, or the paper's integral), `a` the share of a correction that acts and `L` the range of an output. `w₀` is
//! the row of the output for now: a plan that is held. Outputs 0 and 1, the duties of now, keep every bit. As the plan leads
//! to other predictions and these to other actions, runs and fits alternate ([`PASSES`]).

use std::sync::Arc;

use environment::closed_loop::{Controller, FlightPlan};
use environment::draws::{Purpose, stream};
use environment::{EnvironmentSettings, fly, reference_draw, vector_env};
use law::{ControlInput, ControlOutput, PolicyLaw};
use model::observation::{ACTION_LEN, AHEAD, CHANNELS, CORRECTION_OBSERVATION_LEN, ObservationLayout, Pair};
use model::rig::Rig;
use model::steady::SteadyMap;
use nalgebra::{DMatrix, DVector};
use proto::reference::Reference;
use sac::{Dense, Network, Workspace};

use crate::TrainingError;
use crate::settings::{Plan, TrainingSettings};

/// Times that runs and fits alternate (measured: the third moves predictions by less than a hundredth of their error).
const PASSES: usize = 3;
/// Seed of the references that the plan is fitted on; no training and no selection uses it.
const SEED: u64 = 0x0050_1A9F_1700_0000;
/// Runs of the model itself, each on a random reference. Where the rig is another, what MPObs foresees is wrong by the model
/// first; runs of random rigs among these only make the plan wrong where the model is right (measured on the shipped
/// policy: 0.33/0.40 of "nothing changes" instead of 0.26/0.16).
const RUNS: u64 = 8;
/// Length of a run in s (chosen: two or three ramps, holds and sines).
const RUN_S: f64 = 24.0;
/// Ticks at the start of a run that say nothing: the way from rest.
const SKIPPED_TICKS: usize = 150;
/// λ of each number as a share of its own sum of squares (chosen: little, units that hardly ever act stay at w₀).
const RIDGE: f64 = 1e-4;
/// Features that are put through both hidden layers as they are, beside the units that were trained: errors of the ticks
/// behind and ahead come first of `features = "errors"`. Of the trained units alone the plan errs half as much again.
const PASSED: usize = 32;
/// Offset that lifts them over the rectifiers, in the features' unit: 32 kPa of error, far beyond where a correction acts.
const LIFT: f32 = 64.0;
/// Hidden layers that can be trained have a multiple of so many units.
const TRAINABLE_MULTIPLE: usize = 32;
/// Largest share of an output's range that is fitted; beyond it atanh amplifies noise.
const MOST: f64 = 0.95;

/// Model that the plan is fitted for.
pub(crate) struct PlanModel<'a> {
    /// Rig that MPObs and the feed-forward know.
    pub(crate) rig: &'a Rig,
    /// The model's steady map.
    pub(crate) map: &'a Arc<SteadyMap>,
}

/// One tick of a run: what the plan is a function of, and what it counts from.
struct Row {
    hidden: Vec<f32>,
    base: [Pair; AHEAD + 1],
    gain: Pair,
    applied: Pair,
}

/// A policy in its law that keeps what a fit needs.
struct Kept<'a> {
    law: PolicyLaw,
    network: &'a Network,
    settings: &'a EnvironmentSettings,
    workspace: Workspace,
    rows: Vec<Row>,
}

impl Controller for Kept<'_> {
    fn restart(&mut self, duty: Pair) {
        self.law.restart(duty);
    }

    fn decide(&mut self, situation: &ControlInput, predicted_kpa: &[Pair; AHEAD]) -> ControlOutput {
        let layout = self.law.contract();
        let fallback = self.law.observe(situation);
        let mut observation = [0.0; CORRECTION_OBSERVATION_LEN];
        let told = observation.get_mut(..layout.observation_len()).unwrap_or_default();
        self.law.write_observation(situation, predicted_kpa, told);
        let action = self.network.mean_action_with(&mut self.workspace, told);
        let decision = self.law.decide(situation, &vector_env::outputs(layout, self.settings, action));
        let (base, gain) = match layout {
            ObservationLayout::Paper => {
                let middle = 0.5 * (self.settings.duty_high + self.settings.duty_low);
                let half = 0.5 * (self.settings.duty_high - self.settings.duty_low);
                ([decision.parts.map(|p| middle + p.integral); AHEAD + 1], [half; CHANNELS])
            }
            ObservationLayout::Correction => {
                let gain = PolicyLaw::authority(situation).map(|a| a * self.settings.correction_duty);
                (fallback.trajectory.0, gain)
            }
        };
        self.rows.push(Row { hidden: self.network.last_hidden(told), base, gain, applied: [f64::NAN; CHANNELS] });
        decision
    }

    fn applied(&mut self, duty: Pair) {
        if let Some(row) = self.rows.last_mut() {
            row.applied = duty;
        }
        self.law.applied(duty);
    }
}

/// Numbers that an actor answers: all of the plan, or the duties of now alone, where the plan is fitted afterwards.
pub(crate) fn acting_len(plan: Plan) -> usize {
    match plan {
        Plan::Learned => ACTION_LEN,
        Plan::Fitted => CHANNELS,
    }
}

/// An actor's answers, one row for each rig, as whole plans: those for now alone are held.
pub(crate) fn whole_plans(answers: Vec<f32>, plan: Plan) -> Vec<f32> {
    match plan {
        Plan::Learned => answers,
        Plan::Fitted => answers.chunks_exact(CHANNELS).flat_map(|now| now.repeat(AHEAD + 1)).collect(),
    }
}

/// Policy with a plan that is held: every output for later answers what the output for now does.
pub(crate) fn held(network: &Network) -> Network {
    let hold = |layer: &Dense| Dense {
        inputs: layer.inputs,
        outputs: ACTION_LEN,
        weights: layer.weights.chunks_exact(layer.outputs).flat_map(|row| row[..CHANNELS].repeat(AHEAD + 1)).collect(),
        bias: layer.bias[..CHANNELS].repeat(AHEAD + 1),
    };
    with_outputs(network, &hold)
}

/// Policy without a plan: its outputs for now alone.
pub(crate) fn without_plan(network: &Network) -> Network {
    let cut = |layer: &Dense| Dense {
        inputs: layer.inputs,
        outputs: CHANNELS,
        weights: layer.weights.chunks_exact(layer.outputs).flat_map(|row| row[..CHANNELS].to_vec()).collect(),
        bias: layer.bias[..CHANNELS].to_vec(),
    };
    let cut = with_outputs(network, &cut);
    // What was put through for the plan goes with it; with a deviation in the last layer nothing was.
    if cut.log_std.is_some() { cut } else { pruned(&cut) }
}

/// Policy with the first features put through beside its hidden units, as yet unused.
fn widened(network: &Network) -> Network {
    let passed = PASSED.min(network.features.features().len());
    let depth = network.layers.len().saturating_sub(1);
    let mut layers = Vec::with_capacity(depth + 1);
    for (n, layer) in network.layers.iter().enumerate() {
        let (extra_in, extra_out) = (if n > 0 { passed } else { 0 }, if n < depth { passed } else { 0 });
        let (inputs, outputs) = (layer.inputs + extra_in, layer.outputs + extra_out);
        let mut weights = vec![0.0; inputs * outputs];
        for (row, old) in weights.chunks_exact_mut(outputs).zip(layer.weights.chunks_exact(layer.outputs)) {
            row[..layer.outputs].copy_from_slice(old);
        }
        for k in 0..extra_out {
            let from = if n > 0 { layer.inputs + k } else { k };
            weights[from * outputs + layer.outputs + k] = 1.0;
        }
        let lift = if n == 0 { LIFT } else { 0.0 };
        let bias = layer.bias.iter().copied().chain(std::iter::repeat_n(lift, extra_out)).collect();
        layers.push(Dense { inputs, outputs, weights, bias });
    }
    // A deviation is of no use to a policy that is finished.
    Network { features: network.features.clone(), layers, log_std: None }
}

/// Policy without hidden units on which nothing depends, but for as many as make their number one that can be trained: a
/// unit that no sample opens any more keeps the weights that it began with, and they may be zero.
fn pruned(network: &Network) -> Network {
    let mut pruned = network.clone();
    for n in (1..pruned.layers.len()).rev() {
        let (before, after) = pruned.layers.split_at_mut(n);
        let (Some(layer), Some(next)) = (before.last_mut(), after.first_mut()) else { continue };
        let is_used = |k: &usize| next.weights[k * next.outputs..(k + 1) * next.outputs].iter().any(|w| *w != 0.0);
        let (mut used, idle): (Vec<usize>, Vec<usize>) = (0..next.inputs).partition(is_used);
        let kept = used.len().next_multiple_of(TRAINABLE_MULTIPLE);
        if used.is_empty() || kept >= next.inputs {
            continue;
        }
        used.extend(idle.into_iter().take(kept - used.len()));
        used.sort_unstable();
        next.weights =
            used.iter().flat_map(|k| next.weights[k * next.outputs..(k + 1) * next.outputs].to_vec()).collect();
        next.inputs = used.len();
        layer.weights =
            layer.weights.chunks_exact(layer.outputs).flat_map(|row| used.iter().map(|k| row[*k])).collect();
        layer.bias = used.iter().map(|k| layer.bias[*k]).collect();
        layer.outputs = used.len();
    }
    pruned
}

fn with_outputs(network: &Network, change: &dyn Fn(&Dense) -> Dense) -> Network {
    let mut changed = network.clone();
    if let Some(last) = changed.layers.last_mut() {
        *last = change(last);
    }
    changed.log_std = network.log_std.as_ref().map(change);
    changed
}

/// Policy with a plan that is what it then does.
///
/// # Errors
/// If a rig cannot be run.
pub(crate) fn fitted(
    network: &Network,
    settings: &TrainingSettings,
    model: &PlanModel<'_>,
) -> Result<Network, TrainingError> {
    let start = widened(&held(&without_plan(network)));
    let mut fitted = start.clone();
    for _ in 0..PASSES {
        let runs = runs(&fitted, settings, model)?;
        for ahead in 1..=AHEAD {
            for channel in 0..CHANNELS {
                fit_output(&mut fitted, &start, &runs, ahead, channel);
            }
        }
    }
    Ok(fitted)
}

/// Last hidden layers of the policy along its runs on the model.
///
/// # Errors
/// If a rig cannot be run.
pub(crate) fn hidden_along_runs(
    network: &Network,
    settings: &TrainingSettings,
    model: &PlanModel<'_>,
) -> Result<Vec<Vec<f32>>, TrainingError> {
    let flown = held(&without_plan(network));
    let runs = runs(&flown, settings, model)?;
    Ok(runs.into_iter().flat_map(|run| run.into_iter().skip(SKIPPED_TICKS)).map(|row| row.hidden).collect())
}

/// Runs of the policy on the model itself, over random references.
fn runs(network: &Network, settings: &TrainingSettings, model: &PlanModel<'_>) -> Result<Vec<Vec<Row>>, TrainingError> {
    let ticks = (RUN_S / law::TICK_S).round() as usize;
    let mut all = Vec::new();
    for number in 0..RUNS {
        let goals = reference_draw::draw(model.map, ticks + 1, &mut stream(SEED, Purpose::Reference, number, 0));
        let mut csv = "time_s,ref_pos_kpa,ref_neg_kpa\n".to_owned();
        for (tick, [pos, neg]) in goals.iter().enumerate() {
            csv += &format!("{},{pos},{neg}\n", tick as f64 * law::TICK_S);
        }
        let reference = Reference::parse("a random reference", csv.as_bytes())
            .map_err(|error| TrainingError::learner("plan", &error))?;
        let plan = FlightPlan {
            rig: model.rig,
            model: settings.policy.variant.predicts().then_some(model.rig),
            reference: &reference,
            seconds: RUN_S,
            noise_v_rms: settings.environment.noise_v_rms,
            seed: number,
        };
        let law = PolicyLaw::new(Arc::clone(model.map), settings.contract());
        let mut kept =
            Kept { law, network, settings: &settings.environment, workspace: Workspace::default(), rows: Vec::new() };
        fly(&plan, &mut kept)?;
        all.push(kept.rows);
    }
    Ok(all)
}

/// Fits the output for `ahead` ticks later of one channel.
fn fit_output(network: &mut Network, start: &Network, runs: &[Vec<Row>], ahead: usize, channel: usize) {
    let output = CHANNELS * ahead + channel;
    let Some(first) = start.layers.last() else { return };
    let (width, lifted) = (first.inputs + 1, first.inputs - PASSED.min(first.inputs));
    let lift = |k: usize| if (lifted..first.inputs).contains(&k) { f64::from(LIFT) } else { 0.0 };
    let prior = DVector::from_fn(width, |k, _| {
        f64::from(if k < first.inputs { first.weights[k * first.outputs + output] } else { first.bias[output] })
    });
    let (mut normal, mut right) = (DMatrix::<f64>::zeros(width, width), DVector::<f64>::zeros(width));
    for rows in runs {
        let pairs = rows.iter().zip(rows.iter().skip(ahead)).skip(SKIPPED_TICKS);
        for (row, later) in pairs {
            let (gain, applied) = (row.gain[channel], later.applied[channel]);
            // At a limit the duty says nothing of what was asked for.
            if gain <= 0.0 || applied <= 0.0 || applied >= 1.0 {
                continue;
            }
            let wanted = ((applied - row.base[ahead][channel]) / gain).clamp(-MOST, MOST).atanh();
            let phi = DVector::from_fn(width, |k, _| row.hidden.get(k).map_or(1.0, |h| f64::from(*h) - lift(k)));
            let weight = gain * gain;
            normal.syger(weight, &phi, &phi, 1.0);
            right.axpy(weight * (wanted - prior.dot(&phi)), &phi, 1.0);
        }
    }
    normal.fill_upper_triangle_with_lower_triangle();
    for k in 0..width {
        normal[(k, k)] *= 1.0 + RIDGE;
        normal[(k, k)] += f64::MIN_POSITIVE.sqrt();
    }
    let Some(change) = normal.cholesky().map(|c| c.solve(&right)) else { return };
    let weights = prior + change;
    let Some(last) = network.layers.last_mut() else { return };
    for k in 0..first.inputs {
        last.weights[k * last.outputs + output] = weights[k] as f32;
    }
    // The bias takes back what lifts the features over the rectifiers.
    let lifted: f64 = (0..first.inputs).map(|k| lift(k) * weights[k]).sum();
    last.bias[output] = (weights[width - 1] - lifted) as f32;
}
