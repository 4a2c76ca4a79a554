//! A learner with made-up transitions, and everything that an update of it used or left.

use crate::parameters::{Kind, Plain, gather};
use crate::random::Purpose;
use crate::settings::{Settings, Shape};
use crate::workers::{Temperature, read};
use crate::*;

/// A generator of its own (SplitMix64), so that the tests share nothing with the learner's.
pub(super) struct Dice(pub(super) u64);

impl Dice {
    /// In [-1, 1).
    pub(super) fn number(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / (1 << 23) as f32 - 1.0
    }
}

/// Size of a case.
#[derive(Clone, Copy)]
pub(super) struct Size {
    pub(super) observations: usize,
    pub(super) actions: usize,
    pub(super) hidden: [usize; 2],
    pub(super) batch: usize,
    pub(super) rows: usize,
}

/// Small, with remainders everywhere.
pub(super) const SMALL: Size = Size { observations: 11, actions: 3, hidden: [32, 64], batch: 64, rows: 100 };

/// The paper's.
pub(super) const PAPER: Size = Size { observations: 84, actions: 12, hidden: [256, 256], batch: 128, rows: 300 };

pub(super) fn shape(size: Size) -> Shape {
    Shape { observations: size.observations, goal: size.observations - 4..size.observations, actions: size.actions }
}

/// Differences, offsets and scales of every kind; one more feature than entries.
pub(super) fn features(size: Size) -> FeatureMap {
    let n = size.observations;
    let feature = |i: usize| Feature {
        plus: (i + 2) % n,
        minus: [None, Some(i * 5 % n), Some(1)][i / 3 % 3],
        offset: 0.1 * (i % 4) as f32,
        scale: 0.5 + 0.1 * (i % 5) as f32,
    };
    FeatureMap::new(n, (0..=n).map(feature).collect()).unwrap()
}

pub(super) fn settings(size: Size) -> Settings {
    let mut settings = Settings::paper(&shape(size));
    settings.hidden = size.hidden.to_vec();
    settings.batch = size.batch;
    settings.replay_capacity = size.rows;
    settings.lambda_temporal = 0.7;
    settings.lambda_spatial = 0.4;
    settings.spatial_sigma.iter_mut().enumerate().for_each(|(i, sigma)| *sigma *= 0.1 + 0.01 * i as f32);
    settings.temperature = TemperatureRule::Learned(0.3);
    // Tight enough that some samples lie outside.
    settings.log_std = [-0.6, 0.05];
    settings.seed = 5;
    settings
}

pub(super) fn learner(size: Size, settings: Settings, machine: Machine) -> Learner {
    let mut learner = Learner::new(shape(size), features(size), settings, machine).unwrap();
    push(&mut learner, size, size.rows, &mut Dice(1));
    learner
}

pub(super) fn push(learner: &mut Learner, size: Size, rows: usize, dice: &mut Dice) {
    for n in 0..rows {
        let observation: Vec<_> = (0..size.observations).map(|_| 2.0 * dice.number()).collect();
        let next_observation: Vec<_> = observation.iter().map(|x| x + 0.3 * dice.number()).collect();
        let action: Vec<_> = (0..size.actions).map(|_| dice.number()).collect();
        let (observation, next_observation, action) = (&observation, &next_observation, &action);
        let transition =
            Transition { observation, action, reward: dice.number(), next_observation, terminal: n.is_multiple_of(7) };
        learner.push(&transition).unwrap();
    }
}

/// All numbers that are learned.
#[derive(Clone, PartialEq, Debug)]
pub(super) struct Snapshot {
    /// Value, mean, square.
    pub(super) actor: [Vec<Plain>; 3],
    /// Value, mean, square, target, of each.
    pub(super) critics: [[Vec<Plain>; 4]; 2],
    pub(super) temperature: Temperature,
}

pub(super) fn snapshot(learner: &Learner) -> Snapshot {
    let actor: Vec<_> = learner.shared.actor.iter().map(read).collect();
    let critics: Vec<_> = learner.shared.critics.iter().map(read).collect();
    let kinds = [Kind::Value, Kind::Mean, Kind::Square, Kind::Target];
    let [value, mean, square, _] = kinds;
    Snapshot {
        actor: [value, mean, square].map(|kind| gather(actor.iter().map(|part| &**part), kind)),
        critics: [0, 1].map(|c| kinds.map(|kind| gather(critics.iter().map(|part| &part[c]), kind))),
        temperature: *read(&learner.shared.temperature),
    }
}

/// One sample of a batch with its noise, in f64.
#[derive(Clone, Debug)]
pub(super) struct Drawn {
    pub(super) observation: Vec<f64>,
    pub(super) next: Vec<f64>,
    pub(super) action: Vec<f64>,
    pub(super) reward: f64,
    pub(super) live: f64,
    /// Normals of the actor's action, of the target's, and of the disturbed observation.
    pub(super) noise: [Vec<f64>; 3],
}

/// Draws of update `time`.
pub(super) fn drawn(learner: &Learner, time: u64) -> Vec<Drawn> {
    let frame = &learner.shared.frame;
    let replay = read(&learner.shared.replay);
    let wide = |x: &[f32]| x.iter().map(|&x| f64::from(x)).collect::<Vec<_>>();
    let sample = |s: usize| {
        let at = frame.random.below(replay.len() as u32, Purpose::Rows, (s / 16 * 16) as u32, time)[s % 16];
        let row = replay.row(at as usize);
        let action = |which: usize| {
            let of = |j: usize| {
                let position = (s / 16 * frame.shape.actions + j) * 16;
                f64::from(frame.random.normals(Purpose::Actions, position as u32, time)[which][s % 16])
            };
            (0..frame.shape.actions).map(of).collect::<Vec<_>>()
        };
        let draws = frame.shape.observations.div_ceil(32);
        let entry = |i: usize| {
            let position = (s * draws + i / 32) * 16;
            let normals = frame.random.normals(Purpose::Observations, position as u32, time);
            f64::from(normals.as_flattened()[i % 32])
        };
        Drawn {
            observation: wide(row.observation),
            next: wide(row.next),
            action: wide(row.action),
            reward: row.reward.into(),
            live: row.live.into(),
            noise: [action(0), action(1), (0..frame.shape.observations).map(entry).collect()],
        }
    };
    (0..frame.settings.batch).map(sample).collect()
}
