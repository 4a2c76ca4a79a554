//! Motion of late, of the references and of the command itself: what a model leaves at rest says nothing of what it leaves in a step, nor
//! while noise moves the valves.

use model::observation::{CHANNELS, Pair, TICKS_PER_S};

/// Kinds of motion of the references of which the model's errors are recorded apart.
const RECORDED_KINDS: usize = 3;
/// Rates from which on a reference no longer rests, moves quickly, jumps, in kPa/s of the positive channel (chosen: a tenth, half and twice
/// the steepest of the paper's reference). The negative chamber goes half as far.
const FROM_KPA_PER_S: [f64; RECORDED_KINDS] = [0.5, 2.5, 10.0];
const NEGATIVE_SHARE: f64 = 0.5;
/// Ticks for which a motion is felt: 4 s (measured: 20 kPa down, a valve that lags, back within the noise by then).
const FELT_TICKS: u32 = 200;

/// Part of a command that follows from nothing that was measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Excitation {
    /// There is none.
    None,
    /// Noise was added, to explore.
    Noise,
}

/// Kind of motion that is felt in a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Motion {
    /// Rest, slow, quick, and the same while noise moves the valves: the place in the record. A model without their play foresees ways
    /// under noise that no chamber makes.
    Recorded(usize),
    /// A jump, or nothing is known of the reference: each is another, so no record of others narrows the limits.
    Jump,
}

impl Motion {
    /// Kinds of which records are kept.
    pub(crate) const RECORDS: usize = 2 * RECORDED_KINDS;
    /// As fast as the steepest parts of the paper's reference.
    const QUICK: usize = 2;

    /// Tells whether the references move quickly, or more than that.
    pub(crate) fn is_quick(self) -> bool {
        match self {
            Motion::Recorded(place) => place % RECORDED_KINDS == Motion::QUICK,
            Motion::Jump => true,
        }
    }
}

/// References of the last ticks, as far as they count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ReferenceMotion {
    last_kpa: Option<Pair>,
    /// Ticks since the references moved as fast as each rate in `FROM_KPA_PER_S`.
    since: [u32; RECORDED_KINDS],
    /// Ticks since noise was added to the command.
    since_noise: u32,
}

impl ReferenceMotion {
    /// Nothing has moved.
    pub(crate) const RESTING: Self =
        ReferenceMotion { last_kpa: None, since: [FELT_TICKS; RECORDED_KINDS], since_noise: FELT_TICKS };

    /// Takes the references of a tick under control, kPa gauge, and what was added to its command. Both channels count, for the chambers
    /// are coupled through the pump.
    ///
    /// # Real-time
    /// May run in the tick.
    pub(crate) fn follow(&mut self, reference_kpa: Pair, excitation: Excitation) {
        let rate = self.last_kpa.replace(reference_kpa).map_or(0.0, |last| {
            let rates: [f64; CHANNELS] = std::array::from_fn(|c| (reference_kpa[c] - last[c]).abs() * TICKS_PER_S);
            // What is no number moves as fast as can be.
            rates[0].max(rates[1] / NEGATIVE_SHARE) + 0.0 * (rates[0] + rates[1])
        });
        for (since, from) in self.since.iter_mut().zip(FROM_KPA_PER_S) {
            *since = if rate < from { since.saturating_add(1) } else { 0 };
        }
        self.since_noise = if excitation == Excitation::None { self.since_noise.saturating_add(1) } else { 0 };
    }

    /// Kind of motion that is felt.
    ///
    /// # Real-time
    /// May run in the tick.
    pub(crate) fn felt(&self) -> Motion {
        let noise = usize::from(self.since_noise < FELT_TICKS);
        match self.since.iter().filter(|since| **since < FELT_TICKS).count() {
            RECORDED_KINDS => Motion::Jump,
            kind => Motion::Recorded(kind + noise * RECORDED_KINDS),
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
            references.iter().for_each(|reference| motion.follow(*reference, Excitation::None));
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

    /// Noise makes another kind of each motion.
    #[test]
    fn noise_is_felt_for_as_long_beside_each_motion() {
        let mut motion = ReferenceMotion::RESTING;
        let mut after = |positive_kpa: f64, excitation| {
            motion.follow([positive_kpa, -70.0], excitation);
            motion.felt()
        };
        assert_eq!(after(90.0, Excitation::None), Motion::Recorded(0));
        assert_eq!(after(90.0, Excitation::Noise), Motion::Recorded(3));
        assert_eq!(after(90.02, Excitation::Noise), Motion::Recorded(4), "1 kPa/s");
        assert_eq!(after(90.12, Excitation::Noise), Motion::Recorded(5), "5 kPa/s");
        assert!(after(90.12, Excitation::Noise).is_quick());
        assert_eq!(after(70.0, Excitation::Noise), Motion::Jump);
        let course: Vec<Motion> = (0..300).map(|_| after(70.0, Excitation::None)).collect();
        let at = FELT_TICKS as usize - 1;
        assert_eq!((course[at - 1], course[at]), (Motion::Jump, Motion::Recorded(0)));
    }
}
