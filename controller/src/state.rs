//! The daemon's states.
//!
//! ```text
//!              25 sound frames + arm            fault
//!   STANDBY ──────────────────────────▶ RUN ──────────▶ VENTED
//!      ▲  ▲                              │                 │
//!      │  └──────────── disarm ──────────┘                 │
//!      └──────── 25 sound frames after the cause ──────────┘
//! ```
//!
//! In STANDBY and VENTED both vents are open and the pump is off. A fault vents in the tick it is seen in.
//! Nothing arms again by itself, but (with `control.auto_arm`, for simulation) what only had to do with
//! the link. A lost link ends the session; the next one begins in STANDBY.

use crate::notice::Cause;

/// Sound frames that must have come before the rig can be armed: half a second.
pub const FRAMES_TO_ARM: u32 = 25;

/// What the daemon is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// Vents open, waiting to be armed.
    Standby,
    /// Controlling the pressures.
    Run,
    /// Vents open because of a fault.
    Vented(Cause),
}

impl State {
    /// The number that recordings and status carry.
    pub fn code(self) -> u8 {
        match self {
            State::Standby => 0,
            State::Run => 1,
            State::Vented(_) => 2,
        }
    }

    /// The fault's number, 0 for none.
    pub fn fault(self) -> u16 {
        if let State::Vented(cause) = self { cause as u16 } else { 0 }
    }

    /// The name of a recorded state code.
    pub fn name(code: u8) -> &'static str {
        match code {
            0 => "standby",
            1 => "run",
            2 => "vented",
            _ => "unknown",
        }
    }
}

/// A state with what its transitions count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Supervisor {
    state: State,
    sound: u32,
    auto_arm: bool,
    /// Whether `auto_arm` may act; a fault of pressure or sensors takes that away until the operator arms.
    may_arm_itself: bool,
    arm_wanted: bool,
    disarm_wanted: bool,
}

/// What [`Supervisor::accept_frame`] did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transition {
    /// Nothing.
    None,
    /// Armed, by itself or by the operator.
    Armed {
        /// By itself.
        auto: bool,
    },
    /// Disarmed by the operator.
    Disarmed,
    /// The cause of venting is over.
    Recovered,
}

impl Supervisor {
    /// Starts in STANDBY.
    pub fn new(auto_arm: bool) -> Self {
        Supervisor {
            state: State::Standby,
            sound: 0,
            auto_arm,
            may_arm_itself: true,
            arm_wanted: false,
            disarm_wanted: false,
        }
    }

    /// The state.
    pub fn state(&self) -> State {
        self.state
    }

    /// Whether the rig can be armed now.
    pub fn can_arm(&self) -> bool {
        self.state == State::Standby && self.sound >= FRAMES_TO_ARM
    }

    /// The operator asks to arm; it happens at the next sound frame, if it can.
    pub fn arm(&mut self) {
        self.arm_wanted = true;
    }

    /// The operator asks to disarm; it happens at the next frame.
    pub fn disarm(&mut self) {
        self.disarm_wanted = true;
        self.may_arm_itself = false;
    }

    /// A new session: from STANDBY, counting anew.
    pub fn session_opened(&mut self) {
        self.state = State::Standby;
        self.sound = 0;
        self.arm_wanted = false;
    }

    /// A frame with nothing wrong in it.
    pub fn accept_frame(&mut self) -> Transition {
        self.sound = self.sound.saturating_add(1);
        let arm = std::mem::take(&mut self.arm_wanted);
        let disarm = std::mem::take(&mut self.disarm_wanted);
        match self.state {
            State::Run if disarm => {
                self.state = State::Standby;
                Transition::Disarmed
            }
            State::Vented(_) if self.sound >= FRAMES_TO_ARM => {
                self.state = State::Standby;
                self.sound = 0;
                Transition::Recovered
            }
            State::Standby if self.can_arm() && !disarm && (arm || (self.auto_arm && self.may_arm_itself)) => {
                self.state = State::Run;
                self.may_arm_itself = true;
                Transition::Armed { auto: !arm }
            }
            _ => Transition::None,
        }
    }

    /// Something is wrong; answers whether this is news.
    pub fn fault(&mut self, cause: Cause) -> bool {
        self.sound = 0;
        self.arm_wanted = false;
        let news = self.state != State::Vented(cause) && (self.state == State::Run || self.state == State::Standby);
        if news {
            self.state = State::Vented(cause);
            self.may_arm_itself &= cause.clears_by_itself();
        }
        news
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sound(supervisor: &mut Supervisor, frames: u32) -> Vec<Transition> {
        (0..frames).map(|_| supervisor.accept_frame()).filter(|t| *t != Transition::None).collect()
    }

    #[test]
    fn arms_only_after_sound_frames_and_only_when_asked() {
        let mut s = Supervisor::new(false);
        s.arm();
        assert!(sound(&mut s, 1000).is_empty(), "asked too early: forgotten");
        s.arm();
        assert_eq!(sound(&mut s, 1), [Transition::Armed { auto: false }]);
        s.disarm();
        assert_eq!(sound(&mut s, 1), [Transition::Disarmed]);
    }

    #[test]
    fn every_cause_vents_at_once_and_only_link_causes_arm_again() {
        for cause in [
            Cause::FramesMissing,
            Cause::SensorPositive,
            Cause::SensorNegative,
            Cause::OverPressure,
            Cause::OverVacuum,
            Cause::CrioTripped,
            Cause::LinkLost,
            Cause::LawNotFinite,
        ] {
            let mut s = Supervisor::new(true);
            assert_eq!(sound(&mut s, FRAMES_TO_ARM), [Transition::Armed { auto: true }]);
            assert!(s.fault(cause));
            assert_eq!(s.state(), State::Vented(cause));
            assert!(!s.fault(cause), "told once");
            assert!(sound(&mut s, FRAMES_TO_ARM - 1).is_empty());
            assert_eq!(sound(&mut s, 1), [Transition::Recovered]);
            let again = sound(&mut s, 10 * FRAMES_TO_ARM);
            assert_eq!(again.is_empty(), !cause.clears_by_itself(), "{cause:?}");
        }
    }
}
