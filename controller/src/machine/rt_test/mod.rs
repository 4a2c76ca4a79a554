//! Test of what this machine does to a thread that has to be on time: measured with and without load, with what is at fault.
//!
//! A thread with the tick's priority and CPU wakes every millisecond, and beside it one without either, as any program
//! has; once on the machine as it is, once under a load of this program's own. The tick needs less than that: every
//! 20 ms, and the cRIO is the master of time. A wake later than 6 ms would have been a frame given up.
//!
//! | module | subject |
//! | --- | --- |
//! | [`lateness`] | counts and percentiles |
//! | `probe`, `load` | the threads |
//! | [`machine`] | what `/proc` and `/sys` say |
//! | [`rivals`] | threads that run before the tick |
//! | [`finding`] | what is at fault, and the line that changes it |

pub mod finding;
pub mod lateness;
mod load;
pub mod machine;
mod probe;
pub mod rivals;

use std::time::Duration;

use rustix::thread::{CpuSet, sched_getaffinity};
use serde::Serialize;

use crate::config::Realtime;
use crate::machine::realtime::lock_memory;
use crate::machine::rt_test::lateness::LatenessFigures;
use crate::machine::rt_test::load::Load;
use crate::machine::rt_test::machine::{CpuTime, Machine};
use crate::machine::rt_test::probe::Probe;

/// Between two looks whether it should end.
const LOOK: Duration = Duration::from_millis(50);

/// One phase of the test.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Phase {
    /// Lateness with the tick's priority and CPU.
    pub fifo: LatenessFigures,
    /// Lateness with neither.
    pub normal: LatenessFigures,
    /// Share of the CPU's time that a host took.
    pub stolen: f64,
    /// Duration (s).
    pub seconds: f64,
}

/// Results of the measurement.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RtTest {
    /// The tick's CPU.
    pub cpu: usize,
    /// The machine as it is.
    pub quiet: Phase,
    /// Under load.
    pub loaded: Phase,
    /// Refusals of the system, one line each.
    pub refused: Vec<String>,
    /// Description of the machine.
    pub machine: Machine,
}

impl RtTest {
    /// Measures, half of the time quiet and half under load, until it is over or `stop` says so.
    ///
    /// # Errors
    /// If no thread can be started.
    pub fn run(settings: &Realtime, seconds: f64, stop: &dyn Fn() -> bool) -> std::io::Result<Self> {
        let cpu = tick_cpu(settings);
        let machine = Machine::look(cpu, settings.priority);
        let mut refused: Vec<String> = lock_memory().refusal().into_iter().collect();
        let quiet = phase(settings, cpu, 0.5 * seconds, stop, &mut Vec::new())?;
        let load = Load::start(machine.cpus);
        let loaded = phase(settings, cpu, 0.5 * seconds, stop, &mut refused);
        load.end();
        Ok(RtTest { cpu, quiet, loaded: loaded?, refused, machine })
    }

    /// Time that was measured, in both halves (s): less than was asked for where it was stopped.
    pub fn seconds(&self) -> f64 {
        self.quiet.seconds + self.loaded.seconds
    }

    /// Wakes that would have been a frame given up.
    pub fn misses(&self) -> u64 {
        self.quiet.fifo.over_6_ms + self.loaded.fifo.over_6_ms
    }

    /// Tells whether a tick would have been on time throughout, with all that the daemon asks for granted.
    pub fn is_good(&self) -> bool {
        self.refused.is_empty() && self.misses() == 0
    }
}

fn phase(
    settings: &Realtime,
    cpu: usize,
    seconds: f64,
    stop: &dyn Fn() -> bool,
    refused: &mut Vec<String>,
) -> std::io::Result<Phase> {
    let before = CpuTime::of(cpu);
    let begun = std::time::Instant::now();
    let (fifo, normal) = (Probe::start(Some(settings.clone()))?, Probe::start(None)?);
    while begun.elapsed().as_secs_f64() < seconds && !stop() {
        std::thread::sleep(LOOK);
    }
    let ((fifo, not_granted), (normal, _)) = (fifo.end(), normal.end());
    refused.extend(not_granted);
    let stolen = before.zip(CpuTime::of(cpu)).map_or(0.0, |(before, after)| after.stolen_since(&before));
    Ok(Phase { fifo: fifo.figures(), normal: normal.figures(), stolen, seconds: begun.elapsed().as_secs_f64() })
}

/// The CPU that the tick is pinned to: the configured one, or the last that may be used.
fn tick_cpu(settings: &Realtime) -> usize {
    let last = || {
        let allowed = sched_getaffinity(None).ok()?;
        (0..CpuSet::MAX_CPU).rev().find(|cpu| allowed.is_set(*cpu))
    };
    settings.cpu.or_else(last).unwrap_or(0)
}
