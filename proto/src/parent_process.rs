//! Programs that end with the one that started them, however that one went: a rehearsal whose `trainer adapt` is killed
//! must leave no rig, no daemon and no training behind.
//!
//! The one that starts names itself in the environment ([`ends_with_this`]). The one that is started asks the kernel, first of all, for a
//! SIGKILL at that process' end ([`end_with_parent`]): that also reaches a program which a SIGSTOP holds, as a rehearsal's are
//! while this machine computes. No tick calls any of this.

use std::process::Command;

use rustix::process::{Pid, Signal, getppid, set_parent_process_death_signal, test_kill_process};

/// Variable that holds the process number of the program to end with.
pub const VARIABLE: &str = "DUAL_PRESSURE_PARENT";

/// Has a command end when this program does. The thread that spawns it must be the one that lasts: the kernel goes by threads.
pub fn ends_with_this(command: &mut Command) -> &mut Command {
    command.env(VARIABLE, std::process::id().to_string())
}

/// First step of a program that may have been started by [`ends_with_this`]: nothing where it was not.
///
/// Ends the program at once, with exit status 1, where the one to end with has gone already.
pub fn end_with_parent() {
    let Ok(named) = std::env::var(VARIABLE) else { return };
    let Some(parent) = named.parse().ok().and_then(Pid::from_raw) else { return };
    // A kernel that knows no such request leaves the program as it would be without.
    let _ = set_parent_process_death_signal(Some(Signal::KILL));
    if getppid() == Some(parent) {
        return;
    }
    // The variable goes on to programs that this one's parent starts: they end with theirs. One that has gone starts nothing.
    let _ = set_parent_process_death_signal(None);
    if test_kill_process(parent).is_err() {
        std::process::exit(1);
    }
}
