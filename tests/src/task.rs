//! Threads as the kernel sees them: their names, their page faults, how they are scheduled.

use std::path::{Path, PathBuf};

/// Numbers of the threads that have this name.
pub fn tasks_named(name: &str) -> Vec<i32> {
    tasks_in(Path::new("/proc/self/task"), name)
}

/// Priority under SCHED_FIFO of another process's thread with this name; 0 for an ordinary thread, none where there is no such thread.
pub fn fifo_priority(process: u32, name: &str) -> Option<u64> {
    let threads = PathBuf::from(format!("/proc/{process}/task"));
    let task = *tasks_in(&threads, name).first()?;
    field(&std::fs::read_to_string(threads.join(format!("{task}/stat"))).ok()?, 40)
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
    field(&stat, 10).expect("minor faults") + field(&stat, 12).expect("major faults")
}

/// Field of a thread's `stat`, by its number in proc_pid_stat(5). A name may hold blanks; the state behind it is the third.
fn field(stat: &str, number: usize) -> Option<u64> {
    stat.rsplit_once(')')?.1.split_whitespace().nth(number - 3)?.parse().ok()
}

/// Tells whether memory of this process is locked.
pub fn memory_is_locked() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    status.lines().any(|line| line.starts_with("VmLck:") && !line.contains("\t       0 kB"))
}
