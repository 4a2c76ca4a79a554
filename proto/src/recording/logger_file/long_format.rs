//! Tables with a row per channel and time instead of a column per channel: a column of names, one of values.
//!
//! Databases and plotting programs write them. They are refused with the line that pivots them, since which value is a command and which
//! a reading stands in a name.

use std::collections::BTreeSet;

use model::rig::{Decimal, RecordingMap, Rig};

use super::logger_text::BETWEEN_CELLS;
use super::row_names::is_called_a_time;
use super::sheet::{Cells, Sheet, is_data};
use crate::recording::csv::shown;
use crate::recording::recording_error::RecordingError;

/// Channels that such a table has at most.
const MOST_CHANNELS: usize = 64;
/// Rows of each channel at least, on average.
const LEAST_ROWS: usize = 3;
/// Names of channels that an error lists.
const LISTED: usize = 6;

/// Refuses a table with a row per channel.
///
/// # Errors
/// None of the rig's columns is there, nor what the map makes them from, and a column of text names channels.
pub(crate) fn check(sheet: &Sheet<'_>, rig: &Rig, map: &RecordingMap) -> Result<(), RecordingError> {
    let is_there = |name: &str| !matches!(sheet.find(name), Ok(None));
    let mapped = map.columns.values().flat_map(|terms| &terms.0).any(|term| is_there(&term.from));
    let missing = rig.columns();
    if mapped || missing.iter().any(|name| is_there(name)) {
        return Ok(());
    }
    let Some((at, channels)) = (0..sheet.columns.len()).find_map(|at| Some((at, channels(sheet, at)?))) else {
        return Ok(());
    };
    let title = |at: usize| sheet.columns.get(at).map_or("", |column| column.title.as_str());
    let value = value(sheet, at);
    let times =
        || (0..sheet.columns.len()).filter(|other| *other != at && Some(*other) != value && goes_by(sheet, *other, at));
    // A clock of whole seconds beside a finer one does not tell rows apart, and no pivot goes by it.
    let time = times().find(|time| tells_apart(sheet, *time, at)).or_else(|| times().next());
    let mut names: Vec<String> = channels.iter().take(LISTED).map(|name| shown(name)).collect();
    if channels.len() > LISTED {
        names.push("…".to_owned());
    }
    Err(RecordingError::Kind {
        file: sheet.file.clone(),
        what: format!(
            "columns {} are missing; it has one row per channel, column {} names it ({})",
            missing.iter().map(String::as_str).collect::<Vec<_>>().join(", "),
            title(at),
            names.join(", ")
        ),
        mend: format!(
            "pivot it so that each channel has a column: python3 -c \"import pandas; pandas.read_csv('FILE'{}{}{}).pivot(index='{}', columns='{}', values='{}').to_csv('FILE_wide.csv')\"",
            if sheet.header_line.is_some_and(|line| line > 1) { ", comment='#'" } else { "" },
            if sheet.manner.iter().any(|word| word.ends_with(BETWEEN_CELLS)) {
                ", sep=None, engine='python'"
            } else {
                ""
            },
            if sheet.decimal == Decimal::Comma { ", decimal=','" } else { "" },
            time.map_or("time", title),
            title(at),
            value.map_or("value", title)
        ),
    })
}

/// The column of values, beside a column of the channels' names: the last of numbers that are neither times nor one and the same, one that is
/// called so before the others.
fn value(sheet: &Sheet<'_>, of_channels: usize) -> Option<usize> {
    let is_called = |at: &usize| {
        let name = sheet.columns.get(*at).map_or_else(String::new, |column| column.name.to_ascii_lowercase());
        ["value", "wert"].iter().any(|word| name.contains(word))
    };
    let numbers = |at: usize| sheet.numbers(at).ok().filter(|_| at != of_channels);
    let of_numbers: Vec<usize> = (0..sheet.columns.len()).rev().filter(|at| numbers(*at).is_some()).collect();
    let is_time = |at: &usize| sheet.columns.get(*at).is_some_and(|column| is_called_a_time(&column.name));
    let moves = |at: &usize| numbers(*at).is_some_and(|of| of.windows(2).any(|pair| pair[0] != pair[1]));
    let values = || of_numbers.iter().filter(|at| !is_time(at) && moves(at)).copied();
    let called_so = values().find(is_called).or_else(|| of_numbers.iter().copied().find(is_called));
    called_so.or_else(|| values().next()).or_else(|| of_numbers.first().copied())
}

/// Tells whether no two rows of one channel have the same cell in a column.
fn tells_apart(sheet: &Sheet<'_>, column: usize, of_channels: usize) -> bool {
    let cell = |at: usize, row: usize| match sheet.columns.get(at).map(|column| &column.cells) {
        Some(Cells::Text(texts)) => texts.get(row).map_or_else(String::new, ToString::to_string),
        Some(Cells::Numbers(numbers)) => numbers.get(row).map_or_else(String::new, f64::to_string),
        None => String::new(),
    };
    let mut seen = BTreeSet::new();
    (0..sheet.rows()).all(|row| seen.insert((cell(of_channels, row), cell(column, row))))
}

/// Tells whether a column says something of single rows: it changes where the channel of the rows does not. What does not (the number of a
/// block, the span that was asked for) is said of the channel, or of the file.
fn goes_by(sheet: &Sheet<'_>, column: usize, of_channels: usize) -> bool {
    let changes = |at: usize| -> Vec<bool> {
        match sheet.columns.get(at).map(|column| &column.cells) {
            Some(Cells::Text(texts)) => texts.windows(2).map(|pair| pair[0] != pair[1]).collect(),
            Some(Cells::Numbers(numbers)) => numbers.windows(2).map(|pair| pair[0] != pair[1]).collect(),
            None => Vec::new(),
        }
    };
    let channel = changes(of_channels);
    // Channels in turn change in every row.
    let own = |(of, channel): (&bool, &bool)| *of && !channel;
    let in_turn = 2 * channel.iter().filter(|change| **change).count() >= channel.len();
    let all = changes(column);
    if in_turn { all.contains(&true) } else { all.iter().zip(&channel).any(own) }
}

/// The names in a column that names channels: text throughout, few different ones, which come again and again.
fn channels(sheet: &Sheet<'_>, at: usize) -> Option<BTreeSet<String>> {
    let Some(Cells::Text(texts)) = sheet.columns.get(at).map(|column| &column.cells) else { return None };
    let mut seen = BTreeSet::new();
    for text in texts {
        if text.trim().is_empty() || is_data(text, sheet.decimal) || seen.len() > MOST_CHANNELS {
            return None;
        }
        if !seen.contains(text.as_ref()) {
            seen.insert(text.to_string());
        }
    }
    // A state of the rig stands beside a column per channel, and says the same from row to row.
    let changes = texts.windows(2).filter(|pair| matches!(pair, [one, other] if one != other)).count();
    let others = sheet.columns.iter().enumerate().filter(|(of, _)| *of != at);
    let of_numbers = others
        .filter(|(of, _)| (sheet.numbers(*of).is_ok() || sheet.is_timestamped(*of)) && goes_by(sheet, *of, at))
        .count();
    let in_turn = 2 * changes >= texts.len() && of_numbers <= 3;
    let one_behind_another = changes + 1 == seen.len() && of_numbers <= 2;
    (seen.len() > 1 && (in_turn || one_behind_another) && LEAST_ROWS * seen.len() <= texts.len()).then_some(seen)
}
