//! How far the nominal hidden rig is from the paper's model after a refit of the paper's parameters.
#[path = "../tests/paper/mod.rs"]
mod paper;
use hidden_rig::{actuation::Actuation, plant::Plant, rng::Draws, run::{Precision, Rig, Run}, sensor::Noise};
use paper::{Paper, TABLE_III, refit, rms};

fn holds(seed: u64, ticks: usize) -> Vec<[f64; 2]> {
    let mut d = Draws::new(seed);
    let mut u = [0.8, 0.8];
    let mut left = [0usize; 2];
    (0..ticks).map(|_| { for c in 0..2 { if left[c] == 0 { u[c] = d.between(0.62, 0.99); left[c] = 15 + d.index(85); } left[c] -= 1; } u }).collect()
}

fn trace(plant: &Plant, u: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let rig = Rig { plant: plant.clone(), actuation: Actuation::default(), noise: Noise { white_pa: [70.0; 2], slow_pa: [30.0; 2], slow_correlation: 0.9, jitter_s: 1e-4 } };
    let mut run = Run::settled(&rig, u[0], Precision::Fine);
    u.iter().map(|&u| { let r = run.clean_kpa(); run.tick(u, true); r }).collect()
}

fn main() {
    let start = Paper { p: TABLE_III, angle: 0.0 };
    let u = holds(1, 1500);
    let held = holds(2, 1500);
    let mut variants: Vec<(String, Box<dyn Fn(&mut Plant)>)> = Vec::new();
    let base = |p: &mut Plant| { p.pump.wall_conductance_w_k = 150.0; p.chambers[0].wall_conductance_w_k = 600.0; p.chambers[1].wall_conductance_w_k = 400.0; };
    for (angle, b, flapper) in [(0.0, 0.5283, 0.8e-3), (1.0, 0.5283, 0.8e-3), (2.5, 0.5283, 0.8e-3), (0.0, 0.50, 0.8e-3), (0.0, 0.515, 0.8e-3), (0.0, 0.5283, 1.5e-3)] {
        variants.push((format!("angle {angle} b {b} flapper {flapper}"), Box::new(move |p: &mut Plant| { base(p); p.pump.start_angle_rad = angle; for v in &mut p.vents { v.critical_ratio = b; v.follows_s = flapper; } p.pump.inlet.critical_ratio = b; p.pump.outlet.critical_ratio = b; })));
    }
    let only = std::env::args().nth(1);
    for (name, change) in variants {
        if only.as_ref().is_some_and(|o| !name.contains(o.as_str())) { continue; }
        let mut plant = Plant::paper();
        change(&mut plant);
        let t = trace(&plant, &u);
        let raw = rms(&start.from_pressures(&u, t[0]), &t);
        let (fit, dist) = refit(&start, &u, &t, 15);
        let th = trace(&plant, &held);
        let out = rms(&fit.from_pressures(&held, th[0]), &th);
        println!("{name}: raw {raw:.4?} refit {dist:.4?} held out {out:.4?}  shifts % {:?}", fit.p.iter().zip(TABLE_III).map(|(a, b)| (1000.0 * (a / b - 1.0)).round() / 10.0).collect::<Vec<_>>());
    }
}
