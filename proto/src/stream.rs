//! Messages of the daemon to those who watch it live: its ticks, events and state over a local socket, one way.
//!
//! A run of messages, each `u32 length (little-endian) · u8 kind · payload`, `length` counting kind and payload. Payloads
//! are those of recordings, so that a viewer shows live what it shows later:
//!
//! | kind | payload |
//! | --- | --- |
//! | 1 | a tick: wall clock in ns (u64, little-endian), then a `pneumatic.Tick` |
//! | 2 | an event: a `foxglove.Log` |
//! | 3 | about the run, once at the beginning: a JSON object of texts (program, policy, model, reference …) |
//! | 4 | the policies and their stages, whenever they change: JSON |
//! | 5 | the daemon's state ([`DaemonState`]), at the beginning, whenever it changes, and once a second: JSON |
//!
//! Ticks end with the link to the cRIO; the state goes on being told, with the age of the newest data.
//!
//! Kinds of a later version are passed over. Nothing is ever read from a viewer.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::recording::{
    Event, EventLevel, TickRecord, decode_log_message, decode_tick_message, encode_log_message, encode_tick_message,
};

/// Longest message that a reader takes; a tick has about 800 bytes.
pub const LONGEST: usize = 1 << 20;

/// One message.
#[derive(Debug, Clone, PartialEq)]
pub enum Message {
    /// A tick.
    Tick {
        /// Wall clock of its frame (ns since 1970).
        unix_ns: u64,
        /// The tick, without its raw frames.
        tick: Box<TickRecord>,
    },
    /// An event.
    Event(Event),
    /// Facts about the run, by name.
    About(BTreeMap<String, String>),
    /// Policies and their stages, as JSON.
    Policies(String),
    /// The daemon's state.
    State(DaemonState),
}

/// The daemon's state as `controller status` answers it, with or without a session.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct DaemonState {
    /// Code of the state.
    pub state: u8,
    /// Code of the condition behind a venting or the end of the last session; 0 for none.
    pub fault: u16,
    /// Code of the worst condition that waits for a person; 0 for none.
    pub waits: u16,
    /// The session; 0 without one.
    pub session: u32,
    /// Age of the newest data, in ms; absent before the first.
    pub age_ms: Option<u64>,
    /// Name of the policy that controls once armed, or `fallback`.
    pub policy: String,
    /// SHA-256 of its file; empty for the fallback.
    pub policy_sha256: String,
    /// Name of the model in force.
    pub model: String,
    /// SHA-256 of the model as the recording holds it.
    pub model_sha256: String,
    /// Name of the reference that is followed once armed.
    pub reference: String,
    /// Bytes that may still be written where recordings go; absent where that is not known.
    pub recording_free_bytes: Option<u64>,
}

impl DaemonState {
    /// True where it says the same as another one, but for what changes all the time: the age of the data, and the room for
    /// recordings.
    pub fn says_the_same(&self, other: &DaemonState) -> bool {
        let recording_free_bytes = other.recording_free_bytes;
        DaemonState { age_ms: other.age_ms, recording_free_bytes, ..self.clone() } == *other
    }
}

/// Why bytes are no messages of ours.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum StreamError {
    /// A length that no message has.
    #[error(
        "a message of {0} bytes; the longest has {LONGEST}: is that the controller's live socket, of this version?"
    )]
    Length(usize),
    /// A payload that cannot be read.
    #[error("a message of kind {kind} cannot be read: {problem}")]
    Payload {
        /// Kind.
        kind: u8,
        /// Problem.
        problem: String,
    },
}

/// Appends a tick.
pub fn put_tick(unix_ns: u64, tick: &TickRecord, out: &mut Vec<u8>) {
    put(1, out, |out| {
        out.extend_from_slice(&unix_ns.to_le_bytes());
        encode_tick_message(tick, out);
    });
}

/// Appends an event.
pub fn put_event(unix_ns: u64, level: EventLevel, part: &str, message: &str, out: &mut Vec<u8>) {
    put(2, out, |out| encode_log_message(unix_ns, level, part, message, out));
}

/// Appends what is known about the run.
pub fn put_about(about: &BTreeMap<String, String>, out: &mut Vec<u8>) {
    put(3, out, |out| out.extend(serde_json::to_vec(about).unwrap_or_default()));
}

/// Appends the policies and their stages, JSON.
pub fn put_policies(json: &str, out: &mut Vec<u8>) {
    put(4, out, |out| out.extend_from_slice(json.as_bytes()));
}

/// Appends the daemon's state.
pub fn put_state(state: &DaemonState, out: &mut Vec<u8>) {
    put(5, out, |out| out.extend(serde_json::to_vec(state).unwrap_or_default()));
}

fn put(kind: u8, out: &mut Vec<u8>, payload: impl FnOnce(&mut Vec<u8>)) {
    let begin = out.len();
    out.extend_from_slice(&[0, 0, 0, 0, kind]);
    payload(out);
    let length = u32::try_from(out.len() - begin - 4).unwrap_or(u32::MAX);
    if let Some(place) = out.get_mut(begin..begin + 4) {
        place.copy_from_slice(&length.to_le_bytes());
    }
}

/// Puts messages together again from the pieces in which they come.
#[derive(Debug, Default)]
pub struct StreamReader {
    bytes: Vec<u8>,
    taken: usize,
}

impl StreamReader {
    /// Takes bytes as they came.
    pub fn push(&mut self, bytes: &[u8]) {
        self.bytes.drain(..self.taken);
        self.taken = 0;
        self.bytes.extend_from_slice(bytes);
    }

    /// The next whole message; `None` when more bytes are needed.
    ///
    /// # Errors
    /// The bytes are no messages; nothing sensible follows.
    #[allow(clippy::should_implement_trait, reason = "an iterator would end at the first pause")]
    pub fn next(&mut self) -> Result<Option<Message>, StreamError> {
        loop {
            let rest = self.bytes.get(self.taken..).unwrap_or_default();
            let Some((length, rest)) = rest.split_first_chunk::<4>() else { return Ok(None) };
            let length = u32::from_le_bytes(*length) as usize;
            if length == 0 || length > LONGEST {
                return Err(StreamError::Length(length));
            }
            let Some(([kind], payload)) = rest.get(..length).and_then(|whole| whole.split_first_chunk::<1>()) else {
                return Ok(None);
            };
            let message = decode(*kind, payload)?;
            self.taken += 4 + length;
            if let Some(message) = message {
                return Ok(Some(message));
            }
        }
    }
}

/// A message; `None` for a kind of a later version.
fn decode(kind: u8, payload: &[u8]) -> Result<Option<Message>, StreamError> {
    let wrong = |problem: String| StreamError::Payload { kind, problem };
    Ok(Some(match kind {
        1 => {
            let (at, tick) = payload.split_first_chunk::<8>().ok_or_else(|| wrong("it is too short".to_owned()))?;
            let tick = Box::new(decode_tick_message(tick).map_err(wrong)?);
            Message::Tick { unix_ns: u64::from_le_bytes(*at), tick }
        }
        2 => Message::Event(decode_log_message(payload).map_err(wrong)?),
        3 => Message::About(serde_json::from_slice(payload).map_err(|e| wrong(e.to_string()))?),
        4 => Message::Policies(String::from_utf8_lossy(payload).into_owned()),
        5 => Message::State(serde_json::from_slice(payload).map_err(|e| wrong(e.to_string()))?),
        _ => return Ok(None),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn all() -> (Vec<u8>, Vec<Message>) {
        let tick = TickRecord {
            session: 7,
            tick: 9,
            p_pos_kpa: 91.25,
            p_neg_kpa: -70.5,
            ref_pos_kpa: 90.0,
            ..TickRecord::default()
        };
        let about: BTreeMap<String, String> = [("policy".to_owned(), "default \"x\"".to_owned())].into();
        let mut bytes = Vec::new();
        put_about(&about, &mut bytes);
        put_event(5_000_000_001, EventLevel::Error, "tick", "VENTED", &mut bytes);
        put(77, &mut bytes, |out| out.extend_from_slice(b"of a later version"));
        put_tick(6_000_000_000, &tick, &mut bytes);
        put_policies("[1]", &mut bytes);
        let state =
            DaemonState { state: 6, fault: 7, age_ms: Some(10_900), model: "m".to_owned(), ..Default::default() };
        put_state(&state, &mut bytes);
        let event = Event {
            unix_ns: 5_000_000_001,
            level: EventLevel::Error,
            part: "tick".to_owned(),
            message: "VENTED".to_owned(),
        };
        let messages = vec![
            Message::About(about),
            Message::Event(event),
            Message::Tick { unix_ns: 6_000_000_000, tick: Box::new(tick) },
            Message::Policies("[1]".to_owned()),
            Message::State(state),
        ];
        (bytes, messages)
    }

    /// NaN is no equal of NaN; its text is.
    fn text(messages: &[Message]) -> String {
        format!("{messages:?}")
    }

    proptest! {
        #[test]
        fn messages_come_back_whole_however_they_are_cut(size in 1_usize..200) {
            let (bytes, messages) = all();
            let (mut reader, mut found) = (StreamReader::default(), Vec::new());
            for piece in bytes.chunks(size) {
                reader.push(piece);
                while let Some(message) = reader.next().unwrap() {
                    found.push(message);
                }
            }
            prop_assert_eq!(text(&found), text(&messages));
        }

        #[test]
        fn no_bytes_make_it_panic_or_grow(bytes: Vec<u8>) {
            let mut reader = StreamReader::default();
            reader.push(&bytes);
            while let Ok(Some(_)) = reader.next() {}
        }
    }

    #[test]
    fn a_state_that_only_ages_says_the_same() {
        let state = |age_ms, fault| DaemonState { age_ms, fault, ..DaemonState::default() };
        assert!(state(None, 0).says_the_same(&state(Some(5_000), 0)));
        assert!(!state(None, 0).says_the_same(&state(None, 7)));
    }

    #[test]
    fn bytes_of_somebody_else_are_told() {
        let mut reader = StreamReader::default();
        reader.push(b"HTTP/1.1 400 Bad Request");
        assert!(matches!(reader.next(), Err(StreamError::Length(_))));
    }
}
