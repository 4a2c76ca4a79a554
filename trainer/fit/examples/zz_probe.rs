//! temporary
#![allow(clippy::unwrap_used, missing_docs)]
#[path = "../tests/made/mod.rs"]
mod made;
use fit::data::{Records, Role, Split};
use fit::least_squares::{Information, Loss, Problem};
use fit::objective::{FitSettings, RigProblem, blocks_of, fit_from};
use fit::parameters::{ParameterSet, Scatter, nominal};
use fit::simulate::{Arcs, Fidelity, Simulator, refined_starts};
use made::{made, quick_rig};
fn main() {
    let nr = quick_rig();
    let set = ParameterSet::new(&nr, nominal(&nr, Scatter::default())).unwrap();
    let pattern = [1.0, -1.2, 0.8, -0.6, 1.1, -0.9, 0.7, -1.0, 0.5, -0.8, 0.3, -0.4, 0.2, 0.6];
    let truth: Vec<f64> = pattern.to_vec();
    let tr = set.rig_at(&truth).unwrap();
    let records = Records::new(&nr, &[made(&tr, 2000, 1), made(&tr, 2000, 2)]).unwrap();
    let split = Split::of(&records);
    let w: Vec<f64> = split.weights(records.layout(), Role::Fit).iter().zip(split.weights(records.layout(), Role::Select)).map(|(a, b)| a + b).collect();
    let sim = Simulator::new(&records, Fidelity::Detailed);
    let sigma = (0.08f64.powi(2) + 0.03f64.powi(2) / 12.0).sqrt();
    let wk: Vec<f64> = w.iter().map(|w| w / sigma).collect();
    let loss = Loss::Student { freedom: 5.0 };
    let report = |name: &str, z: &[f64], f: Fidelity| {
        let s = sim.at(f);
        let arcs = refined_starts(&s, &set.rig_at(z).unwrap(), &Arcs::free(&records)).unwrap();
        let mut p = RigProblem::new(s, &set, arcs, wk.clone());
        let l = p.linearise(z).unwrap();
        let cost: f64 = l.residuals.iter().map(|r| loss.cost(*r)).sum::<f64>() + 0.5 * z.iter().map(|z| z * z).sum::<f64>();
        let info = Information::of(&l, loss, &set.prior(), &[]).unwrap();
        let n = z.len();
        let g = nalgebra::DVector::from_fn(n, |i, _| z[i] + l.jacobian[i].iter().zip(&l.residuals).map(|(j, r)| j * loss.weight(*r) * r).sum::<f64>());
        let dec = 0.5 * g.dot(&(info.covariance() * &g));
        let off = nalgebra::DVector::from_fn(n, |i, _| z[i] - truth[i]);
        let pr = info.covariance().clone().try_inverse().unwrap();
        println!("{name} {f:?}: cost {cost:.3} decrement {dec:.3} chi2 {:.2}", off.dot(&(pr * &off)));
        println!("   eig {:?}", info.directions().iter().map(|d| (d.information * 100.0).round() / 100.0).collect::<Vec<_>>());
    };
    for f in [Fidelity::Detailed, Fidelity::Averaged] { report("truth", &truth, f); }
    for (name, search, gain) in [("avg", Fidelity::Averaged, 0.05), ("det", Fidelity::Detailed, 0.001)] {
        let st = FitSettings { search, least_gain: gain, ..FitSettings::default() };
        let t = std::time::Instant::now();
        let fitted = fit_from(sim, &set, &set.origin(), &w, &[sigma, sigma], &blocks_of(&split, Role::Fit), &st).unwrap();
        println!("{name}: rounds {} conv {} cost {:.3} comp {:.3} scale {:?} t {:.1}", fitted.rounds, fitted.converged, fitted.cost, fitted.comparable_cost(&records, &w), fitted.scale_kpa, t.elapsed().as_secs_f64());
        println!("   z {:?}", fitted.point.iter().map(|z| (z * 100.0).round() / 100.0).collect::<Vec<_>>());
        println!("   sd {:?}", fitted.estimates.iter().map(|e| (e.undetermined * 100.0).round() / 100.0).collect::<Vec<_>>());
        report(name, &fitted.point, Fidelity::Detailed);
    }
}
