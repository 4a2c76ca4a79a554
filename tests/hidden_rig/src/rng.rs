//! Random draws that a seed fixes on every machine: xoshiro256++ (Blackman and Vigna, 2019), seeded by SplitMix64.
//!
//! Everything drawn in this crate goes back to one number. [`Draws::stream`] gives each purpose its own stream by
//! name, so that one more draw for the noise moves no parameter of the plant.

/// A stream of pseudo-random draws.
#[derive(Debug, Clone, PartialEq)]
pub struct Draws {
    state: [u64; 4],
}

impl Draws {
    /// The stream of a seed.
    pub fn new(seed: u64) -> Self {
        let mut mix = seed;
        Self { state: std::array::from_fn(|_| split_mix(&mut mix)) }
    }

    /// A stream of its own for one purpose; the same name of the same stream gives the same draws.
    pub fn stream(&self, purpose: &str) -> Self {
        Self::new(self.state[0] ^ fnv1a(purpose.as_bytes()))
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        let s = &mut self.state;
        let result = s[0].wrapping_add(s[3]).rotate_left(23).wrapping_add(s[0]);
        let t = s[1] << 17;
        s[2] ^= s[0];
        s[3] ^= s[1];
        s[1] ^= s[2];
        s[0] ^= s[3];
        s[2] ^= t;
        s[3] = s[3].rotate_left(45);
        result
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Uniform between two values.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Uniform in the logarithm, between two positive values.
    pub fn log_between(&mut self, low: f64, high: f64) -> f64 {
        (low.ln() + (high.ln() - low.ln()) * self.unit()).exp()
    }

    /// One of `count` indices, each as likely; 0 if there is none.
    pub fn index(&mut self, count: usize) -> usize {
        ((self.unit() * count as f64) as usize).min(count.saturating_sub(1))
    }

    /// +1 or −1.
    pub fn sign(&mut self) -> f64 {
        if self.unit() < 0.5 { -1.0 } else { 1.0 }
    }

    /// A standard normal draw (Box and Muller, 1958).
    pub fn normal(&mut self) -> f64 {
        // 1 − u lies in (0, 1], so the logarithm is finite.
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.unit()).cos()
    }

    /// A draw of Student's t with five degrees of freedom, scaled to unit variance: tails as real sensors have them.
    pub fn heavy_tailed(&mut self) -> f64 {
        const DEGREES: f64 = 5.0;
        let chi_squared: f64 = (0..5).map(|_| self.normal().powi(2)).sum();
        self.normal() / (chi_squared / DEGREES).sqrt() * ((DEGREES - 2.0) / DEGREES).sqrt()
    }

    /// Puts a list into a random order (Fisher and Yates).
    pub fn shuffle<T>(&mut self, list: &mut [T]) {
        for last in (1..list.len()).rev() {
            let other = self.index(last + 1);
            list.swap(last, other);
        }
    }
}

fn split_mix(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// The 64-bit FNV-1a hash: a name or a file's bytes as a seed.
pub fn fnv1a(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The generator's published test vector: state (1, 2, 3, 4).
    #[test]
    fn follows_the_published_sequence() {
        let mut draws = Draws { state: [1, 2, 3, 4] };
        let first: Vec<u64> = (0..4).map(|_| draws.bits()).collect();
        assert_eq!(first, [41_943_041, 58_720_359, 3_588_806_011_781_223, 3_591_011_842_654_386]);
    }

    #[test]
    fn moments_and_tails_are_those_of_the_laws() {
        const DRAWS: usize = 200_000;
        let mut draws = Draws::new(7);
        let moment = |values: &[f64], power: i32| values.iter().map(|v| v.powi(power)).sum::<f64>() / DRAWS as f64;
        let normal: Vec<f64> = (0..DRAWS).map(|_| draws.normal()).collect();
        let heavy: Vec<f64> = (0..DRAWS).map(|_| draws.heavy_tailed()).collect();
        // Standard error of a mean of 200,000 unit draws is 0.0022; of their square √2 times that. Five of them.
        assert!(moment(&normal, 1).abs() < 0.012 && (moment(&normal, 2) - 1.0).abs() < 0.016);
        // The fourth moment of t5 is 9 at unit variance, so the error of the variance is √(8/n): 0.0063.
        assert!((moment(&heavy, 2) - 1.0).abs() < 0.035);
        assert!(moment(&normal, 4) < 3.2 && moment(&heavy, 4) > 4.5);
    }

    #[test]
    fn streams_are_apart_and_repeatable() {
        let root = Draws::new(1);
        assert_eq!(root.stream("noise").bits(), root.stream("noise").bits());
        assert_ne!(root.stream("noise").bits(), root.stream("plant").bits());
    }
}
