//! A thousand bad policies and a hundred better ones, drawn at random, from the stages before the rig to full authority.
//!
//! `cargo run --release --example thousand -- 1000 100`
//!
//! Incumbent is the fallback on `bench` (averaged pumps, the paper's reference, the converter's noise); the trial is laid
//! out around `dual_pressure`. Drawn to be bad: gains of the wrong sign or far too high, networks of random weights, the shipped
//! one with its weights scattered. What of these comes to full authority flies another two minutes by itself, beside the fallback with
//! the same noise: its error as a multiple of the fallback's says how bad it is. Better: the shipped one with its weights off by up to
//! 3 %, which halves the negative error.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

#[path = "../../admission/tests/corpus/mod.rs"]
mod corpus;
#[path = "../tests/loop_on_bench/mod.rs"]
mod loop_on_bench;

use std::collections::BTreeMap;

use admission::{Examiner, Limits, SignatureRule, signatures};
use corpus::{export, network, perturbed, proportional, shipped};
use handover::{Candidate, Command, Haste, PolicyEvent};
use loop_on_bench::{ENVELOPE, Loop, policy};
use model::observation::ObservationLayout::{Correction, Paper};
use model::observation::Pair;
use model::rig::Rig;
use proto::reference::Reference;
use proto::split_mix::SplitMix64;

/// Errors over the fallback's: as good, for the noise of one flight; and what the ramp's test is built to refuse.
const BADNESS: [f64; 2] = [1.1, 1.5];
/// Ten minutes.
const MOST_TICKS: u32 = 30_000;

/// A bad policy: what it is, and its file.
fn bad(number: u64) -> (&'static str, Vec<u8>) {
    let mut draw = SplitMix64::new(number);
    let signed = |draw: &mut SplitMix64| 2.0 * draw.unit() as f32 - 1.0;
    match number % 5 {
        0 => {
            let gain = 0.3 + 3.0 * draw.unit() as f32;
            let base = [0.6 + 0.4 * draw.unit() as f32, 0.6 + 0.4 * draw.unit() as f32];
            ("hot, duties", export(Paper, &proportional(Paper, [gain, -gain], base)))
        }
        1 => {
            // At least one of the two signs is wrong.
            let gain = [-0.2 * draw.unit() as f32 - 0.005, if draw.unit() < 0.5 { -0.03 } else { 0.03 }];
            ("wrong sign, duties", export(Paper, &proportional(Paper, gain, [0.86, 0.86])))
        }
        2 => {
            let gain = [-0.3 * draw.unit() as f32 - 0.05, 0.3 * draw.unit() as f32 + 0.05];
            ("wrong sign, corrections", export(Correction, &proportional(Correction, gain, [0.0; 2])))
        }
        3 => {
            let (layout, graph) = network(&shipped());
            ("scattered weights", export(layout, &perturbed(&graph, 60.0 + 300.0 * draw.unit(), number)))
        }
        _ => {
            let (layout, mut graph) = network(&shipped());
            for layer in &mut graph.layers {
                let scale = 2.0 / (layer.inputs as f32).sqrt();
                layer.weights.iter_mut().for_each(|w| *w = scale * signed(&mut draw));
            }
            graph.outputs = vec![onnx_file::OutputMap::onto(-0.25, 0.25); 12];
            ("random weights", export(layout, &graph))
        }
    }
}

/// RMSE of two minutes in kPa, without the first ten seconds.
fn alone(active: Option<policy::Policy>, seed: u64) -> Pair {
    let mut run = Loop::new(active, Reference::paper(), seed);
    run.ticks(6_000);
    let counted = &run.errors[500..];
    std::array::from_fn(|c| (counted.iter().map(|e| e[c].powi(2)).sum::<f64>() / counted.len() as f64).sqrt())
}

/// Error as a multiple of the fallback's, on the worse channel.
fn excess(bytes: &[u8], seed: u64) -> f64 {
    let (own, fallback) = (alone(Some(policy(bytes)), seed), alone(None, seed));
    (own[0] / fallback[0]).max(own[1] / fallback[1])
}

/// Fate of a policy: refused before the rig at a stage, lost on it with the most authority it had, or active.
fn fate(examiner: &Examiner, bytes: &[u8], seed: u64) -> (String, f64, u32) {
    if let Err(refusal) = examiner.examine_bytes("drawn".into(), bytes, examiner.fallback()) {
        return (format!("refused: {}", refusal.stage.name()), 0.0, 0);
    }
    let mut run = Loop::new(None, Reference::paper(), seed);
    run.ticks(300);
    assert!(run.store.ask(Command::Try(Candidate::new(policy(bytes)), Haste::Proving)).is_ok());
    let mut most = 0.0_f64;
    let done = run.until(MOST_TICKS, |run| {
        most = most.max(run.snapshot().authority);
        matches!(run.events.last(), Some((_, PolicyEvent::Lost(..) | PolicyEvent::Active(_))))
    });
    assert!(run.farthest[0] <= ENVELOPE.max_pos_kpa + 0.3 && run.farthest[1] >= ENVELOPE.min_neg_kpa - 0.03);
    let ticks = run.errors.len() as u32;
    match run.events.last() {
        Some((_, PolicyEvent::Active(_))) if done => ("active".to_owned(), most, ticks),
        Some((_, PolicyEvent::Lost(_, _, loss))) if done => (format!("lost: {loss:?}"), most, ticks),
        _ => ("undecided after ten minutes".to_owned(), most, ticks),
    }
}

fn main() {
    let mut arguments = std::env::args().skip(1).map(|a| a.parse::<u64>().expect("a number"));
    let (bads, betters) = (arguments.next().unwrap_or(100), arguments.next().unwrap_or(10));
    let model = Rig::builtin("dual_pressure").unwrap();
    let limits = Limits { max_pos_kpa: ENVELOPE.max_pos_kpa, min_neg_kpa: ENVELOPE.min_neg_kpa };
    let examiner = Examiner::new(signatures::offered().into(), SignatureRule::None, &model, limits).unwrap();
    let mut counts: BTreeMap<(String, String), (u32, f64)> = BTreeMap::new();
    let (mut reached, mut slowest) = ([0; BADNESS.len() + 1], 0);
    for number in 0..bads {
        let (kind, bytes) = bad(number);
        let (mut fate, most, _) = fate(&examiner, &bytes, number);
        if fate == "active" {
            let excess = excess(&bytes, number);
            let class = BADNESS.iter().position(|limit| excess < *limit).unwrap_or(BADNESS.len());
            reached[class] += 1;
            fate = format!("active, {excess:.1} times the fallback");
        }
        let entry = counts.entry((kind.to_owned(), fate)).or_default();
        *entry = (entry.0 + 1, entry.1.max(most));
    }
    let (layout, graph) = network(&shipped());
    let mut arrived = 0;
    for number in 0..betters {
        let bytes = export(layout, &perturbed(&graph, 3.0 * SplitMix64::new(number).unit(), 5_000 + number));
        let (fate, most, ticks) = fate(&examiner, &bytes, 7_000 + number);
        if fate == "active" {
            arrived += 1;
            slowest = slowest.max(ticks);
        }
        let entry = counts.entry(("better".to_owned(), fate)).or_default();
        *entry = (entry.0 + 1, entry.1.max(most));
    }
    for ((kind, fate), (count, most)) in counts {
        println!("{kind:26} {fate:34} {count:5}   at most {:3.0} % of the command", 100.0 * most);
    }
    println!(
        "of {bads} drawn to be bad reached full authority, by their error over the fallback's: {} below {}, {} below {}, {} beyond; better: {arrived} of {betters}, the slowest after {slowest} ticks",
        reached[0], BADNESS[0], reached[1], BADNESS[1], reached[2]
    );
}
