//! A network moved towards answers that it is given: weighted least squares by Adam.
//!
//! ```text
//! loss = mean over the lessons of ½ w (tanh u_j − â)²          ∂loss/∂u_j = w (a_j − â) (1 − a_j²) / B
//! ```
//!
//! The passes, the rectifiers and the optimiser are those of the learner ([`crate::trace`], [`crate::network_step`]), on one thread.

use crate::adam::AdamStep;
use crate::elementary::tanh;
use crate::kernel::{Cpu, LANES, Line, Lines, ToFeatures, WIDTH, zeroed};
use crate::network::{Dense, Network, NetworkError};
use crate::network_step::{ForwardPass, StepScratch, step_network};
use crate::parameters::{Kind, NetView, Part, Plain, gather, part};
use crate::trace::{Hidden, Trace, panel_lines};

/// One answer that a network is to give.
#[derive(Debug, Clone, Copy)]
pub struct Lesson<'a> {
    /// Inputs of the first layer.
    pub features: &'a [f32],
    /// Which of the actions.
    pub action: usize,
    /// The action that is wanted, within (-1, 1).
    pub wanted: f32,
    /// Weight of the lesson beside others.
    pub weight: f32,
}

/// Moments of Adam, of every weight.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Moments {
    /// Means of the gradients: layer by layer, output by output, biases behind the weights.
    pub mean: Vec<f32>,
    /// Means of their squares, in the same order.
    pub square: Vec<f32>,
    /// Steps taken.
    pub steps: u64,
}

impl Moments {
    /// Begins anew, for a network that has taken no step.
    pub fn of(network: &Network) -> Self {
        let count = network.layers.iter().map(|layer| layer.weights.len() + layer.bias.len()).sum();
        Moments { mean: vec![0.0; count], square: vec![0.0; count], steps: 0 }
    }
}

/// A network that takes lessons. The same bits with every instruction set.
#[derive(Debug)]
pub struct Regression {
    cpu: Cpu,
    network: Network,
    part: Part,
    steps: u64,
    panels: Vec<Panel>,
    hidden: Hidden,
    room: StepScratch,
}

/// 32 lessons.
#[derive(Debug)]
struct Panel {
    by_sample: Lines,
    features: Lines,
    trace: Trace,
}

impl Regression {
    /// Begins with a network and what Adam remembers of it, for at most `lessons` lessons a step.
    ///
    /// # Errors
    /// Layers that do not fit each other, or moments of another network.
    pub fn new(network: &Network, moments: &Moments, lessons: usize) -> Result<Self, NetworkError> {
        network.check()?;
        let count = Moments::of(network).mean.len();
        if moments.mean.len() != count || moments.square.len() != count {
            return Err(NetworkError::Layer { layer: 0, rule: "has moments of another network" });
        }
        let widths = network.widths();
        let mut part = part(&widths, false, 0, 1);
        let (mut mean, mut square) = (moments.mean.as_slice(), moments.square.as_slice());
        for (slab, layer) in part.iter_mut().zip(&network.layers) {
            let mut plain = Plain::zeroed(layer.inputs, layer.outputs);
            layer.write_to(&mut plain, 0);
            slab.read_from(Kind::Value, &plain);
            for (kind, floats) in [(Kind::Mean, &mut mean), (Kind::Square, &mut square)] {
                plain.take(floats);
                slab.read_from(kind, &plain);
            }
        }
        let panel = |_| Panel {
            by_sample: zeroed(panel_lines(widths[0])),
            features: zeroed(panel_lines(widths[0])),
            trace: Trace::new(&widths),
        };
        let panels: Vec<Panel> = (0..lessons.div_ceil(LANES).max(1)).map(panel).collect();
        let widest = widths.iter().copied().max().unwrap_or(0);
        let room = StepScratch::for_widest(widest, panels.len());
        let hidden = Hidden::new(&widths);
        Ok(Self { cpu: Cpu::best(), network: network.clone(), part, steps: moments.steps, panels, hidden, room })
    }

    /// Takes a step down the mean loss of these lessons; of more than it was made for, the first so many.
    pub fn step(&mut self, lessons: &[Lesson<'_>], rate: f32) {
        let lessons = &lessons[..lessons.len().min(self.panels.len() * LANES)];
        if lessons.is_empty() {
            return;
        }
        let share = 1.0 / lessons.len() as f32;
        let view = NetView::new(std::iter::once(&self.part), Kind::Value);
        let outputs = self.network.layers.last().map_or(0, |layer| layer.outputs);
        let used = lessons.len().div_ceil(LANES);
        for (panel, lessons) in self.panels.iter_mut().zip(lessons.chunks(LANES)) {
            panel.by_sample.fill(Line::ZERO);
            for (sample, lesson) in lessons.iter().enumerate() {
                for (n, chunk) in lesson.features.chunks(WIDTH).enumerate() {
                    panel.by_sample[n * LANES + sample].0[..chunk.len()].copy_from_slice(chunk);
                }
            }
            self.cpu.run(ToFeatures { samples: &panel.by_sample, features: &mut panel.features });
            panel.trace.forward(self.cpu, &view, &panel.features, outputs, &mut self.hidden);
            let Trace { output, gradient, .. } = &mut panel.trace;
            let Some(gradient) = gradient.last_mut() else { continue };
            gradient.fill(Line::ZERO);
            for (sample, lesson) in lessons.iter().enumerate().filter(|(_, lesson)| lesson.action < outputs) {
                let (line, lane) = (2 * lesson.action + sample / WIDTH, sample % WIDTH);
                let answer = tanh(output[line].0[lane]);
                let slope = (-answer).mul_add(answer, 1.0);
                gradient[line].0[lane] = lesson.weight * (answer - lesson.wanted) * slope * share;
            }
            panel.trace.backward(self.cpu, &view, outputs);
        }
        self.steps += 1;
        let adam = AdamStep::new(self.steps, rate, 0.0);
        let passed: Vec<_> = self.panels[..used].iter().map(|panel| (&*panel.by_sample, &panel.trace)).collect();
        let passed = ForwardPass { panels: &passed, whole: used, outputs };
        step_network(self.cpu, passed, &mut self.room, &mut self.part, adam);
    }

    /// The network as it stands, and what Adam remembers of it.
    pub fn standing(&self) -> (Network, Moments) {
        let all = |kind| gather(std::iter::once(&self.part), kind);
        let layers = all(Kind::Value).iter().map(|plain| Dense::from_plain(plain, 0..plain.bias.len())).collect();
        let flat = |kind| all(kind).into_iter().flat_map(|plain| [plain.weights, plain.bias]).flatten().collect();
        let moments = Moments { mean: flat(Kind::Mean), square: flat(Kind::Square), steps: self.steps };
        (Network { layers, ..self.network.clone() }, moments)
    }
}

impl Plain {
    /// A layer of nothing.
    fn zeroed(inputs: usize, outputs: usize) -> Self {
        Self { inputs, weights: vec![0.0; inputs * outputs], bias: vec![0.0; outputs] }
    }

    /// Takes as many numbers as there is room for off the front.
    fn take(&mut self, floats: &mut &[f32]) {
        for room in [&mut self.weights, &mut self.bias] {
            let (own, rest) = floats.split_at(room.len());
            room.copy_from_slice(own);
            *floats = rest;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feature_map::{Feature, FeatureMap};

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
        Network { features, layers: vec![layer(5, 18), layer(18, 7), layer(7, 2)], log_std: None }
    }

    /// Lessons of many kinds, more than one panel of them and no multiple of 32.
    fn features() -> Vec<[f32; 5]> {
        (0..45).map(|n: usize| std::array::from_fn(|k| ((n * 5 + k) * 41 % 29) as f32 / 14.0 - 1.0)).collect()
    }

    fn lessons<'f>(features: &'f [[f32; 5]]) -> Vec<Lesson<'f>> {
        let numbered = features.iter().enumerate();
        let lesson = |(n, features): (usize, &'f [f32; 5])| {
            let (wanted, weight) = ((n % 7) as f32 / 5.0 - 0.6, 0.5 + (n % 3) as f32);
            Lesson { features, action: n % 2, wanted, weight }
        };
        numbered.map(lesson).collect()
    }

    /// The mean loss by the network's own forward pass.
    fn loss(network: &Network, lessons: &[Lesson<'_>]) -> f64 {
        let of = |lesson: &Lesson<'_>| {
            let answer = network.mean_action(lesson.features)[lesson.action];
            0.5 * f64::from(lesson.weight) * f64::from(answer - lesson.wanted).powi(2)
        };
        lessons.iter().map(of).sum::<f64>() / lessons.len() as f64
    }

    /// After one step the mean of the gradients is a tenth of the gradient: every weight's is the difference that it makes to the
    /// loss of the network's own forward pass.
    #[test]
    fn the_gradient_is_that_of_the_networks_own_answers() {
        let (network, features) = (network(), features());
        let lessons = lessons(&features);
        let mut regression = Regression::new(&network, &Moments::of(&network), lessons.len()).unwrap();
        regression.step(&lessons, 1e-3);
        let (_, moments) = regression.standing();
        let mut at = 0;
        for n in 0..network.layers.len() {
            let (inputs, outputs) = (network.layers[n].inputs, network.layers[n].outputs);
            for k in 0..inputs * outputs + outputs {
                let moved = |by: f32| {
                    let mut network = network.clone();
                    let layer = &mut network.layers[n];
                    // Moments lie output by output, weights input by input.
                    *match k < inputs * outputs {
                        true => &mut layer.weights[k % inputs * outputs + k / inputs],
                        false => &mut layer.bias[k - inputs * outputs],
                    } += by;
                    loss(&network, &lessons)
                };
                // Answers are known to some 1e-7, so a step of 1e-3 tells slopes to about 1e-4; a larger one would cross more
                // edges of rectifiers.
                let slope = (moved(1e-3) - moved(-1e-3)) / 2e-3;
                let found = 10.0 * f64::from(moments.mean[at]);
                assert!((slope - found).abs() < 2e-3, "layer {n}, {k}: {found} for {slope}");
                at += 1;
            }
        }
        assert_eq!(at, moments.mean.len());
    }

    /// Steps go down to the answer that is wanted, in pieces as in one go, and to the bit.
    #[test]
    fn steps_lead_to_the_answer_that_is_wanted() {
        let features = [0.4, -0.7, 0.2, 0.9, -0.2];
        let lesson = [Lesson { features: &features, action: 1, wanted: -0.25, weight: 1.0 }];
        let start = network();
        let mut whole = Regression::new(&start, &Moments::of(&start), 1).unwrap();
        (0..500).for_each(|_| whole.step(&lesson, 3e-3));
        let (network, moments) = whole.standing();
        assert!((network.mean_action(&features)[1] + 0.25).abs() < 1e-3);
        let mut first = Regression::new(&start, &Moments::of(&start), 1).unwrap();
        (0..200).for_each(|_| first.step(&lesson, 3e-3));
        let (half, remembered) = first.standing();
        let mut second = Regression::new(&half, &remembered, 1).unwrap();
        (0..300).for_each(|_| second.step(&lesson, 3e-3));
        assert_eq!(second.standing(), (network, moments));
    }

    #[test]
    fn moments_of_another_network_are_refused() {
        assert!(Regression::new(&network(), &Moments::default(), 32).is_err());
    }
}
