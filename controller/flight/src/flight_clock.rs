//! Seconds of flight: from session, tick and arrival to one time axis.
//!
//! Within a session the cRIO's tick counts, 20 ms each, because the cRIO is the master of time and
//! arrival carries the network's jitter. From one session to the next, and while there is none
//! (session 0), the daemon's monotonic clock counts, in whole ticks and at least one. In lockstep that
//! clock says nothing about the plant's time: there it is one tick. A record that repeats a tick, or
//! goes back within a session, stands at the time of the one before it.

use proto::recording::TickRecord;

use crate::statistics::Pacing;

/// Ticks per second.
pub const RATE_HZ: f64 = 50.0;
/// Nanoseconds per tick.
pub const PERIOD_NS: u64 = 20_000_000;

/// Place where a record stands on the flight's time axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// Ticks of 20 ms since the first record.
    pub tick: u64,
    /// Seconds since the first record.
    pub time_s: f64,
    /// Ticks since the record before: 1 in a whole recording, more where some are missing, 0 for the
    /// first record and for a repeated one.
    pub step: u64,
    /// The first record of a session, or of a time without one.
    pub new_session: bool,
}

/// Puts records on one time axis, one after another.
#[derive(Debug, Clone)]
pub struct FlightClock {
    pacing: Pacing,
    before: Option<Before>,
}

#[derive(Debug, Clone, Copy)]
struct Before {
    session: u32,
    tick: u32,
    receive_ns: u64,
    at: u64,
}

impl FlightClock {
    /// A clock that stands before the first record.
    pub fn new(pacing: Pacing) -> Self {
        Self { pacing, before: None }
    }

    /// The place of the next record.
    ///
    /// # Real-time
    /// May run in the tick: a few comparisons.
    pub fn next(&mut self, record: &TickRecord) -> Moment {
        let (at, new_session) = match self.before {
            None => (0, true),
            Some(before) if before.session == record.session && record.session != 0 => {
                (before.at + u64::from(record.tick.saturating_sub(before.tick)), false)
            }
            Some(before) => {
                let pause_ns = match self.pacing {
                    Pacing::Realtime => record.receive_ns.saturating_sub(before.receive_ns),
                    Pacing::Lockstep => 0,
                };
                let pause = pause_ns.saturating_add(PERIOD_NS / 2) / PERIOD_NS;
                (before.at + pause.max(1), before.session != record.session)
            }
        };
        let step = self.before.map_or(0, |before| at - before.at);
        // A record that goes back leaves the clock where it is, so that the next one is not counted twice.
        let tick = match self.before {
            Some(before) if !new_session => before.tick.max(record.tick),
            _ => record.tick,
        };
        self.before = Some(Before { session: record.session, tick, receive_ns: record.receive_ns, at });
        // Divided and not multiplied by 0.02: rounds once.
        Moment { tick: at, time_s: at as f64 / RATE_HZ, step, new_session }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times(pacing: Pacing, records: &[(u32, u32, u64)]) -> Vec<f64> {
        let mut clock = FlightClock::new(pacing);
        let record = |(session, tick, ms): &(u32, u32, u64)| TickRecord {
            session: *session,
            tick: *tick,
            receive_ns: ms * 1_000_000,
            ..TickRecord::default()
        };
        records.iter().map(|entry| clock.next(&record(entry)).time_s).collect()
    }

    #[test]
    fn ticks_count_within_a_session_whatever_the_arrival() {
        assert_eq!(
            times(Pacing::Realtime, &[(9, 100, 0), (9, 101, 33), (9, 102, 40), (9, 105, 41)]),
            [0.0, 0.02, 0.04, 0.1]
        );
    }

    #[test]
    fn a_repeated_or_older_tick_stands_still_and_the_next_goes_on() {
        assert_eq!(times(Pacing::Realtime, &[(9, 7, 0), (9, 7, 5), (9, 6, 9), (9, 8, 20)]), [0.0, 0.0, 0.0, 0.02]);
    }

    #[test]
    fn between_sessions_and_without_one_the_daemons_clock_counts() {
        // 1 s without a connection, then a session, then one that begins within the same tick.
        let records = [(3, 10, 0), (0, 0, 520), (0, 0, 1_020), (4, 0, 1_031), (4, 1, 1_050), (5, 0, 1_050)];
        assert_eq!(times(Pacing::Realtime, &records), [0.0, 0.52, 1.02, 1.04, 1.06, 1.08]);
        assert_eq!(times(Pacing::Lockstep, &records), [0.0, 0.02, 0.04, 0.06, 0.08, 0.1]);
    }

    #[test]
    fn steps_tell_what_is_missing() {
        let mut clock = FlightClock::new(Pacing::Realtime);
        let step = |clock: &mut FlightClock, session, tick| {
            let moment = clock.next(&TickRecord { session, tick, ..TickRecord::default() });
            (moment.step, moment.new_session)
        };
        assert_eq!(step(&mut clock, 1, 0), (0, true));
        assert_eq!(step(&mut clock, 1, 1), (1, false));
        assert_eq!(step(&mut clock, 1, 4), (3, false));
        assert_eq!(step(&mut clock, 2, 0), (1, true));
    }
}
