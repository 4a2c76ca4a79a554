//! A reading that jumps: further in a tick than it was and than the model foresaw.

use crate::loss_window::{LossWindow, Outcome};

/// Distance that a reading may have from all that it could be, in kPa (chosen: a reading is believed neither way beyond it).
pub const JUMP_KPA: f64 = 10.0;
/// Ticks in a row in which a jump must stand before the rig is vented for it; one that comes and goes is counted as well.
const TICKS: u32 = 3;

/// Worth of a reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Worth {
    /// It is where it can be.
    Believed,
    /// It jumped; what it could have been at the least is used meanwhile, in kPa gauge.
    Suspect {
        /// Jump, kPa.
        kpa: f64,
        /// The nearest that it could be.
        instead_kpa: f64,
    },
    /// It has stayed away, or does so again and again.
    Wrong {
        /// Jump, kPa.
        kpa: f64,
        /// The nearest that it could be.
        instead_kpa: f64,
    },
}

/// Watches one reading.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Jump {
    suspect: LossWindow,
}

impl Jump {
    /// Begins anew.
    pub fn restart(&mut self) {
        self.suspect = LossWindow::new();
    }

    /// Takes a reading, all that it could be (kPa gauge): what it was and what was foreseen of it, and the most that it may jump.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn judge(&mut self, reading_kpa: f64, could_be_kpa: [f64; 3], most_kpa: f64) -> Worth {
        let low = could_be_kpa.into_iter().fold(f64::INFINITY, f64::min);
        let high = could_be_kpa.into_iter().fold(f64::NEG_INFINITY, f64::max);
        let instead_kpa = reading_kpa.max(low).min(high);
        let kpa = reading_kpa - instead_kpa;
        if kpa.abs() <= most_kpa {
            self.suspect.push(Outcome::Good);
            return Worth::Believed;
        }
        self.suspect.push(Outcome::Bad);
        if self.suspect.stands(TICKS) { Worth::Wrong { kpa, instead_kpa } } else { Worth::Suspect { kpa, instead_kpa } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_jump_that_stays_is_wrong_and_one_tick_of_it_is_not() {
        let mut jump = Jump::default();
        assert_eq!(jump.judge(95.0, [90.0, 91.0, 90.5], JUMP_KPA), Worth::Believed);
        let suspect = Worth::Suspect { kpa: -30.0, instead_kpa: 90.0 };
        assert_eq!(jump.judge(60.0, [90.0, 91.0, 90.5], JUMP_KPA), suspect);
        assert_eq!(jump.judge(90.0, [90.0, 91.0, 90.5], JUMP_KPA), Worth::Believed);
        assert_eq!(jump.judge(60.0, [90.0, 91.0, 90.5], JUMP_KPA), suspect);
        assert_eq!(jump.judge(60.0, [90.0, 91.0, 90.5], JUMP_KPA), suspect);
        assert_eq!(jump.judge(60.0, [90.0, 91.0, 90.5], JUMP_KPA), Worth::Wrong { kpa: -30.0, instead_kpa: 90.0 });
    }

    #[test]
    fn a_reading_that_jumps_every_fourth_tick_is_wrong_and_every_tenth_is_not() {
        for (every, wrong) in [(4, true), (10, false)] {
            let mut jump = Jump::default();
            let worth = (0..400).map(|k| jump.judge(if k % every == 0 { 150.0 } else { 90.0 }, [90.0; 3], JUMP_KPA));
            assert_eq!(worth.into_iter().any(|w| matches!(w, Worth::Wrong { .. })), wrong, "every {every}");
        }
    }

    #[test]
    fn a_reading_that_stays_behind_what_was_foreseen_has_not_jumped() {
        let mut jump = Jump::default();
        for _ in 0..10 {
            assert_eq!(jump.judge(0.0, [0.0, -18.0, -15.0], JUMP_KPA), Worth::Believed);
        }
    }
}
