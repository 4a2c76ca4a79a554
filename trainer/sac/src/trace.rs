//! One network over one panel of 32 samples: forward, and backward through the rectifiers.
//!
//! ```text
//! h₀ = x,  h_l = max(W_l h_(l−1) + b_l, 0),  y = W_L h_(L−1) + b_L
//! d_L = ∂loss/∂y,  d_l = (W_(l+1)ᵀ d_(l+1)) · [h_l > 0],  ∂loss/∂W_l = d_l h_(l−1)ᵀ
//! ```

use crate::kernel::{Backward, Cpu, Forward, Line, ToSamples, WIDTH, Weights, zeroed};
use crate::parameters::NetView;

/// What a pass leaves for the way back.
#[derive(Debug)]
pub(crate) struct Trace {
    /// Outputs of the hidden layers, feature by feature.
    pub(crate) hidden: Vec<Vec<Line>>,
    /// The same sample by sample, once [`Trace::turn`] has run.
    pub(crate) hidden_by_sample: Vec<Vec<Line>>,
    /// Output of the last layer.
    pub(crate) output: Vec<Line>,
    /// `d_l` of every layer; the last is set by the caller.
    pub(crate) gradient: Vec<Vec<Line>>,
}

/// Lines of a panel of this many features, padded so that it can be transposed.
pub(crate) fn panel_lines(features: usize) -> usize {
    2 * features.next_multiple_of(WIDTH)
}

impl Trace {
    /// Buffers for a network with these widths, inputs first.
    pub(crate) fn new(widths: &[usize]) -> Self {
        let hidden = &widths[1..widths.len() - 1];
        let panels = |widths: &[usize]| widths.iter().map(|&w| zeroed(panel_lines(w))).collect::<Vec<_>>();
        Self {
            hidden: panels(hidden),
            hidden_by_sample: panels(hidden),
            output: zeroed(panel_lines(widths[widths.len() - 1])),
            gradient: panels(&widths[1..]),
        }
    }

    /// Passes a panel through the network.
    pub(crate) fn forward(&mut self, cpu: Cpu, net: &NetView<'_>, x: &[Line]) {
        let last = net.layers.len() - 1;
        for (l, parts) in net.layers.iter().enumerate() {
            let (before, after) = self.hidden.split_at_mut(l);
            let x = before.last().map_or(x, Vec::as_slice);
            let mut y = if l == last { self.output.as_mut_slice() } else { after[0].as_mut_slice() };
            for &weights in parts {
                let (rows, rest) = y.split_at_mut(2 * weights.rows);
                cpu.run(Forward { weights, x, y: rows, rectify: l != last });
                y = rest;
            }
        }
    }

    /// From the last layer's gradient to the first's and, where wanted, to the first inputs.
    pub(crate) fn backward(&mut self, cpu: Cpu, net: &NetView<'_>, inputs: Option<(usize, &mut [Line])>) {
        for l in (1..net.layers.len()).rev() {
            let (before, after) = self.gradient.split_at_mut(l);
            let parts = with_rows(&net.layers[l], &after[0]);
            let (dx, gate) = (before[l - 1].as_mut_slice(), &self.hidden[l - 1]);
            let inputs = net.layers[l][0].inputs;
            cpu.run(Backward { parts: &parts, inputs, gate: Some(gate), dx });
        }
        if let Some((inputs, dx)) = inputs {
            let parts = with_rows(&net.layers[0], &self.gradient[0]);
            cpu.run(Backward { parts: &parts, inputs, gate: None, dx });
        }
    }

    /// Prepares the weight gradients: hidden outputs sample by sample.
    pub(crate) fn turn(&mut self, cpu: Cpu) {
        for (features, samples) in self.hidden.iter().zip(&mut self.hidden_by_sample) {
            cpu.run(ToSamples { features, samples });
        }
    }
}

/// Each part of a layer with its rows of the gradient.
fn with_rows<'a>(parts: &[Weights<'a>], mut dy: &'a [Line]) -> Vec<(Weights<'a>, &'a [Line])> {
    let pair = |&weights: &Weights<'a>| {
        let (rows, rest) = dy.split_at(2 * weights.rows);
        dy = rest;
        (weights, rows)
    };
    parts.iter().map(pair).collect()
}
