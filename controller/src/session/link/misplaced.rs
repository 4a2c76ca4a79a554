//! Sound frames that have no place in a session, as events carry and tell them.

/// A frame whose bytes came as they were sent, and that has no place in a session all the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Misplaced {
    /// It greets again, as a program does that has begun anew.
    Hello,
    /// It commands.
    Command,
    /// The reading belongs to another session.
    Sense {
        /// Session that it belongs to.
        session: u32,
    },
    /// One of its fields holds a code that the protocol does not name.
    UnknownCode {
        /// Place of the field in the frame, bytes from its start.
        offset: u8,
        /// Code.
        code: u8,
    },
}

impl Misplaced {
    /// Code and number as events carry them.
    pub(crate) fn numbers(self) -> [f64; 2] {
        match self {
            Misplaced::Hello => [1.0, 0.0],
            Misplaced::Command => [3.0, 0.0],
            Misplaced::Sense { session } => [2.0, f64::from(session)],
            Misplaced::UnknownCode { offset, code } => [4.0, f64::from(u16::from_be_bytes([offset, code]))],
        }
    }

    /// Text for people about the frame with these numbers.
    pub(crate) fn text([code, number]: [f64; 2]) -> String {
        match code as u8 {
            1 => "a HELLO in the middle of the session; has the cRIO's program begun anew?".to_owned(),
            3 => "a COMMAND, which only the daemon sends; is something else connected?".to_owned(),
            4 => {
                let [offset, code] = (number as u16).to_be_bytes();
                format!(
                    "a frame with the code {code} at byte {offset}, which the protocol does not name there (look at the cRIO's program)"
                )
            }
            _ => format!("a SENSE of session {:08X}, which is not this one", number as u32),
        }
    }
}
