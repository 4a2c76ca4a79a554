//! The head of a table: the row that names its columns, a row of units below it, and where the data begin.

use std::borrow::Cow;

use model::rig::RecordingMap;

use super::logger_text::{Manner, Row, cells_of, filled};
use super::row_names::is_called_a_time;
use super::sheet::is_data;
use crate::recording::columns::units::Unit;
use crate::recording::csv::CsvError;

/// Names, units and where the data begin.
#[derive(Debug, Default)]
pub(crate) struct Head<'a> {
    pub(crate) line: Option<u64>,
    pub(crate) names: Vec<String>,
    pub(crate) units: Vec<Cow<'a, str>>,
    /// Index of the first row of data.
    pub(crate) first: usize,
    /// Rows above the header.
    pub(crate) rows_above: usize,
    pub(crate) in_comment: bool,
}

impl<'a> Head<'a> {
    /// Finds the head among the rows of a file, or in the last comment above them.
    ///
    /// # Errors
    /// Nothing names the columns.
    pub(crate) fn of(
        file: &str,
        rows: &[Row<'a>],
        manner: &Manner,
        map: &RecordingMap,
        comment: Option<(u64, &'a str)>,
    ) -> Result<Self, CsvError> {
        let numbers = |row: &[Cow<'_, str>]| row.iter().filter(|cell| is_data(cell, manner.decimal)).count();
        // Half of the cells, and not the numbers of a block of settings, which are as many as there are by chance.
        let as_many = |row: &[Cow<'_, str>]| filled(row) == manner.cells || row.len().abs_diff(manner.cells) == 0;
        let data = |row: &Row<'_>| as_many(&row.1) && numbers(&row.1) > 0 && 2 * numbers(&row.1) >= filled(&row.1);
        let is_data: Vec<bool> = rows.iter().map(data).collect();
        let first = is_data.iter().position(|data| *data).unwrap_or(rows.len());
        if !map.names.is_empty() {
            // Names for the line that the map says: data begin behind it, whatever looks like data above.
            let behind = map.header_line.map_or(0, |header| rows.partition_point(|(line, _)| *line <= header));
            let first = is_data.iter().skip(behind).position(|data| *data).map_or(rows.len(), |at| behind + at);
            let units = rows.get(behind).filter(|row| behind > 0 && is_units(&row.1)).map(|row| row.1.clone());
            return Ok(Head { names: map.names.clone(), units: units.unwrap_or_default(), first, ..Head::default() });
        }
        if let Some(head) = Self::over_an_index(rows, first, manner).filter(|_| map.header_line.is_none()) {
            return Ok(head);
        }
        let (header, first) = match map.header_line {
            Some(line) => (rows.iter().position(|(at, _)| *at == line), first),
            None => found(rows, &is_data, manner).map_or((None, first), |(at, first)| (Some(at), first)),
        };
        let Some(at) = header else {
            return Self::without_row(file, rows, first, manner, comment);
        };
        let (line, cells) = rows.get(at).cloned().unwrap_or_default();
        let units = units_below(rows, at, manner);
        let first =
            if map.header_line.is_some() || first <= at { at + 1 + usize::from(units.is_some()) } else { first };
        let (names, rows_above) = (under_merged_cells(rows.get(..at).unwrap_or_default(), &cells), at);
        Ok(Head { line: Some(line), names, units: units.unwrap_or_default(), first, rows_above, in_comment: false })
    }

    /// The head that pandas writes over columns of several levels: a line per level, the last one with the names or their units, and below
    /// them one with nothing but the name of the index.
    fn over_an_index(rows: &[Row<'a>], first: usize, manner: &Manner) -> Option<Self> {
        let row = |above: usize| rows.get(first.checked_sub(above)?).filter(|(_, row)| row.len() == manner.cells);
        let texts =
            |cells: &[Cow<'_, str>]| cells.iter().all(|cell| !cell.is_empty() && !is_data(cell, manner.decimal));
        let (_, index) = row(1)?;
        let (index, blank) = index.split_first()?;
        if index.is_empty() || is_data(index, manner.decimal) || !blank.iter().all(|cell| cell.is_empty()) {
            return None;
        }
        let (_, [_, last @ ..]) = row(2).map(|(line, row)| (line, row.as_slice()))? else { return None };
        let units_above = is_units(last);
        let above = if units_above { 3 } else { 2 };
        let (line, [level, names @ ..]) = row(above).map(|(line, row)| (*line, row.as_slice()))? else { return None };
        // A remark or a unit under a header has blanks beside it as well, and the header names its first column.
        let is_level = level.is_empty() || (is_called_a_time(index) && !is_called_a_time(level));
        if names.is_empty() || !texts(names) || !is_level || Unit::parse(index).is_some() {
            return None;
        }
        let units = if units_above { last } else { &[] };
        Some(Head {
            line: Some(line),
            names: std::iter::once(index.to_string())
                .chain(of_levels(rows.get(..first - above).unwrap_or_default(), names))
                .collect(),
            units: std::iter::once(Cow::Borrowed("")).chain(units.iter().cloned()).collect(),
            first,
            rows_above: first - above,
            in_comment: false,
        })
    }

    /// The head of a file whose rows are all data: names in the comment above, or nowhere.
    fn without_row(
        file: &str,
        rows: &[Row<'a>],
        first: usize,
        manner: &Manner,
        comment: Option<(u64, &'a str)>,
    ) -> Result<Self, CsvError> {
        if let Some((line, text)) = comment {
            let names = cells_of(text, manner.separator);
            if names.len() == manner.cells && names.iter().all(|name| !is_data(name, manner.decimal)) {
                let names = names.into_iter().map(str::to_owned).collect();
                return Ok(Head { line: Some(line), names, first, in_comment: true, ..Head::default() });
            }
        }
        let (line, row) = rows.first().cloned().unwrap_or_default();
        if first == rows.len() {
            // Nothing in it looks like data; the first row is taken for the header and says so below.
            let names = row.iter().map(|name| name.to_string()).collect();
            return Ok(Head { line: Some(line), names, first: 1, ..Head::default() });
        }
        let cell = rows
            .get(first)
            .and_then(|row| row.1.first())
            .map(|cell| crate::recording::csv::shown(cell))
            .unwrap_or_default();
        Err(CsvError::NoHeader {
            file: file.to_owned(),
            line: rows.get(first).map_or(line, |row| row.0),
            cell,
            mend: "; or give them in the rig file: [recording] names = [\"…\", \"…\"], or header_line = … where they stand elsewhere",
        })
    }
}

/// Names of the last level; those that stand there twice behind those of the levels above, as long as they do; `rows` are those above the
/// level.
fn of_levels(rows: &[Row<'_>], names: &[Cow<'_, str>]) -> Vec<String> {
    let mut joined: Vec<String> = names.iter().map(ToString::to_string).collect();
    for (_, row) in rows.iter().rev().take_while(|(_, row)| row.len() == names.len() + 1) {
        let are_twice: Vec<bool> =
            joined.iter().map(|name| joined.iter().filter(|other| *other == name).count() > 1).collect();
        if !are_twice.contains(&true) {
            break;
        }
        for ((name, above), is_twice) in joined.iter_mut().zip(row.iter().skip(1)).zip(are_twice) {
            if is_twice {
                *name = format!("{above} {name}");
            }
        }
    }
    joined
}

/// Names of a header. Where one stands twice, what the row above says of it is put before it: a spreadsheet that merges cells writes
/// a word over the first of the columns that it is for, and blanks over the rest.
fn under_merged_cells(above: &[Row<'_>], names: &[Cow<'_, str>]) -> Vec<String> {
    // Where no word of it is for two columns, nothing was merged.
    let is_merged =
        |row: &[Cow<'_, str>]| row.len() == names.len() && (!are_names(row) || row.iter().any(|cell| cell.is_empty()));
    let groups = above.last().map(|(_, row)| row).filter(|row| !are_names(names) && is_merged(row));
    let Some(groups) = groups else { return names.iter().map(ToString::to_string).collect() };
    let mut merged = "";
    let group_of = |group| {
        if !str::is_empty(group) {
            merged = group;
        }
        merged
    };
    let groups: Vec<&str> = groups.iter().map(AsRef::as_ref).map(group_of).collect();
    let stands_twice = |name: &str| names.iter().filter(|other| *other == name).count() > 1;
    let joined = |(group, name): (&str, &Cow<'_, str>)| {
        if stands_twice(name) && !group.is_empty() { format!("{group} {name}") } else { name.to_string() }
    };
    groups.into_iter().zip(names).map(joined).collect()
}

/// The row of units below the names at an index, with nothing but units in it: all of its cells are some, or those above numbers are, as in
/// `Sequence,Volt,Volt,-0.3,0.02` where an oscilloscope has further numbers beside its units.
fn units_below<'a>(rows: &[Row<'a>], names: usize, manner: &Manner) -> Option<Vec<Cow<'a, str>>> {
    let (_, units) = rows.get(names + 1)?;
    if is_units(units) {
        return Some(units.clone());
    }
    let (_, data) = rows.get(names + 2)?;
    let above_numbers =
        || units.iter().zip(data).filter(|(_, below)| is_data(below, manner.decimal)).map(|(unit, _)| unit);
    let known = above_numbers().filter(|unit| Unit::parse(unit).is_some_and(|unit| unit != Unit::Other)).count();
    let are_units =
        known > 0 && 2 * known >= above_numbers().count() && !above_numbers().any(|unit| is_data(unit, manner.decimal));
    let alone = |unit: &Cow<'a, str>| if Unit::parse(unit).is_some() { unit.clone() } else { Cow::Borrowed("") };
    are_units.then(|| units.iter().map(alone).collect())
}

/// Indices of the header and of the first row of data: of all places where data follow a header, that with the most data, and of
/// those with the same names the first.
fn found(rows: &[Row<'_>], is_data: &[bool], manner: &Manner) -> Option<(usize, usize)> {
    let begins = |at: &usize| at.checked_sub(1).is_none_or(|before| is_data.get(before) != Some(&true));
    let starts = (0..rows.len()).filter(|at| is_data.get(*at) == Some(&true)).filter(begins);
    let mut places: Vec<(usize, usize)> =
        starts.filter_map(|first| Some((above(rows, first, manner)?, first))).collect();
    if places.is_empty() {
        // A header and nothing below it that looks like data: the rows below say what is wrong with them.
        let texts = |row: &Row<'_>| filled(&row.1) > 0 && row.1.iter().all(|cell| !is_data_cell(cell, manner));
        places.extend(rows.first().filter(|row| texts(row)).map(|_| (0, 1)));
    }
    let end = |place: usize| places.get(place + 1).map_or(rows.len(), |(_, first)| *first);
    let data_of = |place: usize| {
        let (_, first) = places.get(place).copied().unwrap_or_default();
        is_data.get(first..end(place)).unwrap_or_default().iter().filter(|data| **data).count()
    };
    let most = (0..places.len()).max_by_key(|place| (data_of(*place), std::cmp::Reverse(*place)))?;
    let names = |place: &(usize, usize)| rows.get(place.0).map(|row| &row.1);
    let best = places.get(most)?;
    places.iter().find(|place| names(place) == names(best)).copied()
}

fn is_data_cell(cell: &str, manner: &Manner) -> bool {
    is_data(cell, manner.decimal)
}

/// Index of the header above the data.
fn above(rows: &[Row<'_>], first: usize, manner: &Manner) -> Option<usize> {
    // Cells of the data, those included that are blank in every row.
    let width = rows.get(first).map_or(0, |row| row.1.len());
    let named = |at: usize| {
        let row = rows.get(at)?;
        let cells = row.1.len();
        let texts = row.1.iter().all(|cell| !is_data(cell, manner.decimal));
        // One name more is that of a comment which no row has; one less that of an index without a name.
        // A remark in a line of empty cells names no columns.
        let named = row.1.iter().filter(|cell| !cell.is_empty()).count();
        let as_many = [manner.cells, width].iter().any(|of_data| cells.abs_diff(*of_data) <= 1);
        (texts && named > 0 && 2 * named >= manner.cells && as_many).then_some(at)
    };
    let cells = |at: usize| rows.get(at).map_or(&[] as &[Cow<'_, str>], |row| row.1.as_slice());
    // `CH=1`, `SR=50 Hz`: settings of each channel between its name and its numbers. `trace_values`: a word that numbers begin.
    let is_beside = |at: &usize| {
        let mut filled = cells(*at).iter().filter(|cell| !cell.is_empty()).peekable();
        let is_alone = cells(*at).len() == 1 && manner.cells > 2;
        is_alone || filled.peek().is_some() && filled.all(|cell| cell.contains('='))
    };
    // Where nothing else stands above, such a row is the header.
    let first = (0..first).rev().find(|at| !is_beside(at)).map_or(first, |at| at + 1);
    let Some(directly) = first.checked_sub(1).and_then(named) else {
        // Units of a few columns alone, the others' cells blank.
        let names = first.checked_sub(2).and_then(named).filter(|at| !is_units(cells(*at)))?;
        return units_below(rows, names, manner).map(|_| names);
    };
    // What each number is (its unit, how it was sampled, a line of dashes) may stand between names and data.
    let mut between = std::iter::successors(Some(directly), |at| at.checked_sub(1).and_then(named));
    if is_units(cells(directly)) {
        return between.nth(1).or(Some(directly));
    }
    if are_names(cells(directly)) {
        return Some(directly);
    }
    let alike = |at: &usize| cells(*at).len() == cells(directly).len();
    between.skip(1).take_while(alike).find(|at| are_names(cells(*at))).or(Some(directly))
}

/// Tells whether cells can name columns: no name twice.
fn are_names(row: &[Cow<'_, str>]) -> bool {
    let mut seen = std::collections::HashSet::new();
    row.iter().filter(|cell| !cell.is_empty()).all(|cell| seen.insert(cell.as_ref()))
}

/// Tells whether a row holds units: at least one, and nothing else but empty cells and dashes.
pub(crate) fn is_units(row: &[Cow<'_, str>]) -> bool {
    let units = row.iter().filter(|cell| !cell.is_empty());
    let mut any = false;
    for unit in units {
        match Unit::parse(unit) {
            Some(_) => any = true,
            None => return false,
        }
    }
    any
}
