//! Reason why there is no session, in words for a person: often the one who writes the cRIO's program.

use std::io;

use proto::wire::{ByeReason, FrameType, HELLO_LENGTH, HelloRefusal, WireError};

/// Reason why there is no session.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// The address has no host, or the name is not known.
    #[error("{address}: {source}; check link.address")]
    Resolve {
        /// As configured.
        address: String,
        /// Error of the system.
        source: io::Error,
    },
    /// The address is silent.
    #[error("{address}: {source}; is the cRIO on and its program running?")]
    Connect {
        /// As configured.
        address: String,
        /// Error of the system.
        source: io::Error,
    },
    /// The link broke during the handshake.
    #[error("{address}: the link broke during the handshake: {source}")]
    Broken {
        /// As configured.
        address: String,
        /// Error of the system.
        source: io::Error,
    },
    /// No HELLO came back.
    #[error("{address}: connected, but no HELLO came back within 1 s; is another program listening there?")]
    Silent {
        /// As configured.
        address: String,
    },
    /// No HELLO that counts came back, but something else did.
    #[error("{address}: connected, but no sound HELLO came back: {heard}; docs/protocol.md has frames to compare with")]
    Unanswered {
        /// As configured.
        address: String,
        /// Frame or bytes that came.
        heard: Heard,
    },
    /// The bytes are no frames.
    #[error("{address}: {error}")]
    Wire {
        /// As configured.
        address: String,
        /// The problem.
        error: WireError,
    },
    /// The HELLO that came back cannot open a session.
    #[error("{address}: {refusal}")]
    Refused {
        /// As configured.
        address: String,
        /// Reason.
        refusal: HelloRefusal,
    },
    /// The cRIO answered with another session.
    #[error("{address}: the cRIO answered session {found:08X} instead of {sent:08X}")]
    Session {
        /// As configured.
        address: String,
        /// Number that was asked for.
        sent: u32,
        /// Number that came back.
        found: u32,
    },
    /// The cRIO said BYE.
    #[error("{address}: the cRIO said BYE: {reason}")]
    Bye {
        /// As configured.
        address: String,
        /// Reason.
        reason: ByeReason,
    },
}

/// Bytes that came instead of a HELLO.
///
/// Frame or bytes that were heard, as they are told. A mistake has the same words with every attempt, so that it is told once. So
/// the numbers of a damaged frame are left out: the clock in it makes them new each time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Heard {
    /// A frame with another CRC than its bytes have.
    #[error(
        "the CRC of a {frame} that came does not fit its bytes; it is zlib's crc32 of all bytes before it, big-endian"
    )]
    WrongCrc {
        /// Type.
        frame: FrameType,
    },
    /// A frame with the right CRC, its lowest byte first.
    #[error("the CRC of a {frame} that came has its four bytes in reverse; every number is big-endian")]
    SwappedCrc {
        /// Type.
        frame: FrameType,
    },
    /// A frame that is damaged in another way.
    #[error("{0}")]
    Damaged(WireError),
    /// A sound frame before its time.
    #[error(
        "a {frame} came before it; the cRIO first answers the daemon's HELLO with one of its own that has the same session"
    )]
    Early {
        /// Type.
        frame: FrameType,
    },
    /// Less than a frame.
    #[error(
        "{bytes} bytes came and then no more, which is no whole frame; a HELLO has {HELLO_LENGTH}, its CRC included"
    )]
    Piece {
        /// Number found.
        bytes: usize,
    },
}

impl Heard {
    /// A frame that was dropped for this.
    pub(super) fn damaged(error: WireError) -> Self {
        match error {
            WireError::Crc { frame, found, computed, .. } if found == computed.swap_bytes() => {
                Heard::SwappedCrc { frame }
            }
            WireError::Crc { frame, .. } => Heard::WrongCrc { frame },
            error => Heard::Damaged(error),
        }
    }

    /// Bytes that are no whole frame, as something heard; `None` for no byte at all.
    pub(super) fn piece(bytes: usize) -> Option<Self> {
        (bytes > 0).then_some(Heard::Piece { bytes })
    }
}
