//! All recordings of one rig, with their readings in one vector.

use std::ops::Range;

use model::plant::{Input, Plant};
use model::rig::{Pump, Rig};
use proto::recording::{PERIOD_S, Recording};

use super::Layout;
use super::record::{Earlier, Record, is_on};
use crate::FitError;

/// Recordings of one rig.
#[derive(Debug, Clone, PartialEq)]
pub struct Records {
    inputs: Vec<Input>,
    sensors: Vec<String>,
    records: Vec<Record>,
    layout: Layout,
    readings_kpa: Vec<f64>,
}

impl Records {
    /// Takes the columns that `rig` needs out of recordings.
    ///
    /// # Errors
    /// No recordings; a column that the rig reads or is commanded by is missing or text; the rig is unsound.
    pub fn new(rig: &Rig, recordings: &[Recording]) -> Result<Self, FitError> {
        if recordings.is_empty() {
            return Err(FitError::NoRecordings);
        }
        let plant = Plant::new(rig).map_err(FitError::rig(rig))?;
        let mut records = Vec::with_capacity(recordings.len());
        for recording in recordings {
            let inputs = plant
                .inputs()
                .iter()
                .map(|input| match input.default {
                    Some(value) if recording.names().all(|name| name != input.column) => {
                        Ok(vec![value; recording.rows()])
                    }
                    _ => recording.require([input.column.as_str()]).map(|[numbers]| numbers.to_vec()),
                })
                .collect::<Result<Vec<_>, _>>()?;
            let columns = plant.sensor_columns().iter().chain(plant.inputs().iter().map(|input| &input.column));
            records.push(Record {
                source: recording.source().to_owned(),
                time_s: recording.time_s().to_vec(),
                begun_s: recording.time_s().first().copied().unwrap_or(0.0),
                inputs,
                before: Earlier::default(),
                segments: recording.segments().to_vec(),
                measured: recording.measured().unwrap_or_default().to_vec(),
                missing: plant
                    .sensor_columns()
                    .iter()
                    .map(|of| recording.missing(of).unwrap_or_default().to_vec())
                    .collect(),
                sampling_s: recording.sampling_s(),
                crank_rev: 0.0,
                file_units: columns.filter_map(|of| recording.file_unit(of).cloned()).collect(),
            });
        }
        let sensors = plant.sensor_columns().to_vec();
        let layout = Layout::new(sensors.len(), recordings.iter().map(Recording::rows).collect());
        let mut readings_kpa = Vec::with_capacity(layout.len());
        for recording in recordings {
            for column in recording.require_all(sensors.iter().map(String::as_str))? {
                readings_kpa.extend_from_slice(column);
            }
        }
        Ok(Records { inputs: plant.inputs().to_vec(), sensors, records, layout, readings_kpa })
    }

    /// These recordings with other readings: a simulated experiment.
    ///
    /// # Errors
    /// Another number of readings than there are places for.
    pub fn with_readings(&self, readings_kpa: Vec<f64>) -> Result<Self, FitError> {
        if readings_kpa.len() != self.layout.len() {
            return Err(FitError::Unusable(format!(
                "{} readings for {} places; give one for each row of each channel",
                readings_kpa.len(),
                self.layout.len()
            )));
        }
        Ok(Records { readings_kpa, ..self.clone() })
    }

    /// These recordings with cranks that stood at `crank_rev` (revolutions, by recording).
    #[must_use]
    pub fn with_cranks(mut self, crank_rev: &[f64]) -> Self {
        for (record, rev) in self.records.iter_mut().zip(crank_rev) {
            record.crank_rev = *rev;
        }
        self
    }

    /// These recordings, each as if its file began with its first row: nothing is known of what went before.
    #[must_use]
    pub fn begun_anew(mut self) -> Self {
        for record in &mut self.records {
            record.begun_s = record.time_s.first().copied().unwrap_or(0.0);
            record.before = Earlier::default();
        }
        self
    }

    /// Parts of the recordings (index and rows), each a recording of its own; and which reading of these recordings each
    /// of theirs is. What is empty is left out.
    pub fn parts(&self, parts: &[(usize, Range<usize>)]) -> (Self, Vec<usize>) {
        let kept: Vec<(&Record, usize, &Range<usize>)> = parts
            .iter()
            .filter(|(_, rows)| !rows.is_empty())
            .filter_map(|(record, rows)| Some((self.records.get(*record)?, *record, rows)))
            .filter(|(whole, _, rows)| rows.end <= whole.time_s.len())
            .collect();
        let channels = self.layout.channels();
        let layout = Layout::new(channels, kept.iter().map(|(.., rows)| rows.len()).collect());
        let places: Vec<usize> = kept
            .iter()
            .flat_map(|(_, record, rows)| (0..channels).map(move |channel| (*record, channel, (*rows).clone())))
            .flat_map(|(record, channel, rows)| self.layout.stretch(record, channel, rows))
            .collect();
        let readings_kpa = places.iter().filter_map(|place| self.readings_kpa.get(*place)).copied().collect();
        let cut = |numbers: &[f64], rows: &Range<usize>| numbers.get(rows.clone()).unwrap_or_default().to_vec();
        let read = |record: usize| (0..channels).map(|channel| self.channel_kpa(record, channel).to_vec()).collect();
        let earlier: Vec<Earlier> =
            self.records.iter().enumerate().map(|(record, whole)| whole.earlier(|| read(record))).collect();
        let records = kept
            .iter()
            .map(|(whole, record, rows)| Record {
                source: whole.source.clone(),
                time_s: cut(&whole.time_s, rows),
                begun_s: whole.begun_s,
                inputs: whole.inputs.iter().map(|input| cut(input, rows)).collect(),
                before: earlier.get(*record).cloned().unwrap_or_default().and(rows.start, whole.leading(rows.start)),
                segments: whole
                    .segments
                    .iter()
                    .map(|s| s.start.max(rows.start)..s.end.min(rows.end))
                    .filter(|s| s.start < s.end)
                    .map(|s| s.start - rows.start..s.end - rows.start)
                    .collect(),
                measured: whole.measured.get(rows.start..rows.end).unwrap_or_default().to_vec(),
                missing: whole
                    .missing
                    .iter()
                    .map(|missing| missing.get(rows.start..rows.end).unwrap_or_default().to_vec())
                    .collect(),
                sampling_s: whole.sampling_s,
                // Whole turns do not matter, the rest does.
                crank_rev: whole.crank_rev,
                file_units: whole.file_units.clone(),
            })
            .collect();
        (Records { records, layout, readings_kpa, ..self.clone() }, places)
    }

    /// Rows of one recording as if they were 20 ms apart, whatever their times say.
    pub(super) fn counted(&self, record: usize, rows: &[usize]) -> Option<Self> {
        let whole = self.records.get(record)?;
        let picked =
            |numbers: &[f64]| -> Vec<f64> { rows.iter().filter_map(|row| numbers.get(*row)).copied().collect() };
        let channels = self.layout.channels();
        let readings_kpa = (0..channels).flat_map(|channel| picked(self.channel_kpa(record, channel))).collect();
        let counted = Record {
            time_s: (0..rows.len()).map(|row| PERIOD_S * row as f64).collect(),
            begun_s: 0.0,
            inputs: whole.inputs.iter().map(|input| picked(input)).collect(),
            before: Earlier::default(),
            segments: std::iter::once(0..rows.len()).collect(),
            measured: Vec::new(),
            missing: Vec::new(),
            sampling_s: PERIOD_S,
            ..whole.clone()
        };
        let layout = Layout::new(channels, vec![rows.len()]);
        Some(Records { records: vec![counted], layout, readings_kpa, ..self.clone() })
    }

    /// These recordings, each changed by its place: its commands, and its readings channel after channel (kPa).
    #[must_use]
    pub(super) fn changed(mut self, change: impl Fn(usize, &mut Record, &mut [f64])) -> Self {
        for (at, record) in self.records.iter_mut().enumerate() {
            let start = self.layout.channel(at, 0).start;
            let places = start..start + self.layout.channels() * self.layout.rows(at);
            change(at, record, self.readings_kpa.get_mut(places).unwrap_or_default());
        }
        self
    }

    /// The inputs of the rig, in the order of [`Record::inputs`].
    pub fn inputs(&self) -> &[Input] {
        &self.inputs
    }

    /// The columns of the sensors, in the order of channels.
    pub fn sensors(&self) -> &[String] {
        &self.sensors
    }

    /// The recordings.
    pub fn records(&self) -> &[Record] {
        &self.records
    }

    /// Layout of [`Records::readings_kpa`] and of every trace.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// All readings in gauge kPa.
    pub fn readings_kpa(&self) -> &[f64] {
        &self.readings_kpa
    }

    /// The readings of one channel of one recording, in gauge kPa.
    pub fn channel_kpa(&self, record: usize, channel: usize) -> &[f64] {
        self.readings_kpa.get(self.layout.channel(record, channel)).unwrap_or_default()
    }

    /// The commands of the input with this column in one recording; `None` if the rig has no such input.
    pub fn input(&self, record: usize, column: &str) -> Option<&[f64]> {
        let index = self.inputs.iter().position(|input| input.column == column)?;
        self.records.get(record)?.inputs.get(index).map(Vec::as_slice)
    }

    /// States of the rig's pumps in one recording, row by row, true where switched on: a list for each pump that has a relay.
    pub fn relays(&self, rig: &Rig, record: usize) -> Vec<Vec<bool>> {
        let relay = |pump: &Pump| match pump {
            Pump::Piston(pump) => pump.relay.clone(),
            Pump::Flow(_) => None,
        };
        let commands = rig.pumps.values().filter_map(relay).filter_map(|relay| self.input(record, &relay));
        commands.map(|command| command.iter().map(|level| is_on(*level)).collect()).collect()
    }

    /// Usual distance of samples in s of the recording where it is largest, 20 ms at least.
    pub fn sampling_s(&self) -> f64 {
        self.records.iter().map(|record| record.sampling_s).fold(PERIOD_S, f64::max)
    }

    /// 1 at readings that were taken, 0 at those of rows without a sample and at missing ones; of the recordings' layout.
    pub fn measured(&self) -> Vec<f64> {
        let mut measured = Vec::with_capacity(self.layout.len());
        for record in &self.records {
            for channel in 0..self.layout.channels() {
                let rows = 0..record.time_s.len();
                measured.extend(rows.map(|row| f64::from(u8::from(record.is_read(channel, row)))));
            }
        }
        measured
    }

    /// These recordings with straight lines in place of some readings, which are left out from then on; `left_out` is of the
    /// recordings' layout.
    #[must_use]
    pub fn without_readings(mut self, left_out: &[bool]) -> Self {
        let channels = self.layout.channels();
        for (record, channel, places) in self.layout.all() {
            let Some(here) = left_out.get(places.clone()).filter(|here| here.contains(&true)) else { continue };
            let (Some(r), Some(values)) = (self.records.get_mut(record), self.readings_kpa.get_mut(places)) else {
                continue;
            };
            r.missing.resize(channels, Vec::new());
            if let Some(missing) = r.missing.get_mut(channel) {
                missing.resize(here.len(), false);
                missing.iter_mut().zip(here).for_each(|(missing, out)| *missing |= out);
            }
            r.over_missing(channel, values);
        }
        self
    }

    /// Rows of all recordings together.
    pub fn rows(&self) -> usize {
        self.records.iter().map(|record| record.time_s.len()).sum()
    }
}
