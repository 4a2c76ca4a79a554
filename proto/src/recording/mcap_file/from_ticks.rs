//! From the daemon's ticks to the rows of a recording.
//!
//! A row needs what a reader may rely on: both pressures, and the command that was applied from
//! then on. A tick without a sound reading, or in which no command left, has no row; the hole it
//! leaves is a gap like any other. For a rig, whose commands carry a simulation on, a tick that lacks the reading of a sensor now and
//! then has a row all the same ([`Broken`]).

use super::tick::{Arrival, TickRecord};
use crate::recording::csv::{Column, ColumnData, rows_alone};
use crate::recording::recording_error::RecordingError;
use crate::recording::rows::lost_rows;
use crate::recording::rows::slower::is_slower;
use crate::recording::table::{PERIOD_S, Recording};

/// Phases of an experiment: waiting for rest, playing its rows.
const WAITING: u8 = 1;
const PLAYING: u8 = 2;
/// Ticks at rest that are kept before an experiment's rows. What comes before them is the way from wherever the rig was, with
/// valves, gas and pump in a state that no reading tells: a second of it spoils what the rows say.
const REST_TICKS: usize = 50;
/// Least pause between two sessions in the table (s): must read as a gap.
const SESSION_PAUSE_S: f64 = 1.0;

/// A column and where its numbers come from.
type Source = (&'static str, fn(&TickRecord) -> f64);

/// Columns of every recording made from ticks.
const COLUMNS: [Source; 8] = [
    ("u_pos", |tick| tick.u_pos),
    ("u_neg", |tick| tick.u_neg),
    ("p_pos_kpa", |tick| tick.p_pos_kpa),
    ("p_neg_kpa", |tick| tick.p_neg_kpa),
    ("pump_on", |tick| f64::from(u8::from(tick.pump_on))),
    ("mode", |tick| f64::from(tick.mode)),
    ("state", |tick| f64::from(tick.state)),
    ("fault", |tick| f64::from(tick.fault)),
];

/// Columns that are there when every row has them.
const REFERENCES: [Source; 2] = [("ref_pos_kpa", |tick| tick.ref_pos_kpa), ("ref_neg_kpa", |tick| tick.ref_neg_kpa)];

/// Treatment of a tick with a sound frame in which a sensor's reading is none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Broken {
    /// It has no row.
    NoRow,
    /// It has one, with a straight line in place of the reading, which is marked as missing.
    Missing,
}

pub(crate) fn recording(source: &str, ticks: &[TickRecord], broken: Broken) -> Result<Recording, RecordingError> {
    // A file that another program kept the ticks of alone has no frames; what was sent stands in the ticks.
    let frames = if ticks.iter().any(|tick| tick.command_present) { Frames::Kept } else { Frames::LeftOut };
    let pressures: [Source; 2] = [("p_pos_kpa", |tick| tick.p_pos_kpa), ("p_neg_kpa", |tick| tick.p_neg_kpa)];
    let commanded: Vec<&TickRecord> = ticks.iter().filter(|tick| has_command(tick, frames)).collect();
    let lacks = |value: fn(&TickRecord) -> f64| commanded.iter().map(|tick| finite(value(tick))).collect::<Vec<f64>>();
    // A sensor that is dead for long tells nothing, and nor does a line over that.
    let now_and_then = broken == Broken::Missing && pressures.iter().all(|(_, of)| !is_slower(&lacks(*of)));
    let has_row = |tick: &&TickRecord| now_and_then || pressures.iter().all(|(_, of)| of(tick).is_finite());
    let (ticks_to_rest, sound) = from_rest(commanded.into_iter().filter(has_row).collect());
    let (rows, time_s) = timed(&sound);
    let read = pressures.map(|(name, of)| (name, rows.iter().map(|tick| finite(of(tick))).collect::<Vec<f64>>()));
    let read: Vec<(&str, &[f64])> = read.iter().map(|(name, of)| (*name, of.as_slice())).collect();
    let place = |row: usize| format!("at {:.2} s", time_s.get(row).copied().unwrap_or(0.0));
    let (mut missing, kept) = lost_rows::missing(source, place, &time_s, &read);
    let unread = rows.len() - kept.len();
    let (rows, time_s) = (rows_alone(&rows, &kept), rows_alone(&time_s, &kept));
    if rows.is_empty() {
        return Err(RecordingError::NoReadings { file: source.to_owned(), ticks: ticks.len() });
    }
    let column = |(name, value): Source| Column {
        name: name.to_owned(),
        data: ColumnData::Numbers(rows.iter().map(|tick| finite(value(tick))).collect()),
    };
    let mut columns: Vec<Column> = COLUMNS.into_iter().map(column).collect();
    columns.iter_mut().for_each(|column| missing.fill(&time_s, column));
    let mut notes = Vec::new();
    let references = rows.iter().filter(|tick| referenced(tick)).count();
    if references == rows.len() {
        columns.splice(4..4, REFERENCES.into_iter().map(column));
    } else if references > 0 {
        notes.push(format!(
            "{source}: {references} of {} rows have a reference; ref_pos_kpa and ref_neg_kpa left out",
            rows.len()
        ));
    }
    if ticks_to_rest > 0 {
        notes.push(format!("{source}: {ticks_to_rest} ticks left out in which the rig came to rest for an experiment"));
    }
    let left_out = ticks.len() - rows.len() - ticks_to_rest - unread;
    if left_out > 0 {
        notes.push(format!(
            "{source}: {left_out} of {} ticks left out (no sound reading, no command sent, or a repeated tick)",
            ticks.len()
        ));
    }
    notes.append(&mut missing.notes);
    missing.columns.retain(|(_, missing)| missing.contains(&true));
    Ok(Recording::new(source, time_s, columns)?.with_missing(missing.columns).with_notes(notes))
}

/// A number, NaN for one that is none.
fn finite(number: f64) -> f64 {
    if number.is_finite() { number } else { f64::NAN }
}

/// Without the ticks in which the rig came to rest before an experiment's rows, but for the last of them; how many those are.
fn from_rest(ticks: Vec<&TickRecord>) -> (usize, Vec<&TickRecord>) {
    let mut kept: Vec<&TickRecord> = Vec::with_capacity(ticks.len());
    let mut left_out = 0;
    for (n, tick) in ticks.iter().enumerate() {
        if tick.experiment == PLAYING && n > 0 && ticks[n - 1].experiment == WAITING {
            let waited = kept.iter().rev().take_while(|before| before.experiment == WAITING).count();
            let surplus = waited.saturating_sub(REST_TICKS);
            let end = kept.len();
            kept.drain(end - waited..end - waited + surplus);
            left_out += surplus;
        }
        kept.push(tick);
    }
    (left_out, kept)
}

/// Presence of the frames beside the ticks of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Frames {
    Kept,
    LeftOut,
}

fn has_command(tick: &TickRecord, frames: Frames) -> bool {
    let numbers = [tick.u_pos, tick.u_neg];
    matches!(tick.arrival, Arrival::InTime | Arrival::Late)
        && (tick.command_present || frames == Frames::LeftOut)
        && numbers.iter().all(|number| number.is_finite())
}

fn referenced(tick: &TickRecord) -> bool {
    tick.ref_pos_kpa.is_finite() && tick.ref_neg_kpa.is_finite()
}

/// The ticks that move on, with their times.
fn timed<'a>(sound: &[&'a TickRecord]) -> (Vec<&'a TickRecord>, Vec<f64>) {
    let mut rows: Vec<&TickRecord> = Vec::with_capacity(sound.len());
    let mut time_s: Vec<f64> = Vec::with_capacity(sound.len());
    // Where the running session's first row stands, and its tick.
    let mut origin = (0.0, 0_u32);
    for tick in sound {
        match (rows.last(), time_s.last()) {
            (Some(before), Some(at)) if before.session == tick.session => {
                if tick.tick <= before.tick {
                    continue;
                }
                debug_assert!(*at >= origin.0);
            }
            (Some(before), Some(at)) => {
                let pause_ns = tick.receive_ns.saturating_sub(before.receive_ns);
                let pause_s = (pause_ns as f64 * 1e-9).max(SESSION_PAUSE_S);
                // On the 20 ms grid, so that times stay short and read well.
                origin = (((at + pause_s) / PERIOD_S).round() * PERIOD_S, tick.tick);
            }
            _ => origin = (0.0, tick.tick),
        }
        // k / 50 rounds once; k · 0.02 would carry the rounding of 0.02 along.
        time_s.push(origin.0 + f64::from(tick.tick - origin.1) / 50.0);
        rows.push(tick);
    }
    (rows, time_s)
}
