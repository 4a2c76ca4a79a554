//! `cargo bench -p sac --bench update`: updates per second beside the machine's bound, in the peers' format.
//!
//! On a busy machine trust the figure per second of own CPU time (one thread), and compare within one run only.

use std::time::Duration;

use sac::{Machine, fma_peak, synthetic_learner, update_speed};

const PASSES: usize = 3;

fn main() -> Result<(), sac::LearnerError> {
    for threads in [1, 2] {
        let machine = Machine::with_threads(threads);
        let mut learner = synthetic_learner(500_000, machine)?;
        for _ in 0..PASSES {
            let before = fma_peak(threads, Duration::from_millis(200));
            let speed = update_speed(&mut learner, 7, Duration::from_millis(400));
            let peak = before.max(fma_peak(threads, Duration::from_millis(200)));
            let set = machine.instruction_set();
            println!("peer=sac-{set:?} threads={threads} updates_per_s={:.1}", speed.updates_per_s);
            let [slowest, fastest] = speed.range;
            let own = speed.updates_per_own_s.map_or(String::new(), |own| format!("; {own:.1} per own CPU second"));
            println!(
                "# {slowest:.1} to {fastest:.1}{own}; bound {:.0} updates/s from {:.1} GFLOP/s, median at {:.0} %",
                speed.updates_per_s / speed.part_of(peak),
                peak / 1e9,
                100.0 * speed.part_of(peak)
            );
        }
    }
    Ok(())
}
