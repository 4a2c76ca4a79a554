//! Number of bad ticks among the last 100.

/// Ticks that count.
pub const WINDOW: u32 = 100;
/// Missing frames of [`WINDOW`] above which a person is told: fewer than 90 of 100 came (study of the daemon, §3.6).
pub const MISSING_TO_WARN: u32 = 10;
/// Missing frames of [`WINDOW`] above which the rig is vented: fewer than 75 of 100 came (study of the daemon, §3.6).
pub const MISSING_TO_VENT: u32 = 25;
/// Frames with a wrong CRC of [`WINDOW`] that vent and close the link (study of the daemon, §3.6).
pub const DAMAGED_TO_CLOSE: u32 = 3;
/// Deadlines missed in a row that vent (study of the daemon, §3.6).
pub const DEADLINES_IN_A_ROW: u32 = 3;
/// Deadlines missed of [`WINDOW`] that vent (study of the daemon, §3.6).
pub const DEADLINES_TO_VENT: u32 = 5;

/// Frames of [`WINDOW`] above which something that is wrong off and on vents: a wire or relay that makes contact now and then
/// (chosen: one in five, below what may be missing, for here something is known to be wrong).
pub const FLICKERS_TO_VENT: u32 = 20;
/// Commands of [`WINDOW`] that the cRIO has missed, above which the rig is vented: as for frames the other way.
pub const COMMANDS_TO_VENT: u32 = MISSING_TO_VENT;

/// One bit per tick, the newest lowest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LossWindow {
    bits: u128,
}

/// Outcome of a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// The tick was as it should be.
    Good,
    /// The tick was not as it should be.
    Bad,
}

impl LossWindow {
    /// Nothing bad so far.
    pub fn new() -> Self {
        LossWindow::default()
    }

    /// Takes in a tick and answers how many of the last [`WINDOW`] were bad.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn push(&mut self, outcome: Outcome) -> u32 {
        let keep = (1u128 << WINDOW) - 1;
        self.bits = ((self.bits << 1) | u128::from(outcome == Outcome::Bad)) & keep;
        self.count()
    }

    /// Bad ticks of the last [`WINDOW`].
    pub fn count(&self) -> u32 {
        self.bits.count_ones()
    }

    /// Bad ticks of the newest so many, at most [`WINDOW`].
    pub fn count_newest(&self, ticks: u32) -> u32 {
        (self.bits & ((1u128 << ticks.min(WINDOW)) - 1)).count_ones()
    }

    /// True where this stands: bad for so many ticks in a row, or off and on.
    pub fn stands(&self, in_a_row: u32) -> bool {
        self.in_a_row() >= in_a_row || self.count() > FLICKERS_TO_VENT
    }

    /// Bad ticks in a row up to now.
    pub fn in_a_row(&self) -> u32 {
        self.bits.trailing_ones()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_the_last_hundred_and_forgets_the_rest() {
        let mut window = LossWindow::new();
        for k in 0..1_000u32 {
            let bad = k % 3 == 0;
            let count = window.push(if bad { Outcome::Bad } else { Outcome::Good });
            let expected = (k.saturating_sub(99)..=k).filter(|j| j % 3 == 0).count();
            assert_eq!(count as usize, expected, "{k}");
            assert_eq!(window.in_a_row(), u32::from(bad));
            let newest = (k.saturating_sub(49)..=k).filter(|j| j % 3 == 0).count();
            assert_eq!(window.count_newest(50) as usize, newest, "{k}");
        }
    }
}
