//! Messages to people about a tick: each transition, exploration, and venting in doubt again and again.

use handover::ExplorationShown;
use supervisor::{Arming, Condition, State, Transition};

use super::Cycle;
use super::filtering::FilterWatch;
use crate::cycle::duty_source::{DutySource, NoticeSink, Steering};
use crate::operator::notice::Notice;

/// Ticks between two reminders that venting is in doubt: 5 s (chosen).
const REMIND_TICKS: u32 = 250;

impl<H: DutySource> Cycle<H> {
    /// Tells once that exploration has begun or has ended, whatever ended it.
    pub(super) fn tell_exploration(&mut self, tell: NoticeSink<'_>) {
        let now = self.duty_source.exploration();
        if now == self.exploration {
            return;
        }
        self.exploration = now;
        let tick = self.tick;
        tell(match now {
            Some(ExplorationShown { seed, std_duty, .. }) => Notice::Exploring { tick, seed, std_duty },
            None => Notice::ExplorationOver { tick },
        });
    }

    /// Tells a transition, and the parts that it concerns.
    pub(super) fn tell_transition(&mut self, transition: Transition, tell: NoticeSink<'_>) {
        let tick = self.tick;
        match transition {
            Transition::None | Transition::SessionOpened => {}
            Transition::Stopped => tell(Notice::Stopped { tick }),
            Transition::Armed(arming) => {
                self.monitor.armed();
                self.filter_watch = FilterWatch::new();
                self.duty_source.armed(tick, self.measured);
                tell(match self.duty_source.steering() {
                    Steering::ClosedLoop => Notice::Armed { tick, auto: arming == Arming::Automatic },
                    Steering::OpenLoop => Notice::FirstRow { tick },
                });
            }
            Transition::Disarmed => {
                self.duty_source.explore(None);
                tell(Notice::Disarmed { tick });
            }
            Transition::Vented(cause) | Transition::Faulted(cause) => {
                let value = self.conditions.value(cause);
                self.duty_source.stopped(Some((cause, value)));
                tell(Notice::Vented { cause, tick, value });
            }
            Transition::Disconnected(cause) => {
                self.duty_source.stopped(Some((cause, self.conditions.value(cause))));
                tell(Notice::Disconnected { cause, tick });
            }
            Transition::Held(condition) => {
                // A missing frame has a line of its own.
                if condition != Condition::FrameMissing {
                    self.duty_source.explore(None);
                    tell(Notice::Held { condition, tick, value: self.conditions.value(condition) });
                }
            }
            Transition::Resumed => {}
            Transition::Reverted(condition) => {
                tell(Notice::Reverted { condition, tick, value: self.conditions.value(condition) });
            }
            Transition::Returned => tell(Notice::Returned { tick }),
            Transition::Recovered => tell(Notice::Recovered { tick }),
        }
    }

    /// Venting in doubt is told again and again.
    pub(super) fn remind(&mut self, tell: NoticeSink<'_>) {
        if self.state() != State::Fault {
            self.faulted_ticks = 0;
            return;
        }
        self.faulted_ticks += 1;
        if self.faulted_ticks.is_multiple_of(REMIND_TICKS)
            && let Some(cause) = self.memory.cause
        {
            let seconds = f64::from(self.faulted_ticks) / 50.0;
            tell(Notice::StillFaulted { cause, tick: self.tick, seconds, measured_kpa: self.measured });
        }
    }
}
