//! Facts that a report gives about a flight beside its ticks: place, equipment, messages.

use std::collections::BTreeMap;

use proto::recording::{Attachment, EventLevel, McapContent};

use crate::statistics::{FileState, Pacing, StatisticsOptions};

/// Attachments longer than this are named, not shown (bytes).
const LONGEST_TEXT: usize = 64 * 1024;

/// Names of the daemon's codes.
#[derive(Debug, Clone, Copy)]
pub struct CodeNames {
    /// Name of [`TickRecord::state`](proto::recording::TickRecord::state).
    pub state: fn(u8) -> &'static str,
    /// Name of [`TickRecord::fault`](proto::recording::TickRecord::fault), never asked for 0.
    pub fault: fn(u16) -> &'static str,
}

/// Time at which something was said.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum NoteTime {
    /// Daemon's monotonic clock, as `receive_ns` (ns).
    MonotonicNs(u64),
    /// Time of flight (s).
    FlightS(f64),
}

/// Something that was said during the flight.
#[derive(Debug, Clone, PartialEq)]
pub struct FlightNote {
    /// Time.
    pub at: NoteTime,
    /// Importance.
    pub level: EventLevel,
    /// Part that spoke.
    pub part: String,
    /// Message.
    pub message: String,
}

/// Everything about a flight that its ticks do not say; empty texts are left out of the report.
#[derive(Debug, Clone)]
pub struct FlightInfo {
    /// Heading of the page, for example `Demo: 60 s on the emulated rig bench`.
    pub title: String,
    /// Time at which it began, for example `2026-11-20T02:04:05.678Z`.
    pub started: String,
    /// Program and version.
    pub program: String,
    /// The command that a person typed.
    pub command: String,
    /// The plant: a real rig, or the emulated one's name.
    pub rig: String,
    /// The rig model behind MPObs and feed-forward.
    pub model_rig: String,
    /// The reference that was flown.
    pub reference: String,
    /// Name and SHA-256 of the policy's file; `None` when the built-in law flew.
    pub policy: Option<(String, String)>,
    /// Anything else, by name.
    pub extra: Vec<(String, String)>,
    /// Files to show as they are, by name: the configuration, the rig.
    pub files: Vec<(String, String)>,
    /// Messages.
    pub notes: Vec<FlightNote>,
    /// Settling time, pacing, limits.
    pub options: StatisticsOptions,
    /// Time after its frame was due by which a command must be out (ms): a line in the plot of tick times.
    pub deadline_ms: Option<f64>,
    /// Names of the codes.
    pub codes: CodeNames,
}

impl FlightInfo {
    /// A flight about which nothing more is known.
    pub fn new(title: &str, codes: CodeNames, options: StatisticsOptions) -> Self {
        Self {
            title: title.to_owned(),
            started: String::new(),
            program: String::new(),
            command: String::new(),
            rig: String::new(),
            model_rig: String::new(),
            reference: String::new(),
            policy: None,
            extra: Vec::new(),
            files: Vec::new(),
            notes: Vec::new(),
            options,
            deadline_ms: None,
            codes,
        }
    }

    /// Reads the facts about a flight from its recording.
    ///
    /// The entries `rig`, `model_rig`, `reference` and `command` of
    /// [`RecordingInfo::extra`](proto::recording::RecordingInfo) get their places; all others are listed.
    /// The pacing and the state of the file follow the recording's, whatever `options` say.
    pub fn from_recording(title: &str, content: &McapContent, codes: CodeNames, options: StatisticsOptions) -> Self {
        let mut entries: BTreeMap<String, String> = content.metadata.clone();
        let mut take = |key: &str| entries.remove(key).unwrap_or_default();
        let (started, started_ns) = (take("started"), take("started_monotonic_ns"));
        let lockstep = take("log_time").starts_with("tick");
        let (policy, sha256) = (take("policy_name"), take("policy_sha256"));
        let [program, command, rig, model_rig, reference] =
            ["program", "command", "rig", "model_rig", "reference"].map(&mut take);
        let epoch = unix_ns(&started);
        let note_time = |at_unix_ns: u64| {
            let since_ns = i128::from(at_unix_ns) - i128::from(epoch.unwrap_or(at_unix_ns));
            if lockstep {
                return NoteTime::FlightS(since_ns as f64 / 1e9);
            }
            let at_ns = i128::from(started_ns.parse::<u64>().unwrap_or(0)) + since_ns;
            NoteTime::MonotonicNs(u64::try_from(at_ns.max(0)).unwrap_or(u64::MAX))
        };
        let note = |event: &proto::recording::Event| FlightNote {
            at: note_time(event.unix_ns),
            level: event.level,
            part: event.part.clone(),
            message: event.message.clone(),
        };
        let pacing = if lockstep { Pacing::Lockstep } else { Pacing::Realtime };
        Self {
            started,
            program,
            command,
            rig,
            model_rig,
            reference,
            policy: (!policy.is_empty()).then_some((policy, sha256)),
            extra: entries.into_iter().collect(),
            files: content.attachments.iter().filter_map(shown).collect(),
            notes: content.events.iter().map(note).collect(),
            ..Self::new(title, codes, StatisticsOptions { pacing, file_state: FileState::of(content), ..options })
        }
    }
}

/// An attachment that is text and not too long for a page.
fn shown(attachment: &Attachment) -> Option<(String, String)> {
    let text = std::str::from_utf8(&attachment.data).ok().filter(|text| text.len() <= LONGEST_TEXT)?;
    Some((attachment.name.clone(), text.to_owned()))
}

/// `2026-11-20T02:04:05.678Z` as nanoseconds since 1970; `None` for anything else.
fn unix_ns(text: &str) -> Option<u64> {
    let (date, time) = text.strip_suffix('Z')?.split_once('T')?;
    let mut date = date.split('-').map(|part| part.parse::<u64>().ok());
    let (year, month, day) = (date.next()??, date.next()??, date.next()??);
    let mut clock = time.split(':');
    let hour: u64 = clock.next()?.parse().ok()?;
    let minute: u64 = clock.next()?.parse().ok()?;
    let (second, millis) = clock.next()?.split_once('.')?;
    let (second, millis): (u64, u64) = (second.parse().ok()?, millis.parse().ok()?);
    if !(1970..3000).contains(&year) || !(1..=12).contains(&month) || !(1..=31).contains(&day) {
        return None;
    }
    // Years that begin in March, so that the leap day is the last.
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let days = 365 * year + year / 4 - year / 100 + year / 400 + (153 * month + 2) / 5 + day - 1 - 719_468;
    Some((((days * 24 + hour) * 60 + minute) * 60 + second) * 1_000_000_000 + millis * 1_000_000)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn starts_read_back_as_gnu_date_has_them() {
        // `date -u -d '…' +%s`
        let at = |text| unix_ns(text).map(|ns| ns / 1_000_000);
        assert_eq!(at("1970-01-01T00:00:00.000Z"), Some(0));
        assert_eq!(at("2000-02-29T00:00:00.007Z"), Some(951_782_400_007));
        assert_eq!(at("2026-11-20T02:04:05.678Z"), Some(1_795_140_245_678));
        assert_eq!(at("2100-03-01T00:00:00.000Z"), Some(4_107_542_400_000));
        assert_eq!(["", "yesterday", "2026-13-01T00:00:00.000Z", "2026-11-20T02:04Z"].map(at), [None; 4]);
    }
}
