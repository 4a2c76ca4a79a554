//! Makes the tick's thread a real-time one, as far as the machine allows.
//!
//! Each right that it does not give is told in one line, with the limit to raise. With `realtime.enforce` (the default) nothing is
//! armed then; without it the loop runs all the same, just later at times, and the recording shows how much.

use std::sync::OnceLock;

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getpriority_process, getrlimit, setpriority_process};
use rustix::thread::{CapabilitySet, CpuSet, capabilities, sched_getaffinity, sched_setaffinity};
use thread_priority::{
    NormalThreadSchedulePolicy, RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityOsValue,
    ThreadPriorityValue, ThreadSchedulePolicy, set_thread_priority_and_policy, thread_native_id,
};

use supervisor::Condition;

use crate::config::{Config, Pacing, Realtime};

/// Memory that locking must be allowed for, far above what the daemon uses: 1 GiB.
const ENOUGH_MEMORY: u64 = 1 << 30;

/// CPUs that this program's threads may use, noted before the first of them is pinned.
static ALLOWED: OnceLock<CpuSet> = OnceLock::new();

/// Lock of all memory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum MemoryLock {
    /// All of it is locked.
    Locked,
    /// It is not locked, for this reason.
    Refused(String),
}

impl MemoryLock {
    /// Reason why it is not locked; `None` where it is.
    pub fn refusal(self) -> Option<String> {
        match self {
            MemoryLock::Locked => None,
            MemoryLock::Refused(line) => Some(line),
        }
    }
}

/// Refusals of this machine, and whether that keeps the rig from being armed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rights {
    lines: Vec<String>,
    bars_arming: Option<Condition>,
}

impl Rights {
    /// Judges what was refused to the tick's thread and what became of locking memory.
    pub fn of(refused: Vec<String>, memory: MemoryLock, config: &Config) -> Self {
        let mut lines = refused;
        lines.extend(memory.refusal());
        let enforced = config.realtime.enforce && config.link.pacing == Pacing::Realtime;
        let bars_arming = (enforced && !lines.is_empty()).then_some(Condition::NotRealtime);
        if bars_arming.is_some() {
            lines.push(
                "NOTHING WILL BE ARMED: realtime.enforce = true asks for all of the above; grant it, or set it to false"
                    .to_owned(),
            );
        }
        Rights { lines, bars_arming }
    }

    /// One line for each right that is missing, and what follows.
    pub fn lines(&self) -> &[String] {
        &self.lines
    }

    /// The condition that holds for as long as this process lives, if rights are missing and enforced.
    pub fn bar_arming(&self) -> Option<Condition> {
        self.bars_arming
    }
}

/// Locks all memory, present and future, so that the tick never waits for a page; call it before threads
/// are started. Answers what was refused.
pub fn lock_memory() -> MemoryLock {
    // Locking what will come, too, under a small limit would not fail here but when the next thread needs a stack.
    let limit = getrlimit(Resource::Memlock).current.unwrap_or(u64::MAX);
    let is_bound = !capabilities(None).is_ok_and(|own| own.effective.contains(CapabilitySet::IPC_LOCK));
    if limit < ENOUGH_MEMORY && is_bound {
        return MemoryLock::Refused(format!(
            "memory is not locked (the limit is {} MiB); a page fault may delay a tick: give the service LimitMEMLOCK=infinity",
            limit >> 20
        ));
    }
    // Stacks and heap of later threads are locked as they are made.
    match mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE) {
        Ok(()) => MemoryLock::Locked,
        Err(errno) => MemoryLock::Refused(format!(
            "memory is not locked ({errno}); a page fault may delay a tick: give the service LimitMEMLOCK=infinity"
        )),
    }
}

/// Gives the calling thread SCHED_FIFO and one CPU. Answers what was refused.
pub fn make_realtime(settings: &Realtime) -> Vec<String> {
    let mut refused = Vec::new();
    if let Err(problem) = pin(settings.cpu) {
        refused.push(problem);
    }
    if let Err(error) = raise(settings.priority) {
        refused.push(format!(
            "no SCHED_FIFO priority {} ({error}); other programs may delay a tick: give the service LimitRTPRIO=95",
            settings.priority
        ));
    }
    refused
}

/// Calls `start` on a thread with SCHED_FIFO `priority`, so that threads it starts inherit that.
///
/// For the emulated cRIO of the demo, which stands in for hardware that is never late. Without the rights it is
/// called all the same.
pub fn with_priority<T: Send>(priority: u8, start: impl FnOnce() -> T + Send) -> std::thread::Result<T> {
    std::thread::scope(|scope| {
        let raised = scope.spawn(move || {
            // The tick's own refusal, for the same reason, is the line that a person needs.
            let _ = raise(priority);
            start()
        });
        raised.join()
    })
}

/// Gives the calling thread SCHED_FIFO.
pub(crate) fn raise(priority: u8) -> Result<(), String> {
    let fifo = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    let value = ThreadPriorityValue::try_from(priority).map_err(|e| e.to_string())?;
    set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(value), fifo)
        .map_err(|e| e.to_string())
}

/// Gives the calling thread the priority and the CPUs that any thread of this program has. A thread started by the tick's thread would
/// otherwise inherit the tick's.
pub(crate) fn step_back() {
    let normal = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Other);
    let nice = getpriority_process(None);
    // A thread may always ask for less.
    let _ = set_thread_priority_and_policy(
        thread_native_id(),
        ThreadPriority::Os(ThreadPriorityOsValue::default()),
        normal,
    );
    // With the policy goes a nice value of 0, which a program that was started as a nice one did not ask for.
    if let Ok(nice) = nice {
        let _ = setpriority_process(None, nice);
    }
    if let Some(allowed) = ALLOWED.get() {
        // They were allowed before, so at worst this thread stays on the tick's CPU, where it does not hold up the tick.
        let _ = sched_setaffinity(None, allowed);
    }
}

/// Pins the calling thread; by default to the last CPU it may use, if there are several.
fn pin(wanted: Option<usize>) -> Result<(), String> {
    let allowed =
        sched_getaffinity(None).map_err(|errno| format!("the CPUs allowed are not known ({errno}); not pinned"))?;
    ALLOWED.get_or_init(|| allowed);
    let last = (0..CpuSet::MAX_CPU).rev().find(|cpu| allowed.is_set(*cpu));
    let cpu = match wanted {
        Some(cpu) if cpu < CpuSet::MAX_CPU && allowed.is_set(cpu) => cpu,
        Some(cpu) => return Err(format!("realtime.cpu = {cpu} is none of the CPUs allowed here; not pinned")),
        None if allowed.count() < 2 => return Ok(()),
        None => last.unwrap_or(0),
    };
    let mut only = CpuSet::new();
    only.set(cpu);
    sched_setaffinity(None, &only).map_err(|errno| format!("the tick is not pinned to CPU {cpu} ({errno})"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_rights_bar_arming_only_where_they_are_enforced() {
        let mut config = Config::for_address("127.0.0.1:1");
        let refused = || vec!["no SCHED_FIFO priority 80".to_owned()];
        assert_eq!(Rights::of(Vec::new(), MemoryLock::Locked, &config).bar_arming(), None);
        let rights = Rights::of(refused(), MemoryLock::Locked, &config);
        assert_eq!(rights.bar_arming(), Some(Condition::NotRealtime));
        assert!(rights.lines().last().is_some_and(|line| line.contains("realtime.enforce")), "{rights:?}");
        let unlocked = MemoryLock::Refused("memory is not locked".to_owned());
        assert!(Rights::of(Vec::new(), unlocked, &config).bar_arming().is_some());
        config.realtime.enforce = false;
        assert_eq!(Rights::of(refused(), MemoryLock::Locked, &config).bar_arming(), None);
        config.realtime.enforce = true;
        config.link.pacing = Pacing::Lockstep;
        assert_eq!(Rights::of(refused(), MemoryLock::Locked, &config).bar_arming(), None);
    }
}
