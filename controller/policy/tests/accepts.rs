//! Policies that fly: every way of writing a layer gives what f64 arithmetic gives.
#![allow(clippy::unwrap_used, clippy::panic)]

mod onnx;

use onnx::*;
use policy::{Policy, PolicySignature};
use proptest::prelude::*;

fn load(onnx: &Onnx, contracts: &[PolicySignature]) -> Policy {
    Policy::from_bytes("test".into(), &onnx.bytes(), contracts).unwrap_or_else(|e| panic!("{e}"))
}

fn relu(x: f64) -> f64 {
    x.max(0.0)
}

fn elu(x: f64) -> f64 {
    if x < 0.0 { x.exp_m1() } else { x }
}

fn leaky(x: f64) -> f64 {
    // The standard's default slope.
    if x < 0.0 { f64::from(0.01f32) * x } else { x }
}

fn softplus(x: f64) -> f64 {
    x.exp().ln_1p()
}

fn sigmoid(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

fn unit(x: f64) -> f64 {
    x.clamp(0.0, 1.0)
}

/// f32 sums of 64 products of order one are good to 64 * 2^-24 = 4e-6; two layers and a sigmoid of
/// slope 1/4 stay below that.
const SUM_TOLERANCE: f64 = 4e-6;

type Function = fn(f64) -> f64;

#[test]
fn both_styles_and_every_activation_agree_with_f64() {
    let hidden: [(&str, Function); 6] = [
        ("Relu", relu),
        ("Tanh", f64::tanh),
        ("Elu", elu),
        ("LeakyRelu", leaky),
        ("Softplus", softplus),
        ("Sigmoid", sigmoid),
    ];
    let last: [(&str, Function); 2] = [("Sigmoid", sigmoid), ("Clip", unit)];
    let mut draw = Draw(9);
    for (i, (hidden, h)) in hidden.into_iter().enumerate() {
        for (last, l) in last {
            let net = Mlp::new(&[84, 64, 33, 12], i as u32);
            for onnx in [net.torch(hidden, last), net.matmul_add(hidden, last)] {
                let mut policy = load(&onnx, &paper());
                for _ in 0..50 {
                    let input = observation(&mut draw, 84);
                    let mut ours = [0.0; 12];
                    policy.run(&input, &mut ours).unwrap();
                    for (ours, exact) in ours.iter().zip(net.exact(&input, h, l)) {
                        let off = (f64::from(*ours) - exact).abs();
                        assert!(off < SUM_TOLERANCE, "{hidden} {last}: {ours} for {exact}");
                    }
                }
            }
        }
    }
}

/// By hand, for x = (0.25, -0.125), rows (3, 5) and (7, 11), alpha 2, c = (4, -8), beta 0.5:
/// (2 (0.75 - 0.625) + 2) / 4 = 0.5625, and (2 (1.75 - 1.375) - 4) / 4 = -0.8125, clipped to 0.
#[test]
fn gemm_follows_alpha_beta_and_transpose() {
    let mut onnx = Onnx::new(2, 2);
    onnx.weight("w", &[2, 2], &[3.0, 5.0, 7.0, 11.0]).weight("c", &[1, 2], &[4.0, -8.0]);
    onnx.weight("four", &[], &[4.0]).weight("low", &[], &[0.0]).weight("high", &[], &[1.0]);
    let attributes = vec![float("alpha", 2.0), float("beta", 0.5), int("transB", 1), int("transA", 0)];
    onnx.node("Gemm", &["obs", "w", "c"], "y", attributes);
    onnx.node("Div", &["y", "four"], "z", vec![]);
    onnx.node("Clip", &["z", "low", "high"], "action", vec![]);
    let mut policy = load(&onnx, &[PolicySignature::pressures_to_duties(1, 2, 2)]);
    let mut out = [9.0; 2];
    policy.run(&[0.25, -0.125], &mut out).unwrap();
    assert_eq!(out, [0.5625, 0.0]);
}

/// Bits from numpy: float32 products and sums in the order of the inputs, tanh and exp from the C
/// library in f64, for W1[i][j] = ((7 i + 3 j) % 11 - 5) / 8, b1[j] = (j - 2) / 16, W2[i][j] =
/// ((5 i + 2 j) % 7 - 3) / 4, b2[j] = j / 8, x[i] = 0.1f * (i + 1).
/// A change of these bits is a change of every recorded flight.
#[test]
fn the_bits_are_those_of_another_implementation() {
    let mut onnx = Onnx::new(6, 3);
    let w1: Vec<f32> = (0..30).map(|k| (((7 * (k / 5) + 3 * (k % 5)) % 11) as f32 - 5.0) / 8.0).collect();
    let b1: Vec<f32> = (0..5).map(|j| (j as f32 - 2.0) / 16.0).collect();
    let w2: Vec<f32> = (0..15).map(|k| (((5 * (k / 3) + 2 * (k % 3)) % 7) as f32 - 3.0) / 4.0).collect();
    let b2: Vec<f32> = (0..3).map(|j| j as f32 / 8.0).collect();
    onnx.weight("w1", &[6, 5], &w1).weight("b1", &[5], &b1);
    onnx.weight("w2", &[5, 3], &w2).weight("b2", &[3], &b2);
    onnx.node("MatMul", &["obs", "w1"], "p", vec![]).node("Add", &["p", "b1"], "y", vec![]);
    onnx.node("Tanh", &["y"], "h", vec![]).node("Gemm", &["h", "w2", "b2"], "z", vec![]);
    onnx.node("Sigmoid", &["z"], "action", vec![]);
    let mut policy = load(&onnx, &[PolicySignature::pressures_to_duties(1, 6, 3)]);
    let input: Vec<f32> = (0..6).map(|i| 0.1f32 * (i + 1) as f32).collect();
    let mut out = [0.0; 3];
    policy.run(&input, &mut out).unwrap();
    assert_eq!(out.map(f32::to_bits), GOLDEN_BITS);
}

const GOLDEN_BITS: [u32; 3] = [0x3f0d_c688, 0x3f08_d000, 0x3efc_634c];

#[test]
fn what_changes_nothing_is_taken() {
    let net = Mlp::new(&[84, 16, 12], 3);
    let mut plain = load(&net.torch("Tanh", "Sigmoid"), &paper());
    let mut onnx = net.torch("Tanh", "Sigmoid");
    onnx.shape("same", &[-1, 12]);
    let nodes = onnx.graph().node.len();
    onnx.node("Identity", &["obs"], "o1", vec![]).node("Flatten", &["o1"], "o2", vec![int("axis", 1)]);
    onnx.node("Cast", &["o2"], "o3", vec![int("to", 1)]);
    onnx.graph().node.rotate_left(nodes);
    node_of(&mut onnx, "centred").input[0] = "o3".into();
    node_of(&mut onnx, "action").output[0] = "a1".into();
    onnx.node("Reshape", &["a1", "same"], "action", vec![]);
    // The way old exporters list their weights, and a batch that is fixed at one.
    onnx.graph().input.push(port("mean", tensor_proto::DataType::Float, &[Dim::Fixed(84)]));
    onnx.graph().input[0] = port("obs", tensor_proto::DataType::Float, &[Dim::Fixed(1), Dim::Fixed(84)]);
    let mut padded = load(&onnx, &paper());
    let input = observation(&mut Draw(4), 84);
    let (mut a, mut b) = ([0.0; 12], [1.0; 12]);
    plain.run(&input, &mut a).unwrap();
    padded.run(&input, &mut b).unwrap();
    assert_eq!(a.map(f32::to_bits), b.map(f32::to_bits));
}

#[test]
fn constants_may_come_from_nodes_casts_and_transposes() {
    let net = Mlp::new(&[84, 12], 5);
    let mut plain = load(&net.matmul_add("Tanh", "Sigmoid"), &paper());
    let mut onnx = net.matmul_add("Tanh", "Sigmoid");
    // The mean as a double, cast; the weights transposed in the file; the bias as a Constant node.
    let mean = weight_of(&mut onnx, "mean");
    mean.name = "mean64".into();
    mean.data_type = tensor_proto::DataType::Double as i32;
    mean.raw_data = net.mean.iter().flat_map(|&x| f64::from(x).to_le_bytes()).collect();
    let w0 = weight_of(&mut onnx, "w0");
    w0.name = "w0t".into();
    w0.dims = vec![12, 84];
    w0.raw_data =
        (0..12).flat_map(|j| (0..84).map(move |i| i * 12 + j)).flat_map(|k| net.weights[0][k].to_le_bytes()).collect();
    let mut bias = weight_of(&mut onnx, "b0").clone();
    bias.float_data = net.biases[0].clone();
    bias.raw_data.clear();
    onnx.graph().initializer.retain(|t| t.name != "b0");
    let nodes = onnx.graph().node.len();
    onnx.node("Cast", &["mean64"], "mean", vec![int("to", 1)]);
    onnx.node("Transpose", &["w0t"], "w0", vec![ints("perm", &[1, 0])]);
    onnx.node("Constant", &[], "b0", vec![tensor("value", bias)]);
    onnx.graph().node.rotate_left(nodes);
    let mut folded = load(&onnx, &paper());
    let input = observation(&mut Draw(6), 84);
    let (mut a, mut b) = ([0.0; 12], [1.0; 12]);
    plain.run(&input, &mut a).unwrap();
    folded.run(&input, &mut b).unwrap();
    assert_eq!(a.map(f32::to_bits), b.map(f32::to_bits));
}

#[test]
fn a_tanh_mapped_to_a_duty_is_taken() {
    // Stable-Baselines3's squashed actor: 0.5 tanh + 0.5, constants on either side.
    let mut onnx = Mlp::new(&[84, 24, 12], 7).torch("Relu", "Tanh");
    node_of(&mut onnx, "action").output[0] = "squashed".into();
    onnx.weight("half", &[1], &[0.5]);
    onnx.node("Mul", &["half", "squashed"], "scaled_action", vec![]);
    onnx.node("Add", &["scaled_action", "half"], "action", vec![]);
    let policy = load(&onnx, &paper());
    assert!(policy.checks().lowest_output >= -1e-6 && policy.checks().highest_output <= 1.0 + 1e-6);
    assert_eq!(policy.layers(), "84 scaled -> 24 relu -> 12 tanh scaled");
}

#[test]
fn metadata_golden_pairs_and_description() {
    let net = Mlp::new(&[84, 32, 12], 8);
    let input = observation(&mut Draw(1), 84);
    let row = |v: &[String]| v.join(",");
    let inputs = row(&input.iter().map(|x| x.to_string()).collect::<Vec<_>>());
    let outputs: Vec<String> = net.exact(&input, relu, sigmoid).iter().map(|x| (*x as f32).to_string()).collect();
    let mut onnx = net.torch("Relu", "Sigmoid");
    onnx.metadata("contract", "1").metadata("rate_hz", "50").metadata("input_unit", "kPa gauge");
    onnx.metadata("output_unit", "duty").metadata("seed", "7").metadata("variant", "both");
    onnx.metadata("golden_input", &format!("{inputs};{inputs}"));
    onnx.metadata("golden_output", &format!("{0};{0}", row(&outputs)));
    let path = onnx.save("quick-fox.onnx");
    let policy = Policy::load(&path, &paper()).unwrap();
    assert_eq!(policy.name(), "quick-fox");
    assert_eq!(policy.metadata().get("seed"), Some("7"));
    assert_eq!(policy.checks().golden_pairs, 2);
    assert!(policy.checks().worst_to_golden < SUM_TOLERANCE as f32);
    assert_eq!(policy.parameters(), 85 * 32 + 33 * 12);
    assert_eq!((policy.inputs(), policy.outputs()), (84, 12));
    let told = policy.describe();
    for part in [
        "\"quick-fox\"",
        "84 scaled -> 32 relu -> 12 sigmoid",
        "2 golden pairs",
        "variant both",
        "Observation layout v1 at 50 Hz",
    ] {
        assert!(told.contains(part), "{part} not in: {told}");
    }
    assert_eq!(told.lines().count(), 1);
    assert!(!told.contains(&inputs));
}

#[test]
fn the_file_chooses_among_contracts() {
    let small = Mlp::new(&[10, 8, 4], 2);
    let contracts = [PolicySignature::pressures_to_duties(1, 84, 12), PolicySignature::pressures_to_duties(2, 10, 4)];
    assert_eq!(load(&small.torch("Relu", "Sigmoid"), &contracts).contract().version, 2);
    assert_eq!(load(&sound(), &contracts).contract().version, 1);
    let mut named = small.torch("Relu", "Sigmoid");
    named.metadata("contract", "2");
    assert_eq!(load(&named, &contracts).contract().version, 2);
}

/// `(x − mean) / (std + eps)` and `(x − mean) / sqrt(var + eps)` as exporters leave them without constant folding.
#[test]
fn operations_on_constants_are_folded() {
    let net = Mlp::new(&[84, 16, 12], 5);
    let plain = net.torch("Relu", "Sigmoid");
    let mean: Vec<f32> = (0..84).map(|i| 0.5 * i as f32 - 20.0).collect();
    let std: Vec<f32> = (0..84).map(|i| 3.0 + 0.25 * i as f32).collect();
    let normalised = |rooted: bool| {
        let mut onnx = plain.clone();
        onnx.weight("m", &[84], &mean).weight("eps", &[], &[1e-3]);
        onnx.weight("s", &[1, 84], &if rooted { std.iter().map(|s| s * s).collect() } else { std.clone() });
        let mut layers = std::mem::take(&mut onnx.graph().node);
        layers.iter_mut().flat_map(|n| &mut n.input).filter(|n| *n == "obs").for_each(|n| *n = "own".into());
        onnx.node("Sub", &["obs", "m"], "less", vec![]).node("Add", &["s", "eps"], "wide", vec![]);
        if rooted {
            onnx.node("Sqrt", &["wide"], "root", vec![]);
        }
        onnx.node("Div", &["less", if rooted { "root" } else { "wide" }], "own", vec![]);
        onnx.graph().node.extend(layers);
        onnx
    };
    let mut bare = load(&plain, &paper());
    for rooted in [false, true] {
        let mut folded = load(&normalised(rooted), &paper());
        for seed in 0..20 {
            let input = observation(&mut Draw(seed), 84);
            let scaled: Vec<f32> = input
                .iter()
                .zip(&mean)
                .zip(&std)
                .map(|((x, m), s)| if rooted { (x - m) / (s * s + 1e-3).sqrt() } else { (x - m) / (s + 1e-3) })
                .collect();
            let (mut ours, mut expected) = ([0.0; 12], [0.0; 12]);
            folded.run(&input, &mut ours).unwrap();
            bare.run(&scaled, &mut expected).unwrap();
            assert_eq!(ours, expected);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    /// Any widths, including those that do not fill a panel or a cache line.
    #[test]
    fn any_shape_agrees_with_f64(
        sizes in proptest::collection::vec(1usize..80, 2..5),
        seed: u32,
    ) {
        let net = Mlp::new(&sizes, seed);
        let (inputs, outputs) = (sizes[0], sizes[sizes.len() - 1]);
        let contract = [PolicySignature::pressures_to_duties(1, inputs, outputs)];
        let mut policy = load(&net.torch("Tanh", "Sigmoid"), &contract);
        let input = observation(&mut Draw(seed), inputs);
        let mut ours = vec![0.0; outputs];
        policy.run(&input, &mut ours).unwrap();
        for (ours, exact) in ours.iter().zip(net.exact(&input, f64::tanh, sigmoid)) {
            prop_assert!((f64::from(*ours) - exact).abs() < SUM_TOLERANCE);
        }
    }
}
