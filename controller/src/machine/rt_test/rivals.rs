//! Threads of other programs that the tick's CPU may run before the tick: of its priority or a higher one.
//!
//! SCHED_FIFO knows no slices of time. A thread of the tick's own priority that is there first keeps the CPU until it waits for
//! something.

use std::path::Path;

use proto::regular_file;
use serde::Serialize;

/// The longest of the kernel's files on a thread, in bytes.
const MOST_BYTES: u64 = 1 << 16;
/// Flag of the kernel's own threads, which do no more than they must (`PF_KTHREAD`).
const KERNELS: u64 = 0x0020_0000;
/// Scheduling policies of which a thread is never cut short by one of lower priority: FIFO and round robin.
const BY_PRIORITY: [u64; 2] = [1, 2];
/// Policy that runs before every priority.
const DEADLINE: u64 = 6;

/// Thread of another program.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Rival {
    /// Name of the thread.
    pub name: String,
    /// Number by which the kernel knows it.
    pub thread: u32,
    /// Real-time priority; none where it has a deadline of its own, which goes before all of them.
    pub priority: Option<u64>,
}

/// Threads of other programs than `own` that may run on this CPU, with this priority or more, by the kernel's folder of processes.
pub(super) fn rivals(processes: &Path, own: u32, cpu: usize, priority: u8) -> Vec<Rival> {
    let numbered = |folder: &Path| {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let numbers: Vec<u32> = entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok()).collect();
        numbers
    };
    let mut found = Vec::new();
    for process in numbered(processes).into_iter().filter(|process| *process != own) {
        let threads = processes.join(process.to_string()).join("task");
        for thread in numbered(&threads) {
            let folder = threads.join(thread.to_string());
            // A name may be cut off within a letter.
            let text = |file: &str| {
                let bytes = regular_file::read(&folder.join(file), MOST_BYTES).ok()?;
                Some(String::from_utf8_lossy(&bytes).into_owned())
            };
            let rival = text("stat").and_then(|stat| rival_in(&stat, thread, priority));
            let may_run = || text("status").is_some_and(|status| may_run_on(&status, cpu));
            found.extend(rival.filter(|_| may_run()));
        }
    }
    found
}

/// The rival that a thread's `stat` tells of.
fn rival_in(stat: &str, thread: u32, priority: u8) -> Option<Rival> {
    // A name may hold blanks and brackets of its own.
    let (before, fields) = stat.rsplit_once(')')?;
    let name = before.split_once('(')?.1.to_owned();
    let fields: Vec<&str> = fields.split_whitespace().collect();
    // Numbers by proc_pid_stat(5), of which the first two stand before the bracket.
    let number = |field: usize| fields.get(field - 3)?.parse::<u64>().ok();
    let (flags, its_priority, policy) = (number(9)?, number(40)?, number(41)?);
    if flags & KERNELS != 0 {
        return None;
    }
    if policy == DEADLINE {
        return Some(Rival { name, thread, priority: None });
    }
    (BY_PRIORITY.contains(&policy) && its_priority >= u64::from(priority)).then_some(Rival {
        name,
        thread,
        priority: Some(its_priority),
    })
}

/// Tells whether a thread's `status` allows it a CPU: `Cpus_allowed_list: 0,2-3`.
fn may_run_on(status: &str, cpu: usize) -> bool {
    let Some(list) = status.lines().find_map(|line| line.strip_prefix("Cpus_allowed_list:")) else { return true };
    list.trim().split(',').any(|part| {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let within = |first: usize, last: usize| (first..=last).contains(&cpu);
        first.parse().ok().zip(last.parse().ok()).is_some_and(|(first, last)| within(first, last))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A `stat` as the kernel writes it.
    fn stat(name: &str, flags: u64, priority: u64, policy: u64) -> String {
        let middle = "0 ".repeat(30);
        format!("77 ({name}) S 1 2 3 4 5 {flags} {middle}{priority} {policy} 0 0 0")
    }

    #[test]
    fn those_of_the_ticks_priority_on_its_cpu_are_found() {
        let root = std::env::temp_dir().join(format!("rivals-{}", std::process::id()));
        let thread = |process: u32, thread: u32, stat: String, cpus: &str| {
            let folder = root.join(format!("{process}/task/{thread}"));
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(folder.join("stat"), stat).unwrap();
            std::fs::write(folder.join("status"), format!("Name:\tx\nCpus_allowed_list:\t{cpus}\n")).unwrap();
        };
        thread(77, 78, stat("tick (2)", 0, 80, 1), "1");
        thread(77, 79, stat("slower", 0, 79, 1), "1");
        thread(77, 80, stat("elsewhere", 0, 90, 1), "0,2-3");
        thread(77, 81, stat("ordinary", 0, 0, 0), "0-3");
        thread(90, 90, stat("migration/1", KERNELS, 99, 1), "1");
        thread(91, 91, stat("deadline", 0, 0, DEADLINE), "0-1");
        thread(92, 92, stat("own", 0, 80, 1), "1");
        std::fs::create_dir_all(root.join("self")).unwrap();
        let mut found = rivals(&root, 92, 1, 80);
        std::fs::remove_dir_all(&root).unwrap();
        found.sort_by_key(|rival| rival.thread);
        let rival = |name: &str, thread, priority| Rival { name: name.to_owned(), thread, priority };
        assert_eq!(found, [rival("tick (2)", 78, Some(80)), rival("deadline", 91, None)]);
    }

    /// The kernel's first thread on CPU 0 that moves others between CPUs is one of the highest priority, and its own.
    #[test]
    fn the_kernels_own_file_is_understood() {
        let of_migration = (2..200).find_map(|process| {
            let text = std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
            text.contains("(migration/0)").then_some(text)
        });
        // A container shows its own processes only.
        let Some(text) = of_migration else { return println!("SKIPPED: the kernel's threads are not shown here") };
        assert_eq!(rival_in(&text, 1, 1), None, "{text}");
        let flags = text.rsplit_once(')').unwrap().1.split_whitespace().nth(6).unwrap();
        let as_a_program = text.replacen(flags, "0", 1);
        let rival = rival_in(&as_a_program, 1, 99).unwrap();
        assert_eq!((rival.name.as_str(), rival.priority), ("migration/0", Some(99)));
    }
}
