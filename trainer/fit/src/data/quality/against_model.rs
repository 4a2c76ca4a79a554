//! Swapped columns and wrong units, told by what the rig would do.
//!
//! The rig's own model runs from rest under the recorded commands; after its chambers have filled, where it stands
//! does not depend on any reading. No rig is so far from its file that it stands at a tenth or at ten times of it, or
//! at plus instead of minus, so these tests need no fit.

use model::rig::Rig;

use super::{Finding, Severity, Trouble};
use crate::FitError;
use crate::data::Records;
use crate::simulate::{Arc, Arcs, Fidelity, Simulator};

/// Rows simulated from rest, and those at their end that are compared.
const ROWS: usize = 750;
const COMPARED: usize = 250;
/// Units that pressures are found in, and how many there are of each in 1 kPa.
const UNITS: [(f64, &str); 5] =
    [(1e3, "Pa"), (0.01, "bar"), (0.001, "MPa"), (0.145, "psi"), (10.0, "mbar, hPa or cmH2O")];

pub(super) fn check(rig: &Rig, records: &Records, findings: &mut Vec<Finding>) -> Result<(), FitError> {
    let channels = records.sensors().len();
    let arcs = Arcs::from_arcs(
        records
            .records()
            .iter()
            .enumerate()
            .filter_map(|(record, r)| {
                let first = r.segments.first()?;
                let rows = first.start..first.end.min(first.start + ROWS);
                (rows.len() > 2 * COMPARED).then(|| Arc { record, rows, start_kpa: vec![0.0; channels], fresh: true })
            })
            .collect(),
    );
    let simulator = Simulator::new(records, Fidelity::Coarse);
    let trace = simulator.one(rig, &arcs)?;
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
        compare(rig, records, &source, &medians, findings);
    }
    duties(rig, records, findings);
    Ok(())
}

/// Compares recorded and simulated medians of all channels.
fn compare(rig: &Rig, records: &Records, source: &str, medians: &[(f64, f64)], findings: &mut Vec<Finding>) {
    let add = |column: String, trouble, text| Finding {
        source: source.to_owned(),
        column,
        severity: Severity::Unusable,
        trouble,
        text,
    };
    let columns = records.sensors();
    // Only channels that the rig drives well away from the atmosphere tell anything.
    let telling: Vec<(usize, f64, f64)> = medians
        .iter()
        .enumerate()
        .filter(|(_, (_, simulated))| simulated.abs() > 15.0)
        .map(|(channel, (recorded, simulated))| (channel, *recorded, *simulated))
        .collect();
    if telling.is_empty() {
        return;
    }
    let atmosphere = rig.atmosphere.pressure_kpa_abs;
    let fits = |recorded: f64, simulated: f64| (recorded - simulated).abs() < 0.35 * simulated.abs() + 5.0;
    if telling.iter().all(|(_, recorded, simulated)| fits(*recorded, *simulated)) {
        return;
    }
    for (factor, unit) in UNITS {
        if telling.iter().all(|(_, recorded, simulated)| fits(recorded / factor, *simulated)) {
            let (channel, recorded, simulated) = telling[0];
            findings.push(add(
                columns.get(channel).cloned().unwrap_or_default(),
                Trouble::WrongUnit,
                format!(
                    "reads {recorded:.4} where about {simulated:.0} kPa are expected: the pressures seem to be in \
                     {unit}; convert them to gauge kPa"
                ),
            ));
            return;
        }
    }
    if telling.iter().all(|(_, recorded, simulated)| fits(recorded - atmosphere, *simulated)) {
        let (channel, recorded, simulated) = telling[0];
        findings.push(add(
            columns.get(channel).cloned().unwrap_or_default(),
            Trouble::Absolute,
            format!(
                "reads {recorded:.1} where about {simulated:.0} kPa are expected: the pressures seem to be absolute; \
                 subtract the atmosphere's {atmosphere:.1} kPa"
            ),
        ));
        return;
    }
    if let [(a, recorded_a, simulated_a), (b, recorded_b, simulated_b)] = telling.as_slice()
        && fits(*recorded_a, *simulated_b)
        && fits(*recorded_b, *simulated_a)
    {
        let (one, other) = (columns.get(*a).cloned().unwrap_or_default(), columns.get(*b).cloned().unwrap_or_default());
        findings.push(add(
            format!("{one}, {other}"),
            Trouble::SwappedPressures,
            format!(
                "{one} reads {recorded_a:.1} kPa and {other} {recorded_b:.1} kPa: the two columns seem to be swapped"
            ),
        ));
        return;
    }
    for (channel, recorded, simulated) in &telling {
        let column = columns.get(*channel).cloned().unwrap_or_default();
        if fits(-recorded, *simulated) {
            findings.push(add(
                column,
                Trouble::WrongUnit,
                format!(
                    "reads {recorded:.1} kPa where about {simulated:.0} kPa are expected: the sign seems to be lost"
                ),
            ));
        }
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
