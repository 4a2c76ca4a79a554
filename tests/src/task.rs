//! Threads as the kernel sees them: their names, their page faults, how they are scheduled.

use std::path::{Path, PathBuf};

/// Numbers of the threads that have this name.
pub fn tasks_named(name: &str) -> Vec<i32> {
    tasks_in(Path::new("/proc/self/task"), name)
}

/// Scheduling policy of another process's thread with this name, by the kernel's number: 0 for an ordinary thread, 1 for SCHED_FIFO.
/// None where there is no such thread.
pub fn scheduling_policy(process: u32, name: &str) -> Option<u64> {
    let threads = PathBuf::from(format!("/proc/{process}/task"));
    let task = *tasks_in(&threads, name).first()?;
    let stat = std::fs::read_to_string(threads.join(format!("{task}/stat"))).ok()?;
    // Field 41 of proc_pid_stat(5); the state behind the name is the third.
    stat.rsplit_once(')')?.1.split_whitespace().nth(38)?.parse().ok()
}

fn tasks_in(threads: &Path, name: &str) -> Vec<i32> {
    let entries = std::fs::read_dir(threads).into_iter().flatten().flatten();
    let numbered = |path: PathBuf| {
        let named = std::fs::read_to_string(path.join("comm")).is_ok_and(|comm| comm.trim() == name);
        path.file_name()?.to_str()?.parse().ok().filter(|_| named)
    };
    entries.filter_map(|entry| numbered(entry.path())).collect()
}

/// Page faults of a thread so far, minor and major: what `getrusage` tells the thread itself.
///
/// # Panics
/// If there is no such thread.
pub fn page_faults(task: i32) -> u64 {
    let stat = std::fs::read_to_string(format!("/proc/self/task/{task}/stat")).expect("a thread of this process");
    let (_, after_name) = stat.rsplit_once(')').expect("a name in brackets");
    let field = |n: usize| after_name.split_whitespace().nth(n).and_then(|word| word.parse::<u64>().ok());
    // Fields 10 and 12 of proc_pid_stat(5); the state behind the name is the third.
    field(7).expect("minor faults") + field(9).expect("major faults")
}

/// Tells whether memory of this process is locked.
pub fn memory_is_locked() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    status.lines().any(|line| line.starts_with("VmLck:") && !line.contains("\t       0 kB"))
}
