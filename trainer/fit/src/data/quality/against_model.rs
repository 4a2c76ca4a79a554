//! Swapped pressures and wrong units, told by what the rig would do.
//!
//! The rig's own model runs from rest under the recorded commands; after its chambers have filled, where it stands
//! does not depend on any reading. No rig is so far from its file that it stands at a tenth or at ten times of it, or
//! at plus instead of minus, so these tests need no fit. Margins in kPa are those of a rig that reaches 50 kPa or of a
//! sensor with a range of 500; those of lesser ones are less in proportion, since what a sensor is off by goes with its range. Where
//! they are less, a rig must also be one that forgets where it began: what measured flows add up to in a lung that nothing empties
//! drifts away from any reading by a kPa or two.
//!
//! A meaning is asked at three places: where the rig first stands far enough from the atmosphere to tell, and where it would stand
//! lowest and highest. One number may be a pressure in several units; that all three are in the wrong one is no chance.

use std::ops::Range;

use model::rig::Rig;

use super::counts::{Counts, converters, is_counted, largest, samples};
use super::duties::duties;
use super::expected::extremes;
use super::meaning::{AS_WRITTEN, Meaning, RIGHT, Standing, or_rival};
use super::mend::exchanged_keys;
use super::{Finding, Severity, Trouble, median};
use super::{mistaken, sign_trials};
use crate::FitError;
use crate::data::Records;
use crate::simulate::{Arc, Arcs, Fidelity, Simulator};

/// Rows simulated from rest after which chambers have filled, those that are compared at a time, and the most that are simulated
/// where a rig rests at first.
const ROWS: usize = 750;
const COMPARED: usize = 250;
const MOST_ROWS: usize = 3000;
/// Distance that a rig may have from its file: all channels taken together, in share and in kPa …
const NEAR: [f64; 2] = [0.35, 5.0];
/// … and a single channel that would mean something else than the others.
const NEARER: [f64; 2] = [0.2, 3.0];
/// Simulated pressure, in kPa from the atmosphere, from which on units and signs tell.
const TELLING_KPA: f64 = 15.0;
/// Pressure that a rig reaches, and range of a sensor, from which on these margins hold; below both they are less in proportion.
const WHOLE_REACH_KPA: f64 = 50.0;
const WHOLE_RANGE_KPA: f64 = 500.0;
/// Share of what a rig began with that it may remember, for its readings to tell.
const REMEMBERED: f64 = 0.1;
/// Distance that an absolute pressure may have from its file, in share and in kPa …
const OFF_BY_AIR: [f64; 2] = [0.5, 8.0];
/// … and a gauge one, in atmospheres, that is taken for one.
const FAR_FROM_AIR: f64 = 0.5;

/// A column of a recording that stands where the rig would, as it was read.
pub(super) struct Agreed {
    /// The file.
    pub(super) source: String,
    /// The column.
    pub(super) column: String,
}

/// Adds what the model tells of pressures and duties; gives the columns that agree with it.
///
/// # Errors
/// The rig cannot be simulated.
pub(super) fn check(rig: &Rig, records: &Records, findings: &mut Vec<Finding>) -> Result<Vec<Agreed>, FitError> {
    let channels = records.sensors().len();
    let arcs = from_rest(rig, records);
    let simulator = Simulator::new(records, Fidelity::Coarse);
    let trace = simulator.one(rig, &arcs)?;
    let elsewhere = begun_elsewhere(records, &arcs, &trace);
    let other = simulator.one(rig, &elsewhere)?;
    let (mut standings, mut absolutes) = (Vec::new(), Vec::new());
    for (arc, from_elsewhere) in arcs.arcs().iter().zip(elsewhere.arcs()) {
        let medians = |rows: Range<usize>| -> Vec<Medians> {
            let of = |channel: usize| {
                let part = records.layout().stretch(arc.record, channel, rows.clone());
                let of = |vector: &[f64]| median(vector.get(part.clone()).unwrap_or_default());
                let (simulated, begun) = (of(&trace), from_elsewhere.start_kpa.get(channel).copied().unwrap_or(0.0));
                let forgets = (of(&other) - simulated).abs() <= REMEMBERED * begun.abs();
                Medians { recorded: of(records.readings_kpa()), simulated, forgets }
            };
            (0..channels).map(of).collect()
        };
        let windows: Vec<Vec<Medians>> = compared(&arc.rows).map(medians).collect();
        let source = records.records().get(arc.record).map_or_else(String::new, |r| r.source.clone());
        let simulated = extremes(records, arc, &trace);
        let of = |medians: &Vec<Medians>, channel| standing(rig, records, arc.record, medians, &simulated, channel);
        let all = |c: usize| windows.iter().filter_map(|of| of.get(c)).map(|m| [m.recorded, m.simulated]).collect();
        let first = |channel| Some(Standing { ends: all(channel), ..of(windows.first()?, channel)? });
        let whole: Vec<Standing<'_>> = (0..channels).filter_map(first).collect();
        let tells = |s: &Standing<'_>| s.simulated.abs() > TELLING_KPA * s.scale;
        let telling = (0..channels).filter_map(|channel| {
            let all: Vec<Standing<'_>> = windows.iter().filter_map(|medians| of(medians, channel)).collect();
            let ends = ends(&all);
            all.into_iter().find(tells).map(|first| Standing { ends, ..first })
        });
        let record = arc.record;
        let counted: Vec<usize> = (0..channels).filter(|channel| is_counted(records, record, *channel)).collect();
        standings.push(Recorded { source: source.clone(), record, telling: telling.collect(), counted });
        // What a chamber holds that nothing drives is for its leaks to say.
        if !records.inputs().is_empty() {
            let recorded = extremes(records, arc, records.readings_kpa());
            absolutes.push((Recorded { source, record, telling: whole, counted: Vec::new() }, recorded, simulated));
        }
    }
    let compare = Compare { rig, records, atmosphere_kpa: rig.atmosphere.pressure_kpa_abs };
    // What the duties do is told by the pressures, so what is sure about those comes first. A duty never turns a
    // pressure's sign, but one that is inverted or exchanged moves what is expected of it, so the rest comes last.
    let before = findings.len();
    let counted = |r: &Recorded<'_>| r.telling.iter().all(|s| r.counted.contains(&s.channel));
    let checks: [Check<'_>; 8] = [
        &|found| standings.iter().for_each(|r| found.extend(compare.together(r))),
        &|found| standings.iter().filter(|r| counted(r)).for_each(|r| found.extend(compare.counts(r))),
        &|found| standings.iter().for_each(|r| found.extend(compare.alone(r, |s| s.recorded * s.simulated < 0.0))),
        &|found| duties(rig, records, found),
        &|found| mistaken::check(rig, records, found),
        &|found| standings.iter().for_each(|r| found.extend(compare.alone(r, |_| true))),
        &|found| {
            absolutes.iter().for_each(|(r, recorded, simulated)| found.extend(compare.absolute(r, recorded, simulated)))
        },
        &|found| sign_trials::check(rig, records, found),
    ];
    for check in checks {
        if findings.len() == before {
            check(findings);
        }
    }
    if findings.iter().skip(before).any(|f| f.trouble == Trouble::WrongUnit) {
        mistaken::instead(rig, records, Trouble::WrongUnit, findings);
    }
    Ok(standings.iter().flat_map(|recorded| compare.agreed(recorded)).collect())
}

/// Medians where a channel would stand lowest and highest, recorded and simulated.
fn ends(all: &[Standing<'_>]) -> Vec<[f64; 2]> {
    let by_simulated = |a: &&Standing<'_>, b: &&Standing<'_>| a.simulated.total_cmp(&b.simulated);
    let (lowest, highest) = (all.iter().min_by(by_simulated), all.iter().max_by(by_simulated));
    lowest.into_iter().chain(highest).map(|s| [s.recorded, s.simulated]).collect()
}

/// The first rows of each recording, simulated from rest.
fn from_rest(rig: &Rig, records: &Records) -> Arcs {
    let channels = records.sensors().len();
    Arcs::from_arcs(
        records
            .records()
            .iter()
            .enumerate()
            .filter_map(|(record, r)| {
                let first = r.segments.first()?;
                // Where a rig stands with its pump off is for its leaks to say, and such recordings are made to show them: a
                // chamber that empties in a minute is no other unit.
                let relays = records.relays(rig, record);
                let off = first.clone().find(|row| relays.iter().any(|relay| relay.get(*row).is_some_and(|on| !on)));
                let rows = first.start..off.unwrap_or(first.end).min(first.start + MOST_ROWS);
                (rows.len() > 2 * COMPARED).then(|| Arc {
                    record,
                    rows,
                    start_kpa: vec![0.0; channels],
                    fresh: true,
                    flappers: Vec::new(),
                })
            })
            .collect(),
    )
}

/// Adds what one check finds.
type Check<'c> = &'c dyn Fn(&mut Vec<Finding>);

/// A recording's channels that tell something.
struct Recorded<'a> {
    source: String,
    /// Place among the recordings.
    record: usize,
    telling: Vec<Standing<'a>>,
    /// Channels that look like the counts of a converter.
    counted: Vec<usize>,
}

/// Rows that are compared: the last before chambers count as filled, then the others in turn, for a rig that rests at first.
fn compared(rows: &Range<usize>) -> impl Iterator<Item = Range<usize>> {
    let first = rows.end.min(rows.start + ROWS);
    let windows = (rows.end - first) / COMPARED;
    (0..=windows).map(move |k| first + k * COMPARED).map(|end| end - COMPARED..end)
}

/// Arcs that begin half-way to what the rig would reach.
fn begun_elsewhere(records: &Records, arcs: &Arcs, trace: &[f64]) -> Arcs {
    let of = |arc: &Arc| {
        let farthest = |[low, high]: [f64; 2]| if high.abs() >= low.abs() { high } else { low };
        let reached = extremes(records, arc, trace).into_iter().map(farthest);
        let start_kpa = reached.map(|kpa| if kpa.is_finite() { 0.5 * kpa } else { 0.0 }).collect();
        Arc { start_kpa, ..arc.clone() }
    };
    Arcs::from_arcs(arcs.arcs().iter().map(of).collect())
}

/// Medians of a channel over some rows.
struct Medians {
    recorded: f64,
    simulated: f64,
    /// True where it stands there wherever it began.
    forgets: bool,
}

/// A channel at its medians, where they tell; `reached` are the least and most that the rig would do, by channel.
fn standing<'a>(
    rig: &'a Rig,
    records: &'a Records,
    record: usize,
    medians: &[Medians],
    reached: &[[f64; 2]],
    channel: usize,
) -> Option<Standing<'a>> {
    let &Medians { recorded, simulated, forgets } = medians.get(channel)?;
    let column = records.sensors().get(channel)?;
    let sensor = rig.sensor_of(column).map(|(_, sensor)| sensor);
    let file_unit = records.records().get(record).and_then(|record| record.file_unit(column));
    let [low, high] = *reached.get(channel)?;
    let range_kpa = sensor.map_or(WHOLE_RANGE_KPA, |s| (s.range_kpa_gauge[0] - s.range_kpa_gauge[1]).abs());
    let scale = (low.abs().max(high.abs()) / WHOLE_REACH_KPA).max(range_kpa / WHOLE_RANGE_KPA).min(1.0);
    let standing = Standing { channel, recorded, simulated, sensor, scale, file_unit, ends: Vec::new() };
    (forgets || scale >= 1.0).then_some(standing)
}

/// Compares recorded and simulated medians.
struct Compare<'a> {
    rig: &'a Rig,
    records: &'a Records,
    atmosphere_kpa: f64,
}

impl Compare<'_> {
    fn column(&self, channel: usize) -> String {
        self.records.sensors().get(channel).cloned().unwrap_or_default()
    }

    fn wrong(&self, recorded: &Recorded<'_>, standing: &Standing<'_>, meaning: Meaning) -> Finding {
        Finding {
            source: recorded.source.clone(),
            column: self.column(standing.channel),
            severity: Severity::Unusable,
            trouble: if matches!(meaning, Meaning::Absolute(_, "kPa")) {
                Trouble::Absolute
            } else {
                Trouble::WrongUnit
            },
            text: meaning.text(self.rig, &self.column(standing.channel), standing),
        }
    }

    /// The complaint about a meaning found by some channels within margins, with the other that it cannot be told from.
    fn wrong_or(
        &self,
        recorded: &Recorded<'_>,
        standing: &Standing<'_>,
        by: (&[&Standing<'_>], [f64; 2]),
        meaning: Meaning,
    ) -> Finding {
        let found = self.wrong(recorded, standing, meaning);
        let rival = or_rival(self.rig, &found.column, by, (meaning, standing.file_unit));
        Finding { text: found.text + &rival, ..found }
    }

    /// The complaint about a unit, with the counts of a converter beside it where the channel looks like those.
    fn or_counts(&self, recorded: &Recorded<'_>, standing: &Standing<'_>, found: Finding) -> Finding {
        if !recorded.counted.contains(&standing.channel) {
            return found;
        }
        let counts = Counts { rig: self.rig, run: Some((self.records, recorded.record)) };
        let most = largest(samples(self.records, recorded.record, standing.channel));
        Finding { text: counts.beside(&found.column, most, &found.text), ..found }
    }

    /// The meaning that all of some channels have instead of gauge kPa, with its misfit where they tell first: one that explains what
    /// gauge kPa do not, there or at the ends; `None` where gauge kPa do.
    fn meaning(&self, of: &[&Standing<'_>], wrong: [f64; 2]) -> Option<(f64, Meaning)> {
        let first = |meaning: Meaning, margins| {
            of.iter().map(|s| meaning.misfit(s, self.atmosphere_kpa, margins)).fold(0.0, f64::max)
        };
        let anywhere = |meaning: Meaning, margins| {
            of.iter().map(|s| meaning.misfit_anywhere(s, self.atmosphere_kpa, margins)).fold(0.0, f64::max)
        };
        let at_first = first(RIGHT, NEAR) >= 1.0;
        if !at_first && anywhere(RIGHT, NEAR) < 1.0 {
            return None;
        }
        // What is said of the numbers comes before what units there are: mbar over kPa is a fiftieth off metres of water.
        if of.iter().any(|s| s.file_unit.is_some()) && anywhere(AS_WRITTEN, wrong) < 1.0 {
            return Some((first(AS_WRITTEN, wrong), AS_WRITTEN));
        }
        let is_as_read =
            |meaning: Meaning| of.iter().all(|s| meaning.is_as_read(s.sensor, s.file_unit, self.atmosphere_kpa));
        let others = Meaning::wrong().filter(|meaning| !is_as_read(*meaning));
        let judged: Vec<(f64, f64, Meaning)> =
            others.map(|meaning| (first(meaning, wrong), anywhere(meaning, wrong), meaning)).collect();
        let fits = |(first, anywhere, _): &(f64, f64, Meaning)| if at_first { *first < 1.0 } else { *anywhere < 1.0 };
        let best = judged.iter().filter(|one| fits(one)).min_by(|a, b| a.1.total_cmp(&b.1).then(a.0.total_cmp(&b.0)));
        let nearest = || judged.iter().filter(|_| at_first).min_by(|a, b| a.0.total_cmp(&b.0));
        best.or_else(nearest).map(|(first, _, meaning)| (*first, *meaning))
    }

    /// Columns that stand where the rig would.
    fn agreed(&self, recorded: &Recorded<'_>) -> Vec<Agreed> {
        let agrees = |s: &&Standing<'_>| RIGHT.misfit_anywhere(s, self.atmosphere_kpa, NEAR) < 1.0;
        let of = |s: &Standing<'_>| Agreed { source: recorded.source.clone(), column: self.column(s.channel) };
        recorded.telling.iter().filter(agrees).map(of).collect()
    }

    /// All channels in one unit, as a logger does it, or two columns exchanged.
    fn together(&self, recorded: &Recorded<'_>) -> Option<Finding> {
        let telling = &recorded.telling;
        let (misfit, meaning) = self.meaning(&telling.iter().collect::<Vec<_>>(), NEAR)?;
        if let [a, b] = telling.as_slice() {
            let of = |recorded: f64, s: &Standing<'_>| {
                RIGHT.misfit(&Standing { recorded, ends: Vec::new(), ..*s }, self.atmosphere_kpa, NEAR)
            };
            let exchanged = of(a.recorded, b).max(of(b.recorded, a));
            if exchanged < misfit.min(1.0) {
                let (one, other) = (self.column(a.channel), self.column(b.channel));
                return Some(Finding {
                    source: recorded.source.clone(),
                    column: format!("{one}, {other}"),
                    severity: Severity::Unusable,
                    trouble: Trouble::SwappedPressures,
                    text: format!(
                        "{one} reads {:.1} kPa and {other} {:.1} kPa: the two columns seem to be swapped: {}",
                        a.recorded,
                        b.recorded,
                        exchanged_keys(self.rig, &one, &other)
                    ),
                });
            }
        }
        // One of them may be in this unit already, and be said to be.
        let is_wrong = |s: &&Standing<'_>| !meaning.is_as_read(s.sensor, s.file_unit, self.atmosphere_kpa);
        let first = telling.iter().find(is_wrong).or(telling.first());
        // One channel says nothing about all of them.
        (misfit < 1.0 && telling.len() > 1)
            .then(|| {
                let by: Vec<&Standing<'_>> = telling.iter().collect();
                first.map(|first| self.or_counts(recorded, first, self.wrong_or(recorded, first, (&by, NEAR), meaning)))
            })
            .flatten()
    }

    /// Counts of one converter in all channels; one channel says nothing about all of them.
    fn counts(&self, recorded: &Recorded<'_>) -> Option<Finding> {
        let misfit = |meaning: Meaning| {
            let of = |s: &Standing<'_>| meaning.misfit_anywhere(s, self.atmosphere_kpa, NEAR);
            recorded.telling.iter().map(of).fold(0.0, f64::max)
        };
        if recorded.telling.len() < 2 || misfit(RIGHT) < 1.0 {
            return None;
        }
        let judged = converters().map(|meaning| (misfit(meaning), meaning)).filter(|(misfit, _)| *misfit < 1.0);
        let (_, meaning) = judged.min_by(|a, b| a.0.total_cmp(&b.0))?;
        recorded.telling.first().map(|first| self.wrong(recorded, first, meaning))
    }

    /// Channels that read an atmosphere too much, in whatever unit: told of rigs near the atmosphere too, since no rig is off by that.
    ///
    /// All of a recording must be near what the rig does, not its last seconds alone: least and most by channel, in kPa.
    fn absolute(&self, recorded: &Recorded<'_>, read: &[[f64; 2]], simulated: &[[f64; 2]]) -> Vec<Finding> {
        let whole = |s: &Standing<'_>, meaning: Meaning| {
            let (Some(read), Some([low, high])) = (read.get(s.channel), simulated.get(s.channel)) else { return false };
            let [share, kpa] = OFF_BY_AIR;
            let margin = 2.0 * kpa * s.scale + share * low.abs().max(high.abs());
            let of = |value: f64| meaning.of(value, s.sensor, s.file_unit, self.atmosphere_kpa);
            read.iter().all(|value| of(*value).is_some_and(|p| (low - margin..=high + margin).contains(&p)))
        };
        let near = |s: &Standing<'_>, meaning: Meaning| {
            meaning.misfit(s, self.atmosphere_kpa, OFF_BY_AIR) < 1.0 && whole(s, meaning)
        };
        let closest = |s: &Standing<'_>| {
            let absolute = Meaning::wrong().filter(|meaning| matches!(meaning, Meaning::Absolute(..)));
            absolute
                .filter(|meaning| {
                    near(s, *meaning) && meaning.is_nearer_everywhere(s, self.atmosphere_kpa, OFF_BY_AIR[1])
                })
                .map(|meaning| (meaning.misfit(s, self.atmosphere_kpa, OFF_BY_AIR), meaning))
                .min_by(|a, b| a.0.total_cmp(&b.0))
                .map(|(_, meaning)| meaning)
        };
        let far = |s: &&Standing<'_>| {
            (s.recorded - s.simulated).abs() > FAR_FROM_AIR * self.atmosphere_kpa && !near(s, RIGHT)
        };
        let those = recorded.telling.iter().filter(far);
        those.filter_map(|s| Some(self.wrong(recorded, s, closest(s)?))).collect()
    }

    /// Channels by themselves, as a person does it sensor by sensor.
    fn alone(&self, recorded: &Recorded<'_>, of: impl Fn(&Standing<'_>) -> bool) -> Vec<Finding> {
        // With no other channel to agree with it, a unit must suit wherever the channel stood.
        let suits = |s: &Standing<'_>, meaning: Meaning| meaning.misfit_anywhere(s, self.atmosphere_kpa, NEARER) < 1.0;
        let closest = |s: &Standing<'_>| self.meaning(&[s], NEARER).filter(|(_, meaning)| suits(s, *meaning));
        let those = recorded.telling.iter().filter(|s| of(s));
        let told = |standing: &Standing<'_>| {
            let found = self.wrong_or(recorded, standing, (&[standing], NEARER), closest(standing)?.1);
            Some(self.or_counts(recorded, standing, found))
        };
        those.filter_map(told).collect()
    }
}
