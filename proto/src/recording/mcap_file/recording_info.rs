//! Statements of a recording about itself: who wrote it, when, with what.

use std::collections::BTreeMap;
use std::time::SystemTime;

use mcap::records::Metadata;

use super::wall_clock;

/// Name of the metadata record that every recording begins with.
pub(crate) const METADATA: &str = "recording";
/// Version of what this module writes; a reader refuses a later one.
pub(crate) const FORMAT: u32 = 1;
/// Which clock the messages' log times follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LogTime {
    /// When the frame arrived: a run in real time.
    #[default]
    Arrival,
    /// Tick × 20 ms: a run in lockstep, which may be faster than the clock on the wall.
    Tick,
}

impl LogTime {
    /// Word in a recording's metadata, under `log_time`.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Arrival => "arrival of the frame",
            Self::Tick => "tick x 20 ms (lockstep)",
        }
    }
}

/// Statements of a recording about itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordingInfo {
    /// Program and version that writes it, for example `controller 0.1.0`.
    pub program: String,
    /// Wall clock at the start.
    pub started: SystemTime,
    /// The daemon's monotonic clock at that moment (ns): the zero of `receive_ns` on the wall clock.
    pub started_ns: u64,
    /// Which clock the log times follow.
    pub log_time: LogTime,
    /// Name and SHA-256 (hexadecimal) of the active policy's file.
    pub policy: Option<(String, String)>,
    /// Seed of everything random in the run, where there was one.
    pub seed: Option<u64>,
    /// Anything else worth keeping, by name.
    pub extra: BTreeMap<String, String>,
}

impl RecordingInfo {
    /// Statements that a program starts with: now, arrival times, no policy, no seed.
    pub fn new(program: &str, started_ns: u64) -> Self {
        Self {
            program: program.to_owned(),
            started: SystemTime::now(),
            started_ns,
            log_time: LogTime::default(),
            policy: None,
            seed: None,
            extra: BTreeMap::new(),
        }
    }

    pub(crate) fn metadata(&self) -> Metadata {
        let mut entries = self.extra.clone();
        let mut put = |key: &str, value: String| entries.insert(key.to_owned(), value);
        put("format", FORMAT.to_string());
        put("program", self.program.clone());
        put("started", wall_clock::rfc3339(self.started));
        put("started_monotonic_ns", self.started_ns.to_string());
        put("log_time", self.log_time.words().to_owned());
        if let Some((name, sha256)) = &self.policy {
            put("policy_name", name.clone());
            put("policy_sha256", sha256.clone());
        }
        if let Some(seed) = self.seed {
            put("seed", seed.to_string());
        }
        Metadata { name: METADATA.to_owned(), metadata: entries }
    }
}

/// A file inside the recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Attachment {
    /// Name, for example `rig.toml`.
    pub name: String,
    /// Media type, for example `application/toml`.
    pub media_type: String,
    /// Bytes.
    pub data: Vec<u8>,
}
