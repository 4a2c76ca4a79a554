//! Speed and precision of a rig's run: `cargo run --release -p hidden_rig --example speed`.

#![allow(clippy::print_stdout)] // printing is what an example is for

use std::time::Instant;

use hidden_rig::build_sheet::BuildSheet;
use hidden_rig::run::{Precision, Run};

fn main() {
    const SECONDS: u32 = 60;
    let rig = BuildSheet::paper().rig();
    println!("relative tolerance, s per {SECONDS} s of plant, steps, rejected, events, last pressures (kPa)");
    for relative in [1e-4, 3e-5, 1e-5, 1e-6, 1e-7, 1e-8] {
        let start = Instant::now();
        let mut run = Run::from_rest(&rig, [0.8, 0.8], Precision::Relative(relative));
        for k in 0..50 * SECONDS {
            let pos = if (k / 40) % 2 == 0 { 0.70 } else { 0.95 };
            let neg = if (k / 55) % 2 == 0 { 0.65 } else { 0.95 };
            run.tick([pos, neg], true);
        }
        let (effort, [pos, neg]) = (run.effort(), run.clean_kpa());
        let took = start.elapsed().as_secs_f64();
        println!(
            "{relative:.0e}  {took:.3}  {}  {}  {}  {pos:.4} {neg:.4}",
            effort.steps, effort.rejected, effort.events
        );
    }
}
