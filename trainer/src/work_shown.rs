//! Progress of long work, as one bar with a whole and the time left on a terminal, and as lines elsewhere.
//!
//! A search does not know how many rounds it will take. What it does know after its first fit is how fast this machine is on these
//! recordings, and how many times as long searches took that were measured. The bar goes by that, and where the work outlasts it,
//! it says so, promises no time any more and goes on ever more slowly.

use std::io::{IsTerminal, Write};
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use proto::live_line;

/// Time between two redraws of the bar, and between two lines where there is no terminal.
const BAR_EVERY: Duration = Duration::from_millis(200);
const LINE_EVERY: Duration = Duration::from_secs(10);
/// Work this short needs no progress.
const SHORT: Duration = Duration::from_secs(1);
const BAR_WIDTH: usize = 20;
/// Share of the expected time from which on the bar slows down, so that it never stands still and is never full before the end.
const SLOWER: f64 = 0.9;
/// Share from which on no time left is told.
const NEARLY: f64 = 0.97;

/// Work that is shown while it lasts.
pub(crate) struct WorkShown {
    state: Arc<Mutex<State>>,
    end: Option<Sender<()>>,
    shows: Option<JoinHandle<()>>,
}

/// State of the work.
#[derive(Debug, Clone)]
struct State {
    stage: String,
    begun: Instant,
    /// Time that all of it will take, once that can be told.
    expected: Option<Duration>,
}

impl WorkShown {
    /// Work that begins now.
    pub(crate) fn begin(stage: &str) -> Self {
        let state = Arc::new(Mutex::new(State { stage: stage.to_owned(), begun: Instant::now(), expected: None }));
        let (end, ended) = mpsc::channel::<()>();
        let terminal = std::io::stderr().is_terminal();
        let seen = Arc::clone(&state);
        let shows = std::thread::spawn(move || {
            let mut wait = SHORT;
            let mut bar_shown = false;
            while ended.recv_timeout(wait) == Err(RecvTimeoutError::Timeout) {
                let state = seen.lock().unwrap_or_else(PoisonError::into_inner).clone();
                let line = state.line(state.begun.elapsed());
                let text = if terminal {
                    live_line::written_over(&bar(&line))
                } else {
                    format!("trainer: {}\n", plain(&line))
                };
                bar_shown |= terminal;
                wait = if terminal { BAR_EVERY } else { LINE_EVERY };
                // Progress that cannot be shown is no reason to stop the work.
                let _ = std::io::stderr().lock().write_all(text.as_bytes());
            }
            if bar_shown {
                let _ = std::io::stderr().lock().write_all(live_line::CLEARED.as_bytes());
            }
        });
        WorkShown { state, end: Some(end), shows: Some(shows) }
    }

    /// The work has come to this stage.
    pub(crate) fn stage(&self, stage: &str) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if state.stage != stage {
            stage.clone_into(&mut state.stage);
        }
    }

    /// All of the work will take about so long, from its beginning.
    pub(crate) fn expect(&self, whole: Duration) {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).expected = Some(whole);
    }
}

impl Drop for WorkShown {
    fn drop(&mut self) {
        drop(self.end.take());
        if let Some(shows) = self.shows.take() {
            // A thread that failed has nothing left to clear.
            let _ = shows.join();
        }
    }
}

/// Line that is shown at a moment.
#[derive(Debug, Clone, PartialEq)]
struct Line {
    stage: String,
    elapsed: Duration,
    /// Share that is done, and the time left; `None` of either where that is not known.
    share: Option<f64>,
    left: Option<Duration>,
}

impl State {
    fn line(&self, elapsed: Duration) -> Line {
        let share = self.expected.map(|whole| elapsed.as_secs_f64() / whole.as_secs_f64().max(1e-3));
        let left = self.expected.and_then(|whole| whole.checked_sub(elapsed)).filter(|_| share < Some(NEARLY));
        Line { stage: self.stage.clone(), elapsed, share: share.map(slowing), left }
    }
}

/// The share of the bar at a share of the expected time: the same at first, then ever less, at the same pace where they meet.
fn slowing(share: f64) -> f64 {
    let beyond = share - SLOWER;
    if beyond <= 0.0 { share } else { 1.0 - (1.0 - SLOWER) / (1.0 + beyond / (1.0 - SLOWER)) }
}

/// Whole per cent, 100 at the end alone.
fn percent(share: f64) -> f64 {
    (100.0 * share).floor()
}

impl Line {
    fn times(&self) -> String {
        let left = match (self.share, self.left) {
            (_, Some(left)) => format!(", about {} left", clock(left)),
            (Some(_), None) => ", longer than most".to_owned(),
            (None, None) => String::new(),
        };
        format!("{}{left}", clock(self.elapsed))
    }
}

fn bar(line: &Line) -> String {
    let share = line.share.unwrap_or(0.0);
    let full = ((share * BAR_WIDTH as f64) as usize).min(BAR_WIDTH);
    let (done, left) = ("#".repeat(full), "-".repeat(BAR_WIDTH - full));
    format!("[{done}{left}] {:3.0} %  {}  {}", percent(share), line.times(), line.stage)
}

fn plain(line: &Line) -> String {
    let share = line.share.map_or(String::new(), |share| format!(" ({:.0} %)", percent(share)));
    format!("{}: {}{share}", line.times(), line.stage)
}

/// Minutes and seconds: `1:07`.
pub(crate) fn clock(time: Duration) -> String {
    format!("{}:{:02}", time.as_secs() / 60, time.as_secs() % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(elapsed_s: u64, expected_s: Option<u64>) -> Line {
        let expected = expected_s.map(Duration::from_secs);
        let state = State { stage: "trying mechanisms".to_owned(), begun: Instant::now(), expected };
        state.line(Duration::from_secs(elapsed_s))
    }

    #[test]
    fn the_time_left_is_told_once_it_is_known_and_not_after_it_has_run_out() {
        assert_eq!(plain(&at(5, None)), "0:05: trying mechanisms");
        assert_eq!(plain(&at(20, Some(80))), "0:20, about 1:00 left: trying mechanisms (25 %)");
        assert_eq!(plain(&at(90, Some(80))), "1:30, longer than most: trying mechanisms (96 %)");
        // Work that takes several times as long as most goes on to be seen, and is not done before it is.
        let shares: Vec<f64> = (0..500).map(|s| percent(at(s, Some(80)).share.unwrap())).collect();
        assert!(shares.windows(2).all(|pair| pair[1] >= pair[0]) && shares[499] == 99.0, "{shares:?}");
        assert!(shares[90] < shares[120] && shares[120] < shares[200], "{shares:?}");
        assert_eq!(bar(&at(20, Some(80))), "[#####---------------]  25 %  0:20, about 1:00 left  trying mechanisms");
    }
}
