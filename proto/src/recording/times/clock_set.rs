//! A clock that was set while it was read: a logger without a battery begins in 1970 and learns the time from the network.
//!
//! The times of such a file leave one hole that is longer than all the rest. A long break between two runs looks the same, so it is only
//! remarked. Where the rig file says the distance of rows, the hole becomes a short break; the rows before and behind it are two runs
//! either way.

/// Shorter holes are breaks (s): who learns the time is off by more.
const LEAST_S: f64 = 3600.0;

/// The step in which a clock was set.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ClockSet {
    /// Row behind it.
    pub(crate) row: usize,
    /// Length of the step (s).
    pub(crate) gap_s: f64,
    /// All other steps together (s).
    pub(crate) rest_s: f64,
}

/// The step in which the clock behind these times (s), which go forward, may have been set.
pub(crate) fn clock_set(time_s: &[f64]) -> Option<ClockSet> {
    let all_s = time_s.last()? - time_s.first()?;
    let steps = time_s.windows(2).map(|pair| pair[1] - pair[0]).enumerate();
    let (before, gap_s) = steps.max_by(|(_, one), (_, other)| one.total_cmp(other))?;
    let rest_s = all_s - gap_s;
    (gap_s >= LEAST_S && gap_s > rest_s).then_some(ClockSet { row: before + 1, gap_s, rest_s })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_that_is_set_leaves_a_hole_longer_than_all_the_rest() {
        let run: Vec<f64> = (0..1000).map(|k| 0.02 * f64::from(k)).collect();
        let after = |gap_s: f64| -> Vec<f64> {
            run.iter().enumerate().map(|(k, t)| if k < 400 { *t } else { t + gap_s }).collect()
        };
        assert_eq!(clock_set(&run), None);
        assert_eq!(clock_set(&after(600.0)), None, "a break");
        let set = clock_set(&after(1.7e9)).unwrap();
        assert!(set.row == 400 && (set.rest_s - 19.96).abs() < 1e-3, "{set:?}");
        let hours: Vec<f64> = (0..20_000).map(|k| f64::from(k) + if k < 50 { 0.0 } else { 4000.0 }).collect();
        assert_eq!(clock_set(&hours), None, "a pause in a long recording");
    }
}
