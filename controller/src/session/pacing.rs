//! Time at which the next frame is due.
//!
//! The cRIO is the master of time: the grid follows its frames. Each arrival pulls the grid by at most
//! 0.1 ms, so that one late frame does not shift what counts as late; an arrival far off starts the
//! grid anew. A frame that has not come [`FRAME_GRACE_NS`] after it was due is missing; a command that
//! leaves later than [`COMMAND_DEADLINE_NS`] after its frame was due missed its deadline.

/// Period of the ticks, 20 ms.
pub const PERIOD_NS: u64 = 20_000_000;
/// Time that a frame may be overdue before the tick runs without it: 6 ms.
pub const FRAME_GRACE_NS: u64 = 6_000_000;
/// Time after its frame was due by which the command must be out: 14 ms.
pub const COMMAND_DEADLINE_NS: u64 = 14_000_000;
/// Distance by which one arrival may move the grid: 0.1 ms.
const SLEW_NS: i64 = 100_000;
/// Distance off the grid at which an arrival starts it anew: a quarter of a period.
const LOST_NS: i64 = 5_000_000;

/// The grid of expected arrivals.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Grid {
    due_ns: u64,
    /// Arrivals in a row that were far off.
    off: u32,
}

impl Grid {
    /// A grid whose first frame is due now.
    pub fn new(now_ns: u64) -> Self {
        Grid { due_ns: now_ns, off: 0 }
    }

    /// Time at which the next frame is due.
    pub fn due_ns(&self) -> u64 {
        self.due_ns
    }

    /// Time at which a tick without a frame must begin.
    pub fn give_up_ns(&self) -> u64 {
        self.due_ns + FRAME_GRACE_NS
    }

    /// A frame came; answers how late it was in ns (negative: early) and moves on to the next.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn arrived(&mut self, now_ns: u64) -> i64 {
        let early = now_ns as i64 - self.due_ns as i64;
        // The frame that was given up comes after all: the next one is due already, and stays so.
        let was_given_up = early < -(PERIOD_NS as i64) / 2;
        let late = if was_given_up { early + PERIOD_NS as i64 } else { early };
        self.off = if late.abs() > LOST_NS { self.off + 1 } else { 0 };
        // Several in a row, not one: after a stall of this machine frames come in a burst. Those that were given up count as well: a cRIO
        // whose phase has moved by 6 to 10 ms sends nothing else.
        if self.off >= 3 {
            self.off = 0;
            self.due_ns = now_ns + PERIOD_NS;
        } else if !was_given_up {
            self.due_ns = self.due_ns.saturating_add_signed(late.clamp(-SLEW_NS, SLEW_NS)) + PERIOD_NS;
        }
        late
    }

    /// No frame came: on to the next.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn missed(&mut self, now_ns: u64) {
        self.due_ns += PERIOD_NS;
        // After a stall of this machine the grid does not catch up tick by tick.
        while self.due_ns + PERIOD_NS < now_ns {
            self.due_ns += PERIOD_NS;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn follows_a_slow_clock_without_misses() {
        // 500 ppm: 10 µs a tick, well below what an arrival may move the grid.
        let mut grid = Grid::new(0);
        for k in 0..10_000u64 {
            let late = grid.arrived(k * (PERIOD_NS + 10_000));
            assert!(late.unsigned_abs() < 1_000_000, "tick {k}: {late} ns");
        }
    }

    #[test]
    fn one_late_frame_moves_the_grid_by_the_slew_only() {
        let mut grid = Grid::new(0);
        grid.arrived(0);
        assert_eq!(grid.arrived(PERIOD_NS + 4_000_000), 4_000_000);
        assert_eq!(grid.due_ns(), 2 * PERIOD_NS + 100_000);
    }

    #[test]
    fn a_frame_that_comes_after_it_was_given_up_does_not_shift_the_next() {
        let mut grid = Grid::new(0);
        grid.arrived(0);
        grid.missed(grid.give_up_ns());
        assert_eq!(grid.arrived(PERIOD_NS + 8_000_000), 8_000_000);
        assert_eq!(grid.due_ns(), 2 * PERIOD_NS);
    }

    /// Whatever the phase moves to, the grid is with it again after a few frames: none is given up from then on.
    #[test]
    fn a_phase_that_has_moved_is_found_wherever_it_is() {
        for moved_ns in (0..PERIOD_NS).step_by(250_000) {
            let mut grid = Grid::new(0);
            let mut given_up = Vec::new();
            for k in 0..250_u64 {
                let at_ns = k * PERIOD_NS + moved_ns;
                while grid.give_up_ns() < at_ns {
                    grid.missed(grid.give_up_ns());
                    given_up.push(k);
                }
                grid.arrived(at_ns);
            }
            assert!(given_up.len() <= 4 && given_up.iter().all(|k| *k <= 4), "{moved_ns} ns: {given_up:?}");
        }
    }

    #[test]
    fn a_stall_is_not_caught_up_and_a_new_phase_is_found() {
        let mut grid = Grid::new(0);
        grid.missed(10 * PERIOD_NS);
        assert!(grid.due_ns() + PERIOD_NS >= 10 * PERIOD_NS);
        let mut grid = Grid::new(0);
        let shifted: Vec<i64> = (0..5).map(|k| grid.arrived(k * PERIOD_NS + 9_000_000)).collect();
        assert!(shifted[0] > 8_000_000 && shifted[4].abs() < 1_000_000, "{shifted:?}");
    }
}
