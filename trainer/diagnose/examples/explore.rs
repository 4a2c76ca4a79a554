//! Development: searches over one set of recordings and prints what it sees.
use std::time::Instant;

use diagnose::bench::Bench;
use diagnose::candidate::candidates;
use diagnose::evidence::Bar;
use diagnose::search::{SearchSettings, search};
use fit::data::Records;
use fit::simulate::Fidelity;
use model::rig::Rig;
use proto::recording::Recording;

fn main() {
    let files: Vec<String> = std::env::args().skip(1).collect();
    let rig = Rig::builtin("dual_pressure").unwrap();
    let recordings: Vec<Recording> = files.iter().map(|f| Recording::read(f.as_ref()).unwrap()).collect();
    let records = Records::new(&rig, &recordings).unwrap();
    let bench = Bench::new(&rig, &records, &vec![1.0; records.layout().len()], Fidelity::Coarse, None);
    println!("noise {:?}", bench.noise);
    let all = candidates(&rig);
    let settings = SearchSettings { most_terms: 3, glanced: 8, polished: 3, from_prior: false, bar: Bar::default() };
    let start = Instant::now();
    let found = search(&bench, &all, &settings, &mut |what, share| {
        eprintln!("{:.1} s {what} {:.0} %", start.elapsed().as_secs_f64(), 100.0 * share);
    })
    .unwrap();
    println!(
        "nominal rmse {:?} converged {} rounds {}",
        found.nominal.fitted.rmse_kpa, found.nominal.fitted.converged, found.nominal.fitted.rounds
    );
    for e in &found.nominal.fitted.estimates {
        println!("   {} {:.4} ± {:.4} shift {:.2} sd {:.3}", e.parameter.path, e.value, e.sd, e.shift, e.undetermined);
    }
    for round in &found.rounds {
        println!(
            "round on {:?} taken {} {:?}",
            round.base.iter().map(|t| all[*t].full_name()).collect::<Vec<_>>(),
            round.taken,
            round.evidence
        );
        for (k, gain) in round.ranked.iter().take(12) {
            println!("     {} {gain:.1}", all[*k].full_name());
        }
    }
    println!(
        "best {:?} rmse {:?}",
        found.best.terms.iter().map(|t| all[*t].full_name()).collect::<Vec<_>>(),
        found.best.fitted.rmse_kpa
    );
    for e in found.best.fitted.estimates.iter() {
        println!("   {} {:.4e} ± {:.4e} shift {:.2}", e.parameter.path, e.value, e.sd, e.shift);
    }
    println!("{:.1} s", start.elapsed().as_secs_f64());
}
