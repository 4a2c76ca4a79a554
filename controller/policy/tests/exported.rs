//! All that the trainer exports, the daemon flies: through tract and the kernel, under both contracts.
#![allow(clippy::unwrap_used, clippy::panic)] // a test's own set-up

mod flown;
#[path = "../../../trainer/onnx/tests/networks/mod.rs"]
mod networks;

use flown::contracts;
use model::observation::ObservationLayout::{Correction, Paper};
use networks::{Draw, golden, network, provenance, scattered, walking};
use onnx_file::{GoldenPair, OutputMap, PolicyGraph, Ports, to_onnx};
use policy::{Fault, Policy};

/// f32 sums of up to 256 products against f64; the issue asks for 1e-5, and load compares with tract to the same.
const TOLERANCE: f32 = 1e-5;

fn export(graph: &PolicyGraph, ports: &Ports, golden: &[GoldenPair]) -> Vec<u8> {
    to_onnx(graph, ports, &provenance(), golden).unwrap()
}

fn load(bytes: &[u8]) -> Policy {
    Policy::from_bytes("exported".into(), bytes, &contracts()).unwrap_or_else(|fault| panic!("{fault}"))
}

#[test]
fn the_kernel_answers_as_the_network_does() {
    for (which, hidden) in [(Paper, &[256, 256][..]), (Correction, &[256, 256][..]), (Correction, &[37, 20][..])] {
        let ports = Ports::of(which);
        let graph = network(&ports, hidden, 10.0, 3);
        let mut policy = load(&export(&graph, &ports, &golden(&graph, &ports, 8)));
        assert_eq!(policy.contract().version, which.version());
        assert_eq!(policy.checks().golden_pairs, 8);
        let mut draw = Draw(5);
        let (mut worst, mut low, mut high) = (0.0f32, f32::MAX, f32::MIN);
        let mut ours = [0.0; 12];
        for round in 0..600 {
            let row = if round % 2 == 0 { scattered(&ports, &mut draw) } else { walking(&ports, &mut draw) };
            policy.run(&row, &mut ours).unwrap();
            for (ours, exact) in ours.iter().zip(graph.run(&row).unwrap()) {
                worst = worst.max((ours - exact).abs());
                (low, high) = (low.min(*ours), high.max(*ours));
            }
        }
        assert!(high - low > 0.4, "a network that hardly answers would pass unseen: {low} to {high}");
        println!("contract {}: within {worst:.1e}; {}", ports.contract, policy.describe());
        assert!(worst < TOLERANCE, "contract {}: {worst}", ports.contract);
    }
}

/// The features are what the module doc of `onnx_file::network` says, to the bit: with one dense layer of weight 1 into
/// each answer nothing but the picked difference, the offset and the scale is left before the tanh.
#[test]
fn features_have_the_same_bits_as_in_the_trainer() {
    let ports = Ports::of(Paper);
    let mut graph = network(&ports, &[], 10.0, 6);
    graph.features.drain(..84);
    graph.features.truncate(12);
    graph.layers[0].inputs = 12;
    graph.layers[0].weights = (0..144).map(|k| if k / 12 == k % 12 { 1.0 } else { 0.0 }).collect();
    graph.layers[0].biases = vec![0.0; 12];
    let mut policy = load(&export(&graph, &ports, &[]));
    let (mut draw, mut ours) = (Draw(8), [0.0; 12]);
    for _ in 0..200 {
        let row = walking(&ports, &mut draw);
        policy.run(&row, &mut ours).unwrap();
        for (ours, term) in ours.iter().zip(&graph.features) {
            let feature = (row[term.plus] - row[term.minus.unwrap()] - term.offset) * term.scale;
            // The kernel's tanh is the correctly rounded one but for one case in a million, and then the next number.
            let exact = (f64::from(feature).tanh() as f32) * 0.5 + 0.5;
            assert!((ours - exact).abs() <= f32::EPSILON / 2.0, "{ours} for {exact}");
        }
    }
}

/// Where pressures jump from tick to tick, as on probes, features of small changes amplify rounding, and two sound
/// programs differ by more than 1e-5; on observations as a rig gives them they do not.
#[test]
fn sharp_features_are_no_reason_to_refuse() {
    let ports = Ports::of(Paper);
    let graph = network(&ports, &[256, 256], 0.3, 1);
    let mut policy = load(&export(&graph, &ports, &[]));
    assert!(policy.checks().worst_to_tract > 1e-5, "{}", policy.checks().worst_to_tract);
    let (mut draw, mut ours) = (Draw(5), [0.0; 12]);
    for _ in 0..300 {
        let row = walking(&ports, &mut draw);
        policy.run(&row, &mut ours).unwrap();
        let worst = ours.iter().zip(graph.run(&row).unwrap()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < TOLERANCE, "{worst}");
    }
}

#[test]
fn what_check_policy_prints_tells_the_contract() {
    let ports = Ports::of(Correction);
    let graph = network(&ports, &[64, 64], 10.0, 2);
    let told = load(&export(&graph, &ports, &golden(&graph, &ports, 2))).describe();
    for part in [
        "Observation layout v2 at 50 Hz: takes 124 (p_pos[-10] to travel_neg), gives 12 (du_pos[0] to du_neg[5])",
        "124 -> 154 scaled -> 64 relu -> 64 relu -> 12 tanh scaled",
        "2 golden pairs",
        "rig bench",
        "seed 7",
        "steps 512000",
        "variant both",
        "Made by trainer 0.1.0",
    ] {
        assert!(told.contains(part), "{part:?} is not in: {told}");
    }
}

/// Widths alone tell the contracts apart, so a policy made elsewhere needs no metadata.
#[test]
fn a_file_without_metadata_is_taken_by_its_widths() {
    for which in [Paper, Correction] {
        let ports = Ports::of(which);
        let bytes = export(&network(&ports, &[16], 10.0, 1), &ports, &[]);
        let bare = without_metadata(&bytes);
        assert!(bare.len() < bytes.len());
        let policy = load(&bare);
        assert_eq!((policy.contract().version, policy.metadata().iter().count()), (which.version(), 0));
    }
}

/// Corrections answered by a file that says it answers duties, and the other way round.
#[test]
fn the_two_contracts_are_not_mistaken_for_each_other() {
    let paper = Ports::of(Paper);
    let mut disguised = Ports::of(Correction);
    disguised.contract = 1;
    let graph = network(&disguised, &[16], 10.0, 1);
    let refused = Policy::from_bytes("p".into(), &export(&graph, &disguised, &[]), &contracts()).err().unwrap();
    assert!(matches!(refused, Fault::InputWidth { found: 124, expected: 84, contract: 1, .. }), "{refused}");

    // The right widths and names, but the answers reach past what a correction may be.
    let mut ports = Ports::of(Correction);
    ports.outputs.iter_mut().for_each(|port| port.low = -1.0);
    let mut graph = network(&ports, &[16], 10.0, 1);
    graph.outputs = vec![OutputMap::onto(-1.0, 0.0); 12];
    let refused = Policy::from_bytes("p".into(), &export(&graph, &ports, &[]), &contracts()).err().unwrap();
    assert!(matches!(refused, Fault::OutputRange { low: -0.25, high: 0.25, .. }), "{refused}");

    let mut swapped = Ports::of(Paper);
    swapped.inputs.swap(0, 1);
    let refused = Policy::from_bytes("p".into(), &export(&network(&paper, &[4], 10.0, 1), &swapped, &[]), &contracts());
    assert!(matches!(refused, Err(Fault::MetadataContradicts { key: "input_names", .. })));
    let mut absolute = Ports::of(Correction);
    absolute.inputs[83].unit = "kPa absolute";
    let bytes = export(&network(&absolute, &[4], 10.0, 1), &absolute, &[]);
    let refused = Policy::from_bytes("p".into(), &bytes, &contracts()).err().unwrap().to_string();
    assert!(refused.contains("\"input_units\" says \"kPa absolute (value 83)\""), "{refused}");
}

/// A copy with one byte changed, or cut anywhere, is no copy: the file carries a hash of itself.
#[test]
fn every_changed_byte_and_every_cut_is_found() {
    let ports = Ports::of(Correction);
    let graph = network(&ports, &[4], 10.0, 2);
    let bytes = export(&graph, &ports, &golden(&graph, &ports, 1));
    load(&bytes);
    let mut draw = Draw(11);
    for round in 0..1500 {
        let at = ((f64::from(draw.next()) * 0.5 + 0.5) * bytes.len() as f64) as usize % bytes.len();
        let mut flipped = bytes.clone();
        flipped[at] ^= 1 << (round % 8);
        assert!(Policy::from_bytes("flipped".into(), &flipped, &contracts()).is_err(), "byte {at}, bit {}", round % 8);
    }
    for length in (1..bytes.len()).step_by(61).chain(bytes.len() - 120..bytes.len()) {
        assert!(Policy::from_bytes("cut".into(), &bytes[..length], &contracts()).is_err(), "cut at {length}");
    }
    // Swapped weights keep every sum of bytes; the hash is another all the same.
    let at = bytes.len() / 2;
    let mut swapped = bytes.clone();
    swapped.swap(at, at + 4);
    if swapped != bytes {
        let refused = Policy::from_bytes("swapped".into(), &swapped, &contracts()).err().unwrap();
        assert!(matches!(refused, Fault::ContentHash { .. }), "{refused}");
    }
}

/// An ONNX file without its `metadata_props`: field 14 of the outermost message.
fn without_metadata(bytes: &[u8]) -> Vec<u8> {
    use prost::Message as _;
    let mut model = tract_onnx::pb::ModelProto::decode(bytes).unwrap();
    model.metadata_props.clear();
    model.encode_to_vec()
}
