//! Time of one inference and of one load: `cargo bench -p policy`.
//!
//! p50, p99.9 and maximum over 200,000 runs of 84-256-256-12, each timed by itself (the clock's own
//! cost, about 25 ns, is included), then the same at 50 Hz pacing, where caches have gone cold, and the
//! cost of an activation in multiply-adds, which the load-time limit on operations uses.
#![allow(missing_docs, clippy::unwrap_used, clippy::panic)]

#[path = "../tests/onnx/mod.rs"]
mod onnx;

use std::time::{Duration, Instant};

use onnx::{Draw, Mlp, observation, paper};
use policy::{Policy, PolicySignature};

fn main() {
    let net = Mlp::new(&[84, 256, 256, 12], 1);
    for (hidden, last) in [("Relu", "Sigmoid"), ("Tanh", "Sigmoid")] {
        let bytes = net.torch(hidden, last).bytes();
        let start = Instant::now();
        let mut policy = Policy::from_bytes("bench".into(), &bytes, &paper()).unwrap();
        let load = start.elapsed();
        println!("{} ({} bytes): loaded and checked in {load:.1?}", policy.layers(), bytes.len());
        report("back to back", timed(&mut policy, 200_000, Duration::ZERO));
        report("20 ms apart", timed(&mut policy, 250, Duration::from_millis(20)));
    }
    wide("1024-1024", &[84, 1024, 1024, 12]);
    activations();
}

fn wide(name: &str, sizes: &[usize]) {
    let onnx = Mlp::new(sizes, 2).torch("Relu", "Sigmoid");
    let mut policy = Policy::from_bytes(name.into(), &onnx.bytes(), &paper()).unwrap();
    report(name, timed(&mut policy, 20_000, Duration::ZERO));
}

/// Two networks that differ by twenty activation layers of 256 values.
fn activations() {
    const LAYERS: usize = 20;
    let contract = [PolicySignature::pressures_to_duties(1, 256, 256)];
    let median = |op: Option<&str>| {
        let mut onnx = Mlp::new(&[256, 256], 3).torch("Relu", "Sigmoid");
        let mut value = "scaled".to_owned();
        let nodes = onnx.graph().node.len();
        for layer in 0..LAYERS {
            let Some(op) = op else { break };
            let next = format!("a{layer}");
            onnx.node(op, &[&value], &next, vec![]);
            value = next;
        }
        // Between the normalisation (two nodes) and the layer.
        onnx.graph().node[2..].rotate_left(nodes - 2);
        onnx::node_of(&mut onnx, "y0").input[0] = value;
        let mut policy = Policy::from_bytes("a".into(), &onnx.bytes(), &contract).unwrap();
        let times = timed(&mut policy, 20_000, Duration::ZERO);
        times[times.len() / 2].as_secs_f64()
    };
    let plain = median(None);
    for op in ["Relu", "Tanh", "Sigmoid", "Elu", "Softplus"] {
        let each = (median(Some(op)) - plain) / (LAYERS * 256) as f64;
        println!("{op}: {:.2} ns a value", each * 1e9);
    }
}

/// Sorted times of single runs, `pause` apart.
fn timed(policy: &mut Policy, runs: usize, pause: Duration) -> Vec<Duration> {
    let mut draw = Draw(7);
    let inputs: Vec<Vec<f32>> = (0..64).map(|_| observation(&mut draw, policy.inputs())).collect();
    let mut out = vec![0.0; policy.outputs()];
    let mut times = Vec::with_capacity(runs);
    for input in inputs.iter().cycle().take(runs) {
        if !pause.is_zero() {
            std::thread::sleep(pause);
        }
        let start = Instant::now();
        policy.run(std::hint::black_box(input), std::hint::black_box(&mut out)).unwrap();
        times.push(start.elapsed());
    }
    times.sort_unstable();
    times
}

fn report(what: &str, times: Vec<Duration>) {
    let at = |share: f64| times[((times.len() - 1) as f64 * share).round() as usize];
    println!("  {what}: p50 {:.1?}, p99.9 {:.1?}, max {:.1?} over {} runs", at(0.5), at(0.999), at(1.0), times.len());
}
