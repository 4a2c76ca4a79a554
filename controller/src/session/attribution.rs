//! Causes of a missed deadline: own code, this machine, its host, or the link.

use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};

use rustix::time::{ClockId, clock_gettime};

/// Computation beyond which the tick's own code is to blame, in ns of its CPU time: the soft limit of the time budget (study
/// of the daemon, §3.3).
const OWN_CODE_NS: u64 = 8_000_000;
/// Part of the lateness that must be explained, in ns.
const WORTH_NAMING_NS: u64 = 2_000_000;
/// Length of a tick in which the kernel counts stolen time, in ns: USER_HZ is 100 on every architecture that this runs on.
const KERNEL_TICK_NS: u64 = 10_000_000;
/// Column of the stolen time in a line of `/proc/stat`, behind its name: user nice system idle iowait irq softirq steal.
const STEAL: usize = 7;

/// Cause that a missed deadline is put down to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum MissCause {
    /// The tick itself computed for too long.
    OwnCode = 1,
    /// The tick's thread was ready and did not get a CPU, or the whole program stood still.
    Preempted = 2,
    /// The frame came late.
    Link = 3,
    /// The host took the CPUs from this machine meanwhile.
    Stolen = 4,
}

impl MissCause {
    /// The words for a recorded number.
    pub fn text(code: u8) -> &'static str {
        match code {
            1 => "the tick's own computation",
            2 => "this machine did not give it a CPU: other programs or its host, or the daemon was stopped",
            3 => "the frame came late: the link or the cRIO",
            4 => "this machine's host took its CPUs meanwhile: stolen time",
            _ => "cause not known",
        }
    }
}

/// Times of one tick, in ns.
#[derive(Debug, Clone, Copy)]
pub struct TickTimes {
    /// From the frame in hand to the command sent, on the clock.
    pub wall_ns: u64,
    /// Time of the tick by the thread's CPU time.
    pub cpu_ns: u64,
    /// Time that the thread waited for a CPU since the last tick, as far as it is known.
    pub run_delay_ns: u64,
    /// Time by which the thread came back later from waiting for the frame than it had asked to.
    pub overslept_ns: u64,
    /// Time that the host lately took from all CPUs together, as far as it is known.
    pub stolen_ns: u64,
}

impl TickTimes {
    /// Cause that a miss is put down to.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn cause(self) -> MissCause {
        if self.cpu_ns > OWN_CODE_NS {
            return MissCause::OwnCode;
        }
        // A frame that came meanwhile lay in the buffer: nobody was there to take it.
        let stood_ns = self.wall_ns.saturating_sub(self.cpu_ns).max(self.run_delay_ns).max(self.overslept_ns);
        match stood_ns {
            ..=WORTH_NAMING_NS => MissCause::Link,
            // All of it, by a count in such steps over all CPUs, of which some is always taken.
            _ if self.stolen_ns >= stood_ns + KERNEL_TICK_NS => MissCause::Stolen,
            _ => MissCause::Preempted,
        }
    }
}

/// The host's share of this machine's CPUs, by the first line of `/proc/stat`.
#[derive(Debug, Default)]
pub struct StolenTime {
    stat: Option<File>,
}

impl StolenTime {
    /// Opens the kernel's file; without it no time is stolen.
    pub fn open() -> Self {
        StolenTime { stat: File::open("/proc/stat").ok() }
    }

    /// Time stolen from all CPUs together since the machine started, in ns, in steps of 10 ms.
    ///
    /// # Real-time
    /// May run in a tick that has missed its deadline: two system calls, up to a millisecond where there are many CPUs.
    pub fn total_ns(&mut self) -> Option<u64> {
        let stat = self.stat.as_mut()?;
        let mut text = [0; 160];
        stat.seek(SeekFrom::Start(0)).ok()?;
        let length = stat.read(&mut text).ok()?;
        stolen_in(text.get(..length)?)
    }
}

/// The stolen time in a text that begins as `/proc/stat` does.
fn stolen_in(text: &[u8]) -> Option<u64> {
    let line = text.split(|byte| *byte == b'\n').next()?;
    let mut words = line.split(|byte| *byte == b' ').filter(|word| !word.is_empty());
    words.next().filter(|name| *name == b"cpu")?;
    let ticks: u64 = std::str::from_utf8(words.nth(STEAL)?).ok()?.parse().ok()?;
    ticks.checked_mul(KERNEL_TICK_NS)
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
            overslept_ns: 0,
            stolen_ns: 0,
        };
        assert_eq!(times(15, 14, 0).cause(), MissCause::OwnCode);
        assert_eq!(times(15, 1, 0).cause(), MissCause::Preempted);
        assert_eq!(times(1, 1, 12).cause(), MissCause::Preempted);
        assert_eq!(times(1, 1, 0).cause(), MissCause::Link);
        // Stopped for 30 ms while it waited for a frame.
        let stopped = TickTimes { overslept_ns: 30_000_000, ..times(1, 1, 0) };
        assert_eq!(stopped.cause(), MissCause::Preempted);
        assert_eq!(TickTimes { stolen_ns: 40_000_000, ..stopped }.cause(), MissCause::Stolen);
        assert_eq!(TickTimes { stolen_ns: 30_000_000, ..stopped }.cause(), MissCause::Preempted);
        assert_eq!(TickTimes { stolen_ns: 40_000_000, ..times(1, 1, 0) }.cause(), MissCause::Link);
    }

    #[test]
    fn stolen_time_is_the_eighth_number_of_all_cpus() {
        let text = b"cpu  100 2 30 4000 5 6 7 8 9 10\ncpu0 50 1 15 2000 2 3 3 4 4 5\n";
        assert_eq!(stolen_in(text), Some(80_000_000));
        assert_eq!(stolen_in(b"cpu  100 2 30"), None);
        assert_eq!(stolen_in(b"intr 1 2 3 4 5 6 7 8 9"), None);
        // As the kernel of this machine has it.
        assert!(StolenTime::open().total_ns().is_some());
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
