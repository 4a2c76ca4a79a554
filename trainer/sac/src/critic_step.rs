//! The critics' share of an update.
//!
//! ```text
//! y = r + live · γ (min_i Q̄_i(o′, a′) − α ln π(a′|o′)),   a′ ~ π(·|o′)
//! loss = mean Σ_i (Q_i(o, a) − y)²,                        ∂loss/∂Q_i = 2/B (Q_i − y)
//! ```

use std::ops::Range;

use crate::batch::{Block, Draw, Frame, Lanes, NO_LANES, Smoothness, VIEWS, join};
use crate::judges::smaller;
use crate::kernel::{BiasStep, Coast, LANES, Line, Lines, ToSamples, Vector, WIDTH, WeightStep, Work, zeroed};
use crate::parameters::{NetView, Part, Slab};
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
    /// Draws a thread's panels and asks the slow critics. Network by network, so that a network's weights stay in the
    /// second-level cache while all panels pass.
    pub(crate) fn ask(&self, block: &mut Block) {
        let frame = self.frame;
        let (cpu, settings) = (frame.cpu, &frame.settings);
        let features = frame.features.features().len();
        let Block { panels, spare } = block;
        for panel in &mut *panels {
            let Self { replay, smoothness, time, .. } = *self;
            cpu.run(Draw { frame, replay, smoothness, time, panel, spare });
        }
        for panel in &mut *panels {
            let next = &panel.next;
            spare.actor.forward(cpu, self.actor, &next.x, 2 * frame.shape.actions, &mut spare.hidden);
            let sample = Sample {
                head: &spare.actor.output,
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
                spare.slow.forward(cpu, net, &panel.next_joint, 1, &mut spare.hidden);
                panel.slow_value[c].copy_from_slice(&spare.slow.output[..2]);
            }
        }
    }

    /// Passes a thread's panels through critic `c` and back.
    pub(crate) fn pass(&self, c: usize, block: &mut Block) {
        let (cpu, settings, net) = (self.frame.cpu, &self.frame.settings, &self.critics[c]);
        for panel in &mut block.panels {
            let critic = &mut panel.traces[0];
            critic.forward(cpu, net, &panel.joint, 1, &mut block.spare.hidden);
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

/// Takes one thread's rows of the critic that has passed a step, from the panels of all threads.
pub(crate) fn step_critic(frame: &Frame, blocks: &[&Block], room: &mut StepRoom, critic: &mut Part, adam: AdamStep) {
    let panels = blocks.iter().flat_map(|block| &block.panels);
    let traces: Vec<_> = panels.map(|panel| (&*panel.joint_by_sample, &panel.traces[0])).collect();
    let all = traces.len();
    step_network(frame, Passed { panels: &traces, whole: all, outputs: 1 }, room, critic, adam);
}

/// Panels that a network has passed and is to learn from.
pub(crate) struct Passed<'a> {
    /// Each with its input, sample by sample.
    pub(crate) panels: &'a [(&'a [Line], &'a Trace)],
    /// The first so many came out of all rows of the last layer, the others only out of its first `outputs` rows.
    pub(crate) whole: usize,
    pub(crate) outputs: usize,
}

/// One in so many rows must have no gradient for the others to be put together.
const WORTH_PACKING: usize = 16;

/// Room that a thread's steps need.
#[derive(Debug)]
pub(crate) struct StepRoom {
    /// Two lines for each row of the widest layer.
    sums: Lines,
    /// Gradients of the rows of a hidden layer that any sample opens, panel by panel.
    packed: Lines,
}

impl StepRoom {
    pub(crate) fn new(frame: &Frame) -> Self {
        let widest = [frame.actor_widths(), frame.critic_widths()].concat().into_iter().max().unwrap_or(0);
        let panels = VIEWS.len() * frame.settings.batch.div_ceil(LANES);
        Self { sums: zeroed(2 * widest), packed: zeroed(panels * 2 * widest) }
    }
}

/// A layer's input, sample by sample, and gradients of some of its rows.
type Pair<'a> = (&'a [Line], &'a [Line]);

/// Takes one thread's rows of a network a step.
pub(crate) fn step_network(frame: &Frame, passed: Passed<'_>, room: &mut StepRoom, network: &mut Part, adam: AdamStep) {
    let Passed { panels, whole, outputs } = passed;
    let last = network.len() - 1;
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
        let pairs: Vec<Pair<'_>> = panels.iter().map(pair).collect();
        if l == last {
            // Rows that all panels came out of, then the others.
            let cut = outputs.saturating_sub(slab.rows.start).min(rows);
            step_rows(frame, slab, &numbers(0..cut), &cut_to(&pairs, 0..cut), &mut room.sums, adam);
            step_rows(frame, slab, &numbers(cut..rows), &cut_to(&pairs[..whole], cut..rows), &mut room.sums, adam);
        } else {
            let open = |row: &u16| {
                let row = slab.rows.start + usize::from(*row);
                panels.iter().any(|(_, trace)| trace.gates[l][row] != 0)
            };
            let (live, silent): (Vec<u16>, Vec<u16>) = numbers(0..rows).into_iter().partition(open);
            step_hidden(frame, slab, [&live, &silent], &pairs, room, adam);
        }
        let gradients: Vec<&[Line]> = pairs.iter().map(|&(_, dy)| dy).collect();
        frame.cpu.run(BiasStep { panels: &gradients, rows, bias: &mut slab.bias, step: adam });
    }
}

/// Takes the rows of a hidden layer a step, of which some are live and others no sample opens. These have no gradient and
/// take their step without one; so that this saves time the live ones are put together. It changes no bit.
fn step_hidden(
    frame: &Frame,
    slab: &mut Slab,
    [live, silent]: [&[u16]; 2],
    pairs: &[Pair<'_>],
    room: &mut StepRoom,
    adam: AdamStep,
) {
    let rows = slab.rows.len();
    if silent.len() * WORTH_PACKING < rows {
        return step_rows(frame, slab, &numbers(0..rows), pairs, &mut room.sums, adam);
    }
    let lines = 2 * live.len();
    let mut packed = Vec::with_capacity(pairs.len());
    let mut left = &mut *room.packed;
    for (x, dy) in pairs {
        let (own, rest) = left.split_at_mut(lines);
        for (to, &row) in own.chunks_exact_mut(2).zip(live) {
            to.copy_from_slice(&dy[2 * usize::from(row)..][..2]);
        }
        packed.push((*x, &*own));
        left = rest;
    }
    step_rows(frame, slab, live, &packed, &mut room.sums, adam);
    let (inputs, row_step) = (slab.inputs, slab.row_step());
    frame.cpu.run(Coast { rows: silent, inputs, row_step, weights: &mut slab.weights, step: adam });
}

/// Takes some rows of a layer a step by the gradients in `panels`, in the order of `rows`.
fn step_rows(frame: &Frame, slab: &mut Slab, rows: &[u16], panels: &[Pair<'_>], sums: &mut [Line], step: AdamStep) {
    if rows.is_empty() {
        return;
    }
    let (inputs, row_step, weights) = (slab.inputs, slab.row_step(), &mut slab.weights);
    frame.cpu.run(WeightStep { panels, rows, inputs, row_step, scratch: sums, weights, step });
}

fn numbers(rows: Range<usize>) -> Vec<u16> {
    rows.map(|row| row as u16).collect()
}

/// The pairs with these rows' gradients alone.
fn cut_to<'a>(pairs: &[Pair<'a>], rows: Range<usize>) -> Vec<Pair<'a>> {
    pairs.iter().map(|&(x, dy)| (x, &dy[2 * rows.start..2 * rows.end])).collect()
}
