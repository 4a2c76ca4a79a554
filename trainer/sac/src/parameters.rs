//! Networks cut into parts, one a thread.
//!
//! Thread `t` of `T` owns an even share of the rows (outputs) of every layer of every network, with the moments and
//! slow copies that belong to them. All threads read all parts when a batch passes through; each writes its own when
//! gradients are taken. How a network is cut changes no bit of any result.

use std::ops::Range;

use crate::adam::Learned;
use crate::kernel::{Line, WIDTH, Weights, lines_for, row_step};

/// The rows of one layer that one thread owns.
#[derive(Debug, Clone)]
pub(crate) struct Slab {
    pub(crate) rows: Range<usize>,
    pub(crate) inputs: usize,
    pub(crate) weights: Learned,
    pub(crate) bias: Learned,
}

/// One thread's share of a network, layer by layer.
pub(crate) type Part = Vec<Slab>;

/// Which of a parameter's numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Value,
    Mean,
    Square,
    Target,
}

/// A layer as plain numbers: `weights[n * inputs + k]`, then biases.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Plain {
    pub(crate) inputs: usize,
    pub(crate) weights: Vec<f32>,
    pub(crate) bias: Vec<f32>,
}

/// The rows of a layer that part `part` of `parts` owns: multiples of four, which tiles like.
fn share(rows: usize, part: usize, parts: usize) -> Range<usize> {
    let cut = |n: usize| (4 * (rows.div_ceil(4) * n / parts)).min(rows);
    // The last cut is the end even where the rows are no multiple of four.
    cut(part)..if part + 1 == parts { rows } else { cut(part + 1) }
}

/// Part `part` of a network whose layers have these widths, inputs first; all zero.
pub(crate) fn part(widths: &[usize], with_target: bool, part: usize, parts: usize) -> Part {
    let slab = |pair: &[usize]| {
        let rows = share(pair[1], part, parts);
        let weights = Learned::zeroed(lines_for(pair[0]) * row_step(rows.len()), with_target);
        let bias = Learned::zeroed(lines_for(rows.len()), with_target);
        Slab { rows, inputs: pair[0], weights, bias }
    };
    widths.windows(2).map(slab).collect()
}

impl Learned {
    fn lines(&self, kind: Kind) -> &[Line] {
        match kind {
            Kind::Value => &self.value,
            Kind::Mean => &self.mean,
            Kind::Square => &self.square,
            Kind::Target => &self.target,
        }
    }

    fn lines_mut(&mut self, kind: Kind) -> &mut [Line] {
        match kind {
            Kind::Value => &mut self.value,
            Kind::Mean => &mut self.mean,
            Kind::Square => &mut self.square,
            Kind::Target => &mut self.target,
        }
    }
}

impl Slab {
    pub(crate) fn view(&self, kind: Kind) -> Weights<'_> {
        let (lines, bias) = (self.weights.lines(kind), self.bias.lines(kind));
        Weights { lines, bias, rows: self.rows.len(), inputs: self.inputs, step: self.row_step() }
    }

    /// Lines from one block of 16 inputs to the next.
    pub(crate) fn row_step(&self) -> usize {
        row_step(self.rows.len())
    }

    /// Line and float of weight `k` of local row `n`.
    fn place(&self, n: usize, k: usize) -> (usize, usize) {
        (k / WIDTH * self.row_step() + n, k % WIDTH)
    }

    /// Copies these rows out.
    pub(crate) fn write_to(&self, kind: Kind, plain: &mut Plain) {
        for (n, row) in self.rows.clone().enumerate() {
            for k in 0..self.inputs {
                let (line, float) = self.place(n, k);
                plain.weights[row * self.inputs + k] = self.weights.lines(kind)[line].0[float];
            }
            plain.bias[row] = self.bias.lines(kind)[n / WIDTH].0[n % WIDTH];
        }
    }

    /// Copies these rows in.
    pub(crate) fn read_from(&mut self, kind: Kind, plain: &Plain) {
        for (n, row) in self.rows.clone().enumerate() {
            for k in 0..self.inputs {
                let (line, float) = self.place(n, k);
                self.weights.lines_mut(kind)[line].0[float] = plain.weights[row * self.inputs + k];
            }
            self.bias.lines_mut(kind)[n / WIDTH].0[n % WIDTH] = plain.bias[row];
        }
    }

    /// Starts the optimiser anew.
    pub(crate) fn forget_moments(&mut self) {
        for learned in [&mut self.weights, &mut self.bias] {
            learned.mean.fill(Line::ZERO);
            learned.square.fill(Line::ZERO);
        }
    }

    /// Tells whether all values are numbers.
    pub(crate) fn is_finite(&self) -> bool {
        // 0 x is zero for every number and NaN for what is none.
        let sum = |lines: &[Line]| {
            let mut lanes = [0.0f32; WIDTH];
            lines.iter().for_each(|line| lanes.iter_mut().zip(&line.0).for_each(|(sum, x)| *sum += x * 0.0));
            lanes.iter().sum::<f32>()
        };
        sum(&self.weights.value) + sum(&self.bias.value) == 0.0
    }
}

/// A network, put together from its parts for reading.
pub(crate) struct NetView<'a> {
    /// For each layer its parts in the order of their rows.
    pub(crate) layers: Vec<Vec<Weights<'a>>>,
}

impl<'a> NetView<'a> {
    pub(crate) fn new(parts: impl Iterator<Item = &'a Part> + Clone, kind: Kind) -> Self {
        let depth = parts.clone().next().map_or(0, Vec::len);
        let layer = |l: usize| parts.clone().map(|part| part[l].view(kind)).filter(|view| view.rows > 0).collect();
        Self { layers: (0..depth).map(layer).collect() }
    }
}

/// One kind of all numbers of a network, layer by layer.
pub(crate) fn gather<'a>(parts: impl Iterator<Item = &'a Part> + Clone, kind: Kind) -> Vec<Plain> {
    let depth = parts.clone().next().map_or(0, Vec::len);
    (0..depth)
        .map(|l| {
            let rows = parts.clone().map(|part| part[l].rows.end).max().unwrap_or(0);
            let inputs = parts.clone().next().map_or(0, |part| part[l].inputs);
            let mut plain = Plain { inputs, weights: vec![0.0; rows * inputs], bias: vec![0.0; rows] };
            parts.clone().for_each(|part| part[l].write_to(kind, &mut plain));
            plain
        })
        .collect()
}
