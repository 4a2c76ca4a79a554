//! Recordings as a rig wants them, whoever wrote them: one way in for every command.
//!
//! ```text
//! bytes ── MCAP of ours ────────────────────────────┐
//!       ├─ MATLAB 5 ─┐                              │
//!       └─ text ─────┴─ sheet ── the rig's columns ─┴─ rows of 20 ms, lost ones bridged ── Recording
//! ```
//!
//! Columns are found under the rig's own names or as its `[recording]` table says ([`RecordingMap`]); rates, lost rows and
//! jitter are dealt with alike for both. Columns that the rig does not ask for may hold anything; where samples are rows as they
//! are they are kept by name.

use std::ops::Range;
use std::path::Path;

use model::rig::{RecordingMap, Rig};

use crate::recording::MOST_BYTES;
use crate::recording::columns::{Asked, asked, check, naming, places};
use crate::recording::csv::{Column, ColumnData, TIME_COLUMN, rows_alone};
use crate::recording::logger_file::sheet::Sheet;
use crate::recording::logger_file::{file_kind, logger_text, long_format, second_clock, serial_monitor, text_encoding};
use crate::recording::mcap_file::from_ticks::Broken;
use crate::recording::packed::{self, Unpacked};
use crate::recording::recording_error::RecordingError;
use crate::recording::rows::how_read::{HowRead, readings};
use crate::recording::rows::lost_rows::Missing;
use crate::recording::rows::repeated::Sensors;
use crate::recording::rows::resample::{Kind, Resampling};
use crate::recording::rows::slower::{self, Slower};
use crate::recording::rows::{asynchronous, lost_rows};
use crate::recording::table::{Recording, Rows};
use crate::recording::times::time_notes;
use crate::recording::times::{Stamps, Times, places_of_time, times};
use crate::regular_file;

impl Recording {
    /// Reads a recording for a rig: MCAP of the daemon, what loggers write as text, MATLAB files, also compressed with gzip or zstd.
    ///
    /// # Errors
    /// The file cannot be read, or its content is wrong: one line with file, line and column, and the key of `[recording]` that
    /// would help.
    pub fn read_for(path: &Path, rig: &Rig) -> Result<Self, RecordingError> {
        let file = path.display().to_string();
        let bytes = regular_file::read(path, MOST_BYTES)
            .map_err(|source| RecordingError::Read { file: file.clone(), source })?;
        let named_mcap = path.extension().is_some_and(|end| end.eq_ignore_ascii_case("mcap"));
        let Unpacked { bytes, cut } = packed::unpacked_with_remark(&file, &bytes)?;
        let recording = if bytes.starts_with(mcap::MAGIC) || named_mcap {
            Recording::parse_mcap(&file, &bytes, Broken::Missing)?.into_samples(rig)?
        } else {
            Self::parse_content(&file, &bytes, rig)?
        };
        Ok(recording.with_first_note(cut))
    }

    /// Parses the bytes of a file that is no MCAP file, as [`Recording::read_for`] does; `file` is the name that errors carry.
    ///
    /// # Errors
    /// As [`Recording::read_for`].
    pub fn parse_for(file: &str, bytes: &[u8], rig: &Rig) -> Result<Self, RecordingError> {
        let Unpacked { bytes, cut } = packed::unpacked_with_remark(file, bytes)?;
        Ok(Self::parse_content(file, &bytes, rig)?.with_first_note(cut))
    }

    /// Parses what was in a file, out of its compression.
    fn parse_content(file: &str, bytes: &[u8], rig: &Rig) -> Result<Self, RecordingError> {
        let map = rig.recording.clone().unwrap_or_default();
        if let Some(sheet) = file_kind::sheet(file, bytes)? {
            return from_sheet(&sheet, rig, &map);
        }
        let text = text_encoding::decode(file, bytes).map_err(|error| file_kind::no_text(file, bytes, error))?;
        file_kind::check_text(file, &text)?;
        let text = serial_monitor::unfolded(text);
        if serial_monitor::is_log(&text) {
            return Err(file_kind::log(file));
        }
        from_sheet(&logger_text::sheet(file, &text, &map)?, rig, &map)
    }

    /// Reads it with lost rows bridged and held readings taken once, as samples of other programs are.
    fn into_samples(self, rig: &Rig) -> Result<Self, RecordingError> {
        let kinds = asked(rig);
        let kind_of = |name: &str| kinds.iter().find(|one| one.name == name).map_or(Kind::Switch, |one| one.kind);
        let mut time_s = self.time_s().to_vec();
        let mut columns: Vec<(Column, Kind)> =
            self.columns().iter().map(|column| (column.clone(), kind_of(&column.name))).collect();
        let mut missing = Missing { columns: self.missing_columns().to_vec(), notes: Vec::new() };
        let (how_read, _) = HowRead::find(self.source(), &mut time_s, &mut columns, &mut missing)
            .map_err(|at| never_together(self.source(), &time_s, &columns, at))?;
        if self.segments().len() < 2 && matches!(how_read, HowRead::EveryRow) {
            return Ok(self);
        }
        let mut resampling = Resampling::new(&time_s);
        how_read.mark(&mut resampling);
        let rows = Rows {
            columns: columns_of(&resampling, &columns),
            measured: resampling.measured.clone(),
            missing: how_read.lacking(&missing.columns, &resampling),
            sampling_s: resampling.sampling_s(),
            header_line: None,
            time_s: resampling.rows.clone(),
        };
        let of_sensors = how_read.notes().iter().cloned();
        let notes = self.notes().iter().cloned().chain(of_sensors).chain(resampling.notes(self.source())).collect();
        Ok(Self::from_rows(self.source(), rows)?.with_notes(notes))
    }
}

/// A column at the rows.
fn rows_of(resampling: &Resampling<'_>, data: &ColumnData, kind: Kind) -> ColumnData {
    match data {
        ColumnData::Numbers(numbers) => ColumnData::Numbers(resampling.rows_of(numbers, kind)),
        ColumnData::Text(texts) => ColumnData::Text(resampling.texts_of(texts)),
    }
}

/// Columns at the rows.
fn columns_of(resampling: &Resampling<'_>, columns: &[(Column, Kind)]) -> Vec<Column> {
    let of = |(column, kind): &(Column, Kind)| Column {
        name: column.name.clone(),
        data: rows_of(resampling, &column.data, *kind),
    };
    columns.iter().map(of).collect()
}

/// The recording that a sheet is for a rig.
fn from_sheet(sheet: &Sheet<'_>, rig: &Rig, map: &RecordingMap) -> Result<Recording, RecordingError> {
    let naming = naming(sheet, rig, map)?;
    let filled = crate::recording::rows::unfilled::filled(sheet, map, naming);
    let sheet = filled.as_ref().unwrap_or(sheet);
    let once = crate::recording::rows::doubled::once(sheet, map, naming);
    let sheet = once.as_ref().unwrap_or(sheet);
    long_format::check(sheet, rig, map)?;
    let clocks = second_clock::joined(sheet, (rig, map), naming)?;
    let sheet = clocks.as_ref().unwrap_or(sheet);
    let of_time = places_of_time(sheet, map, naming);
    let timed = lost_rows::timed(sheet, &of_time);
    let sheet = timed.as_ref().unwrap_or(sheet);
    let joined = asynchronous::joined(sheet, &of_time);
    let sheet = joined.as_ref().unwrap_or(sheet);
    let apart = crate::recording::rows::doubled::at_one_time(sheet, &of_time);
    let sheet = apart.as_ref().unwrap_or(sheet);
    let held = asynchronous::apart(sheet, &places(sheet, rig, map, naming)?);
    let (sheet, stamps) =
        held.as_ref().map_or((sheet, Stamps::OfRows), |of| (&of.sheet, Stamps::OfTopics(&of.rows_read)));
    let Times { mut time_s, columns: of_time, taken } = times(sheet, map, naming, stamps)?;
    let (time_notes, may_count_rows) = time_notes::of_times(sheet, map, &of_time, &time_s);
    let mut units = taken;
    let (mut columns, mut file_units, mut blank_columns) = (Vec::new(), Vec::new(), Vec::new());
    for Asked { name, kind, default } in asked(rig) {
        let Some(made) = crate::recording::columns::made(sheet, rig, map, naming, (&name, kind, default))? else {
            blank_columns.extend(blank_column(sheet, &name));
            continue;
        };
        check(sheet, rig, (&name, kind), &made)?;
        units.extend(made.taken);
        file_units.extend(made.file_unit);
        columns.push((Column { name, data: ColumnData::Numbers(made.numbers) }, kind));
    }
    if stamps != Stamps::OfRows {
        let manner = manner(sheet, &units);
        let notes: Vec<String> =
            manner.into_iter().chain(time_notes).chain(sheet.notes.iter().cloned()).chain(blank_columns).collect();
        return of_topics(sheet, &time_s, columns, notes).map(|recording| recording.with_file_units(file_units));
    }
    let numbered = lost_rows::numbered(sheet, &mut time_s, &mut columns);
    let sheet = numbered.as_ref().unwrap_or(sheet);
    let (mut missing, read) = lost_rows::readings(sheet, &mut time_s, &mut columns);
    let sheet = read.as_ref().unwrap_or(sheet);
    let (how_read, kept) = HowRead::find(&sheet.file, &mut time_s, &mut columns, &mut missing)
        .map_err(|at| never_together(&sheet.file, &time_s, &columns, at))?;
    let kept = kept.map(|kept| sheet.rows_alone(&kept));
    let sheet = kept.as_ref().unwrap_or(sheet);
    let slower = Slower::of(&readings(&columns)).map_err(|at| never_together(&sheet.file, &time_s, &columns, at))?;
    let (time_s, columns) = match &slower {
        Some(slower) => {
            missing = missing.cut(&slower.span);
            read_rows(&slower.span, time_s, columns)
        }
        None => (time_s, columns),
    };
    let mut resampling = Resampling::new(&time_s);
    if let Some(slower) = &slower {
        let read = slower.read.get(slower.span.clone()).unwrap_or_default();
        resampling.only(read, Sensors::Slower(slower.rows_a_reading()));
    } else {
        how_read.mark(&mut resampling);
    }
    let lacking = how_read.lacking(&missing.columns, &resampling);
    let mut made = columns_of(&resampling, &columns);
    if resampling.is_as_it_was() {
        let span = slower.as_ref().map_or(0..sheet.rows(), |slower| slower.span.clone());
        made = with_others(made, (sheet, span), &of_time, &resampling);
        // What a relay's column holds that has nothing in any row is no text either.
        made.retain(|column| column.numbers().is_some() || asked(rig).iter().all(|one| one.name != column.name));
    }
    let rows = Rows {
        columns: made,
        measured: resampling.measured.clone(),
        missing: lacking,
        sampling_s: resampling.sampling_s(),
        header_line: sheet.header_line,
        time_s: resampling.rows.clone(),
    };
    let mut notes = Vec::new();
    notes.extend(manner(sheet, &units));
    notes.extend(time_notes);
    notes.extend(sheet.notes.iter().cloned());
    notes.extend(blank_columns);
    notes.extend(missing.notes);
    notes.extend(how_read.notes().iter().cloned());
    notes.extend(resampling.notes(&sheet.file));
    let recording = Recording::from_rows(&sheet.file, rows)?.with_notes(notes).with_file_units(file_units);
    Ok(if may_count_rows { recording.that_may_count_rows() } else { recording })
}

/// Readings that are left out for want of others are told from one in so many on: one or two at the ends are no matter.
const TOLD_LEFT_OUT: usize = 20;

/// The recording of topics that stand in rows of their own: rows where the sensors were read, and the commands that were in force there.
fn of_topics(
    sheet: &Sheet<'_>,
    time_s: &[f64],
    mut columns: Vec<(Column, Kind)>,
    notes: Vec<String>,
) -> Result<Recording, RecordingError> {
    let repeated = asynchronous::without_repeated(time_s, &mut columns);
    let fewest = readings(&columns).iter().map(|of| of.iter().filter(|x| !x.is_nan()).count()).min().unwrap_or(0);
    let spans = asynchronous::spans(time_s, &columns);
    let read = asynchronous::readings(time_s, &mut columns)
        .map_err(|sensor| never_together(&sheet.file, time_s, &columns, sensor))?;
    let read_s = rows_alone(time_s, &read);
    let resampling = Resampling::new(&read_s).commanded(time_s);
    let repeated = (!repeated.is_empty())
        .then(|| format!("{}: {}; only the first row of each reading counts as one", sheet.file, repeated.join(", ")));
    let left_out = fewest.saturating_sub(read.len());
    let in_part = (left_out * TOLD_LEFT_OUT > fewest).then(|| {
        format!(
            "{}: {left_out} of {fewest} readings of the sensor that was read least often are left out, where another one has none ({spans})",
            sheet.file
        )
    });
    let rows = Rows {
        columns: columns_of(&resampling, &columns),
        measured: resampling.measured.clone(),
        missing: Vec::new(),
        sampling_s: resampling.sampling_s(),
        header_line: sheet.header_line,
        time_s: resampling.rows.clone(),
    };
    let notes = notes.into_iter().chain(repeated).chain(in_part).chain(resampling.notes(&sheet.file)).collect();
    Ok(Recording::from_rows(&sheet.file, rows)?.with_notes(notes))
}

/// The remark on a column that is there, has nothing in any row, and so counts as one that is not there.
fn blank_column(sheet: &Sheet<'_>, name: &str) -> Option<String> {
    let at = sheet.find(name).ok().flatten()?;
    let title = sheet.columns.get(at).map_or(name, |column| column.title.as_str());
    Some(format!("{}: column {title} has nothing in any row and counts as one that is not there", sheet.file))
}

/// The error of a sensor whose readings stand in other rows than those of the rest.
fn never_together(file: &str, time_s: &[f64], columns: &[(Column, Kind)], sensor: usize) -> RecordingError {
    let name = columns.iter().filter(|(_, kind)| *kind == Kind::Reading).nth(sensor).map(|(column, _)| &column.name);
    let column = name.cloned().unwrap_or_default();
    RecordingError::NeverTogether { file: file.to_owned(), column, spans: asynchronous::spans(time_s, columns) }
}

/// Times and columns from the first row to the last in which all sensors were read, with lines where one was not.
fn read_rows(
    span: &Range<usize>,
    time_s: Vec<f64>,
    mut columns: Vec<(Column, Kind)>,
) -> (Vec<f64>, Vec<(Column, Kind)>) {
    let time_s = time_s.get(span.clone()).map(<[f64]>::to_vec).unwrap_or_default();
    for (column, kind) in &mut columns {
        column.data = column.data.cut(span);
        if let (Kind::Reading, ColumnData::Numbers(numbers)) = (*kind, &mut column.data) {
            slower::fill(&time_s, numbers);
        }
    }
    (time_s, columns)
}

/// The rig's columns and those that nobody asked for, in the file's order where the rig's own names stand in it.
fn with_others(
    made: Vec<Column>,
    (sheet, span): (&Sheet<'_>, Range<usize>),
    of_time: &[usize],
    resampling: &Resampling<'_>,
) -> Vec<Column> {
    let mut made: Vec<Option<Column>> = made.into_iter().map(Some).collect();
    let mut all = Vec::with_capacity(sheet.columns.len());
    for (at, column) in sheet.columns.iter().enumerate() {
        if of_time.contains(&at) || column.name == TIME_COLUMN {
            continue;
        }
        let is_from_here =
            |one: &Column| one.name == column.name || matches!(sheet.find(&one.name), Ok(Some(of)) if of == at);
        let own = made.iter_mut().find(|one| one.as_ref().is_some_and(is_from_here));
        if let Some(own) = own.and_then(Option::take) {
            all.push(own);
        } else if all.iter().all(|one: &Column| one.name != column.name) {
            let data = rows_of(resampling, &sheet.kept(at).cut(&span), Kind::Signal);
            all.push(Column { name: column.name.clone(), data });
        }
    }
    // Names that the file does not have: those that its map made.
    let made: Vec<Column> = made.into_iter().flatten().collect();
    all.retain(|one| made.iter().all(|own| own.name != one.name));
    made.into_iter().chain(all).collect()
}

/// Remark on the reading of a file, where it was not plain CSV in the rig's units.
fn manner(sheet: &Sheet<'_>, units: &[String]) -> Option<String> {
    let mut words = sheet.manner.clone();
    if !units.is_empty() {
        words.push(format!("units taken: {}", units.join(", ")));
    }
    (!words.is_empty()).then(|| format!("{}: read with {}", sheet.file, words.join("; ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    const RIG: &str = r#"
format = 1
name = "line"
[gas]
gas_constant_j_per_kg_k = 287.0
heat_capacity_ratio = 1.4
[atmosphere]
pressure_kpa_abs = 101.325
temperature_k = 293.15
[volumes.line]
volume_l = 0.1
temperature_k = 293.15
[pumps.pump]
kind = "flow"
outlet = "line"
command = "u"
flow_l_per_min = 2.0
[sources.meter]
kind = "flow"
to = "line"
flow_l_per_min = 1.0
signal = "q"
[sensors.sensor]
volume = "line"
column = "p_kpa"
range_kpa_gauge = [0.0, 100.0]
range_v = [0.0, 5.0]
[recording]
time = { from = "ms", scale = 1e-3 }
columns.u = { from = "PWM", scale = 0.01 }
columns.q = { from = "q_in", scale = 2.0 }
columns.p_kpa = { from = "P", offset = 1.0 }
"#;

    fn read(text: &str) -> Result<Recording, RecordingError> {
        let rig = Rig::from_toml(RIG).unwrap();
        Recording::parse_for("x.csv", text.as_bytes(), &rig)
    }

    /// A parabola in time sampled every 7 ms: means and instants are those of calculus, up to what straight lines
    /// between samples leave out (h²/8 · x'' = 6e-6 of x'' = 1).
    #[test]
    fn dense_samples_become_rows_by_their_means() {
        let mut text = String::from("ms,PWM,q_in,P\n");
        for k in 0..300 {
            let t = 7e-3 * f64::from(k);
            let parabola = 0.5 * t * t;
            text.push_str(&format!("{},{},{parabola},{parabola}\n", 7 * k, if k < 100 { 0 } else { 100 }));
        }
        let recording = read(&text).unwrap();
        let [u, q, p] = recording.require(["u", "q", "p_kpa"]).unwrap();
        assert_eq!(recording.rows(), 105);
        assert!(recording.notes()[0].contains("7.0 ms"), "{:?}", recording.notes());
        for (row, t) in recording.time_s().iter().enumerate().take(100).skip(1) {
            let (a, b) = (*t, t + 0.02);
            assert!((q[row] / 2.0 - (b.powi(3) - a.powi(3)) / 0.12).abs() < 1e-5, "{row}");
            assert!((p[row] - 1.0 - (0.5 * t * t + 0.01_f64.powi(2) / 6.0)).abs() < 1e-5, "{row}");
            // The command steps at 0.7 s; the row that holds the step has its share of it.
            let share = ((b - 0.7) / 0.02).clamp(0.0, 1.0);
            assert!((u[row] - share).abs() < 1e-9, "{row}");
        }
    }

    #[test]
    fn sparse_jittering_samples_are_joined_by_lines_and_gaps_stay_gaps() {
        let times: Vec<f64> = (0..50)
            .map(|k| 20.0 * f64::from(k) + if k % 2 == 0 { 0.0 } else { 0.3 } + if k > 30 { 200.0 } else { 0.0 })
            .collect();
        let text: String = times.iter().map(|t| format!("{t},50,0,{}\n", 0.25 * t)).collect();
        let recording = read(&format!("ms,PWM,q_in,P\n{text}")).unwrap();
        assert_eq!(recording.segments().len(), 2);
        assert_eq!(recording.notes().len(), 0, "20.3 and 19.7 ms are near enough");
        let [p] = recording.require(["p_kpa"]).unwrap();
        for (t, p) in recording.time_s().iter().zip(p) {
            assert!((p - 1.0 - 250.0 * t).abs() < 1e-9);
        }
    }

    #[test]
    fn own_columns_are_taken_as_they_are_and_missing_ones_named() {
        let own = "time_s,u,q,p_kpa\n0,0.1,3,5\n0.02,0.1,3,5\n0.04,0.1,3,5\n";
        assert_eq!(read(own).unwrap().column("p_kpa").unwrap(), [5.0; 3]);
        let said = read("ms,PWM,P\n0,1,1\n20,1,1\n").unwrap_err().to_string();
        assert!(said.contains("q_in") && said.contains("ms,PWM,P"), "{said}");
        let said = read("s,PWM,q_in,P\n0,1,1,1\n").unwrap_err().to_string();
        assert!(said.contains("column ms is missing") && said.contains("[recording] time"), "{said}");
        let said = read("ms,PWM,q_in,P\n0,1,1,1\n0,1,1,1\n").unwrap_err().to_string();
        assert!(said.contains("line 3"), "{said}");
        let said = read("ms,PWM,q_in,P\n0,on,1,1\n20,on,1,1\n").unwrap_err().to_string();
        assert!(said.contains("PWM") && said.contains("text"), "{said}");
    }
}
