//! Command in force, duty echo, state, pump and trip bits: whether the cRIO does what it was told.

use model::observation::{CHANNELS, Pair};
use proto::wire::{CrioState, Mode, Sense};
use supervisor::{Condition, ConditionSet};

use crate::loss_window::{COMMANDS_TO_VENT, LossWindow, Outcome};

/// Frames in a row that must disagree: the vents are open within three ticks, and one late command is no reason
/// (study of the daemon, §3.6).
pub const FRAMES_THAT_DISAGREE: u32 = 3;
/// The oldest command that may be in force, counted from the newest that was sent: time to live and one tick.
const OLDEST_IN_FORCE: usize = 3;
/// Difference that an echo may have from the command, in duty: a driver of 8 bits rounds by 0.002 (chosen).
const ECHO_TOLERANCE: f64 = 0.01;
/// Commands remembered.
const REMEMBERED: usize = 8;

/// A command as it went out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SentCommand {
    /// Sequence number.
    pub sequence: u32,
    /// Duties, positive and negative valve.
    pub duty: Pair,
    /// Mode.
    pub mode: Mode,
    /// True where it switches the pump on.
    pub pump_on: bool,
}

/// Compares what the cRIO reports with what it was told.
#[derive(Debug, Clone, Copy)]
pub struct CommandEcho {
    /// The newest first.
    sent: [Option<SentCommand>; REMEMBERED],
    force: LossWindow,
    echo: LossWindow,
    state: LossWindow,
    pump: LossWindow,
    missed: LossWindow,
    /// The cRIO's count of commands that it missed, as it was.
    missed_before: Option<u16>,
}

impl CommandEcho {
    /// Nothing was sent yet.
    pub fn new() -> Self {
        let none = LossWindow::new();
        CommandEcho {
            sent: [None; REMEMBERED],
            force: none,
            echo: none,
            state: none,
            pump: none,
            missed: none,
            missed_before: None,
        }
    }

    /// Remembers a command that went out.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn sent(&mut self, command: SentCommand) {
        self.sent.rotate_right(1);
        if let Some(first) = self.sent.first_mut() {
            *first = Some(command);
        }
    }

    /// Finds trip bits without a trip, which one frame decides.
    ///
    /// # Real-time
    /// May run in the tick.
    pub(crate) fn judge_trip_bits(sense: &Sense, found: &mut ConditionSet) {
        if sense.state != CrioState::Tripped && !sense.trips.is_empty() {
            found.insert(Condition::TripBits, f64::from(sense.trips.bits()));
        }
    }

    /// Compares a frame; what disagrees three frames in a row, or off and on, is found.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn judge(&mut self, sense: &Sense, found: &mut ConditionSet) {
        CommandEcho::judge_trip_bits(sense, found);
        // Before the cRIO can have taken up three commands there is nothing to compare; in a trip none is in force.
        if self.sent.get(OLDEST_IN_FORCE).is_none_or(Option::is_none) || sense.state == CrioState::Tripped {
            *self = CommandEcho { sent: self.sent, ..CommandEcho::new() };
            return;
        }
        self.count_missed(sense.commands_missed, found);
        let agreeing = |agrees| if agrees { Outcome::Good } else { Outcome::Bad };
        let place = self.sent.iter().position(|c| c.is_some_and(|c| c.sequence == sense.command_in_force));
        let fresh = place.is_some_and(|place| place <= OLDEST_IN_FORCE);
        self.force.push(agreeing(fresh));
        // Where the number is no help, the newest command is what should be in force.
        let Some(command) = self.sent.get(place.unwrap_or(0)).copied().flatten() else { return };
        let expected = if command.mode == Mode::Vent { [1.0; CHANNELS] } else { command.duty };
        let near = |c: usize| {
            let echo = sense.duty.get(c).copied().map_or(f64::NAN, f64::from);
            expected.get(c).is_some_and(|duty| (echo - duty).abs() <= ECHO_TOLERANCE)
        };
        self.echo.push(agreeing(near(0) && near(1)));
        let reported = match command.mode {
            Mode::Vent => true,
            Mode::Run => sense.state == CrioState::Running,
            // A cRIO that makes no difference between both does what it is told all the same.
            Mode::Hold => matches!(sense.state, CrioState::Holding | CrioState::Running),
        };
        self.state.push(agreeing(reported));
        let wanted = command.mode != Mode::Vent && command.pump_on;
        self.pump.push(agreeing(!wanted || sense.pump_running));
        for (frames, condition, value) in [
            (self.force, Condition::CommandNotInForce, f64::from(sense.command_in_force)),
            (self.echo, Condition::EchoWrong, f64::from(sense.duty[usize::from(near(0))])),
            (self.state, Condition::CrioIdle, f64::from(sense.state.code())),
            (self.pump, Condition::PumpOff, 0.0),
        ] {
            if frames.stands(FRAMES_THAT_DISAGREE) {
                found.insert(condition, value);
            }
        }
    }

    /// Counts the frames in which the cRIO says that it has missed a further command.
    fn count_missed(&mut self, missed: u16, found: &mut ConditionSet) {
        let before = self.missed_before.replace(missed).unwrap_or(missed);
        let of_100 = self.missed.push(if missed == before { Outcome::Good } else { Outcome::Bad });
        if of_100 > COMMANDS_TO_VENT {
            found.insert(Condition::CommandsScarce, f64::from(of_100));
        }
    }

    /// Frames in a row that did not report what was commanded.
    pub fn disagreeing(&self) -> u32 {
        self.echo.in_a_row().max(self.force.in_a_row())
    }
}

impl Default for CommandEcho {
    fn default() -> Self {
        CommandEcho::new()
    }
}
