//! Progress of a training run: one bar over all of it on a terminal, plain lines elsewhere.

use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

use proto::live_line;
use training::{Phase, Progress, TrainingCallback};

use crate::stop_signal::StopSignal;

const BAR_EVERY: Duration = Duration::from_millis(200);
const LINE_EVERY: Duration = Duration::from_secs(15);
const BAR_WIDTH: usize = 20;

/// Shows a run's progress, and tells it to stop when a signal came.
pub(crate) struct TrainBar {
    stop: StopSignal,
    terminal: bool,
    next: Instant,
    is_shown: bool,
    phase: Option<Phase>,
}

impl TrainBar {
    /// A bar that stops the run once a signal has come, and lets a second one end the program once nothing can be lost any more.
    pub(crate) fn new(stop: StopSignal) -> Self {
        let terminal = std::io::stderr().is_terminal();
        TrainBar { stop, terminal, next: Instant::now(), is_shown: false, phase: None }
    }

    /// Leaves a clean line.
    pub(crate) fn clear(&mut self) {
        if self.is_shown {
            write(live_line::CLEARED);
            self.is_shown = false;
        }
    }
}

impl TrainingCallback for TrainBar {
    fn progress(&mut self, p: &Progress) {
        let now = Instant::now();
        // On a terminal a change of what is done shows at once: an evaluation takes some seconds.
        let is_new = self.terminal && self.phase != Some(p.phase);
        if now < self.next && !is_new {
            return;
        }
        self.phase = Some(p.phase);
        if self.terminal {
            // What comes after the last step takes its time as well.
            let percent = (100 * p.steps / p.steps_planned.max(1)).min(99);
            let full = BAR_WIDTH * usize::try_from(percent).unwrap_or(99) / 100;
            let bar = format!("[{}{}] {percent:3} %", "#".repeat(full), "-".repeat(BAR_WIDTH - full));
            write(&live_line::written_over(&format!("{bar} {}", figures(p))));
            self.is_shown = true;
            self.next = now + BAR_EVERY;
        } else {
            write(&format!("step {} of {}: {}\n", p.steps, p.steps_planned, figures(p)));
            self.next = now + LINE_EVERY;
        }
    }

    fn stop(&self) -> bool {
        self.stop.has_come()
    }

    fn is_kept(&mut self) {
        self.stop.may_end();
    }
}

/// Figures beside the bar: the time left, the work that is being done, and how well; within 57 characters, so that bar and figures
/// fit 80. A narrower terminal cuts off what stands last.
fn figures(p: &Progress) -> String {
    let left = p.left_s.map_or(String::new(), |s| format!("{}:{:02} left, ", s as u64 / 60, s as u64 % 60));
    let last = p.last_evaluation.as_ref();
    let evaluated = last.map_or(String::new(), |e| format!(", RMSE {:.2}/{:.2} kPa", e.rmse_kpa[0], e.rmse_kpa[1]));
    match p.phase {
        Phase::GoingOn => "going back into the episode".to_owned(),
        Phase::Evaluating => format!("{left}evaluating{evaluated}"),
        Phase::FittingPlan => "fitting the plan".to_owned(),
        Phase::Learning => format!("{left}{:.0} steps/s{evaluated}", p.steps_per_s),
    }
}

fn write(text: &str) {
    // Progress that cannot be shown is no reason to stop the work.
    let _ = std::io::stderr().lock().write_all(text.as_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_fits_a_terminal_and_says_what_is_left() {
        let progress = Progress {
            phase: Phase::Evaluating,
            steps: 1,
            steps_planned: 2,
            steps_per_s: 1234.0,
            left_s: Some(3661.0),
            reward: None,
            acting_rmse_kpa: [0.0; 2],
            last_evaluation: None,
        };
        assert_eq!(figures(&progress), "61:01 left, evaluating");
        assert_eq!(figures(&Progress { phase: Phase::Learning, left_s: None, ..progress }), "1234 steps/s");
    }
}
