//! Properties of this machine that decide how late a thread may be, read from `/proc` and `/sys`.

use std::path::Path;

use proto::regular_file;
use rustix::process::{Resource, getrlimit};
use serde::Serialize;

use super::rivals::{Rival, rivals};

/// The largest file of the kernel's that is read, in bytes.
const MOST_BYTES: u64 = 1 << 20;

/// Properties that decide how late a thread may be; absent what the kernel does not tell.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Machine {
    /// Release of the kernel.
    pub kernel: String,
    /// Preemption of the kernel: `rt`, `full`, `lazy`, `voluntary`, `none`, `dynamic` where only that is known.
    pub preemption: Option<String>,
    /// Share of each period that real-time threads may use, and the period, in µs; -1: all of it.
    pub rt_runtime_us: Option<i64>,
    /// The period (µs).
    pub rt_period_us: Option<i64>,
    /// Governors of the CPUs' clock rates, each once.
    pub governors: Vec<String>,
    /// Highest priority that this user may set without being root; 0 for none.
    pub rtprio_limit: u64,
    /// Memory that this user may lock (MiB); absent where there is no limit.
    pub memlock_limit_mib: Option<u64>,
    /// Share of a CPU's time that this container may use; absent where there is no limit.
    pub cpu_quota: Option<f64>,
    /// Longest way out of an idle state on the tick's CPU (µs).
    pub idle_exit_us: Option<u64>,
    /// Clock by which the kernel tells time.
    pub clock_source: Option<String>,
    /// True where this is a virtual machine.
    pub virtual_machine: bool,
    /// CPUs that may be used.
    pub cpus: usize,
    /// CPUs kept free of other programs, as the kernel writes them.
    pub isolated: String,
    /// Threads of other programs that run before the tick.
    pub rivals: Vec<Rival>,
}

impl Machine {
    /// Looks at this machine; CPU and priority are the tick's.
    pub fn look(cpu: usize, priority: u8) -> Self {
        Self::look_in(Path::new("/"), cpu, priority)
    }

    /// Looks below `root`, which holds copies of the kernel's files.
    fn look_in(root: &Path, cpu: usize, priority: u8) -> Self {
        let text = |path: &str| {
            let text = regular_file::read_text(&root.join(path), MOST_BYTES).ok()?;
            Some(text.trim().to_owned())
        };
        let number = |path: &str| text(path)?.parse::<i64>().ok();
        let (soft, memlock) = (getrlimit(Resource::Rtprio).current, getrlimit(Resource::Memlock).current);
        let version = text("proc/version").unwrap_or_default();
        Machine {
            kernel: version.split_whitespace().nth(2).unwrap_or_default().to_owned(),
            preemption: preemption(&version, text("sys/kernel/realtime"), text("sys/kernel/debug/sched/preempt")),
            rt_runtime_us: number("proc/sys/kernel/sched_rt_runtime_us"),
            rt_period_us: number("proc/sys/kernel/sched_rt_period_us"),
            governors: governors(&root.join("sys/devices/system/cpu")),
            rtprio_limit: soft.unwrap_or(u64::MAX),
            memlock_limit_mib: memlock.map(|bytes| bytes >> 20),
            cpu_quota: text("sys/fs/cgroup/cpu.max").as_deref().and_then(quota),
            idle_exit_us: idle_exit(&root.join(format!("sys/devices/system/cpu/cpu{cpu}/cpuidle"))),
            clock_source: text("sys/devices/system/clocksource/clocksource0/current_clocksource"),
            virtual_machine: text("proc/cpuinfo").is_some_and(|t| t.split_whitespace().any(|w| w == "hypervisor")),
            cpus: std::thread::available_parallelism().map_or(1, std::num::NonZero::get),
            isolated: text("sys/devices/system/cpu/isolated").unwrap_or_default(),
            rivals: rivals(&root.join("proc"), std::process::id(), cpu, priority),
        }
    }
}

/// `none voluntary (full)` names the choice in force; without it the kernel's version tells how it was built.
fn preemption(version: &str, realtime: Option<String>, choices: Option<String>) -> Option<String> {
    if realtime.as_deref() == Some("1") || version.contains("PREEMPT_RT") {
        return Some("rt".to_owned());
    }
    let chosen = choices.and_then(|text| {
        let start = text.split_once('(')?.1;
        Some(start.split_once(')')?.0.to_owned())
    });
    chosen.or_else(|| {
        let built = [("PREEMPT_DYNAMIC", "dynamic"), ("PREEMPT_LAZY", "lazy"), ("PREEMPT", "full")];
        let found = built.into_iter().find(|(word, _)| version.contains(word)).map(|(_, name)| name);
        (!version.is_empty()).then(|| found.unwrap_or("none or voluntary").to_owned())
    })
}

fn governors(cpus: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(cpus).into_iter().flatten().flatten();
    let mut found: Vec<String> = entries
        .filter_map(|entry| regular_file::read_text(&entry.path().join("cpufreq/scaling_governor"), MOST_BYTES).ok())
        .map(|text| text.trim().to_owned())
        .collect();
    found.sort();
    found.dedup();
    found
}

/// `200000 100000` is two CPUs, `max 100000` no limit.
fn quota(text: &str) -> Option<f64> {
    let (quota, period) = text.split_once(' ')?;
    let (quota, period): (f64, f64) = (quota.parse().ok()?, period.parse().ok()?);
    (period > 0.0).then_some(quota / period)
}

fn idle_exit(states: &Path) -> Option<u64> {
    let entries = std::fs::read_dir(states).ok()?.flatten();
    let enabled = entries.filter(|e| {
        regular_file::read_text(&e.path().join("disable"), MOST_BYTES).is_ok_and(|text| text.trim() == "0")
    });
    enabled
        .filter_map(|e| regular_file::read_text(&e.path().join("latency"), MOST_BYTES).ok()?.trim().parse().ok())
        .max()
}

/// Time that the CPU has had and that the host took from it, in ticks of the kernel's, since the machine started.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CpuTime {
    total: u64,
    stolen: u64,
}

impl CpuTime {
    /// Counts of one CPU, as of now.
    pub fn of(cpu: usize) -> Option<Self> {
        Self::in_text(&regular_file::read_text(Path::new("/proc/stat"), MOST_BYTES).ok()?, cpu)
    }

    fn in_text(text: &str, cpu: usize) -> Option<Self> {
        let name = format!("cpu{cpu}");
        let line = text.lines().find(|line| line.split_whitespace().next() == Some(&name))?;
        let numbers: Vec<u64> = line.split_whitespace().skip(1).filter_map(|n| n.parse().ok()).collect();
        // user nice system idle iowait irq softirq steal guest guest_nice; guests are in user already.
        Some(CpuTime { total: numbers.iter().take(8).sum(), stolen: *numbers.get(7)? })
    }

    /// The share of the time since `earlier` that the host took.
    pub fn stolen_since(&self, earlier: &Self) -> f64 {
        let total = self.total.saturating_sub(earlier.total);
        let stolen = self.stolen.saturating_sub(earlier.stolen);
        if total == 0 { 0.0 } else { stolen as f64 / total as f64 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kernels_words_are_understood() {
        let of = |version: &str, rt: Option<&str>, choices: Option<&str>| {
            preemption(version, rt.map(str::to_owned), choices.map(str::to_owned)).unwrap()
        };
        assert_eq!(of("Linux version 6.1 SMP PREEMPT_DYNAMIC", None, Some("none voluntary (full)")), "full");
        assert_eq!(of("Linux version 6.1 SMP PREEMPT_DYNAMIC", None, None), "dynamic");
        assert_eq!(of("Linux version 6.1-rt SMP PREEMPT_RT", None, None), "rt");
        assert_eq!(of("Linux version 6.1", Some("1"), None), "rt");
        assert_eq!(of("Linux version 6.1 SMP", None, None), "none or voluntary");
        assert_eq!((quota("max 100000"), quota("150000 100000")), (None, Some(1.5)));
        let stat = "cpu  9 9 9 9 9 9 9 9 0 0\ncpu1 10 0 10 70 0 0 0 10 0 0\n";
        let later = "cpu1 20 0 20 140 0 0 0 20 0 0\n";
        let (a, b) = (CpuTime::in_text(stat, 1).unwrap(), CpuTime::in_text(later, 1).unwrap());
        assert!((b.stolen_since(&a) - 0.1).abs() < 1e-12);
        assert_eq!(CpuTime::in_text(stat, 3), None);
    }

    #[test]
    fn this_machine_can_be_looked_at() {
        let machine = Machine::look(0, 80);
        assert!(machine.cpus >= 1 && !machine.kernel.is_empty(), "{machine:?}");
    }
}
