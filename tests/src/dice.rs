//! Random numbers that are the same in every run of a test (xorshift, Marsaglia 2003).

/// A stream of them.
#[derive(Debug, Clone)]
pub struct Dice(u64);

impl Dice {
    /// The stream of a seed.
    pub fn new(seed: u64) -> Self {
        Dice(0x9E37_79B9_7F4A_7C15 ^ seed.wrapping_mul(0xD6E8_FEB8_6659_FD93))
    }

    /// A whole number below `sides`.
    pub fn roll(&mut self, sides: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) % sides.max(1)
    }

    /// A number from 0 to 1.
    pub fn share(&mut self) -> f64 {
        self.roll(1 << 40) as f64 / (1u64 << 40) as f64
    }

    /// Tells whether something with this chance happens.
    pub fn chance(&mut self, chance: f64) -> bool {
        self.share() < chance
    }
}
