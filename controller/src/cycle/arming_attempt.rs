//! Arming that is asked for tick by tick by what is steered for, and given up where something bars it.

use supervisor::Condition;

/// Frames for which arming may be barred before it is given up: half a second, as long as an operator's order to arm counts. What
/// bars it may go at any time later, when nobody stands by the rig any more.
const MOST_BARRED: u32 = 25;

/// Frames in which an arming that is asked for was barred.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ArmingAttempt {
    barred: u32,
}

impl ArmingAttempt {
    /// An attempt that nothing has barred yet.
    pub fn new() -> Self {
        ArmingAttempt::default()
    }

    /// Takes a frame in which arming is asked for, with what bars it, and answers what it is given up for.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn given_up(&mut self, bars_arming: Option<Condition>) -> Option<Condition> {
        let condition = bars_arming?;
        self.barred = self.barred.saturating_add(1);
        Some(condition).filter(|_| self.barred > MOST_BARRED)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn is_given_up_after_half_a_second_of_being_barred_also_in_pieces() {
        let bar = Some(Condition::NotRecorded);
        let frames = |bars: fn(u32) -> bool| {
            let mut attempt = ArmingAttempt::new();
            (1..1000).find(|k| attempt.given_up(bar.filter(|_| bars(*k))).is_some())
        };
        assert_eq!(frames(|_| true), Some(MOST_BARRED + 1));
        assert_eq!(frames(|k| k % 2 == 0), Some(2 * (MOST_BARRED + 1)), "what comes and goes bars it as well");
        assert_eq!(frames(|_| false), None);
    }
}
