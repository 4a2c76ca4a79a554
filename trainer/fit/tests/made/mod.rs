//! Recordings made by the model itself, for tests.

#![allow(dead_code)] // each test file uses its part

use fit::data::Records;
use fit::simulate::{Fidelity, Simulator};
use model::rig::Rig;
use proto::recording::Recording;
use proto::recording::csv::{Column, ColumnData};
use rand::{RngExt as _, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

/// Noise of the sensors in kPa and the step of their converter.
pub(crate) const SIGMA_KPA: f64 = 0.08;
pub(crate) const STEP_KPA: f64 = 0.03;

/// The paper's rig at a step of 0.2 ms, for generating and fitting alike: twice as fast. (At 0.4 ms its slopes are those
/// of the integrator's own error where check valves are concerned, which averaged pumps do not share.)
pub(crate) fn quick_rig() -> Rig {
    let mut rig = Rig::builtin("dual_pressure").unwrap();
    rig.integrator.step_ms = 0.2;
    rig
}

/// Random holds of 0.4 … 2.4 s of both duties, with some ramps in between.
pub(crate) fn duties(rows: usize, seed: u64) -> [Vec<f64>; 2] {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    [0.66, 0.66].map(|low: f64| {
        let mut duty = Vec::with_capacity(rows);
        let mut level = 0.8;
        while duty.len() < rows {
            let next = low + (0.98 - low) * random.random::<f64>();
            let hold = random.random_range(20..120);
            let ramp = if random.random::<f64>() < 0.3 { hold } else { 1 };
            for k in 0..hold {
                let share = ((k + 1) as f64 / ramp as f64).min(1.0);
                // Commands are written with five digits.
                duty.push(((level + share * (next - level)) * 1e5).round() * 1e-5);
            }
            level = next;
        }
        duty.truncate(rows);
        duty
    })
}

/// Noise-free readings of a rig under duties, after 6 s that are not recorded; and the duties of the recorded rows.
pub(crate) fn truth(rig: &Rig, rows: usize, seed: u64) -> ([Vec<f64>; 2], [Vec<f64>; 2]) {
    const BEFORE: usize = 300;
    let duty = duties(rows + BEFORE, seed);
    let blank = recording("blank", &duty, &[vec![0.0; rows + BEFORE], vec![0.0; rows + BEFORE]]);
    let records = Records::new(rig, &[blank]).unwrap();
    let trace = Simulator::new(&records, Fidelity::Detailed).free(std::slice::from_ref(rig)).pop().unwrap().unwrap();
    let channel = |c: usize| trace[records.layout().channel(0, c)][BEFORE..].to_vec();
    (duty.map(|d| d[BEFORE..].to_vec()), [channel(0), channel(1)])
}

/// Readings as sensors give them: white noise, then the converter's steps.
pub(crate) fn noisy(truth: &[Vec<f64>; 2], seed: u64) -> [Vec<f64>; 2] {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    truth.clone().map(|channel| {
        channel
            .into_iter()
            .map(|p| {
                let white: f64 = StandardNormal.sample(&mut random);
                ((p + SIGMA_KPA * white) / STEP_KPA).round() * STEP_KPA
            })
            .collect()
    })
}

/// A recording of these columns, 20 ms apart.
pub(crate) fn recording(source: &str, duty: &[Vec<f64>; 2], pressures: &[Vec<f64>; 2]) -> Recording {
    let time_s = (0..duty[0].len()).map(|k| k as f64 * 0.02).collect();
    recording_at(source, time_s, duty, pressures)
}

/// Recording at given times.
pub(crate) fn recording_at(
    source: &str,
    time_s: Vec<f64>,
    duty: &[Vec<f64>; 2],
    pressures: &[Vec<f64>; 2],
) -> Recording {
    let column =
        |name: &str, numbers: &[f64]| Column { name: name.to_owned(), data: ColumnData::Numbers(numbers.to_vec()) };
    let columns = vec![
        column("u_pos", &duty[0]),
        column("u_neg", &duty[1]),
        column("p_pos_kpa", &pressures[0]),
        column("p_neg_kpa", &pressures[1]),
    ];
    Recording::new(source, time_s, columns).unwrap()
}

/// A noisy recording of a rig.
pub(crate) fn made(rig: &Rig, rows: usize, seed: u64) -> Recording {
    let (duty, pressures) = truth(rig, rows, seed);
    recording(&format!("run{seed}.csv"), &duty, &noisy(&pressures, 1000 + seed))
}
