//! Things that reached the tick of a run beside frames, as its recordings hold them, put into a replay in their order.

use std::collections::VecDeque;

use proto::recording::TickInput;
use proto::reference::Reference;
use supervisor::Condition;

use super::recorded_orders::RecordedOrders;
use super::replay_error::ReplayError;
use super::run_file::{RunFile, attached};
use crate::cycle::Cycle;
use crate::experiment::command_sequence::CommandSequence;
use crate::experiment::open_loop_playback::OpenLoopPlayback;
use crate::experiment::pump_relay::PumpRelay;

/// Source of references that were exchanged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Given {
    /// Files beside the recording.
    Beside,
    /// The recording itself.
    Inside,
}

/// References, experiments, policies and models that are still to come.
pub(super) struct RecordedInputs {
    /// References that were exchanged while it ran, in their order.
    references: VecDeque<Reference>,
    given: Given,
    /// References of this run that are known from the recordings so far, the first one counted.
    known: usize,
    /// Experiments that were played while it ran, in their order.
    experiments: VecDeque<CommandSequence>,
    /// Those that are known from the recordings so far.
    known_experiments: usize,
    /// Policies and models that took over while it ran.
    orders: RecordedOrders,
    /// Relay of the pump of the model in force.
    relay: PumpRelay,
}

impl RecordedInputs {
    /// Those of a run to come; `references` are those that were exchanged while it went on, where they stand beside its recordings.
    pub(super) fn new(references: Vec<Reference>) -> Self {
        let given = if references.is_empty() { Given::Inside } else { Given::Beside };
        RecordedInputs {
            references: references.into(),
            given,
            known: 0,
            experiments: VecDeque::new(),
            known_experiments: 0,
            orders: RecordedOrders::default(),
            relay: PumpRelay::Fitted,
        }
    }

    /// Begins with another run, on a model with this relay.
    pub(super) fn begin_anew(&mut self, relay: PumpRelay) {
        self.relay = relay;
        // The first reference is the one that it began with.
        (self.known, self.known_experiments) = (1, 0);
        self.experiments.clear();
        self.orders = RecordedOrders::default();
    }

    /// Takes over what one of its recordings holds.
    pub(super) fn take_in(&mut self, run: &RunFile) -> Result<(), ReplayError> {
        self.take_references(run)?;
        self.take_experiments(run)?;
        self.orders.take_in(run);
        Ok(())
    }

    /// Takes over the references that were exchanged in this recording; a later part repeats those before it.
    fn take_references(&mut self, run: &RunFile) -> Result<(), ReplayError> {
        if self.given == Given::Beside {
            return Ok(());
        }
        let inside: Vec<&[u8]> = run.attachments(attached::REFERENCE).collect();
        for bytes in inside.iter().skip(self.known) {
            self.references.push_back(Reference::parse(attached::REFERENCE, bytes)?);
        }
        self.known = self.known.max(inside.len());
        Ok(())
    }

    /// Takes over the experiments that were played in this recording; a later part repeats those before it.
    fn take_experiments(&mut self, run: &RunFile) -> Result<(), ReplayError> {
        let inside: Vec<&[u8]> = run.attachments(attached::EXPERIMENT).collect();
        for bytes in inside.iter().skip(self.known_experiments) {
            self.experiments.push_back(CommandSequence::parse(attached::EXPERIMENT, bytes.to_vec())?);
        }
        self.known_experiments = self.known_experiments.max(inside.len());
        Ok(())
    }

    /// Puts an input into a cycle; `inputs` are all of its tick.
    ///
    /// # Errors
    /// Why that cannot be done, in words.
    pub(super) fn put_in(&mut self, cycle: &mut Cycle, input: TickInput, inputs: u32) -> Result<(), &'static str> {
        match input {
            TickInput::Arm => cycle.arm(),
            TickInput::Disarm => cycle.disarm(),
            TickInput::Acknowledge => cycle.acknowledge(),
            TickInput::LinkLost => cycle.link_lost(Condition::LinkLost, 0.0, &mut |_| {}),
            TickInput::SessionOpened => cycle.session_opened(),
            TickInput::Reference => {
                let reference = self.references.pop_front().ok_or(
                    "another reference was put in, and the recording does not hold it; give its file with --reference",
                )?;
                cycle.exchange_reference(Box::new(reference));
            }
            TickInput::Experiment => {
                let sequence = self
                    .experiments
                    .pop_front()
                    .ok_or("an experiment was played, and the recording does not hold its commands")?;
                let playback = OpenLoopPlayback::new(sequence.rows().into(), self.relay);
                // One that is over has been handed back by then, as it was in the run.
                let _ = cycle.take_finished_experiment();
                let begun = cycle.begin_experiment(Box::new(playback), &mut |_| {});
                begun.map_err(|_| "an experiment began while another was under way")?;
            }
            TickInput::Policy => self.orders.next_policy(&cycle.duty_source().tracking().policies())?,
            TickInput::Model => self.relay = self.orders.next_model(&cycle.duty_source().tracking().models())?,
            // What was added stands in each tick's record.
            TickInput::Explore => {}
            TickInput::Other if TickInput::is_overfull(inputs) => {
                return Err(
                    "there were too many requests before this tick to record: a tick's record holds eight, and the rest cannot be replayed",
                );
            }
            TickInput::Other => return Err("something reached the tick that this program cannot replay"),
        }
        Ok(())
    }
}
