//! The actor's share of an update, CAPS included.
//!
//! ```text
//! loss = mean [ α ln π(a|o) − min_i Q_i(o, a) + λ_T D_T + λ_S D_S ],     a ~ π(·|o)
//! D_T = ‖μ(s_t, g_t) − μ(s_(t+1), g_t)‖,   D_S = ‖μ(s_t, g_t) − μ(s_t + noise, g_t)‖
//! ```
//! with `μ = tanh` of the mean and `‖d‖ = √(Σ d² + 10⁻⁸)`, as (8)-(10) of the paper. By hand, with `B` samples:
//!
//! ```text
//! ∂loss/∂u_j = (1 − a_j²) ∂(−min Q)/∂a_j / B + 2 α a_j / B       since −ln(1 − tanh² u) has the slope 2 tanh u
//! ∂loss/∂s_j = ∂loss/∂u_j e^s_j ε_j − α / B                       where s_j is within its bounds, else 0
//! ∂D/∂μ_j = ±(μ_j − μ′_j) / D
//! ```
//! Only the smaller critic of each sample has a gradient (see the `min_q` module).

use crate::adam::AdamStep;
use crate::batch::{Block, Frame, NO_LANES, Panel, Smoothness, VIEWS, View, join};
use crate::elementary::tanh;
use crate::kernel::{Line, Vector, WIDTH, Work};
use crate::min_q::min_q;
use crate::network_step::{ForwardPass, StepScratch, step_network};
use crate::parameters::{NetView, Part};
use crate::policy_sample::Sample;
use crate::trace::Trace;

/// Under the root of CAPS' distances, so that it has a slope at zero.
const ROOT_FLOOR: f32 = 1e-8;

/// Inputs of the third phase.
pub(crate) struct ActorPhase<'a> {
    pub(crate) frame: &'a Frame,
    pub(crate) actor: &'a NetView<'a>,
    pub(crate) critics: &'a [NetView<'a>; 2],
    pub(crate) smoothness: Smoothness,
    pub(crate) temperature: f32,
}

impl ActorPhase<'_> {
    /// Passes a thread's panels forward and back, network by network as in the critics' phase.
    pub(crate) fn pass(&self, block: &mut Block) {
        let frame = self.frame;
        let (cpu, actions, batch) = (frame.cpu, frame.shape.actions, frame.settings.batch);
        let features = frame.features.features().len();
        let Block { panels, scratch } = block;
        for panel in &mut *panels {
            for view in self.views() {
                let (x, outputs) = (&panel.views[view as usize].x, outputs_at(view, actions));
                panel.traces[view as usize].forward(cpu, self.actor, x, outputs, &mut scratch.hidden);
            }
            let here = &panel.views[View::Here as usize];
            let sample = Sample {
                head: &panel.traces[View::Here as usize].output,
                noise: &panel.noise[0],
                log_std: frame.settings.log_std,
                action: &mut panel.action,
                stretch: &mut panel.stretch,
            };
            panel.records.log_probability = cpu.run(sample);
            join(&panel.action, &here.x, features, &mut panel.joint);
        }
        for (c, net) in self.critics.iter().enumerate() {
            for panel in &mut *panels {
                panel.critics[c].forward(cpu, net, &panel.joint, 1, &mut scratch.hidden);
            }
        }
        min_q(cpu, self.critics, batch, panels, scratch);
        for panel in &mut *panels {
            cpu.run(PolicyGradient { phase: self, panel });
            for view in self.views() {
                panel.traces[view as usize].backward(cpu, self.actor, outputs_at(view, actions));
            }
        }
    }

    fn views(&self) -> impl Iterator<Item = View> {
        VIEWS.into_iter().filter(|view| self.smoothness.wants(*view))
    }
}

/// Outputs of the actor that a view needs: CAPS compares means alone.
fn outputs_at(view: View, actions: usize) -> usize {
    if view == View::Here { 2 * actions } else { actions }
}

/// Sets the actor's last gradients in all views and records the losses.
struct PolicyGradient<'a> {
    phase: &'a ActorPhase<'a>,
    panel: &'a mut Panel,
}

impl Work for PolicyGradient<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        let settings = &self.phase.frame.settings;
        let actions = self.phase.frame.shape.actions;
        let part = 1.0 / settings.batch as f32;
        let temperature = self.phase.temperature;
        let [lowest, highest] = settings.log_std;
        let [here, next, near] = &mut self.panel.traces;
        let Trace { output: head, gradient, .. } = here;
        let Some(gradient) = gradient.last_mut() else { return };
        for n in 0..2 * actions {
            let log_std = &head[2 * actions + n];
            for l in 0..WIDTH {
                let action = self.panel.action[n].0[l];
                let from_value = self.panel.action_gradient[n].0[l];
                let slope = (-action).mul_add(action, 1.0);
                let to_u = slope.mul_add(from_value, 2.0 * temperature * part * action);
                let inside = log_std.0[l] >= lowest && log_std.0[l] <= highest;
                let to_log_std = to_u.mul_add(self.panel.stretch[n].0[l], -temperature * part);
                gradient[n].0[l] = to_u;
                gradient[2 * actions + n].0[l] = if inside { to_log_std } else { 0.0 };
            }
        }
        let Smoothness { temporal, spatial } = self.phase.smoothness;
        let [mut by_time, mut by_space] = [NO_LANES; 2];
        if temporal > 0.0 {
            by_time = distance(head, next, gradient, temporal * part, actions);
        }
        if spatial > 0.0 {
            by_space = distance(head, near, gradient, spatial * part, actions);
        }
        let records = &mut self.panel.records;
        [records.temporal, records.spatial] = [by_time, by_space];
        for half in 0..2 {
            for l in 0..WIDTH {
                let soft = temperature.mul_add(records.log_probability[half].0[l], -records.value[half].0[l]);
                let smooth = temporal * by_time[half].0[l] + spatial * by_space[half].0[l];
                records.actor_loss[half].0[l] = soft + smooth;
            }
        }
    }
}

/// `‖tanh head − tanh other‖` of each sample, its gradient set in `other` and added to `gradient`.
#[inline(always)]
fn distance(head: &[Line], other: &mut Trace, gradient: &mut [Line], weight: f32, actions: usize) -> [Line; 2] {
    let mut distance = NO_LANES;
    let Some(to_other) = other.gradient.last_mut() else { return distance };
    to_other[2 * actions..].fill(Line::ZERO);
    for half in 0..2 {
        let mut squares = [ROOT_FLOOR; WIDTH];
        for n in (half..2 * actions).step_by(2) {
            for l in 0..WIDTH {
                let difference = tanh(head[n].0[l]) - tanh(other.output[n].0[l]);
                squares[l] = difference.mul_add(difference, squares[l]);
            }
        }
        distance[half] = Line(squares.map(f32::sqrt));
        for n in (half..2 * actions).step_by(2) {
            for l in 0..WIDTH {
                let (a, b) = (tanh(head[n].0[l]), tanh(other.output[n].0[l]));
                let pull = weight * (a - b) / distance[half].0[l];
                gradient[n].0[l] = (-a).mul_add(a, 1.0).mul_add(pull, gradient[n].0[l]);
                to_other[n].0[l] = -(-b).mul_add(b, 1.0) * pull;
            }
        }
    }
    distance
}

/// Takes one thread's rows of the actor a step, from the panels of all threads, view by view.
pub(crate) fn step_actor(
    frame: &Frame,
    blocks: &[&Block],
    smoothness: Smoothness,
    room: &mut StepScratch,
    actor: &mut Part,
    adam: AdamStep,
) {
    let panels = || blocks.iter().flat_map(|block| &block.panels);
    let at =
        |view: View| panels().map(move |panel| (&*panel.views[view as usize].by_sample, &panel.traces[view as usize]));
    let traces: Vec<_> = VIEWS.into_iter().filter(|view| smoothness.wants(*view)).flat_map(at).collect();
    let passed = ForwardPass { panels: &traces, whole: panels().count(), outputs: frame.shape.actions };
    step_network(frame.cpu, passed, room, actor, adam);
}
