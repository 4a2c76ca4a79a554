//! Progress of long work: a bar on a terminal, plain lines elsewhere, nothing for short work.
//!
//! On standard error, so that results on standard output stay clean.

use std::io::{IsTerminal, Write};
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use proto::live_line;

use crate::work_shown::clock;

/// Work this short needs no progress.
const SHORT: Duration = Duration::from_secs(1);
const BAR_EVERY: Duration = Duration::from_millis(100);
const LINE_EVERY: Duration = Duration::from_secs(5);
const BAR_WIDTH: usize = 30;

/// Share of the work that must be done before its pace says when the rest will be: before that a few steps are all there is to go by.
const TELLING: f64 = 0.05;

/// Progress of work with a known number of steps.
#[derive(Debug)]
pub(crate) struct Progress {
    what: String,
    total: u64,
    done: u64,
    terminal: bool,
    /// Beginning of steps that take alike, whose pace says when the rest will be done.
    paced_from: Option<Instant>,
    next: Instant,
    bar_shown: bool,
}

impl Progress {
    /// Work of `total` steps that begins now.
    pub(crate) fn new(what: &str, total: u64) -> Self {
        Progress {
            what: what.to_owned(),
            total: total.max(1),
            done: 0,
            terminal: std::io::stderr().is_terminal(),
            paced_from: None,
            next: Instant::now() + SHORT,
            bar_shown: false,
        }
    }

    /// A line that stays, above the bar.
    pub(crate) fn tell(&mut self, line: &str) {
        let cleared = if self.bar_shown { live_line::CLEARED } else { "" };
        let _ = std::io::stderr().lock().write_all(format!("{cleared}{line}\n").as_bytes());
        self.bar_shown = false;
        self.next = Instant::now();
    }

    /// Steps that take alike begin here: from now on their pace says how much time is left.
    pub(crate) fn begin_even_steps(&mut self) {
        self.paced_from = Some(Instant::now());
    }

    /// `steps` more are done.
    pub(crate) fn advance(&mut self, steps: u64) {
        self.done += steps;
        let now = Instant::now();
        if now < self.next {
            return;
        }
        let left = self.paced_from.and_then(|began| left(self.done, self.total, now.duration_since(began)));
        let left = left.map_or(String::new(), |left| format!(", about {} left", clock(left)));
        let text = if self.terminal {
            self.next = now + BAR_EVERY;
            self.bar_shown = true;
            live_line::written_over(&format!("{}{left}", bar(&self.what, self.done, self.total)))
        } else {
            self.next = now + LINE_EVERY;
            format!("{}: {} %{left}\n", self.what, percent(self.done, self.total))
        };
        // Progress that cannot be shown is no reason to stop the work.
        let _ = std::io::stderr().lock().write_all(text.as_bytes());
    }
}

impl Progress {
    /// Takes a step of work that asks whether to go on: it does.
    pub(crate) fn go_on(&mut self, steps: u64) -> ControlFlow<()> {
        self.advance(steps);
        ControlFlow::Continue(())
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if self.bar_shown {
            let _ = std::io::stderr().lock().write_all(live_line::CLEARED.as_bytes());
        }
    }
}

/// Time that the rest takes at the pace of the steps so far; `None` before these tell it, and at the end.
fn left(done: u64, total: u64, elapsed: Duration) -> Option<Duration> {
    let rest = total.checked_sub(done).filter(|rest| *rest > 0)?;
    (done as f64 >= TELLING * total as f64 && done > 0).then(|| elapsed.mul_f64(rest as f64 / done as f64))
}

fn percent(done: u64, total: u64) -> u64 {
    (100 * done.min(total)).checked_div(total).unwrap_or(100)
}

fn bar(what: &str, done: u64, total: u64) -> String {
    let percent = percent(done, total);
    let full = BAR_WIDTH * usize::try_from(percent).unwrap_or(100) / 100;
    format!("{what} [{}{}] {percent:3} %", "#".repeat(full), "-".repeat(BAR_WIDTH - full))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bar_runs_from_empty_to_full_and_no_further() {
        assert_eq!(bar("x", 0, 7), format!("x [{}]   0 %", "-".repeat(30)));
        assert_eq!(bar("x", 1, 2), format!("x [{}{}]  50 %", "#".repeat(15), "-".repeat(15)));
        assert_eq!(bar("x", 9, 7), format!("x [{}] 100 %", "#".repeat(30)));
    }

    #[test]
    fn the_time_left_goes_by_the_pace_of_the_steps_and_is_told_once_there_is_one() {
        let after = |done, s| left(done, 80, Duration::from_secs(s));
        assert_eq!((after(0, 5), after(3, 5), after(80, 160), after(81, 160)), (None, None, None, None));
        // 2 s a step.
        assert_eq!((after(4, 8), after(60, 120)), (Some(Duration::from_secs(152)), Some(Duration::from_secs(40))));
        assert_eq!(left(0, 0, Duration::from_secs(1)), None);
    }
}
