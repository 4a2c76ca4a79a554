//! The learner: remembers transitions, acts, and takes gradient steps.

use std::sync::{Arc, PoisonError};

use crate::batch::{Frame, Scratch, Smoothness};
use crate::feature_map::FeatureMap;
use crate::kernel::{Cpu, InstructionSet, LANES, Line, ToFeatures, WIDTH, Work};
use crate::network::{Dense, Network, NetworkError};
use crate::parameters::{Kind, NetView, Part, Plain, gather, part};
use crate::policy_sample::{MeanAction, Sample};
use crate::random::{Purpose, Random};
use crate::replay::{Replay, Transition, TransitionError};
use crate::settings::{Settings, SettingsError, Shape, TemperatureRule};
use crate::workers::{ActorUpdate, Job, Shared, Sums, Temperature, Workers, read, write};

/// Machine that the learner runs on; no bit of any result depends on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Machine {
    /// Threads in an update, at least 1 and at most a 32nd of the batch; more are not used.
    pub threads: usize,
    /// The processor's fastest set unless one is named.
    pub cpu: Cpu,
}

impl Machine {
    /// Machine with this number of threads and the fastest instructions.
    pub fn with_threads(threads: usize) -> Self {
        Self { threads, cpu: Cpu::best() }
    }

    /// The instruction set in use.
    pub fn instruction_set(&self) -> InstructionSet {
        self.cpu.instruction_set()
    }
}

/// Why a learner could not be made.
#[derive(Debug, thiserror::Error)]
pub enum LearnerError {
    /// A setting.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The system gave no thread.
    #[error("cannot start a learning thread: {0}; use fewer threads")]
    Threads(#[from] std::io::Error),
    /// Weights to begin from.
    #[error(transparent)]
    Network(#[from] NetworkError),
}

/// Means over some updates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UpdateReport {
    /// Sum of both critics' mean squared errors.
    pub critic_loss: f64,
    /// Entropy, value and smoothness together.
    pub actor_loss: f64,
    /// α after the updates.
    pub temperature: f64,
    /// Entropy of the policy at the batch, nats.
    pub entropy: f64,
    /// Mean value of the smaller critic at the policy's actions.
    pub mean_q: f64,
    /// Mean distance of (9), before its weight; 0 where it is not computed.
    pub caps_t: f64,
    /// Mean distance of (10), before its weight; 0 where it is not computed.
    pub caps_s: f64,
    /// True where all of this and all weights are numbers; where not, the run has diverged.
    pub finite: bool,
}

/// Soft Actor-Critic with CAPS.
#[derive(Debug)]
pub struct Learner {
    pub(crate) shared: Arc<Shared>,
    workers: Workers,
    /// Updates made.
    pub(crate) updates: u64,
    /// Explorations made: the time of their noise.
    pub(crate) explorations: u64,
    pub(crate) smoothness: Smoothness,
    learning_rate: f32,
    scratch: Scratch,
}

impl Learner {
    /// A learner with fresh weights and nothing remembered.
    ///
    /// # Errors
    /// A setting out of its range, features of another observation, or no thread to be had.
    pub fn new(shape: Shape, features: FeatureMap, settings: Settings, machine: Machine) -> Result<Self, LearnerError> {
        settings.check(&shape)?;
        if features.observations() != shape.observations {
            return Err(SettingsError { key: "features", rule: "must read the observation's number of entries" }.into());
        }
        if machine.threads == 0 {
            return Err(SettingsError { key: "threads", rule: "must be at least 1" }.into());
        }
        let threads = machine.threads.min(settings.batch / LANES);
        let smoothness = Smoothness { temporal: settings.lambda_temporal, spatial: settings.lambda_spatial };
        let learning_rate = settings.learning_rate;
        let replay = Replay::new(&shape, settings.replay_capacity);
        let frame = Frame::new(machine.cpu, shape, settings, features);
        let (actor, critics) = fresh(&frame, threads);
        let (TemperatureRule::Learned(start) | TemperatureRule::Fixed(start)) = frame.settings.temperature;
        let temperature = Temperature { log: start.ln(), mean: 0.0, square: 0.0 };
        let scratch = Scratch::new(&frame);
        let shared = Arc::new(Shared::new(frame, replay, critics, actor, temperature));
        let workers = Workers::new(Arc::clone(&shared))?;
        Ok(Self { shared, workers, updates: 0, explorations: 0, smoothness, learning_rate, scratch })
    }

    /// Sizes of the problem.
    pub fn shape(&self) -> &Shape {
        &self.shared.frame.shape
    }

    /// The settings it was made with (λ_T as it was then).
    pub fn settings(&self) -> &Settings {
        &self.shared.frame.settings
    }

    /// Threads in an update.
    pub fn threads(&self) -> usize {
        self.workers.threads()
    }

    /// Updates made.
    pub fn updates(&self) -> u64 {
        self.updates
    }

    /// Transitions that can be drawn.
    pub fn replay_len(&self) -> usize {
        read(&self.shared.replay).len()
    }

    /// Remembers a transition, overwriting the oldest where the replay is full.
    ///
    /// # Errors
    /// A transition of another size; nothing is kept.
    pub fn push(&mut self, transition: &Transition<'_>) -> Result<(), TransitionError> {
        write(&self.shared.replay).push(transition)
    }

    /// Numbers of the rows that the replay keeps, counted from the first that was ever written.
    pub fn replay_rows(&self) -> std::ops::Range<u64> {
        let replay = read(&self.shared.replay);
        replay.oldest()..replay.written()
    }

    /// Floats of a row of the replay.
    pub fn replay_width(&self) -> usize {
        read(&self.shared.replay).width()
    }

    /// Copies rows of the replay by their numbers `[rows × replay_width]`; those that it does not keep are left out.
    pub fn copy_replay_rows(&self, rows: std::ops::Range<u64>) -> Vec<f32> {
        read(&self.shared.replay).copy_rows(rows)
    }

    /// Puts rows `[rows × replay_width]` back under their numbers, the first of which is `first`; they must come in order.
    pub fn restore_replay_rows(&mut self, first: u64, floats: &[f32]) {
        write(&self.shared.replay).restore_rows(first, floats);
    }

    /// Sets λ_T from the next update on (fine-tuning hardens it); a value that is no weight is refused.
    ///
    /// # Errors
    /// A negative or infinite weight, or none.
    pub fn set_lambda_temporal(&mut self, lambda: f32) -> Result<(), SettingsError> {
        if !lambda.is_finite() || lambda < 0.0 {
            return Err(SettingsError { key: "lambda_temporal", rule: "must be finite and not negative" });
        }
        self.smoothness.temporal = lambda;
        Ok(())
    }

    /// Sets Adam's learning rate from the next update on. A learner that is read back has its settings' rate again: who
    /// anneals sets it before every update.
    ///
    /// # Errors
    /// A rate that is not finite and positive.
    pub fn set_learning_rate(&mut self, learning_rate: f32) -> Result<(), SettingsError> {
        if !learning_rate.is_finite() || learning_rate <= 0.0 {
            return Err(SettingsError { key: "learning_rate", rule: "must be finite and positive" });
        }
        self.learning_rate = learning_rate;
        Ok(())
    }

    /// Actions for some raw observations, one after the other: samples where it explores, else the mean.
    ///
    /// # Errors
    /// Observations that are no whole number of rows.
    pub fn act(&mut self, observations: &[f32], explore: bool) -> Result<Vec<f32>, TransitionError> {
        let frame = &self.shared.frame;
        let (width, actions) = (frame.shape.observations, frame.shape.actions);
        if !observations.len().is_multiple_of(width) {
            let found = observations.len();
            return Err(TransitionError {
                part: "observations together",
                expected: found.next_multiple_of(width),
                found,
            });
        }
        let parts: Vec<_> = self.shared.actor.iter().map(read).collect();
        let net = NetView::new(parts.iter().map(|part| &**part), Kind::Value);
        let scratch = &mut self.scratch;
        let mut out = Vec::with_capacity(observations.len() / width * actions);
        for (chunk, rows) in observations.chunks(width * LANES).enumerate() {
            frame.cpu.run(InferenceInput { frame, rows, scratch });
            scratch.actor.forward(frame.cpu, &net, &scratch.look.x, 2 * actions, &mut scratch.hidden);
            let head = &scratch.actor.output;
            if explore {
                let noise: Vec<Line> = (0..actions)
                    .flat_map(|j| {
                        let position = ((chunk * actions + j) * WIDTH) as u32;
                        frame.random.normals(Purpose::Exploration, position, self.explorations).map(Line)
                    })
                    .collect();
                let (action, stretch) = (&mut scratch.action, &mut scratch.stretch);
                frame.cpu.run(Sample { head, noise: &noise, log_std: frame.settings.log_std, action, stretch });
            } else {
                frame.cpu.run(MeanAction { head, action: &mut scratch.action });
            }
            for row in 0..rows.len() / width {
                let lane = |j: usize| scratch.action[2 * j + row / WIDTH].0[row % WIDTH];
                out.extend((0..actions).map(lane));
            }
        }
        self.explorations += u64::from(explore);
        Ok(out)
    }

    /// Does this number of updates; nothing while the replay is empty.
    pub fn update(&mut self, times: u64) -> UpdateReport {
        self.update_with(times, ActorUpdate::Learns)
    }

    /// Does this number of updates of the critics alone, under an actor and a temperature that stay as they are: critics that begin
    /// beside a policy from elsewhere first learn what it is worth (Zhou et al., WSRL, 2024). The report's figures of the
    /// actor are 0.
    pub fn update_critics(&mut self, times: u64) -> UpdateReport {
        self.update_with(times, ActorUpdate::Frozen)
    }

    fn update_with(&mut self, times: u64, actor: ActorUpdate) -> UpdateReport {
        let times = if self.replay_len() == 0 { 0 } else { times };
        *self.shared.sums.lock().unwrap_or_else(PoisonError::into_inner) = Sums::default();
        self.workers.run(Job {
            first: self.updates,
            times,
            smoothness: self.smoothness,
            learning_rate: self.learning_rate,
            actor,
        });
        self.updates += times;
        let sums = *self.shared.sums.lock().unwrap_or_else(PoisonError::into_inner);
        let mean = |sum: f64| sum / times.max(1) as f64;
        let mut report = UpdateReport {
            critic_loss: mean(sums.critic_loss),
            actor_loss: mean(sums.actor_loss),
            temperature: self.temperature(),
            entropy: mean(sums.entropy),
            mean_q: mean(sums.value),
            caps_t: mean(sums.temporal),
            caps_s: mean(sums.spatial),
            finite: self.weights_are_finite(),
        };
        let UpdateReport { critic_loss, actor_loss, temperature, entropy, mean_q, caps_t, caps_s, .. } = report;
        let all = [critic_loss, actor_loss, temperature, entropy, mean_q, caps_t, caps_s];
        report.finite &= all.iter().all(|x| x.is_finite());
        report
    }

    /// α, the weight of entropy.
    pub fn temperature(&self) -> f64 {
        f64::from(read(&self.shared.temperature).log).exp()
    }

    fn weights_are_finite(&self) -> bool {
        let fine = |part: &Part| part.iter().all(|slab| slab.is_finite());
        self.shared.actor.iter().all(|part| fine(&read(part)))
            && self.shared.critics.iter().all(|pair| read(pair).iter().all(fine))
    }

    /// The actor as it is now.
    pub fn policy(&self) -> Network {
        let parts: Vec<_> = self.shared.actor.iter().map(read).collect();
        let mut plain = gather(parts.iter().map(|part| &**part), Kind::Value);
        let actions = self.shared.frame.shape.actions;
        let head = plain.pop();
        let hidden = plain.iter().map(|layer| Dense::from_plain(layer, 0..layer.bias.len()));
        let mean = head.iter().map(|head| Dense::from_plain(head, 0..actions));
        Network {
            features: self.shared.frame.features.clone(),
            layers: hidden.chain(mean).collect(),
            log_std: head.as_ref().map(|head| Dense::from_plain(head, actions..2 * actions)),
        }
    }
}

/// Fresh weights, uniform within ±1/√inputs (the peers' default), cut into parts.
fn fresh(frame: &Frame, threads: usize) -> (Vec<Part>, Vec<[Part; 2]>) {
    let (actor_widths, critic_widths) = (frame.actor_widths(), frame.critic_widths());
    let settings = &frame.settings;
    let mut actor = drawn(frame.random, &actor_widths, 0);
    if let Some(head) = actor.last_mut() {
        head.weights.iter_mut().chain(&mut head.bias).for_each(|x| *x *= settings.last_layer_scale);
        head.bias[frame.shape.actions..].iter_mut().for_each(|x| *x += settings.initial_log_std);
    }
    let critics = [1, 2].map(|network| drawn(frame.random, &critic_widths, network));
    let fill = |mut part: Part, plain: &[Plain], kinds: &[Kind]| {
        for (slab, plain) in part.iter_mut().zip(plain) {
            kinds.iter().for_each(|&kind| slab.read_from(kind, plain));
        }
        part
    };
    let actor = (0..threads).map(|t| fill(part(&actor_widths, false, t, threads), &actor, &[Kind::Value]));
    let both = [Kind::Value, Kind::Target];
    let twins =
        (0..threads).map(|t| [0, 1].map(|c: usize| fill(part(&critic_widths, true, t, threads), &critics[c], &both)));
    (actor.collect(), twins.collect())
}

/// A network's layers, drawn; `network` keeps networks apart.
fn drawn(random: Random, widths: &[usize], network: u64) -> Vec<Plain> {
    let layer = |(l, pair): (usize, &[usize])| {
        let (inputs, rows) = (pair[0], pair[1]);
        let bound = 1.0 / (inputs as f32).sqrt();
        let time = network << 16 | l as u64;
        let count = (inputs + 1) * rows;
        let draws = (0..count as u32).step_by(WIDTH);
        let mut numbers: Vec<f32> = draws.flat_map(|at| random.uniforms(Purpose::Weights, at, time)).collect();
        numbers.truncate(count);
        numbers.iter_mut().for_each(|x| *x = (2.0 * *x - 1.0) * bound);
        let bias = numbers.split_off(inputs * rows);
        Plain { inputs, weights: numbers, bias }
    };
    widths.windows(2).enumerate().map(layer).collect()
}

/// Up to 32 raw observations as a panel of features.
struct InferenceInput<'a> {
    frame: &'a Frame,
    rows: &'a [f32],
    scratch: &'a mut Scratch,
}

impl Work for InferenceInput<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: crate::kernel::Vector>(self) {
        let look = &mut self.scratch.look;
        look.by_sample.fill(Line::ZERO);
        for (sample, observation) in self.rows.chunks_exact(self.frame.shape.observations).enumerate() {
            crate::batch::place(&self.frame.features, observation, &mut self.scratch.row, &mut look.by_sample, sample);
        }
        ToFeatures { samples: &look.by_sample, features: &mut look.x }.run::<V>();
    }
}
