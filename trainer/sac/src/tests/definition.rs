//! Gradients against finite differences of the losses as they are defined, in f64.
//!
//! Central differences with a step of 1e-7 are good to about 1e-9 (and cross no rectifier's kink but by a rare
//! chance); what is compared with them was summed in f32 over up to 192 samples: 2e-5 of a layer's largest gradient
//! is some dozen roundings.

use super::case::*;
use crate::parameters::Plain;
use crate::*;

const TOLERANCE: f64 = 2e-5;

/// A network in f64: for each layer `weights[n][k]` and biases.
type Net = Vec<(Vec<Vec<f64>>, Vec<f64>)>;

fn net(plain: &[Plain]) -> Net {
    let wide = |x: &[f32]| x.iter().map(|&x| f64::from(x)).collect::<Vec<f64>>();
    plain.iter().map(|l| (l.weights.chunks(l.inputs).map(wide).collect(), wide(&l.bias))).collect()
}

fn run(net: &Net, x: &[f64]) -> Vec<f64> {
    let mut x = x.to_vec();
    for (l, (weights, bias)) in net.iter().enumerate() {
        let dot = |row: &Vec<f64>| row.iter().zip(&x).map(|(w, x)| w * x).sum::<f64>();
        x = weights.iter().zip(bias).map(|(row, b)| dot(row) + b).collect();
        if l + 1 < net.len() {
            x.iter_mut().for_each(|x| *x = x.max(0.0));
        }
    }
    x
}

fn map(features: &FeatureMap, x: &[f64]) -> Vec<f64> {
    let feature = |f: &Feature| (x[f.plus] - f.minus.map_or(0.0, |m| x[m]) - f64::from(f.offset)) * f64::from(f.scale);
    features.features().iter().map(feature).collect()
}

struct Definition<'a> {
    settings: &'a Settings,
    features: &'a FeatureMap,
    shape: &'a Shape,
    alpha: f64,
    batch: &'a [Drawn],
}

impl Definition<'_> {
    /// Action and its log-probability, by the density of u and the slope of tanh.
    fn sample(&self, actor: &Net, x: &[f64], noise: &[f64]) -> (Vec<f64>, f64) {
        let head = run(actor, x);
        let n = noise.len();
        let (mut action, mut log_probability) = (Vec::new(), 0.0);
        for j in 0..n {
            let [low, high] = self.settings.log_std.map(f64::from);
            let std = head[n + j].clamp(low, high).exp();
            let u = head[j] + std * noise[j];
            let density = (-0.5 * noise[j].powi(2)).exp() / (std * std::f64::consts::TAU.sqrt());
            log_probability += density.ln() - (1.0 - u.tanh().powi(2)).ln();
            action.push(u.tanh());
        }
        (action, log_probability)
    }

    fn value(&self, critic: &Net, action: &[f64], x: &[f64]) -> f64 {
        run(critic, &[action, x].concat())[0]
    }

    fn targets(&self, actor: &Net, slow: &[Net; 2]) -> Vec<f64> {
        let target = |d: &Drawn| {
            let x = map(self.features, &d.next);
            let (action, log_probability) = self.sample(actor, &x, &d.noise[1]);
            let value = self.value(&slow[0], &action, &x).min(self.value(&slow[1], &action, &x));
            d.reward + d.live * f64::from(self.settings.discount) * (value - self.alpha * log_probability)
        };
        self.batch.iter().map(target).collect()
    }

    fn critic_loss(&self, critic: &Net, targets: &[f64]) -> f64 {
        let error =
            |(d, y): (&Drawn, &f64)| (self.value(critic, &d.action, &map(self.features, &d.observation)) - y).powi(2);
        self.batch.iter().zip(targets).map(error).sum::<f64>() / self.batch.len() as f64
    }

    fn distance(&self, actor: &Net, a: &[f64], b: &[f64]) -> f64 {
        let mu = |x: &[f64]| run(actor, &map(self.features, x))[..self.shape.actions].to_vec();
        let square = |(a, b): (f64, f64)| (a.tanh() - b.tanh()).powi(2);
        (mu(a).into_iter().zip(mu(b)).map(square).sum::<f64>() + 1e-8).sqrt()
    }

    /// The loss, and the means of log-probability and of both distances.
    fn actor_loss(&self, actor: &Net, critics: &[Net; 2]) -> (f64, [f64; 3]) {
        let n = self.batch.len() as f64;
        let (mut loss, mut means) = (0.0, [0.0; 3]);
        for d in self.batch {
            let x = map(self.features, &d.observation);
            let (action, log_probability) = self.sample(actor, &x, &d.noise[0]);
            let value = self.value(&critics[0], &action, &x).min(self.value(&critics[1], &action, &x));
            let mut next = d.next.clone();
            let goal = self.shape.goal.clone();
            next[goal.clone()].copy_from_slice(&d.observation[goal]);
            let disturb = |(i, x): (usize, &f64)| x + f64::from(self.settings.spatial_sigma[i]) * d.noise[2][i];
            let near: Vec<f64> = d.observation.iter().enumerate().map(disturb).collect();
            let temporal = self.distance(actor, &d.observation, &next);
            let spatial = self.distance(actor, &d.observation, &near);
            let smooth =
                f64::from(self.settings.lambda_temporal) * temporal + f64::from(self.settings.lambda_spatial) * spatial;
            loss += (self.alpha * log_probability - value + smooth) / n;
            means.iter_mut().zip([log_probability, temporal, spatial]).for_each(|(m, x)| *m += x / n);
        }
        (loss, means)
    }
}

/// Compares some gradients of every layer with differences of `loss`; `means` are Adam's after the first step, that
/// is a tenth of the gradient.
fn compare(name: &str, net: &Net, means: &[Plain], loss: impl Fn(&Net) -> f64) {
    const STEP: f64 = 1e-7;
    for (l, plain) in means.iter().enumerate() {
        let largest = |x: &[f32]| x.iter().fold(0.0f64, |a, &x| a.max(f64::from(x).abs())) / 0.1;
        let (weights, biases) = (plain.weights.len(), plain.bias.len());
        let dice = &mut Dice(l as u64);
        let mut pick = |n: usize| ((f64::from(dice.number()) * 0.5 + 0.5) * n as f64) as usize;
        let (mut worst, mut seen) = (0.0f64, 0);
        for trial in 0..40 {
            let is_bias = trial % 4 == 0;
            let at = pick(if is_bias { biases } else { weights });
            let moved = |by: f64| {
                let mut net = net.clone();
                let place =
                    if is_bias { &mut net[l].1[at] } else { &mut net[l].0[at / plain.inputs][at % plain.inputs] };
                *place += by;
                loss(&net)
            };
            let expected = (moved(STEP) - moved(-STEP)) / (2.0 * STEP);
            let numbers = if is_bias { &plain.bias } else { &plain.weights };
            let got = f64::from(numbers[at]) / 0.1;
            seen += usize::from(expected.abs() > 1e-3 * largest(numbers));
            worst = worst.max((got - expected).abs() / largest(numbers));
        }
        assert!(worst < TOLERANCE, "{name}, layer {l}: {worst:.1e}");
        assert!(seen > 10, "{name}, layer {l}: most gradients are zero");
    }
}

fn check(settings: Settings) {
    let mut learner = learner(SMALL, settings, Machine::with_threads(2));
    let before = snapshot(&learner);
    let batch = drawn(&learner, 0);
    let report = learner.update(1);
    let after = snapshot(&learner);
    let alpha = f64::from(before.temperature.log).exp();
    let frame = &learner.shared.frame;
    let (settings, features, shape) = (&frame.settings, &frame.features, &frame.shape);
    let definition = Definition { settings, features, shape, alpha, batch: &batch };
    let actor = net(&before.actor[0]);
    let critics = [0, 1].map(|c| net(&before.critics[c][0]));
    let slow = [0, 1].map(|c| net(&before.critics[c][3]));
    let targets = definition.targets(&actor, &slow);
    let mut critic_loss = 0.0;
    for (c, critic) in critics.iter().enumerate() {
        critic_loss += definition.critic_loss(critic, &targets);
        let loss = |critic: &Net| definition.critic_loss(critic, &targets);
        compare(&format!("critic {c}"), critic, &after.critics[c][1], loss);
    }
    // The actor learns from the critics that have just learned.
    let critics = [0, 1].map(|c| net(&after.critics[c][0]));
    compare("actor", &actor, &after.actor[1], |actor| definition.actor_loss(actor, &critics).0);
    let (actor_loss, [log_probability, temporal, spatial]) = definition.actor_loss(&actor, &critics);
    for (name, got, expected) in [
        ("critic loss", report.critic_loss, critic_loss),
        ("actor loss", report.actor_loss, actor_loss),
        ("entropy", report.entropy, -log_probability),
        ("temporal", report.caps_t, if settings.lambda_temporal > 0.0 { temporal } else { 0.0 }),
        ("spatial", report.caps_s, if settings.lambda_spatial > 0.0 { spatial } else { 0.0 }),
    ] {
        assert!((got - expected).abs() < 1e-5 * expected.abs().max(1.0), "{name}: {got} {expected}");
    }
    let gradient = -alpha * (log_probability + f64::from(settings.target_entropy));
    let got = f64::from(after.temperature.mean) / 0.1;
    let expected = if matches!(settings.temperature, TemperatureRule::Learned(_)) { gradient } else { 0.0 };
    assert!((got - expected).abs() < 1e-5 * gradient.abs(), "temperature: {got} {expected}");
    assert!(report.finite);
}

#[test]
fn gradients_are_slopes_of_the_losses() {
    check(settings(SMALL));
}

#[test]
fn without_caps_and_with_a_fixed_temperature_too() {
    let mut settings = settings(SMALL);
    (settings.lambda_temporal, settings.lambda_spatial) = (0.0, 0.0);
    settings.temperature = TemperatureRule::Fixed(0.1);
    check(settings);
}

#[test]
fn with_one_caps_term_alone() {
    let mut settings = settings(SMALL);
    settings.lambda_temporal = 0.0;
    check(settings);
}

/// Entries outside the bounds of the standard deviation exist in the case above, or it would not test them.
#[test]
fn the_case_reaches_the_bounds() {
    let learner = learner(SMALL, settings(SMALL), Machine::with_threads(1));
    let actor = net(&snapshot(&learner).actor[0]);
    let [low, high] = learner.settings().log_std.map(f64::from);
    let heads = drawn(&learner, 0).into_iter().map(|d| run(&actor, &map(&features(SMALL), &d.observation)));
    let log_std: Vec<f64> = heads.flat_map(|head| head[SMALL.actions..].to_vec()).collect();
    assert!(log_std.iter().any(|&x| x < low || x > high) && log_std.iter().any(|&x| x > low && x < high));
}
