//! Inputs on which a policy is tried before it may fly, the same for every policy and every run.
//!
//! Uncorrelated values alone would average out in the first layer and miss what the rig produces, so
//! four kinds take turns over the contract's ranges: both chambers at a level (a grid), values drawn
//! each by itself, every value at one end of its range, and one trend through all values. Wild probes
//! reach a thousand times the physical range: there only finiteness and the output's range are asked,
//! because rounding before a saturation may differ there between two correct programs.

use crate::policy_signature::{Channel, PolicySignature};

/// Probes within the physical range.
pub(crate) const IN_RANGE: usize = 1024;
/// Probes far outside.
pub(crate) const WILD: usize = 128;

/// Levels per chamber on the grid of the first kind: 16 x 16 = a quarter of the probes.
const LEVELS: usize = 16;

/// Fills `input` with probe number `number`; from [`IN_RANGE`] on they are wild.
pub(crate) fn fill(contract: &PolicySignature, number: usize, input: &mut [f32]) {
    let mut random = SplitMix64(number as u64);
    let kind = number % 4;
    let round = number / 4;
    let level = |turn: usize| (turn % LEVELS) as f32 / (LEVELS - 1) as f32;
    let levels = [level(round), level(round / LEVELS)];
    let (start, slope) = (random.unit(), random.unit() - 0.5);
    let last = contract.inputs.len().saturating_sub(1).max(1) as f32;
    for (i, (value, channel)) in input.iter_mut().zip(&contract.inputs).enumerate() {
        let share = match kind {
            _ if number >= IN_RANGE => 2000.0 * random.unit() - 1000.0,
            0 => levels[i % 2],
            1 => random.unit(),
            2 => random.unit().round(),
            _ => (start + slope * i as f32 / last).clamp(0.0, 1.0),
        };
        *value = at(channel, share);
    }
}

/// The value at `share` of a channel's range.
fn at(channel: &Channel, share: f32) -> f32 {
    channel.low + share * (channel.high - channel.low)
}

/// Sebastiano Vigna's SplitMix64 generator: one multiplication chain, no state but a counter.
struct SplitMix64(u64);

impl SplitMix64 {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in 0..1, on 24 bits.
    fn unit(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1u32 << 24) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// First outputs of the reference C program for seed 0.
    #[test]
    fn generator_is_splitmix64() {
        let mut random = SplitMix64(0);
        assert_eq!(random.next(), 0xe220_a839_7b1d_cdaf);
        assert_eq!(random.next(), 0x6e78_9e6a_a1b9_65f4);
    }

    #[test]
    fn probes_fill_the_range_and_stay_in_it() {
        let contract = PolicySignature::pressures_to_duties(1, 84, 12);
        let mut input = vec![0.0; 84];
        let mut extremes = vec![(f32::MAX, f32::MIN); 84];
        for number in 0..IN_RANGE {
            fill(&contract, number, &mut input);
            for ((value, channel), (low, high)) in input.iter().zip(&contract.inputs).zip(&mut extremes) {
                assert!((channel.low..=channel.high).contains(value));
                *low = low.min(*value);
                *high = high.max(*value);
            }
        }
        for (extreme, channel) in extremes.iter().zip(&contract.inputs) {
            assert_eq!(*extreme, (channel.low, channel.high));
        }
    }
}
