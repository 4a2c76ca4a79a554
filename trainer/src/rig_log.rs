//! Messages of `trainer rig` while it runs: events, spoilt frames, and counts at the end.

use std::io::Write;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use proto::emulator::{Event, GroundTruth, Statistics, TruthObserver};
use serde_json::{Map, Value, json};

use crate::failure::Failure;
use crate::stdout;

/// Events that may wait to be told; beyond it they are dropped rather than hold the emulator up.
const WAITING: usize = 1024;
/// Event lines in a second; a client gone wild must not fill a disk.
const LINES_PER_S: u32 = 20;

/// Items that the emulator's thread hands over.
#[derive(Debug)]
pub(crate) enum Seen {
    Event(Event),
    /// The last edge that was asked for has passed.
    TimeOver,
}

/// A watcher that hands over events, and says when edge number `last_edge` (from 1) has passed.
pub(crate) fn watcher(last_edge: Option<u64>) -> (Box<dyn TruthObserver>, Receiver<Seen>) {
    let (sender, receiver) = sync_channel(WAITING);
    (Box::new(Forward { sender, last_edge }), receiver)
}

struct Forward {
    sender: SyncSender<Seen>,
    last_edge: Option<u64>,
}

impl TruthObserver for Forward {
    fn tick(&mut self, truth: &GroundTruth) {
        if self.last_edge == Some(truth.edge + 1) {
            // No room: the counts tell it as well, a little later.
            let _ = self.sender.try_send(Seen::TimeOver);
        }
    }

    fn event(&mut self, event: &Event) {
        let _ = self.sender.try_send(Seen::Event(event.clone()));
    }
}

/// Lines for people, on standard output, or on standard error where that is kept for JSON.
pub(crate) struct Log {
    json: bool,
    started: Instant,
    second: u64,
    lines: u32,
    untold: u64,
    spoilt: u64,
}

impl Log {
    pub(crate) fn new(json: bool) -> Self {
        Log { json, started: Instant::now(), second: 0, lines: 0, untold: 0, spoilt: 0 }
    }

    /// A line as it is.
    pub(crate) fn line(&self, text: &str) {
        // An emulator whose lines no one takes goes on emulating.
        let _ = if self.json {
            writeln!(std::io::stderr().lock(), "{text}")
        } else {
            let mut out = std::io::stdout().lock();
            writeln!(out, "{text}").and_then(|()| out.flush())
        };
    }

    /// Something happened.
    pub(crate) fn event(&mut self, event: &Event) {
        self.timed(&event.to_string());
    }

    /// Tells what the fault script did to frames since the last look.
    pub(crate) fn counts(&mut self, counts: &Statistics) {
        let new = counts.frames_spoilt.saturating_sub(self.spoilt);
        if new > 0 {
            self.spoilt = counts.frames_spoilt;
            self.timed(&format!("fault script: {new} frames spoilt, {} in all", counts.frames_spoilt));
        }
    }

    /// The final counts.
    ///
    /// # Errors
    /// Standard output cannot be written.
    pub(crate) fn end(&mut self, counts: &Statistics) -> Result<(), Failure> {
        self.tell_untold();
        if self.json {
            let object: Map<String, Value> =
                rows(counts).iter().map(|(key, _, n)| ((*key).to_owned(), json!(n))).collect();
            return stdout::say_json(&Value::Object(object));
        }
        stdout::say(&table(counts))
    }

    /// A line with the time since the start in s, unless there were too many in this second.
    fn timed(&mut self, text: &str) {
        let now = self.started.elapsed();
        if now.as_secs() != self.second {
            self.tell_untold();
            (self.second, self.lines) = (now.as_secs(), 0);
        }
        self.lines += 1;
        if self.lines > LINES_PER_S {
            self.untold += 1;
            return;
        }
        self.line(&stamped(now, text));
    }

    fn tell_untold(&mut self) {
        if self.untold > 0 {
            self.line(&stamped(self.started.elapsed(), &format!("{} more events, not shown", self.untold)));
            self.untold = 0;
        }
    }
}

fn stamped(since: Duration, text: &str) -> String {
    let line: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    format!("{:10.3} s  {line}", since.as_secs_f64())
}

/// Key, words and value of each count; those that are zero in sound operation come last.
fn rows(counts: &Statistics) -> [(&'static str, &'static str, u64); 20] {
    [
        ("edges", "ticks", counts.edges),
        ("senses", "SENSE frames", counts.senses),
        ("sessions", "sessions", counts.sessions),
        ("commands_taken", "COMMANDs applied", counts.commands_taken),
        ("missed", "ticks without a COMMAND", counts.missed),
        ("stalled_ticks", "ticks this machine stalled", counts.stalled_ticks),
        ("rejected_session", "COMMANDs of no open session", counts.rejected_session),
        ("rejected_sequence", "COMMANDs not newer", counts.rejected_sequence),
        ("rejected_duty", "COMMANDs with a duty outside 0 to 1", counts.rejected_duty),
        ("rejected_tripped", "COMMANDs while tripped", counts.rejected_tripped),
        ("damaged", "damaged frames", counts.damaged),
        ("trips_over_pressure", "trips by over-pressure", counts.trips_over_pressure),
        ("trips_command_lost", "trips by lost commands", counts.trips_command_lost),
        ("trips_sensor", "trips by a broken sensor", counts.trips_sensor),
        ("trips_operator", "trips by an operator's stop", counts.trips_operator),
        ("links_lost", "links lost", counts.links_lost),
        ("turned_away", "clients turned away", counts.turned_away),
        ("hellos_refused", "HELLOs refused", counts.hellos_refused),
        ("frames_spoilt", "frames spoilt by the fault script", counts.frames_spoilt),
        ("waits_over", "waits for an answer given up", counts.waits_over),
    ]
}

/// Rows told even where they are zero.
const ALWAYS: usize = 5;

fn table(counts: &Statistics) -> String {
    let told = |(index, row): (usize, &(&str, &str, u64))| index < ALWAYS || row.2 > 0;
    let seconds = counts.edges as f64 * 0.02;
    let mut text = format!("stopped after {seconds:.2} s of the rig's time\n");
    for (_, (_, words, count)) in rows(counts).iter().enumerate().filter(|row| told((row.0, row.1))) {
        text.push_str(&format!("{count:>10}  {words}\n"));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_leaves_out_what_did_not_happen() {
        let counts = Statistics { edges: 3000, senses: 2990, sessions: 1, trips_sensor: 2, ..Statistics::default() };
        let text = table(&counts);
        assert!(text.starts_with("stopped after 60.00 s"), "{text}");
        assert_eq!(text.lines().count(), 1 + ALWAYS + 1, "{text}");
        assert!(text.contains("         2  trips by a broken sensor") && !text.contains("damaged"), "{text}");
    }

    #[test]
    fn json_has_every_count_that_the_emulator_keeps() {
        // Debug prints each field once: a count added to the emulator and forgotten here shows.
        let shown = format!("{:?}", Statistics::default());
        for field in shown.trim_start_matches("Statistics { ").trim_end_matches(" }").split(", ") {
            let (name, _) = field.split_once(": ").unwrap();
            assert!(rows(&Statistics::default()).iter().any(|(key, _, _)| *key == name), "{name}");
        }
    }
}
