//! Networks as a trainer makes them, and observations as a rig gives them.
// Each test file that has this module, here and in the `policy` crate, uses part of it.
#![allow(dead_code, unreachable_pub, missing_docs)]

use onnx_file::{Dense, FeatureTerm, GoldenPair, OutputMap, PolicyGraph, Ports, Provenance};

/// Numbers in -1..1 from a linear congruential generator; the tests need no better.
pub struct Draw(pub u32);

impl Draw {
    pub fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (self.0 >> 8) as f32 / 8_388_608.0 - 1.0
    }

    /// Torch's default for a linear layer, 1/√n uniform, times 1.7: answers then span most of their range.
    fn dense(&mut self, inputs: usize, outputs: usize) -> Dense {
        let scale = 1.7 / (inputs as f32).sqrt();
        let mut many = |count, scale: f32| (0..count).map(|_| scale * self.next()).collect();
        Dense { inputs, outputs, weights: many(inputs * outputs, scale), biases: many(outputs, 0.1) }
    }
}

/// A network for the ports: every observation scaled to -1..1, and for each pressure its change over a tick, of which
/// `sharpest_kpa` is scaled to 1.
pub fn network(ports: &Ports, hidden: &[usize], sharpest_kpa: f32, seed: u32) -> PolicyGraph {
    let mut draw = Draw(seed);
    let plain = ports.inputs.iter().enumerate().map(|(plus, port)| FeatureTerm {
        plus,
        minus: None,
        offset: 0.5 * (port.low + port.high),
        scale: 2.0 / (port.high - port.low),
    });
    let pressures = ports.inputs.iter().filter(|port| port.name.starts_with("p_")).count();
    let changes = (2..pressures).map(|plus| FeatureTerm {
        plus,
        minus: Some(plus - 2),
        offset: 0.01 * draw.next(),
        scale: 1.0 / sharpest_kpa,
    });
    let features: Vec<FeatureTerm> = plain.chain(changes.collect::<Vec<_>>()).collect();
    let mut widths = vec![features.len()];
    widths.extend(hidden);
    widths.push(ports.outputs.len());
    PolicyGraph {
        inputs: ports.inputs.len(),
        features,
        layers: widths.windows(2).map(|pair| draw.dense(pair[0], pair[1])).collect(),
        outputs: ports.outputs.iter().map(|port| OutputMap::onto(port.low, port.high)).collect(),
    }
}

/// An observation whose every value is drawn by itself from its range.
pub fn scattered(ports: &Ports, draw: &mut Draw) -> Vec<f32> {
    ports.inputs.iter().map(|p| 0.5 * (p.low + p.high) + 0.5 * (p.high - p.low) * draw.next()).collect()
}

/// An observation as a rig gives it: each quantity walks from tick to tick by a hundredth of its range.
pub fn walking(ports: &Ports, draw: &mut Draw) -> Vec<f32> {
    let mut values = scattered(ports, draw);
    for i in 2..values.len() {
        let quantity = |i: usize| ports.inputs[i].name.split('[').next();
        let (low, high) = (ports.inputs[i].low, ports.inputs[i].high);
        if quantity(i) == quantity(i - 2) {
            values[i] = (values[i - 2] + 0.01 * (high - low) * draw.next()).clamp(low, high);
        }
    }
    values
}

pub fn provenance() -> Provenance {
    Provenance {
        rig: "bench".into(),
        rig_hash: "0123456789abcdef".into(),
        seed: 7,
        steps: 512_000,
        variant: "both".into(),
        preset: "paper".into(),
        trainer: "0.1.0".into(),
        more: vec![("commit".into(), "b9ce2cb".into())],
    }
}

/// Golden pairs as the network itself answers in f64.
pub fn golden(graph: &PolicyGraph, ports: &Ports, count: usize) -> Vec<GoldenPair> {
    let mut draw = Draw(77);
    let inputs = (0..count).map(|_| walking(ports, &mut draw));
    inputs.map(|input| GoldenPair { output: graph.run(&input).unwrap(), input }).collect()
}
