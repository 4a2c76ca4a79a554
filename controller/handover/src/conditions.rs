//! What kind of tick it is, by the reference alone: errors are only compared with errors of the same kind.

use law::ControlInput;
use model::observation::{CHANNELS, Pair, TICKS_PER_S};

/// Kinds of ticks.
pub const KINDS: usize = 3;
/// References that move more slowly than this rest, in kPa/s: below it no valve turns round in a second.
const REST_KPA_PER_S: Pair = [0.5, 0.25];
/// References that move further than this in a tick jump, in kPa: ten times what the pump can follow.
const JUMP_KPA: Pair = [2.0, 1.0];
/// Ticks for which a jump is felt. Measured: 20 kPa down, the positive pressure is within its noise after 4 s where the valve lags; before,
/// its errors are of the jump and say nothing of who controls.
const FELT_TICKS: u32 = 200;

/// Tells kinds of ticks apart, each channel by itself.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Conditions {
    since_jump: [Option<u32>; CHANNELS],
}

impl Conditions {
    /// The kind of this tick for each channel: 0 rest, 1 motion, 2 after a jump.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn kinds(&mut self, input: &ControlInput) -> [usize; CHANNELS] {
        let (now, next) = (input.goals_kpa[0], input.goals_kpa[1]);
        std::array::from_fn(|c| {
            let move_kpa = (next[c] - now[c]).abs();
            let since = &mut self.since_jump[c];
            *since = if move_kpa > JUMP_KPA[c] { Some(0) } else { since.map(|s| s.saturating_add(1)) };
            match since {
                Some(ticks) if *ticks < FELT_TICKS => 2,
                _ => usize::from(move_kpa * TICKS_PER_S > REST_KPA_PER_S[c]),
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::observation::GOALS_AHEAD;

    #[test]
    fn rest_motion_and_jumps_are_told_apart() {
        let mut conditions = Conditions::default();
        let mut kinds = |now: f64, next: f64| {
            let mut goals_kpa = [[next, -70.0]; GOALS_AHEAD + 1];
            goals_kpa[0] = [now, -70.0];
            conditions.kinds(&ControlInput::of_measured([0.0; 2], goals_kpa))
        };
        assert_eq!(kinds(80.0, 80.0), [0, 0]);
        assert_eq!(kinds(80.0, 80.1), [1, 0]);
        assert_eq!(kinds(80.0, 85.0), [2, 0]);
        for _ in 1..FELT_TICKS {
            assert_eq!(kinds(85.0, 85.0), [2, 0]);
        }
        assert_eq!(kinds(85.0, 85.0), [0, 0]);
    }
}
