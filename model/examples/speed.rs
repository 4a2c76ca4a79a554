//! scratch
use model::plant::*;
use model::real::*;
use model::rig::*;
use std::sync::Arc;
use std::time::Instant;
fn go<R: Real>(name: &str, rig: &Rig, n: usize, set: InstructionSet) {
    let plant = Arc::new(Plant::<R>::side_by_side(std::slice::from_ref(rig)).unwrap());
    let mut s = Simulation::on(plant, set);
    let t = Instant::now();
    for k in 0..n {
        s.tick(&[
            R::splat(0.85 + 0.1 * (((k / 50) % 3) as f64 - 1.0)),
            R::splat(0.82 + 0.08 * (((k / 70) % 3) as f64 - 1.0)),
            R::splat(1.0),
        ]);
    }
    println!(
        "{name} {set:?} {:.0} ticks/s  {:.4} {:.4}",
        (n * R::LANES) as f64 / t.elapsed().as_secs_f64(),
        s.pressure_kpa(0).lane(0),
        s.pressure_kpa(1).lane(0)
    );
}
fn main() {
    for name in Rig::BUILTIN {
        let rig = Rig::builtin(name).unwrap();
        for set in [InstructionSet::Avx2] {
            go::<f64>(name, &rig, 5000, set);
            go::<Lanes<8>>(name, &rig, 2000, set);
        }
    }
}
