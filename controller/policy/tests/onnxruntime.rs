//! The kernel against onnxruntime, on files from both sides; skipped where Python lacks it.
//!
//! The outputs are sigmoids, tanhs and clips of sums of up to 256 products in f32, which two programs
//! add in different orders: 1e-5 leaves a decade over the rounding (measured here: below 1e-6).
#![allow(clippy::unwrap_used, clippy::panic)]

mod onnx;

use std::path::{Path, PathBuf};
use std::process::Command;

use onnx::*;
use policy::Policy;

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

fn python(arguments: &[&Path]) {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/second_opinion.py");
    let output = Command::new("python3").arg(script).args(arguments).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
}

fn folder(name: &str) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::create_dir_all(&path).unwrap();
    path
}

fn read(path: &Path) -> Vec<f32> {
    let bytes = std::fs::read(path).unwrap();
    bytes.as_chunks().0.iter().map(|&b| f32::from_le_bytes(b)).collect()
}

/// Largest difference over all rows.
fn worst(policy: &mut Policy, inputs: &[f32], expected: &[f32]) -> f32 {
    assert_eq!(inputs.len() / 84, expected.len() / 12);
    assert!(inputs.len() >= 100 * 84);
    let mut ours = [0.0; 12];
    let mut worst = 0.0f32;
    for (input, expected) in inputs.chunks(84).zip(expected.chunks(12)) {
        policy.run(input, &mut ours).unwrap();
        for (a, b) in ours.iter().zip(expected) {
            worst = worst.max((a - b).abs());
        }
    }
    worst
}

#[test]
fn files_made_by_the_onnx_package() {
    if !available() {
        return;
    }
    let folder = folder("made_by_python");
    python(&[Path::new("make"), &folder]);
    let inputs = read(&folder.join("inputs.f32"));
    for name in ["torch_style", "sb3_style", "odd_style"] {
        let mut policy = Policy::load(&folder.join(format!("{name}.onnx")), &paper()).unwrap();
        let expected = read(&folder.join(format!("{name}.f32")));
        // A network that gives one answer to everything would pass unseen.
        let (low, high) = expected.iter().fold((1.0f32, 0.0f32), |(l, h), &x| (l.min(x), h.max(x)));
        assert!(high - low > 0.2, "{name} spans {low} to {high}");
        let off = worst(&mut policy, &inputs, &expected);
        assert!(off < TOLERANCE, "{name}: {off}");
    }
}

#[test]
fn files_made_by_these_tests() {
    if !available() {
        return;
    }
    let folder = folder("made_here");
    let mut draw = Draw(11);
    let inputs: Vec<f32> = (0..200).flat_map(|_| observation(&mut draw, 84)).collect();
    let rows = folder.join("inputs.f32");
    std::fs::write(&rows, inputs.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<_>>()).unwrap();
    let wide = Mlp::new(&[84, 256, 256, 12], 21);
    let odd = Mlp::new(&[84, 37, 12], 22);
    let cases = [
        ("relu", wide.torch("Relu", "Sigmoid")),
        ("tanh", wide.matmul_add("Tanh", "Clip")),
        ("elu", odd.torch("Elu", "Clip")),
        ("softplus", odd.matmul_add("Softplus", "Sigmoid")),
    ];
    for (name, onnx) in cases {
        let (model, out) = (folder.join(format!("{name}.onnx")), folder.join(format!("{name}.f32")));
        std::fs::write(&model, onnx.bytes()).unwrap();
        python(&[Path::new("run"), &model, &rows, &out]);
        let mut policy = Policy::load(&model, &paper()).unwrap();
        let off = worst(&mut policy, &inputs, &read(&out));
        assert!(off < TOLERANCE, "{name}: {off}");
    }
}
