//! Causes of a late tick, each with the very line that changes it.

use serde::Serialize;

use super::RtTest;
use super::rivals::Rival;

/// Lateness from which something is wrong, in µs: a tick of 4 ms then still leaves 9 of its 14 ms. Chosen.
const LATE_US: f64 = 1_000.0;
/// Share of the CPU's time taken by the host from which it counts: a tick in 500. Chosen.
const STOLEN: f64 = 0.002;
/// Way out of an idle state that costs more than a wake of a quiet machine, in µs. Chosen.
const IDLE_EXIT_US: u64 = 150;
/// Least share of a period that real-time threads need: a tick of 10 ms in 20, and as much for others. Chosen.
const RT_SHARE: f64 = 0.8;

/// Importance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Weight {
    /// The daemon will not arm, or ticks will be missed.
    Fault,
    /// It may be behind the lateness that was measured.
    Suspect,
}

/// Something at fault.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// Importance.
    pub weight: Weight,
    /// Finding in one clause.
    pub what: String,
    /// The line that changes it: a command, or a line for a file.
    pub fix: String,
}

/// Causes, the worst first.
pub fn findings(test: &RtTest) -> Vec<Finding> {
    let mut found = refused(test);
    let late = test.loaded.fifo.p999_us > LATE_US || test.quiet.fifo.p999_us > LATE_US || test.misses() > 0;
    found.extend(throttled(test));
    found.extend(shared(test, late));
    if late {
        found.extend(rivals(test));
        found.extend(kernel(test));
        found.extend(clocks(test));
    }
    found.sort_by_key(|finding| finding.weight);
    found
}

fn finding(weight: Weight, what: impl Into<String>, fix: impl Into<String>) -> Finding {
    Finding { weight, what: what.into(), fix: fix.into() }
}

fn refused(test: &RtTest) -> Vec<Finding> {
    test.refused
        .iter()
        .map(|line| {
            let (what, fix) = line.rsplit_once(": ").unwrap_or((line, "run it as the service"));
            let limits = if fix.contains("RTPRIO") {
                " in the unit, or for a login: echo '@dual-pressure - rtprio 95' >> /etc/security/limits.d/dual-pressure.conf"
            } else if fix.contains("MEMLOCK") {
                " in the unit, or for a login: echo '@dual-pressure - memlock unlimited' >> /etc/security/limits.d/dual-pressure.conf"
            } else {
                ""
            };
            finding(Weight::Fault, what, format!("{fix}{limits}"))
        })
        .collect()
}

fn throttled(test: &RtTest) -> Vec<Finding> {
    let machine = &test.machine;
    let mut found = Vec::new();
    if let (Some(runtime), Some(period)) = (machine.rt_runtime_us, machine.rt_period_us)
        && runtime >= 0
        && (runtime as f64) < RT_SHARE * period as f64
    {
        found.push(finding(
            Weight::Fault,
            format!("real-time threads may use only {runtime} of {period} us"),
            "sysctl -w kernel.sched_rt_runtime_us=950000",
        ));
    }
    if let Some(quota) = machine.cpu_quota {
        found.push(finding(
            Weight::Fault,
            format!("this container may use only {quota:.2} CPUs; a spent quota stops every thread"),
            "start it without a CPU limit (docker: no --cpus; systemd: CPUQuota=)",
        ));
    }
    found
}

fn shared(test: &RtTest, late: bool) -> Vec<Finding> {
    let stolen = test.quiet.stolen.max(test.loaded.stolen);
    let mut found = Vec::new();
    if stolen > STOLEN {
        let weight = if late { Weight::Fault } else { Weight::Suspect };
        found.push(finding(
            weight,
            format!("the host took {:.1} % of CPU {}'s time from this virtual machine", stolen * 100.0, test.cpu),
            "on the host: dedicated CPUs for this guest (libvirt: <vcpupin vcpu='N' cpuset='M'/>), or a PC of its own",
        ));
    } else if late && test.machine.virtual_machine {
        found.push(finding(
            Weight::Suspect,
            "this is a virtual machine; a host can stop it without saying so",
            "on the host: dedicated CPUs for this guest (libvirt: <vcpupin vcpu='N' cpuset='M'/>), or a PC of its own",
        ));
    }
    if late && test.machine.cpus < 2 {
        found.push(finding(
            Weight::Suspect,
            "there is only one CPU for everything",
            "give the machine a second CPU: the tick is then pinned to the last one",
        ));
    } else if late && test.machine.isolated.is_empty() {
        found.push(finding(
            Weight::Suspect,
            format!("CPU {} also serves other programs and interrupts", test.cpu),
            format!("kernel command line: isolcpus={0} nohz_full={0} irqaffinity=0", test.cpu),
        ));
    }
    found
}

/// Threads that keep the CPU from the tick for as long as they like.
fn rivals(test: &RtTest) -> impl Iterator<Item = Finding> {
    test.machine.rivals.iter().map(|rival| {
        let Rival { name, thread, priority } = rival;
        let priority = priority.map_or("a deadline".to_owned(), |priority| format!("real-time priority {priority}"));
        finding(
            Weight::Suspect,
            format!("the thread {name} ({thread}) of another program has {priority} and may use CPU {}", test.cpu),
            format!("chrt --other --pid 0 {thread}, or give it another CPU: taskset -pc CPU {thread}"),
        )
    })
}

fn kernel(test: &RtTest) -> Option<Finding> {
    let now = test.machine.preemption.as_deref()?;
    match now {
        "rt" => None,
        "full" | "lazy" => Some(finding(
            Weight::Suspect,
            format!("the kernel is no real-time kernel (preemption: {now})"),
            "apt install linux-image-rt-amd64, then start that kernel",
        )),
        _ => Some(finding(
            Weight::Suspect,
            format!("the kernel lets its own work go on before a real-time thread (preemption: {now})"),
            "kernel command line: preempt=full; better: apt install linux-image-rt-amd64",
        )),
    }
}

fn clocks(test: &RtTest) -> Vec<Finding> {
    let machine = &test.machine;
    let mut found = Vec::new();
    if machine.governors.iter().any(|governor| governor != "performance") {
        found.push(finding(
            Weight::Suspect,
            format!("the CPUs' clock rate is varied (governor: {})", machine.governors.join(", ")),
            "cpupower frequency-set -g performance",
        ));
    }
    if let Some(us) = machine.idle_exit_us.filter(|us| *us > IDLE_EXIT_US) {
        found.push(finding(
            Weight::Suspect,
            format!("CPU {} may sleep so deeply that waking takes {us} us", test.cpu),
            "cpupower idle-set -D 100; for good: kernel command line processor.max_cstate=1 intel_idle.max_cstate=1",
        ));
    }
    if let Some(clock) = machine.clock_source.as_deref().filter(|clock| ["hpet", "acpi_pm", "jiffies"].contains(clock))
    {
        found.push(finding(
            Weight::Suspect,
            format!("the kernel tells time with {clock}, which is slow to read"),
            "kernel command line: tsc=reliable clocksource=tsc",
        ));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::rt_test::Phase;
    use crate::machine::rt_test::lateness::Lateness;
    use crate::machine::rt_test::machine::Machine;

    fn test(late_us: u64) -> RtTest {
        let phase = |us: u64| {
            let mut lateness = Lateness::new();
            (0..1_000).for_each(|_| lateness.add(us * 1_000));
            Phase { fifo: lateness.figures(), normal: lateness.figures(), stolen: 0.0, seconds: 1.0 }
        };
        RtTest {
            cpu: 1,
            quiet: phase(20),
            loaded: phase(late_us),
            refused: Vec::new(),
            machine: Machine { cpus: 2, isolated: "1".to_owned(), ..Machine::default() },
        }
    }

    #[test]
    fn a_quiet_machine_has_nothing_at_fault_whatever_it_is_made_of() {
        let mut test = test(100);
        test.machine.preemption = Some("none".to_owned());
        test.machine.governors = vec!["powersave".to_owned()];
        assert!(findings(&test).is_empty(), "{:?}", findings(&test));
        assert!(test.is_good());
    }

    #[test]
    fn each_cause_has_its_line() {
        let other = Rival { name: "tick".to_owned(), thread: 4711, priority: Some(80) };
        let with = |change: &dyn Fn(&mut RtTest)| {
            let mut test = test(8_000);
            change(&mut test);
            let found = findings(&test);
            assert!(!test.is_good());
            found.iter().map(|f| format!("{}: {}\n", f.what, f.fix)).collect::<String>()
        };
        for (said, words) in [
            (with(&|t| t.machine.preemption = Some("none".to_owned())), "preempt=full"),
            (with(&|t| t.machine.governors = vec!["powersave".to_owned()]), "cpupower frequency-set -g performance"),
            (with(&|t| t.machine.idle_exit_us = Some(900)), "max_cstate=1"),
            (with(&|t| t.machine.clock_source = Some("hpet".to_owned())), "tsc=reliable"),
            (with(&|t| t.machine.cpu_quota = Some(1.0)), "CPUQuota"),
            (with(&|t| t.machine.rt_runtime_us = Some(100_000)), "sched_rt_runtime_us=950000"),
            (with(&|t| t.loaded.stolen = 0.03), "3.0 % of CPU 1"),
            (with(&|t| t.machine.isolated = String::new()), "isolcpus=1"),
            (with(&|t| t.machine.cpus = 1), "second CPU"),
            (with(&|t| t.machine.rivals = vec![other.clone()]), "chrt --other --pid 0 4711"),
            (
                with(&|t| {
                    t.refused =
                        vec!["no SCHED_FIFO priority 80 (EPERM); late: give the service LimitRTPRIO=95".to_owned()]
                }),
                "rtprio 95",
            ),
        ] {
            // The period is needed beside the run time.
            if words.contains("sched_rt_runtime") {
                continue;
            }
            assert!(said.contains(words), "`{words}` is not in: {said}");
        }
        let mut throttled = test(100);
        (throttled.machine.rt_runtime_us, throttled.machine.rt_period_us) = (Some(100_000), Some(1_000_000));
        assert!(findings(&throttled)[0].fix.contains("sched_rt_runtime_us=950000"));
    }
}
