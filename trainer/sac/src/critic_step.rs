//! The critics' share of an update.
//!
//! ```text
//! y = r + live · γ (min_i Q̄_i(o′, a′) − α ln π(a′|o′)),   a′ ~ π(·|o′)
//! loss = mean Σ_i (Q_i(o, a) − y)²,                        ∂loss/∂Q_i = 2/B (Q_i − y)
//! ```

use crate::batch::{Block, Draw, Frame, Lanes, NO_LANES, Smoothness, join};
use crate::kernel::{Line, ToSamples, Vector, WIDTH, Work};
use crate::min_q::smaller;
use crate::network_step::{ForwardPass, StepScratch, step_network};
use crate::parameters::{NetView, Part};
use crate::policy_sample::Sample;
use crate::replay::Replay;
use crate::{adam::AdamStep, trace::Trace};

/// Inputs of the first phase.
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
    /// Draws a thread's panels and asks the slow critics. Network by network, so that a network's weights stay in the
    /// second-level cache while all panels pass.
    pub(crate) fn ask(&self, block: &mut Block) {
        let frame = self.frame;
        let (cpu, settings) = (frame.cpu, &frame.settings);
        let features = frame.features.features().len();
        let Block { panels, scratch } = block;
        for panel in &mut *panels {
            let Self { replay, smoothness, time, .. } = *self;
            cpu.run(Draw { frame, replay, smoothness, time, panel, scratch });
        }
        for panel in &mut *panels {
            let next = &panel.next;
            scratch.actor.forward(cpu, self.actor, &next.x, 2 * frame.shape.actions, &mut scratch.hidden);
            let sample = Sample {
                head: &scratch.actor.output,
                noise: &panel.noise[1],
                log_std: settings.log_std,
                action: &mut scratch.action,
                stretch: &mut scratch.stretch,
            };
            panel.next_log_probability = cpu.run(sample);
            join(&scratch.action, &next.x, features, &mut panel.next_joint);
            let actions = 2 * frame.shape.actions;
            panel.joint[actions..][..2 * features].copy_from_slice(&panel.views[0].x[..2 * features]);
            cpu.run(ToSamples { features: &panel.joint, samples: &mut panel.joint_by_sample });
        }
        for (c, net) in self.slow.iter().enumerate() {
            for panel in &mut *panels {
                scratch.slow.forward(cpu, net, &panel.next_joint, 1, &mut scratch.hidden);
                panel.slow_value[c].copy_from_slice(&scratch.slow.output[..2]);
            }
        }
    }

    /// Passes a thread's panels through critic `c` and back.
    pub(crate) fn pass(&self, c: usize, block: &mut Block) {
        let (cpu, settings, net) = (self.frame.cpu, &self.frame.settings, &self.critics[c]);
        for panel in &mut block.panels {
            let critic = &mut panel.traces[0];
            critic.forward(cpu, net, &panel.joint, 1, &mut block.scratch.hidden);
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
            critic.backward(cpu, net, 1);
        }
    }
}

fn sum(a: &Lanes, b: &Lanes) -> Lanes {
    std::array::from_fn(|half| Line(std::array::from_fn(|l| a[half].0[l] + b[half].0[l])))
}

/// Parts of a target.
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

/// Takes one thread's rows of the critic that has passed a step, from the panels of all threads.
pub(crate) fn step_critic(frame: &Frame, blocks: &[&Block], room: &mut StepScratch, critic: &mut Part, adam: AdamStep) {
    let panels = blocks.iter().flat_map(|block| &block.panels);
    let traces: Vec<_> = panels.map(|panel| (&*panel.joint_by_sample, &panel.traces[0])).collect();
    let all = traces.len();
    step_network(frame.cpu, ForwardPass { panels: &traces, whole: all, outputs: 1 }, room, critic, adam);
}
