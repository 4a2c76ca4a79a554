//! Speed
use hidden_rig::{actuation::Actuation, build_sheet::BuildSheet, run::{Precision, Rig, Run}, sensor::Noise};
fn main() {
    let rig = BuildSheet::paper().rig();
    for precision in [1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 1e-8] {
        let start = std::time::Instant::now();
        let mut run = Run::from_rest(&rig, [0.8, 0.8], Precision::Relative(precision));
        let mut trace = Vec::new();
        for k in 0..1000 {
            let d = [if (k / 40) % 2 == 0 { 0.7 } else { 0.95 }, if (k / 55) % 2 == 0 { 0.65 } else { 0.95 }];
            run.tick(d, true);
            trace.push(run.clean_kpa());
        }
        println!("{precision:e}: {:.3} s per 60 s, {:?}, {:?} {:?}", 3.0 * start.elapsed().as_secs_f64(), run.effort(), trace[999], trace[500]);
    }
}
