//! A thread's share of the batch: panels of 32 samples with everything that is computed for them.

use crate::feature_map::FeatureMap;
use crate::kernel::{Cpu, LANES, Line, Lines, ToFeatures, WIDTH, Work, lines_for, prefetch, zeroed};
use crate::random::{Purpose, Random};
use crate::replay::Replay;
use crate::settings::{Settings, Shape};
use crate::trace::{Hidden, Trace, panel_lines};

/// Parts that do not change while a learner lives.
#[derive(Debug)]
pub(crate) struct Frame {
    pub(crate) cpu: Cpu,
    pub(crate) shape: Shape,
    pub(crate) settings: Settings,
    pub(crate) features: FeatureMap,
    pub(crate) random: Random,
    /// σ of CAPS' spatial term, padded to whole draws of normals.
    sigma: Vec<f32>,
}

impl Frame {
    pub(crate) fn new(cpu: Cpu, shape: Shape, settings: Settings, features: FeatureMap) -> Self {
        let mut sigma = settings.spatial_sigma.clone();
        sigma.resize(sigma.len().next_multiple_of(LANES), 0.0);
        let random = Random::new(settings.seed);
        Self { cpu, shape, settings, features, random, sigma }
    }

    /// Widths of the actor's layers: mean and logarithm of the standard deviation of each action come out.
    pub(crate) fn actor_widths(&self) -> Vec<usize> {
        self.widths(self.features.features().len(), 2 * self.shape.actions)
    }

    /// Widths of a critic's layers: the action goes in first, so that its gradient is that of the first inputs.
    pub(crate) fn critic_widths(&self) -> Vec<usize> {
        self.widths(self.shape.actions + self.features.features().len(), 1)
    }

    fn widths(&self, inputs: usize, outputs: usize) -> Vec<usize> {
        [&[inputs], self.settings.hidden.as_slice(), &[outputs]].concat()
    }
}

/// The actor's three inputs of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum View {
    /// `(s_t, g_t)`
    Here = 0,
    /// `(s_(t+1), g_t)`, for (9).
    Next = 1,
    /// `(s_t + noise, g_t)`, for (10).
    Near = 2,
}

/// The weights of (8).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Smoothness {
    pub(crate) temporal: f32,
    pub(crate) spatial: f32,
}

impl Smoothness {
    /// Tells whether this view of the samples takes part.
    pub(crate) fn wants(self, view: View) -> bool {
        match view {
            View::Here => true,
            View::Next => self.temporal > 0.0,
            View::Near => self.spatial > 0.0,
        }
    }
}

/// All views.
pub(crate) const VIEWS: [View; 3] = [View::Here, View::Next, View::Near];

/// One number for each sample of a panel.
pub(crate) type Lanes = [Line; 2];

pub(crate) const NO_LANES: Lanes = [Line::ZERO; 2];

/// Figures of each sample that are reported.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Records {
    pub(crate) critic_loss: Lanes,
    pub(crate) actor_loss: Lanes,
    pub(crate) log_probability: Lanes,
    pub(crate) value: Lanes,
    pub(crate) temporal: Lanes,
    pub(crate) spatial: Lanes,
}

/// The actor's input at one view of a panel, feature by feature and sample by sample.
#[derive(Debug)]
pub(crate) struct Glance {
    pub(crate) x: Lines,
    pub(crate) by_sample: Lines,
}

impl Glance {
    fn new(widths: &[usize]) -> Self {
        let panel = || zeroed(panel_lines(widths[0]));
        Self { x: panel(), by_sample: panel() }
    }
}

/// 32 samples.
#[derive(Debug)]
pub(crate) struct Panel {
    /// Number of the panel in the batch.
    pub(crate) number: usize,
    pub(crate) reward: Lanes,
    pub(crate) live: Lanes,
    /// Normals for the actor's step and for the targets, two lines an action.
    pub(crate) noise: [Lines; 2],
    /// The actor's inputs at the three views.
    pub(crate) views: [Glance; 3],
    /// The network that learns: one critic after the other in the first, then the actor at the three views.
    pub(crate) traces: [Trace; 3],
    /// The actions drawn at the first view, `σ ε` of each, and what the critics say about them; two lines each.
    pub(crate) action: Lines,
    pub(crate) stretch: Lines,
    pub(crate) action_gradient: Lines,
    /// Actions and features, the critics' input.
    pub(crate) joint: Lines,
    pub(crate) joint_by_sample: Lines,
    /// The critics as the actor's critics.
    pub(crate) critics: [Trace; 2],
    /// `(s_(t+1), g_(t+1))`, what the actor draws there, and the critics' input with that.
    pub(crate) next: Glance,
    pub(crate) next_log_probability: Lanes,
    pub(crate) next_joint: Lines,
    /// Values by the slow critics.
    pub(crate) slow_value: [Lanes; 2],
    pub(crate) records: Records,
}

/// Buffers that the panels of a thread share, for passes that need no way back.
#[derive(Debug)]
pub(crate) struct Scratch {
    /// For acting.
    pub(crate) look: Glance,
    /// The actor in acting and at `(s_(t+1), g_(t+1))`.
    pub(crate) actor: Trace,
    pub(crate) slow: Trace,
    /// Samples that a judge passes back, put together from several panels.
    pub(crate) judge: Trace,
    pub(crate) hidden: Hidden,
    /// Gradient of a critic by the actions, two lines each.
    pub(crate) action_gradient: Lines,
    /// The sampled actions and `σ ε` of each, two lines each.
    pub(crate) action: Lines,
    pub(crate) stretch: Lines,
    /// One observation and its features.
    observation: Vec<f32>,
    pub(crate) row: Vec<f32>,
}

/// A thread's panels.
#[derive(Debug)]
pub(crate) struct Block {
    pub(crate) panels: Vec<Panel>,
    pub(crate) scratch: Scratch,
}

impl Block {
    pub(crate) fn new(frame: &Frame, thread: usize, threads: usize) -> Self {
        let all = frame.settings.batch / LANES;
        let panels = (all * thread / threads..all * (thread + 1) / threads).map(|n| Panel::new(frame, n)).collect();
        Self { panels, scratch: Scratch::new(frame) }
    }
}

impl Panel {
    fn new(frame: &Frame, number: usize) -> Self {
        let (actor, critic) = (frame.actor_widths(), frame.critic_widths());
        let joint = || zeroed(panel_lines(critic[0]));
        let actions = || zeroed(2 * frame.shape.actions);
        Self {
            number,
            reward: NO_LANES,
            live: NO_LANES,
            noise: [(); 2].map(|()| zeroed(2 * frame.shape.actions)),
            views: [(); 3].map(|()| Glance::new(&actor)),
            traces: [(); 3].map(|()| Trace::new(&actor)),
            action: actions(),
            stretch: actions(),
            action_gradient: actions(),
            joint: joint(),
            joint_by_sample: joint(),
            critics: [(); 2].map(|()| Trace::passing(&critic)),
            next: Glance::new(&actor),
            next_log_probability: NO_LANES,
            next_joint: joint(),
            slow_value: [NO_LANES; 2],
            records: Records {
                critic_loss: NO_LANES,
                actor_loss: NO_LANES,
                log_probability: NO_LANES,
                value: NO_LANES,
                temporal: NO_LANES,
                spatial: NO_LANES,
            },
        }
    }
}

impl Scratch {
    pub(crate) fn new(frame: &Frame) -> Self {
        let (actor, critic) = (frame.actor_widths(), frame.critic_widths());
        let actions = || zeroed(2 * frame.shape.actions);
        Self {
            look: Glance::new(&actor),
            actor: Trace::passing(&actor),
            slow: Trace::passing(&critic),
            judge: Trace::new(&critic),
            hidden: Hidden::new(&actor),
            action_gradient: actions(),
            action: actions(),
            stretch: actions(),
            observation: vec![0.0; frame.sigma.len()],
            row: vec![0.0; lines_for(actor[0]) * WIDTH],
        }
    }
}

/// Fills a panel: rows of the replay, features, noise.
pub(crate) struct Draw<'a> {
    pub(crate) frame: &'a Frame,
    pub(crate) replay: &'a Replay,
    pub(crate) smoothness: Smoothness,
    /// Number of the update, from 0.
    pub(crate) time: u64,
    pub(crate) panel: &'a mut Panel,
    pub(crate) scratch: &'a mut Scratch,
}

/// Number of rows ahead for which memory is asked.
const AHEAD: usize = 8;

impl Work for Draw<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: crate::kernel::Vector>(self) {
        let Self { frame, replay, smoothness, time, panel, scratch } = self;
        let first = panel.number * LANES;
        let end = replay.len() as u32;
        let halves = [0, 1].map(|h| frame.random.below(end, Purpose::Rows, (first + h * WIDTH) as u32, time));
        let rows = halves.as_flattened();
        for at in &rows[..AHEAD] {
            prefetch(replay.floats(*at as usize));
        }
        let [here, next, near] = &mut panel.views;
        let goal = frame.shape.goal.clone();
        for (sample, &at) in rows.iter().enumerate() {
            if let Some(&ahead) = rows.get(sample + AHEAD) {
                prefetch(replay.floats(ahead as usize));
            }
            let row = replay.row(at as usize);
            let (half, lane) = (sample / WIDTH, sample % WIDTH);
            panel.reward[half].0[lane] = row.reward;
            panel.live[half].0[lane] = row.live;
            for (line, &action) in panel.joint.chunks_exact_mut(2).zip(row.action) {
                line[half].0[lane] = action;
            }
            place(&frame.features, row.observation, &mut scratch.row, &mut here.by_sample, sample);
            place(&frame.features, row.next, &mut scratch.row, &mut panel.next.by_sample, sample);
            let length = row.observation.len();
            if smoothness.wants(View::Next) {
                let mixed = &mut scratch.observation[..length];
                mixed.copy_from_slice(row.next);
                mixed[goal.clone()].copy_from_slice(&row.observation[goal.clone()]);
                place(&frame.features, mixed, &mut scratch.row, &mut next.by_sample, sample);
            }
            if smoothness.wants(View::Near) {
                scratch.observation[..length].copy_from_slice(row.observation);
                let draws = scratch.observation.len() / LANES;
                for (n, entries) in scratch.observation.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
                    let position = (((first + sample) * draws + n) * WIDTH) as u32;
                    let noise = frame.random.normals(Purpose::Observations, position, time);
                    let sigma = &frame.sigma[n * LANES..][..LANES];
                    for ((x, sigma), noise) in entries.iter_mut().zip(sigma).zip(noise.as_flattened()) {
                        *x = sigma.mul_add(*noise, *x);
                    }
                }
                place(&frame.features, &scratch.observation[..length], &mut scratch.row, &mut near.by_sample, sample);
            }
        }
        for action in 0..frame.shape.actions {
            for half in 0..2 {
                let position = (((2 * panel.number + half) * frame.shape.actions + action) * WIDTH) as u32;
                let noise = frame.random.normals(Purpose::Actions, position, time);
                for (lines, noise) in panel.noise.iter_mut().zip(noise) {
                    lines[2 * action + half] = Line(noise);
                }
            }
        }
        for (view, glance) in VIEWS.into_iter().zip(&mut panel.views) {
            if smoothness.wants(view) {
                ToFeatures { samples: &glance.by_sample, features: &mut glance.x }.run::<V>();
            }
        }
        let following = &mut panel.next;
        ToFeatures { samples: &following.by_sample, features: &mut following.x }.run::<V>();
    }
}

/// Writes the features of an observation as sample `sample` of a panel.
#[inline(always)]
pub(crate) fn place(
    features: &FeatureMap,
    observation: &[f32],
    row: &mut [f32],
    by_sample: &mut [Line],
    sample: usize,
) {
    features.apply(observation, row);
    for (n, chunk) in row.as_chunks::<WIDTH>().0.iter().enumerate() {
        by_sample[n * LANES + sample] = Line(*chunk);
    }
}

/// `[actions, features]`, the critics' input.
pub(crate) fn join(actions: &[Line], x: &[Line], features: usize, joint: &mut [Line]) {
    let (head, tail) = joint.split_at_mut(actions.len());
    head.copy_from_slice(actions);
    tail[..2 * features].copy_from_slice(&x[..2 * features]);
}
