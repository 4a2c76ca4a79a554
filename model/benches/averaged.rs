//! Gain by averaging: time of a table, of a free run of 5 minutes, and how far it is from the detailed plant.
//!
//! `cargo bench -p model --bench averaged`. Free runs of 15,000 ticks from 95/−70 kPa under random holds; the first
//! 2,000 ticks are compared with the detailed plant.
#![allow(missing_docs, clippy::unwrap_used)]

use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use model::averaged::PumpTables;
use model::plant::{FreeRunStart, Plant, Simulated, Simulation};
use model::real::Lanes;
use model::rig::Rig;

const TICKS: usize = 15_000;
const REPEATS: usize = 7;

fn main() {
    let droop = "[[mechanisms]]\nid = \"pump_droop\"\ncomponent = \"pump\"\nspeed_loss_per_bar = 0.05\n";
    let with_droop = format!("{}\n{droop}", model::rig::DUAL_PRESSURE);
    let rigs = [
        ("dual_pressure", Rig::builtin("dual_pressure").unwrap()),
        ("bench", Rig::builtin("bench").unwrap()),
        ("with pump_droop", Rig::from_toml(&with_droop).unwrap()),
    ];
    for (name, rig) in &rigs {
        println!("{name}");
        let table = median((0..REPEATS).map(|_| {
            milliseconds(|| {
                black_box(Plant::averaged(rig, 5.0, &PumpTables::new()).unwrap());
            })
        }));
        println!("  table and plant       {table:>8.2} ms");
        for step_ms in [2.0, 5.0, 10.0] {
            let tables = PumpTables::new();
            let one = Arc::new(Plant::averaged(rig, step_ms, &tables).unwrap());
            let rigs = std::slice::from_ref(rig);
            let eight = Arc::new(Plant::<Lanes<8>>::averaged_side_by_side(rigs, step_ms, &tables).unwrap());
            let single = median((0..REPEATS).map(|_| milliseconds(|| free_run(&one))));
            let lanes = median((0..REPEATS).map(|_| milliseconds(|| free_run(&eight)))) / 8.0;
            let [pos, neg] = off(rig, &one);
            println!(
                "  steps of {step_ms:>4} ms      {single:>8.2} ms a free run, {lanes:.2} ms a lane; rms off {pos:.4} {neg:.4} kPa"
            );
        }
    }
}

/// Levels held for 0.5 … 2.5 s.
fn duties(tick: usize) -> [f64; 3] {
    let level = |hold: usize, salt: u64| {
        let mut seed = ((tick / hold) as u64 + salt).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        seed ^= seed >> 31;
        0.6 + 0.4 * (seed % 1000) as f64 / 1000.0
    };
    [level(61, 1), level(83, 2), 1.0]
}

fn start<R: Simulated>(plant: &Arc<Plant<R>>) -> Simulation<R> {
    let mut simulation = Simulation::new(Arc::clone(plant));
    simulation.start_from(&[95.0, -70.0].map(R::splat), &[0.8, 0.8, 1.0].map(R::splat), FreeRunStart::Running);
    simulation
}

fn free_run<R: Simulated>(plant: &Arc<Plant<R>>) {
    let mut simulation = start(plant);
    for tick in 0..TICKS {
        simulation.tick(&duties(tick).map(R::splat));
        black_box(simulation.reading_kpa(0));
        black_box(simulation.reading_kpa(1));
    }
}

fn off(rig: &Rig, averaged: &Arc<Plant<f64>>) -> [f64; 2] {
    let (mut rough, mut fine) = (start(averaged), start(&Arc::new(Plant::new(rig).unwrap())));
    let mut sum = [0.0; 2];
    for tick in 0..2000 {
        rough.tick(&duties(tick));
        fine.tick(&duties(tick));
        for (c, sum) in sum.iter_mut().enumerate() {
            *sum += (rough.reading_kpa(c) - fine.reading_kpa(c)).powi(2);
        }
    }
    sum.map(|sum: f64| (sum / 2000.0).sqrt())
}

fn milliseconds(work: impl FnOnce()) -> f64 {
    let start = Instant::now();
    work();
    start.elapsed().as_secs_f64() * 1e3
}

fn median(numbers: impl Iterator<Item = f64>) -> f64 {
    let mut numbers: Vec<f64> = numbers.collect();
    numbers.sort_unstable_by(f64::total_cmp);
    numbers[numbers.len() / 2]
}
