//! Ticks that were missed, as the daemon's own records tell.

use controller::session::pacing::{COMMAND_DEADLINE_NS, FRAME_GRACE_NS, PERIOD_NS};
use proto::recording::{Arrival, TickRecord};

use super::Late;

/// A tick that was missed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Miss {
    due_ns: u64,
    /// Time at which its frame was in hand or given up.
    taken_ns: u64,
    /// Time from then until its command had left.
    answered_ns: u64,
    /// Time by which it was later than it may be.
    over_ns: u64,
    pub(super) by: By,
}

/// Part of a missed tick that took its time, as far as its own record tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum By {
    /// The frame had not come when it was given up.
    FrameGivenUp,
    /// The frame came too late to be answered in time.
    FrameLate,
    /// The frame was there in time, and the answer took too long.
    Answer,
    /// There is no record of it: frames of several ticks came at once, the newest in time.
    Skipped,
}

impl Miss {
    /// The miss that a record tells of, where it does.
    fn of(tick: &TickRecord) -> Option<Self> {
        let given_up = tick.arrival == Arrival::Missing;
        if !tick.deadline_missed && !given_up {
            return None;
        }
        let (arrival_ns, answered_ns) = (tick.arrival_lateness_ns.max(0) as u64, u64::from(tick.compute_ns));
        // A frame that was given up was at least as late as its limit.
        let (since_due_ns, over_ns, by) = if given_up {
            (FRAME_GRACE_NS, FRAME_GRACE_NS, By::FrameGivenUp)
        } else {
            let by = if arrival_ns > answered_ns { By::FrameLate } else { By::Answer };
            (arrival_ns, (arrival_ns + answered_ns).saturating_sub(COMMAND_DEADLINE_NS), by)
        };
        let due_ns = tick.receive_ns.saturating_sub(since_due_ns);
        Some(Miss { due_ns, taken_ns: tick.receive_ns, answered_ns, over_ns, by })
    }

    /// The miss of ticks that have no record before this one, where there are any: their frames lay there for so long.
    fn before(tick: &TickRecord, skipped: u32) -> Option<Self> {
        let over_ns = (u64::from(skipped) * PERIOD_NS).checked_sub(COMMAND_DEADLINE_NS)?;
        let due_ns = tick.receive_ns.saturating_sub(u64::from(skipped) * PERIOD_NS);
        let (taken_ns, answered_ns) = (tick.receive_ns, u64::from(tick.compute_ns));
        Some(Miss { due_ns, taken_ns, answered_ns, over_ns, by: By::Skipped })
    }

    /// Tells whether something was as late as the tick exceeded its time, in the time of that tick.
    pub(super) fn is_excused_by(&self, late: &[Late]) -> bool {
        let (from, to) = (self.due_ns.saturating_sub(PERIOD_NS), self.due_ns + PERIOD_NS + self.over_ns);
        late.iter().any(|(due_ns, by_ns)| due_ns + by_ns >= from && *due_ns <= to && *by_ns >= self.over_ns)
    }

    /// One line about it, with what the cRIO says of its frame.
    pub(super) fn text(&self, ticks: &[(u64, u64)]) -> String {
        let ms = |ns: u64| ns as f64 * 1e-6;
        let newest = ticks.partition_point(|(_, ready_ns)| *ready_ns <= self.taken_ns).checked_sub(1);
        let held = newest.map_or("before any was ready".to_owned(), |at| {
            format!("{:.1} ms after the newest was ready", ms(self.taken_ns - ticks[at].1))
        });
        let what = if self.by == By::FrameGivenUp { "given up" } else { "in hand" };
        format!(
            "{:?}, over its time by {:.1} ms: its frame was {what} {held} and {:.1} ms after it was due; answered within {:.1} ms",
            self.by,
            ms(self.over_ns),
            ms(self.taken_ns.saturating_sub(self.due_ns)),
            ms(self.answered_ns)
        )
    }
}

/// Ticks as the daemon's recorder sees them.
#[derive(Debug, Default)]
pub struct Witness {
    pub(super) misses: Vec<Miss>,
    pub(super) ticks: u64,
    pub(super) controlled: u64,
    /// Session and number of the newest tick.
    newest: Option<(u32, u32)>,
}

impl Witness {
    /// Takes a tick in.
    pub fn see(&mut self, tick: &TickRecord) {
        self.ticks += 1;
        self.controlled += u64::from(tick.mode != 0);
        let before = self.newest.replace((tick.session, tick.tick)).filter(|(session, _)| *session == tick.session);
        let skipped = before.map_or(0, |(_, number)| tick.tick.saturating_sub(number).saturating_sub(1));
        self.misses.extend(Miss::before(tick, skipped));
        self.misses.extend(Miss::of(tick));
    }
}
