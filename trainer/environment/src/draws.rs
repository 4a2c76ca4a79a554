//! Random numbers: one stream for each purpose, so that one more draw here changes nothing there.

use proto::split_mix::SplitMix64;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

/// Purpose of a stream of random numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// Rig parameters and mechanisms.
    Rig,
    /// References.
    Reference,
    /// Beginning of an episode.
    Start,
    /// Seeds of the sensors' noise.
    Noise,
    /// Length of an episode's warm-up.
    WarmUp,
    /// Ticks at which a flight is branched.
    Branch,
    /// Order in which branches are learned from.
    Shuffle,
}

/// The stream of a seed, a purpose, an episode and a lane.
///
/// The four are mixed by SplitMix64, one after the other, into the seed of a PCG generator (O'Neill, 2014), whose numbers are
/// the same on every machine.
pub fn stream(seed: u64, purpose: Purpose, episode: u64, lane: usize) -> Pcg64Mcg {
    let mixed = [purpose as u64 + 1, episode, lane as u64].into_iter().fold(mix(seed), |key, part| mix(key ^ part));
    Pcg64Mcg::seed_from_u64(mixed)
}

fn mix(value: u64) -> u64 {
    SplitMix64::new(value).next_u64()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt as _;

    #[test]
    fn streams_differ_in_every_key_and_repeat() {
        let first = |seed, purpose, episode, lane| stream(seed, purpose, episode, lane).random::<u64>();
        let here = first(1, Purpose::Rig, 2, 3);
        assert_eq!(here, first(1, Purpose::Rig, 2, 3));
        for other in [
            first(2, Purpose::Rig, 2, 3),
            first(1, Purpose::Noise, 2, 3),
            first(1, Purpose::Rig, 3, 3),
            first(1, Purpose::Rig, 2, 4),
        ] {
            assert_ne!(here, other);
        }
    }
}
