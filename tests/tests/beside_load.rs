//! The daemon in real time, on a machine that has other things to do: no tick is missed that an oracle beside it does not excuse,
//! and none is lost while policies change. An hour of the same is the example `oracle_hour`.
//!
//! Where the system gives no priority the oracle tells nothing; what does not hang on it is tested all the same.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use controller::config::Realtime;
use controller::machine::realtime::make_realtime;
use controller::operator::mailbox::{Status, mailbox};
use controller::operator::socket::Ask;
use controller::state::State;
use flight::Recorded;
use proto::recording::{EventLevel, TickRecord};
use rustix::thread::{CpuSet, sched_setaffinity};
use tests::in_process::Daemon;
use tests::oracle::{CrioProcess, Oracles, Verdict, Witness, attend, be_the_crio};
use tests::{Folder, alone};

/// Set for the process of the test below that is the cRIO.
const IS_THE_CRIO: &str = "IS_THE_CRIO";

/// Between two looks of an operator: longer than a policy that has controlled before takes to all of the command.
const LOOK: Duration = Duration::from_secs(1);

/// No test: this program, started anew, is the emulated cRIO of the others, which waits for no lock of theirs.
#[test]
#[ignore = "started by the tests of this file"]
fn the_crio_itself() {
    if std::env::var_os(IS_THE_CRIO).is_some() {
        be_the_crio();
    }
}

/// A daemon beside the oracle, and nothing else of this program, that controls for this long, or until its operator has enough; its
/// ticks, and the verdict.
fn flown(
    policy: &str,
    time: Duration,
    mut operator: impl FnMut(&Daemon, Option<State>) -> Enough,
) -> (Vec<TickRecord>, Verdict) {
    let folder = Folder::new();
    let mut command = Command::new(std::env::current_exe().unwrap());
    let command = command.args(["--exact", "the_crio_itself", "--ignored", "--nocapture"]).env(IS_THE_CRIO, "1");
    let crio = CrioProcess::start(command);
    let config = folder.write(
        "controller.toml",
        format!(
            "link.address = \"{}\"\nrecord.directory = \"recordings\"\nrecord.min_free_mib = 16\ncontrol.socket = \"s\"\n\
             control.auto_arm = true\nreference.repeat = true\nrealtime.enforce = false\n{policy}\n",
            crio.address()
        ),
    );
    let ticks = Arc::new(Mutex::new(Vec::new()));
    let kept = Arc::clone(&ticks);
    let daemon = Daemon::start(&config, move |recorded| match recorded {
        Recorded::Tick(tick) => kept.lock().unwrap().push(*tick),
        Recorded::Event { level: EventLevel::Info, .. } => {}
        Recorded::Event { message, .. } => println!("the daemon: {message}"),
    });
    let oracles = Oracles::start();
    let until = Instant::now() + time;
    while operator(&daemon, attend(&daemon)) == Enough::NotYet && Instant::now() < until {
        assert!(!daemon.is_over(), "the daemon has ended by itself");
        std::thread::sleep(LOOK);
    }
    daemon.end();
    let ticks = std::mem::take(&mut *ticks.lock().unwrap());
    let mut witness = Witness::default();
    ticks.iter().for_each(|tick| witness.see(tick));
    let verdict = Verdict::of(&witness, oracles, crio);
    println!("{}", verdict.text);
    (ticks, verdict)
}

/// Answer of an operator who is asked whether the run may end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Enough {
    Yes,
    NotYet,
}

/// No miss that nothing excuses, where the oracle could see.
fn check(verdict: &Verdict) {
    if verdict.refused.is_empty() {
        assert!(verdict.unexcused.is_empty(), "{:#?}\n{}", verdict.unexcused, verdict.text);
    } else {
        println!("SKIPPED: the oracle has no priority here: {}", verdict.refused.join("; "));
    }
}

/// Priority of the thread that ticks every 0.1 ms: any holds up a reader of none, and a low one no other daemon of this machine.
const PRIORITY: u8 = 10;

/// Threads of ordinary priority that compute, two for each CPU, until they are dropped.
struct Load(Arc<AtomicBool>);

impl Load {
    fn start() -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        for _ in 0..2 * std::thread::available_parallelism().map_or(1, usize::from) {
            let stop = Arc::clone(&stop);
            std::thread::spawn(move || {
                let mut x = 1.0_f64;
                while !stop.load(Ordering::Relaxed) {
                    x = std::hint::black_box((1.000_1 * x).sin() + 1.0);
                }
            });
        }
        Load(stop)
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Sets a flag when a thread ends, by a panic too.
struct SetAtEnd<'a>(&'a AtomicBool);

impl Drop for SetAtEnd<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Tests of the thorough tier (docs/testing.md).
mod thorough {
    use super::*;

    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn a_minute_beside_the_oracle_has_no_miss_that_nothing_excuses() {
        let _alone = alone();
        let minute = Duration::from_secs(60);
        let (ticks, verdict) = flown("policy.active = \"default\"", minute, |_, _| Enough::NotYet);
        // 50 in a second; a machine that stands still for long loses some.
        assert!(ticks.len() > 2_000 && verdict.controlled > 1_000, "{}", verdict.text);
        check(&verdict);
    }

    /// An ordinary thread on the tick's processor that looks at what the tick shows, all the time: sooner or later the tick interrupts
    /// it in the middle of that. Whoever then waits for it waits until the kernel takes the processor from him, about a second.
    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn a_reader_that_the_tick_interrupts_holds_up_no_tick() {
        // Between the longest that this machine's host is likely to stand still and that second.
        const HELD_UP: Duration = Duration::from_millis(400);
        let _alone = alone();
        let cpu = std::thread::available_parallelism().map_or(1, usize::from) - 1;
        let (tick, desk) = mailbox();
        let is_over = &AtomicBool::new(false);
        let (refused, shown, longest) = std::thread::scope(|scope| {
            scope.spawn(move || {
                let mut only = CpuSet::new();
                only.set(cpu);
                sched_setaffinity(None, &only).expect("the tick's CPU");
                while !is_over.load(Ordering::Relaxed) {
                    std::hint::black_box(desk.status());
                }
            });
            let ticking = scope.spawn(move || {
                let _over = SetAtEnd(is_over);
                let refused = make_realtime(&Realtime { cpu: Some(cpu), priority: PRIORITY, ..Realtime::default() });
                let (until, mut shown, mut longest) = (Instant::now() + Duration::from_secs(20), 0, Duration::ZERO);
                while Instant::now() < until && refused.is_empty() {
                    std::thread::sleep(Duration::from_micros(100));
                    let begun = Instant::now();
                    tick.show(Status::default());
                    (shown, longest) = (shown + 1, longest.max(begun.elapsed()));
                }
                (refused, shown, longest)
            });
            ticking.join().unwrap()
        });
        if refused.is_empty() {
            println!("{shown} times shown, in {longest:?} at most");
            assert!(shown > 1_000 && longest < HELD_UP, "{shown} times shown, in {longest:?} at most");
        } else {
            println!("SKIPPED: no thread can be given the tick's priority here: {}", refused.join("; "));
        }
    }

    /// Each is the operator's: to the fallback, and back to the policy before it, which has half a second to all of the command and
    /// is then on probation.
    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn dozens_of_swaps_under_load_lose_no_tick_and_move_no_duty_too_far() {
        const SWAPS: usize = 48;
        let _alone = alone();
        let _load = Load::start();
        let (patience, mut swaps) = (Duration::from_secs(10 * SWAPS as u64), 0);
        let policy = "policy.active = \"default\"\npolicy.when_behind = \"fly\"";
        let (ticks, verdict) = flown(policy, patience, |daemon, state| {
            if state == Some(State::Run) {
                let swap = if swaps % 2 == 0 { Ask::Swap { name: "fallback".to_owned() } } else { Ask::Rollback {} };
                swaps += usize::from(daemon.ask(&swap).is_some_and(|reply| reply.ok));
            }
            if swaps < SWAPS { Enough::NotYet } else { Enough::Yes }
        });
        let run = State::Run.code();
        let (mut changes, mut gaps) = (0, 0);
        for pair in ticks.windows(2) {
            let [before, after] = pair else { continue };
            if before.session != after.session {
                continue;
            }
            let ticks_apart = after.tick.wrapping_sub(before.tick);
            gaps += usize::from(ticks_apart > 1);
            if before.state != run || after.state != run {
                continue;
            }
            changes += usize::from((before.authority, before.swap_id) != (after.authority, after.swap_id));
            for (a, b) in [(before.u_pos, after.u_pos), (before.u_neg, after.u_neg)] {
                let most = 0.1 * f64::from(ticks_apart) + 1e-9;
                assert!((a - b).abs() <= most, "tick {}: from {a} to {b} in {ticks_apart} ticks", after.tick);
            }
        }
        println!("{swaps} swaps, {changes} ticks in which somebody's authority changed, {gaps} gaps");
        assert!(swaps == SWAPS && changes >= 2 * swaps, "{swaps} swaps, {changes} changes: {}", verdict.text);
        check(&verdict);
        if verdict.refused.is_empty() {
            assert_eq!(gaps, verdict.excused_gaps, "ticks that are lost: {}", verdict.text);
        }
    }
}
