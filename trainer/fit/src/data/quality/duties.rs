//! Swapped and inverted duties, told by which chamber answers, and which way.
//!
//! This asks no model, so that a rig that is far from its file is judged as well, and knows one actuator alone, or one for each of two
//! chambers. What it cannot tell is left to free runs ([`super::mistaken`]), which know any number.

use model::rig::{Pump, Rig};

use super::mend::{exchanged_keys, inverted_key};
use super::{Finding, Severity, Trouble};
use crate::data::Records;
use crate::least_squares::{LinearFit, solve};

/// Rows after a change of duty within which its own chamber answers.
const ANSWER_ROWS: usize = 10;
/// Rows over which a chamber has settled, whatever delays its valve or rings in its sensor's line: 2 s.
const SETTLED_ROWS: usize = 100;
/// Standard errors at which an effect is beyond doubt.
const SURE: f64 = 8.0;

/// A valve or a pump between a chamber with a sensor and anything else: it moves that chamber's pressure in a known direction.
struct Actuator<'r> {
    command: &'r str,
    channel: usize,
    /// Sign of the effect of opening or driving it.
    sign: f64,
    is: Is,
}

/// Kinds of actuators.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Is {
    /// It opens.
    Valve,
    /// It is driven.
    Pump,
    /// It is switched.
    Relay,
}

/// Tells by which chamber answers first whether two duties are exchanged or one is inverted.
///
/// The rate of pressure `Δp` over 0.2 s is regressed on the duties over that time and the pressures (a first-order
/// plant); the sign and size of the coefficients are compared with those of the simulated rig by the caller's own
/// valves: a valve from a chamber lowers its pressure, one into a chamber raises it, and so does a pump. A duty is inverted only if pressures averaged
/// over 2 s say so as well: a sensor whose line rings swings the wrong way for a while.
pub(super) fn duties(rig: &Rig, records: &Records, findings: &mut Vec<Finding>) {
    let actuators = actuators(rig, records);
    // A command that acts between two chambers, or on none with a sensor, hides what the others do.
    let is_commanded = |pump: &&Pump| matches!(pump, Pump::Flow(pump) if pump.command.is_some());
    if actuators.len() < rig.valves.values().count() + rig.pumps.values().filter(is_commanded).count() {
        return;
    }
    if let [only] = actuators.as_slice() {
        inverted_alone(rig, records, only, findings);
    }
    let [one, other] = actuators.as_slice() else { return };
    if one.channel == other.channel || records.sensors().len() != 2 {
        return;
    }
    let pair = [one, other];
    let Some([first, second]) = regressed(records, pair, ANSWER_ROWS, |p, rows| p[rows.end] - p[rows.start]) else {
        return;
    };
    // Effects of both duties on both chambers, in standard errors, signed as the rig has them.
    let t = |fit: &LinearFit, k: usize, sign: f64| sign * fit.x[k] / fit.sd[k].max(1e-12);
    let own = [t(&first, 1, one.sign), t(&second, 2, other.sign)];
    let cross = [t(&first, 2, one.sign), t(&second, 1, other.sign)];
    if cross[0] > SURE && cross[1] > SURE && own[0].abs() < 0.5 * cross[0] && own[1].abs() < 0.5 * cross[1] {
        findings.push(Finding {
            source: String::new(),
            column: format!("{}, {}", one.command, other.command),
            severity: Severity::Unusable,
            trouble: Trouble::SwappedDuties,
            text: format!(
                "each chamber answers to the other's duty: {} and {} seem to be swapped: {}",
                one.command,
                other.command,
                exchanged_keys(rig, one.command, other.command)
            ),
        });
        return;
    }
    let mean = |p: &[f64], rows: std::ops::Range<usize>| p[rows.clone()].iter().sum::<f64>() / rows.len() as f64;
    let settled = regressed(records, pair, SETTLED_ROWS, mean)
        .map_or(own, |[first, second]| [t(&first, 1, one.sign), t(&second, 2, other.sign)]);
    for ((effect, settled), valve) in own.iter().zip(settled).zip(pair) {
        if *effect < -SURE && settled < 0.0 {
            findings.push(inverted(rig, "", valve.command, valve.is));
        }
    }
}

/// The complaint about a command that is turned round, in one recording or (without a `source`) in all.
pub(super) fn inverted(rig: &Rig, source: &str, command: &str, is: Is) -> Finding {
    let [what, whose, full] = match is {
        Is::Valve => ["opening the valve", "duty", "open"],
        Is::Pump => ["driving the pump", "duty", "full speed"],
        Is::Relay => ["switching the pump on", "relay", "on"],
    };
    Finding {
        source: source.to_owned(),
        column: command.to_owned(),
        severity: Severity::Unusable,
        trouble: Trouble::InvertedDuty,
        text: format!(
            "{what} moves the pressure the wrong way: the {whose} seems to be inverted (1 is {full}): {}",
            inverted_key(rig, command)
        ),
    }
}

/// Tells whether the only duty of a rig is inverted: the rate of its chamber's pressure on it and on that pressure, and the pressure
/// after two seconds of it.
fn inverted_alone(rig: &Rig, records: &Records, only: &Actuator<'_>, findings: &mut Vec<Finding>) {
    let t = |fit: &LinearFit| only.sign * fit.x[1] / fit.sd[1].max(1e-12);
    let of = |window: usize, answer: &dyn Fn(&[f64], std::ops::Range<usize>) -> f64| {
        let (mut columns, mut answers) = (vec![Vec::new(); 3], Vec::new());
        for record in 0..records.records().len() {
            let Some(u) = records.input(record, only.command) else { continue };
            let p = records.channel_kpa(record, only.channel);
            for segment in records.records().get(record).map_or(&[][..], |r| &r.segments) {
                let mut row = segment.start;
                while row + window < segment.end {
                    let mean = u[row..row + window].iter().sum::<f64>() / window as f64;
                    columns.iter_mut().zip([1.0, mean, p[row]]).for_each(|(column, value)| column.push(value));
                    answers.push(answer(p, row..row + window));
                    row += window;
                }
            }
        }
        solve(&columns, &answers, "duty").ok().filter(|fit| fit.condition < 1e4).map(|fit| t(&fit))
    };
    let fast = of(ANSWER_ROWS, &|p, rows| p[rows.end] - p[rows.start]);
    let settled = of(SETTLED_ROWS, &|p, rows| p[rows.clone()].iter().sum::<f64>() / rows.len() as f64);
    if fast.is_some_and(|t| t < -SURE) && settled.is_some_and(|t| t < -SURE) {
        findings.push(inverted(rig, "", only.command, only.is));
    }
}

/// Valves, and pumps that are commanded, that act on one chamber with a sensor.
fn actuators<'r>(rig: &'r Rig, records: &Records) -> Vec<Actuator<'r>> {
    let channel_of = |volume: &str| {
        let sensor = rig.sensors.values().find(|s| s.volume == volume)?;
        records.sensors().iter().position(|column| *column == sensor.column)
    };
    let acting = |is: Is, from: &str, to: &str, command: &'r str| {
        let (channel, sign) = match (channel_of(from), channel_of(to)) {
            (Some(channel), None) => (channel, -1.0),
            (None, Some(channel)) => (channel, 1.0),
            _ => return None,
        };
        Some(Actuator { command, channel, sign, is })
    };
    let valves = rig.valves.values().filter_map(|v| acting(Is::Valve, &v.from, &v.to, &v.command));
    let pumps = rig.pumps.values().filter_map(|pump| match pump {
        Pump::Flow(p) => acting(Is::Pump, &p.inlet, &p.outlet, p.command.as_deref()?),
        Pump::Piston(_) => None,
    });
    valves.chain(pumps).collect()
}

/// Regresses an `answer` of each valve's chamber over windows of so many rows on a constant, both mean duties and both pressures before
/// it; where windows are long, on the constant and the duties alone. `None` where the recordings do not tell these apart.
fn regressed(
    records: &Records,
    [one, other]: [&Actuator<'_>; 2],
    window: usize,
    answer: impl Fn(&[f64], std::ops::Range<usize>) -> f64,
) -> Option<[LinearFit; 2]> {
    let regressors = if window > ANSWER_ROWS { 3 } else { 5 };
    let (mut columns, mut answers) = (vec![Vec::new(); regressors], [Vec::new(), Vec::new()]);
    for (record, r) in records.records().iter().enumerate() {
        let (Some(u1), Some(u2)) = (records.input(record, one.command), records.input(record, other.command)) else {
            continue;
        };
        let p = [records.channel_kpa(record, one.channel), records.channel_kpa(record, other.channel)];
        for segment in &r.segments {
            let mut row = segment.start;
            while row + window < segment.end {
                let mean = |u: &[f64]| u[row..row + window].iter().sum::<f64>() / window as f64;
                let of = [1.0, mean(u1), mean(u2), p[0][row], p[1][row]];
                columns.iter_mut().zip(of).for_each(|(column, value)| column.push(value));
                for (answers, p) in answers.iter_mut().zip(p) {
                    answers.push(answer(p, row..row + window));
                }
                row += window;
            }
        }
    }
    let fit = |answers: &[f64]| solve(&columns, answers, "duties").ok().filter(|fit| fit.condition < 1e4);
    Some([fit(&answers[0])?, fit(&answers[1])?])
}
