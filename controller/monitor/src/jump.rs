//! A reading that jumps: further in a tick than it was and than the model foresaw.

/// How far a reading may be from all that it could be, in kPa (chosen: a reading is believed neither way beyond it).
pub const JUMP_KPA: f64 = 10.0;
/// Ticks in a row in which a jump must stand before the rig is vented for it.
const TICKS: u32 = 3;

/// What a reading is worth.
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
    /// It has stayed away.
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
    suspect: u32,
}

impl Jump {
    /// Begins anew.
    pub fn restart(&mut self) {
        self.suspect = 0;
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
            self.suspect = 0;
            return Worth::Believed;
        }
        self.suspect = self.suspect.saturating_add(1);
        if self.suspect >= TICKS { Worth::Wrong { kpa, instead_kpa } } else { Worth::Suspect { kpa, instead_kpa } }
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
    fn a_reading_that_stays_behind_what_was_foreseen_has_not_jumped() {
        let mut jump = Jump::default();
        for _ in 0..10 {
            assert_eq!(jump.judge(0.0, [0.0, -18.0, -15.0], JUMP_KPA), Worth::Believed);
        }
    }
}
