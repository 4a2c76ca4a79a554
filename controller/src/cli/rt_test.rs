//! `controller rt-test`: how late this machine is, what is at fault, and the line that changes it.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use clap::Args;
use controller::config::{Config, Realtime};
use controller::machine::rt_test::finding::{Finding, Weight, findings};
use controller::machine::rt_test::lateness::{EDGES_US, LatenessFigures};
use controller::machine::rt_test::{Phase, RtTest};
use controller::machine::signals::{Signals, ordered_to_stop};
use serde_json::json;

use super::Failure;
use super::console::{say, tell};

/// Measures how late this machine wakes a real-time thread, with and without load
///
/// A thread with the tick's priority and CPU wakes every millisecond; a wake more than 6 ms late would have cost a
/// tick. What is at fault is named with the line that changes it. Exit status 1: a tick would have been late, or
/// priority or locked memory are not granted.
#[derive(Debug, Args)]
#[command(after_help = "Example:
  sudo -u dual-pressure controller rt-test \\
    --config /etc/dual-pressure/controller.toml")]
pub(crate) struct RtTestArgs {
    /// Seconds it takes, half of them under load
    #[arg(long, default_value_t = 20.0, value_name = "S")]
    seconds: f64,
    /// Configuration file, for [realtime]; without it the defaults
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Print one JSON object, and nothing else on standard output
    #[arg(long)]
    json: bool,
}

impl RtTestArgs {
    pub(super) fn run(self) -> Result<(), Failure> {
        if !(self.seconds >= 1.0 && self.seconds <= 86_400.0) {
            return Err(Failure::input(format!("--seconds {:?}: give a time from 1 to 86400", self.seconds)));
        }
        let settings = match &self.config {
            Some(file) => Config::read(file)?.realtime,
            None => Realtime::default(),
        };
        let _signals = Signals::install(&Arc::new(AtomicBool::new(false))).map_err(Failure::work)?;
        if !self.json {
            tell(format_args!("measuring for {:.0} s, half of them under load of its own", self.seconds));
        }
        let test = RtTest::run(&settings, self.seconds, &ordered_to_stop).map_err(Failure::work)?;
        let found = findings(&test);
        if self.json {
            let mut object = serde_json::to_value(&test).map_err(Failure::work)?;
            object["good"] = test.is_good().into();
            object["findings"] = json!(found);
            say(object);
        } else {
            say(text(&test, &found));
        }
        if test.seconds() < self.seconds {
            return Err(Failure::work(format!("stopped after {:.1} of {} s", test.seconds(), self.seconds)));
        }
        if test.is_good() { Ok(()) } else { Err(Failure::not_good(verdict(&test))) }
    }
}

fn verdict(test: &RtTest) -> String {
    match (test.refused.is_empty(), test.misses()) {
        (false, _) => "not good: the system does not grant what the tick needs".to_owned(),
        (true, misses) => format!("not good: {misses} wakes were more than 6 ms late"),
    }
}

fn text(test: &RtTest, found: &[Finding]) -> String {
    let machine = &test.machine;
    let preemption = machine.preemption.as_deref().unwrap_or("unknown");
    let mut out = format!(
        "kernel {}, preemption {preemption}, {} CPUs{}; the tick's CPU is {}\n\n",
        machine.kernel,
        machine.cpus,
        if machine.virtual_machine { ", virtual" } else { "" },
        test.cpu
    );
    out.push_str("lateness of a wake     median      99 %    99.9 %       max   > 6 ms     wakes\n");
    for (name, phase) in [("quiet", &test.quiet), ("loaded", &test.loaded)] {
        out.push_str(&row(&format!("{name}, as the tick"), &phase.fifo));
        out.push_str(&row(&format!("{name}, no priority"), &phase.normal));
    }
    out.push('\n');
    out.push_str(&histogram([("quiet, as the tick", &test.quiet), ("loaded, as the tick", &test.loaded)]));
    out.push('\n');
    for finding in found {
        let word = if finding.weight == Weight::Fault { "at fault" } else { "perhaps" };
        out.push_str(&wrapped(&format!("{word:<9} {}", finding.what)));
        out.push_str(&format!("          -> {}\n", finding.fix));
    }
    out.push_str(match (test.is_good(), found.is_empty()) {
        (true, _) => "good: every wake was in time for a tick",
        (false, true) => "nothing is known to be at fault; look at /proc/interrupts and at what else runs",
        (false, false) => "change what is at fault first, then measure again",
    });
    out
}

fn row(name: &str, figures: &LatenessFigures) -> String {
    let time = |us: f64| if us < 1_000.0 { format!("{us:.0} us") } else { format!("{:.1} ms", us / 1_000.0) };
    format!(
        "{name:<19}{:>10}{:>10}{:>10}{:>10}{:>9}{:>10}\n",
        time(figures.p50_us),
        time(figures.p99_us),
        time(figures.p999_us),
        time(figures.max_us),
        figures.over_6_ms,
        figures.wakes
    )
}

/// Table of the wakes of each phase that were less late than each edge and later than the edge before it.
fn histogram(phases: [(&str, &Phase); 2]) -> String {
    let longest = phases.iter().flat_map(|(_, phase)| phase.fifo.bins).max().unwrap_or(0).to_string().len();
    // Room for an edge and a space, or for the largest count and one.
    let width = (longest + 1).max(6);
    let mut out = format!("{:<19}", "wakes below, in us");
    EDGES_US.iter().for_each(|edge| out.push_str(&format!("{edge:>width$}")));
    out.push_str(&format!("{:>width$}\n", "more"));
    for (name, Phase { fifo, .. }) in phases {
        out.push_str(&format!("{name:<19}"));
        fifo.bins.iter().for_each(|count| out.push_str(&format!("{count:>width$}")));
        out.push('\n');
    }
    out
}

/// Lines of at most 80 columns, the further ones indented.
fn wrapped(text: &str) -> String {
    let (mut out, mut width) = (String::new(), 0);
    for word in text.split_inclusive(' ') {
        if width + word.trim_end().chars().count() > 80 {
            out.truncate(out.trim_end().len());
            out.push_str("\n          ");
            width = 10;
        }
        out.push_str(word);
        width += word.chars().count();
    }
    out.truncate(out.trim_end().len());
    out.push('\n');
    out
}
