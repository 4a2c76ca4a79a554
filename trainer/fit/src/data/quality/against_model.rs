//! Swapped columns and wrong units, told by what the rig would do.
//!
//! The rig's own model runs from rest under the recorded commands; after its chambers have filled, where it stands
//! does not depend on any reading. No rig is so far from its file that it stands at a tenth or at ten times of it, or
//! at plus instead of minus, so these tests need no fit.

use model::rig::Rig;

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
    let mut standings = Vec::new();
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
        standings.push(Recorded { source, telling: telling(rig, records, &medians) });
    }
    let compare = Compare { columns: records.sensors(), atmosphere_kpa: rig.atmosphere.pressure_kpa_abs };
    // What the duties do is told by the pressures, so what is sure about those comes first. A duty never turns a
    // pressure's sign, but one that is inverted or exchanged moves what is expected of it, so the rest comes last.
    let before = findings.len();
    let checks: [Check<'_>; 4] = [
        &|found| standings.iter().for_each(|r| found.extend(compare.together(r))),
        &|found| standings.iter().for_each(|r| found.extend(compare.alone(r, |s| s.recorded * s.simulated < 0.0))),
        &|found| duties(rig, records, found),
        &|found| standings.iter().for_each(|r| found.extend(compare.alone(r, |_| true))),
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

/// Only channels that the rig drives well away from the atmosphere tell anything.
fn telling<'a>(rig: &'a Rig, records: &Records, medians: &[(f64, f64)]) -> Vec<Standing<'a>> {
    medians
        .iter()
        .enumerate()
        .filter(|(_, (_, simulated))| simulated.abs() > 15.0)
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

/// Rows after a change of duty within which its own chamber answers.
const ANSWER_ROWS: usize = 10;

/// Tells by which chamber answers first whether two duties are exchanged or one is inverted.
///
/// The rate of pressure `Δp` over 0.2 s is regressed on the duties over that time and the pressures (a first-order
/// plant); the sign and size of the coefficients are compared with those of the simulated rig by the caller's own
/// valves: a valve from a chamber lowers its pressure, one into a chamber raises it.
fn duties(rig: &Rig, records: &Records, findings: &mut Vec<Finding>) {
    let channels = records.sensors().len();
    let valves: Vec<(&str, usize, f64)> = rig
        .valves
        .values()
        .filter_map(|valve| {
            let channel_of = |volume: &str| {
                let sensor = rig.sensors.values().find(|s| s.volume == volume)?;
                records.sensors().iter().position(|column| *column == sensor.column)
            };
            // A valve between a chamber with a sensor and anything else acts on that chamber with a known sign.
            match (channel_of(&valve.from), channel_of(&valve.to)) {
                (Some(channel), None) => Some((valve.command.as_str(), channel, -1.0)),
                (None, Some(channel)) => Some((valve.command.as_str(), channel, 1.0)),
                _ => None,
            }
        })
        .collect();
    let [(one, c1, s1), (other, c2, s2)] = valves.as_slice() else { return };
    if c1 == c2 || channels != 2 {
        return;
    }
    let mut rows: Vec<[f64; 5]> = Vec::new();
    let mut answers: Vec<[f64; 2]> = Vec::new();
    for (record, r) in records.records().iter().enumerate() {
        let (Some(u1), Some(u2)) = (records.input(record, one), records.input(record, other)) else { continue };
        let p = [records.channel_kpa(record, *c1), records.channel_kpa(record, *c2)];
        for segment in &r.segments {
            let mut row = segment.start;
            while row + ANSWER_ROWS < segment.end {
                let mean = |u: &[f64]| u[row..row + ANSWER_ROWS].iter().sum::<f64>() / ANSWER_ROWS as f64;
                rows.push([1.0, mean(u1), mean(u2), p[0][row], p[1][row]]);
                answers.push([p[0][row + ANSWER_ROWS] - p[0][row], p[1][row + ANSWER_ROWS] - p[1][row]]);
                row += ANSWER_ROWS;
            }
        }
    }
    let columns: Vec<Vec<f64>> = (0..5).map(|k| rows.iter().map(|r| r[k]).collect()).collect();
    let fit = |channel: usize| {
        let b: Vec<f64> = answers.iter().map(|a| a[channel]).collect();
        crate::least_squares::solve(&columns, &b, "duties").ok().filter(|fit| fit.condition < 1e4)
    };
    let (Some(first), Some(second)) = (fit(0), fit(1)) else { return };
    // Effects of both duties on both chambers, in standard errors, signed as the rig has them.
    let t = |fit: &crate::least_squares::LinearFit, k: usize, sign: f64| sign * fit.x[k] / fit.sd[k].max(1e-12);
    let own = [t(&first, 1, *s1), t(&second, 2, *s2)];
    let cross = [t(&first, 2, *s1), t(&second, 1, *s2)];
    const SURE: f64 = 8.0;
    if cross[0] > SURE && cross[1] > SURE && own[0].abs() < 0.5 * cross[0] && own[1].abs() < 0.5 * cross[1] {
        findings.push(Finding {
            source: String::new(),
            column: format!("{one}, {other}"),
            severity: Severity::Unusable,
            trouble: Trouble::SwappedDuties,
            text: format!("each chamber answers to the other's duty: {one} and {other} seem to be swapped"),
        });
        return;
    }
    for (effect, (column, ..)) in own.iter().zip(&valves) {
        if *effect < -SURE {
            findings.push(Finding {
                source: String::new(),
                column: (*column).to_owned(),
                severity: Severity::Unusable,
                trouble: Trouble::InvertedDuty,
                text: "opening the valve moves the pressure the wrong way: the duty seems to be inverted (1 is open)"
                    .to_owned(),
            });
        }
    }
}

fn median(values: &[f64]) -> f64 {
    let mut values = values.to_vec();
    let middle = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f64::total_cmp).1 }
}
