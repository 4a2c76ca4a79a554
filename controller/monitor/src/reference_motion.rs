//! Speed of the references of late: what a model leaves at rest says nothing of what it leaves in a step.

use model::observation::{CHANNELS, Pair, TICKS_PER_S};

/// Kinds of motion of which the model's errors are recorded apart.
pub(crate) const RECORDED_KINDS: usize = 3;
/// Rates from which on a reference no longer rests, moves quickly, jumps, in kPa/s of the positive channel (chosen: a tenth, half and twice
/// the steepest of the paper's reference). The negative chamber goes half as far.
const FROM_KPA_PER_S: [f64; RECORDED_KINDS] = [0.5, 2.5, 10.0];
const NEGATIVE_SHARE: f64 = 0.5;
/// Ticks for which a motion is felt: 4 s (measured: 20 kPa down, a valve that lags, back within the noise by then).
const FELT_TICKS: u32 = 200;

/// Kind of motion that is felt in a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Motion {
    /// Rest, slow, quick: the place in the record.
    Recorded(usize),
    /// A jump, or nothing is known of the reference: each is another, so no record of others narrows the limits.
    Jump,
}

impl Motion {
    /// As fast as the steepest parts of the paper's reference.
    pub(crate) const QUICK: Motion = Motion::Recorded(2);
}

/// References of the last ticks, as far as they count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ReferenceMotion {
    last_kpa: Option<Pair>,
    /// Ticks since the references moved as fast as each rate in `FROM_KPA_PER_S`.
    since: [u32; RECORDED_KINDS],
}

impl ReferenceMotion {
    /// Nothing has moved.
    pub(crate) const RESTING: Self = ReferenceMotion { last_kpa: None, since: [FELT_TICKS; RECORDED_KINDS] };

    /// Takes the references of a tick under control, kPa gauge. Both channels count, for the chambers are coupled through the pump.
    ///
    /// # Real-time
    /// May run in the tick.
    pub(crate) fn follow(&mut self, reference_kpa: Pair) {
        let rate = self.last_kpa.replace(reference_kpa).map_or(0.0, |last| {
            let rates: [f64; CHANNELS] = std::array::from_fn(|c| (reference_kpa[c] - last[c]).abs() * TICKS_PER_S);
            // What is no number moves as fast as can be.
            rates[0].max(rates[1] / NEGATIVE_SHARE) + 0.0 * (rates[0] + rates[1])
        });
        for (since, from) in self.since.iter_mut().zip(FROM_KPA_PER_S) {
            *since = if rate < from { since.saturating_add(1) } else { 0 };
        }
    }

    /// Kind of motion that is felt.
    ///
    /// # Real-time
    /// May run in the tick.
    pub(crate) fn felt(&self) -> Motion {
        match self.since.iter().filter(|since| **since < FELT_TICKS).count() {
            RECORDED_KINDS => Motion::Jump,
            kind => Motion::Recorded(kind),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_motion_is_felt_for_four_seconds() {
        let mut motion = ReferenceMotion::RESTING;
        let mut after = |references: &[Pair]| {
            references.iter().for_each(|reference| motion.follow(*reference));
            motion.felt()
        };
        assert_eq!(after(&[[90.0, -70.0]; 100]), Motion::Recorded(0));
        assert_eq!(after(&[[90.02, -70.0]]), Motion::Recorded(1), "1 kPa/s");
        assert_eq!(after(&[[90.02, -70.03]]), Motion::Recorded(2), "1.5 kPa/s of the negative channel");
        assert_eq!(after(&[[70.0, -70.03]]), Motion::Jump);
        assert_eq!(after(&[[70.0, -70.03]; 199]), Motion::Jump);
        assert_eq!(after(&[[70.0, -70.03]]), Motion::Recorded(0));
        assert_eq!(after(&[[f64::NAN, -70.03]]), Motion::Jump);
        assert_eq!(after(&[[70.0, -70.03]]), Motion::Jump);
    }
}
