//! The policy as fixed buffers: what runs in the tick.
//!
//! A dense layer `y = W x + b` is kept in panels of 32 (then 16) outputs: for each input the panel's
//! weights lie side by side in 64-byte lines, so that one pass over memory in order feeds all
//! accumulators. Outputs are padded to 16 with zero weights.
//!
//! ```text
//! y_j = ((0 + w_j0 x_0) + w_j1 x_1) + ...   then + b_j
//! ```
//! in f32, in the order of the inputs, each product and each sum rounded by itself. That order is the
//! result's definition: lanes run over j, never over the sum, and products are not fused, so every
//! machine and every compiler flag gives the same bits.
//!
//! One code path for all machines, without AVX2: the weights stream from the second-level cache, which
//! is the bound. Measured for 84-256-256-12 on one EPYC core: SSE2 4.7 us, AVX2 3.5, AVX2 with FMA 3.6,
//! AVX-512 3.3, and 208 for fused products where the CPU has no FMA. Of a tick of 20 ms the best of
//! these saves 0.007 %, and at 50 Hz caches are cold and all are alike; that is not worth unsafe code.

use crate::activation::Activation;
use crate::refused::Refused;

/// Floats in a cache line: the unit of padding.
const LINE: usize = 16;
/// Cache lines side by side in a wide panel.
const WIDE: usize = 2;

/// One cache line of weights or biases.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Line([f32; LINE]);

/// A dense layer, packed.
pub(crate) struct Dense {
    inputs: usize,
    outputs: usize,
    weights: Box<[Line]>,
    bias: Box<[Line]>,
}

/// Operation of an elementwise constant on the running value `x`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Arithmetic {
    /// `x + c`
    Add,
    /// `x - c`
    Subtract,
    /// `c - x`
    SubtractFrom,
    /// `x c`
    Multiply,
    /// `x / c`
    Divide,
    /// `c / x`
    DivideInto,
}

/// One layer of the chain.
pub(crate) enum Layer {
    Dense(Dense),
    Constant(Arithmetic, Box<[f32]>),
    Activation(Activation),
}

/// A chain of layers with the two buffers they work between.
pub(crate) struct Kernel {
    layers: Box<[Layer]>,
    inputs: usize,
    outputs: usize,
    front: Box<[f32]>,
    back: Box<[f32]>,
}

impl Dense {
    /// Packs `weights[input * outputs + output]` and a bias of `outputs` values.
    pub(crate) fn new(inputs: usize, outputs: usize, weights: &[f32], bias: &[f32]) -> Self {
        let lines = outputs.div_ceil(LINE);
        let mut packed = Vec::with_capacity(lines * inputs);
        for panel in panels(lines) {
            for input in 0..inputs {
                for line in panel.clone() {
                    packed.push(line_of(weights, input * outputs, outputs, line));
                }
            }
        }
        let bias = (0..lines).map(|line| line_of(bias, 0, outputs, line)).collect();
        Self { inputs, outputs, weights: packed.into(), bias }
    }

    /// Adds to the bias; used to take in the `Add` that follows a `MatMul`.
    pub(crate) fn add_bias(&mut self, more: &[f32]) {
        for (bias, more) in self.bias.floats_mut().zip(more) {
            *bias += more;
        }
    }

    pub(crate) fn width(&self) -> (usize, usize) {
        (self.inputs, self.outputs)
    }

    /// One weight, out of its panel.
    pub(crate) fn weight(&self, input: usize, output: usize) -> f32 {
        let line = output / LINE;
        let first = line - line % WIDE;
        let wide = WIDE.min(self.bias.len() - first);
        self.weights[first * self.inputs + input * wide + line - first].0[output % LINE]
    }

    /// One bias.
    pub(crate) fn bias(&self, output: usize) -> f32 {
        self.bias[output / LINE].0[output % LINE]
    }

    #[inline(always)]
    fn apply(&self, x: &[f32], y: &mut [f32]) {
        let x = &x[..self.inputs];
        let (mut weights, mut bias) = (&self.weights[..], &self.bias[..]);
        let mut y = &mut y[..self.bias.len() * LINE];
        while bias.len() >= WIDE {
            let (panel, rest) = weights.split_at(WIDE * x.len());
            let (sum, tail) = y.split_at_mut(WIDE * LINE);
            accumulate::<WIDE>(panel, &bias[..WIDE], x, sum);
            (weights, bias, y) = (rest, &bias[WIDE..], tail);
        }
        if !bias.is_empty() {
            accumulate::<1>(weights, bias, x, y);
        }
    }
}

/// The lines of each panel: pairs, then a single one.
fn panels(lines: usize) -> impl Iterator<Item = std::ops::Range<usize>> {
    (0..lines).step_by(WIDE).map(move |first| first..lines.min(first + WIDE))
}

/// Sixteen values of the row that starts at `row`, zero beyond `width`.
fn line_of(values: &[f32], row: usize, width: usize, line: usize) -> Line {
    let mut out = [0.0; LINE];
    for (lane, place) in out.iter_mut().zip(line * LINE..width) {
        *lane = values[row + place];
    }
    Line(out)
}

/// One panel: `L` lines of accumulators in registers over all inputs.
#[inline(always)]
fn accumulate<const L: usize>(panel: &[Line], bias: &[Line], x: &[f32], y: &mut [f32]) {
    let mut sums = [[0.0f32; LINE]; L];
    let (rows, _) = panel.as_chunks::<L>();
    for (row, &x) in rows.iter().zip(x) {
        for (sum, weight) in sums.iter_mut().zip(row) {
            for (sum, weight) in sum.iter_mut().zip(&weight.0) {
                *sum += weight * x;
            }
        }
    }
    for ((sum, bias), y) in sums.iter().zip(bias).zip(y.chunks_exact_mut(LINE)) {
        for ((y, sum), bias) in y.iter_mut().zip(sum).zip(&bias.0) {
            *y = sum + bias;
        }
    }
}

/// Floats of a row of lines, in order.
trait Floats {
    fn floats_mut(&mut self) -> impl Iterator<Item = &mut f32>;
}

impl Floats for [Line] {
    fn floats_mut(&mut self) -> impl Iterator<Item = &mut f32> {
        self.iter_mut().flat_map(|line| line.0.iter_mut())
    }
}

impl Arithmetic {
    #[inline(always)]
    fn apply(self, values: &mut [f32], constant: &[f32]) {
        let pairs = values.iter_mut().zip(constant);
        match self {
            Self::Add => pairs.for_each(|(x, c)| *x += c),
            Self::Subtract => pairs.for_each(|(x, c)| *x -= c),
            Self::SubtractFrom => pairs.for_each(|(x, c)| *x = c - *x),
            Self::Multiply => pairs.for_each(|(x, c)| *x *= c),
            Self::Divide => pairs.for_each(|(x, c)| *x /= c),
            Self::DivideInto => pairs.for_each(|(x, c)| *x = c / *x),
        }
    }
}

impl Kernel {
    /// A chain that takes `inputs` values; every layer fits the one before it.
    pub(crate) fn new(inputs: usize, layers: Vec<Layer>) -> Self {
        let mut outputs = inputs;
        let mut widest = inputs;
        for layer in &layers {
            if let Layer::Dense(dense) = layer {
                outputs = dense.outputs;
                widest = widest.max(outputs);
            }
        }
        let places = widest.next_multiple_of(LINE);
        Self { layers: layers.into(), inputs, outputs, front: vec![0.0; places].into(), back: vec![0.0; places].into() }
    }

    pub(crate) fn inputs(&self) -> usize {
        self.inputs
    }

    pub(crate) fn outputs(&self) -> usize {
        self.outputs
    }

    pub(crate) fn layers(&self) -> &[Layer] {
        &self.layers
    }

    /// Computes one action.
    ///
    /// # Errors
    /// [`Refused`] for wrong lengths, a non-finite input, a non-finite output; `out` is then untouched.
    ///
    /// # Real-time
    /// Allocates nothing, takes no lock, makes no system call; time bounded by the load-time limit on
    /// operations.
    pub(crate) fn run(&mut self, input: &[f32], out: &mut [f32]) -> Result<(), Refused> {
        if input.len() != self.inputs {
            return Err(Refused::InputLength { found: input.len(), expected: self.inputs });
        }
        if out.len() != self.outputs {
            return Err(Refused::OutputLength { found: out.len(), expected: self.outputs });
        }
        if let Some((index, value)) = first_not_finite(input) {
            return Err(Refused::InputNotFinite { index, value });
        }
        self.front[..input.len()].copy_from_slice(input);
        let result = forward(&self.layers, &mut self.front, &mut self.back, self.inputs);
        let action = &result[..self.outputs];
        if let Some((index, value)) = first_not_finite(action) {
            return Err(Refused::OutputNotFinite { index, value });
        }
        out.copy_from_slice(action);
        Ok(())
    }
}

fn first_not_finite(values: &[f32]) -> Option<(usize, f32)> {
    values.iter().copied().enumerate().find(|(_, v)| !v.is_finite())
}

/// Runs the chain from `current`, which holds `width` values; returns the buffer that ends with the result.
fn forward<'a>(layers: &[Layer], current: &'a mut [f32], other: &'a mut [f32], width: usize) -> &'a [f32] {
    let (mut current, mut other, mut width) = (current, other, width);
    for layer in layers {
        match layer {
            Layer::Dense(dense) => {
                dense.apply(current, other);
                std::mem::swap(&mut current, &mut other);
                width = dense.outputs;
            }
            Layer::Constant(arithmetic, constant) => {
                arithmetic.apply(&mut current[..width], constant);
            }
            Layer::Activation(activation) => activation.apply(&mut current[..width]),
        }
    }
    current
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn dense(inputs: usize, outputs: usize, seed: u32) -> (Dense, Vec<f32>, Vec<f32>) {
        let mut state = seed;
        let mut draw = move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 8_388_608.0 - 1.0
        };
        let weights: Vec<f32> = (0..inputs * outputs).map(|_| draw()).collect();
        let bias: Vec<f32> = (0..outputs).map(|_| draw()).collect();
        (Dense::new(inputs, outputs, &weights, &bias), weights, bias)
    }

    proptest! {
        /// Packing loses nothing: the same bits as the plain double loop, at every odd width.
        #[test]
        fn dense_is_the_defined_sum(inputs in 1usize..90, outputs in 1usize..70, seed: u32) {
            let (layer, weights, bias) = dense(inputs, outputs, seed);
            let places = (0..inputs).flat_map(|i| (0..outputs).map(move |j| (i, j)));
            prop_assert!(places.zip(&weights).all(|((i, j), w)| layer.weight(i, j) == *w));
            prop_assert!(bias.iter().enumerate().all(|(j, b)| layer.bias(j) == *b));
            let x: Vec<f32> = (0..inputs).map(|i| (i as f32 * 0.7).sin()).collect();
            let expected: Vec<f32> = (0..outputs).map(|j| {
                let mut sum = 0.0f32;
                for (i, x) in x.iter().enumerate() {
                    sum += weights[i * outputs + j] * x;
                }
                sum + bias[j]
            }).collect();
            let mut kernel = Kernel::new(inputs, vec![Layer::Dense(layer)]);
            let mut y = vec![0.0; outputs];
            kernel.run(&x, &mut y).unwrap();
            let bits = |v: &[f32]| v.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
            prop_assert_eq!(bits(&y), bits(&expected));
        }
    }

    #[test]
    fn an_overflow_inside_is_refused_and_leaves_the_output_alone() {
        let layer = Dense::new(1, 2, &[f32::MAX, 1.0], &[0.0, 0.0]);
        let relu = Layer::Activation(Activation::Relu);
        let mut kernel = Kernel::new(1, vec![Layer::Dense(layer), relu]);
        let mut y = [7.0; 2];
        let refused = kernel.run(&[2.0], &mut y);
        assert_eq!(refused, Err(Refused::OutputNotFinite { index: 0, value: f32::INFINITY }));
        assert_eq!(y, [7.0; 2]);
    }
}
