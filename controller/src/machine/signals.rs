//! Handling of signals: each that would end a program by default is either an order or told and ignored.
//!
//! | signal | does |
//! | --- | --- |
//! | `TERM`, `INT`, `XCPU`, `PWR` | vents, says BYE, finishes the recording, ends |
//! | `HUP` | reads the configuration again |
//! | `USR1`, `USR2`, `QUIT`, `ALRM`, `VTALRM`, `PROF`, `IO`, `TSTP`, `TTIN`, `TTOU`, `STKFLT`, `XFSZ`, `PIPE` | nothing; all but the last two are told |
//!
//! A program that takes seconds to start holds them from its first line on ([`hold_until_install`]): until it runs, only those that end
//! a run do what they do by default, and the rest waits.
//!
//! `XCPU` comes from systemd's LimitRTTIME when a real-time thread never waits, `PWR` from what watches a power supply.
//! `TSTP` would stop the tick with the rig armed. `XFSZ` and `PIPE` come with an error of the write that caused them, which
//! is handled there.

use std::io;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use proto::first_signal::FirstSignal;
use rustix::process::Signal;
use signal_hook::consts::{
    SIGALRM, SIGHUP, SIGINT, SIGIO, SIGPIPE, SIGPROF, SIGQUIT, SIGTERM, SIGTSTP, SIGTTIN, SIGTTOU, SIGUSR1, SIGUSR2,
    SIGVTALRM, SIGXCPU, SIGXFSZ,
};
use signal_hook::iterator::Signals as Pending;

/// Signals that end the run in order.
const STOPS: [i32; 4] = [SIGTERM, SIGINT, SIGXCPU, Signal::POWER.as_raw()];
/// Signals that are told and do nothing.
const TOLD: [(i32, &str); 11] = [
    (SIGUSR1, "SIGUSR1"),
    (SIGUSR2, "SIGUSR2"),
    (SIGQUIT, "SIGQUIT"),
    (SIGALRM, "SIGALRM"),
    (SIGVTALRM, "SIGVTALRM"),
    (SIGPROF, "SIGPROF"),
    (SIGIO, "SIGIO"),
    (SIGTSTP, "SIGTSTP"),
    (SIGTTIN, "SIGTTIN"),
    (SIGTTOU, "SIGTTOU"),
    (Signal::STKFLT.as_raw(), "SIGSTKFLT"),
];
/// Signals that do nothing, because the write that caused them fails by itself.
const SILENT: [i32; 2] = [SIGXFSZ, SIGPIPE];

/// First signal that ends a run; empty before handlers are installed.
static ORDERED_TO_STOP: OnceLock<FirstSignal> = OnceLock::new();

/// Signals that came since they are held; taken over by what is installed.
static HELD: Mutex<Option<Pending>> = Mutex::new(None);

/// Has signals that end no run wait for [`Signals::install`]; those that end a run still end the program at once, for nothing has begun
/// yet.
///
/// # Errors
/// If the system refuses a handler.
pub fn hold_until_install() -> io::Result<()> {
    let pending = waiting()?;
    *HELD.lock().unwrap_or_else(PoisonError::into_inner) = Some(pending);
    Ok(())
}

/// Installs handlers for all signals that do not end a run.
fn waiting() -> io::Result<Pending> {
    for signal in SILENT {
        // Nobody looks at this flag: a signal with a handler does not end the program.
        signal_hook::flag::register(signal, Arc::new(AtomicBool::new(false)))?;
    }
    Pending::new(std::iter::once(SIGHUP).chain(TOLD.iter().map(|(number, _)| *number)))
}

/// Tells whether a signal has asked this process to end.
pub fn ordered_to_stop() -> bool {
    stopped_status().is_some()
}

/// Exit status of work that was stopped before it was done, where a signal asked this process to end.
pub fn stopped_status() -> Option<u8> {
    ORDERED_TO_STOP.get()?.exit_status()
}

/// Order that a signal stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// End the run; the stop flag is set already.
    Stop,
    /// Read the configuration again.
    Reload,
    /// Nothing; the signal's name.
    Nothing(&'static str),
}

/// The signals of a run; what they did before is not put back at its end.
pub struct Signals {
    pending: Pending,
}

impl Signals {
    /// From now on signals are orders; those that end a run set `stop` at once.
    ///
    /// # Errors
    /// If the system refuses a handler.
    pub fn install(stop: &Arc<AtomicBool>) -> io::Result<Self> {
        let ordered = ORDERED_TO_STOP.get_or_init(FirstSignal::default);
        for signal in STOPS {
            signal_hook::flag::register(signal, Arc::clone(stop))?;
            signal_hook::flag::register_usize(
                signal,
                Arc::clone(ordered.newest()),
                usize::try_from(signal).unwrap_or_default(),
            )?;
        }
        let held = HELD.lock().unwrap_or_else(PoisonError::into_inner).take();
        let pending = held.map_or_else(waiting, Ok)?;
        STOPS.iter().try_for_each(|signal| pending.add_signal(*signal))?;
        Ok(Signals { pending })
    }

    /// Orders that came since the last call; does not wait.
    pub fn orders(&mut self) -> Vec<Order> {
        // A look that notes the first signal that ends the run.
        ordered_to_stop();
        self.pending.pending().map(order).collect()
    }
}

fn order(signal: i32) -> Order {
    match signal {
        SIGHUP => Order::Reload,
        _ if STOPS.contains(&signal) => Order::Stop,
        _ => Order::Nothing(TOLD.iter().find(|(number, _)| *number == signal).map_or("a signal", |(_, name)| name)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_signal_has_one_meaning() {
        assert_eq!(order(SIGTERM), Order::Stop);
        assert_eq!(order(SIGHUP), Order::Reload);
        assert_eq!(order(SIGQUIT), Order::Nothing("SIGQUIT"));
        let mut all: Vec<i32> = STOPS.into_iter().chain([SIGHUP]).chain(TOLD.map(|t| t.0)).chain(SILENT).collect();
        let count = all.len();
        all.sort_unstable();
        all.dedup();
        assert_eq!(all.len(), count);
    }
}
