//! Occurrences during a flight: found in the ticks themselves, and what the daemon said.
//!
//! Stretches of the same trouble are one entry with its length. Of each kind at most 20 are listed, with
//! a line that says how many more there were: a flight with 3,000 missed deadlines needs one sentence
//! and not 3,000.

use proto::recording::{Arrival, EventLevel};

use crate::flight_info::{CodeNames, FlightNote};
use crate::flight_rows::{Flight, Row};
use crate::statistics::{Pacing, Stage};
use crate::wording;

/// The most entries of one kind.
const MOST: usize = 20;

/// One thing that happened.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Occurrence {
    /// Time at which it began (s of flight).
    pub(crate) from_s: f64,
    /// Duration (s); `None` for what has no length.
    pub(crate) length_s: Option<f64>,
    /// Importance.
    pub(crate) level: EventLevel,
    /// Part that it concerns.
    pub(crate) part: String,
    /// Description of what happened.
    pub(crate) text: String,
}

/// Everything that happened, in order.
pub(crate) fn occurrences(flight: &Flight<'_>, codes: &CodeNames, notes: &[FlightNote]) -> Vec<Occurrence> {
    let kinds = [
        faults(flight, codes),
        trips(flight),
        states(flight, codes),
        deadlines(flight),
        frames(flight, Arrival::Missing, "did not come"),
        frames(flight, Arrival::Late, "came late"),
        frames(flight, Arrival::Damaged, "came damaged"),
        sessions(flight),
        holes(flight),
        said(flight, notes),
    ];
    let mut all: Vec<Occurrence> = kinds.into_iter().flat_map(shortened).collect();
    all.sort_by(|a, b| a.from_s.total_cmp(&b.from_s));
    all
}

fn stretch(rows: &[Row<'_>], level: EventLevel, part: &str, text: String) -> Option<Occurrence> {
    let first = rows.first()?;
    Some(Occurrence {
        from_s: first.place.moment.time_s,
        length_s: Some(length_s(rows)),
        level,
        part: part.to_owned(),
        text,
    })
}

/// To the end of the last tick (s).
fn length_s(rows: &[Row<'_>]) -> f64 {
    match (rows.first(), rows.last()) {
        (Some(first), Some(last)) => last.place.moment.time_s + 0.02 - first.place.moment.time_s,
        _ => 0.0,
    }
}

fn faults(flight: &Flight<'_>, codes: &CodeNames) -> Vec<Occurrence> {
    let numbers = distinct(flight.rows().map(|row| row.tick.fault));
    let of = |number: u16| {
        let stretches = flight.stretches(|row| row.tick.fault == number);
        let name = (codes.fault)(number);
        stretches.into_iter().filter_map(move |rows| {
            stretch(&rows, EventLevel::Error, "daemon", format!("fault: {name} (code {number})"))
        })
    };
    numbers.into_iter().filter(|number| *number != 0).flat_map(of).collect()
}

fn trips(flight: &Flight<'_>) -> Vec<Occurrence> {
    let numbers = distinct(flight.rows().map(|row| row.tick.crio_trip));
    let of = |bits: u8| {
        let stretches = flight.stretches(|row| row.tick.crio_trip == bits);
        stretches
            .into_iter()
            .filter_map(move |rows| stretch(&rows, EventLevel::Error, "cRIO", format!("trip: {}", trip_text(bits))))
    };
    numbers.into_iter().filter(|bits| *bits != 0).flat_map(of).collect()
}

/// Trip bits in words, as the wire protocol names them.
pub(crate) fn trip_text(bits: u8) -> String {
    let names = [(1, "over-pressure"), (2, "command lost"), (4, "sensor"), (8, "operator stop")];
    let mut parts: Vec<String> =
        names.iter().filter(|(bit, _)| bits & bit != 0).map(|(_, name)| (*name).to_owned()).collect();
    if bits & 0xF0 != 0 {
        parts.push(format!("unknown bits {:#04x}", bits & 0xF0));
    }
    parts.join(", ")
}

fn states(flight: &Flight<'_>, codes: &CodeNames) -> Vec<Occurrence> {
    let mut before = None;
    let mut changes = Vec::new();
    for row in flight.rows() {
        let state = row.tick.state;
        if before.replace(state) != Some(state) {
            changes.push(Occurrence {
                from_s: row.place.moment.time_s,
                length_s: None,
                level: EventLevel::Info,
                part: "daemon".to_owned(),
                text: format!("state {}", (codes.state)(state)),
            });
        }
    }
    changes
}

fn deadlines(flight: &Flight<'_>) -> Vec<Occurrence> {
    if flight.statistics.options.pacing == Pacing::Lockstep {
        return Vec::new();
    }
    let text = |rows: &[Row<'_>]| {
        let slowest = rows.iter().max_by_key(|row| row.tick.compute_ns).copied();
        let why = slowest.map_or_else(String::new, |row| format!("; {}", blame(&row)));
        match rows.len() {
            1 => format!("deadline missed{why}"),
            number => format!("{number} deadlines missed in a row{why}"),
        }
    };
    let misses = flight.stretches(|row| row.tick.deadline_missed);
    misses.iter().filter_map(|rows| stretch(rows, EventLevel::Error, "tick", text(rows))).collect()
}

/// Tells where the time of a slow tick went.
fn blame(row: &Row<'_>) -> String {
    let tick = row.tick;
    let us = |ns: u32| wording::short_time(Some(f64::from(ns) / 1e3));
    let stages = Stage::ALL.iter().filter(|stage| **stage != Stage::Whole);
    let times: Vec<(&str, u32)> = stages.filter_map(|stage| Some((stage.name(), stage.ns(tick)?))).collect();
    let told: u64 = times.iter().map(|(_, ns)| u64::from(*ns)).sum();
    let between = u64::from(tick.compute_ns).saturating_sub(told);
    let late_ns = u64::try_from(tick.arrival_lateness_ns).unwrap_or(0);
    // The frame itself was the trouble when it came later than the tick took.
    if late_ns > u64::from(tick.compute_ns) {
        return format!("its frame came {} late", wording::short_time(Some(late_ns as f64 / 1e3)));
    }
    match times.iter().max_by_key(|(_, ns)| *ns) {
        Some((name, ns)) if u64::from(*ns) >= between => {
            format!("the tick took {}, of that {name} {}", us(tick.compute_ns), us(*ns))
        }
        // No stage ran that long: the thread was not running.
        _ if tick.compute_ns > 0 => format!(
            "the tick took {}, most of it outside its stages: perhaps the computer stalled",
            us(tick.compute_ns)
        ),
        _ => "no command was sent".to_owned(),
    }
}

fn frames(flight: &Flight<'_>, arrival: Arrival, what: &str) -> Vec<Occurrence> {
    let timed = flight.statistics.options.pacing == Pacing::Realtime;
    let text = |rows: &[Row<'_>]| {
        let latest = rows.iter().map(|row| row.tick.arrival_lateness_ns).max().filter(|_| arrival == Arrival::Late);
        let late = latest.filter(|_| timed).map(|ns| format!(", up to {}", wording::short_time(Some(ns as f64 / 1e3))));
        let frames = wording::counted(rows.len() as u64, "frame", "frames");
        format!("{frames} {what}{}", late.unwrap_or_default())
    };
    let stretches = flight.stretches(|row| row.tick.arrival == arrival && row.tick.session != 0);
    stretches.iter().filter_map(|rows| stretch(rows, EventLevel::Warning, "link", text(rows))).collect()
}

fn sessions(flight: &Flight<'_>) -> Vec<Occurrence> {
    let news = flight.rows().filter(|row| row.place.moment.new_session);
    news.map(|row| Occurrence {
        from_s: row.place.moment.time_s,
        length_s: None,
        level: EventLevel::Info,
        part: "link".to_owned(),
        text: match row.tick.session {
            0 => "no session with the cRIO".to_owned(),
            session => format!("session {session:08X} begins"),
        },
    })
    .collect()
}

fn holes(flight: &Flight<'_>) -> Vec<Occurrence> {
    let after = flight.rows().filter(|row| row.place.moment.step > 1 && !row.place.moment.new_session);
    after
        .filter(|row| row.tick.session != 0)
        .map(|row| {
            let missing = row.place.moment.step - 1;
            let length_s = missing as f64 / 50.0;
            Occurrence {
                from_s: row.place.moment.time_s - length_s,
                length_s: Some(length_s),
                level: EventLevel::Warning,
                part: "recorder".to_owned(),
                text: format!("{} without a record", wording::counted(missing, "tick", "ticks")),
            }
        })
        .collect()
}

fn said(flight: &Flight<'_>, notes: &[FlightNote]) -> Vec<Occurrence> {
    let said = |note: &FlightNote| Occurrence {
        from_s: flight.time_of(note.at),
        length_s: None,
        level: note.level,
        part: note.part.clone(),
        text: note.message.clone(),
    };
    notes.iter().map(said).collect()
}

/// The first of a kind, and a line for the rest.
fn shortened(mut kind: Vec<Occurrence>) -> Vec<Occurrence> {
    kind.sort_by(|a, b| a.from_s.total_cmp(&b.from_s));
    if kind.len() <= MOST + 1 {
        return kind;
    }
    let rest = kind.split_off(MOST);
    let (Some(last), Some(next)) = (kind.last().cloned(), rest.first()) else { return kind };
    let until_s = rest.last().map_or(next.from_s, |rest| rest.from_s);
    kind.push(Occurrence {
        from_s: next.from_s,
        length_s: Some(until_s - next.from_s),
        text: format!("… and {} more of this kind", wording::count(rest.len() as u64)),
        ..last
    });
    kind
}

fn distinct<T: Ord>(values: impl Iterator<Item = T>) -> Vec<T> {
    let set: std::collections::BTreeSet<T> = values.collect();
    set.into_iter().collect()
}
