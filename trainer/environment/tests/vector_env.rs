//! The env against the same rigs flown one by one, and against itself.

#![allow(clippy::unwrap_used)] // a test's own set-up; clippy knows tests only by their attribute

use std::sync::Arc;

use environment::closed_loop::{FlightPlan, PolicyController};
use environment::{EnvironmentSettings, RigDraw, SIDE_BY_SIDE, Score, VectorEnv, fly};
use law::{Fallback, FallbackSettings, PolicyLaw};
use model::observation::{ACTION_LEN, ObservationLayout};
use model::rig::Rig;
use model::steady::SteadyMap;
use proto::reference::Reference;

fn env(contract: ObservationLayout, rig: &str, seed: u64) -> VectorEnv {
    let settings = EnvironmentSettings { episode_s: 10.0, ..EnvironmentSettings::default() };
    let model = Rig::builtin("dual_pressure").unwrap();
    let draw = RigDraw::new(&Rig::builtin(rig).unwrap(), &settings).unwrap();
    VectorEnv::new(draw, &model, contract, true, &settings, seed).unwrap()
}

/// A correction of nothing lets the fallback fly; it must hold every drawn reference once it has got there.
#[test]
fn the_fallback_follows_drawn_references() {
    let mut env = env(ObservationLayout::Correction, "dual_pressure", 5);
    let mut errors: Vec<f64> = Vec::new();
    for episode in 0..4 {
        env.begin(episode).unwrap();
        let mut tick = 0;
        while !env.is_truncated() {
            let step = env.step(&[0.0; SIDE_BY_SIDE * ACTION_LEN]);
            assert!(step.terminal.iter().all(|t| !t), "the fallback left the envelope");
            tick += 1;
            if tick > 250 {
                errors.extend(step.error_kpa.iter().map(|e| e[0].abs().max(e[1].abs())));
            }
        }
    }
    errors.sort_by(f64::total_cmp);
    let median = errors[errors.len() / 2];
    assert!(median < 0.3, "half of all ticks are within {median} kPa");
}

/// All duties shut drive the negative chamber out of its envelope: terminal there, and flying again afterwards.
#[test]
fn leaving_the_envelope_is_terminal_and_the_rig_starts_anew() {
    let mut env = env(ObservationLayout::Paper, "dual_pressure", 6);
    let mut tripped = [0usize; SIDE_BY_SIDE];
    while !env.is_truncated() {
        let step = env.step(&[-1.0; SIDE_BY_SIDE * ACTION_LEN]);
        for (lane, count) in tripped.iter_mut().enumerate() {
            if step.terminal[lane] {
                *count += 1;
                assert!(step.rewards[lane] < -100.0);
                let row = env.observations().chunks_exact(84).nth(lane).unwrap();
                assert!(row[21] > -94.0 && row[20] < 159.0, "lane {lane} starts anew at {:?}", &row[20..22]);
            }
        }
    }
    assert!(tripped.iter().all(|n| *n > 0), "{tripped:?}");
}

#[test]
fn an_episode_follows_from_seed_and_number_alone() {
    let run = |env: &mut VectorEnv, number: u64| {
        env.begin(number).unwrap();
        let mut sum = Vec::new();
        for tick in 0..100 {
            let action = ((tick % 13) as f32 - 6.0) / 10.0;
            sum.extend(env.step(&[action; SIDE_BY_SIDE * ACTION_LEN]).rewards);
        }
        sum
    };
    let mut first = env(ObservationLayout::Correction, "bench", 7);
    let before = run(&mut first, 3);
    run(&mut first, 4);
    assert_eq!(before, run(&mut first, 3), "again by the same env");
    assert_eq!(before, run(&mut env(ObservationLayout::Correction, "bench", 7), 3), "by another env of the same seed");
    assert_ne!(before, run(&mut env(ObservationLayout::Correction, "bench", 8), 3), "by another seed");
}

/// The closed loop flies the fallback as the law's own test does; a policy that corrects nothing is the fallback with a
/// faster integral, and tracks no worse.
#[test]
fn a_flight_with_no_correction_is_no_worse_than_the_fallbacks() {
    let model = Rig::builtin("dual_pressure").unwrap();
    let bench = Rig::builtin("bench").unwrap();
    let map = Arc::new(SteadyMap::new(&model).unwrap());
    let reference = Reference::paper();
    let plan = FlightPlan {
        rig: &bench,
        model: Some(&model),
        reference: &reference,
        seconds: 20.0,
        noise_v_rms: 0.24e-3,
        seed: 1,
    };
    let plain = fly(&plan, &mut Fallback::new(Arc::clone(&map), FallbackSettings::default())).unwrap();
    let law = PolicyLaw::new(map, ObservationLayout::Correction);
    let corrected = fly(&plan, &mut PolicyController::new(law, |_: &[f32]| [0.0; ACTION_LEN])).unwrap();
    assert_eq!(plain.ticks[0], corrected.ticks[0]);
    let [score, corrected] = [plain, corrected].map(|flown| Score::of(&flown.ticks));
    for (plain, corrected) in score.rmse_kpa.iter().zip(corrected.rmse_kpa) {
        assert!(corrected < 1.02 * plain, "{corrected} {plain}");
    }
    // The first reversals, with the play not learned yet, are most of these twenty seconds.
    assert!(score.rmse_kpa[0] < 0.6 && score.rmse_kpa[1] < 0.6, "{score:?}");
}

/// On a rig whose positive sensor lags by 160 ms a score is of readings less the lagged reference, here by Euler steps of 20 µs.
#[test]
fn behind_a_late_sensor_a_score_is_of_what_it_shows_of_chambers_on_the_reference() {
    let lag = "[[mechanisms]]\nid = \"sensor_lag\"\ncomponent = \"sensor_pos\"\ntime_constant_ms = 160.0\n";
    let late = Rig::from_toml(&format!("{}\n{lag}", model::rig::DUAL_PRESSURE)).unwrap();
    let plain = Rig::builtin("dual_pressure").unwrap();
    let map = Arc::new(SteadyMap::new(&plain).unwrap());
    let reference = Reference::paper();
    let flown = |rig| {
        let plan = FlightPlan { rig, model: None, reference: &reference, seconds: 12.0, noise_v_rms: 0.24e-3, seed: 1 };
        fly(&plan, &mut Fallback::new(Arc::clone(&map), FallbackSettings::default())).unwrap().ticks
    };
    let ticks = flown(&late);
    let (mut lagged, steps) = (ticks[0].goal_kpa[0], 1000);
    let (mut squares, mut count, mut farthest_kpa) = (0.0, 0.0, 0.0_f64);
    for pair in ticks.windows(2) {
        let [from, to] = [pair[0].goal_kpa[0], pair[1].goal_kpa[0]];
        for step in 0..steps {
            let at = from + (to - from) * f64::from(step) / f64::from(steps);
            lagged += 0.02 / f64::from(steps) / 0.16 * (at - lagged);
        }
        assert!((pair[1].shown_goal_kpa[0] - lagged).abs() < 1e-3, "{pair:?}, {lagged}");
        assert_eq!(pair[1].shown_goal_kpa[1], pair[1].goal_kpa[1]);
        farthest_kpa = farthest_kpa.max((to - lagged).abs());
    }
    assert!(farthest_kpa > 0.2, "the reference moves: {farthest_kpa}");
    for tick in &ticks[250..] {
        squares += (tick.measured_kpa[0] - tick.shown_goal_kpa[0]).powi(2);
        count += 1.0;
    }
    assert!((Score::of(&ticks).rmse_kpa[0] - (squares / count).sqrt()).abs() < 1e-12);
    assert!(flown(&plain).iter().all(|tick| tick.shown_goal_kpa == tick.goal_kpa));
}

/// A tick of 10 ms would let half the time pass that the law believes, as plant or as model: both ways to fly say so by the key.
#[test]
fn a_rig_with_another_tick_is_not_flown() {
    let paper = Rig::builtin("dual_pressure").unwrap();
    let mut quick = paper.clone();
    quick.integrator.tick_ms = 10.0;
    let settings = EnvironmentSettings { episode_s: 1.0, ..EnvironmentSettings::default() };
    let map = Arc::new(SteadyMap::new(&paper).unwrap());
    for (rig, model) in [(&quick, &paper), (&paper, &quick)] {
        let draw = RigDraw::new(rig, &settings).unwrap();
        let env = VectorEnv::new(draw, model, ObservationLayout::Correction, true, &settings, 1);
        let reference = Reference::paper();
        let plan =
            FlightPlan { rig, model: Some(model), reference: &reference, seconds: 1.0, noise_v_rms: 0.0, seed: 1 };
        let flown = fly(&plan, &mut Fallback::new(Arc::clone(&map), FallbackSettings::default()));
        for error in [env.err().unwrap(), flown.err().unwrap()] {
            assert!(error.to_string().contains("integrator.tick_ms: a tick of 10 ms"), "{error}");
        }
    }
}
