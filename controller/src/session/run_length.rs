//! Length of a run: seconds are seconds, whatever happens in them.
//!
//! A run that is to last `S` seconds ends `S` after it was first armed. What comes between (a fault, a lost link, standing
//! by with nobody to arm again, arming anew) neither stops that time nor begins it again. It passes twice: in ticks,
//! which in lockstep is the only time there is, and on the daemon's clock, so that a cRIO that falls silent or samples
//! slower than it should cannot make a run longer.

use crate::session::pacing::PERIOD_NS;

/// Ticks that a run that arms itself may need for it; from then on its time passes: 1 s.
const TICKS_TO_ARM: u64 = 50;
/// In real time a run may last this much longer than it should, on the daemon's clock, before it is ended there: the
/// ticks' own end is the exact one.
const CLOCK_SLACK_NS: u64 = 500_000_000;
/// In lockstep, where the clock says nothing, a cRIO that is silent for this long ends the run: 10 s.
const LOCKSTEP_SILENCE_NS: u64 = 10_000_000_000;

/// From when on the time of a run passes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Begins {
    /// Time at which the rig is first armed.
    WhenArmed,
    /// Time at which the rig is first armed, or a second after the first tick if it is not: for a run that arms itself.
    WhenArmedOrSoon,
}

/// Clock that ends a run beside its ticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RunClock {
    /// The daemon's: it passes as the ticks do.
    Realtime,
    /// None, but for a cRIO that is silent.
    Lockstep,
}

/// The time that a run has, and what has passed of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RunLength {
    limit: Option<Limit>,
    ticks: u64,
    begun: Option<Begun>,
    started_ns: Option<u64>,
    last_tick_ns: Option<u64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Limit {
    ticks: u64,
    begins: Begins,
    clock: RunClock,
}

impl Limit {
    /// Time on the clock after which a run that has begun is over whatever its ticks say (ns).
    fn clock_ns(&self) -> u64 {
        self.ticks.saturating_mul(PERIOD_NS).saturating_add(CLOCK_SLACK_NS)
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Begun {
    tick: u64,
    at_ns: u64,
}

impl RunLength {
    /// A run that ends when somebody ends it.
    pub const ENDLESS: RunLength =
        RunLength { limit: None, ticks: 0, begun: None, started_ns: None, last_tick_ns: None };

    /// A run of so many seconds, to the nearest tick.
    pub fn seconds(seconds: f64, begins: Begins, clock: RunClock) -> Self {
        let ticks = (seconds * 1e9 / PERIOD_NS as f64).round().max(1.0) as u64;
        RunLength { limit: Some(Limit { ticks, begins, clock }), ..Self::ENDLESS }
    }

    /// Says that the daemon looks for its cRIO from now on.
    pub fn started(&mut self, now_ns: u64) {
        self.started_ns = Some(now_ns);
    }

    /// Takes in a tick that was answered; `armed` says whether the rig was under control in it.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn tick(&mut self, armed: Armed, now_ns: u64) {
        self.ticks += 1;
        self.last_tick_ns = Some(now_ns);
        let Some(limit) = self.limit else { return };
        let soon = limit.begins == Begins::WhenArmedOrSoon && self.ticks > TICKS_TO_ARM;
        if self.begun.is_none() && (armed == Armed::Yes || soon) {
            self.begun = Some(Begun { tick: self.ticks, at_ns: now_ns });
        }
    }

    /// Tells whether the run's time is over.
    ///
    /// # Real-time
    /// Runs in the tick, and between sessions.
    pub fn is_over(&self, now_ns: u64) -> bool {
        let Some(limit) = self.limit else { return false };
        let since = |then: Option<u64>| then.map_or(0, |then| now_ns.saturating_sub(then));
        let by_clock = match (limit.clock, limit.begins, self.begun) {
            (RunClock::Lockstep, ..) => since(self.last_tick_ns.or(self.started_ns)) > LOCKSTEP_SILENCE_NS,
            (RunClock::Realtime, _, Some(begun)) => since(Some(begun.at_ns)) >= limit.clock_ns(),
            (RunClock::Realtime, Begins::WhenArmedOrSoon, None) => {
                since(self.started_ns) >= limit.clock_ns() + TICKS_TO_ARM * PERIOD_NS
            }
            (RunClock::Realtime, Begins::WhenArmed, None) => false,
        };
        self.has_all_ticks() || by_clock
    }

    /// Tells whether all ticks of the run have come.
    fn has_all_ticks(&self) -> bool {
        self.limit.zip(self.begun).is_some_and(|(limit, begun)| self.ticks - begun.tick >= limit.ticks)
    }

    /// End of a run that ends now.
    pub fn end(&self, now_ns: u64) -> RunEnd {
        let is_whole = match self.limit.map(|limit| limit.clock) {
            // A cRIO that has fallen silent ends the run as well, and not as a whole one.
            Some(RunClock::Lockstep) => self.has_all_ticks(),
            Some(RunClock::Realtime) | None => self.is_over(now_ns),
        };
        if is_whole { RunEnd::Whole } else { RunEnd::Before }
    }
}

/// End that a run came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RunEnd {
    /// Time was over: the run is whole, whatever is asked for from here on.
    Whole,
    /// Time was not over, or it had none.
    Before,
}

/// State of a tick for the length of a run: under control or not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Armed {
    /// Under control.
    Yes,
    /// Vents open.
    No,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ticks until the end, from the first; `armed` says for each whether the rig is under control.
    fn ends_after(mut length: RunLength, armed: impl Fn(u64) -> bool) -> Option<u64> {
        (0..10_000).find(|tick| {
            length.tick(if armed(*tick) { Armed::Yes } else { Armed::No }, tick * PERIOD_NS);
            length.is_over(tick * PERIOD_NS)
        })
    }

    #[test]
    fn two_seconds_are_two_seconds_whatever_happens() {
        let manual = || RunLength::seconds(2.0, Begins::WhenArmed, RunClock::Lockstep);
        assert_eq!(ends_after(manual(), |tick| tick >= 25), Some(125));
        assert_eq!(ends_after(manual(), |tick| tick == 25), Some(125), "vented after one tick");
        assert_eq!(ends_after(manual(), |tick| tick >= 25 && tick % 40 > 20), Some(125), "armed again and again");
        assert_eq!(ends_after(manual(), |_| false), None, "waits for its operator");
        let auto = RunLength::seconds(2.0, Begins::WhenArmedOrSoon, RunClock::Lockstep);
        assert_eq!(ends_after(auto, |_| false), Some(150), "cannot be armed");
        assert_eq!(ends_after(RunLength::ENDLESS, |_| true), None);
        assert_eq!(RunLength::ENDLESS.end(u64::MAX), RunEnd::Before, "who ends it is the end that it has");
    }

    #[test]
    fn the_clock_ends_what_ticks_do_not() {
        let second = 1_000_000_000;
        let mut slow = RunLength::seconds(2.0, Begins::WhenArmed, RunClock::Realtime);
        slow.tick(Armed::Yes, 0);
        assert!(!slow.is_over(2 * second));
        assert!(slow.is_over(2 * second + CLOCK_SLACK_NS), "one tick in two seconds");
        let mut gone = RunLength::seconds(2.0, Begins::WhenArmed, RunClock::Lockstep);
        gone.tick(Armed::No, 0);
        assert!(!gone.is_over(LOCKSTEP_SILENCE_NS) && gone.is_over(LOCKSTEP_SILENCE_NS + 1));
        assert_eq!(gone.end(LOCKSTEP_SILENCE_NS + 1), RunEnd::Before);
        let mut nobody = RunLength::seconds(2.0, Begins::WhenArmedOrSoon, RunClock::Realtime);
        nobody.started(second);
        assert!(!nobody.is_over(3 * second) && nobody.is_over(5 * second), "no cRIO at all");
    }
}
