//! One network over one panel of 32 samples: forward, and backward through the rectifiers.
//!
//! ```text
//! h₀ = x,  h_l = max(W_l h_(l−1) + b_l, 0),  y = W_L h_(L−1) + b_L
//! d_L = ∂loss/∂y,  d_l = (W_(l+1)ᵀ d_(l+1)) · [h_l > 0],  ∂loss/∂W_l = d_l h_(l−1)ᵀ
//! ```
//!
//! Hidden outputs feature by feature live only until the next layer has read them: one buffer serves all passes of a
//! thread and stays in the caches. What is kept is a bit a sample for the way back and, where weights will take a
//! step, the outputs sample by sample. All of an update at once would not fit the second-level cache.

use crate::kernel::{Backward, Cpu, Forward, Gate, Line, Lines, Rows, ToSamples, WIDTH, Weights, zeroed};
use crate::parameters::NetView;

/// Trace that a pass leaves for the way back.
#[derive(Debug)]
pub(crate) struct Trace {
    /// For each feature of each hidden layer the samples that passed its rectifier.
    pub(crate) gates: Vec<Vec<Gate>>,
    /// Outputs of the hidden layers, sample by sample; empty where no weights take a step.
    pub(crate) hidden_by_sample: Vec<Lines>,
    /// Output of the last layer.
    pub(crate) output: Lines,
    /// `d_l` of every layer; the last is set by the caller.
    pub(crate) gradient: Vec<Lines>,
}

/// Outputs of hidden layers, feature by feature, for each pass in turn.
#[derive(Debug)]
pub(crate) struct Hidden(Vec<Lines>);

impl Hidden {
    /// Buffers for networks with these widths, inputs first.
    pub(crate) fn new(widths: &[usize]) -> Self {
        Self(panels(&widths[1..widths.len() - 1]))
    }
}

/// Lines of a panel of this many features, padded so that it can be transposed.
pub(crate) fn panel_lines(features: usize) -> usize {
    2 * features.next_multiple_of(WIDTH)
}

fn panels(widths: &[usize]) -> Vec<Lines> {
    widths.iter().map(|&w| zeroed(panel_lines(w))).collect()
}

impl Trace {
    /// Buffers for a network with these widths, inputs first.
    pub(crate) fn new(widths: &[usize]) -> Self {
        let hidden = &widths[1..widths.len() - 1];
        Self {
            gates: hidden.iter().map(|&w| vec![0; w]).collect(),
            hidden_by_sample: panels(hidden),
            output: zeroed(panel_lines(widths[widths.len() - 1])),
            gradient: panels(&widths[1..]),
        }
    }

    /// As [`Self::new`] for a network that only passes forward, or back by way of another's gradients.
    pub(crate) fn passing(widths: &[usize]) -> Self {
        let hidden = &widths[1..widths.len() - 1];
        let gates = hidden.iter().map(|&w| vec![0; w]).collect();
        let output = zeroed(panel_lines(widths[widths.len() - 1]));
        Self { gates, hidden_by_sample: Vec::new(), output, gradient: Vec::new() }
    }

    /// Passes a panel through the network, of whose last layer the first `outputs` rows are wanted.
    pub(crate) fn forward(&mut self, cpu: Cpu, net: &NetView<'_>, x: &[Line], outputs: usize, hidden: &mut Hidden) {
        let last = net.layers.len() - 1;
        for (l, parts) in net.layers.iter().enumerate() {
            let (before, after) = hidden.0.split_at_mut(l);
            let x = before.last().map_or(x, |lines| &**lines);
            let (mut y, mut row) = (if l == last { &mut *self.output } else { &mut *after[0] }, 0);
            for weights in parts {
                let weights = if l == last { weights.first(outputs - row) } else { *weights };
                let (rows, rest) = y.split_at_mut(2 * weights.rows);
                let gates = self.gates.get_mut(l).map(|gates| &mut gates[row..][..weights.rows]);
                cpu.run(Forward { weights, x, y: rows, gates });
                (y, row) = (rest, row + weights.rows);
            }
            if let Some(samples) = self.hidden_by_sample.get_mut(l) {
                cpu.run(ToSamples { features: &after[0], samples });
            }
        }
    }

    /// From the gradient of the last layer's first `outputs` rows to the first layer's.
    pub(crate) fn backward(&mut self, cpu: Cpu, net: &NetView<'_>, outputs: usize) {
        let last = net.layers.len() - 1;
        for l in (1..=last).rev() {
            let (before, after) = self.gradient.split_at_mut(l);
            let wanted = if l == last { outputs } else { usize::MAX };
            let parts = rows(net, l, wanted, &after[0], self.gates.get(l));
            let (dx, gates) = (&mut *before[l - 1], Some(self.gates[l - 1].as_slice()));
            let inputs = net.layers[l][0].inputs;
            cpu.run(Backward { parts: &parts, inputs, gates, dx });
        }
    }

    /// From the first layer's gradient to the first of its inputs, as many as there is room for at two lines each.
    pub(crate) fn to_inputs(&self, cpu: Cpu, net: &NetView<'_>, dx: &mut [Line]) {
        let parts = rows(net, 0, usize::MAX, &self.gradient[0], self.gates.first());
        cpu.run(Backward { parts: &parts, inputs: dx.len() / 2, gates: None, dx });
    }
}

/// Each part of the first `wanted` rows of layer `l` with its rows of the gradient, those live that a gate lets through.
fn rows<'a>(
    net: &NetView<'a>,
    l: usize,
    mut wanted: usize,
    mut dy: &'a [Line],
    gates: Option<&Vec<Gate>>,
) -> Vec<Rows<'a>> {
    let mut first = 0;
    let pair = |weights: &Weights<'a>| {
        let weights = weights.first(wanted);
        let (own, rest) = dy.split_at(2 * weights.rows);
        let open = |n: &u16| gates.is_none_or(|gates| gates[first + usize::from(*n)] != 0);
        let live = (0..weights.rows as u16).filter(open).collect();
        (dy, wanted, first) = (rest, wanted - weights.rows, first + weights.rows);
        Rows { weights, dy: own, live }
    };
    net.layers[l].iter().map(pair).collect()
}
