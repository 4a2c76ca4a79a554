//! Sequence number, clock, tick number and sample rate of the frames: which of them count.
//!
//! Ticks are the daemon's time: the reference goes by them. So a tick number is believed only where it agrees with time
//! that really passed: by the cRIO's clock, and in real time by the daemon's own as well. A frame that is rejected is
//! no frame. Three in a row that agree among themselves are a new numbering, which is then taken up; by that time
//! missing frames have vented the rig.

use proto::wire::{Sense, TICK_NS, is_newer};
use supervisor::Condition;

/// Ticks by which a frame's number may run ahead of the cRIO's clock since the frame before (chosen: one frame sent late
/// and the next in time make one).
const AHEAD_OF_CLOCK_TICKS: i64 = 2;
/// Time by which tick numbers may run ahead of the daemon's own clock, in ns: 100 ms (chosen: above the stall that can have
/// delayed the first frame, below what moves a reference visibly).
const AHEAD_OF_ARRIVAL_NS: i64 = 100_000_000;
/// Speed at which the origin of [`AHEAD_OF_ARRIVAL_NS`] follows, in ns per tick: 1 %, above any clock's error (chosen).
const FOLLOW_NS: i64 = 200_000;
/// Frames at the start of a session of which the earliest, against its tick, tells where the ticks stand: one that comes after a stall
/// of either side tells nothing. Chosen: a stall of 0.2 s is over by then.
const ORIGIN_FRAMES: u32 = 10;
/// Rejected frames in a row, agreeing among themselves, that make a new numbering (chosen).
const REJECTED_TO_RENUMBER: u32 = 3;
/// A period by the cRIO's clock counts as 20 ms within this, in ns: 10 % (chosen: above the scatter of a clock read in a thread).
const PERIOD_TOLERANCE_NS: u64 = 2_000_000;
/// Frames over which the sample rate is judged, and how many of them may have another period.
const RATE_FRAMES: u32 = 50;
const RATE_WRONG: u32 = 25;

/// Meaning of arrivals for the time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pacing {
    /// They tell it: the cRIO sends 50 frames a second.
    RealTime,
    /// They do not tell it: the cRIO waits for every answer.
    Lockstep,
}

/// Reason why a frame does not count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Rejection {
    /// It is the same frame, or an older one, again.
    Stale {
        /// Sequence number.
        sequence: u32,
    },
    /// The sequence number goes on, the tick does not.
    TickStands {
        /// Tick.
        tick: u32,
    },
    /// The clock does not go on.
    ClockStands {
        /// Clock, ns.
        clock_ns: u64,
    },
    /// The tick is this many ticks ahead of the time that has passed.
    TickJumped {
        /// Ticks ahead.
        ahead: i64,
    },
}

impl Rejection {
    /// The number that a person is told.
    pub fn value(self) -> f64 {
        match self {
            Rejection::Stale { sequence } => f64::from(sequence),
            Rejection::TickStands { tick } => f64::from(tick),
            Rejection::ClockStands { clock_ns } => clock_ns as f64 * 1e-9,
            Rejection::TickJumped { ahead } => ahead as f64,
        }
    }
}

#[derive(Debug, Clone, Copy)]
struct Last {
    sequence: u32,
    clock_ns: u64,
    tick: u32,
}

impl Last {
    fn of(sense: &Sense) -> Self {
        Last { sequence: sense.sequence, clock_ns: sense.clock_ns, tick: sense.tick }
    }
}

/// Judges the frames of one session.
#[derive(Debug, Clone, Copy)]
pub struct FrameGate {
    pacing: Pacing,
    last: Option<Last>,
    /// Newest rejected frame, and how many in a row agreed with each other.
    rejected: Option<(Last, u32)>,
    /// Arrival minus tick × 20 ms, ns: where the ticks stand against the daemon's clock.
    origin_ns: Option<i64>,
    /// Frames that counted since the origin was begun.
    since_origin: u32,
    ahead_ns: i64,
    wrong_periods: u64,
    periods: u32,
    /// Period of the last frame, ns, by the cRIO's clock.
    period_ns: u64,
}

impl FrameGate {
    /// A gate at the start of a session.
    pub fn new(pacing: Pacing) -> Self {
        FrameGate {
            pacing,
            last: None,
            rejected: None,
            origin_ns: None,
            since_origin: 0,
            ahead_ns: 0,
            wrong_periods: 0,
            periods: 0,
            period_ns: TICK_NS,
        }
    }

    /// Judges a frame of this session that arrived at `at_ns` of the daemon's monotonic clock.
    ///
    /// # Errors
    /// Why it does not count.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn judge(&mut self, sense: &Sense, at_ns: u64) -> Result<(), Rejection> {
        let Some(last) = self.last else {
            self.accept(sense, at_ns);
            return Ok(());
        };
        let rejection = if !is_newer(sense.sequence, last.sequence) {
            // A repeated frame says nothing new, not even that something is wrong with the numbering.
            return Err(Rejection::Stale { sequence: sense.sequence });
        } else if !(1..u32::MAX / 2).contains(&sense.tick.wrapping_sub(last.tick)) {
            Rejection::TickStands { tick: sense.tick }
        } else if sense.clock_ns <= last.clock_ns {
            Rejection::ClockStands { clock_ns: sense.clock_ns }
        } else {
            let ticks = i64::from(sense.tick.wrapping_sub(last.tick));
            let by_clock = ticks - ((sense.clock_ns - last.clock_ns) as f64 / TICK_NS as f64).round() as i64;
            let by_arrival = self.ahead_of_arrival(sense, at_ns);
            if by_clock > AHEAD_OF_CLOCK_TICKS {
                Rejection::TickJumped { ahead: by_clock }
            } else if by_arrival > 5 * AHEAD_OF_ARRIVAL_NS {
                Rejection::TickJumped { ahead: by_arrival / TICK_NS as i64 }
            } else {
                self.rejected = None;
                self.accept(sense, at_ns);
                return Ok(());
            }
        };
        if self.renumbered(sense) {
            (self.origin_ns, self.since_origin) = (None, 0);
            self.accept(sense, at_ns);
            return Ok(());
        }
        Err(rejection)
    }

    /// Condition that the cRIO samples at another rate than 50 Hz, with the rate in Hz; `None` where it does not.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn wrong_rate(&self) -> Option<(Condition, f64)> {
        // In lockstep a cRIO's clock shows how fast the two programs go, not how far apart its samples are.
        let wrong = self.pacing == Pacing::RealTime
            && (self.wrong_periods & ((1 << RATE_FRAMES) - 1)).count_ones() > RATE_WRONG;
        // Ticks that come faster than time passes, whatever the cRIO's own clock says.
        let fast = self.ahead_ns > AHEAD_OF_ARRIVAL_NS;
        let period_ns = if wrong {
            self.period_ns as f64
        } else {
            let ticks_ns = f64::from(self.since_origin.saturating_sub(ORIGIN_FRAMES)) * TICK_NS as f64;
            TICK_NS as f64 * (1.0 - self.ahead_ns as f64 / ticks_ns.max(TICK_NS as f64))
        };
        (wrong || fast).then(|| (Condition::SampleRate, 1e9 / period_ns.max(1.0)))
    }

    fn ahead_of_arrival(&self, sense: &Sense, at_ns: u64) -> i64 {
        match (self.pacing, self.origin_ns) {
            (Pacing::RealTime, Some(origin)) => origin - offset_ns(sense, at_ns),
            _ => 0,
        }
    }

    fn renumbered(&mut self, sense: &Sense) -> bool {
        let now = Last::of(sense);
        let agreeing = match self.rejected {
            Some((before, count))
                if now.tick.wrapping_sub(before.tick) == 1
                    && now.sequence.wrapping_sub(before.sequence) == 1
                    && now.clock_ns > before.clock_ns =>
            {
                count + 1
            }
            _ => 1,
        };
        self.rejected = Some((now, agreeing));
        let again = agreeing >= REJECTED_TO_RENUMBER;
        if again {
            self.rejected = None;
        }
        again
    }

    fn accept(&mut self, sense: &Sense, at_ns: u64) {
        if let Some(last) = self.last {
            let ticks = u64::from(sense.tick.wrapping_sub(last.tick)).max(1);
            if let Some(passed) = sense.clock_ns.checked_sub(last.clock_ns)
                && ticks <= 4
            {
                self.period_ns = passed / ticks;
                let wrong = self.period_ns.abs_diff(TICK_NS) > PERIOD_TOLERANCE_NS;
                self.wrong_periods = (self.wrong_periods << 1) | u64::from(wrong);
                self.periods = self.periods.saturating_add(1);
            }
        }
        if self.pacing == Pacing::RealTime {
            let offset = offset_ns(sense, at_ns);
            let mut origin = self.origin_ns.unwrap_or(offset);
            if self.since_origin < ORIGIN_FRAMES {
                origin = origin.min(offset);
            }
            self.since_origin = self.since_origin.saturating_add(1);
            self.ahead_ns = origin - offset;
            self.origin_ns = Some(origin + (offset - origin).clamp(-FOLLOW_NS, FOLLOW_NS));
        }
        self.last = Some(Last::of(sense));
    }
}

fn offset_ns(sense: &Sense, at_ns: u64) -> i64 {
    // Wrapping: only differences within a session count.
    (at_ns as i64).wrapping_sub(i64::from(sense.tick).wrapping_mul(TICK_NS as i64))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::wire::{CrioState, TripBits};

    fn frame(sequence: u32, tick: u32, clock_ns: u64) -> Sense {
        Sense {
            sequence,
            clock_ns,
            session: 1,
            tick,
            command_in_force: 0,
            volts: [1.3, 3.8, f32::NAN, f32::NAN],
            duty: [1.0; 2],
            state: CrioState::Idle,
            pump_running: false,
            trips: TripBits::NONE,
            commands_missed: 0,
        }
    }

    /// Frames of a sound cRIO.
    fn sound(gate: &mut FrameGate, ticks: std::ops::Range<u32>) {
        for k in ticks {
            let now = 1 + u64::from(k) * TICK_NS;
            assert_eq!(gate.judge(&frame(k + 1, k, now), now), Ok(()), "{k}");
            assert_eq!(gate.wrong_rate(), None, "{k}");
        }
    }

    #[test]
    fn one_frame_with_a_tick_far_ahead_is_no_frame_and_the_next_goes_on() {
        let mut gate = FrameGate::new(Pacing::RealTime);
        sound(&mut gate, 0..100);
        let now = 1 + 100 * TICK_NS;
        assert_eq!(gate.judge(&frame(101, 1_600, now), now), Err(Rejection::TickJumped { ahead: 1_500 }));
        // The jumped frame has used its sequence number; the next one is newer and in place.
        let now = now + TICK_NS;
        assert_eq!(gate.judge(&frame(102, 101, now), now), Ok(()));
    }

    #[test]
    fn a_numbering_that_stays_ahead_is_taken_up_at_the_third_frame() {
        let mut gate = FrameGate::new(Pacing::Lockstep);
        sound(&mut gate, 0..50);
        let answers: Vec<bool> =
            (50..56u32).map(|k| gate.judge(&frame(k + 1, k + 1_500, 1 + u64::from(k) * TICK_NS), 0).is_ok()).collect();
        assert_eq!(answers, [false, false, true, true, true, true]);
    }

    #[test]
    fn what_does_not_advance_does_not_count() {
        let mut gate = FrameGate::new(Pacing::Lockstep);
        sound(&mut gate, 0..50);
        let now = 1 + 50 * TICK_NS;
        assert_eq!(gate.judge(&frame(50, 50, now), 0), Err(Rejection::Stale { sequence: 50 }));
        assert_eq!(gate.judge(&frame(51, 49, now), 0), Err(Rejection::TickStands { tick: 49 }));
        let stands = 1 + 49 * TICK_NS;
        for k in 51..90 {
            assert!(gate.judge(&frame(k + 1, k, stands), 0).is_err(), "a frozen clock is never taken up");
        }
    }

    #[test]
    fn a_stall_of_this_machine_is_neither_a_jump_nor_another_rate() {
        let mut gate = FrameGate::new(Pacing::RealTime);
        sound(&mut gate, 0..100);
        // Frames 100 … 109 come in one burst 200 ms late; then all is as before.
        for k in 100..300u32 {
            let sent = 1 + u64::from(k) * TICK_NS;
            let at = if k < 110 { 1 + 110 * TICK_NS } else { sent };
            assert_eq!(gate.judge(&frame(k + 1, k, sent), at), Ok(()));
            assert_eq!(gate.wrong_rate(), None, "{k}");
        }
        // A late first frame moves the origin; 80 ms are no reason.
        let mut gate = FrameGate::new(Pacing::RealTime);
        for k in 0..500u32 {
            let sent = 1 + u64::from(k) * TICK_NS;
            let at = if k < 4 { 80_000_001 } else { sent };
            assert_eq!(gate.judge(&frame(k + 1, k, sent), at), Ok(()));
            assert_eq!(gate.wrong_rate(), None, "{k}");
        }
    }

    /// The machine stands still as a session begins: its first frames wait, and are read together.
    #[test]
    fn a_stall_at_the_start_of_a_session_is_no_other_sample_rate() {
        for stall_ns in [145_000_000, 190_000_000] {
            let mut gate = FrameGate::new(Pacing::RealTime);
            for k in 0..500u32 {
                let sent = 1 + u64::from(k) * TICK_NS;
                assert_eq!(gate.judge(&frame(k + 1, k, sent), sent.max(stall_ns)), Ok(()));
                assert_eq!(gate.wrong_rate(), None, "{k}");
            }
        }
    }

    #[test]
    fn another_sample_rate_is_found_by_either_clock() {
        for (period_ns, clock_ns) in [(10_000_000, 10_000_000), (10_000_000, 20_000_000), (25_000_000, 25_000_000)] {
            let mut gate = FrameGate::new(Pacing::RealTime);
            let found = (0..100u32).find(|k| {
                let _ = gate.judge(&frame(k + 1, *k, 1 + u64::from(*k) * clock_ns), 1 + u64::from(*k) * period_ns);
                let rate = gate.wrong_rate();
                // The rate that a person is told is that which is wrong.
                assert!(rate.is_none_or(|(_, hz)| (hz - 1e9 / period_ns as f64).abs() < 8.0), "{rate:?}");
                rate.is_some()
            });
            assert!(found.is_some_and(|k| k < 30), "{period_ns} {clock_ns}: {found:?}");
        }
    }
}
