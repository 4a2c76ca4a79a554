//! Flights of a policy and their branches: what shifted answers cost.

use environment::draws::{Purpose, stream};
use environment::{SIDE_BY_SIDE, Step, VectorEnv};
use model::observation::{ACTION_LEN, AHEAD, CHANNELS, Pair};
use rand::RngExt as _;
use sac::{Network, Workspace};

use crate::TrainingError;
use crate::settings::RolloutSettings;

/// Ticks at the start of an episode that nothing is learned from: the estimates of the state settle.
const SKIPPED_TICKS: usize = 50;

/// Answers for now of eight rigs.
type Answers = [[f32; CHANNELS]; SIDE_BY_SIDE];

/// Flies a policy and its branches.
pub(super) struct Probe {
    flight: VectorEnv,
    branch: VectorEnv,
    workspace: Workspace,
    seed: u64,
    shape: Vec<f32>,
}

/// A flight of eight rigs with its branches.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Episode {
    /// Features that the network is put, tick by tick and rig by rig.
    features: Vec<f32>,
    /// Answers.
    answers: Vec<Answers>,
    /// Branches by shifted answers.
    pub(super) branches: Vec<Branch>,
}

/// Two branches of one rig and one channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Branch {
    tick: usize,
    lane: usize,
    channel: usize,
    /// g: of the cost along the shift, per half range.
    pub(super) slope: f64,
    /// h, per square of half the range.
    pub(super) curvature: f64,
}

impl Episode {
    /// Features and answers of the tick `later` ticks into a branch.
    pub(super) fn at(&self, branch: &Branch, later: usize) -> Option<(&[f32], f32)> {
        let width = self.features.len() / (self.answers.len() * SIDE_BY_SIDE).max(1);
        let tick = branch.tick + later;
        let row = tick * SIDE_BY_SIDE + branch.lane;
        let answer = self.answers.get(tick)?.get(branch.lane)?.get(branch.channel)?;
        Some((self.features.get(row * width..(row + 1) * width)?, *answer))
    }
}

impl Branch {
    /// Which valve's answer was shifted.
    pub(super) fn channel(&self) -> usize {
        self.channel
    }
}

/// k: how much of the shift each tick of a branch gets; half a sine.
pub(super) fn shape(settings: &RolloutSettings) -> Vec<f32> {
    let step = std::f32::consts::PI / (settings.shift_ticks as f32 + 1.0);
    (1..=settings.shift_ticks).map(|j| (step * j as f32).sin()).collect()
}

impl Probe {
    /// Flies in copies of `env`.
    pub(super) fn new(env: &VectorEnv, settings: &RolloutSettings, seed: u64) -> Self {
        Probe {
            flight: env.clone(),
            branch: env.clone(),
            workspace: Workspace::default(),
            seed,
            shape: shape(settings),
        }
    }

    /// Flies episode `number` with its branches; nothing where `stop` asks to leave it.
    ///
    /// # Errors
    /// If a drawn rig is unsound.
    pub(super) fn episode(
        &mut self,
        network: &Network,
        settings: &RolloutSettings,
        number: u64,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<Option<Episode>, TrainingError> {
        self.flight.begin(number)?;
        self.branch.clone_from(&self.flight);
        let mut random = stream(self.seed, Purpose::Branch, number, 0);
        let mut between = move || {
            let every = settings.branch_every_ticks;
            (every / 2 + random.random_range(0..every)).max(1)
        };
        let mut episode = Episode::default();
        let mut tried: Vec<Tried> = Vec::new();
        let (mut costs, mut terminal) = (Vec::new(), Vec::new());
        let mut next = SKIPPED_TICKS + between();
        let mut before = None;
        let width = network.features.features().len();
        for tick in 0.. {
            if self.flight.is_truncated() {
                break;
            }
            if stop() {
                return Ok(None);
            }
            let answers = answers(network, &mut self.workspace, &self.flight);
            let length = self.flight.observations().len() / SIDE_BY_SIDE;
            for told in self.flight.observations().chunks_exact(length) {
                let from = episode.features.len();
                episode.features.resize(from + width, 0.0);
                network.features.apply(told, &mut episode.features[from..]);
            }
            let before_now = before.unwrap_or(answers);
            if tick == next {
                tried.push(self.try_shifts(network, settings, tick, &answers, &before_now));
                next = tick + between();
            }
            let step = self.flight.step(&actions(&answers));
            costs.push(std::array::from_fn(|lane| cost(settings, &step, lane, &answers, &before_now)));
            terminal.push(step.terminal);
            episode.answers.push(answers);
            before = Some(answers);
        }
        for tried in tried {
            episode.branches.extend(tried.branches(settings, &costs, &terminal));
        }
        Ok(Some(episode))
    }

    /// Costs of both shifts of both channels from where the flight stands.
    fn try_shifts(
        &mut self,
        network: &Network,
        settings: &RolloutSettings,
        tick: usize,
        answers_now: &Answers,
        before_now: &Answers,
    ) -> Tried {
        let mut tried = Tried { tick, cost: [[[0.0; 2]; CHANNELS]; SIDE_BY_SIDE], tripped: [false; SIDE_BY_SIDE] };
        for channel in 0..CHANNELS {
            for (side, sign) in [1.0, -1.0].into_iter().enumerate() {
                self.branch.stand_where(&self.flight);
                let mut before = *before_now;
                for later in 0..settings.horizon_ticks {
                    let mut now = match later {
                        0 => *answers_now,
                        _ => answers(network, &mut self.workspace, &self.branch),
                    };
                    if let Some(share) = self.shape.get(later) {
                        now.iter_mut().for_each(|row| row[channel] += sign * settings.shift as f32 * share);
                    }
                    let step = self.branch.step(&actions(&now));
                    for lane in 0..SIDE_BY_SIDE {
                        tried.cost[lane][channel][side] += cost(settings, &step, lane, &now, &before);
                        tried.tripped[lane] |= step.terminal[lane];
                    }
                    before = now;
                }
            }
        }
        tried
    }
}

/// Costs of the branches of one tick.
struct Tried {
    tick: usize,
    /// Cost of each rig and channel, shifted up and down.
    cost: [[[f64; 2]; CHANNELS]; SIDE_BY_SIDE],
    tripped: [bool; SIDE_BY_SIDE],
}

impl Tried {
    /// Slopes and curvatures, beside what the flight itself cost; none of a rig that left its envelope.
    fn branches<'a>(
        &'a self,
        settings: &'a RolloutSettings,
        costs: &'a [[f64; SIDE_BY_SIDE]],
        terminal: &'a [[bool; SIDE_BY_SIDE]],
    ) -> impl Iterator<Item = Branch> + 'a {
        let over = self.tick..self.tick + settings.horizon_ticks;
        let flown = costs.get(over.clone()).unwrap_or_default();
        let tripped = terminal.get(over).unwrap_or_default();
        (0..SIDE_BY_SIDE)
            .filter(move |lane| !flown.is_empty() && !self.tripped[*lane] && !tripped.iter().any(|t| t[*lane]))
            .flat_map(move |lane| (0..CHANNELS).map(move |channel| (lane, channel)))
            .map(move |(lane, channel)| {
                let unshifted: f64 = flown.iter().map(|cost| cost[lane]).sum();
                let [up, down] = self.cost[lane][channel];
                let slope = (up - down) / (2.0 * settings.shift);
                let curvature = (up + down - 2.0 * unshifted) / settings.shift.powi(2);
                Branch { tick: self.tick, lane, channel, slope, curvature }
            })
    }
}

/// Cost of a tick of a rig: its errors before noise, and how much its answers changed.
fn cost(settings: &RolloutSettings, step: &Step, lane: usize, now: &Answers, before: &Answers) -> f64 {
    let error: Pair = step.noise_free_error_kpa[lane];
    (0..CHANNELS)
        .map(|c| {
            let share = error[c] / settings.error_scale_kpa[c];
            let change = f64::from(now[lane][c] - before[lane][c]);
            2.0 * ((1.0 + share * share).sqrt() - 1.0) + settings.change_price * change * change
        })
        .sum()
}

/// The policy's answers for now where an environment stands.
fn answers(network: &Network, workspace: &mut Workspace, env: &VectorEnv) -> Answers {
    let length = env.observations().len() / SIDE_BY_SIDE;
    let mut answers = [[0.0; CHANNELS]; SIDE_BY_SIDE];
    for (row, told) in answers.iter_mut().zip(env.observations().chunks_exact(length)) {
        for (answer, given) in row.iter_mut().zip(network.mean_action_with(workspace, told)) {
            *answer = *given;
        }
    }
    answers
}

/// Whole plans that hold the answers for now.
fn actions(answers: &Answers) -> Vec<f32> {
    let actions: Vec<f32> = answers.iter().flat_map(|now| now.repeat(AHEAD + 1)).collect();
    debug_assert_eq!(actions.len(), SIDE_BY_SIDE * ACTION_LEN);
    actions
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::PolicyStart;
    use crate::settings::{Plan, TrainingSettings};
    use environment::vector_env::Pumps;
    use environment::{EnvironmentSettings, RigDraw};
    use model::rig::Rig;
    use std::path::Path;

    fn shipped() -> (VectorEnv, Network) {
        let start =
            PolicyStart::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../controller/policies/default.onnx"));
        let start = start.unwrap();
        let mut settings = TrainingSettings::preset("adaptation").unwrap();
        start.adopt_into(&mut settings).unwrap();
        // Backlash, lag and delay: everything that a plant and a model can remember is in it.
        let rig = Rig::builtin("bench").unwrap();
        let environment = EnvironmentSettings { episode_s: 6.0, warm_up_s: 1.0, ..settings.environment.clone() };
        let draw = RigDraw::new(&rig, &environment).unwrap();
        let pumps = Pumps::Averaged { step_ms: 2.0 };
        let env = VectorEnv::with_pumps(draw, (&rig, pumps), settings.contract(), true, &environment, 3).unwrap();
        (env, start.network(Plan::Fitted))
    }

    /// A branch whose answers are not shifted is the flight itself: plant, model, law, noise and reference go on to the bit, so
    /// what branches differ by is the shift alone.
    #[test]
    fn a_branch_that_shifts_nothing_is_the_flight() {
        let (env, network) = shipped();
        let settings = RolloutSettings { episode_s: 5.0, ..RolloutSettings::default() };
        let mut probe = Probe::new(&env, &settings, 1);
        probe.shape.fill(0.0);
        let episode = probe.episode(&network, &settings, 0, &|| false).unwrap().unwrap();
        assert!(episode.branches.len() > 100, "{}", episode.branches.len());
        assert!(episode.branches.iter().all(|b| b.slope == 0.0 && b.curvature == 0.0), "{:?}", episode.branches[0]);
        // With its shape it differs.
        probe.shape = shape(&settings);
        let shifted = probe.episode(&network, &settings, 0, &|| false).unwrap().unwrap();
        assert_eq!(shifted.answers, episode.answers, "the flight is the same whatever its branches do");
        assert!(shifted.branches.iter().any(|b| b.slope != 0.0));
    }

    #[test]
    fn a_stop_leaves_an_episode() {
        let (env, network) = shipped();
        let settings = RolloutSettings::default();
        assert_eq!(Probe::new(&env, &settings, 1).episode(&network, &settings, 0, &|| true).unwrap(), None);
    }

    /// An answer that only costs: its slope is that of a parabola around zero, whatever the rig does.
    #[test]
    fn slopes_lead_down() {
        let (env, mut network) = shipped();
        // Only changes of the answer are paid for: errors weigh next to nothing.
        let settings = RolloutSettings {
            episode_s: 5.0,
            change_price: 1e4,
            error_scale_kpa: [100.0; 2],
            shift_ticks: 1,
            horizon_ticks: 2,
            ..RolloutSettings::default()
        };
        if let Some(last) = network.layers.last_mut() {
            last.weights.fill(0.0);
            last.bias.fill(0.0);
        }
        let episode = Probe::new(&env, &settings, 1).episode(&network, &settings, 0, &|| false).unwrap().unwrap();
        for branch in &episode.branches {
            // There and back again: 2 ρ ε², so h = 4 ρ. An error of a few kPa at a scale of 100 moves it by some 1e-3.
            assert!((branch.curvature / 4e4 - 1.0).abs() < 1e-2, "{}", branch.curvature);
            assert!(branch.slope.abs() < 100.0, "{}", branch.slope);
        }
    }
}
