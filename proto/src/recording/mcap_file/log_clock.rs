//! Log times: from the daemon's monotonic clock to nanoseconds since 1970.
//!
//! In real time a tick stands at the wall clock of its arrival. In lockstep, where a minute of plant
//! time may pass in a second, it stands at the start plus 20 ms per tick, so that a viewer shows the
//! plant's time.

use super::recording_info::{LogTime, RecordingInfo};
use super::tick::TickRecord;
use super::wall_clock;

/// From the daemon's clock to the wall clock.
#[derive(Debug)]
pub(crate) struct LogClock {
    rule: LogTime,
    started_unix_ns: u64,
    started_ns: u64,
    // For `LogTime::Tick`: session, its first tick, log time of that tick; and the last log time.
    session: Option<(u32, u32, u64)>,
    last: u64,
}

impl LogClock {
    const PERIOD_NS: u64 = 20_000_000;

    pub(crate) fn new(info: &RecordingInfo) -> Self {
        let started_unix_ns = wall_clock::unix_ns(info.started);
        Self { rule: info.log_time, started_unix_ns, started_ns: info.started_ns, session: None, last: started_unix_ns }
    }

    /// Log time of a tick (ns since 1970).
    pub(crate) fn at(&mut self, tick: &TickRecord) -> u64 {
        self.last = match self.rule {
            LogTime::Arrival => self.arrival(tick.receive_ns),
            LogTime::Tick => {
                let (first, base) = match self.session {
                    Some((session, first, base)) if session == tick.session => (first, base),
                    Some(_) => (tick.tick, self.last + Self::PERIOD_NS),
                    None => (tick.tick, self.started_unix_ns),
                };
                self.session = Some((tick.session, first, base));
                base + u64::from(tick.tick.saturating_sub(first)) * Self::PERIOD_NS
            }
        };
        self.last
    }

    /// Log time of a moment of the daemon's clock (ns since 1970).
    pub(crate) fn moment(&self, at_ns: u64) -> u64 {
        match self.rule {
            LogTime::Arrival => self.arrival(at_ns),
            LogTime::Tick => self.last,
        }
    }

    fn arrival(&self, at_ns: u64) -> u64 {
        // A moment before the start is possible: the queue already held a tick.
        let before = self.started_ns.saturating_sub(at_ns);
        let after = at_ns.saturating_sub(self.started_ns);
        self.started_unix_ns.saturating_add(after).saturating_sub(before)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::{Duration, UNIX_EPOCH};

    const START: u64 = 1_000_000_000_000;

    fn clock(rule: LogTime) -> LogClock {
        let mut info = RecordingInfo::new("test", 500);
        info.started = UNIX_EPOCH + Duration::from_nanos(START);
        info.log_time = rule;
        LogClock::new(&info)
    }

    fn tick(session: u32, tick: u32, receive_ns: u64) -> TickRecord {
        TickRecord { session, tick, receive_ns, ..TickRecord::default() }
    }

    #[test]
    fn arrival_times_stand_on_the_wall_clock_before_and_after_the_start() {
        let mut clock = clock(LogTime::Arrival);
        assert_eq!(clock.at(&tick(1, 0, 500)), START);
        assert_eq!(clock.at(&tick(1, 1, 20_000_700)), START + 20_000_200);
        assert_eq!(clock.moment(100), START - 400);
        assert_eq!(clock.at(&tick(1, 2, u64::MAX)), u64::MAX);
    }

    #[test]
    fn lockstep_times_count_ticks_and_go_on_after_a_new_session() {
        let mut clock = clock(LogTime::Tick);
        assert_eq!(clock.moment(9_999), START);
        assert_eq!(clock.at(&tick(1, 7, 0)), START);
        assert_eq!(clock.at(&tick(1, 9, 3)), START + 40_000_000);
        assert_eq!(clock.at(&tick(2, 0, 4)), START + 60_000_000);
        assert_eq!(clock.at(&tick(2, 1, 5)), START + 80_000_000);
        assert_eq!(clock.moment(9_999), START + 80_000_000);
    }
}
