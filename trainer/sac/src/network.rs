//! A policy by itself: layers as plain numbers, a forward pass, a small file.

use crate::elementary::tanh;
use crate::feature_map::FeatureMap;
use crate::kernel::{Cpu, Vector, Work};
use crate::parameters::Plain;

/// `y = x W + b`.
#[derive(Debug, Clone, PartialEq)]
pub struct Dense {
    /// Number of inputs.
    pub inputs: usize,
    /// Number of outputs.
    pub outputs: usize,
    /// `weights[input * outputs + output]`.
    pub weights: Vec<f32>,
    /// One for each output.
    pub bias: Vec<f32>,
}

/// A policy: features, rectified layers, and `tanh` of the last one's outputs.
#[derive(Debug, Clone, PartialEq)]
pub struct Network {
    /// From the raw observation to the first layer's inputs.
    pub features: FeatureMap,
    /// The layers; all but the last are rectified, the last gives the mean before `tanh`.
    pub layers: Vec<Dense>,
    /// Beside the last layer: the logarithm of the standard deviation. Exploration needs it, flying does not.
    pub log_std: Option<Dense>,
}

/// Fault of a network.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum NetworkError {
    /// Layers that do not fit each other, or numbers that are none.
    #[error("policy's layer {layer} {rule}")]
    Layer {
        /// Which, from 0.
        layer: usize,
        /// Rule that it breaks.
        rule: &'static str,
    },
    /// Another size than the learner's.
    #[error("policy has layers {found:?}, the learner {expected:?}; give the learner the same hidden widths")]
    Widths {
        /// Sizes of the network.
        found: Vec<usize>,
        /// Sizes of the learner.
        expected: Vec<usize>,
    },
    /// Other features than the learner's.
    #[error("policy reads other features than the learner; both must be made for the same observation contract")]
    Features,
}

/// Memory for [`Network::mean_action_with`], so that no call allocates.
#[derive(Debug, Default, Clone)]
pub struct Workspace {
    front: Vec<f32>,
    back: Vec<f32>,
}

impl Network {
    /// Widths from features to actions.
    pub fn widths(&self) -> Vec<usize> {
        let inputs = self.features.features().len();
        std::iter::once(inputs).chain(self.layers.iter().map(|layer| layer.outputs)).collect()
    }

    /// Refuses layers that do not fit each other.
    ///
    /// # Errors
    /// The first layer that does not fit, or holds a number that is none.
    pub fn check(&self) -> Result<(), NetworkError> {
        let widths = self.widths();
        if self.layers.is_empty() {
            return Err(NetworkError::Layer { layer: 0, rule: "is missing" });
        }
        let last = self.layers.len() - 1;
        let inputs_of = |layer: usize| if layer > last { widths[last] } else { widths[layer] };
        for (layer, dense) in self.layers.iter().chain(&self.log_std).enumerate() {
            let fault = |rule| Err(NetworkError::Layer { layer, rule });
            if dense.inputs != inputs_of(layer) {
                return fault("must take what the layer before gives");
            }
            if layer > last && dense.outputs != widths[last + 1] {
                return fault("(of the standard deviation) must give one value an action");
            }
            if dense.outputs == 0 || dense.weights.len() != dense.inputs * dense.outputs {
                return fault("needs a weight for each pair of input and output");
            }
            if dense.bias.len() != dense.outputs {
                return fault("needs a bias for each output");
            }
            if dense.weights.iter().chain(&dense.bias).any(|x| !x.is_finite()) {
                return fault("must have finite weights");
            }
        }
        Ok(())
    }

    /// As [`Self::mean_action_with`], in memory of its own.
    #[cfg(test)]
    pub(crate) fn mean_action(&self, observation: &[f32]) -> Vec<f32> {
        let mut workspace = Workspace::default();
        self.mean_action_with(&mut workspace, observation).to_vec()
    }

    /// Deterministic action of one raw observation, each entry in (-1, 1), in memory that is kept between calls.
    pub fn mean_action_with<'w>(&self, workspace: &'w mut Workspace, observation: &[f32]) -> &'w [f32] {
        workspace.front.resize(self.features.features().len(), 0.0);
        Cpu::best().run(Pass { network: self, observation, workspace });
        &workspace.front
    }
}

impl Network {
    /// Values of the last hidden layer for one raw observation, which the last layer takes.
    pub fn last_hidden(&self, observation: &[f32]) -> Vec<f32> {
        let mut front = vec![0.0; self.features.features().len()];
        self.features.apply(observation, &mut front);
        let hidden = self.layers.split_last().map_or(&[][..], |(_, hidden)| hidden);
        for layer in hidden {
            let mut back = layer.bias.clone();
            for (x, weights) in front.iter().zip(layer.weights.chunks_exact(layer.outputs)) {
                back.iter_mut().zip(weights).for_each(|(y, w)| *y += w * x);
            }
            back.iter_mut().for_each(|y| *y = y.max(0.0));
            front = back;
        }
        front
    }
}

struct Pass<'a> {
    network: &'a Network,
    observation: &'a [f32],
    workspace: &'a mut Workspace,
}

impl Work for Pass<'_> {
    type Output = ();
    /// Does the same products in the same order as the learner's kernels: the same bits.
    #[inline(always)]
    fn run<V: Vector>(self) {
        let Workspace { front, back } = self.workspace;
        self.network.features.apply(self.observation, front);
        let last = self.network.layers.len().saturating_sub(1);
        for (n, layer) in self.network.layers.iter().enumerate() {
            back.clear();
            back.extend_from_slice(&layer.bias);
            for (x, weights) in front.iter().zip(layer.weights.chunks_exact(layer.outputs)) {
                for (y, w) in back.iter_mut().zip(weights) {
                    *y = w.mul_add(*x, *y);
                }
            }
            if n < last {
                back.iter_mut().for_each(|y| *y = if *y < 0.0 { 0.0 } else { *y });
            }
            std::mem::swap(front, back);
        }
        front.iter_mut().for_each(|y| *y = tanh(*y));
    }
}

impl Dense {
    /// Rows `rows` of a layer stored by output.
    pub(crate) fn from_plain(plain: &Plain, rows: std::ops::Range<usize>) -> Self {
        let (inputs, outputs) = (plain.inputs, rows.len());
        let mut weights = vec![0.0; inputs * outputs];
        for (n, row) in rows.clone().enumerate() {
            for k in 0..inputs {
                weights[k * outputs + n] = plain.weights[row * inputs + k];
            }
        }
        Self { inputs, outputs, weights, bias: plain.bias[rows].to_vec() }
    }

    /// Writes the layer to rows from `first` on of one stored by output.
    pub(crate) fn write_to(&self, plain: &mut Plain, first: usize) {
        for n in 0..self.outputs {
            for k in 0..self.inputs {
                plain.weights[(first + n) * self.inputs + k] = self.weights[k * self.outputs + n];
            }
            plain.bias[first + n] = self.bias[n];
        }
    }
}
