//! A network's step, layer by layer, from the panels that have passed it.
//!
//! Each thread takes its own rows of every layer. Rows of a hidden layer that no sample of the batch opens have no gradient
//! (`d_l = … · [h_l > 0]`): they are left out of the products, and their moments fade.

use std::ops::Range;

use crate::adam::AdamStep;
use crate::batch::{Frame, VIEWS};
use crate::kernel::{BiasStep, Cpu, LANES, Line, Lines, MomentumStep, WeightStep, zeroed};
use crate::parameters::{Part, Slab};
use crate::trace::Trace;

/// Panels that a network has passed and is to learn from.
pub(crate) struct ForwardPass<'a> {
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
pub(crate) struct StepScratch {
    /// Two lines for each row of the widest layer.
    sums: Lines,
    /// Gradients of the rows of a hidden layer that any sample opens, panel by panel.
    packed: Lines,
}

impl StepScratch {
    pub(crate) fn new(frame: &Frame) -> Self {
        let widest = [frame.actor_widths(), frame.critic_widths()].concat().into_iter().max().unwrap_or(0);
        Self::for_widest(widest, VIEWS.len() * frame.settings.batch.div_ceil(LANES))
    }

    /// For so many panels, and networks whose widest layer has so many rows.
    pub(crate) fn for_widest(widest: usize, panels: usize) -> Self {
        Self { sums: zeroed(2 * widest), packed: zeroed(panels * 2 * widest) }
    }
}

/// A layer's input, sample by sample, and gradients of some of its rows.
type Pair<'a> = (&'a [Line], &'a [Line]);

/// Takes one thread's rows of a network a step.
pub(crate) fn step_network(
    cpu: Cpu,
    passed: ForwardPass<'_>,
    room: &mut StepScratch,
    network: &mut Part,
    adam: AdamStep,
) {
    let ForwardPass { panels, whole, outputs } = passed;
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
            step_rows(cpu, slab, &numbers(0..cut), &cut_to(&pairs, 0..cut), &mut room.sums, adam);
            step_rows(cpu, slab, &numbers(cut..rows), &cut_to(&pairs[..whole], cut..rows), &mut room.sums, adam);
        } else {
            let open = |row: &u16| {
                let row = slab.rows.start + usize::from(*row);
                panels.iter().any(|(_, trace)| trace.gates[l][row] != 0)
            };
            let (live, silent): (Vec<u16>, Vec<u16>) = numbers(0..rows).into_iter().partition(open);
            step_hidden(cpu, slab, [&live, &silent], &pairs, room, adam);
        }
        let gradients: Vec<&[Line]> = pairs.iter().map(|&(_, dy)| dy).collect();
        cpu.run(BiasStep { panels: &gradients, rows, bias: &mut slab.bias, step: adam });
    }
}

/// Takes the rows of a hidden layer a step, of which some are live and others no sample opens. These have no gradient and
/// take their step without one; so that this saves time the live ones are put together. It changes no bit.
fn step_hidden(
    cpu: Cpu,
    slab: &mut Slab,
    [live, silent]: [&[u16]; 2],
    pairs: &[Pair<'_>],
    room: &mut StepScratch,
    adam: AdamStep,
) {
    let rows = slab.rows.len();
    if silent.len() * WORTH_PACKING < rows {
        return step_rows(cpu, slab, &numbers(0..rows), pairs, &mut room.sums, adam);
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
    step_rows(cpu, slab, live, &packed, &mut room.sums, adam);
    let (inputs, row_step) = (slab.inputs, slab.row_step());
    cpu.run(MomentumStep { rows: silent, inputs, row_step, weights: &mut slab.weights, step: adam });
}

/// Takes some rows of a layer a step by the gradients in `panels`, in the order of `rows`.
fn step_rows(cpu: Cpu, slab: &mut Slab, rows: &[u16], panels: &[Pair<'_>], sums: &mut [Line], step: AdamStep) {
    if rows.is_empty() {
        return;
    }
    let (inputs, row_step, weights) = (slab.inputs, slab.row_step(), &mut slab.weights);
    cpu.run(WeightStep { panels, rows, inputs, row_step, scratch: sums, weights, step });
}

fn numbers(rows: Range<usize>) -> Vec<u16> {
    rows.map(|row| row as u16).collect()
}

/// The pairs with these rows' gradients alone.
fn cut_to<'a>(pairs: &[Pair<'a>], rows: Range<usize>) -> Vec<Pair<'a>> {
    pairs.iter().map(|&(x, dy)| (x, &dy[2 * rows.start..2 * rows.end])).collect()
}
