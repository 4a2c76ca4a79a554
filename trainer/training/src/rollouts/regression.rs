//! A network moved towards answers: weighted least squares by Adam.

use environment::draws::{Purpose, stream};
use model::observation::CHANNELS;
use rand::seq::SliceRandom as _;
use sac::{Dense, Network};

use super::probe::{Episode, shape};
use crate::settings::RolloutSettings;

/// Lessons of one step.
const BATCH: usize = 128;
const BETA_1: f32 = 0.9;
const BETA_2: f32 = 0.99;
const EPSILON: f32 = 1e-6;
/// What a lesson weighs at most beside one whose curvature is the round's upper quartile.
const MOST_WEIGHT: f32 = 3.0;
/// Largest answer that is aimed for; beyond it the network's last tanh is flat.
const MOST_ANSWER: f32 = 0.98;

/// One answer to be moved.
struct Lesson<'a> {
    features: &'a [f32],
    channel: usize,
    wanted: f32,
    weight: f32,
}

/// What Adam remembers of every weight, layer by layer, weights before biases.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Moments {
    pub(super) mean: Vec<f32>,
    pub(super) square: Vec<f32>,
    pub(super) steps: u64,
}

impl Moments {
    /// Of a network that has taken no step.
    pub(super) fn of(network: &Network) -> Self {
        let count = network.layers.iter().map(|layer| layer.weights.len() + layer.bias.len()).sum();
        Moments { mean: vec![0.0; count], square: vec![0.0; count], steps: 0 }
    }

    /// Takes every weight a step down its gradient.
    fn step(&mut self, network: &mut Network, gradient: &[f32], rate: f32) {
        self.steps += 1;
        let passed = self.steps as f64;
        let mean_scale = (1.0 - f64::from(BETA_1).powf(passed)) as f32;
        let square_scale = (1.0 - f64::from(BETA_2).powf(passed)) as f32;
        let weights = network.layers.iter_mut().flat_map(|layer| layer.weights.iter_mut().chain(&mut layer.bias));
        let remembered = self.mean.iter_mut().zip(&mut self.square);
        for ((weight, (mean, square)), g) in weights.zip(remembered).zip(gradient) {
            *mean = BETA_1 * *mean + (1.0 - BETA_1) * g;
            *square = BETA_2 * *square + (1.0 - BETA_2) * g * g;
            *weight -= rate * (*mean / mean_scale) / ((*square / square_scale).sqrt() + EPSILON);
        }
    }
}

/// Moves a network towards what the branches of a round say. The same for any number of threads that flew them.
pub(super) fn learn(
    network: &mut Network,
    moments: &mut Moments,
    round: &[Episode],
    settings: &RolloutSettings,
    [seed, number]: [u64; 2],
    rate: f32,
) {
    let lessons = lessons(round, settings);
    let mut order: Vec<usize> = (0..lessons.len()).collect();
    let mut gradient = Moments::of(network).mean;
    let mut pass = Pass::default();
    for epoch in 0..settings.epochs {
        order.shuffle(&mut stream(seed, Purpose::Shuffle, number, usize::try_from(epoch).unwrap_or(0)));
        for batch in order.chunks(BATCH) {
            gradient.fill(0.0);
            for lesson in batch.iter().filter_map(|n| lessons.get(*n)) {
                pass.add_gradient(network, lesson, &mut gradient);
            }
            let share = 1.0 / batch.len() as f32;
            gradient.iter_mut().for_each(|g| *g *= share);
            moments.step(network, &gradient, rate);
        }
    }
}

/// What every tick of every branch is to answer.
fn lessons<'a>(round: &'a [Episode], settings: &RolloutSettings) -> Vec<Lesson<'a>> {
    let shape = shape(settings);
    let square: f32 = shape.iter().map(|k| k * k).sum();
    let least: [f64; CHANNELS] = std::array::from_fn(|channel| least_curvature(round, channel));
    let most = settings.most_move;
    let mut lessons = Vec::new();
    for episode in round {
        for branch in &episode.branches {
            let channel = branch.channel();
            let curvature = branch.curvature.max(least[channel]);
            let moved = (branch.slope / curvature).clamp(-most, most) as f32;
            let weight = ((curvature / least[channel]) as f32).min(MOST_WEIGHT) / square;
            for (later, share) in shape.iter().enumerate() {
                let Some((features, answered)) = episode.at(branch, later) else { continue };
                let wanted = (answered - moved * share).clamp(-MOST_ANSWER, MOST_ANSWER);
                lessons.push(Lesson { features, channel, wanted, weight });
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

/// Room for a pass through the network and back.
#[derive(Debug, Default)]
struct Pass {
    values: Vec<Vec<f32>>,
    error: Vec<f32>,
    back: Vec<f32>,
}

impl Pass {
    /// Adds the gradient of `½ w (a − â)²` to that of the batch.
    fn add_gradient(&mut self, network: &Network, lesson: &Lesson<'_>, gradient: &mut [f32]) {
        let last = network.layers.len().saturating_sub(1);
        self.values.resize(network.layers.len(), Vec::new());
        for n in 0..network.layers.len() {
            let (before, after) = self.values.split_at_mut(n);
            let input = before.last().map_or(lesson.features, Vec::as_slice);
            network.layers[n].forward(input, &mut after[0]);
            if n < last {
                after[0].iter_mut().for_each(|y| *y = y.max(0.0));
            }
        }
        self.error.clear();
        self.error.extend(self.values[last].iter().enumerate().map(|(c, z)| {
            let answer = z.tanh();
            if c == lesson.channel { lesson.weight * (answer - lesson.wanted) * (1.0 - answer * answer) } else { 0.0 }
        }));
        let mut end = gradient.len();
        for n in (0..network.layers.len()).rev() {
            let layer = &network.layers[n];
            let begin = end - layer.weights.len() - layer.bias.len();
            let input = if n == 0 { lesson.features } else { self.values[n - 1].as_slice() };
            backward(layer, input, &self.error, &mut gradient[begin..end], &mut self.back);
            std::mem::swap(&mut self.error, &mut self.back);
            end = begin;
        }
    }
}

/// Adds a layer's gradient, and puts what its inputs are blamed for into `back`; a rectified input of 0 is blamed for nothing.
fn backward(layer: &Dense, input: &[f32], error: &[f32], gradient: &mut [f32], back: &mut Vec<f32>) {
    let (weights, bias) = gradient.split_at_mut(layer.weights.len());
    bias.iter_mut().zip(error).for_each(|(g, e)| *g += e);
    back.clear();
    let rows = layer.weights.chunks_exact(layer.outputs).zip(weights.chunks_exact_mut(layer.outputs));
    for (x, (row, gradient)) in input.iter().zip(rows) {
        let mut blame = 0.0;
        if *x != 0.0 {
            for ((g, e), w) in gradient.iter_mut().zip(error).zip(row) {
                *g += e * x;
                blame += e * w;
            }
        }
        back.push(blame);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sac::{Feature, FeatureMap};

    fn network() -> Network {
        let feature = |n| Feature { plus: n, minus: None, offset: 0.0, scale: 1.0 };
        let number = |n: usize| ((n * 37 % 23) as f32 - 11.0) / 20.0;
        let layer = |inputs: usize, outputs: usize| Dense {
            inputs,
            outputs,
            weights: (0..inputs * outputs).map(number).collect(),
            bias: (0..outputs).map(|n| 0.1 * number(n + 5)).collect(),
        };
        let features = FeatureMap::new(5, (0..5).map(feature).collect()).unwrap();
        Network { features, layers: vec![layer(5, 7), layer(7, 6), layer(6, 2)], log_std: None }
    }

    fn loss(network: &Network, lesson: &Lesson<'_>) -> f64 {
        let answer = network.mean_action(lesson.features)[lesson.channel];
        0.5 * f64::from(lesson.weight) * f64::from(answer - lesson.wanted).powi(2)
    }

    /// Every weight's gradient is the difference that the weight makes to the loss of the network's own forward pass.
    #[test]
    fn the_gradient_is_that_of_the_networks_own_answers() {
        let features = [0.4, -0.7, 0.0, 0.9, -0.2];
        let network = network();
        for channel in 0..CHANNELS {
            let lesson = Lesson { features: &features, channel, wanted: 0.3, weight: 2.0 };
            let mut gradient = Moments::of(&network).mean;
            Pass::default().add_gradient(&network, &lesson, &mut gradient);
            let mut at = 0;
            for n in 0..network.layers.len() {
                let (weights, all) = (network.layers[n].weights.len(), network.layers[n].bias.len());
                for k in 0..weights + all {
                    let moved = |by: f32| {
                        let mut network = network.clone();
                        let layer = &mut network.layers[n];
                        *if k < weights { &mut layer.weights[k] } else { &mut layer.bias[k - weights] } += by;
                        loss(&network, &lesson)
                    };
                    // Answers are known to some 1e-7, so a step of 1e-3 tells slopes to about 1e-4; a larger one would cross the
                    // edges of rectifiers.
                    let slope = (moved(1e-3) - moved(-1e-3)) / 2e-3;
                    let found = f64::from(gradient[at]);
                    assert!((slope - found).abs() < 1e-3, "channel {channel}, layer {n}, {k}: {found} for {slope}");
                    at += 1;
                }
            }
        }
    }

    /// Steps go down to the answer that is wanted, and leave the other channel's loss out.
    #[test]
    fn steps_lead_to_the_answer_that_is_wanted() {
        let features = [0.4, -0.7, 0.2, 0.9, -0.2];
        let mut network = network();
        let lesson = Lesson { features: &features, channel: 1, wanted: -0.25, weight: 1.0 };
        let mut moments = Moments::of(&network);
        for _ in 0..500 {
            let mut gradient = vec![0.0; moments.mean.len()];
            Pass::default().add_gradient(&network, &lesson, &mut gradient);
            moments.step(&mut network, &gradient, 3e-3);
        }
        assert!((network.mean_action(&features)[1] + 0.25).abs() < 1e-3);
    }
}
