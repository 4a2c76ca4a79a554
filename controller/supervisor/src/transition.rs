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

use crate::action::{Acknowledgement, Action, Actuation, ControlledBy, Integration, Transition};
use crate::condition::{Condition, Latch, Severity};
use crate::inputs::{Arming, Inputs, Request, Tick};
use crate::memory::{FRAMES_TO_ARM, Memory};
use crate::state::State;

/// Good ticks after which HOLD is left (study of the daemon, §3.4).
pub const GOOD_TICKS_AFTER_HOLD: u32 = 5;
/// Good ticks after which REVERT is left (study of the daemon, §3.4).
pub const GOOD_TICKS_AFTER_REVERT: u32 = 50;
/// Returns from REVERT that are made without a person in [`RETURN_PERIOD_TICKS`] (study of the daemon, §3.4).
pub const RETURNS_PER_PERIOD: u8 = 3;
/// Period of [`RETURNS_PER_PERIOD`]: 10 minutes.
pub const RETURN_PERIOD_TICKS: u32 = 30_000;

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

/// Decides about integration: what is in doubt is not integrated, also where something worse has made another state of it.
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
    (memory.sound_frames, memory.settling_frames) = (0, 0);
    (memory.good_ticks, memory.reverted) = (0, None);
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
        memory.settling_frames = memory.settling_frames.saturating_sub(1);
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
            // The frames that ended the venting are those that arming asks for: whoever is told that it stands by can arm it. By itself
            // it waits for as many again, so that a cause that comes and goes does not switch pump and valves each time.
            memory.state = State::Standby;
            (memory.cause, memory.settling_frames) = (None, FRAMES_TO_ARM);
            Transition::Recovered
        }
        State::Vent => Transition::None,
    }
}

fn arm(memory: &mut Memory, inputs: &Inputs<'_>) -> Transition {
    let asked = matches!(inputs.request, Some(Request::Arm | Request::Play));
    let may_arm_itself = memory.may_arm_itself && memory.settling_frames == 0;
    let by_itself = inputs.arming == Arming::Automatic && may_arm_itself && inputs.request.is_none();
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
