//! Development: `diagnose [--quick] OUT RECORDING…` on the paper's rig.
use std::time::Instant;

use diagnose::{Request, run};
use model::rig::Rig;
use proto::recording::Recording;

fn main() {
    let mut args: Vec<String> = std::env::args().skip(1).collect();
    let quick = args.iter().position(|a| a == "--quick").map(|at| args.remove(at)).is_some();
    let out_dir = args.remove(0).into();
    let recordings: Vec<Recording> = args.iter().map(|f| Recording::read(f.as_ref()).unwrap()).collect();
    let request = Request { rig: Rig::builtin("dual_pressure").unwrap(), recordings, out_dir, quick, threads: None };
    let start = Instant::now();
    let mut last = String::new();
    let outcome = run(&request, &mut |what, share| {
        if last != what {
            eprintln!("{:6.1} s  {what} {:.0} %", start.elapsed().as_secs_f64(), 100.0 * share);
            last = what.to_owned();
        }
    });
    match outcome {
        Ok(diagnosis) => println!("{}{:.1} s", diagnosis.to_json().unwrap(), start.elapsed().as_secs_f64()),
        Err(error) => eprintln!("{error}"),
    }
}
