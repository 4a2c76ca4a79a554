//! The way from where the rig is to where the reference is.
//!
//! At arming the rig is seldom where the reference begins. Followed at once, the step would saturate both
//! valves and wind up whatever integrates. So the gap at arming is closed along half a cosine:
//!
//! ```text
//! g(t) = ref(t) + (p₀ − ref(0)) · (1 + cos(π t/T))/2      t < T
//! ```
//!
//! with `T` long enough for the gap: [`LONGEST_S`] for the whole range of the rig, shorter for less.

use model::observation::{CHANNELS, Pair};

/// Duration of the longest approach, for a gap of [`WIDEST_KPA`] or more, in seconds.
pub const LONGEST_S: f64 = 3.0;
/// Gap in kPa from which the approach takes its longest.
pub const WIDEST_KPA: f64 = 60.0;

/// An approach under way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SoftStart {
    gap_kpa: Pair,
    duration_s: f64,
}

impl SoftStart {
    /// From the pressures measured at arming to the reference at that time, in kPa gauge.
    pub fn new(measured_kpa: Pair, reference_kpa: Pair) -> Self {
        let gap_kpa: Pair = std::array::from_fn(|c| measured_kpa[c] - reference_kpa[c]);
        let widest = gap_kpa.iter().fold(0.0_f64, |widest, gap| widest.max(gap.abs()));
        SoftStart { gap_kpa, duration_s: LONGEST_S * (widest / WIDEST_KPA).min(1.0) }
    }

    /// Offset of the reference at `time_s` after arming, in kPa.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn offset_kpa(&self, time_s: f64) -> Pair {
        if time_s >= self.duration_s {
            return [0.0; CHANNELS];
        }
        let share = 0.5 + 0.5 * (std::f64::consts::PI * time_s.max(0.0) / self.duration_s).cos();
        self.gap_kpa.map(|gap| gap * share)
    }

    /// Duration in seconds.
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn starts_where_the_rig_is_and_ends_on_the_reference() {
        let approach = SoftStart::new([0.0, 0.0], [80.0, -70.0]);
        assert_eq!(approach.offset_kpa(0.0), [-80.0, 70.0]);
        assert_eq!(approach.offset_kpa(LONGEST_S), [0.0, 0.0]);
        let mut before = approach.offset_kpa(0.0)[0];
        for i in 1..=300 {
            let now = approach.offset_kpa(f64::from(i) * 0.01)[0];
            assert!(now >= before, "the gap closes steadily");
            before = now;
        }
    }

    #[test]
    fn no_gap_means_no_approach() {
        let approach = SoftStart::new([80.0, -70.0], [80.0, -70.0]);
        assert_eq!(approach.duration_s(), 0.0);
        assert_eq!(approach.offset_kpa(0.0), [0.0, 0.0]);
    }
}
