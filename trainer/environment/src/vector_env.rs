//! Eight rigs side by side, each with its own parameters, reference, noise and law: what a learner acts on.
//!
//! The eight share one compiled structure and are integrated in lanes, plant and MPObs model both, which makes a
//! step of one environment several times cheaper than alone. Episodes begin and end together. A rig that leaves
//! the safety envelope ends its own episode there (a terminal state) and is started anew on the same reference.

use std::sync::Arc;

use law::{ControlInput, ControlOutput, PolicyLaw, SoftStart, TICK_S, saturated};
use model::observation::{ACTION_LEN, AHEAD, ActionTrajectory, CHANNELS, GOALS_AHEAD, ObservationLayout, Pair};
use model::predict::{DualPressureRig, Predictor};
use model::real::{Lanes, Real};
use model::rig::{Rig, RigError};
use model::shown_reference::ShownReference;
use model::steady::SteadyMap;
use proto::emulator::{SensorScale, Sensors, check_tick};
use rand::{Rng, RngExt as _};
use rand_distr::{Distribution, StandardNormal};

use crate::draws::{Purpose, stream};
use crate::reward::{correction_price, reward};
use crate::rig_draw::RigDraw;
use crate::settings::EnvironmentSettings;
use crate::{EnvironmentError, reference_draw, sensor_scales};

/// Environments that run side by side.
pub const SIDE_BY_SIDE: usize = 8;
type Eight = Lanes<SIDE_BY_SIDE>;

/// Pressures beyond which the daemon vents, in kPa gauge: positive above, negative below.
pub const ENVELOPE_KPA: Pair = [160.0, -95.0];
/// Share of episodes that begin with the rig at rest and vented, as a flight does.
const FROM_REST: f64 = 0.04;
/// Share that begins anywhere.
const FROM_ANYWHERE: f64 = 0.06;
/// Distance from the reference at which the others begin, in kPa RMS.
const NEAR_KPA: Pair = [1.5, 0.7];

/// The shortest warm-up, as a share of the longest.
const LEAST_WARM_UP: f64 = 0.1;

/// Result of a step of all eight.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Rewards.
    pub rewards: [f32; SIDE_BY_SIDE],
    /// True where the rig left its envelope: nothing comes after.
    pub terminal: [bool; SIDE_BY_SIDE],
    /// Error of the measured pressures in kPa: less what the rig's sensors show of chambers on the goal.
    pub error_kpa: [Pair; SIDE_BY_SIDE],
    /// Error of the readings before noise, in kPa.
    pub noise_free_error_kpa: [Pair; SIDE_BY_SIDE],
    /// Change of the applied duties since the tick before.
    pub duty_change: [Pair; SIDE_BY_SIDE],
}

/// Ways to simulate the pumps of plants and model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pumps {
    /// Stroke by stroke.
    Detailed,
    /// Averaged over a revolution: some times as fast, and off by 0.01 to 0.02 kPa (`model::averaged`).
    Averaged {
        /// Step in ms.
        step_ms: f64,
    },
}

impl Pumps {
    fn compiled(self, rigs: &[Rig; SIDE_BY_SIDE]) -> Result<DualPressureRig<Eight>, RigError> {
        match self {
            Pumps::Detailed => DualPressureRig::side_by_side(rigs),
            Pumps::Averaged { step_ms } => DualPressureRig::averaged_side_by_side(rigs, step_ms),
        }
    }
}

/// One rig of the env, but for its physics.
#[derive(Clone)]
struct EnvInstance {
    law: PolicyLaw,
    sensors: Sensors,
    reference: Arc<[Pair]>,
    approach: SoftStart,
    approach_from: usize,
    situation: ControlInput,
    /// Readings of the rig's sensors of chambers on the goals, up to the present one.
    shown_reference: ShownReference,
    /// Readings with the chambers on the goals, now and in the next ticks: the goals themselves where no sensor is late.
    shown_kpa: [Pair; AHEAD + 1],
    predicted: [Pair; AHEAD],
    trajectory: ActionTrajectory,
    duty: Pair,
}

/// The env.
#[derive(Clone)]
pub struct VectorEnv {
    settings: EnvironmentSettings,
    contract: ObservationLayout,
    draw: RigDraw,
    scales: [SensorScale; CHANNELS],
    map: Arc<SteadyMap>,
    seed: u64,
    plant: DualPressureRig<Eight>,
    pumps: Pumps,
    /// The model behind MPObs; without it the prediction is "stays as it is".
    predictor: Option<Predictor<Eight>>,
    instances: Vec<EnvInstance>,
    tick: usize,
    ticks: usize,
    observations: Vec<f32>,
    next_observation: Vec<f32>,
}

impl VectorEnv {
    /// A env of rigs drawn by `draw`, with `model` behind MPObs and feed-forward. Call [`VectorEnv::begin`] next.
    ///
    /// # Errors
    /// If settings are out of range, or a rig lacks what a dual-pressure rig needs.
    pub fn new(
        draw: RigDraw,
        model: &Rig,
        contract: ObservationLayout,
        model_predicted: bool,
        settings: &EnvironmentSettings,
        seed: u64,
    ) -> Result<Self, EnvironmentError> {
        Self::with_pumps(draw, (model, Pumps::Detailed), contract, model_predicted, settings, seed)
    }

    /// As [`VectorEnv::new`], with pumps that are simulated otherwise.
    ///
    /// # Errors
    /// As [`VectorEnv::new`].
    pub fn with_pumps(
        draw: RigDraw,
        (model, pumps): (&Rig, Pumps),
        contract: ObservationLayout,
        model_predicted: bool,
        settings: &EnvironmentSettings,
        seed: u64,
    ) -> Result<Self, EnvironmentError> {
        settings.check()?;
        for rig in [draw.nominal(), model] {
            check_tick(rig).map_err(EnvironmentError::rig(rig))?;
        }
        let same: [Rig; SIDE_BY_SIDE] = std::array::from_fn(|_| model.clone());
        let compiled = pumps.compiled(&same).map_err(EnvironmentError::rig(model))?;
        let map = Arc::new(SteadyMap::new(model).map_err(EnvironmentError::rig(model))?);
        let scales = sensor_scales(draw.nominal())?;
        let mut env = VectorEnv {
            contract,
            scales,
            map,
            seed,
            plant: compiled.clone(),
            pumps,
            predictor: model_predicted.then(|| Predictor::with(compiled)),
            instances: Vec::new(),
            tick: 0,
            ticks: (settings.episode_s / TICK_S).round() as usize,
            observations: vec![0.0; SIDE_BY_SIDE * contract.observation_len()],
            next_observation: vec![0.0; SIDE_BY_SIDE * contract.observation_len()],
            settings: settings.clone(),
            draw,
        };
        env.begin(0)?;
        Ok(env)
    }

    /// Begins episode `number`: everything about it follows from the seed and this number.
    ///
    /// # Errors
    /// If a drawn rig is unsound.
    pub fn begin(&mut self, number: u64) -> Result<(), EnvironmentError> {
        let mut rigs = Vec::with_capacity(SIDE_BY_SIDE);
        self.instances.clear();
        for lane in 0..SIDE_BY_SIDE {
            let of = |purpose| stream(self.seed, purpose, number, lane);
            let rig = self.draw.draw(&mut of(Purpose::Rig))?;
            let shown_reference = ShownReference::of(&rig);
            rigs.push(rig);
            let reference = reference_draw::draw(&self.map, self.ticks + GOALS_AHEAD + 2, &mut of(Purpose::Reference));
            self.instances.push(EnvInstance {
                law: PolicyLaw::new(Arc::clone(&self.map), self.contract),
                sensors: Sensors::new(self.scales, self.settings.noise_v_rms, of(Purpose::Noise).random()),
                reference: reference.into(),
                approach: SoftStart::new([0.0; CHANNELS], [0.0; CHANNELS]),
                approach_from: 0,
                situation: ControlInput::of_measured([0.0; CHANNELS], [[0.0; CHANNELS]; GOALS_AHEAD + 1]),
                shown_reference,
                shown_kpa: [[0.0; CHANNELS]; AHEAD + 1],
                predicted: [[0.0; CHANNELS]; AHEAD],
                trajectory: ActionTrajectory::held([1.0; CHANNELS]),
                duty: [1.0; CHANNELS],
            });
        }
        let named = rigs.first().cloned();
        let rigs: [Rig; SIDE_BY_SIDE] = rigs.try_into().unwrap_or_else(|_| unreachable!("one rig was drawn per lane"));
        self.plant = self
            .pumps
            .compiled(&rigs)
            .map_err(|error| EnvironmentError::Rig { name: named.map_or_else(String::new, |rig| rig.name), error })?;
        self.tick = 0;
        let starts: [(Pair, Pair); SIDE_BY_SIDE] =
            std::array::from_fn(|lane| self.start(lane, &mut stream(self.seed, Purpose::Start, number, lane)));
        let pressures = std::array::from_fn(|c| Eight::from_lanes(|lane| starts[lane].0[c]));
        let duties = std::array::from_fn(|c| Eight::from_lanes(|lane| starts[lane].1[c]));
        self.plant.start_from(pressures, duties);
        if let Some(predictor) = &mut self.predictor {
            predictor.restart(pressures, duties);
        }
        for (lane, (_, duty)) in starts.into_iter().enumerate() {
            self.member_starts(lane, duty);
        }
        self.sense();
        self.observations.copy_from_slice(&self.next_observation);
        if self.contract == ObservationLayout::Correction {
            let share = stream(self.seed, Purpose::WarmUp, number, 0).random_range(LEAST_WARM_UP..=1.0);
            for _ in 0..(share * self.settings.warm_up_s / TICK_S).round() as usize {
                self.step(&[0.0; SIDE_BY_SIDE * ACTION_LEN]);
            }
        }
        Ok(())
    }

    /// Stands where `other` stands, in the same episode: a copy of `other` of this episode may go another way from any tick of it.
    pub fn stand_where(&mut self, other: &VectorEnv) {
        self.plant.restore(&other.plant.state());
        if let (Some(predictor), Some(theirs)) = (&mut self.predictor, &other.predictor) {
            predictor.stand_where(theirs);
        }
        self.instances.clone_from(&other.instances);
        self.tick = other.tick;
        self.observations.clone_from(&other.observations);
        self.next_observation.clone_from(&other.next_observation);
    }

    /// Observations for the policy, eight rows of [`ObservationLayout::observation_len`] numbers.
    pub fn observations(&self) -> &[f32] {
        &self.observations
    }

    /// Observations that the last step led to, before rigs that left their envelope were started anew.
    pub fn next_observation(&self) -> &[f32] {
        &self.next_observation
    }

    /// Tells whether the episode's time is over: a truncation, no terminal state.
    pub fn is_truncated(&self) -> bool {
        self.tick >= self.ticks
    }

    /// Steps of one environment in an episode.
    pub fn ticks(&self) -> usize {
        self.ticks
    }

    /// Acts: eight rows of twelve numbers within −1 … 1, which become duties or corrections as the settings say.
    pub fn step(&mut self, actions: &[f32]) -> Step {
        let mut duty_change = [[0.0; CHANNELS]; SIDE_BY_SIDE];
        for ((instance, action), change) in
            self.instances.iter_mut().zip(actions.chunks_exact(ACTION_LEN)).zip(&mut duty_change)
        {
            let outputs = outputs(self.contract, &self.settings, action);
            let decision = instance.law.decide(&instance.situation, &outputs);
            *change = instance.apply(&decision);
        }
        let duties: [Eight; CHANNELS] =
            std::array::from_fn(|c| Eight::from_lanes(|lane| self.instances.get(lane).map_or(1.0, |m| m.duty[c])));
        if let Some(predictor) = &mut self.predictor {
            predictor.advance(duties, true);
        }
        self.plant.tick(duties, true);
        self.tick += 1;
        self.sense();
        let mut step = Step {
            rewards: [0.0; SIDE_BY_SIDE],
            terminal: [false; SIDE_BY_SIDE],
            error_kpa: [[0.0; CHANNELS]; SIDE_BY_SIDE],
            noise_free_error_kpa: [[0.0; CHANNELS]; SIDE_BY_SIDE],
            duty_change,
        };
        self.observations.copy_from_slice(&self.next_observation);
        let reached = self.plant.readings_kpa();
        for lane in 0..SIDE_BY_SIDE {
            let Some(instance) = self.instances.get(lane) else { continue };
            let (measured_kpa, shown_kpa) = (&instance.situation.measured_kpa, &instance.shown_kpa);
            let predicted = self.predictor.as_ref().map(|_| &instance.predicted);
            let settings = &self.settings.reward;
            let [pos, neg] = reached.map(|p| p.lane(lane));
            let seen_kpa = if settings.noise_free { [pos, neg] } else { *measured_kpa };
            let mut reward_value = reward(settings, shown_kpa, seen_kpa, predicted);
            if self.contract == ObservationLayout::Correction {
                let row = actions.chunks_exact(ACTION_LEN).nth(lane).unwrap_or_default();
                reward_value += correction_price(settings, row);
            }
            step.error_kpa[lane] = std::array::from_fn(|c| measured_kpa[c] - shown_kpa[0][c]);
            step.noise_free_error_kpa[lane] = std::array::from_fn(|c| [pos, neg][c] - shown_kpa[0][c]);
            // Written so that NaN counts as outside.
            step.terminal[lane] = !(pos <= ENVELOPE_KPA[0] && neg >= ENVELOPE_KPA[1]);
            if step.terminal[lane] {
                reward_value = settings.scale * settings.tripped;
                self.restart(lane);
            }
            step.rewards[lane] = reward_value as f32;
        }
        step
    }

    /// Where an episode begins: pressures in kPa gauge, and the duties long in force.
    fn start(&self, lane: usize, random: &mut impl Rng) -> (Pair, Pair) {
        let first = self.instances.get(lane).and_then(|m| m.reference.first().copied()).unwrap_or([80.0, -70.0]);
        let kind: f64 = random.random_range(0.0..1.0);
        let near: Pair = std::array::from_fn(|c| {
            let gauss: f64 = StandardNormal.sample(random);
            first[c] + NEAR_KPA[c] * gauss
        });
        let anywhere = reference_draw::place(&self.map, random);
        if kind < FROM_REST {
            return ([0.0; CHANNELS], [1.0; CHANNELS]);
        }
        let place = if kind < FROM_REST + FROM_ANYWHERE { anywhere } else { near };
        let place = [place[0].clamp(0.0, 150.0), place[1].clamp(-90.0, 0.0)];
        (place, self.map.duty_for(place, [0.0; CHANNELS]).map(saturated))
    }

    /// Starts one rig anew near its reference, in the middle of the episode.
    fn restart(&mut self, lane: usize) {
        let Some(at) = self.instances.get(lane).and_then(|m| m.reference.get(self.tick)).copied() else { return };
        let duty = self.map.duty_for(at, [0.0; CHANNELS]).map(saturated);
        self.plant.restart_lane(lane, at, duty);
        if let Some(predictor) = &mut self.predictor {
            predictor.restart_lane(lane, at, duty);
        }
        self.member_starts(lane, duty);
        let readings = self.plant.readings_kpa().map(|p| p.lane(lane));
        let length = self.contract.observation_len();
        let (map, contract) = (&self.map, self.contract);
        let Some(instance) = self.instances.get_mut(lane) else { return };
        instance.law = PolicyLaw::new(Arc::clone(map), contract);
        instance.law.restart(duty);
        instance.measure(readings, self.tick);
        instance.predicted = [instance.situation.measured_kpa; AHEAD];
        instance.law.observe(&instance.situation);
        if let Some(row) = self.observations.chunks_exact_mut(length).nth(lane) {
            instance.law.write_observation(&instance.situation, &instance.predicted, row);
        }
    }

    fn member_starts(&mut self, lane: usize, duty: Pair) {
        let readings = self.plant.readings_kpa().map(|p| p.lane(lane));
        let tick = self.tick;
        if let Some(instance) = self.instances.get_mut(lane) {
            let first = instance.reference.get(tick).copied().unwrap_or(readings);
            instance.approach = SoftStart::new(readings, first);
            instance.approach_from = tick;
            instance.shown_reference.restart();
            instance.trajectory = ActionTrajectory::held(duty);
            instance.duty = duty;
            instance.law.restart(duty);
        }
    }

    /// Measures, predicts and writes what the policies are told.
    fn sense(&mut self) {
        let readings = self.plant.readings_kpa();
        for (lane, instance) in self.instances.iter_mut().enumerate() {
            instance.measure(readings.map(|p| p.lane(lane)), self.tick);
        }
        let instances = &self.instances;
        let of = |value: &dyn Fn(&EnvInstance) -> f64| Eight::from_lanes(|lane| instances.get(lane).map_or(0.0, value));
        if let Some(predictor) = &mut self.predictor {
            let undelayed = predictor.observe(std::array::from_fn(|c| of(&|m| m.situation.measured_kpa[c])));
            let plan = std::array::from_fn(|j| std::array::from_fn(|c| of(&|m| m.trajectory.remaining()[j][c])));
            let predicted = predictor.predict(&plan, true);
            for (lane, instance) in self.instances.iter_mut().enumerate() {
                instance.situation.undelayed_kpa = undelayed.map(|p| p.lane(lane));
                instance.predicted = predicted.map(|pair| pair.map(|p| p.lane(lane)));
                if !instance.predicted.as_flattened().iter().all(|p| p.is_finite()) {
                    instance.predicted = [instance.situation.measured_kpa; AHEAD];
                }
            }
        } else {
            for instance in &mut self.instances {
                instance.predicted = [instance.situation.measured_kpa; AHEAD];
            }
        }
        let length = self.contract.observation_len();
        for (instance, row) in self.instances.iter_mut().zip(self.next_observation.chunks_exact_mut(length)) {
            instance.law.observe(&instance.situation);
            instance.law.write_observation(&instance.situation, &instance.predicted, row);
        }
    }
}

impl EnvInstance {
    fn measure(&mut self, readings_kpa: Pair, tick: usize) {
        let volts = self.sensors.sample(readings_kpa, [&[], &[]]);
        let scales = self.sensors.scales();
        self.situation.measured_kpa = std::array::from_fn(|c| scales[c].gauge_kpa(f64::from(volts[c])));
        self.situation.undelayed_kpa = self.situation.measured_kpa;
        self.situation.goals_kpa = std::array::from_fn(|j| {
            let goal = self.reference.get(tick + j).or(self.reference.last()).copied().unwrap_or_default();
            let offset = self.approach.offset_kpa((tick + j - self.approach_from) as f64 * TICK_S);
            std::array::from_fn(|c| goal[c] + offset[c])
        });
        self.shown_kpa = self.shown_reference.goals_kpa(1, &self.situation.goals_kpa);
    }

    /// Sends a decision; answers by how much the duties changed.
    fn apply(&mut self, decision: &ControlOutput) -> Pair {
        let duty = decision.duty();
        self.trajectory = decision.trajectory;
        self.law.applied(duty);
        let before = std::mem::replace(&mut self.duty, duty);
        std::array::from_fn(|c| duty[c] - before[c])
    }
}

/// Meaning of twelve numbers within −1 … 1 under a contract: duties, or corrections of the fallback's.
pub fn outputs(contract: ObservationLayout, settings: &EnvironmentSettings, action: &[f32]) -> [f32; ACTION_LEN] {
    let (middle, half) = match contract {
        ObservationLayout::Paper => {
            (0.5 * (settings.duty_high + settings.duty_low), 0.5 * (settings.duty_high - settings.duty_low))
        }
        ObservationLayout::Correction => (0.0, settings.correction_duty),
    };
    let mut outputs = [0.0; ACTION_LEN];
    for (output, action) in outputs.iter_mut().zip(action) {
        *output = (half as f32).mul_add(*action, middle as f32);
    }
    outputs
}
