//! A problem that is learned within seconds: say the number you are shown.

use super::case::Dice;
use crate::*;

/// One-step episodes: the observation is a level in ±2, the reward `−(a − level/2)²` summed over two actions.
#[test]
fn a_number_is_learned_to_be_said() {
    let shape = Shape { observations: 3, goal: 2..3, actions: 2 };
    let mut settings = Settings::paper(&shape);
    settings.hidden = vec![64, 64];
    settings.batch = 64;
    settings.replay_capacity = 20_000;
    settings.learning_rate = 1e-3;
    settings.lambda_temporal = 0.0;
    settings.lambda_spatial = 0.01;
    settings.temperature = TemperatureRule::Learned(0.1);
    settings.target_entropy = -4.0;
    settings.last_layer_scale = 0.01;
    let map = FeatureMap::identity(3).unwrap();
    let mut learner = Learner::new(shape, map, settings, Machine::with_threads(1)).unwrap();
    let mut dice = Dice(4);
    let error = |learner: &mut Learner, dice: &mut Dice| {
        let levels: Vec<f32> = (0..96).map(|_| 1.6 * dice.number()).collect();
        let rows: Vec<f32> = levels.iter().flat_map(|x| [*x, 0.0, 1.0]).collect();
        let actions = learner.act(&rows, false).unwrap();
        let off = |(action, level): (&[f32], &f32)| action.iter().map(|a| (a - level / 2.0).abs()).sum::<f32>() / 2.0;
        actions.chunks(2).zip(&levels).map(off).sum::<f32>() / 96.0
    };
    let at_first = error(&mut learner, &mut dice);
    for _ in 0..250 {
        let levels: Vec<f32> = (0..8).map(|_| 1.6 * dice.number()).collect();
        let rows: Vec<f32> = levels.iter().flat_map(|x| [*x, 0.0, 1.0]).collect();
        let actions = learner.act(&rows, true).unwrap();
        for ((level, action), row) in levels.iter().zip(actions.chunks(2)).zip(rows.chunks(3)) {
            let reward = -action.iter().map(|a| (a - level / 2.0).powi(2)).sum::<f32>();
            let transition = Transition { observation: row, action, reward, next_observation: row, terminal: true };
            learner.push(&transition).unwrap();
        }
        assert!(learner.update(8).finite);
    }
    let at_last = error(&mut learner, &mut dice);
    // An actor near zero is off by the mean of |level|/2 = 0.4; a learned one by the noise of its learning.
    assert!(at_first > 0.3 && at_last < 0.08, "{at_first} {at_last}");
}

/// Numbers that are none show in the report, and settings out of range are named.
#[test]
fn divergence_is_reported() {
    let shape = Shape { observations: 2, goal: 1..2, actions: 1 };
    let mut settings = Settings::paper(&shape);
    (settings.hidden, settings.batch, settings.replay_capacity) = (vec![32], 32, 64);
    let map = FeatureMap::identity(2).unwrap();
    let mut learner = Learner::new(shape.clone(), map.clone(), settings.clone(), Machine::with_threads(1)).unwrap();
    let report = learner.update(3);
    assert!(report.finite && learner.updates() == 0, "an empty replay teaches nothing");
    for reward in [1.0, f32::INFINITY] {
        let (observation, action) = (&[0.5, 0.5], &[0.1]);
        let transition = Transition { observation, action, reward, next_observation: observation, terminal: false };
        learner.push(&transition).unwrap();
    }
    assert!(!learner.update(3).finite);
    settings.discount = 1.5;
    let refused = Learner::new(shape, map, settings, Machine::with_threads(1)).unwrap_err();
    assert_eq!(refused.to_string(), "learner setting 'discount' must be within 0 and 1");
}

/// Adam's first step is η, whatever the gradient: a rate that is set shows in the weights.
#[test]
fn the_rate_is_the_one_that_was_set() {
    let shape = Shape { observations: 2, goal: 1..2, actions: 1 };
    let mut settings = Settings::paper(&shape);
    (settings.hidden, settings.batch, settings.replay_capacity) = (vec![32], 32, 64);
    let map = FeatureMap::identity(2).unwrap();
    let mut learner = Learner::new(shape, map, settings, Machine::with_threads(1)).unwrap();
    let (observation, action) = (&[0.5, 0.5], &[0.1]);
    let transition = Transition { observation, action, reward: 1.0, next_observation: observation, terminal: false };
    learner.push(&transition).unwrap();
    for rate in [0.0, -1e-3, f32::NAN, f32::INFINITY] {
        assert!(learner.set_learning_rate(rate).unwrap_err().to_string().contains("learning_rate"));
    }
    learner.set_learning_rate(0.125).unwrap();
    let before = learner.policy();
    learner.update(1);
    let after = learner.policy();
    let pairs = before.layers.iter().zip(&after.layers).flat_map(|(a, b)| a.bias.iter().zip(&b.bias));
    let most = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    // Less by ε over the gradient, which is 1e-3 and more somewhere.
    assert!((most - 0.125).abs() < 1e-5, "{most}");
}
