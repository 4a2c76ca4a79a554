//! Between whatever decides and the valves: slow duties in HOLD, the safety filter, and how often it had to act.

use model::observation::MOST_CHANGE_DUTY;
use monitor::LossWindow;
use monitor::loss_window::Outcome;
use proto::recording::TickRecord;
use proto::wire::Mode;
use safety_filter::Intervention;
use supervisor::{Condition, Integration};

use super::Cycle;
use crate::cycle::duty_source::{ActuatorCommand, DutySource, NoticeSink, Steering};
use crate::operator::notice::Notice;

/// The most that a duty moves in a tick of HOLD: half of what it may otherwise (study of the daemon, §3.4).
const HOLD_SLEW_DUTY: f64 = 0.5 * MOST_CHANGE_DUTY;
/// Ticks without a bent command after which the next one is told again: a second.
const FILTER_TOLD_AGAIN: u32 = 50;
/// Newest commands among which bent ones are counted (study of the daemon, §3.6).
const FILTER_TICKS: u32 = 50;
/// Bent commands of [`FILTER_TICKS`] above which the policy is not trusted (study of the daemon, §3.6).
const FILTER_TO_REVERT: u32 = 20;

/// Counter of how often the safety filter had to bend a command toward vent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct FilterWatch {
    bent: LossWindow,
}

impl FilterWatch {
    /// Nothing was bent yet.
    pub(super) fn new() -> Self {
        FilterWatch { bent: LossWindow::new() }
    }

    /// Takes a command; how many of the newest were bent.
    fn push(&mut self, outcome: Outcome) -> u32 {
        self.bent.push(outcome);
        self.bent.count_newest(FILTER_TICKS)
    }

    /// Tells whether it had been quiet for so long that the next one is told.
    fn is_quiet(&self) -> bool {
        self.bent.count_newest(FILTER_TOLD_AGAIN) == 0
    }
}

impl<H: DutySource> Cycle<H> {
    /// In HOLD duties move slowly.
    pub(super) fn held(&self, wanted: ActuatorCommand, last: ActuatorCommand) -> ActuatorCommand {
        if self.action.is_none_or(|action| action.integration == Integration::On) {
            return wanted;
        }
        let duty = std::array::from_fn(|c| {
            wanted.duty[c].clamp(last.duty[c] - HOLD_SLEW_DUTY, last.duty[c] + HOLD_SLEW_DUTY).clamp(0.0, 1.0)
        });
        ActuatorCommand { duty, mode: Mode::Hold, ..wanted }
    }

    /// The command that may be sent in place of the one that was asked for: the one place between whatever decides and the
    /// valves.
    pub(super) fn filtered(
        &mut self,
        asked: ActuatorCommand,
        record: &mut TickRecord,
        tell: NoticeSink<'_>,
    ) -> ActuatorCommand {
        let filtered = self.filter.limit(asked.duty);
        record.command_before_filter = asked.duty;
        record.filter_active = filtered.intervention != Intervention::None;
        let bent = filtered.intervention > Intervention::Slew;
        if bent && self.filter_watch.is_quiet() {
            tell(Notice::Filtered { tick: self.tick, asked: asked.duty, measured: self.measured });
        }
        let of_50 = self.filter_watch.push(if bent { Outcome::Bad } else { Outcome::Good });
        // An experiment is played as it is, and what it asks for is nobody's fault.
        if of_50 > FILTER_TO_REVERT && self.duty_source.steering() == Steering::ClosedLoop {
            self.report(Condition::FilterBusy, f64::from(of_50));
        }
        ActuatorCommand { duty: filtered.duty, ..asked }
    }

    /// Commands that the safety filter has changed since the start.
    pub fn filter_interventions(&self) -> u64 {
        self.filter.interventions()
    }
}
