//! The example of docs/policies.md, run as it stands: Stable-Baselines3 makes a policy, the daemon's loader takes it.
//! Skipped where Python lacks it.
#![allow(clippy::unwrap_used)] // a test's own set-up; clippy knows tests only by their attribute

mod flown;

use std::path::{Path, PathBuf};
use std::process::Command;

use flown::contracts;
use policy::Policy;

/// Tells whether Python has what the script imports; says so once where not.
fn available() -> bool {
    let probe = Command::new("python3").args(["-c", "import onnx, stable_baselines3, torch"]).output();
    let found = probe.is_ok_and(|output| output.status.success());
    if !found {
        eprintln!("skipped: python3 with stable-baselines3 and onnx is not here (pip install stable-baselines3 onnx)");
    }
    found
}

#[test]
fn a_policy_of_stable_baselines3_is_taken() {
    if !available() {
        return;
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/examples/sb3_policy.py");
    let file = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("sb3_policy.onnx");
    let output = Command::new("python3")
        .arg(script)
        .args(["--rig", "toy", "--steps", "150", "--out"])
        .arg(&file)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut policy = Policy::load(&file, &contracts()).unwrap();
    assert_eq!(policy.contract().version, 1);
    // Units, names and golden pairs are in the file, so load has compared them.
    for key in ["rate_hz", "input_unit", "output_unit", "input_names", "output_names"] {
        assert!(policy.metadata().get(key).is_some(), "{key}");
    }
    assert_eq!((policy.checks().golden_pairs, policy.metadata().get("steps")), (8, Some("150")));
    // Two ends of the rig's range: an actor whose normalisation was left out would answer both from its saturation.
    let mut answers = [[0.0; 12]; 2];
    for (answer, share) in answers.iter_mut().zip([0.2, 0.8]) {
        let contract = policy.contract().clone();
        let row: Vec<f32> = contract.inputs.iter().map(|c| c.low + share * (c.high - c.low)).collect();
        policy.run(&row, answer).unwrap();
        assert!(answer.iter().all(|u| (0.05..0.95).contains(u)), "{answer:?}");
    }
    let apart = answers[0].iter().zip(answers[1]).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(apart > 0.01, "{apart}");
}
