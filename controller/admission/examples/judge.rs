//! Takes policies through all stages and prints what each figure is: for tuning rules, and for a policy that is refused.
//!
//! `cargo run --release -p admission --example judge -- RIG FILE…`

use std::path::Path;

use admission::{Examiner, Limits, SignatureRule, signatures};
use policy::Links;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let rig = proto::rig_file::load(&arguments.next().ok_or("give a rig and policies")?)?;
    let started = std::time::Instant::now();
    let limits = Limits { max_pos_kpa: 160.0, min_neg_kpa: -95.0 };
    let examiner = Examiner::new(signatures::offered().into(), SignatureRule::None, &rig, limits)?;
    println!("laid out in {:.2} s", started.elapsed().as_secs_f64());
    for (rig, tally) in examiner.fallback().iter().enumerate() {
        println!("fallback on rig {rig}: {tally:.3?}");
    }
    for file in arguments {
        let started = std::time::Instant::now();
        let outcome = examiner.examine(Path::new(&file), Links::Follow, examiner.fallback());
        let seconds = started.elapsed().as_secs_f64();
        match outcome {
            Ok(admitted) => println!(
                "{file}: PASSED in {seconds:.2} s, {:.1} µs\n  {:.3?}\n  {:.3?}",
                admitted.inference_us, admitted.figures, admitted.answers
            ),
            Err(refusal) => println!("{file}: {refusal} ({seconds:.2} s)\n  {:.3?}", refusal.figures),
        }
    }
    Ok(())
}
