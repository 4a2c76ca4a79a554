//! Policies and models that took over while a recorded run went on, handed to the tick of its replay.

use std::collections::{HashMap, VecDeque};

use handover::{Candidate, Command, Haste, StoreEnd};
use model::rig::Rig;
use policy::Policy;
use proto::emulator::rig_and_crio;
use proto::recording::TickOrder;

use crate::daemon::contracts;
use crate::experiment::pump_relay::PumpRelay;
use crate::model_change::ModelDesk;
use crate::replay::run_file::{RunFile, attached};

/// Orders of a run that its recordings hold so far.
#[derive(Default)]
pub(crate) struct RecordedOrders {
    /// Orders that are known, whether they were carried out or not; a later part of the run repeats those before it.
    known: usize,
    /// Models that are known, the first one counted.
    known_models: usize,
    policies: VecDeque<TickOrder>,
    /// Models with the samples that they had run along with.
    models: VecDeque<(Rig, u64)>,
    /// Files of policies by SHA-256.
    files: HashMap<String, Vec<u8>>,
}

impl RecordedOrders {
    /// Takes in what a recording adds to those before it. What it cannot make sense of is missed where it is needed.
    pub(crate) fn take_in(&mut self, run: &RunFile) {
        for bytes in run.attachments(attached::POLICY) {
            self.files.entry(policy::hash(bytes).to_string()).or_insert_with(|| bytes.to_vec());
        }
        let models: Vec<&[u8]> = run.attachments(attached::MODEL).collect();
        let mut new_models = models.iter().skip(self.known_models.max(1));
        let orders: Vec<&[u8]> = run.attachments(attached::ORDER).collect();
        for order in orders.iter().skip(self.known).filter_map(|bytes| TickOrder::from_json(bytes)) {
            match order {
                TickOrder::Model { followed } => {
                    let text = new_models.next().and_then(|bytes| std::str::from_utf8(bytes).ok());
                    let rig = text.and_then(|text| Rig::from_toml(text).ok());
                    self.models.extend(rig.map(|rig| (rig, followed)));
                }
                of_policy => self.policies.push_back(of_policy),
            }
        }
        self.known = self.known.max(orders.len());
        self.known_models = self.known_models.max(models.len());
    }

    /// Gives the tick the next order about policies.
    ///
    /// # Errors
    /// Why it cannot be given: the recording lacks it or its file.
    pub(crate) fn next_policy(&mut self, end: &StoreEnd) -> Result<(), &'static str> {
        let order =
            self.policies.pop_front().ok_or("another policy took part, and the recording does not say which")?;
        let candidate = |sha256: Option<String>| match sha256 {
            None => Ok(Candidate::fallback()),
            Some(sha256) => {
                let bytes = self.files.get(&sha256);
                let bytes = bytes.ok_or("another policy took part, and the recording does not hold its file")?;
                let read = Policy::from_bytes(sha256, bytes, &contracts());
                read.map(Candidate::new).map_err(|_| "another policy took part, and this program cannot read its file")
            }
        };
        let command = match order {
            TickOrder::Prove { sha256 } => Command::Try(candidate(sha256)?, Haste::Proving),
            TickOrder::Resume { sha256 } => Command::Try(candidate(sha256)?, Haste::Straight),
            TickOrder::Rollback | TickOrder::Model { .. } => Command::Rollback,
        };
        end.sweep();
        end.ask(command).map_err(|_| "more policies took part than the tick of the replay took")
    }

    /// Gives the tick the next model; the relay of its rig's pump.
    ///
    /// # Errors
    /// Why it cannot be given: the recording lacks it, or it cannot be flown.
    pub(crate) fn next_model(&mut self, desk: &ModelDesk) -> Result<PumpRelay, &'static str> {
        desk.follow_replay();
        let (rig, followed) =
            self.models.pop_front().ok_or("another model took over, and the recording does not hold its file")?;
        let unfit = |_| "another model took over, and this program cannot fly it";
        desk.repeat(&rig, followed).map_err(unfit)?;
        rig_and_crio(&rig).map(|(_, crio)| PumpRelay::of(&crio)).map_err(unfit)
    }
}
