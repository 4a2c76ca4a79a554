//! Kinds of ticks, by the reference alone: errors are only compared with errors of the same kind.

use law::ControlInput;
use model::observation::{CHANNELS, Pair, TICKS_PER_S};

/// Kinds of ticks.
pub const KINDS: usize = 4;
/// The reference rests.
const REST: usize = 0;
/// It moves.
const MOTION: usize = 1;
/// It has jumped, or will within what a law looks ahead: whoever controls, duties move as fast as they may before the jump, and the
/// pressure is far off for a while behind it.
pub const JUMPED: usize = 2;
/// It has turned round, set out or stopped at once: whoever controls, valves must first cross their backlash.
pub const KINKED: usize = 3;
/// References that move more slowly than this rest, in kPa/s: below it no valve turns round in a second.
const REST_KPA_PER_S: Pair = [0.5, 0.25];
/// References that move further than this in a tick jump, in kPa: ten times what the pump can follow.
const JUMP_KPA: Pair = [2.0, 1.0];
/// Rates that change by more than this from tick to tick are a kink, in kPa/s: two fifths of the steepest the paper's reference goes. On
/// `bench` the fallback leaves 0.5 kPa in the ten seconds around its turning round, and 0.1 to 0.2 in others.
const KINK_KPA_PER_S: Pair = [2.0, 1.0];
/// Ticks for which a jump or a kink is felt. Measured: 20 kPa down, the positive pressure is within its noise after 4 s where the valve lags; before,
/// its errors are of the jump and say nothing of who controls.
const FELT_TICKS: u32 = 200;

/// Tells kinds of ticks apart, each channel by itself.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Conditions {
    since_jump: [Option<u32>; CHANNELS],
    since_kink: [Option<u32>; CHANNELS],
}

impl Conditions {
    /// The kind of this tick for each channel: 0 rest, 1 motion, 2 around a jump, 3 after a kink.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn kinds(&mut self, input: &ControlInput) -> [usize; CHANNELS] {
        let [now, next, later, ..] = input.goals_kpa;
        std::array::from_fn(|c| {
            let (move_kpa, next_move_kpa) = (next[c] - now[c], later[c] - next[c]);
            // On `bench` the fallback sets out five ticks before a jump.
            let moves_kpa =
                input.goals_kpa.iter().zip(input.goals_kpa.iter().skip(1)).map(|(from, to)| to[c] - from[c]);
            let largest_kpa = moves_kpa.fold(0.0, |largest: f64, kpa| largest.max(kpa.abs()));
            let has_jumped = felt(&mut self.since_jump[c], largest_kpa, JUMP_KPA[c]);
            let has_kinked = felt(&mut self.since_kink[c], (next_move_kpa - move_kpa) * TICKS_PER_S, KINK_KPA_PER_S[c]);
            match (has_jumped, has_kinked) {
                (true, _) => JUMPED,
                (false, true) => KINKED,
                _ if move_kpa.abs() * TICKS_PER_S > REST_KPA_PER_S[c] => MOTION,
                _ => REST,
            }
        })
    }
}

/// Counts ticks since a size was beyond its limit; tells whether that is still felt.
fn felt(since: &mut Option<u32>, size: f64, limit: f64) -> bool {
    *since = if size.abs() > limit { Some(0) } else { since.map(|ticks| ticks.saturating_add(1)) };
    since.is_some_and(|ticks| ticks < FELT_TICKS)
}

#[cfg(test)]
mod tests {
    use model::observation::GOALS_AHEAD;

    use super::*;

    #[test]
    fn a_reference_that_turns_round_is_a_kind_of_its_own() {
        let mut conditions = Conditions::default();
        // A triangle of 5 kPa/s that turns round at tick 100.
        let goal = |tick: i32| 80.0 + 0.1 * f64::from(100 - (tick - 100).abs());
        let mut kind = |tick: i32| {
            let goals_kpa = std::array::from_fn(|ahead| [goal(tick + ahead as i32), -70.0]);
            conditions.kinds(&ControlInput::of_measured([0.0; 2], goals_kpa))[0]
        };
        let kinds: Vec<usize> = (0..400).map(&mut kind).collect();
        assert!(kinds[..98].iter().all(|kind| *kind == MOTION), "{kinds:?}");
        assert!(kinds[100..298].iter().all(|kind| *kind == KINKED), "{kinds:?}");
        assert!(kinds[301..].iter().all(|kind| *kind == MOTION), "{kinds:?}");
    }

    /// A step of 13 kPa at tick 100: from the tick on at which it is the last of the goals.
    #[test]
    fn a_jump_counts_from_where_a_law_sees_it() {
        let mut conditions = Conditions::default();
        let goal = |tick: usize| if tick < 100 { 85.0 } else { 98.0 };
        let kinds: Vec<usize> = (0..400)
            .map(|tick| {
                let goals_kpa = std::array::from_fn(|ahead| [goal(tick + ahead), -70.0]);
                conditions.kinds(&ControlInput::of_measured([0.0; 2], goals_kpa))[0]
            })
            .collect();
        let begins = 100 - GOALS_AHEAD;
        assert!(kinds[..begins].iter().all(|kind| *kind == REST), "{kinds:?}");
        assert!(kinds[begins..99 + FELT_TICKS as usize].iter().all(|kind| *kind == JUMPED), "{kinds:?}");
        assert!(kinds[101 + FELT_TICKS as usize..].iter().all(|kind| *kind == REST), "{kinds:?}");
    }

    #[test]
    fn rest_motion_and_jumps_are_told_apart() {
        let mut conditions = Conditions::default();
        let mut kinds = |now: f64, next: f64| {
            // On at the same rate.
            let goals_kpa = std::array::from_fn(|ahead| [now + ahead as f64 * (next - now), -70.0]);
            conditions.kinds(&ControlInput::of_measured([0.0; 2], goals_kpa))
        };
        assert_eq!(kinds(80.0, 80.0), [0, 0]);
        assert_eq!(kinds(80.0, 80.02), [1, 0]);
        assert_eq!(kinds(80.0, 85.0), [2, 0]);
        for _ in 1..FELT_TICKS {
            assert_eq!(kinds(85.0, 85.0), [2, 0]);
        }
        assert_eq!(kinds(85.0, 85.0), [0, 0]);
    }
}
