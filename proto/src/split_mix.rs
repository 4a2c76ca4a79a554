//! Random numbers that a seed stands for, the same on every machine: SplitMix64 (Steele, Lea, Flood, OOPSLA 2014).
//!
//! Seeds go from process to process: into recordings, which are replayed to the bit, and into figures by which policies are compared. So
//! the numbers behind a seed are a format. A 64-bit counter with step `0x9E3779B97F4A7C15`, mixed by two multiplications. Small, seeded by any
//! number, and good enough for sensor noise and for dice; not for secrets. Gaussian numbers come by
//! Box and Muller, r = √(−2 ln u₁) cos 2πu₂, whose last bit depends on the machine's `ln` and `cos`.

const STEP: u64 = 0x9E37_79B9_7F4A_7C15;

/// A SplitMix64 generator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SplitMix64 {
    state: u64,
}

impl SplitMix64 {
    /// The generator of this seed.
    pub const fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    /// The generator of a seed and keys, so that a throw of the dice depends on what it is for and
    /// not on how many were thrown before it.
    pub(crate) fn keyed(seed: u64, keys: &[u64]) -> Self {
        let mut generator = Self::new(seed);
        for key in keys {
            generator = Self::new(generator.next_u64() ^ key);
        }
        generator
    }

    /// The next 64 bits.
    ///
    /// # Real-time
    /// May run in the tick: two multiplications.
    pub const fn next_u64(&mut self) -> u64 {
        self.state = self.state.wrapping_add(STEP);
        let mixed = (self.state ^ (self.state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ (mixed >> 31)
    }

    /// Uniform in \[0, 1), 53 bits.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn unit(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Gaussian with mean 0 and standard deviation 1.
    pub(crate) fn gaussian(&mut self) -> f64 {
        // 1 - u is in (0, 1]: the logarithm stays finite.
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.unit()).cos()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gives_the_numbers_of_another_implementation() {
        // Seed 1234567, worked out in Python with integers.
        let mut generator = SplitMix64::new(1_234_567);
        for expected in [
            6_457_827_717_110_365_317,
            3_203_168_211_198_807_973,
            9_817_491_932_198_370_423,
            4_593_380_528_125_082_431,
            16_408_922_859_458_223_821,
        ] {
            assert_eq!(generator.next_u64(), expected);
        }
    }

    #[test]
    fn gaussian_has_its_moments_and_tails() {
        let mut generator = SplitMix64::new(7);
        let n = 200_000;
        let draws: Vec<f64> = (0..n).map(|_| generator.gaussian()).collect();
        let moment = |power: i32| draws.iter().map(|x| x.powi(power)).sum::<f64>() / f64::from(n);
        // Five standard errors of each estimate: √(1/n), √(2/n), √(96/n).
        assert!(moment(1).abs() < 5.0 * (1.0 / f64::from(n)).sqrt());
        assert!((moment(2) - 1.0).abs() < 5.0 * (2.0 / f64::from(n)).sqrt());
        assert!((moment(4) - 3.0).abs() < 5.0 * (96.0 / f64::from(n)).sqrt());
        // Beyond 2: 4.550 % of a Gaussian.
        let beyond = draws.iter().filter(|x| x.abs() > 2.0).count() as f64 / f64::from(n);
        assert!((beyond - 0.0455).abs() < 5.0 * (0.0455 * 0.9545 / f64::from(n)).sqrt());
    }

    #[test]
    fn keys_make_throws_independent_of_their_order() {
        let first = SplitMix64::keyed(1, &[2, 3]).next_u64();
        assert_eq!(first, SplitMix64::keyed(1, &[2, 3]).next_u64());
        assert_ne!(first, SplitMix64::keyed(1, &[3, 2]).next_u64());
        assert_ne!(first, SplitMix64::keyed(2, &[2, 3]).next_u64());
    }
}
