//! Lateness with which a thread wakes: percentiles and counts in fixed bins.

use flight::duration_histogram::DurationHistogram;
use serde::Serialize;

/// Upper edges of the bins that are shown, in µs; the last bin has none.
pub const EDGES_US: [u64; 9] = [50, 100, 200, 500, 1_000, 2_000, 5_000, 10_000, 20_000];

/// Lateness of one thread over one phase.
#[derive(Debug, Clone)]
pub struct Lateness {
    times: DurationHistogram,
    bins: [u64; EDGES_US.len() + 1],
    late: u64,
}

/// The figures of a [`Lateness`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LatenessFigures {
    /// Times the thread woke.
    pub wakes: u64,
    /// Half of the times it was less late than this, in µs.
    pub p50_us: f64,
    /// 99 of 100 times.
    pub p99_us: f64,
    /// 999 of 1,000 times.
    pub p999_us: f64,
    /// The latest.
    pub max_us: f64,
    /// Times it was later than a frame may be ([`crate::session::pacing::FRAME_GRACE_NS`]).
    pub over_6_ms: u64,
    /// Times in each bin of [`EDGES_US`], and beyond the last.
    pub bins: [u64; EDGES_US.len() + 1],
}

impl Lateness {
    /// Nothing yet.
    pub fn new() -> Self {
        Lateness { times: DurationHistogram::new(), bins: [0; EDGES_US.len() + 1], late: 0 }
    }

    /// Takes in one wake.
    ///
    /// # Real-time
    /// May run in a real-time thread: allocates nothing.
    pub fn add(&mut self, late_ns: u64) {
        self.times.add(late_ns);
        self.late += u64::from(late_ns > crate::session::pacing::FRAME_GRACE_NS);
        let bin = EDGES_US.iter().position(|edge| late_ns < edge * 1_000).unwrap_or(EDGES_US.len());
        if let Some(count) = self.bins.get_mut(bin) {
            *count += 1;
        }
    }

    /// The figures so far.
    pub fn figures(&self) -> LatenessFigures {
        let us = |ns: Option<u64>| ns.map_or(0.0, |ns| ns as f64 * 1e-3);
        LatenessFigures {
            wakes: self.times.total(),
            p50_us: us(self.times.percentile_ns(0.5)),
            p99_us: us(self.times.percentile_ns(0.99)),
            p999_us: us(self.times.percentile_ns(0.999)),
            max_us: us(self.times.max_ns()),
            over_6_ms: self.late,
            bins: self.bins,
        }
    }
}

impl Default for Lateness {
    fn default() -> Self {
        Lateness::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_wake_is_in_one_bin() {
        let mut lateness = Lateness::new();
        for us in [0, 49, 50, 99, 1_999, 6_001, 19_999, 20_000, 1_000_000] {
            lateness.add(us * 1_000);
        }
        let figures = lateness.figures();
        assert_eq!(figures.bins, [2, 2, 0, 0, 0, 1, 0, 1, 1, 2]);
        assert_eq!((figures.wakes, figures.over_6_ms), (9, 4));
        // A bin of the histogram is a few per cent wide.
        assert!((figures.max_us - 1e6).abs() < 1e5, "{figures:?}");
    }
}
