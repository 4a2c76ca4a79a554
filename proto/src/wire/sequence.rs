//! Sequence numbers: per direction, from 1, past `0xFFFFFFFF` to 1; 0 is no sequence number.
//!
//! They live on a ring of 2³² − 1 numbers. `a` is newer than `b` where the way from `b` up to `a`
//! round that ring is shorter than half of it, so a wrap is no step back.

/// Numbers on the ring: 1 to `0xFFFFFFFF`.
const RING: u64 = 0xFFFF_FFFF;

/// Gives out the sequence numbers of one direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SequenceCounter {
    last: u32,
}

impl SequenceCounter {
    /// A counter whose first number is 1.
    #[must_use]
    pub const fn new() -> Self {
        Self { last: 0 }
    }

    /// A counter that goes on after `last` (0: from the start).
    #[must_use]
    pub const fn after(last: u32) -> Self {
        Self { last }
    }

    /// The number last given out, 0 where there is none yet.
    #[must_use]
    pub const fn last(&self) -> u32 {
        self.last
    }

    /// The next number.
    ///
    /// # Real-time
    /// May run in the tick.
    pub const fn advance(&mut self) -> u32 {
        self.last = match self.last.checked_add(1) {
            Some(next) => next,
            None => 1,
        };
        self.last
    }
}

impl Default for SequenceCounter {
    fn default() -> Self {
        Self::new()
    }
}

/// Steps from `from` up to `to` round the ring, `None` where either is 0 (no sequence number).
#[must_use]
pub const fn sequence_distance(from: u32, to: u32) -> Option<u32> {
    if from == 0 || to == 0 {
        return None;
    }
    Some(((to as u64 + RING - from as u64) % RING) as u32)
}

/// True where `candidate` is newer than `last`, the last number seen (0: none yet).
///
/// # Real-time
/// May run in the tick.
#[must_use]
pub const fn is_newer(candidate: u32, last: u32) -> bool {
    if candidate == 0 {
        return false;
    }
    match sequence_distance(last, candidate) {
        None => true,
        Some(steps) => steps != 0 && (steps as u64) <= RING / 2,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_from_one_and_wraps_past_all_ones_to_one() {
        let mut counter = SequenceCounter::new();
        assert_eq!([counter.advance(), counter.advance(), counter.advance()], [1, 2, 3]);
        let mut counter = SequenceCounter::after(0xFFFF_FFFE);
        assert_eq!([counter.advance(), counter.advance(), counter.advance()], [0xFFFF_FFFF, 1, 2]);
    }

    #[test]
    fn newer_survives_the_wrap() {
        assert!(is_newer(1, 0), "the first of all");
        assert!(is_newer(2, 1));
        assert!(!is_newer(1, 1), "a repetition");
        assert!(!is_newer(1, 2), "a step back");
        assert!(is_newer(1, 0xFFFF_FFFF), "the wrap");
        assert!(is_newer(5, 0xFFFF_FFF0), "a wrap with a gap");
        assert!(!is_newer(0xFFFF_FFFF, 1), "a step back over the wrap");
        assert!(!is_newer(0, 7), "0 is no sequence number");
        assert!(!is_newer(0, 0));
        // Half the ring: 0x7FFF_FFFF steps up is ahead, one more is behind.
        assert!(is_newer(0x8000_0000, 1));
        assert!(!is_newer(0x8000_0001, 1));
    }

    #[test]
    fn distance_counts_the_steps() {
        assert_eq!(sequence_distance(1, 4), Some(3));
        assert_eq!(sequence_distance(0xFFFF_FFFF, 1), Some(1), "no 0 between them");
        assert_eq!(sequence_distance(0, 4), None);
    }
}
