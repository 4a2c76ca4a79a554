//! Distance of hidden rigs from the paper's model once its thirteen parameters are refitted.
//!
//! `cargo run --release -p hidden_rig --example distance -- OUT/truth/case_000.json …` refits the paper's equations (as
//! they stand in this crate's tests, not in the model) to the first 40 s of a case's first recording without noise, and
//! lets them run freely over 40 s of its last. Nulls should end below the noise; concealed effects should not.

#![allow(clippy::print_stdout, clippy::unwrap_used)] // an example prints, and stops where it cannot go on

#[path = "../tests/paper/mod.rs"]
mod paper;

use std::path::Path;

use hidden_rig::recording::{Recording, read_commands};
use hidden_rig::sizing::Trace;
use hidden_rig::truth::Truth;
use paper::{NAMES, Paper, TABLE_III, refit, rms};

/// Rows that are fitted, and rows that are held out.
const ROWS: usize = 2000;

fn main() {
    for file in std::env::args().skip(1) {
        let file = Path::new(&file);
        let truth = Truth::read(file).unwrap();
        let cases = file.parent().unwrap().parent().unwrap().join("cases").join(&truth.case);
        // Run again rather than read: the traces of the truth are those of these very commands.
        let clean = |name: &str| -> (Trace, Trace) {
            let commands = read_commands(&cases.join(name)).unwrap();
            let commands = &commands[..ROWS.min(commands.len())];
            let recording: Recording = truth.experiment(commands);
            (commands.iter().map(|command| command.duty).collect(), recording.clean_kpa())
        };
        let (fitted, held_out) = (clean("rec_a.csv"), clean("rec_c.csv"));
        let (model, distance) = refit(&Paper { p: TABLE_III, angle: 0.0 }, &fitted.0, &fitted.1, 12);
        let free = rms(&model.run_from_pressures(&held_out.0, held_out.1[0]), &held_out.1);
        let noise = truth.build.noise.sigma_pa().map(|pa| 1e-3 * pa);
        println!(
            "{} {:?}: fitted {distance:.4?}, held out {free:.4?}, noise {noise:.3?} kPa{}",
            truth.case,
            truth.class,
            if truth.ripple_beats { ", ripple beats" } else { "" }
        );
        let moved: Vec<String> = NAMES
            .iter()
            .zip(model.p.iter().zip(TABLE_III))
            .map(|(name, (p, table))| format!("{name} {:+.1} %", 100.0 * (p / table - 1.0)))
            .collect();
        println!("    {}", moved.join(", "));
    }
}
