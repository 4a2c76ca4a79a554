//! Swapped pressures and wrong units, told by what the rig would do.
//!
//! The rig's own model runs from rest under the recorded commands; after its chambers have filled, where it stands
//! does not depend on any reading. No rig is so far from its file that it stands at a tenth or at ten times of it, or
//! at plus instead of minus, so these tests need no fit.

use model::rig::Rig;

use super::duties::duties;
use super::meaning::{Meaning, RIGHT, Standing};
use super::{Finding, Severity, Trouble};
use crate::FitError;
use crate::data::Records;
use crate::simulate::{Arc, Arcs, Fidelity, Simulator};

/// Rows simulated from rest, and those at their end that are compared.
const ROWS: usize = 750;
const COMPARED: usize = 250;
/// How far a rig may be from its file: all channels taken together, in share and in kPa …
const NEAR: [f64; 2] = [0.35, 5.0];
/// … and a single channel that would mean something else than the others.
const NEARER: [f64; 2] = [0.2, 3.0];
/// Simulated pressure, in kPa from the atmosphere, from which on units and signs tell.
const TELLING_KPA: f64 = 15.0;
/// How far an absolute pressure may be from its file, in share and in kPa …
const OFF_BY_AIR: [f64; 2] = [0.5, 8.0];
/// … and a gauge one, in atmospheres, that is taken for one.
const FAR_FROM_AIR: f64 = 0.5;

pub(super) fn check(rig: &Rig, records: &Records, findings: &mut Vec<Finding>) -> Result<(), FitError> {
    let channels = records.sensors().len();
    let arcs = Arcs::from_arcs(
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
                let rows = first.start..off.unwrap_or(first.end).min(first.start + ROWS);
                (rows.len() > 2 * COMPARED).then(|| Arc {
                    record,
                    rows,
                    start_kpa: vec![0.0; channels],
                    fresh: true,
                    flappers: Vec::new(),
                })
            })
            .collect(),
    );
    let simulator = Simulator::new(records, Fidelity::Coarse);
    let trace = simulator.one(rig, &arcs)?;
    let (mut standings, mut absolutes) = (Vec::new(), Vec::new());
    for arc in arcs.arcs() {
        let compared = arc.rows.end - COMPARED..arc.rows.end;
        let medians: Vec<(f64, f64)> = (0..channels)
            .map(|channel| {
                let part = records.layout().stretch(arc.record, channel, compared.clone());
                let of = |vector: &[f64]| median(vector.get(part.clone()).unwrap_or_default());
                (of(records.readings_kpa()), of(&trace))
            })
            .collect();
        let source = records.records().get(arc.record).map_or_else(String::new, |r| r.source.clone());
        // What a chamber holds that nothing drives is for its leaks to say.
        if !records.inputs().is_empty() {
            let telling = standing(rig, records, &medians, |_| true);
            let (recorded, simulated) =
                (extremes(records, arc.record, records.readings_kpa()), extremes(records, arc.record, &trace));
            absolutes.push((Recorded { source: source.clone(), telling }, recorded, simulated));
        }
        let far = |simulated: f64| simulated.abs() > TELLING_KPA;
        standings.push(Recorded { source, telling: standing(rig, records, &medians, far) });
    }
    let compare = Compare { columns: records.sensors(), atmosphere_kpa: rig.atmosphere.pressure_kpa_abs };
    // What the duties do is told by the pressures, so what is sure about those comes first. A duty never turns a
    // pressure's sign, but one that is inverted or exchanged moves what is expected of it, so the rest comes last.
    let before = findings.len();
    let checks: [Check<'_>; 5] = [
        &|found| standings.iter().for_each(|r| found.extend(compare.together(r))),
        &|found| standings.iter().for_each(|r| found.extend(compare.alone(r, |s| s.recorded * s.simulated < 0.0))),
        &|found| duties(rig, records, found),
        &|found| standings.iter().for_each(|r| found.extend(compare.alone(r, |_| true))),
        &|found| {
            absolutes.iter().for_each(|(r, recorded, simulated)| found.extend(compare.absolute(r, recorded, simulated)))
        },
    ];
    for check in checks {
        if findings.len() == before {
            check(findings);
        }
    }
    Ok(())
}

/// Adds what one check finds.
type Check<'c> = &'c dyn Fn(&mut Vec<Finding>);

/// A recording's channels that tell something.
struct Recorded<'a> {
    source: String,
    telling: Vec<Standing<'a>>,
}

/// Channels whose simulated pressure is one that tells; of units only those that the rig drives well away from the atmosphere do.
fn standing<'a>(
    rig: &'a Rig,
    records: &Records,
    medians: &[(f64, f64)],
    tells: impl Fn(f64) -> bool,
) -> Vec<Standing<'a>> {
    medians
        .iter()
        .enumerate()
        .filter(|(_, (_, simulated))| tells(*simulated))
        .map(|(channel, (recorded, simulated))| Standing {
            channel,
            recorded: *recorded,
            simulated: *simulated,
            sensor: rig.sensors.values().find(|sensor| Some(&sensor.column) == records.sensors().get(channel)),
        })
        .collect()
}

/// Compares recorded and simulated medians.
struct Compare<'a> {
    columns: &'a [String],
    atmosphere_kpa: f64,
}

impl Compare<'_> {
    fn column(&self, channel: usize) -> String {
        self.columns.get(channel).cloned().unwrap_or_default()
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
            text: meaning.text(standing, self.atmosphere_kpa),
        }
    }

    /// All channels in one unit, as a logger does it, or two columns exchanged.
    fn together(&self, recorded: &Recorded<'_>) -> Option<Finding> {
        let telling = &recorded.telling;
        let worst =
            |meaning: Meaning| telling.iter().map(|s| meaning.misfit(s, self.atmosphere_kpa, NEAR)).fold(0.0, f64::max);
        if worst(RIGHT) < 1.0 {
            return None;
        }
        let (misfit, meaning) =
            Meaning::wrong().map(|meaning| (worst(meaning), meaning)).min_by(|a, b| a.0.total_cmp(&b.0))?;
        if let [a, b] = telling.as_slice() {
            let of =
                |recorded: f64, s: &Standing<'_>| RIGHT.misfit(&Standing { recorded, ..*s }, self.atmosphere_kpa, NEAR);
            let exchanged = of(a.recorded, b).max(of(b.recorded, a));
            if exchanged < misfit.min(1.0) {
                let (one, other) = (self.column(a.channel), self.column(b.channel));
                return Some(Finding {
                    source: recorded.source.clone(),
                    column: format!("{one}, {other}"),
                    severity: Severity::Unusable,
                    trouble: Trouble::SwappedPressures,
                    text: format!(
                        "{one} reads {:.1} kPa and {other} {:.1} kPa: the two columns seem to be swapped",
                        a.recorded, b.recorded
                    ),
                });
            }
        }
        // One channel says nothing about all of them.
        (misfit < 1.0 && telling.len() > 1)
            .then(|| telling.first().map(|first| self.wrong(recorded, first, meaning)))
            .flatten()
    }

    /// Channels that read an atmosphere too much, in whatever unit: told of rigs near the atmosphere too, since no rig is off by that.
    ///
    /// All of a recording must be near what the rig does, not its last seconds alone: least and most by channel, in kPa.
    fn absolute(&self, recorded: &Recorded<'_>, read: &[[f64; 2]], simulated: &[[f64; 2]]) -> Vec<Finding> {
        let whole = |s: &Standing<'_>, meaning: Meaning| {
            let (Some(read), Some([low, high])) = (read.get(s.channel), simulated.get(s.channel)) else { return false };
            let [share, kpa] = OFF_BY_AIR;
            let margin = 2.0 * kpa + share * low.abs().max(high.abs());
            let of = |value: f64| meaning.of(value, s.sensor, self.atmosphere_kpa);
            read.iter().all(|value| of(*value).is_some_and(|p| (low - margin..=high + margin).contains(&p)))
        };
        let near = |s: &Standing<'_>, meaning: Meaning| {
            meaning.misfit(s, self.atmosphere_kpa, OFF_BY_AIR) < 1.0 && whole(s, meaning)
        };
        let closest = |s: &Standing<'_>| {
            let absolute = Meaning::wrong().filter(|meaning| matches!(meaning, Meaning::Absolute(..)));
            absolute
                .filter(|meaning| near(s, *meaning))
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
        let misfits = |s: &&Standing<'_>| RIGHT.misfit(s, self.atmosphere_kpa, NEAR) >= 1.0 && of(s);
        let closest = |standing: &Standing<'_>| {
            Meaning::wrong()
                .map(|meaning| (meaning.misfit(standing, self.atmosphere_kpa, NEARER), meaning))
                .min_by(|a, b| a.0.total_cmp(&b.0))
                .filter(|(misfit, _)| *misfit < 1.0)
        };
        recorded
            .telling
            .iter()
            .filter(misfits)
            .filter_map(|standing| Some(self.wrong(recorded, standing, closest(standing)?.1)))
            .collect()
    }
}

/// Least and most of a vector's readings by channel of a recording, those of rows that were not simulated left out.
fn extremes(records: &Records, record: usize, vector: &[f64]) -> Vec<[f64; 2]> {
    let of = |channel: usize| {
        let part = vector.get(records.layout().channel(record, channel)).unwrap_or_default();
        let finite = part.iter().copied().filter(|value| value.is_finite());
        finite.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| [low.min(value), high.max(value)])
    };
    (0..records.layout().channels()).map(of).collect()
}

fn median(values: &[f64]) -> f64 {
    let mut values = values.to_vec();
    let middle = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f64::total_cmp).1 }
}
