//! Magnetic hysteresis as a field of relays.
//!
//! Preisach (1935): the output is the weighted sum of relays, each of which switches on when the input rises past its
//! upper threshold and off when it falls past its lower one. Here the relays stand on a grid of centres `c` and half
//! widths `h`, with thresholds `c ± h`; the density is even in `c` and a raised cosine over `h`, between `mean (1 −
//! spread)` and `mean (1 + spread)`. Far from a turning point the output then follows the input with slope 1, offset by
//! the mean half width; right after one it departs softly, because narrow relays let go before wide ones.

/// Relays per half width: one of them is worth 1e-4 of the duty, and less once weighted.
const CENTRES: usize = 14_000;
/// Half widths of the grid.
const WIDTHS: usize = 11;
/// Lowest and highest centre: the range of the duty and room for half widths to 0.2 on either side.
const LOWEST: f64 = -0.2;
const HIGHEST: f64 = 1.2;

/// Distance of neighbouring centres.
const STEP: f64 = (HIGHEST - LOWEST) / CENTRES as f64;

/// A field of relays with its memory.
#[derive(Debug, Clone, PartialEq)]
pub struct Preisach {
    half_widths: [f64; WIDTHS],
    weights: [f64; WIDTHS],
    /// States of the relays, true for on: half width by half width, in the order of rising centres.
    on: Vec<bool>,
    /// Number of those that are on, per half width.
    count: [u32; WIDTHS],
    /// The last input: what lies between it and the next is all that can switch.
    input: f64,
}

impl Preisach {
    /// A field whose loop is 2 · `mean` wide, demagnetised: every relay is off but those below the range, as after a
    /// duty of 0 for long.
    ///
    /// `spread` (0 to below 1) is how much half widths differ from their mean.
    pub fn new(mean: f64, spread: f64) -> Self {
        let place = |row: usize| 2.0 * (row as f64 + 0.5) / WIDTHS as f64 - 1.0;
        let half_widths = std::array::from_fn(|row| mean * (1.0 + spread * place(row)));
        let bell: [f64; WIDTHS] = std::array::from_fn(|row| 1.0 + (std::f64::consts::PI * place(row)).cos());
        let total: f64 = bell.iter().sum();
        let mut field = Self {
            half_widths,
            weights: bell.map(|weight| weight / total),
            on: vec![false; CENTRES * WIDTHS],
            count: [0; WIDTHS],
            input: LOWEST - 1.0,
        };
        field.apply(0.0);
        field
    }

    /// Half width of the loop that a large swing runs through (duty).
    pub fn mean_half_width(&self) -> f64 {
        self.half_widths.iter().zip(&self.weights).map(|(width, weight)| width * weight).sum()
    }

    /// Applies an input and reads the output, in the input's own scale.
    pub fn apply(&mut self, input: f64) -> f64 {
        let rising = input > self.input;
        let mut output = 0.0;
        for (row, relays) in self.on.chunks_exact_mut(CENTRES).enumerate() {
            // Rising, relays with c + h in (last, input] go on; falling, those with c − h in [input, last) go off.
            let threshold = if rising { self.half_widths[row] } else { -self.half_widths[row] };
            let (low, high) = (self.input.min(input) - threshold, self.input.max(input) - threshold);
            for relay in &mut relays[relays_below(low)..relays_below(high)] {
                if *relay != rising {
                    *relay = rising;
                    self.count[row] = if rising { self.count[row] + 1 } else { self.count[row] - 1 };
                }
            }
            output += self.weights[row] * (LOWEST + f64::from(self.count[row]) * STEP);
        }
        self.input = input;
        output
    }
}

/// Number of centres below a value.
fn relays_below(value: f64) -> usize {
    ((value - LOWEST) / STEP + 0.5).floor().clamp(0.0, CENTRES as f64) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One relay's step: what the grid cannot resolve.
    const GRAIN: f64 = 1e-4;

    #[test]
    fn branches_lie_a_loop_width_apart_and_have_slope_one() {
        let mut field = Preisach::new(0.03, 0.6);
        assert!((field.mean_half_width() - 0.03).abs() < 1e-12);
        for input in [0.4, 0.6, 0.8] {
            assert!((field.apply(input) - (input - 0.03)).abs() < GRAIN);
        }
        field.apply(1.0);
        for input in [0.8, 0.6, 0.4] {
            assert!((field.apply(input) - (input + 0.03)).abs() < GRAIN);
        }
    }

    /// Rate-independence: the same turning points reached in 3 steps or in 3,000 leave the same output.
    #[test]
    fn only_turning_points_count() {
        let turns = [0.0, 0.9, 0.55, 0.7, 0.6];
        let mut coarse = Preisach::new(0.04, 0.5);
        let mut fine = coarse.clone();
        let mut last = 0.0;
        for turn in turns {
            coarse.apply(turn);
            for k in 1..=1000 {
                fine.apply(last + (turn - last) * f64::from(k) / 1000.0);
            }
            last = turn;
        }
        assert_eq!(coarse, fine);
    }

    /// Wiping out: a larger swing forgets the smaller loops inside it.
    #[test]
    fn a_minor_loop_is_forgotten_by_a_larger_swing() {
        let mut with = Preisach::new(0.03, 0.6);
        let mut without = with.clone();
        for input in [0.8, 0.6, 0.7, 0.5, 0.9] {
            with.apply(input);
        }
        for input in [0.8, 0.5, 0.9] {
            without.apply(input);
        }
        assert_eq!(with, without);
    }

    #[test]
    fn a_minor_loop_closes() {
        let mut field = Preisach::new(0.03, 0.6);
        field.apply(0.8);
        let start = field.apply(0.6);
        field.apply(0.68);
        assert!((field.apply(0.6) - start).abs() < 1e-12);
    }
}
