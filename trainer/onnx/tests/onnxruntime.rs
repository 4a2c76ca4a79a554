//! Exported files as the ONNX package checks them and onnxruntime runs them; skipped where Python lacks these.
#![allow(clippy::unwrap_used)] // a test's own set-up; clippy knows tests only by their attribute

mod networks;

use std::path::{Path, PathBuf};
use std::process::Command;

use model::observation::ObservationLayout;
use networks::{Draw, golden, network, provenance, scattered, walking};
use onnx_file::{Ports, to_onnx};

/// Hidden sums of some hundred products in f32 against f64: measured at most 6e-7. The issue asks for 1e-5.
const TOLERANCE: f32 = 1e-5;

/// Tells whether Python has what the script imports; says so once where not.
fn available() -> bool {
    let probe = Command::new("python3").args(["-c", "import numpy, onnx, onnxruntime"]).output();
    let found = probe.is_ok_and(|output| output.status.success());
    if !found {
        eprintln!("skipped: python3 with numpy, onnx and onnxruntime is not here (pip install onnx onnxruntime)");
    }
    found
}

fn python(arguments: &[&Path]) -> String {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/second_opinion.py");
    let output = Command::new("python3").arg(script).args(arguments).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn save(name: &str, bytes: &[u8]) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

fn little_endian(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// Both contracts, over observations drawn value by value and over observations as a rig gives them; one row at a time
/// and all rows in one batch.
#[test]
fn onnxruntime_answers_as_the_network_does() {
    if !available() {
        return;
    }
    for (contract, hidden) in [
        (ObservationLayout::Paper, &[256, 256][..]),
        (ObservationLayout::Correction, &[256, 256][..]),
        (ObservationLayout::Correction, &[37][..]),
        (ObservationLayout::Paper, &[][..]),
    ] {
        let ports = Ports::of(contract);
        let graph = network(&ports, hidden, 10.0, 3);
        let mut draw = Draw(5);
        let mut rows: Vec<Vec<f32>> = (0..300).map(|_| scattered(&ports, &mut draw)).collect();
        rows.extend((0..300).map(|_| walking(&ports, &mut draw)));
        let name = format!("contract_{}_{}", ports.contract, hidden.len());
        let model = save(&format!("{name}.onnx"), &to_onnx(&graph, &ports, &provenance(), &[]).unwrap());
        let inputs = save(&format!("{name}_inputs.f32"), &little_endian(&rows.concat()));
        let outputs = save(&format!("{name}_outputs.f32"), &[]);
        python(&[Path::new("run"), &model, &inputs, &outputs]);
        let answers = std::fs::read(&outputs).unwrap();
        let answers: Vec<f32> = answers.as_chunks().0.iter().map(|&b| f32::from_le_bytes(b)).collect();
        // The script writes the answers row by row, then those of the whole batch.
        assert_eq!(answers.len(), 2 * rows.len() * ports.outputs.len());
        let exact: Vec<f32> = rows.iter().flat_map(|row| graph.run(row).unwrap()).collect();
        let (low, high) = exact.iter().fold((1.0f32, -1.0f32), |(l, h), &y| (l.min(y), h.max(y)));
        assert!(high - low > 0.4, "a network that hardly answers would pass unseen: {low} to {high}");
        let off = exact.iter().cycle().zip(&answers).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        println!("{name}: within {off:.1e}");
        assert!(off < TOLERANCE, "{name}: {off}");
    }
}

/// The ONNX package reads back what was said, and golden numbers are the same f32.
#[test]
fn metadata_read_back() {
    if !available() {
        return;
    }
    let ports = Ports::of(ObservationLayout::Correction);
    let graph = network(&ports, &[16], 10.0, 4);
    let pairs = golden(&graph, &ports, 3);
    let model = save("metadata.onnx", &to_onnx(&graph, &ports, &provenance(), &pairs).unwrap());
    let golden_bits = save("metadata.f32", &[]);
    let said = python(&[Path::new("describe"), &model, &golden_bits]);
    for line in [
        "ir 8 opset 17 producer trainer 0.1.0",
        "observation ['batch', 124] action ['batch', 12]",
        "contract=2",
        "rate_hz=50",
        "output_unit=duty",
        "rig=bench",
        "rig_hash=0123456789abcdef",
        "seed=7",
        "steps=512000",
        "variant=both",
        "preset=paper",
        "trainer=0.1.0",
        "commit=b9ce2cb",
    ] {
        assert!(said.lines().any(|l| l == line), "{line:?} is not in:\n{said}");
    }
    let flat: Vec<f32> =
        pairs.iter().flat_map(|p| &p.input).chain(pairs.iter().flat_map(|p| &p.output)).copied().collect();
    assert_eq!(std::fs::read(&golden_bits).unwrap(), little_endian(&flat));
}
