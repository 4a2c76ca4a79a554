//! Forward and backward through a dense layer, a panel of 32 samples at a time.
//!
//! ```text
//! forward    y[n] = b[n] + Σ_k w[n][k] x[k]            k in order, products fused
//! backward  dx[k] =        Σ_n w[n][k] dy[n]           n in order, products fused
//! ```
//!
//! A tile of `R` rows keeps `2 R` sums in registers; for each term it loads one row of the panel (two lines) and
//! broadcasts `R` weights. The panel (32 KiB for 256 features) stays in the first-level cache while the weights
//! pass by once.
#![allow(unsafe_code)] // reason: the innermost loops run without bounds checks, which are made once per call

use super::prefetch::touch;
use super::{LANES, Line, Vector, WIDTH, Work, lines_for};

/// Some rows of a layer's weights.
#[derive(Clone, Copy)]
pub(crate) struct Weights<'a> {
    /// `lines[(k / 16) · step + n]` holds `w[n][k..k + 16]`.
    pub(crate) lines: &'a [Line],
    /// One value a row.
    pub(crate) bias: &'a [Line],
    pub(crate) rows: usize,
    pub(crate) inputs: usize,
    /// `row_step` of all rows, of which `rows` may be but the first.
    pub(crate) step: usize,
}

impl Weights<'_> {
    /// The first so many rows.
    pub(crate) fn first(self, rows: usize) -> Self {
        Self { rows: self.rows.min(rows), ..self }
    }

    fn check(&self) {
        assert!(self.rows <= self.step && self.lines.len() >= lines_for(self.inputs) * self.step, "weights of a layer");
        assert!(self.bias.len() >= lines_for(self.rows), "biases of a layer");
    }
}

/// `y = b + W x`, rectified or not, for some rows.
pub(crate) struct Forward<'a> {
    pub(crate) weights: Weights<'a>,
    /// Two lines for each input.
    pub(crate) x: &'a [Line],
    /// Two lines for each row.
    pub(crate) y: &'a mut [Line],
    /// Where it is rectified: which samples passed, for each row.
    pub(crate) gates: Option<&'a mut [Gate]>,
}

/// Bit `s` is whether sample `s` of a panel passed the rectifier: all that the way back needs of a layer's output.
pub(crate) type Gate = u32;

impl Work for Forward<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(mut self) {
        let Weights { rows, inputs, .. } = self.weights;
        self.weights.check();
        assert!(self.x.len() >= 2 * inputs && self.y.len() >= 2 * rows, "panels of a layer");
        assert!(self.gates.as_ref().is_none_or(|gates| gates.len() >= rows), "gates of a layer");
        let mut row = 0;
        while row < rows {
            // SAFETY: `row + R <= rows`, and the lengths are checked above.
            row += unsafe {
                match rows - row {
                    12 | 20.. if V::ROWS >= 12 => self.tile::<V, 12>(row),
                    8.. if V::ROWS >= 8 => self.tile::<V, 8>(row),
                    4.. if V::ROWS >= 4 => self.tile::<V, 4>(row),
                    2.. if V::ROWS >= 2 => self.tile::<V, 2>(row),
                    _ => self.tile::<V, 1>(row),
                }
            };
        }
    }
}

impl Forward<'_> {
    /// # Safety
    /// Rows `row..row + R` exist and the slices have their lengths.
    #[inline(always)]
    unsafe fn tile<V: Vector, const R: usize>(&mut self, row: usize) -> usize {
        let Weights { lines, bias, inputs, step, .. } = self.weights;
        // SAFETY: every address below is within the slices by the caller's promise: weight line
        // (k / 16) · step + row + r, panel lines 2 k and 2 k + 1, bias and gate row + r.
        unsafe {
            let bias = bias.as_ptr().cast::<f32>().add(row);
            let mut sums = [[V::splat(0.0); 2]; R];
            for (r, sum) in sums.iter_mut().enumerate() {
                *sum = [V::splat(*bias.add(r)); 2];
            }
            let mut weights = lines.as_ptr().add(row);
            let mut x = self.x.as_ptr().cast::<f32>();
            let mut left = inputs;
            while left > 0 {
                let terms = left.min(WIDTH);
                // Two blocks ahead: often they come from the third-level cache.
                for r in 0..R {
                    touch(weights.wrapping_add(2 * step + r).cast());
                }
                let w = weights.cast::<f32>();
                for k in 0..terms {
                    let panel = [V::load(x), V::load(x.add(WIDTH))];
                    for (r, sum) in sums.iter_mut().enumerate() {
                        let w = V::splat(*w.add(r * WIDTH + k));
                        *sum = [sum[0].plus_product(w, panel[0]), sum[1].plus_product(w, panel[1])];
                    }
                    x = x.add(LANES);
                }
                left -= terms;
                weights = weights.wrapping_add(step);
            }
            let y = self.y.as_mut_ptr().cast::<f32>().add(row * LANES);
            for (r, sum) in sums.into_iter().enumerate() {
                let mut sum = sum;
                if let Some(gates) = &mut self.gates {
                    let [low, high] = sum.map(|s| Gate::from(s.positive()));
                    *gates.get_unchecked_mut(row + r) = low | high << WIDTH;
                    sum = sum.map(|s| s.rectified());
                }
                sum[0].store(y.add(r * LANES));
                sum[1].store(y.add(r * LANES + WIDTH));
            }
        }
        R
    }
}

/// Some rows of a layer on the way back.
pub(crate) struct Rows<'a> {
    pub(crate) weights: Weights<'a>,
    /// Two lines for each row.
    pub(crate) dy: &'a [Line],
    /// Rows whose `dy` is not zero throughout, in rising order.
    pub(crate) live: Vec<u16>,
}

/// `dx = Wᵀ dy` for the first inputs of a layer, whose rows may lie in several parts, closed where the gate is.
///
/// Rows that are not live would add `w · 0`, which changes no bit of a sum that begins at +0: they are passed over. Of the
/// actor's second layer that is up to half, once a run has gone on for a while.
pub(crate) struct Backward<'a> {
    /// The parts in the order of their rows.
    pub(crate) parts: &'a [Rows<'a>],
    /// Inputs wanted: the first so many.
    pub(crate) inputs: usize,
    /// Which samples of each of the layer's inputs passed, where these came from a rectifier.
    pub(crate) gates: Option<&'a [Gate]>,
    /// Two lines for each input wanted.
    pub(crate) dx: &'a mut [Line],
}

impl Work for Backward<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(mut self) {
        for Rows { weights, dy, live } in self.parts {
            weights.check();
            assert!(weights.inputs >= self.inputs && dy.len() >= 2 * weights.rows, "parts of a layer");
            assert!(live.iter().all(|&n| usize::from(n) < weights.rows), "live rows of a layer");
        }
        assert!(self.dx.len() >= 2 * self.inputs, "panel of a layer");
        assert!(self.gates.is_none_or(|gates| gates.len() >= self.inputs), "gates of a layer");
        let mut input = 0;
        while input < self.inputs {
            // Tiles never straddle two lines of weights: 8, 4, 2 and 1 divide 16 and come in falling order.
            // SAFETY: `input + R <= inputs`, and the lengths are checked above.
            input += unsafe {
                match self.inputs - input {
                    8.. if V::ROWS >= 8 => self.tile::<V, 8>(input),
                    4.. if V::ROWS >= 4 => self.tile::<V, 4>(input),
                    2.. if V::ROWS >= 2 => self.tile::<V, 2>(input),
                    _ => self.tile::<V, 1>(input),
                }
            };
        }
    }
}

/// Rows of weights that a tile asks for before it needs them: they come from the second-level cache.
const AHEAD: usize = 8;

impl Backward<'_> {
    /// # Safety
    /// Inputs `input..input + R` exist and lie in one line, and the slices have their lengths.
    #[inline(always)]
    unsafe fn tile<V: Vector, const R: usize>(&mut self, input: usize) -> usize {
        // SAFETY: every address below is within the slices by the caller's promise: weight line
        // (input / 16) · step + n from float input % 16 on, dy lines 2 n and 2 n + 1, dx lines and gates of the inputs.
        unsafe {
            let mut sums = [[V::splat(0.0); 2]; R];
            for Rows { weights, dy, live } in self.parts {
                let first = weights.lines.as_ptr().wrapping_add(input / WIDTH * weights.step);
                let (first, dy) = (first.cast::<f32>().wrapping_add(input % WIDTH), dy.as_ptr().cast::<f32>());
                for &n in live {
                    let n = usize::from(n);
                    let (w, dy) = (first.add(n * WIDTH), dy.add(n * LANES));
                    let panel = [V::load(dy), V::load(dy.add(WIDTH))];
                    touch(w.wrapping_add(AHEAD * WIDTH).cast());
                    for (r, sum) in sums.iter_mut().enumerate() {
                        let w = V::splat(*w.add(r));
                        *sum = [sum[0].plus_product(w, panel[0]), sum[1].plus_product(w, panel[1])];
                    }
                }
            }
            let dx = self.dx.as_mut_ptr().cast::<f32>().add(input * LANES);
            for (r, [mut low, mut high]) in sums.into_iter().enumerate() {
                if let Some(gates) = self.gates {
                    let gate = *gates.get_unchecked(input + r);
                    (low, high) = (low.where_set(gate as u16), high.where_set((gate >> WIDTH) as u16));
                }
                low.store(dx.add(r * LANES));
                high.store(dx.add(r * LANES + WIDTH));
            }
        }
        R
    }
}
