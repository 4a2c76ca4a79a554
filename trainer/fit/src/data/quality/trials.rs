//! Free runs of the rig as given, with commands and readings taken for something else than they are said to be.
//!
//! A fault of a recording (two columns exchanged, a command turned round, an atmosphere too much) is told where the rig follows the
//! recording well with the fault mended and badly as it stands. All trials of a recording are copies of the same rows that run side by
//! side, so that a dozen of them take hardly longer than a few.

use std::ops::Range;

use model::rig::Rig;

use super::meaning::Meaning;
use crate::data::noise::span;
use crate::data::{Earlier, Record, Records};
use crate::simulate::{Arcs, Fidelity, Run, Simulator};

/// Most rows of a trial, the fewest that tell anything, and the most of all trials together.
const ROWS: usize = 1500;
const LEAST_ROWS: usize = 500;
const ALL_ROWS: usize = 30_000;
/// Rows that a trial begins before the first command moves.
const BEFORE: usize = 50;
/// Share of a channel's largest pressure that it counts as moving through at least: what stands still is off by something, too.
const LEAST_SPAN: f64 = 0.1;

/// One way to take a recording's columns; numbers are places among the inputs or channels of [`Records`].
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Taken {
    /// Everything is what it is said to be.
    AsItStands,
    /// Two commands stand in each other's place.
    CommandsExchanged([usize; 2]),
    /// Commands are 0 where they ought to be 1.
    CommandsInverted(Vec<usize>),
    /// Two sensors stand in each other's place.
    SensorsExchanged([usize; 2]),
    /// Sensors read so many kPa too little.
    SensorsShifted(Vec<usize>, f64),
    /// The numbers of sensors are something else than gauge kPa.
    SensorsMeant(Vec<usize>, Meaning),
}

impl Taken {
    /// Changes a copy of a recording to what it would be; `readings_kpa` are its channels one after another.
    fn apply(&self, rig: &Rig, sensors: &[String], record: &mut Record, readings_kpa: &mut [f64]) {
        let rows = record.time_s.len();
        let place = |channel: usize| channel * rows..(channel + 1) * rows;
        match self {
            Taken::AsItStands => {}
            Taken::CommandsExchanged([one, other]) => {
                if one.max(other) < &record.inputs.len() {
                    record.inputs.swap(*one, *other);
                }
            }
            Taken::CommandsInverted(inputs) => {
                for input in inputs {
                    record.inputs.get_mut(*input).into_iter().flatten().for_each(|u| *u = 1.0 - *u);
                }
            }
            Taken::SensorsExchanged([one, other]) => {
                if place(*one.max(other)).end <= readings_kpa.len() {
                    place(*one).zip(place(*other)).for_each(|(a, b)| readings_kpa.swap(a, b));
                }
                if one.max(other) < &record.missing.len() {
                    record.missing.swap(*one, *other);
                }
            }
            Taken::SensorsShifted(channels, kpa) => {
                for channel in channels {
                    readings_kpa.get_mut(place(*channel)).into_iter().flatten().for_each(|p| *p += kpa);
                }
            }
            Taken::SensorsMeant(channels, meaning) => {
                for channel in channels {
                    let Some(column) = sensors.get(*channel) else { continue };
                    let sensor = rig.sensor_of(column).map(|(_, sensor)| sensor);
                    let file_unit = record.file_unit(column);
                    let of = |p: f64| meaning.of(p, sensor, file_unit, rig.atmosphere.pressure_kpa_abs);
                    let values = readings_kpa.get_mut(place(*channel)).into_iter().flatten();
                    values.for_each(|p| *p = of(*p).unwrap_or(f64::NAN));
                }
            }
        }
    }

    /// The channels whose readings it concerns, of so many.
    pub(super) fn channels(&self, all: usize) -> Vec<usize> {
        match self {
            Taken::SensorsExchanged(pair) => pair.to_vec(),
            Taken::SensorsShifted(channels, _) | Taken::SensorsMeant(channels, _) => channels.clone(),
            Taken::AsItStands | Taken::CommandsExchanged(_) | Taken::CommandsInverted(_) => (0..all).collect(),
        }
    }
}

/// The end of one trial.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Outcome {
    /// Mean square by which the rig was off the readings, by channel, in squares of what the channel moves through.
    squares: Vec<f64>,
    /// Least of the readings as they were taken, and of the rig (kPa), by channel.
    pub(super) lowest_kpa: Vec<[f64; 2]>,
}

impl Outcome {
    /// Root mean square by which the rig was off in some channels, as a share of what these move through; infinite where no run
    /// came to an end.
    pub(super) fn off(&self, channels: &[usize]) -> f64 {
        let of = |channel: &usize| self.squares.get(*channel).copied().unwrap_or(f64::INFINITY);
        let mean = channels.iter().map(of).sum::<f64>() / channels.len().max(1) as f64;
        if mean.is_finite() { mean.sqrt() } else { f64::INFINITY }
    }
}

/// The outcome of each way to take a recording; `None` of a recording without a stretch in which a command moves, and of a rig that
/// cannot be run.
pub(super) fn tried(rig: &Rig, records: &Records, record: usize, all: &[Taken]) -> Option<Vec<Outcome>> {
    let rows = rows(records, record, all.len())?;
    let (copies, _) = records.parts(&vec![(record, rows); all.len()]);
    let copies = copies.changed(|copy, record, readings_kpa| {
        // Commands before the first row stand as they were recorded, whatever the trial.
        record.before = Earlier::default();
        if let Some(taken) = all.get(copy) {
            taken.apply(rig, records.sensors(), record, readings_kpa);
        }
    });
    let simulator = Simulator::new(&copies, Fidelity::Coarse);
    let trace = simulator.run(&[Run::from(rig.clone())], &Arcs::free(&copies)).pop()?.ok()?;
    let channels = 0..copies.layout().channels();
    let outcome = |copy: usize| {
        let (squares, lowest_kpa) = channels.clone().map(|channel| compared(&copies, &trace, copy, channel)).unzip();
        Outcome { squares, lowest_kpa }
    };
    Some((0..all.len()).map(outcome).collect())
}

/// Mean square by which a channel of a copy is off, in squares of what it moves through, and the least that is read and simulated.
fn compared(copies: &Records, trace: &[f64], copy: usize, channel: usize) -> (f64, [f64; 2]) {
    let simulated = trace.get(copies.layout().channel(copy, channel)).unwrap_or_default();
    let read = copies.channel_kpa(copy, channel);
    let record = copies.records().get(copy);
    let (mut squares, mut count, mut lowest, mut largest) = (0.0, 0.0, [f64::INFINITY; 2], 0.0_f64);
    for (row, (p, s)) in read.iter().zip(simulated).enumerate() {
        if record.is_some_and(|of| of.is_read(channel, row)) {
            squares += (p - s).powi(2);
            count += 1.0;
            lowest = [lowest[0].min(*p), lowest[1].min(*s)];
            largest = largest.max(p.abs());
        }
    }
    let moves_kpa = span(Some(read)).max(LEAST_SPAN * largest);
    let off = squares / (f64::max(count, 1.0) * moves_kpa.powi(2));
    (if off.is_finite() { off } else { f64::INFINITY }, lowest)
}

/// Rows of a recording that are tried: of its longest stretch, from shortly before a command moves.
fn rows(records: &Records, record: usize, trials: usize) -> Option<Range<usize>> {
    let r = records.records().get(record)?;
    let longest = r.segments.iter().max_by_key(|segment| segment.len())?;
    let moves = |row: &usize| r.inputs.iter().any(|input| input.get(*row) != input.get(longest.start));
    let from = longest.clone().find(moves)?.saturating_sub(BEFORE).max(longest.start);
    let most = (ALL_ROWS / trials.max(1)).clamp(LEAST_ROWS, ROWS);
    let rows = from..longest.end.min(from + most);
    (rows.len() >= LEAST_ROWS).then_some(rows)
}
