//! `controller rt-test` as a user runs it: what it prints, and its exit status.
//!
//! A test cannot say whether this machine is good enough: it may be shared, and slow at this moment. What is tested is that
//! the verdict, the figures and the exit status say the same, and that what was taken away is named.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::process::Command;
use std::time::Duration;

use serde_json::Value;

mod process;
use process::{Ended, Running, alone, finish, with_small_limits_and, without_real_time_rights};

/// Seconds of a test; half of them under load.
const SECONDS: &str = "3";
/// Edges of the histogram that is printed, in us.
const EDGES: [&str; 9] = ["50", "100", "200", "500", "1000", "2000", "5000", "10000", "20000"];

fn rt_test(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_controller"));
    command.arg("rt-test").args(arguments);
    command
}

/// Numbers behind the `which`-th line of the output that begins so.
fn row(ended: &Ended, name: &str, which: usize) -> Vec<u64> {
    let line = ended.stdout.lines().filter(|line| line.starts_with(name)).nth(which);
    let line = line.unwrap_or_else(|| panic!("no line `{name}`: {ended:?}"));
    line[name.len()..].split_whitespace().filter_map(|word| word.parse().ok()).collect()
}

/// As the first step of a new user: a table, a histogram, the verdict.
#[test]
fn it_prints_how_late_this_machine_is_with_and_without_load() {
    let _alone = alone();
    let ended = finish(&mut rt_test(&["--seconds", SECONDS]));
    let head = ended.stdout.lines().next().unwrap_or_default();
    assert!(head.starts_with("kernel ") && head.contains("the tick's CPU is"), "{ended:?}");
    let edges = ended.stdout.lines().find_map(|line| line.strip_prefix("wakes below, in us"));
    let edges = edges.unwrap_or_else(|| panic!("{ended:?}"));
    assert!(edges.split_whitespace().eq(EDGES.into_iter().chain(["more"])), "{edges}");
    let mut misses = 0;
    for phase in ["quiet", "loaded"] {
        let name = format!("{phase}, as the tick");
        // Times have units behind them; what stands alone is how often it was late, and how often it woke.
        let figures = row(&ended, &name, 0);
        let [late, wakes] = figures[figures.len() - 2..] else { panic!("{figures:?}") };
        let bins = row(&ended, &name, 1);
        assert_eq!((bins.len(), bins.iter().sum::<u64>()), (10, wakes), "{ended:?}");
        assert!(wakes > 0 && late >= bins[8] + bins[9] && late <= bins[7..].iter().sum(), "{ended:?}");
        row(&ended, &format!("{phase}, no priority"), 0);
        misses += late;
    }
    let is_refused = ended.stderr.contains("does not grant what the tick needs");
    let good = ended.stdout.trim_end().ends_with("good: every wake was in time for a tick");
    assert_eq!(good, misses == 0 && !is_refused, "{ended:?}");
    assert_eq!(ended.status, Some(if good { 0 } else { 1 }), "{ended:?}");
    if !good && !is_refused {
        assert!(ended.stderr.contains(&format!("not good: {misses} wakes were more than 6 ms late")), "{ended:?}");
    }
}

/// For programs: one object with the same figures. The load is one: its threads use the processor, which the two that wake do not.
#[test]
fn its_object_says_the_same_as_its_exit_status() {
    let _alone = alone();
    let before = processor_s();
    let ended = finish(&mut rt_test(&["--json", "--seconds", SECONDS]));
    let used_s = processor_s() - before;
    let found: Value = serde_json::from_str(&ended.stdout).unwrap_or_else(|e| panic!("{e}: {ended:?}"));
    let mut misses = 0;
    for phase in ["quiet", "loaded"] {
        let (phase, seconds) = (&found[phase], found[phase]["seconds"].as_f64().unwrap());
        for thread in ["fifo", "normal"] {
            let (wakes, bins) = (&phase[thread]["wakes"], phase[thread]["bins"].as_array().unwrap());
            let sum: u64 = bins.iter().map(|bin| bin.as_u64().unwrap()).sum();
            assert_eq!(Some(sum), wakes.as_u64(), "{found}");
            // One wake in a millisecond; what was slept through is one wake.
            assert!(sum > 0 && sum as f64 <= 1_000.0 * seconds + 1.0, "{found}");
        }
        misses += phase["fifo"]["over_6_ms"].as_u64().unwrap();
    }
    let refused = found["refused"].as_array().unwrap();
    assert_eq!(found["good"], misses == 0 && refused.is_empty(), "{found}");
    assert_eq!(ended.status, Some(if found["good"] == true { 0 } else { 1 }), "{found}");
    // Two threads that wake 1,000 times a second use some hundredths of it; those of the load, however little they are
    // given here, more than a tenth of what all CPUs had.
    let loaded_s = found["loaded"]["seconds"].as_f64().unwrap();
    let cpus = std::thread::available_parallelism().unwrap().get() as f64;
    assert!(used_s > 0.1 * cpus * loaded_s, "{used_s} s of the processor in {loaded_s} s under load");
}

/// Processor time of this process's children that have ended (s): the fields `cutime` and `cstime` of proc_pid_stat(5), in
/// hundredths.
fn processor_s() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap();
    let fields: Vec<&str> = stat.rsplit_once(')').unwrap().1.split_whitespace().collect();
    // The state behind the name is the third field.
    fields[13..15].iter().map(|ticks| ticks.parse::<f64>().unwrap()).sum::<f64>() * 0.01
}

/// Rights that were taken away are at fault, and the lines that give them back are told.
#[test]
fn rights_that_are_missing_are_named_with_the_lines_that_give_them() {
    let Some(mut command) = without_real_time_rights() else { return };
    let _alone = alone();
    let ended = finish(command.arg(env!("CARGO_BIN_EXE_controller")).args(["rt-test", "--seconds", "1"]));
    assert_eq!(ended.status, Some(1), "{ended:?}");
    assert!(ended.stderr.contains("not good: the system does not grant what the tick needs"), "{ended:?}");
    let unwrapped = ended.stdout.split_whitespace().collect::<Vec<_>>().join(" ");
    for words in [
        "at fault no SCHED_FIFO priority",
        "-> give the service LimitRTPRIO=95",
        "at fault memory is not locked",
        "-> give the service LimitMEMLOCK=infinity",
        "/etc/security/limits.d/",
    ] {
        assert!(unwrapped.contains(words), "`{words}` is not in: {ended:?}");
    }
    assert!(!ended.stdout.contains("good: every wake"), "{ended:?}");
}

/// Who holds CAP_IPC_LOCK may lock what it likes, whoever it is and however small the limit.
#[test]
fn memory_is_locked_by_the_capability_where_the_limit_is_small() {
    for (capabilities, is_locked) in [("-all,+ipc_lock", true), ("-all", false)] {
        let Some(mut command) = with_small_limits_and(capabilities) else { return };
        let _alone = alone();
        let ended = finish(command.arg(env!("CARGO_BIN_EXE_controller")).args(["rt-test", "--seconds", "1"]));
        assert_eq!(ended.stdout.contains("memory is not locked"), !is_locked, "{capabilities}: {ended:?}");
        assert!(ended.stdout.contains("no SCHED_FIFO priority"), "{capabilities}: {ended:?}");
    }
}

/// Ctrl-C: what was measured by then is told.
#[test]
fn what_was_measured_is_told_when_it_is_stopped() {
    let _alone = alone();
    let measuring = Running::start(&mut rt_test(&["--seconds", "86400"]));
    measuring.line("measuring for 86400 s");
    // Until the quiet half has something in it.
    std::thread::sleep(Duration::from_millis(500));
    measuring.signal("INT");
    let ended = measuring.wait();
    assert_eq!(ended.status, Some(130), "{ended:?}");
    assert!(row(&ended, "quiet, as the tick", 1).iter().sum::<u64>() > 0, "{ended:?}");
}

#[test]
fn a_time_that_is_none_is_wrong_use() {
    for seconds in ["0", "-1", "nan", "1e9"] {
        let ended = finish(&mut rt_test(&[&format!("--seconds={seconds}")]));
        assert_eq!((ended.status, ended.stderr.lines().count()), (Some(2), 1), "{ended:?}");
        assert!(ended.stderr.contains("give a time from 1 to 86400"), "{ended:?}");
    }
}
