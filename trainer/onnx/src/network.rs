//! Network that is exported: scaled features of the observation, dense layers with rectifiers, a tanh mapped to duties.
//!
//! ```text
//! f_k = ((x[plus_k] − x[minus_k]) − offset_k) · scale_k
//! h_0 = f,   h_(l+1) = max(0, W_l h_l + b_l),   z = W_L h_L + b_L
//! y_j = scale_j · tanh(z_j) + shift_j
//! ```
//!
//! In f32 the features have the same bits in every runtime, with or without fused products: the difference is rounded
//! once, then the offset, then the scale. A trainer that computes them in this order sees what the file computes.

use crate::error::ExportError;

/// One feature: an observation, or the difference of two, shifted and scaled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FeatureTerm {
    /// Place of the observation.
    pub plus: usize,
    /// Place of the observation that is taken off, if one is.
    pub minus: Option<usize>,
    /// Offset that is taken off, in the observation's unit.
    pub offset: f32,
    /// Factor, in 1 over that unit.
    pub scale: f32,
}

/// A dense layer.
#[derive(Debug, Clone, PartialEq)]
pub struct Dense {
    /// Values it takes.
    pub inputs: usize,
    /// Values it gives.
    pub outputs: usize,
    /// `weights[input * outputs + output]`.
    pub weights: Vec<f32>,
    /// One for each output.
    pub biases: Vec<f32>,
}

/// Range that an output's tanh is mapped to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutputMap {
    /// Half of the range.
    pub scale: f32,
    /// Middle.
    pub shift: f32,
}

impl OutputMap {
    /// Maps −1 … 1 to `low` … `high`.
    pub fn onto(low: f32, high: f32) -> Self {
        OutputMap { scale: 0.5 * (high - low), shift: 0.5 * (high + low) }
    }
}

/// A policy's network.
#[derive(Debug, Clone, PartialEq)]
pub struct PolicyGraph {
    /// Observations.
    pub inputs: usize,
    /// Features of the first layer.
    pub features: Vec<FeatureTerm>,
    /// Rectified but for the last, whose outputs go through the tanh.
    pub layers: Vec<Dense>,
    /// One for each output.
    pub outputs: Vec<OutputMap>,
}

impl PolicyGraph {
    /// Tells whether sizes fit and all numbers are finite.
    ///
    /// # Errors
    /// The first [`ExportError`] about sizes, places and values.
    pub fn check(&self) -> Result<(), ExportError> {
        let inputs = self.inputs;
        for (feature, term) in self.features.iter().enumerate() {
            if let Some(index) = [Some(term.plus), term.minus].into_iter().flatten().find(|&i| i >= inputs) {
                return Err(ExportError::FeatureIndex { feature, index, inputs });
            }
        }
        let mut width = self.features.len();
        for (layer, dense) in self.layers.iter().enumerate() {
            if dense.inputs != width || width == 0 {
                return Err(ExportError::LayerWidth { layer, found: dense.inputs, expected: width });
            }
            let sizes = [
                ("weights", dense.weights.len(), dense.inputs.saturating_mul(dense.outputs)),
                ("biases", dense.biases.len(), dense.outputs),
            ];
            if let Some((what, found, expected)) = sizes.into_iter().find(|(_, found, expected)| found != expected) {
                return Err(ExportError::LayerSize { layer, what, found, expected });
            }
            width = dense.outputs;
        }
        if self.layers.is_empty() {
            return Err(ExportError::NoLayers);
        }
        if self.outputs.len() != width {
            return Err(ExportError::OutputMaps { found: self.outputs.len(), expected: width });
        }
        finite("number of the features", self.features.iter().flat_map(|t| [t.offset, t.scale]))?;
        finite("number of the output maps", self.outputs.iter().flat_map(|m| [m.scale, m.shift]))?;
        finite("weight", self.layers.iter().flat_map(|l| l.weights.iter().copied()))?;
        finite("bias", self.layers.iter().flat_map(|l| l.biases.iter().copied()))
    }

    /// The answer to one observation, in f64 and rounded to f32 at the end: what any correct f32 program approaches.
    ///
    /// # Errors
    /// As [`PolicyGraph::check`], and [`ExportError::RowLength`] for an observation of another length.
    pub fn run(&self, observation: &[f32]) -> Result<Vec<f32>, ExportError> {
        self.check()?;
        if observation.len() != self.inputs {
            let (found, expected) = (observation.len(), self.inputs);
            return Err(ExportError::RowLength { what: "the observation", found, expected });
        }
        Ok(self.answer(observation))
    }

    /// As [`PolicyGraph::run`], of a network that was checked.
    pub(crate) fn answer(&self, observation: &[f32]) -> Vec<f32> {
        let at = |i: usize| f64::from(observation.get(i).copied().unwrap_or(f32::NAN));
        let feature =
            |t: &FeatureTerm| (at(t.plus) - t.minus.map_or(0.0, at) - f64::from(t.offset)) * f64::from(t.scale);
        let mut values: Vec<f64> = self.features.iter().map(feature).collect();
        for (l, layer) in self.layers.iter().enumerate() {
            if l > 0 {
                values.iter_mut().for_each(|v| *v = v.max(0.0));
            }
            values = layer.apply(&values);
        }
        let mapped = |(z, map): (&f64, &OutputMap)| f64::from(map.scale) * z.tanh() + f64::from(map.shift);
        values.iter().zip(&self.outputs).map(mapped).map(|y| y as f32).collect()
    }
}

impl Dense {
    fn apply(&self, x: &[f64]) -> Vec<f64> {
        let mut sums: Vec<f64> = self.biases.iter().map(|&b| f64::from(b)).collect();
        for (x, row) in x.iter().zip(self.weights.chunks_exact(self.outputs.max(1))) {
            for (sum, &weight) in sums.iter_mut().zip(row) {
                *sum += f64::from(weight) * x;
            }
        }
        sums
    }
}

fn finite(what: &'static str, values: impl Iterator<Item = f32>) -> Result<(), ExportError> {
    match values.enumerate().find(|(_, v)| !v.is_finite()) {
        Some((place, value)) => Err(ExportError::NotFinite { what, place, value }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two features, two hidden neurons of which the second is rectified away, one output.
    fn small() -> PolicyGraph {
        PolicyGraph {
            inputs: 3,
            features: vec![
                FeatureTerm { plus: 0, minus: None, offset: 80.0, scale: 0.0125 },
                FeatureTerm { plus: 0, minus: Some(2), offset: 0.0, scale: 0.5 },
            ],
            layers: vec![
                Dense { inputs: 2, outputs: 2, weights: vec![2.0, -1.0, 0.5, -3.0], biases: vec![0.25, 0.0] },
                Dense { inputs: 2, outputs: 1, weights: vec![0.4, 100.0], biases: vec![-0.1] },
            ],
            outputs: vec![OutputMap::onto(0.0, 1.0)],
        }
    }

    /// By hand for x = (100, 7, 99): f = (0.25, 0.5), h = (2·0.25 + 0.5·0.5 + 0.25, max(0, −1.75)) = (1, 0),
    /// z = 0.3, tanh 0.3 = 0.29131 26125 (Abramowitz & Stegun, table 4.15), y = 0.64565 63062.
    #[test]
    fn forward_pass_by_hand() {
        let answer = small().run(&[100.0, 7.0, 99.0]).unwrap();
        assert_eq!(answer, [0.645_656_306_2_f64 as f32]);
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let refused = |change: fn(&mut PolicyGraph)| {
            let mut graph = small();
            change(&mut graph);
            graph.check().unwrap_err()
        };
        use ExportError::*;
        assert!(matches!(refused(|g| g.features[1].minus = Some(3)), FeatureIndex { feature: 1, index: 3, inputs: 3 }));
        assert!(matches!(refused(|g| g.features.clear()), LayerWidth { layer: 0, found: 2, expected: 0 }));
        assert!(matches!(refused(|g| g.layers.clear()), NoLayers));
        assert!(matches!(refused(|g| g.layers.reverse()), LayerWidth { layer: 1, found: 2, expected: 1 }));
        assert!(matches!(
            refused(|g| {
                g.layers[1].weights.pop();
            }),
            LayerSize { layer: 1, what: "weights", .. }
        ));
        assert!(matches!(refused(|g| g.layers[0].biases.push(0.0)), LayerSize { layer: 0, what: "biases", .. }));
        assert!(matches!(refused(|g| g.outputs.clear()), OutputMaps { found: 0, expected: 1 }));
        assert!(matches!(refused(|g| g.layers[0].weights[3] = f32::NAN), NotFinite { what: "weight", place: 3, .. }));
        assert!(matches!(refused(|g| g.features[0].scale = f32::INFINITY), NotFinite { place: 1, .. }));
        assert!(matches!(small().run(&[1.0]), Err(RowLength { found: 1, expected: 3, .. })));
    }

    #[test]
    fn an_output_map_reaches_both_ends() {
        for (low, high) in [(0.0, 1.0), (-0.25, 0.25), (0.2, 0.95)] {
            let map = OutputMap::onto(low, high);
            assert!((map.shift - map.scale - low).abs() < 1e-7 && (map.shift + map.scale - high).abs() < 1e-7);
        }
    }
}
