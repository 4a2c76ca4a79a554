//! Wald's sequential test of a candidate's errors against the incumbent's record.
//!
//! The squares of errors, as multiples of the incumbent's mean square in like conditions, have mean 1 if the candidate is
//! as good, and `R` = 1.5² if it errs half as much again. For Gaussian errors each independent one adds
//!
//! ```text
//! Λ += ½ (x (1 − 1/R) − ln R)
//! ```
//!
//! and the test ends at ±ln(1/ε) (Wald, Sequential Analysis, 1947). Neighbouring ticks err alike: `ALIKE_TICKS` of them
//! count as one. The two channels are tested each by itself: a candidate passes when both have passed, and is refused
//! when either is.

use model::observation::CHANNELS;

/// R: mean square of a candidate that must be refused, as a multiple of the incumbent's.
const REFUSED_RATIO: f64 = 1.5 * 1.5;
/// Ticks whose errors are one piece of evidence: half a second, in which the loop forgets.
const ALIKE_TICKS: f64 = 25.0;
/// ln(1/ε) with ε = 1 %: both errors of the test, for each level.
const DECIDED: f64 = 4.605;
/// The most that a single tick counts, as a multiple of the incumbent's mean square: of Gaussian errors one in two thousand is beyond. A knock at
/// the rig, or a turn of the reference at which the valve's backlash costs more than at others, is no verdict.
const MOST_EXCESS: f64 = 12.0;
/// What counts for an error that is no number.
const NOT_FINITE_EXCESS: f64 = 25.0;

/// What the test says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TestVerdict {
    /// More ticks are needed.
    Open,
    /// As good as the incumbent in both channels.
    AsGood,
    /// Worse in at least one.
    Worse,
}

/// A test under way.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SequentialTest {
    log_ratio: [f64; CHANNELS],
    passed: [bool; CHANNELS],
    refused: bool,
}

impl SequentialTest {
    /// Takes in a channel's squared error as a multiple of the incumbent's mean square ([`crate::record::Record::excess`]).
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn add(&mut self, channel: usize, excess: f64) {
        let (Some(sum), Some(passed)) = (self.log_ratio.get_mut(channel), self.passed.get_mut(channel)) else { return };
        let excess = if excess.is_finite() { excess.min(MOST_EXCESS) } else { NOT_FINITE_EXCESS };
        let gained = 0.5 * (excess * (1.0 - 1.0 / REFUSED_RATIO) - REFUSED_RATIO.ln()) / ALIKE_TICKS;
        *sum += gained;
        if *sum <= -DECIDED {
            // It has passed; what comes later still counts, from here on.
            (*passed, *sum) = (true, -DECIDED);
        }
        self.refused |= *sum >= DECIDED;
    }

    /// What it says so far.
    pub fn verdict(&self) -> TestVerdict {
        match (self.refused, self.passed) {
            (true, _) => TestVerdict::Worse,
            (false, [true, true]) => TestVerdict::AsGood,
            _ => TestVerdict::Open,
        }
    }

    /// Λ of both channels: +4.6 refuses, −4.6 passes.
    pub fn log_ratio(&self) -> [f64; CHANNELS] {
        self.log_ratio
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gaussian by the sum of twelve uniform numbers of a linear congruence, and alike for 25 ticks.
    fn errors(seed: u64, scale: f64) -> impl FnMut() -> f64 {
        let mut state = seed;
        let mut unit = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        let (mut left, mut error) = (0, 0.0);
        move || {
            if left == 0 {
                left = 25;
                error = scale * ((0..12).map(|_| unit()).sum::<f64>() - 6.0);
            }
            left -= 1;
            error
        }
    }

    fn decided(seed: u64, scale: f64) -> (TestVerdict, u32) {
        let mut test = SequentialTest::default();
        let (mut first, mut second) = (errors(seed, scale), errors(seed + 1000, 1.0));
        for tick in 1..200_000 {
            test.add(0, first().powi(2));
            test.add(1, second().powi(2));
            if test.verdict() != TestVerdict::Open {
                return (test.verdict(), tick);
            }
        }
        (TestVerdict::Open, 200_000)
    }

    /// Of 200 candidates as good as the incumbent at most 4 are refused, of 200 with half as much error again at most 4 pass:
    /// ε = 1 % each, with three standard deviations of the binomial for the two channels together.
    #[test]
    fn errors_of_the_test_are_what_they_are_set_to() {
        let (mut wrong, mut ticks) = (0, 0);
        for seed in 0..200 {
            let (verdict, after) = decided(seed, 1.0);
            wrong += u32::from(verdict != TestVerdict::AsGood);
            ticks += after;
        }
        println!("as good: {wrong} of 200 refused, decided after {} ticks on average", ticks / 200);
        assert!(wrong <= 8, "{wrong}");
        let passed = (0..200).filter(|seed| decided(*seed, 1.5).0 != TestVerdict::Worse).count();
        assert!(passed <= 4, "{passed}");
        // Clearly worse is clear soon: three times the error within four seconds.
        let slowest = (0..50).map(|seed| decided(seed, 3.0)).max_by_key(|(_, ticks)| *ticks).unwrap();
        assert_eq!(slowest.0, TestVerdict::Worse);
        assert!(slowest.1 < 600, "{slowest:?}");
    }

    #[test]
    fn a_knock_is_no_verdict_and_nan_is_bad() {
        let mut test = SequentialTest::default();
        test.add(0, 1e9);
        assert_eq!(test.verdict(), TestVerdict::Open);
        for _ in 0..20 {
            test.add(1, f64::NAN);
        }
        assert_eq!(test.verdict(), TestVerdict::Worse);
    }
}
