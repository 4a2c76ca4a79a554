//! Time of the rig that an adaptation takes: its ticks, less those that pass while this machine computes.
//!
//! While a diagnosis or a training computes, nothing of the rig is used: it stands still in a rehearsal, and goes on as it was
//! otherwise. While the daemon examines a model or a policy it goes on as well; in real time that is fifty ticks a second, in
//! lockstep as many as this machine can play meanwhile, which no rig would have had.

use std::time::{Duration, Instant};

use model::observation::TICKS_PER_S;

use crate::AdaptError;
use crate::programs::Console;
use crate::run::Adaptation;

/// Length of a tick, in s.
pub(crate) const TICK_S: f64 = 1.0 / TICKS_PER_S;
/// Ticks in a minute of the rig.
pub(crate) const TICKS_PER_MIN: f64 = 60.0 * TICKS_PER_S;

/// Pacing of the daemon's ticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pacing {
    /// The clock: fifty a second.
    RealTime,
    /// The rig, which goes as fast as this machine can.
    Lockstep,
}

/// A moment: session and tick, and what the wall's clock said.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Moment {
    at: (u32, u32),
    wall: Instant,
}

impl Moment {
    /// Ticks and time from here until another moment; no ticks where a session ended on the way.
    fn until(&self, later: &Moment) -> (u64, Duration) {
        let ticks = if later.at.0 == self.at.0 { u64::from(later.at.1.wrapping_sub(self.at.1)) } else { 0 };
        (ticks, later.wall - self.wall)
    }
}

impl Adaptation {
    /// Now.
    pub(crate) fn moment(&self, console: &mut dyn Console) -> Result<Moment, AdaptError> {
        Ok(Moment { at: self.daemon.status(console)?.at, wall: Instant::now() })
    }

    /// Minutes of the rig that were used so far; nothing where the daemon has begun another session since.
    pub(crate) fn rig_minutes(&self, console: &mut dyn Console) -> Result<Option<f64>, AdaptError> {
        let now = self.daemon.status(console)?.at;
        let ticks = self.journal.before.as_ref().filter(|before| before.at.0 == now.0);
        Ok(ticks.and_then(|before| self.journal.rig_minutes(u64::from(now.1.wrapping_sub(before.at.1)))))
    }

    /// Does what this machine's processors are needed for, while a rig that can stands still.
    pub(crate) fn computed<T>(
        &mut self,
        work: impl FnOnce(&Self, &mut dyn Console) -> Result<T, AdaptError>,
        console: &mut dyn Console,
    ) -> Result<T, AdaptError> {
        let before = self.moment(console)?;
        self.rig.pause();
        let done = work(self, console);
        self.rig.go_on();
        let after = match self.moment(console) {
            Ok(after) => after,
            // What went wrong in the work says more than that the daemon has gone meanwhile.
            Err(gone) => return done.and(Err(gone)),
        };
        let (ticks, wall) = before.until(&after);
        self.journal.unused_ticks += ticks;
        self.journal.computed_s += wall.as_secs_f64();
        done
    }

    /// Counts what passed since `before`, while the daemon examined something, as a rig in real time would have it.
    pub(crate) fn examined_since(&mut self, before: &Moment, console: &mut dyn Console) -> Result<(), AdaptError> {
        if self.folders.pacing == Pacing::Lockstep {
            let (ticks, wall) = before.until(&self.moment(console)?);
            self.journal.unused_ticks += beyond_real_time(ticks, wall);
        }
        Ok(())
    }
}

/// Ticks beyond those that real time has.
fn beyond_real_time(ticks: u64, wall: Duration) -> u64 {
    ticks.saturating_sub((wall.as_secs_f64() * TICKS_PER_S) as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_beyond_real_time_are_not_the_rigs() {
        assert_eq!(beyond_real_time(4000, Duration::from_secs(10)), 3500);
        assert_eq!(beyond_real_time(480, Duration::from_secs(10)), 0, "a late tick is no time that was saved");
    }

    #[test]
    fn a_session_that_ended_counts_nothing() {
        let wall = Instant::now();
        let begun = Moment { at: (7, u32::MAX - 9), wall };
        let later = |at| begun.until(&Moment { at, wall: wall + Duration::from_secs(1) }).0;
        assert_eq!((later((7, 40)), later((8, 40))), (50, 0));
    }
}
