//! Every rig that diagnosis can write can be trained on: each mechanism of its library, at each place, under each preset.

#![allow(clippy::unwrap_used, clippy::panic)] // a test's own set-up; clippy knows tests only by their attribute

use environment::{RigDraw, SIDE_BY_SIDE, VectorEnv};
use model::mechanism::candidates;
use model::observation::ACTION_LEN;
use model::rig::Rig;
use training::TrainingSettings;

/// Ticks that each rig is driven for.
const TICKS: usize = 12;

/// Eight rigs drawn around `rig`, driven with it as the model; what they read must stay finite.
fn drive(settings: &TrainingSettings, rig: &Rig, what: &str) {
    let draw = RigDraw::new(rig, &settings.environment).unwrap_or_else(|error| panic!("{what}: {error}"));
    let mut environment = settings.environment.clone();
    environment.warm_up_s = 0.0;
    let mut env = VectorEnv::new(draw, rig, settings.contract(), true, &environment, 1)
        .unwrap_or_else(|error| panic!("{what}: {error}"));
    for tick in 0..TICKS {
        let action = if tick % 4 < 2 { 0.3 } else { -0.3 };
        let step = env.step(&[action; SIDE_BY_SIDE * ACTION_LEN]);
        assert!(step.rewards.iter().all(|r| r.is_finite()), "{what}, tick {tick}");
        assert!(env.observations().iter().all(|o| o.is_finite()), "{what}, tick {tick}");
    }
}

#[test]
fn every_mechanism_that_diagnosis_names_can_be_trained_on() {
    let rig = Rig::builtin("dual_pressure").unwrap();
    let settings = TrainingSettings::preset("correction").unwrap();
    let mut ids = std::collections::BTreeSet::new();
    for candidate in candidates(&rig) {
        let strongest: Vec<f64> = candidate.parameters.iter().filter_map(|p| p.starts.last().copied()).collect();
        ids.insert(candidate.id);
        let what = format!("{}{} on {}", candidate.id, candidate.form, candidate.component);
        drive(&settings, &candidate.on(&rig, &strongest), &what);
    }
    // All of the library but what a person states or data shape (`model::mechanism::candidates`).
    assert!(ids.len() >= 23, "{ids:?}");
}

/// Several at once, as diagnosis writes them, under every preset that draws; the ones that presets draw, too.
#[test]
fn several_found_mechanisms_go_together_with_what_presets_draw() {
    let text = Rig::builtin_text("dual_pressure").unwrap().to_owned()
        + "[[mechanisms]]\nid = \"command_delay\"\ncomponent = \"valve_pos\"\ndelay_ms = 60.0\n\
           [[mechanisms]]\nid = \"command_delay\"\ncomponent = \"valve_neg\"\ndelay_ms = 60.0\n\
           [[mechanisms]]\nid = \"valve_lag\"\ncomponent = \"valve_pos\"\ntime_constant_ms = 80.0\n\
           [[mechanisms]]\nid = \"valve_hysteresis\"\ncomponent = \"valve_neg\"\nhalf_width_duty = 0.03\n\
           [[mechanisms]]\nid = \"chamber_thermal\"\ncomponent = \"positive\"\nwall_conductance_w_per_k = 0.9\n\
           [[mechanisms]]\nid = \"residual_response\"\ncomponent = \"pos\"\nnatural_frequency_hz = 3.0\ndamping_ratio = 0.4\nshare = 0.5\n";
    let sensor = Rig::builtin("dual_pressure").unwrap().sensors.keys().next().unwrap().clone();
    let rig = Rig::from_toml(&text.replace("\"pos\"", &format!("\"{sensor}\""))).unwrap();
    for preset in ["paper", "paper-drawn", "correction"] {
        drive(&TrainingSettings::preset(preset).unwrap(), &rig, preset);
    }
}
