//! The critics' share of an update.
//!
//! ```text
//! y = r + live · γ (min_i Q̄_i(o′, a′) − α ln π(a′|o′)),   a′ ~ π(·|o′)
//! loss = mean Σ_i (Q_i(o, a) − y)²,                        ∂loss/∂Q_i = 2/B (Q_i − y)
//! ```

use crate::batch::{Block, Draw, Frame, Lanes, NO_LANES, Smoothness, join};
use crate::kernel::{BiasStep, Line, ToSamples, Vector, WIDTH, WeightStep, Work};
use crate::parameters::{NetView, Part};
use crate::policy_sample::Sample;
use crate::replay::Replay;
use crate::{adam::AdamStep, trace::Trace};

/// What the first phase reads.
pub(crate) struct CriticPhase<'a> {
    pub(crate) frame: &'a Frame,
    pub(crate) replay: &'a Replay,
    pub(crate) actor: &'a NetView<'a>,
    pub(crate) critics: &'a [NetView<'a>; 2],
    pub(crate) slow: &'a [NetView<'a>; 2],
    pub(crate) smoothness: Smoothness,
    pub(crate) temperature: f32,
    pub(crate) time: u64,
}

impl CriticPhase<'_> {
    /// Draws a thread's panels, passes them forward and back. Network by network, so that a network's weights stay in
    /// the second-level cache while all panels pass.
    pub(crate) fn pass(&self, block: &mut Block) {
        let frame = self.frame;
        let (cpu, settings) = (frame.cpu, &frame.settings);
        let features = frame.features.features().len();
        let Block { panels, spare } = block;
        for panel in &mut *panels {
            let Self { replay, smoothness, time, .. } = *self;
            cpu.run(Draw { frame, replay, smoothness, time, panel, spare });
        }
        for panel in &mut *panels {
            let next = &mut panel.next;
            next.trace.forward(cpu, self.actor, &next.x);
            let sample = Sample {
                head: &next.trace.output,
                noise: &panel.noise[1],
                log_std: settings.log_std,
                action: &mut spare.action,
                stretch: &mut spare.stretch,
            };
            panel.next_log_probability = cpu.run(sample);
            join(&spare.action, &next.x, features, &mut panel.next_joint);
            let actions = 2 * frame.shape.actions;
            panel.joint[actions..][..2 * features].copy_from_slice(&panel.views[0].x[..2 * features]);
            cpu.run(ToSamples { features: &panel.joint, samples: &mut panel.joint_by_sample });
        }
        for (c, net) in self.slow.iter().enumerate() {
            for panel in &mut *panels {
                spare.slow.forward(cpu, net, &panel.next_joint);
                panel.slow_value[c].copy_from_slice(&spare.slow.output[..2]);
            }
        }
        for (c, net) in self.critics.iter().enumerate() {
            for panel in &mut *panels {
                let critic = &mut panel.critics[c];
                critic.forward(cpu, net, &panel.joint);
                let target = Target {
                    reward: &panel.reward,
                    live: &panel.live,
                    slow_value: &panel.slow_value,
                    log_probability: &panel.next_log_probability,
                    discount: settings.discount,
                    temperature: self.temperature,
                };
                let loss = cpu.run(TargetError { target, critic, batch: settings.batch });
                let record = &mut panel.records.critic_loss;
                *record = if c == 0 { loss } else { sum(record, &loss) };
                critic.backward(cpu, net, None);
                critic.turn(cpu);
            }
        }
    }
}

fn sum(a: &Lanes, b: &Lanes) -> Lanes {
    std::array::from_fn(|half| Line(std::array::from_fn(|l| a[half].0[l] + b[half].0[l])))
}

/// What a target is made of.
struct Target<'a> {
    reward: &'a Lanes,
    live: &'a Lanes,
    slow_value: &'a [Lanes; 2],
    log_probability: &'a Lanes,
    discount: f32,
    temperature: f32,
}

/// Sets a critic's last gradient from its target; gives the loss of each sample.
struct TargetError<'a> {
    target: Target<'a>,
    critic: &'a mut Trace,
    batch: usize,
}

impl Work for TargetError<'_> {
    type Output = Lanes;
    #[inline(always)]
    fn run<V: Vector>(self) -> Lanes {
        let Target { reward, live, slow_value, log_probability, discount, temperature } = self.target;
        let mut loss = NO_LANES;
        let Some(gradient) = self.critic.gradient.last_mut() else { return loss };
        for half in 0..2 {
            let value = &self.critic.output[half].0;
            for l in 0..WIDTH {
                let [a, b] = [0, 1].map(|c| slow_value[c][half].0[l]);
                let future = smaller(a, b) - temperature * log_probability[half].0[l];
                let target = (live[half].0[l] * discount).mul_add(future, reward[half].0[l]);
                let error = value[l] - target;
                gradient[half].0[l] = 2.0 / self.batch as f32 * error;
                loss[half].0[l] = error * error;
            }
        }
        loss
    }
}

/// The smaller of two, or NaN where either is.
#[inline(always)]
pub(crate) fn smaller(a: f32, b: f32) -> f32 {
    if a < b || a.is_nan() { a } else { b }
}

/// Takes one thread's rows of both critics a step, from the panels of all threads.
pub(crate) fn step_critics(
    frame: &Frame,
    blocks: &[&Block],
    sums: &mut [Line],
    critics: &mut [Part; 2],
    adam: AdamStep,
) {
    for (c, critic) in critics.iter_mut().enumerate() {
        let panels = || blocks.iter().flat_map(|block| &block.panels);
        let traces = panels().map(|panel| (panel.joint_by_sample.as_slice(), &panel.critics[c]));
        step_network(frame, &traces.collect::<Vec<_>>(), sums, critic, adam);
    }
}

/// Takes one thread's rows of a network a step; each panel comes with its input, sample by sample.
pub(crate) fn step_network(
    frame: &Frame,
    panels: &[(&[Line], &Trace)],
    sums: &mut [Line],
    network: &mut Part,
    adam: AdamStep,
) {
    for (l, slab) in network.iter_mut().enumerate() {
        let rows = slab.rows.len();
        if rows == 0 {
            continue;
        }
        let (first, end) = (2 * slab.rows.start, 2 * slab.rows.end);
        let pair = |&(input, trace): &(_, _)| {
            let trace: &Trace = trace;
            let x: &[Line] = if l == 0 { input } else { &trace.hidden_by_sample[l - 1] };
            (x, &trace.gradient[l][first..end])
        };
        let pairs: Vec<(&[Line], &[Line])> = panels.iter().map(pair).collect();
        let scratch = &mut sums[..2 * rows];
        let (inputs, weights, step) = (slab.inputs, &mut slab.weights, adam);
        frame.cpu.run(WeightStep { panels: &pairs, rows, inputs, scratch, weights, step });
        let gradients: Vec<&[Line]> = pairs.iter().map(|&(_, dy)| dy).collect();
        frame.cpu.run(BiasStep { panels: &gradients, rows, bias: &mut slab.bias, step });
    }
}
