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

fn median(values: &[f64]) -> f64 {
    let mut values = values.to_vec();
    let middle = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f64::total_cmp).1 }
}
