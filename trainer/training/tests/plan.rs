//! The plan is what is then done: MPObs rolled again from recorded plans, on the rig that the model is.

#![allow(clippy::unwrap_used)] // a test's own set-up; clippy knows tests only by their attribute

use std::path::Path;
use std::sync::Arc;

use environment::closed_loop::{FlightPlan, PolicyController};
use environment::fly;
use environment::plan_check::{PlanErrors, PlannedTick, Watched};
use law::PolicyLaw;
use model::observation::{AHEAD, CHANNELS};
use model::predict::Predictor;
use model::rig::Rig;
use model::steady::SteadyMap;
use proto::reference::Reference;
use training::{PolicyStart, Run, TrainedPolicy, TrainingSettings};

/// Share that the plan may err of what "nothing changes" errs. On the positive channel most of it is the readings' noise: with
/// the duties then applied in place of the plan it would be 0.24.
const MOST_SHARE: f64 = 0.3;

/// A minute of the paper's reference on the ideal rig, with it as the model.
fn run(policy: &TrainedPolicy) -> Vec<PlannedTick> {
    let rig = Rig::builtin("dual_pressure").unwrap();
    let map = Arc::new(SteadyMap::new(&rig).unwrap());
    let plan = FlightPlan {
        rig: &rig,
        model: Some(&rig),
        reference: &Reference::paper(),
        seconds: 60.0,
        noise_v_rms: proto::emulator::Sensors::ADC_NOISE_V_RMS,
        seed: 3,
    };
    let mut runner = policy.runner();
    let law = PolicyLaw::new(map, policy.settings().contract());
    let mut watched = Watched::new(PolicyController::new(law, |observation: &[f32]| runner.outputs(observation)));
    fly(&plan, &mut watched).unwrap();
    watched.ticks
}

/// Rolls a model along what was recorded, and ahead from what was planned a tick before.
fn rolled_again(ticks: &[PlannedTick]) -> Vec<PlannedTick> {
    let mut model = Predictor::new(&Rig::builtin("dual_pressure").unwrap()).unwrap();
    let mut planned = [[1.0; CHANNELS]; AHEAD];
    let roll = |(n, tick): (usize, &PlannedTick)| {
        if n == 0 {
            model.restart(tick.measured_kpa, [1.0; CHANNELS]);
        }
        model.observe(tick.measured_kpa);
        let predicted_kpa = model.predict(&planned, true);
        planned = tick.trajectory.remaining();
        model.advance(tick.trajectory.now(), true);
        PlannedTick { predicted_kpa, ..*tick }
    };
    ticks.iter().enumerate().map(roll).collect()
}

fn shipped() -> TrainedPolicy {
    TrainedPolicy::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../controller/policies/default.onnx")).unwrap()
}

#[test]
fn the_shipped_policy_does_what_it_plans() {
    let ticks = run(&shipped());
    let again = rolled_again(&ticks);
    let errors = PlanErrors::of(&again);
    println!("five ticks ahead: plan {:?} kPa, nothing changes {:?} kPa", errors.plan_kpa, errors.unchanged_kpa);
    assert!(errors.share().iter().all(|share| *share <= MOST_SHARE), "{errors:?}");
    // What flew had the same predictions: the same model, restarted on the same reading.
    assert_eq!(PlanErrors::of(&ticks), errors);
}

/// Tests of the thorough tier (docs/testing.md).
mod thorough {
    use super::*;

    /// A policy whose plan means nothing: fitted, it foresees what it does, and its answer for now keeps every bit.
    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn a_fitted_plan_foresees_and_changes_no_duty_of_now() {
        let mut network = shipped().network().clone();
        let last = network.layers.last_mut().unwrap();
        let outputs = last.outputs;
        for (k, w) in last.weights.iter_mut().enumerate().filter(|(k, _)| k % outputs >= CHANNELS) {
            *w = 0.2 * (k as f32 * 0.37).sin();
        }
        let scrambled = shipped().with_network(network);
        let before = PlanErrors::of(&run(&scrambled));
        let fitted = scrambled.with_fitted_plan().unwrap();
        let after = PlanErrors::of(&run(&fitted));
        println!("share of nothing changes: {:?}, fitted {:?}", before.share(), after.share());
        assert!(before.share()[1] > 2.0 * MOST_SHARE, "{before:?}");
        assert!(after.share().iter().all(|share| *share <= MOST_SHARE), "{after:?}");
        let observation: Vec<f32> = (0..124).map(|k| 0.3 * (k as f32 * 0.7).sin()).collect();
        let [was, is] = [&scrambled, &fitted].map(|policy| policy.runner().outputs(&observation));
        assert_eq!(was[..CHANNELS], is[..CHANNELS]);
        // A run that starts from it starts with that answer, and without the units that only the plan needs.
        let folder = std::env::temp_dir().join(format!("plan-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let file = folder.join("fitted.onnx");
        std::fs::write(&file, fitted.to_onnx(&[]).unwrap()).unwrap();
        let start = PolicyStart::load(&file).unwrap();
        let settings = TrainingSettings::preset("correction").unwrap();
        let started = Run::begin(settings, Some(&start), &folder.join("run"), 1).unwrap().policy();
        assert_eq!(started.runner().outputs(&observation)[..CHANNELS], was[..CHANNELS]);
        assert!(started.network().widths() < fitted.network().widths(), "{:?}", started.network().widths());
        std::fs::remove_dir_all(&folder).unwrap();
        // Fitted again it is fitted anew and not widened once more.
        assert_eq!(fitted.with_fitted_plan().unwrap().network().widths(), fitted.network().widths());
    }
}
