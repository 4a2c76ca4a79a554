//! Policies that must not fly and policies that may, made here from a few numbers and from what was trained.
//!
//! Controllers are written as networks of one layer: a gain on chosen features and an offset, through a tanh. Layout 1
//! answers duties, layout 2 corrections of the fallback.
// Each test file compiles this module for itself and uses part of it.
#![allow(dead_code, unreachable_pub, missing_docs, clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::path::{Path, PathBuf};

use model::observation::ObservationLayout::{self, Correction, Paper};
use onnx_file::{Dense, FeatureTerm, GoldenPair, OutputMap, PolicyGraph, Ports, Provenance, from_onnx, to_onnx};
use proto::split_mix::SplitMix64;

/// Places in the observation: pressures and references of the present tick, positive and negative; ten ticks ago.
pub const NOW: [usize; 2] = [20, 21];
pub const BEFORE: [usize; 2] = [18, 19];
pub const LONG_AGO: [usize; 2] = [0, 1];
pub const GOAL: [usize; 2] = [52, 53];

/// One valve's share of a controller: `tanh(offset + gain (x[plus] − x[minus]))`, mapped to the range.
#[derive(Clone, Copy)]
pub struct Gain {
    pub plus: usize,
    pub minus: Option<usize>,
    pub per_kpa: f32,
    pub offset: f32,
}

/// A controller of both valves, the same now and in its plan, mapped onto `low` … `high`.
pub fn controller(layout: ObservationLayout, gains: [Gain; 2], low: f32, high: f32) -> PolicyGraph {
    let ports = Ports::of(layout);
    let features =
        gains.iter().map(|g| FeatureTerm { plus: g.plus, minus: g.minus, offset: 0.0, scale: 1.0 }).collect::<Vec<_>>();
    let mut weights = vec![0.0; 2 * 12];
    for output in 0..12 {
        weights[(output % 2) * 12 + output] = gains[output % 2].per_kpa;
    }
    let biases = (0..12).map(|output| gains[output % 2].offset).collect();
    PolicyGraph {
        inputs: ports.inputs.len(),
        features,
        layers: vec![Dense { inputs: 2, outputs: 12, weights, biases }],
        outputs: vec![OutputMap::onto(low, high); 12],
    }
}

/// Proportional action on the error, in duty per kPa: positive is the right way round for the positive valve, and the
/// same sign is turned for the negative one. `base` is the duty at no error.
pub fn proportional(layout: ObservationLayout, gain: [f32; 2], base: [f32; 2]) -> PolicyGraph {
    let (low, high) = range(layout);
    let half = 0.5 * (high - low);
    let of = |c: usize| Gain {
        plus: NOW[c],
        minus: Some(GOAL[c]),
        per_kpa: gain[c] / half,
        offset: (((base[c] - low) / half - 1.0).clamp(-0.999, 0.999)).atanh(),
    };
    controller(layout, [of(0), of(1)], low, high)
}

pub fn range(layout: ObservationLayout) -> (f32, f32) {
    match layout {
        Paper => (0.0, 1.0),
        Correction => (-0.25, 0.25),
    }
}

/// Always the same answer.
pub fn constant(layout: ObservationLayout, answer: [f32; 2]) -> PolicyGraph {
    proportional(layout, [0.0; 2], answer)
}

/// The bytes of a network with a golden pair of its own.
pub fn export(layout: ObservationLayout, graph: &PolicyGraph) -> Vec<u8> {
    let ports = Ports::of(layout);
    let input: Vec<f32> = ports.inputs.iter().map(|p| p.low + 0.45 * (p.high - p.low)).collect();
    let golden = [GoldenPair { output: graph.run(&input).unwrap(), input }];
    let provenance = Provenance { rig: "dual_pressure".into(), trainer: "0.1.0".into(), ..Provenance::default() };
    to_onnx(graph, &ports, &provenance, &golden).unwrap()
}

pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().find(|p| p.join("Cargo.lock").is_file()).unwrap().to_owned()
}

/// The policy that ships.
pub fn shipped() -> Vec<u8> {
    std::fs::read(root().join("controller/policies/default.onnx")).unwrap()
}

/// The layout and the network of a file that the trainer wrote.
pub fn network(bytes: &[u8]) -> (ObservationLayout, PolicyGraph) {
    let exported = from_onnx(bytes).unwrap();
    let layout = if exported.metadata["contract"] == "1" { Paper } else { Correction };
    (layout, exported.graph)
}

/// Policies that the trainer left in `docs/runs`, by name.
pub fn trained() -> Vec<(String, Vec<u8>)> {
    let mut all = vec![("default".to_owned(), shipped())];
    for entry in std::fs::read_dir(root().join("docs/runs")).unwrap().flatten() {
        if let Ok(bytes) = std::fs::read(entry.path().join("policy.onnx")) {
            all.push((entry.file_name().to_string_lossy().into_owned(), bytes));
        }
    }
    all.sort();
    all
}

/// A draw of mean 0 and standard deviation 1: the sum of twelve uniform ones.
fn normal(draw: &mut SplitMix64) -> f64 {
    (0..12).map(|_| draw.unit()).sum::<f64>() - 6.0
}

/// A network with every weight and bias off by so many percent (standard deviation).
pub fn perturbed(graph: &PolicyGraph, percent: f64, seed: u64) -> PolicyGraph {
    let mut draw = SplitMix64::new(seed);
    let mut changed = graph.clone();
    for layer in &mut changed.layers {
        for value in layer.weights.iter_mut().chain(&mut layer.biases) {
            *value *= (1.0 + 0.01 * percent * normal(&mut draw)) as f32;
        }
    }
    changed
}

/// Well-formed files that must not fly, by name.
pub fn bad_networks() -> Vec<(String, Vec<u8>)> {
    let mut all: Vec<(String, Vec<u8>)> = Vec::new();
    let mut add = |name: &str, layout, graph: PolicyGraph| all.push((name.to_owned(), export(layout, &graph)));
    for (name, answer) in
        [("always_0", [0.0, 0.0]), ("always_1", [1.0, 1.0]), ("always_half", [0.5, 0.5]), ("shut_and_open", [0.0, 1.0])]
    {
        add(name, Paper, constant(Paper, answer));
    }
    for (name, answer) in
        [("correct_shut", [-0.25, -0.25]), ("correct_open", [0.25, 0.25]), ("correct_nothing", [0.0, 0.0])]
    {
        add(name, Correction, constant(Correction, answer));
    }
    let base = [0.86, 0.86];
    // Opening the positive valve lowers its pressure, opening the negative one raises it: + on p − ref, − on it.
    for (name, gain) in [
        ("wrong_sign", [-0.03, 0.03]),
        ("wrong_sign_weak", [-0.01, 0.01]),
        ("wrong_sign_positive", [-0.03, -0.03]),
        ("wrong_sign_negative", [0.03, 0.03]),
        ("bang_bang", [100.0, -100.0]),
        ("bang_bang_wrong", [-100.0, 100.0]),
        ("hot", [0.6, -0.6]),
        ("hotter", [2.0, -2.0]),
        ("deaf_negative", [0.03, 0.0]),
    ] {
        add(name, Paper, proportional(Paper, gain, base));
    }
    for (name, gain) in [
        ("correct_wrong_sign", [-0.1, 0.1]),
        ("correct_bang_bang", [100.0, -100.0]),
        ("correct_hot", [0.4, -0.4]),
        ("correct_hotter", [1.5, -1.5]),
        ("correct_wrong_hot", [-0.4, 0.4]),
    ] {
        add(name, Correction, proportional(Correction, gain, [0.0, 0.0]));
    }
    // The other channel's error, what was ten ticks ago, the change from tick to tick.
    let gains = |plus: [usize; 2], minus: [usize; 2], per_kpa: [f32; 2], offset: f32| {
        [0, 1].map(|c: usize| Gain { plus: plus[c], minus: Some(minus[c]), per_kpa: per_kpa[c], offset })
    };
    let crossed = gains([NOW[1], NOW[0]], [GOAL[1], GOAL[0]], [0.1, -0.1], 0.9);
    add("crossed", Paper, controller(Paper, crossed, 0.0, 1.0));
    let late = gains(LONG_AGO, GOAL, [0.15, -0.15], 0.9);
    add("late", Paper, controller(Paper, late, 0.0, 1.0));
    let noise = gains(NOW, BEFORE, [5.0, -5.0], 0.9);
    add("noise", Paper, controller(Paper, noise, 0.0, 1.0));
    add("noise_correction", Correction, controller(Correction, gains(NOW, BEFORE, [8.0, -8.0], 0.0), -0.25, 0.25));
    // Trained for something else: the weights of the shipped one scattered, its answers turned round, its inputs shifted.
    let (layout, graph) = network(&shipped());
    for (percent, seed) in [(200.0, 2), (400.0, 3)] {
        add(&format!("scattered_{percent}"), layout, perturbed(&graph, percent, seed));
    }
    let mut loud = graph.clone();
    loud.outputs = vec![OutputMap::onto(-0.25, 0.25); 12];
    loud.layers.last_mut().unwrap().weights.iter_mut().for_each(|w| *w *= 20.0);
    add("loud", layout, loud.clone());
    loud.layers.last_mut().unwrap().weights.iter_mut().for_each(|w| *w = -*w);
    add("loud_turned", layout, loud);
    // Sound where it is looked at, shut where the pressure is high: features clipped by tanh cannot do it, two layers can.
    add("trap_above_100", Paper, trap(100.0));
    add("trap_above_95", Paper, trap(95.0));
    all
}

/// A proportional controller that shuts the positive vent as soon as the pressure is above `kpa`.
pub fn trap(kpa: f32) -> PolicyGraph {
    let sound = proportional(Paper, [0.02, -0.02], [0.86, 0.86]);
    let inputs = sound.inputs;
    let feature = |plus: usize, minus: Option<usize>, offset: f32| FeatureTerm { plus, minus, offset, scale: 1.0 };
    let features =
        vec![feature(NOW[0], Some(GOAL[0]), 0.0), feature(NOW[1], Some(GOAL[1]), 0.0), feature(NOW[0], None, kpa)];
    // Hidden: both signs of both errors, and the trap.
    let mut first = vec![0.0; 3 * 5];
    for (feature, unit, weight) in [(0, 0, 1.0), (0, 1, -1.0), (1, 2, 1.0), (1, 3, -1.0), (2, 4, 1.0)] {
        first[feature * 5 + unit] = weight;
    }
    let mut second = vec![0.0; 5 * 12];
    for output in 0..12 {
        let (up, down) = if output % 2 == 0 { (0, 1) } else { (2, 3) };
        let gain = if output % 2 == 0 { 0.04 } else { -0.04 };
        second[up * 12 + output] = gain;
        second[down * 12 + output] = -gain;
        if output % 2 == 0 {
            second[4 * 12 + output] = -10.0;
        }
    }
    PolicyGraph {
        inputs,
        features,
        layers: vec![
            Dense { inputs: 3, outputs: 5, weights: first, biases: vec![0.0; 5] },
            Dense { inputs: 5, outputs: 12, weights: second, biases: vec![0.9; 12] },
        ],
        outputs: vec![OutputMap::onto(0.0, 1.0); 12],
    }
}

/// Files that are no sound policy at all, by name; made from the shipped one.
pub fn bad_files() -> Vec<(String, Vec<u8>)> {
    let (layout, graph) = network(&shipped());
    let sealed = export(layout, &graph);
    let mut all: Vec<(String, Vec<u8>)> = Vec::new();
    for percent in [1, 5, 25, 50, 75, 90, 99] {
        all.push((format!("cut_{percent}"), sealed[..sealed.len() * percent / 100].to_vec()));
    }
    all.push(("cut_last".into(), sealed[..sealed.len() - 1].to_vec()));
    all.push(("empty".into(), Vec::new()));
    all.push(("text".into(), b"time_s,ref_pos_kpa,ref_neg_kpa\n0,80,-70\n".to_vec()));
    all.push(("zip".into(), b"PK\x03\x04 and so on".to_vec()));
    all.push(("zeros".into(), vec![0; 4096]));
    let mut noise = SplitMix64::new(3);
    all.push(("random".into(), (0..5000).map(|_| (256.0 * noise.unit()) as u8).collect()));
    let mut draw = SplitMix64::new(17);
    for flip in 0..12 {
        let mut bytes = sealed.clone();
        let at = (draw.unit() * bytes.len() as f64) as usize;
        bytes[at] ^= 1 << (flip % 8);
        all.push((format!("flipped_{flip}"), bytes));
    }
    for (name, value) in [("nan", f32::NAN), ("infinite", f32::INFINITY)] {
        // The first weight of the last layer, found by its bytes.
        let old = graph.layers[0].weights[7].to_le_bytes();
        let at = sealed.windows(4).position(|w| w == old).unwrap();
        let mut bytes = sealed.clone();
        bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
        all.push((name.into(), bytes));
    }
    let ports = |change: &dyn Fn(&mut Ports)| {
        let mut ports = Ports::of(layout);
        change(&mut ports);
        to_onnx(&graph, &ports, &Provenance::default(), &[]).unwrap()
    };
    all.push(("contract_3".into(), ports(&|p| p.contract = 3)));
    all.push(("contract_1".into(), ports(&|p| p.contract = 1)));
    all.push(("rate_100".into(), ports(&|p| p.rate_hz = 100.0)));
    all.push(("channels_swapped".into(), ports(&|p| p.inputs.swap(0, 1))));
    all.push(("pascal".into(), ports(&|p| p.inputs.iter_mut().for_each(|i| i.unit = "Pa"))));
    all
}
