//! Requests to a cycle: by an operator, by whoever runs an experiment. It counts in the next tick.

use handover::ExplorationRules;
use proto::reference::Reference;
use supervisor::Request;

use super::Cycle;
use crate::cycle::duty_source::{Afterwards, DutySource, NoticeSink, Steering};
use crate::experiment::open_loop_playback::OpenLoopPlayback;
use crate::operator::notice::Notice;

impl<H: DutySource> Cycle<H> {
    /// The operator asks to arm; it happens in the next tick or not at all.
    pub fn arm(&mut self) {
        // An experiment arms by itself, once the rig stands at rest.
        if self.duty_source.steering() == Steering::ClosedLoop {
            self.ask(Request::Arm);
        }
    }

    /// The operator has looked at what was wrong.
    pub fn acknowledge(&mut self) {
        self.ask(Request::Acknowledge);
    }

    /// The operator asks to disarm.
    pub fn disarm(&mut self) {
        self.ask(Request::Disarm);
        self.duty_source.stopped(None);
    }

    /// Plays an experiment from the next tick on, which first opens both vents; hands it back where that cannot be.
    ///
    /// # Real-time
    /// Runs in the tick.
    ///
    /// # Errors
    /// The experiment: another one is under way, or nothing is steered for that could go on afterwards.
    pub fn begin_experiment(
        &mut self,
        playback: Box<OpenLoopPlayback>,
        tell: NoticeSink<'_>,
    ) -> Result<(), Box<OpenLoopPlayback>> {
        let rows = playback.rows();
        let afterwards = if self.state().is_controlling() { Afterwards::Armed } else { Afterwards::StandingBy };
        self.duty_source.begin_experiment(playback, afterwards)?;
        // In standby as well, where it only takes the leave to arm by itself: an experiment may end before it has armed.
        self.ask(Request::Disarm);
        tell(Notice::ExperimentBegins { tick: self.tick, rows });
        Ok(())
    }

    /// Explores around the active policy from the next tick on, or no more; only while the rig is controlled.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn explore(&mut self, rules: Option<ExplorationRules>) {
        self.duty_source.explore(rules.filter(|_| self.state().is_controlling()));
    }

    /// The experiment that is over, to be dropped outside the tick.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn take_finished_experiment(&mut self) -> Option<Box<OpenLoopPlayback>> {
        self.duty_source.take_finished_experiment()
    }

    /// Ends the experiment that is under way, and hands it back: there will be no further tick.
    pub fn end_experiment(&mut self) -> Option<Box<OpenLoopPlayback>> {
        self.duty_source.session_over();
        self.duty_source.take_finished_experiment()
    }

    /// Takes a request; the safer of several in one tick counts.
    pub(super) fn ask(&mut self, request: Request) {
        self.request = self.request.max(Some(request));
    }

    /// Puts in another reference, which starts at once, and hands back the old one, to be dropped elsewhere.
    pub fn exchange_reference(&mut self, reference: Box<Reference>) -> Box<Reference> {
        let running = self.state().is_controlling().then_some((self.tick, self.measured));
        self.duty_source.exchange_reference(reference, running)
    }
}

#[cfg(test)]
mod tests {
    use proto::wire::{CrioState, Mode, TripBits};

    use super::*;
    use crate::cycle::tests::{SOUND, answer, cycle, sense};
    use crate::experiment::command_sequence::Row;
    use crate::experiment::pump_relay::PumpRelay;
    use crate::state::{Condition, FRAMES_TO_ARM, State};

    /// Begun in standby with leave to arm by itself, as where the link was lost and found again while the experiment was checked.
    #[test]
    fn nothing_arms_itself_after_an_experiment_that_ended_before_it_armed() {
        let mut cycle = cycle();
        let step = |cycle: &mut Cycle, tick: u32| {
            // A reading that stands still to the bit would be a frozen sensor's.
            let noise_volts = 0.0002 * (tick * 7_919 % 11) as f32;
            let volts = SOUND.map(|volts| volts + noise_volts);
            answer(cycle, &sense(tick, volts, CrioState::Running, TripBits::NONE)).0.mode
        };
        for tick in 0..FRAMES_TO_ARM - 5 {
            assert_eq!(step(&mut cycle, tick), Mode::Vent);
        }
        assert!(cycle.state() == State::Standby && cycle.memory().may_arm_itself);
        let rows = vec![Row { duty: [0.8, 0.8], pump_on: true }; 300];
        let playback = Box::new(OpenLoopPlayback::new(rows.into(), PumpRelay::Absent));
        assert!(cycle.begin_experiment(playback, &mut |_| ()).is_ok());
        // Not long enough to be found at rest, which takes three means of half a second.
        for tick in FRAMES_TO_ARM - 5..2 * FRAMES_TO_ARM {
            assert_eq!(step(&mut cycle, tick), Mode::Vent, "tick {tick}");
        }
        cycle.link_lost(Condition::LinkLost, 0.0, &mut |_| ());
        cycle.session_opened();
        assert!(cycle.take_finished_experiment().is_some(), "the cut link has ended it");
        for tick in 0..4 * FRAMES_TO_ARM {
            assert_eq!(step(&mut cycle, tick), Mode::Vent, "armed by itself in tick {tick}");
        }
        cycle.arm();
        assert_eq!(step(&mut cycle, 4 * FRAMES_TO_ARM), Mode::Run, "a person arms");
    }
}
