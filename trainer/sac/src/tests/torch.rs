//! Three whole updates of the paper's size against torch in double precision; skipped where Python lacks it.
//!
//! Which Python: `SAC_TEST_PYTHON`, else `python3`. The script gets weights, batches and noise and does the rest on
//! its own: features, losses, autograd, torch's Adam, slow copies, temperature.

use std::path::Path;
use std::process::Command;

use super::case::*;
use crate::parameters::Plain;
use crate::*;

const UPDATES: u64 = 3;

fn python() -> String {
    std::env::var("SAC_TEST_PYTHON").unwrap_or_else(|_| "python3".into())
}

fn available() -> bool {
    let probe = Command::new(python()).args(["-c", "import torch"]).output();
    let found = probe.is_ok_and(|output| output.status.success());
    if !found {
        eprintln!("skipped: {} with torch is not here (pip install torch, or set SAC_TEST_PYTHON)", python());
    }
    found
}

/// Weights and biases in one row.
fn flat(layers: &[Plain]) -> impl Iterator<Item = f64> {
    layers.iter().flat_map(|layer| layer.weights.iter().chain(&layer.bias)).map(|&x| f64::from(x))
}

/// Means and squares of all networks, values, targets, `ln α`.
fn result(s: &Snapshot) -> Vec<(&'static str, Vec<f64>)> {
    vec![
        ("actor", flat(&s.actor[0]).collect()),
        ("actor's mean", flat(&s.actor[1]).collect()),
        ("actor's square", flat(&s.actor[2]).collect()),
        ("critics", s.critics.iter().flat_map(|c| flat(&c[0])).collect()),
        ("critics' mean", s.critics.iter().flat_map(|c| flat(&c[1])).collect()),
        ("critics' square", s.critics.iter().flat_map(|c| flat(&c[2])).collect()),
        ("critics' targets", s.critics.iter().flat_map(|c| flat(&c[3])).collect()),
        ("temperature", vec![s.temperature.log.into(), s.temperature.mean.into(), s.temperature.square.into()]),
    ]
}

#[test]
fn three_updates_are_those_of_torch() {
    if !available() {
        return;
    }
    let mut learner = learner(PAPER, settings(PAPER), Machine::with_threads(2));
    let before = snapshot(&learner);
    let (settings, shape, map) = (learner.settings().clone(), learner.shape().clone(), features(PAPER));
    let n = |x: usize| x as f64;
    let mut input = vec![n(shape.observations), n(shape.goal.start), n(shape.goal.end), n(shape.actions)];
    input.extend([n(settings.hidden[0]), n(settings.hidden[1]), n(settings.batch), UPDATES as f64]);
    input.extend([settings.learning_rate, settings.discount, settings.soft_update].map(f64::from));
    input.extend([settings.lambda_temporal, settings.lambda_spatial, settings.target_entropy].map(f64::from));
    input.extend(settings.log_std.map(f64::from));
    input.extend([f64::from(before.temperature.log), n(map.features().len())]);
    for f in map.features() {
        input.extend([n(f.plus), f.minus.map_or(-1.0, n), f.offset.into(), f.scale.into()]);
    }
    input.extend(settings.spatial_sigma.iter().map(|&x| f64::from(x)));
    input.extend(flat(&before.actor[0]).chain(before.critics.iter().flat_map(|c| flat(&c[0]))));
    for d in (0..UPDATES).flat_map(|time| drawn(&learner, time)) {
        input.extend([d.observation, d.next, d.action, vec![d.reward, d.live]].concat());
        input.extend(d.noise.concat());
    }
    let folder = std::env::temp_dir().join(format!("sac-torch-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let (from, to) = (folder.join("input.f64"), folder.join("output.f64"));
    std::fs::write(&from, input.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<_>>()).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/second_opinion.py");
    let output = Command::new(python()).arg(script).args([&from, &to]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let bytes = std::fs::read(&to).unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
    let theirs: Vec<f64> = bytes.as_chunks().0.iter().map(|&b| f64::from_le_bytes(b)).collect();

    learner.update(UPDATES);
    let after = snapshot(&learner);
    let (mut at, start) = (0, result(&before));
    for ((name, ours), (_, start)) in result(&after).into_iter().zip(start) {
        let theirs = &theirs[at..][..ours.len()];
        at += ours.len();
        // Adam divides by the gradient's own size, so that a gradient of rounding alone moves a weight as far as a
        // true one: parameters are held to 0.1 % of their way in the mean over all of them, moments each and every
        // one to 1e-4 of the largest.
        let off: Vec<f64> = ours.iter().zip(theirs).map(|(a, b)| (a - b).abs()).collect();
        let way: f64 = theirs.iter().zip(&start).map(|(a, b)| (a - b).abs()).sum();
        let largest = theirs.iter().fold(0.0f64, |a, x| a.max(x.abs()));
        let mean = off.iter().sum::<f64>() / way;
        let worst = off.iter().fold(0.0f64, |a, &x| a.max(x)) / largest;
        println!("{name}: off by {mean:.1e} of the way, worst {worst:.1e} of the largest");
        assert!(way > 0.0 && mean < 1e-3, "{name}: {mean:.1e}");
        let is_moment = name.ends_with("mean") || name.ends_with("square") || name == "temperature";
        assert!(!is_moment || worst < 1e-4, "{name}: {worst:.1e}");
    }
    assert_eq!(at, theirs.len());
}
