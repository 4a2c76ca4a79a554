//! Conduct of a candidate, whatever it errs by: commands that the safety filter had to bend, pressures far off, duties that hunt,
//! and whether it had a part in them.

use model::observation::{CHANNELS, Pair};

use crate::conditions::{JUMPED, KINKED};
use crate::loss::Loss;
use crate::record::Record;

/// Ticks over which duties' changes and the safety filter's interventions are watched.
pub(crate) const WATCHED_TICKS: u32 = 50;
/// Interventions of the safety filter within them that end it, unless the incumbent had two thirds of as many in its own worst
/// second: one that hunts is bent in bursts, whoever shares in its commands.
const MOST_INTERVENTIONS: u32 = 3;
const INTERVENTIONS_RATIO: f64 = 1.5;
/// A candidate whose duties change by more than this (RMS a tick, in duty) and by three times the incumbent's hunts.
const CHATTER_DUTY: f64 = 0.025;
/// Such a limit after a jump of the reference, where whoever controls moves a duty far: through all of its range and back at most, at
/// the slew limit of 0.1 a tick (0.063). Measured on `bench`, steps of 13 kPa every second: 0.032. What takes back the change right
/// before it (0.018 there) is no way to another reference, and is held against [`CHATTER_DUTY`] all the same.
const JUMP_DUTY: f64 = 0.065;
/// Errors beyond this many times the incumbent's RMS, and beyond [`WIDE_KPA`], for [`WIDE_TICKS`] end it at once; beyond
/// [`WIDE_WATCHED_KPA`] where an operator went back to what errs more, and where the reference has turned round at once.
const WIDE_RATIO: f64 = 6.0;
const WIDE_KPA: Pair = [2.0, 1.0];
const WIDE_WATCHED_KPA: Pair = [4.0, 3.0];
pub(crate) const WIDE_TICKS: u32 = 10;
/// A share that has changed the duties by less than this within the last second is not to blame for what the rig does:
/// on `dual_pressure` it moves the settled pressures by 0.17 kPa at most.
const BLAMELESS_DUTY: f64 = 0.001;

/// Showing of a tick, once its command was out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shown {
    /// Kinds of the tick.
    pub kinds: [usize; CHANNELS],
    /// Errors in kPa.
    pub error_kpa: Pair,
    /// Changes of the duties.
    pub change_duty: Pair,
    /// True where the safety filter changed the command.
    pub filtered: bool,
    /// Part of the duties that is the candidate's: away from what the incumbent decided.
    pub part_duty: Pair,
}

/// Yardstick that a candidate is held against.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Judged {
    /// The incumbent's errors, besides the rules on hunting, interventions and far-off pressures.
    Compared,
    /// Those rules alone: an operator may go back to what errs more than what controls now.
    Watched,
    /// Nothing at all: the fallback is the last resort, and there is nothing better to give the command back to.
    Unquestioned,
}

/// Sums over the ticks watched.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Watched {
    ticks: u32,
    interventions: u32,
    /// Tells whether one of the ticks was after a jump of a reference.
    has_jumped: bool,
    /// Sums of squares of the changes, and of what they take back of the ones right before them.
    changes: Pair,
    taken_back: Pair,
    last_change_duty: Pair,
    wide: [u32; CHANNELS],
    part_duty: Pair,
}

/// Answer of the rules on interventions, far-off pressures and hunting to a tick.
pub(crate) enum Finding {
    Fault(Loss),
    /// Something is wrong, and the candidate has no part in it worth the name.
    NotIts,
}

impl Watched {
    /// Applies the rules to a tick, once its command is out.
    ///
    /// # Real-time
    /// May run in the tick.
    pub(crate) fn judge(&mut self, shown: &Shown, record: &Record, judged: Judged) -> Option<Finding> {
        self.ticks += 1;
        // The chambers are coupled through the pump: a jump of either reference moves both duties.
        let has_jumped = shown.kinds.contains(&JUMPED);
        // After a jump of the reference the slew limit holds anybody back.
        self.interventions += u32::from(shown.filtered && !has_jumped);
        self.has_jumped |= has_jumped;
        let rms_kpa = record.rms_kpa();
        for c in 0..CHANNELS {
            let stretched = judged == Judged::Watched || shown.kinds[c] == KINKED;
            let wide_kpa = if stretched { WIDE_WATCHED_KPA } else { WIDE_KPA };
            self.changes[c] += shown.change_duty[c].powi(2);
            let last_change_duty = std::mem::replace(&mut self.last_change_duty[c], shown.change_duty[c]);
            self.taken_back[c] += taken_back(last_change_duty, shown.change_duty[c]).powi(2);
            let part_duty = shown.part_duty[c].abs();
            self.part_duty[c] = part_duty.max(self.part_duty[c] * (1.0 - 1.0 / f64::from(WATCHED_TICKS)));
            let wide = shown.error_kpa[c].abs() > (WIDE_RATIO * rms_kpa[c]).max(wide_kpa[c]);
            // After a jump of the reference anything may be far off.
            self.wide[c] = if wide && shown.kinds[c] != JUMPED { self.wide[c] + 1 } else { 0 };
        }
        // The chambers are coupled through the pump: a share in either valve is a share in both pressures.
        let blamed = self.part_duty.iter().any(|duty| *duty > BLAMELESS_DUTY);
        let fault = |loss| Some(if blamed { Finding::Fault(loss) } else { Finding::NotIts });
        let most = INTERVENTIONS_RATIO * record.most_bent();
        if self.interventions >= MOST_INTERVENTIONS && f64::from(self.interventions) > most {
            return fault(Loss::Filtered);
        }
        if self.wide.iter().any(|ticks| *ticks >= WIDE_TICKS) {
            return fault(Loss::FarOff);
        }
        if self.ticks < WATCHED_TICKS {
            return None;
        }
        let hunts = (0..CHANNELS).any(|c| {
            let rms = |squares: f64| (squares / f64::from(self.ticks)).sqrt();
            let usual = 3.0 * record.change_duty(c);
            let most = if self.has_jumped { JUMP_DUTY } else { CHATTER_DUTY };
            rms(self.changes[c]) > usual.max(most) || rms(self.taken_back[c]) > usual.max(CHATTER_DUTY)
        });
        *self = Watched {
            wide: self.wide,
            part_duty: self.part_duty,
            last_change_duty: self.last_change_duty,
            ..Watched::default()
        };
        if hunts { fault(Loss::Hunts) } else { None }
    }
}

/// Part of a change that takes back the one before it.
fn taken_back(before_duty: f64, change_duty: f64) -> f64 {
    if before_duty * change_duty < 0.0 { before_duty.abs().min(change_duty.abs()) } else { 0.0 }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use model::rig::Rig;
    use model::steady::SteadyMap;

    use super::*;

    /// Half of what is called far off, where the rig has settled under such a share.
    #[test]
    fn a_blameless_share_moves_no_pressure_far() {
        let map = SteadyMap::new(&Rig::builtin("dual_pressure").unwrap()).unwrap();
        for goal in [[85.0, -71.0], [70.0, -60.0], [95.0, -74.0]] {
            let duty = map.duty_for(goal, [0.0; CHANNELS]);
            for share in [[BLAMELESS_DUTY, 0.0], [0.0, BLAMELESS_DUTY], [BLAMELESS_DUTY; CHANNELS]] {
                let settled = map.settled_kpa(std::array::from_fn(|c| duty[c] + share[c])).unwrap();
                println!("{goal:?} {share:?} {settled:?}");
                for c in 0..CHANNELS {
                    assert!((settled[c] - goal[c]).abs() < 0.5 * WIDE_KPA[c], "{goal:?} {share:?} {settled:?}");
                }
            }
        }
    }
}
