//! When the next sample edge comes: an absolute 20 ms grid, or at once.

use std::time::{Duration, Instant};

use crate::wire::TICK_NS;

/// One tick.
pub(super) const TICK: Duration = Duration::from_nanos(TICK_NS);

/// Pace of plant time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// On an absolute 20 ms grid.
    RealTime,
    /// As fast as the answers come.
    Lockstep {
        /// Longest wait for an answer; then the tick counts as one without a command.
        wait: Duration,
    },
}

impl Pace {
    /// Lockstep with a wait of two seconds, which no daemon that lives needs.
    pub const LOCKSTEP: Self = Self::Lockstep { wait: Duration::from_secs(2) };
}

/// The absolute grid of real time: edge n stands at start + n × 20 ms.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    next: Instant,
}

impl Grid {
    /// A grid whose first edge is now.
    pub(super) const fn starting(now: Instant) -> Self {
        Self { next: now }
    }

    /// When the next edge is due.
    pub(super) const fn next(&self) -> Instant {
        self.next
    }

    /// Goes on to the edge after this one; says how many whole ticks were stalled and left out.
    ///
    /// A late edge leaves the grid where it is. Edges that would already be in the past when this one
    /// is done are left out rather than made up for in a burst, which no daemon could answer in time.
    pub(super) fn advance(&mut self, now: Instant) -> u32 {
        let late = now.saturating_duration_since(self.next);
        let stalled = u32::try_from(late.as_nanos() / TICK.as_nanos()).unwrap_or(u32::MAX);
        self.next += TICK * stalled.saturating_add(1);
        stalled
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn late_edges_do_not_make_the_grid_drift() {
        let start = Instant::now();
        let mut grid = Grid::starting(start);
        for edge in 0..1000_u32 {
            assert_eq!(grid.next(), start + TICK * edge);
            // Each edge late by another part of the tick.
            let late = Duration::from_micros(u64::from(edge * 7919 % 20_000));
            assert_eq!(grid.advance(grid.next() + late), 0);
        }
    }

    #[test]
    fn a_stall_leaves_whole_ticks_out_and_keeps_the_phase() {
        let start = Instant::now();
        let mut grid = Grid::starting(start);
        assert_eq!(grid.advance(start + Duration::from_millis(105)), 5);
        assert_eq!(grid.next(), start + TICK * 6);
    }
}
