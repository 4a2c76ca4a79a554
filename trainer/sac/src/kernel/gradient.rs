//! The weight gradient of a layer and, while it is still warm, the step it causes.
//!
//! ```text
//! g[n][k] = Σ_samples dy[n] x[k]      samples in order, products fused
//! ```
//!
//! Lanes run over `k` here: the layer's input is read sample by sample, `dy` feature by feature and broadcast. Four
//! panels (128 samples) of 32 inputs are 16 KiB and stay in the first-level cache while all rows pass; a batch of
//! three times that goes in three rounds over partial sums. The last round ends in [`AdamStep`], so a gradient never
//! goes to memory; moments and slow copies are asked for while a tile is summed, because all parameters together
//! exceed the second-level cache.
#![allow(unsafe_code)] // reason: the innermost loops run without bounds checks, which are made once per call

use super::prefetch::touch;
use super::{LANES, Line, Vector, WIDTH, Work, lines_for};
use crate::adam::{AdamStep, Learned};

/// Panels whose inputs share the first-level cache.
const PANELS_A_ROUND: usize = 4;

/// One step of some rows of a layer's weights.
pub(crate) struct WeightStep<'a> {
    /// For each panel the layer's input, sample by sample, and these rows of `dy`, feature by feature.
    pub(crate) panels: &'a [(&'a [Line], &'a [Line])],
    /// Where each of these rows lies among the layer's rows.
    pub(crate) rows: &'a [u16],
    pub(crate) inputs: usize,
    /// [`super::row_step`] of all the layer's rows.
    pub(crate) row_step: usize,
    /// Partial sums: two lines a row.
    pub(crate) scratch: &'a mut [Line],
    /// In panels of 16 inputs, as [`super::Weights`].
    pub(crate) weights: &'a mut Learned,
    pub(crate) step: AdamStep,
}

/// Which sums a tile works on.
#[derive(Clone, Copy)]
struct Tile {
    row: usize,
    /// First line of inputs, `k / 16`.
    block: usize,
    first_round: bool,
    last_round: bool,
}

impl Work for WeightStep<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(mut self) {
        let blocks = lines_for(self.inputs);
        assert!(self.scratch.len() >= 2 * self.rows.len(), "partial sums");
        assert!(self.weights.value.len() >= blocks * self.row_step, "weights of a layer");
        assert!(self.rows.iter().all(|&row| usize::from(row) < self.row_step), "rows of a layer");
        for (x, dy) in self.panels {
            assert!(x.len() >= blocks * LANES && dy.len() >= 2 * self.rows.len(), "panels of a layer");
        }
        let rounds = self.panels.len().div_ceil(PANELS_A_ROUND);
        let mut block = 0;
        while block < blocks {
            let wide = blocks - block >= 2;
            for (round, panels) in self.panels.chunks(PANELS_A_ROUND).enumerate() {
                let (first_round, last_round) = (round == 0, round + 1 == rounds);
                let mut row = 0;
                while row < self.rows.len() {
                    let tile = Tile { row, block, first_round, last_round };
                    // SAFETY: `row + R <= rows.len()`, `block + L <= blocks`, and the lengths are checked above.
                    row += unsafe {
                        match (self.rows.len() - row, wide) {
                            (12 | 20.., true) if V::ROWS >= 12 => self.tile::<V, 12, 2>(panels, tile),
                            (8.., true) if V::ROWS >= 8 => self.tile::<V, 8, 2>(panels, tile),
                            (8.., false) if V::ROWS >= 8 => self.tile::<V, 8, 1>(panels, tile),
                            (4.., true) if V::ROWS >= 4 => self.tile::<V, 4, 2>(panels, tile),
                            (4.., false) if V::ROWS >= 4 => self.tile::<V, 4, 1>(panels, tile),
                            (2.., true) if V::ROWS >= 2 => self.tile::<V, 2, 2>(panels, tile),
                            (2.., false) if V::ROWS >= 2 => self.tile::<V, 2, 1>(panels, tile),
                            (_, true) => self.tile::<V, 1, 2>(panels, tile),
                            (_, false) => self.tile::<V, 1, 1>(panels, tile),
                        }
                    };
                }
            }
            block += if wide { 2 } else { 1 };
        }
    }
}

impl WeightStep<'_> {
    /// # Safety
    /// Rows `row..row + R` and lines of inputs `block..block + L` exist and the slices have their lengths.
    #[inline(always)]
    unsafe fn tile<V: Vector, const R: usize, const L: usize>(
        &mut self,
        panels: &[(&[Line], &[Line])],
        tile: Tile,
    ) -> usize {
        let Tile { row, block, first_round, last_round } = tile;
        // SAFETY: every address below is within the slices by the caller's promise: scratch lines 2 (row + r) + l,
        // input lines (block + l) · 32 + sample, dy floats (row + r) · 32 + sample.
        unsafe {
            let scratch = self.scratch.as_mut_ptr().add(2 * row).cast::<f32>();
            let mut sums = [[V::splat(0.0); L]; R];
            if !first_round {
                for (r, sum) in sums.iter_mut().enumerate() {
                    for (l, sum) in sum.iter_mut().enumerate() {
                        *sum = V::load(scratch.add(r * LANES + l * WIDTH));
                    }
                }
            }
            for (n, (x, dy)) in panels.iter().enumerate() {
                if last_round {
                    self.ask_for::<R, L>(row, block, n, panels.len());
                }
                let x = x.as_ptr().add(block * LANES).cast::<f32>();
                let dy = dy.as_ptr().add(2 * row).cast::<f32>();
                for sample in 0..LANES {
                    let mut inputs = [V::splat(0.0); L];
                    for (l, input) in inputs.iter_mut().enumerate() {
                        *input = V::load(x.add((l * LANES + sample) * WIDTH));
                    }
                    for (r, sum) in sums.iter_mut().enumerate() {
                        let dy = V::splat(*dy.add(r * LANES + sample));
                        for (sum, input) in sum.iter_mut().zip(inputs) {
                            *sum = sum.plus_product(dy, input);
                        }
                    }
                }
            }
            for (r, sum) in sums.into_iter().enumerate() {
                for (l, sum) in sum.into_iter().enumerate() {
                    sum.store(scratch.add(r * LANES + l * WIDTH));
                }
            }
        }
        if last_round {
            for r in 0..R {
                for l in 0..L {
                    let gradient = self.scratch[2 * (row + r) + l];
                    let at = (block + l) * self.row_step + usize::from(self.rows[row + r]);
                    self.step.line(self.weights, at, &gradient);
                }
            }
        }
        R
    }
}

impl WeightStep<'_> {
    /// Asks for a share of what a tile's step will need: one of the four arrays a panel, because only so many
    /// requests fit under way.
    #[inline(always)]
    fn ask_for<const R: usize, const L: usize>(&self, row: usize, block: usize, panel: usize, panels: usize) {
        let arrays = [&self.weights.value, &self.weights.mean, &self.weights.square, &self.weights.target];
        for array in arrays.iter().skip(panel).step_by(panels) {
            for l in 0..L {
                let first = array.as_ptr().wrapping_add((block + l) * self.row_step);
                let rows = &self.rows[row..row + R];
                rows.iter().for_each(|&row| touch(first.wrapping_add(usize::from(row)).cast()));
            }
        }
    }
}

/// One step of rows whose gradient is zero: their moments fade, and what moves on still moves.
pub(crate) struct MomentumStep<'a> {
    /// Where these rows lie among the layer's rows.
    pub(crate) rows: &'a [u16],
    pub(crate) inputs: usize,
    /// [`super::row_step`] of all the layer's rows.
    pub(crate) row_step: usize,
    pub(crate) weights: &'a mut Learned,
    pub(crate) step: AdamStep,
}

impl Work for MomentumStep<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        for block in 0..lines_for(self.inputs) {
            for &row in self.rows {
                self.step.line(self.weights, block * self.row_step + usize::from(row), &Line::ZERO);
            }
        }
    }
}

/// One step of some biases: `g[n] = Σ_samples dy[n]`, first lane by lane, then across lanes in halves.
pub(crate) struct BiasStep<'a> {
    /// For each panel these rows of `dy`, feature by feature.
    pub(crate) panels: &'a [&'a [Line]],
    pub(crate) rows: usize,
    pub(crate) bias: &'a mut Learned,
    pub(crate) step: AdamStep,
}

impl Work for BiasStep<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        for at in 0..lines_for(self.rows) {
            let mut rows = [Line::ZERO; WIDTH];
            for (row, lanes) in (at * WIDTH..self.rows).zip(&mut rows) {
                let mut sums = lanes.0;
                for dy in self.panels {
                    for line in &dy[2 * row..2 * row + 2] {
                        sums.iter_mut().zip(&line.0).for_each(|(sum, x)| *sum += x);
                    }
                }
                lanes.0 = sums;
            }
            let mut lanes = [Line::ZERO; WIDTH];
            // SAFETY: both sides are 16 lines one apart.
            unsafe { V::transpose(rows.as_ptr().cast(), WIDTH, lanes.as_mut_ptr().cast(), WIDTH) };
            self.step.line(self.bias, at, &across(lanes));
        }
    }
}

/// The sums of 16 lanes of 16 rows, lane by lane, halves first.
#[inline(always)]
fn across(mut lanes: [Line; WIDTH]) -> Line {
    for half in [8, 4, 2, 1] {
        for l in 0..half {
            for row in 0..WIDTH {
                lanes[l].0[row] += lanes[l + half].0[row];
            }
        }
    }
    lanes[0]
}
