//! Lessons from the branches of a round: which answers the network is to give, and giving them.

use environment::draws::{Purpose, stream};
use model::observation::CHANNELS;
use rand::seq::SliceRandom as _;
use sac::{Lesson, Moments, Network, NetworkError, Regression};

use super::probe::{Episode, shape};
use crate::settings::RolloutSettings;

/// Lessons of one step.
const BATCH: usize = 128;
/// Largest weight of a lesson, beside one whose curvature is the round's upper quartile.
const MOST_WEIGHT: f32 = 3.0;
/// Largest answer that is aimed for; beyond it the network's last tanh is flat.
const MOST_ANSWER: f32 = 0.98;

/// The network moved towards what the branches of a round say, and what Adam remembers then. The same for any number of threads
/// that flew them.
///
/// # Errors
/// Moments of another network.
pub(super) fn learn(
    network: &Network,
    moments: &Moments,
    round: &[Episode],
    settings: &RolloutSettings,
    [seed, number]: [u64; 2],
    rate: f32,
) -> Result<(Network, Moments), NetworkError> {
    let lessons = lessons(round, settings);
    let mut order: Vec<usize> = (0..lessons.len()).collect();
    let mut regression = Regression::new(network, moments, BATCH)?;
    let mut batch = Vec::with_capacity(BATCH);
    for epoch in 0..settings.epochs {
        order.shuffle(&mut stream(seed, Purpose::Shuffle, number, usize::try_from(epoch).unwrap_or(0)));
        for some in order.chunks(BATCH) {
            batch.clear();
            batch.extend(some.iter().filter_map(|n| lessons.get(*n)).copied());
            regression.step(&batch, rate);
        }
    }
    Ok(regression.standing())
}

/// Lessons of all branches: the answer that each of their ticks is to give.
fn lessons<'a>(round: &'a [Episode], settings: &RolloutSettings) -> Vec<Lesson<'a>> {
    let shape = shape(settings);
    let square: f32 = shape.iter().map(|k| k * k).sum();
    let least: [f64; CHANNELS] = std::array::from_fn(|channel| least_curvature(round, channel));
    let most = settings.most_move;
    let mut lessons = Vec::new();
    for episode in round {
        for branch in &episode.branches {
            let action = branch.channel();
            let curvature = branch.curvature.max(least[action]);
            let moved = (branch.slope / curvature).clamp(-most, most) as f32;
            let weight = ((curvature / least[action]) as f32).min(MOST_WEIGHT) / square;
            for (later, share) in shape.iter().enumerate() {
                let Some((features, answered)) = episode.at(branch, later) else { continue };
                let wanted = (answered - moved * share).clamp(-MOST_ANSWER, MOST_ANSWER);
                lessons.push(Lesson { features, action, wanted, weight });
            }
        }
    }
    lessons
}

/// h̄: where a valve sticks in its play the cost has no curvature, or a negative one, and a step by it would go anywhere.
fn least_curvature(round: &[Episode], channel: usize) -> f64 {
    let branches = round.iter().flat_map(|episode| &episode.branches);
    let mut sizes: Vec<f64> =
        branches.filter(|branch| branch.channel() == channel).map(|branch| branch.curvature.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    sizes.get(sizes.len() * 3 / 4).copied().unwrap_or(1.0).max(1e-3)
}
