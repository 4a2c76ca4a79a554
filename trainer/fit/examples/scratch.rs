#![allow(clippy::unwrap_used, missing_docs)]
use std::time::Instant;
use fit::data::*; use fit::objective::*; use fit::parameters::*; use fit::simulate::*;
use model::rig::Rig; use proto::recording::Recording;
fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let rig = Rig::builtin("dual_pressure").unwrap();
    let recs: Vec<Recording> = args.iter().map(|p| Recording::read(p.as_ref()).unwrap()).collect();
    let records = Records::new(&rig, &recs).unwrap();
    let noise = noise(&records);
    println!("{noise:?}");
    let split = Split::of(&records);
    let weights = split.weights(records.layout(), Role::Fit);
    let held = split.weights(records.layout(), Role::HeldOut);
    let set = ParameterSet::new(&rig, nominal(&rig, Scatter::default())).unwrap();
    let sim = Simulator::new(&records, if std::env::var("COARSE").is_ok() { Fidelity::Coarse } else { Fidelity::Detailed }).on(1);
    let t = Instant::now();
    println!("nominal held {:?} {:?}", errors_at(&sim, &rig, Horizon::Free, &held).unwrap(), t.elapsed());
    let sigma: Vec<f64> = noise.iter().map(|n| n.sigma_kpa).collect();
    let t = Instant::now();
    let f = fit_from(sim, &set, &set.origin(), &weights, &sigma, &blocks_of(&split, Role::Fit), &FitSettings::default()).unwrap();
    println!("fit {:?} rounds {} converged {} cost {} scale {:?} rmse {:?}", t.elapsed(), f.rounds, f.converged, f.cost, f.scale_kpa, f.rmse_kpa);
    for e in &f.estimates { println!("{:45} {:10.5} ± {:8.5} {:6} shift {:6.2} undet {:.3}", e.parameter.path, e.value, e.sd, e.parameter.unit(), e.shift, e.undetermined); }
    let sim = sim.at(Fidelity::Detailed);
    for h in [Horizon::Free, Horizon::Windows{seconds:10.0}, Horizon::Windows{seconds:1.0}] {
        println!("{h:?} held {:?}", errors_at(&sim, &f.rig, h, &held).unwrap());
    }
    let tr = trace_at(&sim, &f.rig, Horizon::Free).unwrap();
    let mut out = String::new();
    for (r, c, range) in records.layout().all() { for (row, i) in range.enumerate() { out.push_str(&format!("{r},{c},{row},{},{}\n", records.readings_kpa()[i], tr[i])); } }
    std::fs::write("/tmp/fitws/trace.csv", out).unwrap();
}
