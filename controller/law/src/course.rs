//! Place of a run on its reference: the approach from where the rig was, then the reference, once or again and again.

use model::observation::{GOALS_AHEAD, Pair};

use crate::{SoftStart, TICK_S};

/// Continuation behind the last row of a reference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum AfterEnd {
    /// It is held.
    #[default]
    Hold,
    /// The first one, in the next tick: the reference begins again.
    Repeat,
}

/// Shortest reference that is repeated, in s: what it is followed with looks 0.8 s to either side.
pub const SHORTEST_REPEATED_S: f64 = 2.0;

/// A reference being flown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Course {
    approach: SoftStart,
    start_tick: u32,
    /// Ticks after which it begins again.
    period_ticks: Option<u32>,
}

impl Course {
    /// At rest on a reference that begins at 0 kPa; it is started before anything is flown.
    pub fn at_rest() -> Self {
        Course { approach: SoftStart::new([0.0; 2], [0.0; 2]), start_tick: 0, period_ticks: None }
    }

    /// A flight begins in this tick, from the pressures measured to `first_kpa`, where the reference begins; it ends at `end_s`.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn start(&mut self, tick: u32, measured_kpa: Pair, (first_kpa, end_s): (Pair, f64), after: AfterEnd) {
        self.start_tick = tick;
        self.approach = SoftStart::new(measured_kpa, first_kpa);
        let repeats = after == AfterEnd::Repeat && end_s >= SHORTEST_REPEATED_S;
        self.period_ticks = repeats.then(|| (end_s / TICK_S).round() as u32);
    }

    /// Ticks after which it begins again, where it does.
    pub fn period_ticks(&self) -> Option<u32> {
        self.period_ticks
    }

    /// Flights that were over before this tick; the first is number 0.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn flight(&self, tick: u32) -> u32 {
        self.period_ticks.map_or(0, |period| tick.wrapping_sub(self.start_tick) / period)
    }

    /// Time on the reference in this tick, in s.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn time_s(&self, tick: u32) -> f64 {
        let ticks = tick.wrapping_sub(self.start_tick);
        f64::from(self.period_ticks.map_or(ticks, |period| ticks % period)) * TICK_S
    }

    /// Goals of this tick and the next fifteen, in kPa gauge: the reference `at` each of them, and what is left of the approach.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn goals_kpa(&self, tick: u32, at: impl Fn(f64) -> Pair) -> [Pair; GOALS_AHEAD + 1] {
        let since_s = f64::from(tick.wrapping_sub(self.start_tick)) * TICK_S;
        std::array::from_fn(|j| {
            let time_s = since_s + j as f64 * TICK_S;
            let goal = match self.period_ticks {
                None => at(time_s),
                Some(_) => at(self.time_s(tick.wrapping_add(j as u32))),
            };
            let offset = self.approach.offset_kpa(time_s);
            std::array::from_fn(|c| goal[c] + offset[c])
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(time_s: f64) -> Pair {
        [80.0 + time_s.min(4.0), -70.0]
    }

    #[test]
    fn the_last_row_is_held_or_the_first_comes_again() {
        let mut course = Course::at_rest();
        for (after, then, flight) in [(AfterEnd::Hold, 84.0, 0), (AfterEnd::Repeat, 81.0, 2)] {
            course.start(7, [80.0, -70.0], (ramp(0.0), 4.0), after);
            let tick = 7 + 450;
            assert_eq!((course.goals_kpa(tick, ramp)[0][0], course.flight(tick)), (then, flight), "{after:?}");
        }
        // Just before the end the goals ahead are those of the next flight.
        let ahead = course.goals_kpa(7 + 199, ramp);
        assert!((ahead[0][0] - 83.98).abs() < 1e-9 && ahead[1][0] == 80.0 && (ahead[2][0] - 80.02).abs() < 1e-9);
    }

    #[test]
    fn the_approach_belongs_to_the_first_flight_alone() {
        let mut course = Course::at_rest();
        course.start(0, [0.0, 0.0], (ramp(0.0), 4.0), AfterEnd::Repeat);
        assert_eq!(course.goals_kpa(0, ramp)[0], [0.0, 0.0]);
        assert_eq!(course.goals_kpa(200, ramp)[0], [80.0, -70.0]);
    }

    #[test]
    fn what_is_too_short_is_held() {
        let mut course = Course::at_rest();
        course.start(0, [0.0, 0.0], ([80.0, -70.0], 0.0), AfterEnd::Repeat);
        assert_eq!((course.period_ticks(), course.flight(5_000)), (None, 0));
    }
}
