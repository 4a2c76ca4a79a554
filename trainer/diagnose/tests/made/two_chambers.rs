//! A rig that is not the paper's: a small pump fills a chamber, which passes its gas on through a line into another one that leaks.

use fit::data::Records;
use fit::simulate::{Fidelity, Simulator};
use model::rig::Rig;
use proto::recording::Recording;
use rand::{RngExt as _, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

use super::column;

/// Noise of the readings in kPa.
pub const SIGMA_KPA: f64 = 0.03;

const RIG: &str = r#"
format = 1
name = "duo"
description = "Two chambers in a row."

[gas]
gas_constant_j_per_kg_k = 287.0
heat_capacity_ratio = 1.4

[atmosphere]
pressure_kpa_abs = 101.325
temperature_k = 293.15

[integrator]
step_ms = 0.4
tick_ms = 20.0

[volumes.a]
volume_l = 0.2
temperature_k = 293.15

[volumes.b]
volume_l = 0.5
temperature_k = 293.15

[pumps.micro]
kind = "flow"
inlet = "atmosphere"
outlet = "a"
command = "drive"
flow_l_per_min = 2.0

[lines.ab]
kind = "laminar"
from = "a"
to = "b"
resistance_kpa_s_per_l = 400.0

[lines.bleed]
kind = "laminar"
from = "b"
to = "atmosphere"
resistance_kpa_s_per_l = 700.0

[sensors.sa]
volume = "a"
column = "pa"
range_kpa_gauge = [-20.0, 100.0]
range_v = [0.0, 5.0]

[sensors.sb]
volume = "b"
column = "pb"
range_kpa_gauge = [-20.0, 100.0]
range_v = [0.0, 5.0]
"#;

pub fn rig() -> Rig {
    Rig::from_toml(RIG).unwrap()
}

/// Random holds of 0.4 to 2.5 s between two drives, both of which are among them.
pub fn holds(rows: usize, [low, high]: [f64; 2], seed: u64) -> Vec<f64> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut drive = vec![high; 50.min(rows)];
    drive.resize(100.min(rows), low);
    while drive.len() < rows {
        let level: f64 = low + (high - low) * random.random::<f64>();
        drive.resize((drive.len() + random.random_range(20..125)).min(rows), (level * 1e5).round() * 1e-5);
    }
    drive
}

/// Recording of a rig with these sensors from rest, under a drive.
pub fn recorded(rig: &Rig, source: &str, drive: &[f64], seed: u64) -> Recording {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let time_s: Vec<f64> = (0..drive.len()).map(|k| k as f64 * 0.02).collect();
    let with = |pressures: Vec<Vec<f64>>| {
        let mut columns = vec![column("drive", drive.to_vec())];
        columns.extend(rig.sensors.values().zip(pressures).map(|(sensor, kpa)| column(&sensor.column, kpa)));
        Recording::new(source, time_s.clone(), columns).unwrap()
    };
    let records = Records::new(rig, &[with(vec![vec![0.0; drive.len()]; rig.sensors.len()])]).unwrap();
    let trace = Simulator::new(&records, Fidelity::Detailed).free(std::slice::from_ref(rig)).pop().unwrap().unwrap();
    let read = |channel: usize| -> Vec<f64> {
        let simulated = trace[records.layout().channel(0, channel)].iter();
        simulated.map(|kpa| kpa + SIGMA_KPA * Distribution::<f64>::sample(&StandardNormal, &mut random)).collect()
    };
    with((0..rig.sensors.len()).map(read).collect())
}
