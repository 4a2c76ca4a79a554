//! Development: searches over one set of recordings and prints what it sees.

#![allow(clippy::unwrap_used)] // A development tool: what fails here is looked at.

use std::time::Instant;

use diagnose::bench::Bench;
use diagnose::search::candidate::candidates;
use diagnose::search::{SearchSettings, search};
use fit::data::Records;
use fit::simulate::Fidelity;
use model::rig::Rig;
use proto::recording::Recording;

fn cpu() -> f64 {
    let s = std::fs::read_to_string("/proc/self/stat").unwrap();
    let f: Vec<&str> = s.rsplit(')').next().unwrap().split_whitespace().collect();
    (f[11].parse::<f64>().unwrap() + f[12].parse::<f64>().unwrap()) / 100.0
}

fn main() {
    let files: Vec<String> = std::env::args().skip(1).collect();
    let rig = Rig::builtin("dual_pressure").unwrap();
    let recordings: Vec<Recording> = files.iter().map(|f| Recording::read(f.as_ref()).unwrap()).collect();
    let records = Records::new(&rig, &recordings).unwrap();
    let bench = Bench::new(&rig, &records, &vec![1.0; records.layout().len()], Fidelity::Coarse);
    println!("noise {:?}", bench.noise);
    let all = candidates(&rig);
    let quick = std::env::var("QUICK").is_ok();
    let settings = if quick { SearchSettings::short(false) } else { SearchSettings::whole(false) };
    let start = Instant::now();
    let mut last = String::new();
    let found = search(&bench, &all, &vec![0.0; bench.nominal.len()], &settings, &mut |what, _| {
        if last != what {
            eprintln!("{:.1} s, cpu {:.1} s {what}", start.elapsed().as_secs_f64(), cpu());
            last = what.to_owned();
        }
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
        for ranked in round.ranked.iter().take(16) {
            println!("     {} {:.1}", all[ranked.candidate].full_name(), ranked.gain);
        }
    }
    for e in &found.tried {
        let ev = diagnose::judge::evidence::evidence(&bench, e, &found.nominal);
        println!(
            "tried {:?} cost {:.1} rmse {:?} excess {:?} fitted {:.1} chosen {:.1}",
            e.terms.iter().map(|t| all[*t].full_name()).collect::<Vec<_>>(),
            diagnose::search::cost(&bench, e),
            e.fitted.rmse_kpa,
            diagnose::judge::excess(&bench, &e.trace),
            ev.fitted,
            ev.chosen
        );
    }
    println!(
        "best {:?} rmse {:?}",
        found.best.terms.iter().map(|t| all[*t].full_name()).collect::<Vec<_>>(),
        found.best.fitted.rmse_kpa
    );
    for e in found.best.fitted.estimates.iter() {
        println!("   {} {:.4e} ± {:.4e} shift {:.2}", e.parameter.path, e.value, e.sd, e.shift);
    }
    println!("{:.1} s cpu {:.1} s", start.elapsed().as_secs_f64(), cpu());
}
