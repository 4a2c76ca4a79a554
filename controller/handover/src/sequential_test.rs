//! Wald's sequential test of a candidate's errors against the incumbent's record.
//!
//! The squares of errors, as multiples of the incumbent's mean square in like conditions, have mean 1 if the candidate is
//! as good, and `R` if it errs `√R` times as much ([`Rigour`]). For Gaussian errors each independent one adds
//!
//! ```text
//! Λ += ½ (x (1 − 1/R) − ln R)
//! ```
//!
//! and the test ends at ±ln(1/ε) (Wald, Sequential Analysis, 1947). Neighbouring ticks err alike: so many of them count as one as
//! a stretch has in which the reference costs the same. The two channels are tested each by itself: a candidate passes when
//! both have passed, and is refused when either is.

use model::observation::CHANNELS;

/// Error that a candidate may make, and the evidence by which that is held to be known.
///
/// The loop forgets in half a second, but what a reference costs does not: on two sines the fallback leaves 0.09 kPa for 20 s and 0.4 kPa
/// for the next 20 s, turn and turn about. With half a second as one piece of evidence of 30 policies as good as the incumbent 8 came through,
/// on three references; `docs/policies-results.md` has the table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rigour {
    /// R: mean square of a candidate that must be refused, as a multiple of the incumbent's.
    refused_ratio: f64,
    /// Ticks whose errors are one piece of evidence.
    alike_ticks: f64,
    /// The most that the plain mean of squares may be, as a multiple of the incumbent's, for a candidate to pass: Λ lets single
    /// ticks count for little, and what errs seldom but far must not pass by that.
    passed_mean: f64,
}

impl Rigour {
    /// For a share of the command: of a candidate that errs three times as much a share of half shows twice the error.
    pub const SHARE: Rigour = Rigour { refused_ratio: 1.75 * 1.75, alike_ticks: 50.0, passed_mean: f64::INFINITY };
    /// For all of the command.
    pub const ALL: Rigour = Rigour { refused_ratio: 1.5 * 1.5, alike_ticks: 75.0, passed_mean: 1.5 };
}

/// ln(1/ε) with ε = 1 %: both errors of the test, for each level.
const DECIDED: f64 = 4.605;
/// The most that a single tick counts, as a multiple of the incumbent's mean square: of Gaussian errors one in seventy is beyond. A knock at
/// the rig, or a turn of the reference at which the valve's backlash costs more than at others, is no verdict.
const MOST_EXCESS: f64 = 6.0;
/// The most that it counts in the plain mean.
const MOST_PLAIN_EXCESS: f64 = 50.0;
/// Excess that counts for an error that is no number.
const NOT_FINITE_EXCESS: f64 = 25.0;

/// Verdict of the test.
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
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SequentialTest {
    rigour: Rigour,
    log_ratio: [f64; CHANNELS],
    passed: [bool; CHANNELS],
    refused: bool,
    plain_sum: [f64; CHANNELS],
    ticks: [f64; CHANNELS],
}

impl SequentialTest {
    /// A test that knows nothing yet.
    pub fn new(rigour: Rigour) -> Self {
        let zero = [0.0; CHANNELS];
        let passed = [false; CHANNELS];
        SequentialTest { rigour, log_ratio: zero, passed, refused: false, plain_sum: zero, ticks: zero }
    }

    /// Takes in a channel's squared error as a multiple of the incumbent's mean square ([`crate::record::Record::excess`]).
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn add(&mut self, channel: usize, excess: f64) {
        let (Some(sum), Some(passed)) = (self.log_ratio.get_mut(channel), self.passed.get_mut(channel)) else { return };
        if let (Some(plain_sum), Some(ticks)) = (self.plain_sum.get_mut(channel), self.ticks.get_mut(channel)) {
            *plain_sum += if excess.is_finite() { excess.min(MOST_PLAIN_EXCESS) } else { MOST_PLAIN_EXCESS };
            *ticks += 1.0;
        }
        let excess = if excess.is_finite() { excess.min(MOST_EXCESS) } else { NOT_FINITE_EXCESS };
        let Rigour { refused_ratio, alike_ticks, .. } = self.rigour;
        let gained = 0.5 * (excess * (1.0 - 1.0 / refused_ratio) - refused_ratio.ln()) / alike_ticks;
        *sum += gained;
        if *sum <= -DECIDED {
            // It has passed; what comes later still counts, from here on.
            (*passed, *sum) = (true, -DECIDED);
        }
        self.refused |= *sum >= DECIDED;
    }

    /// Verdict so far.
    pub fn verdict(&self) -> TestVerdict {
        let errs_seldom_but_far =
            self.plain_sum.iter().zip(&self.ticks).any(|(sum, ticks)| *sum > self.rigour.passed_mean * ticks);
        match (self.refused, self.passed) {
            (true, _) => TestVerdict::Worse,
            (false, [true, true]) if !errs_seldom_but_far => TestVerdict::AsGood,
            _ => TestVerdict::Open,
        }
    }

    /// Λ of both channels: +4.6 is a verdict against it, −4.6 passes.
    pub fn log_ratio(&self) -> [f64; CHANNELS] {
        self.log_ratio
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gaussian by the sum of twelve uniform numbers of a linear congruence, and alike for as long as the test takes it to be.
    fn errors(seed: u64, scale: f64, rigour: Rigour) -> impl FnMut() -> f64 {
        let mut state = seed;
        let mut unit = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        let (mut left, mut error) = (0.0, 0.0);
        move || {
            if left == 0.0 {
                left = rigour.alike_ticks;
                error = scale * ((0..12).map(|_| unit()).sum::<f64>() - 6.0);
            }
            left -= 1.0;
            error
        }
    }

    fn decided(seed: u64, scale: f64, rigour: Rigour) -> (TestVerdict, u32) {
        let mut test = SequentialTest::new(rigour);
        let (mut first, mut second) = (errors(seed, scale, rigour), errors(seed + 1000, 1.0, rigour));
        for tick in 1..200_000 {
            test.add(0, first().powi(2));
            test.add(1, second().powi(2));
            if test.verdict() != TestVerdict::Open {
                return (test.verdict(), tick);
            }
        }
        (TestVerdict::Open, 200_000)
    }

    /// At most 8 of 200 candidates as good as the incumbent are refused, of 200 that err as much as must be refused at most 8 pass:
    /// ε = 1 % each, with three standard deviations of the binomial for the two channels together.
    #[test]
    fn errors_of_the_test_are_what_they_are_set_to() {
        for rigour in [Rigour::SHARE, Rigour::ALL] {
            let (mut wrong, mut ticks) = (0, 0);
            for seed in 0..200 {
                let (verdict, after) = decided(seed, 1.0, rigour);
                wrong += u32::from(verdict != TestVerdict::AsGood);
                ticks += after;
            }
            println!("{rigour:?}: {wrong} of 200 as good refused, decided after {} ticks on average", ticks / 200);
            assert!(wrong <= 8, "{rigour:?} {wrong}");
            let worse = rigour.refused_ratio.sqrt();
            let passed = (0..200).filter(|seed| decided(*seed, worse, rigour).0 != TestVerdict::Worse).count();
            println!("{rigour:?}: {passed} of 200 that err {worse} times as much pass");
            assert!(passed <= 8, "{rigour:?} {passed}");
            // Clearly worse is clear soon: three times the error within six pieces of evidence in nine of ten draws.
            let mut slow: Vec<u32> = (0..50).map(|seed| decided(seed, 3.0, rigour).1).collect();
            slow.sort_unstable();
            println!("{rigour:?}: three times the error is refused after {} to {} ticks", slow[0], slow[49]);
            assert!(f64::from(slow[45]) <= 14.0 * rigour.alike_ticks, "{slow:?}");
        }
    }

    #[test]
    fn a_knock_is_no_verdict_and_nan_is_bad() {
        for rigour in [Rigour::SHARE, Rigour::ALL] {
            let mut test = SequentialTest::new(rigour);
            test.add(0, 1e9);
            assert_eq!(test.verdict(), TestVerdict::Open);
            for _ in 0..80 {
                test.add(1, f64::NAN);
            }
            assert_eq!(test.verdict(), TestVerdict::Worse);
        }
    }
}
