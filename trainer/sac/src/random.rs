//! Noise by counting: Philox 2×32-10 (Salmon, Moraes, Dror & Shaw 2011) and normals by Box & Muller.
//!
//! Every number is a function of (seed, what it is for, which row, which update). No thread owns a stream, so that
//! the numbers do not depend on who draws them, and the whole state of the generator in a checkpoint is two counters.

use std::array::from_fn;

use crate::elementary::{ln, sin_cos_of_turns};
use crate::kernel::WIDTH;

/// Purpose that numbers are drawn for; each use has a counter space of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Purpose {
    /// Rows of the replay.
    Rows = 0,
    /// Actions of the actor's step and of the critics' targets.
    Actions = 1,
    /// Disturbed observations of CAPS' spatial term.
    Observations = 2,
    /// Exploration.
    Exploration = 3,
    /// Initial weights.
    Weights = 4,
}

/// Bits of the counter that the purpose leaves for positions.
const POSITION_BITS: u32 = 28;

/// The generator: a key.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Random {
    key: u32,
}

impl Random {
    /// All 64 bits of the seed matter: two seeds share a stream by chance only.
    pub(crate) fn new(seed: u64) -> Self {
        let [low, high] = philox([seed as u32, (seed >> 32) as u32], 0x5ac0_ca95);
        Self { key: low ^ high }
    }

    /// Sixteen pairs of 32 bits for positions `first..first + 16` at `time`.
    #[inline(always)]
    fn words(self, purpose: Purpose, first: u32, time: u64) -> ([u32; WIDTH], [u32; WIDTH]) {
        // Times beyond 2³² go into the key: an update that late is another stream, not a repetition.
        let key = self.key ^ ((time >> 32) as u32).wrapping_mul(0x9e37_79b9);
        let mut left: [u32; WIDTH] = from_fn(|l| ((purpose as u32) << POSITION_BITS).wrapping_add(first + l as u32));
        let mut right = [time as u32; WIDTH];
        let mut round_key = key;
        for _ in 0..ROUNDS {
            for l in 0..WIDTH {
                [left[l], right[l]] = round([left[l], right[l]], round_key);
            }
            round_key = round_key.wrapping_add(KEY_STEP);
        }
        (left, right)
    }

    /// Two lines of standard normals for positions `first..first + 16` at `time`.
    #[inline(always)]
    pub(crate) fn normals(self, purpose: Purpose, first: u32, time: u64) -> [[f32; WIDTH]; 2] {
        let (left, right) = self.words(purpose, first, time);
        let mut out = [[0.0; WIDTH]; 2];
        for l in 0..WIDTH {
            // (0, 1], so that the logarithm is finite: no normal exceeds √(2 ln 2²⁴) = 5.77.
            let radius = (-2.0 * ln(unit(left[l]) + UNIT_STEP)).sqrt();
            let (sin, cos) = sin_cos_of_turns(unit(right[l]));
            out[0][l] = radius * cos;
            out[1][l] = radius * sin;
        }
        out
    }

    /// Sixteen numbers below `end`, for positions `first..first + 16` at `time`.
    #[inline(always)]
    pub(crate) fn below(self, end: u32, purpose: Purpose, first: u32, time: u64) -> [u32; WIDTH] {
        let (left, _) = self.words(purpose, first, time);
        left.map(|word| ((u64::from(word) * u64::from(end)) >> 32) as u32)
    }

    /// Sixteen numbers in [0, 1), for positions `first..first + 16` at `time`.
    pub(crate) fn uniforms(self, purpose: Purpose, first: u32, time: u64) -> [f32; WIDTH] {
        self.words(purpose, first, time).0.map(unit)
    }
}

const ROUNDS: usize = 10;
const MULTIPLIER: u64 = 0xd256_d193;
const KEY_STEP: u32 = 0x9e37_79b9;
/// The spacing of [`unit`].
const UNIT_STEP: f32 = 1.0 / (1 << 24) as f32;

/// 24 bits as a number in [0, 1).
#[inline(always)]
fn unit(word: u32) -> f32 {
    (word >> 8) as i32 as f32 * UNIT_STEP
}

#[inline(always)]
fn round([left, right]: [u32; 2], key: u32) -> [u32; 2] {
    let product = u64::from(left) * MULTIPLIER;
    [(product >> 32) as u32 ^ key ^ right, product as u32]
}

/// The block function of Philox 2×32-10.
fn philox(counter: [u32; 2], key: u32) -> [u32; 2] {
    let keys = (0..ROUNDS as u32).map(|n| key.wrapping_add(n.wrapping_mul(KEY_STEP)));
    keys.fold(counter, round)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn philox_gives_the_authors_known_answers() {
        // kat_vectors of Random123, "philox2x32 10".
        assert_eq!(philox([0, 0], 0), [0xff1d_ae59, 0x6cd1_0df2]);
        assert_eq!(philox([0xffff_ffff, 0xffff_ffff], 0xffff_ffff), [0x2c3f_628b, 0xab4f_d7ad]);
        assert_eq!(philox([0x243f_6a88, 0x85a3_08d3], 0x1319_8a2e), [0xdd7c_e038, 0xf62a_4c12]);
    }

    #[test]
    fn a_vector_of_words_is_the_block_function() {
        let random = Random::new(7);
        let (left, right) = random.words(Purpose::Observations, 1000, 42);
        for l in 0..WIDTH {
            let counter = [(2 << POSITION_BITS) + 1000 + l as u32, 42];
            assert_eq!([left[l], right[l]], philox(counter, random.key));
        }
    }

    /// 320,000 normals have moments within five standard errors, tails and both outputs' correlation too.
    #[test]
    fn normals_are_normal() {
        let random = Random::new(1);
        let pairs: Vec<_> = (0..10_000u64).map(|t| random.normals(Purpose::Actions, 16 * (t % 7) as u32, t)).collect();
        let all: Vec<f64> = pairs.iter().flatten().flatten().map(|&x| f64::from(x)).collect();
        let n = all.len() as f64;
        let moment = |p: i32| all.iter().map(|x| x.powi(p)).sum::<f64>() / n;
        // Variances of the sample moments: 1, 2, 15, 96.
        for (p, expected, variance) in [(1, 0.0, 1.0), (2, 1.0, 2.0), (3, 0.0, 15.0), (4, 3.0, 96.0f64)] {
            assert!((moment(p) - expected).abs() < 5.0 * (variance / n).sqrt(), "moment {p}: {}", moment(p));
        }
        let beyond = all.iter().filter(|x| x.abs() > 3.0).count() as f64 / n;
        assert!((beyond - 0.0027).abs() < 5.0 * (0.0027 / n).sqrt(), "{beyond}");
        let mixed: f64 = pairs.iter().flat_map(|[a, b]| a.iter().zip(b)).map(|(a, b)| f64::from(a * b)).sum();
        assert!((mixed / (n / 2.0)).abs() < 5.0 / (n / 2.0).sqrt());
        let neighbours: f64 = all.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / n;
        assert!(neighbours.abs() < 5.0 / n.sqrt());
    }

    #[test]
    fn rows_are_drawn_evenly() {
        let (random, mut counts) = (Random::new(3), [0u32; 10]);
        for time in 0..10_000 {
            random.below(10, Purpose::Rows, 0, time).iter().for_each(|&i| counts[i as usize] += 1);
        }
        // 16,000 expected in each of ten; five standard deviations of a binomial are 600.
        assert!(counts.iter().all(|&c| c.abs_diff(16_000) < 600), "{counts:?}");
    }

    #[test]
    fn every_seed_bit_matters() {
        let keys: std::collections::HashSet<_> = (0..64).map(|bit| Random::new(1 << bit).key).collect();
        assert_eq!(keys.len(), 64);
    }
}
