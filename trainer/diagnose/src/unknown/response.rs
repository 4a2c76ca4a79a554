//! A reading that answers the pressure in a way of its own: a formula with three numbers, where a table over a chamber's
//! variables would need a memory for every swing.
//!
//! Which frequency and damping fit, and what share of the reading answers so, is first looked up on the simulated pressure, filtered at the rows' own rate; only the
//! best place is then fitted in free runs.

use fit::data::Role;
use fit::parameters::{Knowledge, Parameter, SearchRange, Transform};
use model::mechanism::{Mechanism, ResidualResponse};
use model::rig::MechanismInstance;
use proto::recording::PERIOD_S;

use super::{UnknownTerm, fit_further, told};
use crate::bench::{Bench, Explanation};

/// Frequencies that are looked at, in Hz: each 1.25 times the one before. Beyond the last the rows, 20 ms apart, show
/// no swing.
const LOWEST_HZ: f64 = 0.2;
const FREQUENCIES: i32 = 21;
/// Damping ratios that are looked at.
const DAMPINGS: [f64; 8] = [0.025, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0, 2.0];
/// Largest share of a reading, either way.
const SHARE: f64 = 4.0;
/// Share of a reading's mean squared mismatch that must go at a first look.
const WORTH: f64 = 0.1;
/// Standard deviation of frequency's and damping's logarithm, and of the share: as good as nothing is known of what has no name.
const KNOWN: f64 = 1.5;

/// Where a reading's answer fits best at a first look.
struct Look {
    channel: usize,
    sensor: String,
    response: ResidualResponse,
    /// Share of the reading's mean squared mismatch that goes.
    goes: f64,
}

/// Fits an answer of the reading that gains most by one; `None` where none does, or the rig takes no further one (a sensor has
/// one at most).
pub(super) fn fit_response(bench: &Bench<'_>, base: &Explanation) -> Option<UnknownTerm> {
    let looks = (0..bench.records.layout().channels()).filter_map(|channel| look(bench, base, channel));
    let best = looks.max_by(|a, b| a.goes.total_cmp(&b.goes)).filter(|best| best.goes > WORTH)?;
    let mut rig = base.fitted.rig.clone();
    let at = rig.mechanisms.len();
    let known = base.set.len();
    let ResidualResponse { natural_frequency_hz, damping_ratio, share } = best.response;
    let numbers = [
        ("natural_frequency_hz", Transform::Log, natural_frequency_hz, [0.05, 100.0]),
        ("damping_ratio", Transform::Log, damping_ratio, [0.005, 20.0]),
        ("share", Transform::Linear, share, [-5.0, 5.0]),
    ];
    let mechanism = Mechanism::ResidualResponse(best.response);
    rig.mechanisms.push(MechanismInstance { component: best.sensor.clone(), enabled: true, mechanism });
    let own = numbers.map(|(key, transform, mean, bounds)| Parameter {
        path: format!("mechanisms.{at}.{key}"),
        transform,
        mean,
        knowledge: Knowledge::Prior { sd: KNOWN },
        bounds,
        range: SearchRange::Whole,
    });
    let explanation = fit_further(bench, base, &rig, own, [base.fitted.point.clone()]).ok()?;
    let rings = explanation.fitted.estimates.get(known + 1).is_some_and(|damping| damping.value < 1.0);
    let depends_on = format!(
        "a reading of {} that {}: natural frequency {} Hz, damping ratio {}, share of the reading {}",
        best.sensor,
        if rings { "rings as a mass on a spring would" } else { "comes late by two lags" },
        told(&explanation, known),
        told(&explanation, known + 1),
        told(&explanation, known + 2)
    );
    Some(UnknownTerm { explanation, depends_on, reading: Some(best.channel) })
}

/// The frequency and damping at which what `base` simulates comes nearest to one reading.
fn look(bench: &Bench<'_>, base: &Explanation, channel: usize) -> Option<Look> {
    let column = bench.records.sensors().get(channel)?;
    let (sensor, _) = bench.rig.sensor_of(column)?;
    let layout = bench.records.layout();
    let weights = bench.split.weights(layout, Role::Fit);
    // Runs of rows without a gap: what was simulated, what was read, what counts.
    let mut runs: Vec<(&[f64], &[f64], Vec<bool>)> = Vec::new();
    for (record, r) in bench.records.records().iter().enumerate() {
        for rows in &r.segments {
            let places = layout.stretch(record, channel, rows.clone());
            let counts = places.clone().map(|i| {
                let at = |of: &[f64]| of.get(i).is_some_and(|weight| *weight != 0.0);
                at(&weights) && at(bench.counted())
            });
            runs.push((
                base.trace.get(places.clone())?,
                bench.records.readings_kpa().get(places.clone())?,
                counts.collect(),
            ));
        }
    }
    // Σ of missing², missing · effect and effect² of an answer of the whole reading.
    let sums = |effect: &dyn Fn(&[f64]) -> Vec<f64>| -> [f64; 3] {
        let mut sums = [0.0; 3];
        for (simulated, recorded, counts) in &runs {
            let rows = effect(simulated).into_iter().zip(simulated.iter().zip(*recorded)).zip(counts);
            for ((effect, (simulated, recorded)), _) in rows.filter(|(_, counts)| **counts) {
                let missing = recorded - simulated;
                for (sum, term) in sums.iter_mut().zip([missing * missing, missing * effect, effect * effect]) {
                    *sum += term;
                }
            }
        }
        sums
    };
    let mut best: Option<Look> = None;
    for step in 0..FREQUENCIES {
        for damping_ratio in DAMPINGS {
            let natural_frequency_hz = LOWEST_HZ * 1.25_f64.powi(step);
            let whole = ResidualResponse { natural_frequency_hz, damping_ratio, share: 1.0 };
            let effect = |simulated: &[f64]| {
                answered(&whole, simulated).iter().zip(simulated).map(|(z, p)| z - p).collect::<Vec<f64>>()
            };
            let [missing, along, size] = sums(&effect);
            let share = (along / size).clamp(-SHARE, SHARE);
            let goes = (2.0 * share * along - share * share * size) / missing;
            if goes.is_finite() && best.as_ref().is_none_or(|best| goes > best.goes) {
                let response = ResidualResponse { share, ..whole };
                best = Some(Look { channel, sensor: sensor.to_owned(), response, goes });
            }
        }
    }
    best
}

/// Readings that an answer makes of simulated ones, row by row, from rest.
fn answered(response: &ResidualResponse, simulated: &[f64]) -> Vec<f64> {
    let swing = response.swing(PERIOD_S);
    let mut before = simulated.first().copied().unwrap_or(0.0);
    let (mut reading, mut speed) = (before, 0.0);
    simulated
        .iter()
        .map(|now| {
            let seen = 0.5 * (before + now);
            let off = reading - seen;
            (reading, speed) =
                (seen + swing.keeps * off + swing.turns * speed, swing.damps * speed - swing.turns * off);
            before = *now;
            reading
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A slow sine comes through whole; at its natural frequency it is 1/(2 ζ) as large.
    #[test]
    fn an_answer_has_its_resonance() {
        let response = ResidualResponse { natural_frequency_hz: 2.0, damping_ratio: 0.25, share: 1.0 };
        for (hz, gain) in [(0.05, 1.0), (2.0, 2.0)] {
            let sine: Vec<f64> =
                (0..4000).map(|k| (std::f64::consts::TAU * hz * PERIOD_S * f64::from(k)).sin()).collect();
            let largest = answered(&response, &sine).iter().skip(2000).fold(0.0_f64, |most, y| most.max(y.abs()));
            // Means of neighbouring rows are 0.8 % smaller than a sine of 2 Hz, and held for a row each.
            assert!((largest / gain - 1.0).abs() < 0.015, "{hz} Hz: {largest}");
        }
    }
}
