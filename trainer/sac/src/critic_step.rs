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
    /// Draws a thread's panels, passes them forward and back.
    pub(crate) fn pass(&self, block: &mut Block) {
        let frame = self.frame;
        let (cpu, settings) = (frame.cpu, &frame.settings);
        let features = frame.features.features().len();
        let actions = 2 * frame.shape.actions;
        let Block { panels, spare } = block;
        for panel in panels {
            let Self { replay, smoothness, time, .. } = *self;
            cpu.run(Draw { frame, replay, smoothness, time, panel, spare });
            let next = &mut spare.next;
            next.trace.forward(cpu, self.actor, &next.x);
            let sample = Sample {
                head: &next.trace.output,
                noise: &panel.noise[1],
                log_std: settings.log_std,
                action: &mut spare.action,
                stretch: &mut spare.stretch,
            };
            let log_probability = cpu.run(sample);
            join(&spare.action, &next.x, features, &mut spare.joint);
            for (slow, net) in spare.slow.iter_mut().zip(self.slow) {
                slow.forward(cpu, net, &spare.joint);
            }
            panel.joint[actions..][..2 * features].copy_from_slice(&panel.views[0].x[..2 * features]);
            for (critic, net) in panel.critics.iter_mut().zip(self.critics) {
                critic.forward(cpu, net, &panel.joint);
            }
            let error = TargetError {
                reward: &panel.reward,
                live: &panel.live,
                slow: &spare.slow,
                log_probability: &log_probability,
                critics: &mut panel.critics,
                discount: settings.discount,
                temperature: self.temperature,
                batch: settings.batch,
            };
            panel.records.critic_loss = cpu.run(error);
            for (critic, net) in panel.critics.iter_mut().zip(self.critics) {
                critic.backward(cpu, net, None);
                critic.turn(cpu);
            }
            cpu.run(ToSamples { features: &panel.joint, samples: &mut panel.joint_by_sample });
        }
    }
}

/// Sets the critics' last gradients from their targets; gives the loss of each sample.
struct TargetError<'a> {
    reward: &'a Lanes,
    live: &'a Lanes,
    slow: &'a [Trace; 2],
    log_probability: &'a Lanes,
    critics: &'a mut [Trace; 2],
    discount: f32,
    temperature: f32,
    batch: usize,
}

impl Work for TargetError<'_> {
    type Output = Lanes;
    #[inline(always)]
    fn run<V: Vector>(self) -> Lanes {
        let mut loss = NO_LANES;
        for half in 0..2 {
            let values = [0, 1].map(|c| self.slow[c].output[half].0);
            let mut target = [0.0; WIDTH];
            for l in 0..WIDTH {
                let future = smaller(values[0][l], values[1][l]) - self.temperature * self.log_probability[half].0[l];
                target[l] = (self.live[half].0[l] * self.discount).mul_add(future, self.reward[half].0[l]);
            }
            for critic in &mut *self.critics {
                let value = critic.output[half];
                let Some(gradient) = critic.gradient.last_mut() else { continue };
                for l in 0..WIDTH {
                    let error = value.0[l] - target[l];
                    gradient[half].0[l] = 2.0 / self.batch as f32 * error;
                    loss[half].0[l] = error.mul_add(error, loss[half].0[l]);
                }
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
