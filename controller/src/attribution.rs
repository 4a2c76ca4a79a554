//! What a missed deadline is put down to: own code, this machine, or the link.

use rustix::time::{ClockId, clock_gettime};

/// Computation beyond which the tick's own code is to blame, in ns of its CPU time: the soft limit of the time budget (study
/// of the daemon, §3.3).
const OWN_CODE_NS: u64 = 8_000_000;
/// Part of the lateness that must be explained, in ns.
const WORTH_NAMING_NS: u64 = 2_000_000;

/// What a missed deadline is put down to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum MissCause {
    /// The tick itself computed for too long.
    OwnCode = 1,
    /// The tick's thread was ready and did not get a CPU: other programs, or time that the host took.
    Preempted = 2,
    /// The frame came late.
    Link = 3,
}

impl MissCause {
    /// The words for a recorded number.
    pub fn text(code: u8) -> &'static str {
        match code {
            1 => "the tick's own computation",
            2 => "this machine did not give it a CPU: other programs or its host",
            3 => "the frame came late: the link or the cRIO",
            _ => "cause not known",
        }
    }
}

/// Times of one tick, in ns.
#[derive(Debug, Clone, Copy)]
pub struct TickTimes {
    /// From the frame in hand to the command sent, on the clock.
    pub wall_ns: u64,
    /// The same by the thread's CPU time.
    pub cpu_ns: u64,
    /// Time that the thread waited for a CPU since the last tick, as far as it is known.
    pub run_delay_ns: u64,
}

impl TickTimes {
    /// What a miss is put down to.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn cause(self) -> MissCause {
        if self.cpu_ns > OWN_CODE_NS {
            MissCause::OwnCode
        } else if self.wall_ns.saturating_sub(self.cpu_ns) > WORTH_NAMING_NS || self.run_delay_ns > WORTH_NAMING_NS {
            MissCause::Preempted
        } else {
            MissCause::Link
        }
    }
}

/// CPU time of the calling thread, in ns.
///
/// # Real-time
/// May run in the tick: one system call.
pub fn thread_cpu_ns() -> u64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    (time.tv_sec as u64).wrapping_mul(1_000_000_000).wrapping_add(time.tv_nsec as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_miss_has_its_cause() {
        let times = |wall_ms: u64, cpu_ms: u64, delay_ms: u64| TickTimes {
            wall_ns: wall_ms * 1_000_000,
            cpu_ns: cpu_ms * 1_000_000,
            run_delay_ns: delay_ms * 1_000_000,
        };
        assert_eq!(times(15, 14, 0).cause(), MissCause::OwnCode);
        assert_eq!(times(15, 1, 0).cause(), MissCause::Preempted);
        assert_eq!(times(1, 1, 12).cause(), MissCause::Preempted);
        assert_eq!(times(1, 1, 0).cause(), MissCause::Link);
    }

    #[test]
    fn cpu_time_counts_work_and_not_sleep() {
        let before = thread_cpu_ns();
        std::thread::sleep(std::time::Duration::from_millis(30));
        let slept = thread_cpu_ns() - before;
        assert!(slept < 20_000_000, "{slept}");
        let mut x = 1u64;
        for k in 0..20_000_000u64 {
            x = std::hint::black_box(x.wrapping_mul(k | 1));
        }
        assert!(thread_cpu_ns() - before > slept + 1_000_000, "{x}");
    }
}
