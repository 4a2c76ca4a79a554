//! Transitions for the learner, from a folder of recordings.
//!
//! ```text
//! (o_τ, a_τ, r_{τ+1}, o_{τ+1}),    r and o as in training (environment), a the whole answer of the policy
//! ```
//!
//! Two ticks make a transition where they follow each other in one session, both are RUN, the law of both is explained by the
//! recording, the filter left the command of the first alone, and its answer is one that the policy under training could
//! give. Under layout 2 the fallback by itself is an answer of zeros; under layout 1 its ticks are left out. A gap, a fault,
//! an exchange of policies parts the trajectory there.

mod beginning;

use std::collections::{BTreeMap, VecDeque};
use std::path::Path;

use environment::reward::{correction_price, reward};
use environment::vector_env::ENVELOPE_KPA;
use environment::{EnvironmentSettings, vector_env};
use model::observation::{ACTION_LEN, ObservationLayout};
use model::rig::Rig;
use proto::recording::{FollowEnd, TickInput, TickRecord, attached};
use training::TrainingSettings;

use self::beginning::{Begun, Part};
use crate::FinetuneError;
use crate::files_inside::{parsed_reference, rig};
use crate::loop_rebuild::{LeftOut, LoopRebuild, RebuiltTick, is_controlled};
use crate::recording_folder::{Piece, Read, RecordingFolder};

/// Largest size of an answer that counts as within the policy's range; a tanh gets no nearer to 1 in f32.
const MOST_ACTION: f32 = 1.0 + 1e-5;
const WITHIN_ACTION: f32 = 1.0 - 1e-6;

/// A transition, ready for the learner.
#[derive(Debug, Clone, PartialEq)]
pub struct Transition {
    /// Observation before the action.
    pub observation: Vec<f32>,
    /// The action, each entry in (−1, 1).
    pub action: Vec<f32>,
    /// The reward.
    pub reward: f32,
    /// Observation after it.
    pub next_observation: Vec<f32>,
    /// True where the rig left its envelope.
    pub terminal: bool,
    /// Session and number of the tick after it.
    pub measured_at: (u32, u32),
    /// Goals of that tick, in kPa gauge.
    pub goals_kpa: [f64; 2],
    /// Error that was measured in it, in kPa.
    pub error_kpa: [f64; 2],
}

/// Counts of what in the recordings was of use.
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct Tally {
    /// Ticks read.
    pub ticks: u64,
    /// Transitions made.
    pub transitions: u64,
    /// Observations that are, to the bit, what the recorded policy was shown, of all that were compared.
    pub same_observations: u64,
    /// Observations that were compared.
    pub compared_observations: u64,
    /// Ticks that were left out, by reason.
    pub left_out: BTreeMap<String, u64>,
}

/// Transitions of a folder, in the order of its ticks: the same ones whenever and in however many pieces it is read.
pub struct Transitions {
    folder: RecordingFolder,
    layout: ObservationLayout,
    acting_len: usize,
    predicts: bool,
    environment: EnvironmentSettings,
    rebuild: Option<LoopRebuild>,
    /// References and models of the run that have been put in.
    known: [usize; 2],
    waiting: VecDeque<Item>,
    /// True where the next tick is the first of its recording.
    begins: bool,
    /// True where ticks of the recording are lost before this one, and with them what may have taken over there.
    is_behind_loss: bool,
    /// True where the recordings before this one, whose run it may go on with, end behind such a loss.
    ended_behind_loss: bool,
    before: Option<RebuiltTick>,
    /// The recording that began last.
    part: Option<Part>,
    /// Session and number of the last tick.
    last: Option<(u32, u32)>,
    /// True where the loop was taken up within a run, and is known once nothing controls.
    awaits_rest: bool,
    /// Remarks on parts that are missing.
    notes: Vec<String>,
    tally: Tally,
}

/// Item that was read and not looked at yet.
#[derive(Debug)]
enum Item {
    /// A recording begins.
    Begins,
    /// Ticks of the recording may be lost here.
    Loss,
    /// A tick.
    Tick(Box<TickRecord>),
}

/// File inside the recording that can take over while a run goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Exchanged {
    Reference,
    Model,
}

impl Transitions {
    /// Transitions of the recordings in `folder` for a policy of these settings.
    pub fn new(folder: &Path, settings: &TrainingSettings) -> Self {
        Transitions {
            folder: RecordingFolder::new(folder),
            layout: settings.contract(),
            acting_len: settings.shape().actions,
            predicts: settings.policy.variant.predicts(),
            environment: settings.environment.clone(),
            rebuild: None,
            known: [0; 2],
            waiting: VecDeque::new(),
            begins: false,
            is_behind_loss: false,
            ended_behind_loss: false,
            before: None,
            part: None,
            last: None,
            awaits_rest: false,
            notes: Vec::new(),
            tally: Tally::default(),
        }
    }

    /// Counts of what was of use so far.
    pub fn tally(&self) -> &Tally {
        &self.tally
    }

    /// The model behind the newest tick.
    pub fn model(&self) -> Option<&Rig> {
        self.rebuild.as_ref().map(LoopRebuild::model)
    }

    /// Times that a law had to be joined late ([`LoopRebuild::joined`]).
    pub fn joined(&self) -> u64 {
        self.rebuild.as_ref().map_or(0, LoopRebuild::joined)
    }

    /// Remarks on what is damaged in the recordings or missing between them, each of them once.
    pub fn take_notes(&mut self) -> Vec<String> {
        let mut notes = self.folder.take_notes();
        notes.append(&mut self.notes);
        notes
    }

    /// Name of the recording that is being read.
    pub fn recording(&self) -> String {
        self.folder.current_name()
    }

    /// Ticks that were read and not looked at yet.
    pub fn waiting(&self) -> usize {
        self.waiting.len()
    }

    /// The next transition of what is there; nothing where it ends for now.
    ///
    /// # Errors
    /// A recording that cannot be read or lacks its model or reference.
    pub fn next_transition(&mut self) -> Result<Option<Transition>, FinetuneError> {
        loop {
            match self.waiting.pop_front() {
                Some(Item::Begins) => {
                    self.begins = true;
                    self.ended_behind_loss |= std::mem::take(&mut self.is_behind_loss);
                }
                Some(Item::Loss) => self.is_behind_loss = true,
                Some(Item::Tick(record)) => {
                    if std::mem::take(&mut self.begins) {
                        self.begin_recording(&record)?;
                    }
                    if !self.exchange(&record)? {
                        self.waiting.push_front(Item::Tick(record));
                        return Ok(None);
                    }
                    if let Some(transition) = self.tick(&record) {
                        self.tally.transitions += 1;
                        return Ok(Some(transition));
                    }
                }
                None if self.read_on()? => {}
                None => return Ok(None),
            }
        }
    }

    /// The last recording is over, though nobody finished it: what is whole of its end comes with the next transitions.
    ///
    /// # Errors
    /// As [`Transitions::next_transition`].
    pub fn give_up(&mut self) -> Result<(), FinetuneError> {
        let piece = self.folder.give_up()?;
        self.wait_for(piece);
        Ok(())
    }

    fn wait_for(&mut self, piece: Piece) {
        let Piece { ticks, lost_before } = piece;
        let mut losses = lost_before.into_iter().peekable();
        for (at, tick) in ticks.into_iter().enumerate() {
            while losses.next_if(|loss| *loss <= at).is_some() {
                self.waiting.push_back(Item::Loss);
            }
            self.waiting.push_back(Item::Tick(Box::new(tick)));
        }
        self.waiting.extend(losses.map(|_| Item::Loss));
    }

    /// Reads a piece; whether there was one.
    fn read_on(&mut self) -> Result<bool, FinetuneError> {
        match self.folder.read_on()? {
            Read::Nothing => return Ok(false),
            Read::Begins => self.waiting.push_back(Item::Begins),
            Read::Ticks(piece) => self.wait_for(piece),
        }
        Ok(true)
    }

    /// A later part of a run goes on with its loop, also with one that nobody knows any more; any other recording begins a loop.
    fn begin_recording(&mut self, first: &TickRecord) -> Result<(), FinetuneError> {
        let ended_behind_loss = std::mem::take(&mut self.ended_behind_loss);
        let Some(recording) = self.folder.current() else { return Ok(()) };
        let part = Part::of(self.folder.current_name(), recording);
        // Ticks tell more than names: people rename files.
        let is_next_tick = self.last.is_some_and(|last| is_next(last, first));
        let follows = |before: &Part| is_next_tick || part.names(before);
        if part.is_later() && self.part.as_ref().is_some_and(follows) {
            // It holds the files of the parts before as well, so that what is lost there still counts.
            self.is_behind_loss |= ended_behind_loss;
        } else {
            let Begun { rebuild, known, note } = part.begin(recording, self.layout)?;
            (self.rebuild, self.known) = (rebuild, known);
            self.notes.extend(note);
            self.before = None;
            self.awaits_rest = part.is_later();
        }
        self.part = Some(part);
        Ok(())
    }

    /// Puts in what took over before a tick; `false` where the file of it is still to come.
    fn exchange(&mut self, record: &TickRecord) -> Result<bool, FinetuneError> {
        let due: Vec<Exchanged> = TickInput::of(record.inputs)
            .filter_map(|input| match input {
                TickInput::Reference => Some(Exchanged::Reference),
                TickInput::Model => Some(Exchanged::Model),
                _ => None,
            })
            .collect();
        if !due.is_empty() && self.is_behind_loss {
            // Files inside count by their order; one of those before may have taken over in a tick that is lost.
            self.rebuild = None;
        }
        // All of them, or none yet: a tick is looked at once.
        for what in [Exchanged::Reference, Exchanged::Model] {
            let count = due.iter().filter(|due| **due == what).count();
            while count > 0 && self.rebuild.is_some() && self.there_are(what) < self.known[what as usize] + count {
                if self.is_over() || self.has_lost(what) {
                    // Nobody knows what controls from here on, until the daemon begins anew.
                    self.rebuild = None;
                } else if !self.read_on()? {
                    return Ok(false);
                }
            }
        }
        for what in due {
            self.put_in(what)?;
        }
        Ok(true)
    }

    /// Files of a kind in the recording under way, as far as it has been read.
    fn there_are(&self, what: Exchanged) -> usize {
        self.folder.current().map_or(0, |recording| recording.attachments(name_of(what)).count())
    }

    /// Tells whether files of a kind are lost in the recording under way: no later one of them is given any more.
    fn has_lost(&self, what: Exchanged) -> bool {
        self.folder.current().is_some_and(|recording| recording.has_lost(name_of(what)))
    }

    /// Tells whether the recording of the tick under way brings nothing more.
    fn is_over(&self) -> bool {
        self.waiting.iter().any(|item| matches!(item, Item::Begins))
            || self.folder.current().is_none_or(|recording| recording.end() == FollowEnd::Finished)
    }

    fn put_in(&mut self, what: Exchanged) -> Result<(), FinetuneError> {
        let file = self.folder.current_name();
        let Some((rebuild, recording)) = self.rebuild.as_mut().zip(self.folder.current()) else { return Ok(()) };
        let known = &mut self.known[what as usize];
        let Some(bytes) = recording.attachments(name_of(what)).nth(*known) else { return Ok(()) };
        *known += 1;
        match what {
            Exchanged::Reference => rebuild.exchange_reference(parsed_reference(&file, bytes)?),
            Exchanged::Model => rebuild.exchange_model(rig(&file, bytes)?)?,
        }
        Ok(())
    }

    /// Takes in a tick; the transition that it completes.
    fn tick(&mut self, record: &TickRecord) -> Option<Transition> {
        self.tally.ticks += 1;
        self.last = Some((record.session, record.tick));
        self.awaits_rest &= is_controlled(record);
        let known = self.rebuild.as_mut().filter(|_| !self.awaits_rest);
        let now = known.and_then(|rebuild| rebuild.follow(record));
        let before = self.before.take();
        let transition = before.and_then(|before| self.transition(before, now.as_ref(), record));
        let left_out = match &now {
            None if self.rebuild.is_none() || self.awaits_rest => Some(LeftOut::LawDiffers),
            None => Some(LeftOut::NotRunning),
            Some(now) => {
                if let Some(same) = now.is_same_to_the_bit.filter(|_| now.is_sound) {
                    self.tally.compared_observations += 1;
                    self.tally.same_observations += u64::from(same);
                }
                now.answer.err().or_else(|| self.action(now).is_none().then_some(LeftOut::BeyondRange))
            }
        };
        if let Some(reason) = left_out {
            *self.tally.left_out.entry(reason.words().to_owned()).or_default() += 1;
        }
        self.before = now.filter(|now| now.answer.is_ok());
        transition
    }

    fn transition(&self, before: RebuiltTick, now: Option<&RebuiltTick>, record: &TickRecord) -> Option<Transition> {
        let action = self.action(&before)?;
        if !is_next(before.at, record) {
            return None;
        }
        let settings = &self.environment.reward;
        let measured_at = (record.session, record.tick);
        let measured_kpa = [record.p_pos_kpa, record.p_neg_kpa];
        if measured_kpa[0] > ENVELOPE_KPA[0] || measured_kpa[1] < ENVELOPE_KPA[1] {
            let reward = (settings.scale * settings.tripped) as f32;
            let next_observation = before.observation.clone();
            let goals_kpa = before.goals_kpa[1];
            return Some(Transition {
                observation: before.observation,
                action,
                reward,
                next_observation,
                terminal: true,
                measured_at,
                goals_kpa,
                error_kpa: std::array::from_fn(|c| measured_kpa[c] - before.shown_kpa[1][c]),
            });
        }
        let now = now.filter(|now| now.is_sound)?;
        let predicted = self.predicts.then_some(&now.predicted_kpa);
        let mut paid = reward(settings, &now.shown_kpa, now.measured_kpa, predicted);
        if self.layout == ObservationLayout::Correction {
            paid += correction_price(settings, &action);
        }
        Some(Transition {
            observation: before.observation,
            action,
            reward: paid as f32,
            next_observation: now.observation.clone(),
            terminal: false,
            measured_at,
            goals_kpa: now.goals_kpa[0],
            error_kpa: std::array::from_fn(|c| now.measured_kpa[c] - now.shown_kpa[0][c]),
        })
    }

    /// The recorded answer as an action of the policy under training; nothing where that could not give it.
    fn action(&self, tick: &RebuiltTick) -> Option<Vec<f32>> {
        let answer = tick.answer.ok()?;
        let [high, middle] =
            [1.0, 0.0].map(|action| vector_env::outputs(self.layout, &self.environment, &[action; ACTION_LEN])[0]);
        let action = |output: &f32| (output - middle) / (high - middle);
        let actions: Vec<f32> = answer.iter().take(self.acting_len).map(action).collect();
        let is_within = actions.iter().all(|a| a.abs() <= MOST_ACTION);
        is_within.then(|| actions.iter().map(|a| a.clamp(-WITHIN_ACTION, WITHIN_ACTION)).collect())
    }
}

/// Tells whether a tick comes right behind one of this session and number.
fn is_next((session, number): (u32, u32), record: &TickRecord) -> bool {
    (record.session, record.tick) == (session, number.wrapping_add(1))
}

const fn name_of(what: Exchanged) -> &'static str {
    match what {
        Exchanged::Reference => attached::REFERENCE,
        Exchanged::Model => attached::MODEL,
    }
}

#[cfg(test)]
mod tests;
