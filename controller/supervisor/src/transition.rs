//! The pure function from (memory, inputs) to (memory, action).
//!
//! ```text
//!  INIT ─▶ CONNECT ─▶ STANDBY ─arm─▶ RUN ◀──5 good ticks── HOLD
//!             ▲          ▲            │  ──Hold condition──▶
//!             │          │            ├──Revert condition──▶ REVERT ──50 good ticks, 3 per 10 min──▶ RUN
//!         link gone      │            ▼
//!        (any state)     └─25 sound── VENT ◀── Vent condition (any state with a session)
//!                          frames,    │
//!                       acknowledged  └──venting not confirmed──▶ FAULT ──acknowledged, confirmed──▶ VENT
//! ```
//!
//! *arm* is asked for by a person, by an experiment for its rows, or acted on by `auto_arm`.
//!
//! STOP is entered from every state and left from none. The whole table, drawn, stands in `docs/safety.md`.

use crate::condition::{Condition, Latch, Severity};
use crate::condition_set::ConditionSet;
use crate::state::State;

/// Sound frames in a row before the rig can be armed, and after the cause before VENT is left: half a second (chosen).
pub const FRAMES_TO_ARM: u32 = 25;
/// Good ticks after which HOLD is left (study of the daemon, §3.4).
pub const GOOD_TICKS_AFTER_HOLD: u32 = 5;
/// Good ticks after which REVERT is left (study of the daemon, §3.4).
pub const GOOD_TICKS_AFTER_REVERT: u32 = 50;
/// Returns from REVERT that are made without a person in [`RETURN_PERIOD_TICKS`] (study of the daemon, §3.4).
pub const RETURNS_PER_PERIOD: u8 = 3;
/// Period of [`RETURNS_PER_PERIOD`]: 10 minutes.
pub const RETURN_PERIOD_TICKS: u32 = 30_000;

/// What made this call.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tick {
    /// A frame was accepted.
    Frame,
    /// No frame was accepted in time.
    Missing,
    /// A session was opened.
    SessionOpened,
    /// The link is gone.
    LinkGone,
    /// Still without a session.
    Waiting,
}

/// What is asked for: by a person, or by what is steered for on a person's behalf.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Request {
    /// Play the rows of an experiment: arms for these only, and whatever stops them leaves arming to a person.
    Play,
    /// Control the pressures.
    Arm,
    /// What was wrong has been looked at.
    Acknowledge,
    /// Open the vents.
    Disarm,
    /// End the program.
    Stop,
}

/// Whether a person is needed to arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arming {
    /// By a person only.
    Manual,
    /// By itself once all is sound (`control.auto_arm`: simulation and tests).
    Automatic,
}

/// What the function is told.
#[derive(Debug, Clone, Copy)]
pub struct Inputs<'a> {
    /// What made this call.
    pub tick: Tick,
    /// What is wrong now.
    pub conditions: &'a ConditionSet,
    /// Request of this tick, where there is one.
    pub request: Option<Request>,
    /// Whether a person is needed to arm.
    pub arming: Arming,
}

/// Everything that is remembered from tick to tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Memory {
    /// The state.
    pub state: State,
    /// Why the state is HOLD, VENT or FAULT, or why the last session ended; the worst so far.
    pub cause: Option<Condition>,
    /// Why the policy does not control, while it does not.
    pub reverted: Option<Condition>,
    /// Conditions that wait for a person.
    pub latched: ConditionSet,
    /// Sound frames in a row.
    pub sound_frames: u32,
    /// Good ticks in a row while in HOLD or REVERT.
    pub good_ticks: u32,
    /// Returns from REVERT made in this period.
    pub returns: u8,
    /// Ticks since the first of them.
    pub return_period_ticks: u32,
    /// True while `auto_arm` may act: not after a latched condition, a disarm or the beginning of an experiment, until it is armed
    /// by a person or, after an experiment that began under control and was played to its end, for the reference again.
    pub may_arm_itself: bool,
}

impl Memory {
    /// Nothing has happened yet.
    pub const START: Memory = Memory {
        state: State::Init,
        cause: None,
        reverted: None,
        latched: ConditionSet::EMPTY,
        sound_frames: 0,
        good_ticks: 0,
        returns: 0,
        return_period_ticks: 0,
        may_arm_itself: true,
    };

    /// Tells whether an order to arm would be followed at the next sound frame.
    pub fn can_arm(&self, conditions: &ConditionSet) -> bool {
        self.state == State::Standby
            && self.sound_frames >= FRAMES_TO_ARM
            && self.latched.is_empty()
            && Self::bars_arming(conditions).is_none()
    }

    /// Worst condition that keeps the rig from being armed as long as it holds.
    pub fn bars_arming(conditions: &ConditionSet) -> Option<Condition> {
        let bars = |condition: &Condition| condition.severity() == Severity::BarsArming;
        conditions.worst(Severity::Vent).or_else(|| conditions.iter().find(bars))
    }

    /// Tells whether a session may be opened: not while a trip of the cRIO waits for a person, because a HELLO would undo it.
    pub fn may_open_session(&self) -> bool {
        !self.latched.iter().any(Condition::bars_session)
    }
}

impl Default for Memory {
    fn default() -> Self {
        Memory::START
    }
}

/// What goes to the valves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Actuation {
    /// Both vents open, pump off.
    Vent,
    /// The controller's duties.
    Control,
    /// The plan that was made for this tick: there is no frame to answer.
    Plan,
}

/// Whose duties count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ControlledBy {
    /// The policy, where there is one.
    Policy,
    /// The fallback.
    Fallback,
}

/// Whether integrators move on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Integration {
    /// They do.
    On,
    /// They stand still, and duties move slowly.
    Off,
}

/// What a person is told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transition {
    /// Nothing happened.
    None,
    /// A session was opened.
    SessionOpened,
    /// Armed.
    Armed(Arming),
    /// Disarmed by the operator.
    Disarmed,
    /// Vented, or vented already and now for a worse reason.
    Vented(Condition),
    /// Venting is in doubt.
    Faulted(Condition),
    /// The link is gone while nothing worse was told.
    Disconnected(Condition),
    /// HOLD began.
    Held(Condition),
    /// HOLD is over.
    Resumed,
    /// The fallback took over.
    Reverted(Condition),
    /// The policy controls again.
    Returned,
    /// The cause is over, and acknowledged where it had to be.
    Recovered,
    /// Ending.
    Stopped,
}

/// What came of [`Request::Acknowledge`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Acknowledgement {
    /// There was none.
    None,
    /// Everything that waited is cleared.
    Cleared,
    /// This still holds, and goes on waiting.
    StillHolds(Condition),
}

/// What to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Action {
    /// What goes to the valves.
    pub actuation: Actuation,
    /// Whose duties count.
    pub controlled_by: ControlledBy,
    /// Whether integrators move on.
    pub integration: Integration,
    /// What a person is told.
    pub transition: Transition,
    /// What came of an acknowledgement.
    pub acknowledgement: Acknowledgement,
    /// Whether the cRIO's trip may be ended by a new HELLO now.
    pub renew_session: bool,
}

/// Moves from one tick to the next.
///
/// # Real-time
/// Pure, bounded, allocation-free: runs in the tick.
pub fn next(memory: &Memory, inputs: &Inputs<'_>) -> (Memory, Action) {
    let mut after = *memory;
    let mut transition = Transition::None;
    let acknowledgement = latch_and_acknowledge(&mut after, inputs);
    count_returns(&mut after);
    if inputs.request == Some(Request::Disarm) {
        after.may_arm_itself = false;
    }
    if memory.state == State::Stop || inputs.request == Some(Request::Stop) {
        if memory.state != State::Stop {
            transition = Transition::Stopped;
        }
        after.state = State::Stop;
    } else {
        transition = match inputs.tick {
            Tick::LinkGone => disconnect(&mut after, inputs),
            Tick::SessionOpened => open(&mut after),
            Tick::Waiting => wait(&mut after),
            Tick::Frame | Tick::Missing => match inputs.conditions.worst(Severity::Vent) {
                Some(worst) => vent(&mut after, worst),
                None => sound(&mut after, inputs),
            },
        };
    }
    let action = Action {
        actuation: actuation(after.state, inputs.tick),
        controlled_by: if after.reverted.is_some() { ControlledBy::Fallback } else { ControlledBy::Policy },
        integration: integration(&after, inputs),
        transition,
        acknowledgement,
        renew_session: renews(&after, inputs),
    };
    (after, action)
}

/// What is in doubt is not integrated, also where something worse has made another state of it.
fn integration(memory: &Memory, inputs: &Inputs<'_>) -> Integration {
    let in_doubt = inputs.conditions.iter().any(|c| c.severity() == Severity::Hold);
    match memory.state {
        State::Hold => Integration::Off,
        state if state.is_controlling() && in_doubt => Integration::Off,
        _ => Integration::On,
    }
}

fn actuation(state: State, tick: Tick) -> Actuation {
    match (state.is_controlling(), tick) {
        (true, Tick::Frame) => Actuation::Control,
        (true, Tick::Missing) => Actuation::Plan,
        _ => Actuation::Vent,
    }
}

/// A trip for lost commands alone is ended by the daemon; any other only after a person has acknowledged it.
fn renews(memory: &Memory, inputs: &Inputs<'_>) -> bool {
    let tripped = [Condition::CommandsLost, Condition::CrioTripped, Condition::TripBits]
        .into_iter()
        .any(|c| inputs.conditions.contains(c));
    tripped && memory.may_open_session() && inputs.tick == Tick::Frame
}

fn latch_and_acknowledge(memory: &mut Memory, inputs: &Inputs<'_>) -> Acknowledgement {
    let acknowledged = inputs.request == Some(Request::Acknowledge);
    // What somebody has seen must have been there before this tick: a new condition waits for its own acknowledgement.
    let mut remains = None;
    if acknowledged {
        for condition in Condition::ALL {
            if memory.latched.contains(*condition) {
                // A trip of the cRIO holds until a new HELLO, which the acknowledgement is what allows.
                if inputs.conditions.contains(*condition) && !condition.bars_session() {
                    remains = Some(*condition);
                } else {
                    memory.latched.remove(*condition);
                }
            }
        }
    }
    for condition in inputs.conditions.iter() {
        if condition.latch() == Latch::UntilAcknowledged {
            memory.may_arm_itself = false;
            if !(acknowledged && condition.bars_session()) {
                memory.latched.insert(condition, inputs.conditions.value(condition));
            }
        }
    }
    match (acknowledged, remains) {
        (false, _) => Acknowledgement::None,
        (true, Some(condition)) => Acknowledgement::StillHolds(condition),
        (true, None) => Acknowledgement::Cleared,
    }
}

fn count_returns(memory: &mut Memory) {
    if memory.returns > 0 {
        memory.return_period_ticks = memory.return_period_ticks.saturating_add(1);
        if memory.return_period_ticks >= RETURN_PERIOD_TICKS {
            (memory.returns, memory.return_period_ticks) = (0, 0);
        }
    }
}

fn disconnect(memory: &mut Memory, inputs: &Inputs<'_>) -> Transition {
    let cause = inputs.conditions.worst(Severity::Vent).unwrap_or(Condition::LinkLost);
    // A session that ends while the rig is vented for something worse goes on being vented for that.
    let worse_told = memory.state.is_vented() && memory.cause.is_some_and(|c| c.rank() >= cause.rank());
    memory.state = State::Connect;
    (memory.sound_frames, memory.good_ticks, memory.reverted) = (0, 0, None);
    if worse_told {
        return Transition::Disconnected(cause);
    }
    memory.cause = Some(cause);
    Transition::Vented(cause)
}

fn open(memory: &mut Memory) -> Transition {
    (memory.sound_frames, memory.good_ticks, memory.reverted) = (0, 0, None);
    let waiting = memory.latched.worst(Severity::Vent);
    memory.state = match waiting {
        Some(_) => State::Vent,
        None => State::Standby,
    };
    memory.cause = waiting;
    Transition::SessionOpened
}

fn wait(memory: &mut Memory) -> Transition {
    memory.state = State::Connect;
    Transition::None
}

fn vent(memory: &mut Memory, worst: Condition) -> Transition {
    (memory.sound_frames, memory.good_ticks, memory.reverted) = (0, 0, None);
    let news = !memory.state.is_vented() || memory.cause.is_none_or(|before| worst.rank() > before.rank());
    let faulted = worst.severity() == Severity::Fault;
    memory.state = if faulted || memory.state == State::Fault { State::Fault } else { State::Vent };
    if !news {
        return Transition::None;
    }
    memory.cause = Some(worst);
    if faulted { Transition::Faulted(worst) } else { Transition::Vented(worst) }
}

/// A tick in which nothing is wrong that would open the vents.
fn sound(memory: &mut Memory, inputs: &Inputs<'_>) -> Transition {
    if inputs.tick == Tick::Frame {
        memory.sound_frames = memory.sound_frames.saturating_add(1);
    }
    match memory.state {
        State::Init | State::Connect | State::Stop => Transition::None,
        State::Standby => arm(memory, inputs),
        State::Run | State::Hold | State::Revert if inputs.request == Some(Request::Disarm) => {
            memory.state = State::Standby;
            (memory.cause, memory.reverted) = (None, None);
            Transition::Disarmed
        }
        State::Run | State::Hold | State::Revert => control(memory, inputs.conditions.worst(Severity::Hold)),
        State::Fault if memory.latched.is_empty() => {
            // The acknowledgement came, and what was in doubt is seen again: from here on as any other venting.
            memory.state = State::Vent;
            Transition::None
        }
        State::Fault => Transition::None,
        State::Vent if memory.latched.is_empty() && memory.sound_frames >= FRAMES_TO_ARM => {
            memory.state = State::Standby;
            (memory.cause, memory.sound_frames) = (None, 0);
            Transition::Recovered
        }
        State::Vent => Transition::None,
    }
}

fn arm(memory: &mut Memory, inputs: &Inputs<'_>) -> Transition {
    let asked = matches!(inputs.request, Some(Request::Arm | Request::Play));
    let by_itself = inputs.arming == Arming::Automatic && memory.may_arm_itself && inputs.request.is_none();
    if inputs.tick != Tick::Frame || !(asked || by_itself) || !memory.can_arm(inputs.conditions) {
        return Transition::None;
    }
    memory.state = State::Run;
    (memory.cause, memory.reverted, memory.good_ticks) = (None, None, 0);
    memory.may_arm_itself = inputs.request != Some(Request::Play);
    Transition::Armed(if asked { Arming::Manual } else { Arming::Automatic })
}

/// RUN, HOLD and REVERT among each other.
fn control(memory: &mut Memory, worst: Option<Condition>) -> Transition {
    match worst {
        Some(condition) if condition.severity() == Severity::Revert => {
            memory.good_ticks = 0;
            memory.state = State::Revert;
            let news = memory.reverted.is_none_or(|before| condition.rank() > before.rank());
            if news {
                memory.reverted = Some(condition);
                return Transition::Reverted(condition);
            }
            Transition::None
        }
        Some(condition) => {
            memory.good_ticks = 0;
            let news = memory.state != State::Hold;
            memory.state = State::Hold;
            memory.cause = Some(condition);
            if news { Transition::Held(condition) } else { Transition::None }
        }
        None => {
            memory.good_ticks = memory.good_ticks.saturating_add(1);
            match memory.state {
                State::Hold if memory.good_ticks >= GOOD_TICKS_AFTER_HOLD => {
                    memory.state = if memory.reverted.is_some() { State::Revert } else { State::Run };
                    (memory.cause, memory.good_ticks) = (None, 0);
                    Transition::Resumed
                }
                State::Revert if may_return(memory) => {
                    memory.state = State::Run;
                    (memory.reverted, memory.good_ticks) = (None, 0);
                    memory.returns += 1;
                    Transition::Returned
                }
                _ => Transition::None,
            }
        }
    }
}

fn may_return(memory: &Memory) -> bool {
    memory.good_ticks >= GOOD_TICKS_AFTER_REVERT
        && memory.returns < RETURNS_PER_PERIOD
        // A policy that gave no usable answer is not asked again.
        && memory.reverted != Some(Condition::PolicyRefused)
}
