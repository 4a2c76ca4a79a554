//! Orders of other threads that the tick took while a run went on, as a recording keeps them so that it can be replayed.
//!
//! Each is a small JSON file inside, named [`crate::recording::mcap_file::attached::ORDER`], in the order in which they were given. The files that
//! they speak of stand beside them under their own names: policies, told apart by their SHA-256, and models, one for each
//! order of a model in its turn.

use serde::{Deserialize, Serialize};

/// An order.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "order")]
pub enum TickOrder {
    /// A policy is tried, from shadow on.
    Prove {
        /// SHA-256 of its file, lower-case hexadecimal; absent for the fallback.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sha256: Option<String>,
    },
    /// A policy that has been active before takes over within half a second.
    Resume {
        /// SHA-256 of its file, lower-case hexadecimal; absent for the fallback.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sha256: Option<String>,
    },
    /// Back to what was active before, or from a candidate to what is active.
    Rollback,
    /// Another model takes over.
    Model {
        /// Ticks under control, counted from the start of the daemon, that it had run along with.
        followed: u64,
    },
}

impl TickOrder {
    /// Bytes inside a recording.
    pub fn to_json(&self) -> Vec<u8> {
        // Strings and whole numbers alone: nothing that could not be written.
        serde_json::to_vec(self).unwrap_or_default()
    }

    /// Reads it back; `None` where a later version wrote an order of another kind.
    pub fn from_json(bytes: &[u8]) -> Option<Self> {
        serde_json::from_slice(bytes).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_back_and_reads_plainly() {
        for (order, text) in [
            (TickOrder::Prove { sha256: Some("ab".to_owned()) }, r#"{"order":"prove","sha256":"ab"}"#),
            (TickOrder::Resume { sha256: None }, r#"{"order":"resume"}"#),
            (TickOrder::Rollback, r#"{"order":"rollback"}"#),
            (TickOrder::Model { followed: 7 }, r#"{"order":"model","followed":7}"#),
        ] {
            assert_eq!(String::from_utf8(order.to_json()).unwrap(), text);
            assert_eq!(TickOrder::from_json(text.as_bytes()), Some(order));
        }
        assert_eq!(TickOrder::from_json(br#"{"order":"dance"}"#), None);
    }
}
