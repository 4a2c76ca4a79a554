//! The shipped policy on 40 randomised rigs and 10 on which one thing alone is off; a table on standard output.
//!
//! `cargo test --release -p training --test many_rigs -- --ignored --nocapture` (two minutes of one core). `POLICY` names
//! another policy: an ONNX file of ours or the folder of a run.

#![allow(clippy::unwrap_used)] // a test's own set-up; clippy knows tests only by their attribute

use std::path::{Path, PathBuf};
use std::sync::Arc;

use environment::closed_loop::{Controller, FlightPlan, PolicyController};
use environment::draws::{Purpose, stream};
use environment::{RigDraw, Score, fly};
use law::{Fallback, FallbackSettings, PolicyLaw};
use model::rig::Rig;
use model::steady::SteadyMap;
use proto::reference::Reference;
use training::{TrainedPolicy, TrainingSettings};

/// No training, no selection and no plan draws rigs of this seed.
const SEED: u64 = 0x40_1010;
/// Duty change per tick (RMS) from which a valve hunts: calm runs have 0.002 to 0.01, limit cycles 0.03 to 0.06
/// (`docs/training-results.md`).
const HUNTS: f64 = 0.02;

/// One thing alone, on both valves.
const ALONE: [(&str, &str); 10] = [
    ("command_delay", "delay_ms = 20.0"),
    ("command_delay", "delay_ms = 40.0"),
    ("command_delay", "delay_ms = 60.0"),
    ("valve_lag", "time_constant_ms = 20.0"),
    ("valve_lag", "time_constant_ms = 50.0"),
    ("valve_lag", "time_constant_ms = 90.0"),
    ("valve_hysteresis", "half_width_duty = 0.01"),
    ("valve_hysteresis", "half_width_duty = 0.03"),
    ("valve_hysteresis", "half_width_duty = 0.05"),
    ("dead_zone", "closed_duty = 0.0"),
];

fn rigs() -> Vec<(String, Rig)> {
    let nominal = Rig::builtin("dual_pressure").unwrap();
    let settings = TrainingSettings::preset("correction").unwrap();
    let draw = RigDraw::new(&nominal, &settings.environment).unwrap();
    let drawn = (0..40).map(|n| (format!("randomised {n}"), draw.draw(&mut stream(SEED, Purpose::Rig, n, 0)).unwrap()));
    let text = Rig::builtin_text("dual_pressure").unwrap();
    let alone = ALONE.iter().map(|(id, number)| {
        let on = |valve: &str| format!("[[mechanisms]]\nid = \"{id}\"\ncomponent = \"{valve}\"\n{number}\n");
        let rig = match *id {
            // Nothing at all is off: the rig of the paper.
            "dead_zone" => nominal.clone(),
            _ => Rig::from_toml(&format!("{text}\n{}{}", on("valve_pos"), on("valve_neg"))).unwrap(),
        };
        (if *id == "dead_zone" { "nothing".to_owned() } else { format!("{id} {number}") }, rig)
    });
    drawn.chain(alone).collect()
}

fn score(rig: &Rig, model: &Rig, controller: &mut impl Controller) -> Score {
    let plan = FlightPlan {
        rig,
        model: Some(model),
        reference: &Reference::paper(),
        seconds: 60.0,
        noise_v_rms: proto::emulator::Sensors::ADC_NOISE_V_RMS,
        seed: 5,
    };
    Score::of(&fly(&plan, controller).unwrap().ticks)
}

#[test]
#[ignore = "two minutes; run it by name for the table"]
fn no_rig_makes_the_shipped_policy_hunt() {
    let shipped = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../controller/policies/default.onnx");
    let policy = TrainedPolicy::load(&std::env::var_os("POLICY").map_or_else(shipped, PathBuf::from)).unwrap();
    let model = Rig::builtin("dual_pressure").unwrap();
    let map = Arc::new(SteadyMap::new(&model).unwrap());
    let (mut hunting, mut behind, mut ratios) = (Vec::new(), Vec::new(), [Vec::new(), Vec::new()]);
    println!("rig | policy RMSE, kPa | fallback RMSE, kPa | policy duty change per tick, RMS");
    for (name, rig) in rigs() {
        let mut runner = policy.runner();
        let law = PolicyLaw::new(Arc::clone(&map), policy.settings().contract());
        let flown = score(&rig, &model, &mut PolicyController::new(law, |o: &[f32]| runner.outputs(o)));
        let fallback = score(&rig, &model, &mut Fallback::new(Arc::clone(&map), FallbackSettings::default()));
        let ([p, n], [fp, fn_], [dp, dn]) = (flown.rmse_kpa, fallback.rmse_kpa, flown.duty_change_rms);
        println!("{name} | {p:.3} / {n:.3} | {fp:.3} / {fn_:.3} | {dp:.4} / {dn:.4}");
        if flown.duty_change_rms.iter().any(|change| *change > HUNTS) {
            hunting.push(name.clone());
        }
        if flown.rmse_kpa.iter().zip(fallback.rmse_kpa).any(|(own, other)| *own > other) {
            behind.push(name);
        }
        for (ratios, (own, other)) in ratios.iter_mut().zip(flown.rmse_kpa.iter().zip(fallback.rmse_kpa)) {
            ratios.push(own / other);
        }
    }
    let mean = |ratios: &[f64]| (ratios.iter().map(|r| r.ln()).sum::<f64>() / ratios.len() as f64).exp();
    println!("of the fallback's error, geometric mean: {:.3} / {:.3}", mean(&ratios[0]), mean(&ratios[1]));
    println!("behind the fallback on a channel: {}: {behind:?}", behind.len());
    assert!(hunting.is_empty(), "{hunting:?}");
}
