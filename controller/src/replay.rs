//! A recorded run again: the control law on the recorded inputs, every output compared bit for bit.
//!
//! The inputs of a tick are its SENSE frame as it came (or that it did not come), what reached the tick beside frames
//! ([`TickInput`]), and the files inside the recording: configuration, models, references, policies. No clock, no socket and
//! no random number goes into a decision, so the same inputs must give the same bits; where they do not, the program,
//! its compiler or the machine decides otherwise than it did, and the first stage that differs says where to look.
//!
//! Two things end a replay early: ticks that were not recorded, and inputs whose content the recording does not hold. What was
//! compared until then counts, and the end is told. So is a recording of which something could not be read: what follows the
//! end of one that was cut short was not compared.

pub(crate) mod recorded_orders;
pub mod run_file;

mod beginning;
mod comparison;
pub mod part_order;
mod recorded_inputs;
mod replay_error;

use handover::Noise;
use proto::recording::{TickInput, TickRecord};
use proto::reference::Reference;
use proto::wire::{Frame, Sense, SequenceCounter};
use supervisor::Condition;

use crate::cycle::Cycle;
use crate::cycle::limits::OF_ONE_FRAME;
use crate::replay::run_file::RunFile;

use beginning::{cycle, no_beginning};
use comparison::compare;
pub use comparison::{Difference, Stage};
use recorded_inputs::RecordedInputs;
pub use replay_error::ReplayError;

/// Findings of a replay.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Replayed {
    /// Ticks compared.
    pub ticks: u64,
    /// Numbers compared.
    pub numbers: u64,
    /// Ticks that differ in a bit.
    pub differing: u64,
    /// The first of them.
    pub first: Option<Difference>,
    /// Reason why it ended before the recording did.
    pub ended: Option<String>,
    /// Notes on what could not be read of the recordings, a line each.
    pub notes: Vec<String>,
    /// The first of them that ticks may be missing for.
    pub lost: Option<String>,
}

impl Replayed {
    /// The reason why not all that was run was compared, one line: where it ended early, else what could not be read.
    pub fn missing(&self) -> Option<&str> {
        self.ended.as_deref().or(self.lost.as_deref())
    }
}

/// Conditions that are found outside the tick and reach it as they are recorded.
const FOUND_BY_LOOP: [Condition; 9] = [
    Condition::FramesScarce,
    Condition::NotRealtime,
    Condition::NotRecorded,
    Condition::FrameImplausible,
    Condition::DeadlineMissed,
    Condition::FramesLost,
    Condition::DeadlinesMissed,
    Condition::ClockImplausible,
    Condition::SampleRate,
];

/// A run being replayed, recording after recording.
pub struct Replay {
    cycle: Option<Cycle>,
    /// Session, number and dropped records of the last tick.
    last: Option<(u32, u32, u32)>,
    replayed: Replayed,
    inputs: RecordedInputs,
    /// First ticks of the recordings so far: session, number, time, and the file.
    begun: Vec<((u32, u32, u64), String)>,
    /// The part of its run that the newest recording is.
    part: u32,
    /// True where something could not be read of the run so far.
    is_damaged: bool,
    /// True where a recording holds no tick: a part of a run may be missing.
    lacks_ticks: bool,
    /// Session and sequence number of the newest frame.
    heard: Option<(u32, u32)>,
}

/// Place of a tick behind the one before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    /// In the same recording.
    Within,
    /// In the same recording, behind a part of it that is damaged.
    BehindDamage,
    /// In the same recording, of which a part is damaged that nobody can place: another tool has put the ticks in another order.
    PerhapsBehindDamage,
    /// In the next.
    Between,
}

/// Place of a recording's tick, by its index.
fn place(run: &RunFile, index: usize) -> Place {
    match index {
        0 => Place::Between,
        _ if run.content.lost_before.contains(&index) => Place::BehindDamage,
        _ if run.content.is_damaged_within && run.content.lost_before.is_empty() => Place::PerhapsBehindDamage,
        _ => Place::Within,
    }
}

impl Replay {
    /// A replay; `references` are those that were exchanged while the run went on, in their order.
    pub fn new(references: Vec<Reference>) -> Self {
        Replay {
            cycle: None,
            last: None,
            replayed: Replayed::default(),
            inputs: RecordedInputs::new(references),
            begun: Vec::new(),
            part: 0,
            is_damaged: false,
            lacks_ticks: false,
            heard: None,
        }
    }

    /// Takes note of a recording that holds no tick, before the others are replayed: what it was to hold is lost, and what comes behind
    /// that cannot be compared.
    pub fn without_ticks(&mut self, note: String) {
        self.replayed.notes.push(note.clone());
        self.replayed.lost.get_or_insert(note);
        self.lacks_ticks = true;
    }

    /// Replays a recording. One whose first tick is the next of the one before continues it; any other is a run of its
    /// own, by a daemon that began anew.
    ///
    /// # Errors
    /// The recording lacks what a replay needs.
    pub fn run(&mut self, run: &RunFile) -> Result<(), ReplayError> {
        self.replayed.notes.extend(run.content.notes.iter().cloned());
        if self.replayed.lost.is_none() {
            // Where a file inside is damaged that is needed, the replay ends there or does not begin.
            self.replayed.lost = run.notes_on_ticks().next().cloned();
        }
        for (index, tick) in run.content.ticks.iter().enumerate() {
            if self.replayed.ended.is_some() {
                return Ok(());
            }
            let continues = self
                .last
                .is_some_and(|(session, number, _)| session == tick.session && number.wrapping_add(1) == tick.tick);
            let first = index == 0;
            let goes_on = continues || (self.cycle.is_some() && run.part() > 1);
            if first {
                self.check_order(run, tick, goes_on.then_some(self.part))?;
            }
            if first {
                self.is_damaged = run.notes_on_ticks().next().is_some() || (goes_on && self.is_damaged);
            }
            if first && !goes_on {
                let (cycle, relay) = cycle(run)?;
                self.cycle = Some(cycle);
                self.inputs.begin_anew(relay);
            }
            if first {
                self.inputs.take_in(run)?;
            }
            if first && !goes_on {
                // What there was no room for may have been the opening; the tick says so.
                let begins = TickInput::of(tick.inputs).any(|input| input == TickInput::SessionOpened);
                if !begins && !TickInput::is_overfull(tick.inputs) {
                    return Err(no_beginning(run));
                }
            } else if let Some(why) = self.lost_before(tick, place(run, index)) {
                self.replayed.ended = Some(why);
                return Ok(());
            }
            self.tick(tick);
            self.last = Some((tick.session, tick.tick, tick.records_dropped));
        }
        Ok(())
    }

    /// Refuses a recording that was replayed already, and one that does not follow the part `before` it.
    fn check_order(&mut self, run: &RunFile, first: &TickRecord, before: Option<u32>) -> Result<(), ReplayError> {
        let file = run.path.display().to_string();
        let key = (first.session, first.tick, first.receive_ns);
        if let Some((_, before)) = self.begun.iter().find(|(begun, _)| *begun == key) {
            return Err(ReplayError::Twice { file, before: before.clone() });
        }
        let found = run.part();
        // One that holds no tick may be the part between.
        if let Some(before) = before.filter(|before| found > 1 && found != before + 1 && !self.lacks_ticks) {
            return Err(ReplayError::PartMissing { file, found, before });
        }
        self.begun.push((key, file));
        self.part = found;
        Ok(())
    }

    /// Reason why ticks before this one are not in the recording, if any are not. A number that is skipped is no proof: in
    /// lockstep a frame that never came leaves no tick, and of frames that queue up only the newest does. Nor is one that comes
    /// twice: a frame that was missed and came late has the number of the tick that went without it.
    fn lost_before(&self, tick: &TickRecord, place: Place) -> Option<String> {
        let (session, number, dropped) = self.last?;
        let at = format!("before tick {} of session {:08X}", tick.tick, tick.session);
        if tick.records_dropped != dropped {
            return Some(format!(
                "{} ticks {at} were not recorded: the queue was full",
                tick.records_dropped.wrapping_sub(dropped)
            ));
        }
        // Within a file another session is nothing to wonder at; behind what was cut short or damaged it is what was lost.
        let is_elsewhere = session != tick.session || number.wrapping_add(1) != tick.tick;
        let (skipped, may_be_lost) = match place {
            Place::Within => (false, false),
            Place::PerhapsBehindDamage => {
                (session == tick.session && is_elsewhere && number != tick.tick, self.is_damaged)
            }
            Place::BehindDamage => (is_elsewhere, self.is_damaged),
            // A recording that holds no tick may have stood between.
            Place::Between => (is_elsewhere, self.is_damaged || self.lacks_ticks),
        };
        (skipped && may_be_lost).then(|| format!("the recording is damaged {at}"))
    }

    /// Findings.
    pub fn found(self) -> Replayed {
        self.replayed
    }

    fn tick(&mut self, recorded: &TickRecord) {
        let Some(cycle) = &mut self.cycle else { return };
        for (at, input) in TickInput::of(recorded.inputs).enumerate() {
            let known = self.inputs.put_in(cycle, input, recorded.inputs);
            if is_between_sessions(recorded.inputs, at) {
                // Where no frame comes it counts at once: the session that is opened next would forget it.
                cycle.waiting(&mut |_| {});
            }
            if let Err(problem) = known {
                let at = format!("{problem} (session {:08X}, tick {})", recorded.session, recorded.tick);
                self.replayed.ended = Some(at);
                return;
            }
        }
        // What the loop around the tick had found: deadlines, losses, numbering, rights.
        report_recorded(cycle, recorded, &FOUND_BY_LOOP);
        let sense = sense_of(recorded);
        if let Some(sense) = &sense {
            let before = self.heard.replace((sense.session, sense.sequence));
            if before.is_none_or(|before| !follows_at_once(sense, before)) {
                // A frame that this one overtook is in no record; what it decided alone is among the findings.
                report_recorded(cycle, recorded, &OF_ONE_FRAME);
            }
        }
        let now = [recorded.exploration_pos, recorded.exploration_neg];
        let explored = Noise { now, plan: recorded.exploration_plan };
        cycle.duty_source_mut().tracking_mut().impose_exploration(explored);
        let mut again = TickRecord { session: recorded.session, ..TickRecord::default() };
        let answer = match sense {
            Some(sense) => {
                cycle.observe(&sense, &mut again, &mut |_| {});
                cycle.predict(&mut again);
                cycle.decide(&mut again, &mut |_| {})
            }
            None => cycle.frame_missing(0.0, &mut again, &mut |_| {}),
        };
        if let Ok(Frame::Command(sent)) = Frame::decode(&recorded.command) {
            cycle.sent(sent.sequence);
        }
        cycle.settle();
        // In every tick: a model may follow that a later recording of the run holds, and it needs the ticks before it.
        cycle.duty_source().tracking().models().follow_replay();
        let replayed = &mut self.replayed;
        let difference = compare(recorded, &again, &answer, &mut replayed.numbers);
        if let Some((stage, values)) = difference {
            replayed.differing += 1;
            let (index, session, tick) = (replayed.ticks, recorded.session, recorded.tick);
            replayed.first.get_or_insert(Difference { index, session, tick, stage, values });
        }
        replayed.ticks += 1;
    }
}

/// Reports those of the conditions that a record has among its findings.
fn report_recorded(cycle: &mut Cycle, recorded: &TickRecord, conditions: &[Condition]) {
    for condition in conditions {
        if recorded.findings & (1 << condition.code()) != 0 {
            cycle.report(*condition, 0.0);
        }
    }
}

/// Tells whether a frame is the next of its session behind the one with this session and sequence number, so that none was
/// overtaken in between.
fn follows_at_once(sense: &Sense, (session, sequence): (u32, u32)) -> bool {
    session == sense.session && SequenceCounter::after(sequence).advance() == sense.sequence
}

/// Tells whether an input of a tick, by its place among them, came while there was no session. Of what ends a session only a lost
/// link is an input; a session whose cRIO tripped ends behind a tick, and the next one begins with the inputs.
fn is_between_sessions(inputs: u32, at: usize) -> bool {
    let is_edge = |input: &TickInput| matches!(input, TickInput::LinkLost | TickInput::SessionOpened);
    let is_edge_itself = TickInput::of(inputs).nth(at).is_some_and(|input| is_edge(&input));
    !is_edge_itself && TickInput::of(inputs).skip(at + 1).find(is_edge) == Some(TickInput::SessionOpened)
}

/// The frame that came, where a sound one did.
fn sense_of(recorded: &TickRecord) -> Option<Sense> {
    match Frame::decode(recorded.sense_present.then_some(&recorded.sense)?) {
        Ok(Frame::Sense(sense)) => Some(sense),
        _ => None,
    }
}

#[cfg(test)]
mod tests;
