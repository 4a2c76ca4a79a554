//! Networks that must not become a file, and one that always becomes the same file.
#![allow(clippy::unwrap_used)] // a test's own set-up; clippy knows tests only by their attribute

mod networks;

use model::observation::ObservationLayout;
use networks::{golden, network, provenance};
use onnx_file::{ExportError, OutputMap, PolicyGraph, Ports, to_onnx};

fn small(contract: ObservationLayout) -> (PolicyGraph, Ports) {
    let ports = Ports::of(contract);
    (network(&ports, &[8], 10.0, 1), ports)
}

#[test]
fn same_network_same_bytes() {
    let (graph, ports) = small(ObservationLayout::Paper);
    let pairs = golden(&graph, &ports, 2);
    let bytes = || to_onnx(&graph, &ports, &provenance(), &pairs).unwrap();
    assert_eq!(bytes(), bytes());
}

#[test]
fn a_network_of_the_other_contract() {
    let (graph, ports) = small(ObservationLayout::Correction);
    let refused = to_onnx(&graph, &Ports::of(ObservationLayout::Paper), &provenance(), &[]).unwrap_err();
    assert_eq!(refused, ExportError::Width { side: "inputs", found: 124, expected: 84, contract: 1 });
    // Same inputs, but duties answered where corrections belong.
    let mut duties = graph;
    duties.outputs = vec![OutputMap::onto(0.0, 1.0); 12];
    let refused = to_onnx(&duties, &ports, &provenance(), &[]).unwrap_err();
    assert!(matches!(refused, ExportError::OutputRange { .. }), "{refused}");
    assert_eq!(refused.to_string(), "output du_pos[0] reaches 0 to 1, observation layout v2 lets it be -0.25 to 0.25");
}

#[test]
fn a_diverged_network() {
    let (mut graph, ports) = small(ObservationLayout::Paper);
    graph.layers[1].weights[40] = f32::NAN;
    let refused = to_onnx(&graph, &ports, &provenance(), &[]).unwrap_err().to_string();
    assert!(refused.ends_with("is NaN; the training diverged: export an earlier checkpoint"), "{refused}");
}

/// The answers of a trainer whose layers, order of features or maps are not those of the graph.
#[test]
fn golden_pairs_of_another_network() {
    let (graph, ports) = small(ObservationLayout::Paper);
    let sound = golden(&graph, &ports, 4);
    let export = |pairs: &[_]| to_onnx(&graph, &ports, &provenance(), pairs);
    let mut wrong = sound.clone();
    wrong[2].output[11] += 1e-4;
    assert!(matches!(export(&wrong), Err(ExportError::GoldenDiffers { pair: 2, output: 11, .. })));
    wrong[2].output[11] = f32::NAN;
    assert!(matches!(export(&wrong), Err(ExportError::GoldenDiffers { pair: 2, output: 11, .. })));
    let mut infinite = sound.clone();
    infinite[1].input[5] = f32::INFINITY;
    assert!(matches!(export(&infinite), Err(ExportError::NotFinite { place: 5, .. })));
    let mut short = sound.clone();
    short[0].output.pop();
    assert!(matches!(export(&short), Err(ExportError::RowLength { found: 11, expected: 12, .. })));
    let many = vec![sound[0].clone(); 257];
    assert!(matches!(export(&many), Err(ExportError::TooManyGolden { found: 257, .. })));
    assert!(export(&sound).is_ok());
}
