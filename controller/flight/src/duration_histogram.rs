//! Times in bins of known relative width, for percentiles without keeping the values.
//!
//! # Bins
//! Whole nanoseconds. Below 128 ns every value has a bin of its own; above, each octave
//! [2ᵉ, 2ᵉ⁺¹) is cut into 128 even bins. A bin is therefore at most 1/128 = 0.8 % of its lowest value
//! wide, from 128 ns to the end at 68.7 s; what lies beyond counts in the last bin. Largest and smallest value are kept
//! exactly.
//!
//! # Percentiles
//! The nearest rank: the smallest value that at least a share `q` of all values do not exceed. What is
//! returned is the upper edge of that value's bin (and never more than the largest value), so a
//! percentile is never told too small, and at most 0.8 % too large.

/// log2 of the bins per octave.
const SUB_BITS: u32 = 7;
/// Bins per octave.
const SUB: u64 = 1 << SUB_BITS;
/// Values from here on (ns) share the last bin.
const END_NS: u64 = 1 << 36;
/// Number of bins: one octave's worth for the exact values, then 29 octaves.
const BINS: usize = ((36 - SUB_BITS + 1) as usize) << SUB_BITS;

/// Counts of durations.
#[derive(Debug, Clone)]
pub struct DurationHistogram {
    counts: Box<[u64]>,
    total: u64,
    least_ns: u64,
    most_ns: u64,
}

impl Default for DurationHistogram {
    fn default() -> Self {
        Self::new()
    }
}

impl DurationHistogram {
    /// An empty histogram; allocates its 30 kB here and nothing later.
    pub fn new() -> Self {
        Self { counts: vec![0; BINS].into_boxed_slice(), total: 0, least_ns: u64::MAX, most_ns: 0 }
    }

    /// Counts a value (ns).
    ///
    /// # Real-time
    /// May run in the tick: a shift, an addition.
    pub fn add(&mut self, ns: u64) {
        if let Some(count) = self.counts.get_mut(bin_of(ns)) {
            *count += 1;
        }
        self.total += 1;
        self.least_ns = self.least_ns.min(ns);
        self.most_ns = self.most_ns.max(ns);
    }

    /// Number of values.
    pub fn total(&self) -> u64 {
        self.total
    }

    /// The largest value (ns), exactly; `None` without any.
    pub fn max_ns(&self) -> Option<u64> {
        (self.total > 0).then_some(self.most_ns)
    }

    /// The percentile of a share in [0, 1] (ns); `None` without any value.
    ///
    /// Shares outside are taken as 0 or 1, NaN as 1.
    pub fn percentile_ns(&self, share: f64) -> Option<u64> {
        if self.total == 0 {
            return None;
        }
        // NaN fails the comparison and asks for the largest, the safe answer.
        let share = if share < 1.0 { share.max(0.0) } else { 1.0 };
        let rank = ((share * self.total as f64).ceil() as u64).clamp(1, self.total);
        let mut passed = 0;
        for (bin, count) in self.counts.iter().enumerate() {
            passed += count;
            if passed >= rank {
                // Beyond the end the edge says nothing.
                let edge = if bin + 1 == BINS { self.most_ns } else { upper_edge(bin) };
                return Some(edge.min(self.most_ns).max(self.least_ns));
            }
        }
        Some(self.most_ns)
    }
}

fn bin_of(ns: u64) -> usize {
    let ns = ns.min(END_NS - 1);
    if ns < SUB {
        return ns as usize;
    }
    let octave = ns.ilog2() - SUB_BITS;
    // The leading SUB_BITS + 1 bits, the first of which is always 1.
    let leading = ns >> octave;
    ((u64::from(octave) << SUB_BITS) + leading) as usize
}

/// The largest value of a bin.
fn upper_edge(bin: usize) -> u64 {
    let bin = bin as u64;
    if bin < SUB {
        return bin;
    }
    let octave = (bin >> SUB_BITS) - 1;
    let leading = bin - (octave << SUB_BITS);
    ((leading + 1) << octave) - 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The most by which a percentile may be told too large, as a share of it: a bin of an octave.
    const RESOLUTION: f64 = 1.0 / SUB as f64;

    #[test]
    fn bins_follow_each_other_without_gap_or_overlap() {
        for bin in 0..BINS {
            let upper = upper_edge(bin);
            assert_eq!(bin_of(upper), bin, "upper edge {upper}");
            assert_eq!(bin_of(upper + 1), (bin + 1).min(BINS - 1), "after {upper}");
        }
        assert_eq!(upper_edge(BINS - 1), END_NS - 1);
        assert_eq!(bin_of(u64::MAX), BINS - 1);
    }

    #[test]
    fn hand_counted_percentiles() {
        let mut histogram = DurationHistogram::new();
        assert_eq!((histogram.percentile_ns(0.5), histogram.max_ns()), (None, None));
        // 1 … 100 ns lie in bins of their own, so the answers are exact.
        (1..=100).for_each(|ns| histogram.add(ns));
        let at = |share| histogram.percentile_ns(share).unwrap();
        assert_eq!([at(0.0), at(0.5), at(0.99), at(0.999), at(1.0)], [1, 50, 99, 100, 100]);
        assert_eq!([at(-3.0), at(7.0), at(f64::NAN)], [1, 100, 100]);
    }

    #[test]
    fn a_value_beyond_the_end_is_the_maximum_still() {
        let mut histogram = DurationHistogram::new();
        (0..9).for_each(|_| histogram.add(1_000));
        histogram.add(100_000_000_000);
        assert_eq!(histogram.percentile_ns(0.999), Some(100_000_000_000));
    }

    proptest! {
        #[test]
        fn percentiles_agree_with_sorted_values(
            // Exponents, so that every octave is met.
            values in prop::collection::vec((0_u32..36, 0_u64..u64::MAX), 1..400),
            share in 0.0..=1.0_f64,
        ) {
            let mut values: Vec<u64> = values.iter().map(|(bits, random)| random >> (63 - bits)).collect();
            let mut histogram = DurationHistogram::new();
            values.iter().for_each(|ns| histogram.add(*ns));
            values.sort_unstable();
            let rank = ((share * values.len() as f64).ceil() as usize).clamp(1, values.len());
            let exact = values[rank - 1];
            let told = histogram.percentile_ns(share).unwrap();
            prop_assert!(told >= exact, "{told} < {exact}");
            prop_assert!(told as f64 <= exact as f64 * (1.0 + RESOLUTION), "{told} for {exact}");
            prop_assert_eq!(histogram.max_ns(), values.last().copied());
            prop_assert_eq!(Some(histogram.least_ns), values.first().copied());
        }
    }
}
