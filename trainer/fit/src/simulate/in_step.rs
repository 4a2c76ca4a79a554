//! The ripple of a speed that keeps step, as the readings have it.
//!
//! The averaged pump predicts the ripple to a tenth or so of its height and to a few degrees of its angle, not the same in
//! each channel: a twentieth of a kPa is left, as slow as the ripple passes. Once speed and angles are known
//! ([`super::tachometer`]), the readings themselves say how high each harmonic is:
//!
//! ```text
//! min over a, b of  |off − Σ_h a_h u_h + b_h v_h|² / s² + |a − 1|² / p² + |b|² / p²
//! ```
//!
//! by channel, `u` and `v` the predicted harmonics at the angles read and a quarter of their period on, all less their mean
//! over each recording. What is left of a model is slow, so that rows count as one in [`TOGETHER`]; `p` is [`SPREAD`].

use std::f64::consts::TAU;

use nalgebra::{SMatrix, SVector};

use super::ripple::{HARMONICS, Ripple};
use super::tachometer::Tachometer;
use crate::data::Records;

/// Rows of which errors of a model go together: 5 s.
const TOGETHER: f64 = 250.0;
/// Spread of a harmonic's height about the predicted one, as a share of that.
const SPREAD: f64 = 0.2;

/// The ripple on each reading in kPa, at the speed and angles that were read off `ripple`. `weights` is zero at readings that
/// do not count.
pub fn ripple_in_step(records: &Records, ripple: &Ripple, read: &Tachometer, weights: &[f64]) -> Vec<f64> {
    const UNKNOWNS: usize = 2 * HARMONICS;
    let mut ripple_kpa = vec![0.0; records.layout().len()];
    let turns_hz = read.slip * ripple.speed_rpm / 60.0;
    // The harmonics at one reading, at angle zero and a quarter of a period on.
    let predicted = |index: usize, turned: f64| -> SVector<f64, UNKNOWNS> {
        let pairs = ripple.at.get(index).copied().unwrap_or_default();
        SVector::from_fn(|k, _| {
            let (sin, cos) = (TAU * (k / 2 + 1) as f64 * turned).sin_cos();
            let (u, v) = pairs.get(k / 2).map_or((0.0, 0.0), |pair| pair.turned(sin, cos));
            if k % 2 == 0 { u } else { v }
        })
    };
    for channel in 0..records.layout().channels() {
        let mut normal = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
        let mut along = SVector::<f64, UNKNOWNS>::zeros();
        let (mut squares, mut rows) = (0.0, 0.0);
        let mut all = Vec::new();
        for (index, record) in records.records().iter().enumerate() {
            let first_s = record.time_s.first().copied().unwrap_or(0.0);
            let crank = read.crank_rev.get(index).copied().unwrap_or(0.0);
            let harmonics: Vec<(usize, SVector<f64, UNKNOWNS>)> = records
                .layout()
                .channel(index, channel)
                .zip(&record.time_s)
                .map(|(place, time_s)| (place, predicted(place, crank + turns_hz * (time_s - first_s))))
                .collect();
            let counted = || harmonics.iter().filter(|(place, _)| weights.get(*place).is_some_and(|w| *w > 0.0));
            let off = |place: usize| {
                let at = |numbers: &[f64]| numbers.get(place).copied().unwrap_or(0.0);
                at(records.readings_kpa()) - at(&ripple.mean_kpa)
            };
            let n = (counted().count() as f64).max(1.0);
            let mean_off = counted().map(|(place, _)| off(*place)).sum::<f64>() / n;
            let mean: SVector<f64, UNKNOWNS> = counted().map(|(_, h)| *h).sum::<SVector<f64, UNKNOWNS>>() / n;
            for (place, h) in counted() {
                let (h, off) = (h - mean, off(*place) - mean_off);
                normal += h * h.transpose();
                along += h * off;
                squares += off * off;
                rows += 1.0;
            }
            all.extend(harmonics);
        }
        // As predicted, but for what the readings say otherwise.
        let expected = SVector::<f64, UNKNOWNS>::from_fn(|k, _| if k % 2 == 0 { 1.0 } else { 0.0 });
        let explained = 2.0 * along.dot(&expected) - (normal * expected).dot(&expected);
        let variance = ((squares - explained) / f64::max(rows, 1.0)).max(1e-9);
        let trust = 1.0 / (SPREAD * SPREAD);
        let information = normal / (variance * TOGETHER) + SMatrix::identity() * trust;
        let heights =
            information.cholesky().map_or(expected, |c| c.solve(&(along / (variance * TOGETHER) + expected * trust)));
        for (place, h) in all {
            if let Some(slot) = ripple_kpa.get_mut(place) {
                *slot = heights.dot(&h);
            }
        }
    }
    ripple_kpa
}

#[cfg(test)]
mod tests {
    use super::super::start::refined_starts;
    use super::super::tachometer::tachometer;
    use super::super::tachometer::tests::recorded_on;
    use super::super::{Arcs, Fidelity, Simulator};
    use super::*;
    use model::rig::{Pump, Rig};

    /// Root mean square of what is left of readings about a smooth run, each channel of each recording less its mean.
    fn left_kpa(records: &Records, rig: &Rig) -> f64 {
        let simulator = Simulator::new(records, Fidelity::Smooth).on(1);
        let arcs = refined_starts(&simulator, rig, &Arcs::free(records)).unwrap();
        let trace = simulator.one(rig, &arcs).unwrap();
        let mut squares = 0.0;
        for (_, _, range) in records.layout().all() {
            let off: Vec<f64> = range.map(|i| records.readings_kpa()[i] - trace[i]).collect();
            let mean = off.iter().sum::<f64>() / off.len() as f64;
            squares += off.iter().map(|o| (o - mean).powi(2)).sum::<f64>();
        }
        (squares / records.layout().len() as f64).sqrt()
    }

    #[test]
    fn a_ripple_in_step_comes_out_of_the_readings() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let mut turning = rig.clone();
        for pump in turning.pumps.values_mut() {
            if let Pump::Piston(pump) = pump {
                pump.speed_rpm = 2998.5;
            }
        }
        // A twentieth of a turn of the crank a second: three turns of the ripple in 60 s.
        let recordings = [0.1, 0.6].map(|crank| recorded_on(turning.clone(), crank, 3000));
        let records = Records::new(&rig, &recordings).unwrap();
        let simulator = Simulator::new(&records, Fidelity::Averaged).on(1);
        let weights = vec![1.0; records.layout().len()];
        let predicted = Ripple::of(&simulator, &rig).unwrap().unwrap();
        let read = tachometer(&records, &predicted, &weights).swap_remove(0);
        let ripple = ripple_in_step(&records, &predicted, &read, &weights);
        let freed = records.readings_kpa().iter().zip(&ripple).map(|(r, ripple)| r - ripple).collect();
        let (before, after) = (left_kpa(&records, &rig), left_kpa(&records.with_readings(freed).unwrap(), &rig));
        // The ripple has a root mean square of 0.2 kPa; strokes that fill the chambers from rest are not of it.
        assert!(before > 0.15 && after < 0.3 * before, "{before} {after}");
    }
}
