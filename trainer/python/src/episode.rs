//! The rig as a learning problem, one rig at a time: the daemon's tick with a policy from outside in it.
//!
//! Observation layout v1 (84 numbers, kPa gauge), 12 duties out, the paper's reward (§III-A4). Measure, predict
//! (MPObs), observe, decide, limit, apply go on as in the daemon and in the trainer's own environment, whose parts
//! these are; everything about an episode follows from its number.

use std::sync::Arc;

use environment::draws::{Purpose, stream};
use environment::reward::reward;
use environment::vector_env::ENVELOPE_KPA;
use environment::{DomainRandomization, EnvironmentError, EnvironmentSettings, RigDraw, reference_draw, sensor_scales};
use law::{ControlInput, PolicyLaw, SoftStart, TICK_S, saturated};
use model::observation::{
    ACTION_LEN, AHEAD, ActionTrajectory, CHANNELS, GOALS_AHEAD, OBSERVATION_LEN, ObservationLayout, PAST, Pair,
};
use model::predict::{DualPressureRig, Predictor};
use model::rig::Rig;
use model::shown_reference::ShownReference;
use model::steady::SteadyMap;
use proto::emulator::{SensorScale, Sensors, load_for_loop};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use rand::RngExt as _;

use crate::{bytes_of, refused};

/// Readings that a sound rig shows, kPa gauge: the bounds of the observation space.
const LOWEST_KPA: Pair = [-20.0, -101.0];
const HIGHEST_KPA: Pair = [300.0, 20.0];
/// Share of episodes that begin at rest and vented; the others begin where the reference does. Chosen.
const FROM_REST: f64 = 0.1;

/// The numbers that are shown beside an observation, by name.
type Info = [(&'static str, f64); 6];
/// An observation's bytes and info.
type Begun<'py> = (Bound<'py, PyBytes>, Vec<(&'static str, f64)>);
/// An observation's bytes, reward, terminal, truncated, info.
type Stepped<'py> = (Bound<'py, PyBytes>, f64, bool, bool, Vec<(&'static str, f64)>);

/// One rig with its reference, noise and control law.
#[pyclass]
pub(crate) struct Env {
    model: Rig,
    draw: RigDraw,
    settings: EnvironmentSettings,
    scales: [SensorScale; CHANNELS],
    map: Arc<SteadyMap>,
    episode: Option<Episode>,
}

/// State that lives for one episode.
struct Episode {
    plant: DualPressureRig,
    predictor: Predictor,
    law: PolicyLaw,
    sensors: Sensors,
    reference: Vec<Pair>,
    soft_start: SoftStart,
    input: ControlInput,
    /// Readings of the rig's sensors with the chambers on the goals, up to the present one, and for now and the next ticks.
    shown_reference: ShownReference,
    shown_kpa: [Pair; AHEAD + 1],
    predicted_kpa: [Pair; AHEAD],
    plan: ActionTrajectory,
    duty: Pair,
    tick: usize,
}

#[pymethods]
impl Env {
    /// An environment of rigs drawn around `rig` within ± `spread` percent.
    ///
    /// # Errors
    /// `ValueError` with the line that names file, key or range.
    #[new]
    fn new(rig: &str, model: Option<&str>, episode_s: f64, noise_v_rms: Option<f64>, spread: f64) -> PyResult<Self> {
        let model_file = model.unwrap_or(rig);
        let plant = load_for_loop(rig, None).map_err(refused)?;
        let model = load_for_loop(model_file, None).map_err(refused)?;
        let mut settings = EnvironmentSettings {
            episode_s,
            spread: DomainRandomization {
                volumes_percent: spread,
                valves_percent: spread,
                check_valves_percent: spread,
                ..DomainRandomization::default()
            },
            ..EnvironmentSettings::default()
        };
        if let Some(volts) = noise_v_rms {
            settings.noise_v_rms = volts;
        }
        settings.check().map_err(named_as_here)?;
        let draw = RigDraw::new(&plant, &settings).map_err(refused)?;
        let (scales, map) = (sensor_scales(&plant).map_err(refused)?, SteadyMap::new(&model).map_err(refused)?);
        Ok(Env { model, draw, settings, scales, map: Arc::new(map), episode: None })
    }

    /// Lowest and highest observation, bytes of `f32`.
    #[staticmethod]
    fn bounds(py: Python<'_>) -> (Bound<'_, PyBytes>, Bound<'_, PyBytes>) {
        let of = |pair: Pair| {
            PyBytes::new(py, &bytes_of((0..OBSERVATION_LEN).map(|n| pair[n % CHANNELS] as f32), f32::to_le_bytes))
        };
        (of(LOWEST_KPA), of(HIGHEST_KPA))
    }

    /// Begins the episode of this number; its first observation, bytes of `f32`, and info.
    ///
    /// # Errors
    /// `ValueError` if the drawn rig is unsound.
    fn reset<'py>(&mut self, py: Python<'py>, number: u64) -> PyResult<Begun<'py>> {
        let episode = self.begin(number)?;
        let begun = (PyBytes::new(py, &episode.observation()), episode.info(episode.plant.readings_kpa()).to_vec());
        self.episode = Some(episode);
        Ok(begun)
    }

    /// One tick under twelve duties (positive, negative; this tick and the next five).
    ///
    /// # Errors
    /// `ValueError` before `reset`, or for another number of duties.
    fn step<'py>(&mut self, py: Python<'py>, action: Vec<f32>) -> PyResult<Stepped<'py>> {
        let ticks = self.ticks();
        let Some(episode) = &mut self.episode else { return Err(refused("call reset() before step()")) };
        let count = action.len();
        let action: [f32; ACTION_LEN] = action
            .try_into()
            .map_err(|_| refused(format!("{count} duties given, {ACTION_LEN} expected: u_pos, u_neg of six ticks")))?;
        episode.act(&action);
        let pressures = episode.plant.readings_kpa();
        // Written so that NaN counts as outside.
        let terminal = !(pressures[0] <= ENVELOPE_KPA[0] && pressures[1] >= ENVELOPE_KPA[1]);
        let value = if terminal {
            self.settings.reward.tripped
        } else {
            let (shown_kpa, measured_kpa) = (&episode.shown_kpa, episode.input.measured_kpa);
            reward(&self.settings.reward, shown_kpa, measured_kpa, Some(&episode.predicted_kpa))
        };
        let truncated = episode.tick >= ticks;
        let info: Info = episode.info(pressures);
        Ok((PyBytes::new(py, &episode.observation()), value, terminal, truncated, info.to_vec()))
    }
}

/// A setting's error under the name that the argument has in Python.
fn named_as_here(error: EnvironmentError) -> PyErr {
    match error {
        EnvironmentError::Setting { key, problem } => {
            let key = key.trim_start_matches("environment.");
            refused(format!("{}: {problem}", if key.starts_with("spread.") { "spread" } else { key }))
        }
        rig => refused(rig),
    }
}

impl Env {
    fn ticks(&self) -> usize {
        (self.settings.episode_s / TICK_S).round() as usize
    }

    fn begin(&self, number: u64) -> PyResult<Episode> {
        let of = |purpose| stream(0, purpose, number, 0);
        let rig = self.draw.draw(&mut of(Purpose::Rig)).map_err(refused)?;
        let reference = reference_draw::draw(&self.map, self.ticks() + GOALS_AHEAD + 2, &mut of(Purpose::Reference));
        let at_rest = of(Purpose::Start).random_range(0.0..1.0) < FROM_REST;
        let first = reference.first().copied().unwrap_or([80.0, -70.0]);
        let (start, duty) = if at_rest {
            ([0.0; CHANNELS], [1.0; CHANNELS])
        } else {
            (first, self.map.duty_for(first, [0.0; CHANNELS]).map(saturated))
        };
        let mut episode = Episode {
            plant: DualPressureRig::new(&rig).map_err(refused)?,
            predictor: Predictor::new(&self.model).map_err(refused)?,
            law: PolicyLaw::new(Arc::clone(&self.map), ObservationLayout::Paper),
            sensors: Sensors::new(self.scales, self.settings.noise_v_rms, of(Purpose::Noise).random()),
            soft_start: SoftStart::new(start, first),
            reference,
            input: ControlInput::of_measured(start, [first; GOALS_AHEAD + 1]),
            shown_reference: ShownReference::of(&rig),
            shown_kpa: [first; AHEAD + 1],
            predicted_kpa: [start; AHEAD],
            plan: ActionTrajectory::held(duty),
            duty,
            tick: 0,
        };
        episode.plant.start_from(start, duty);
        episode.predictor.restart(start, duty);
        episode.law.restart(duty);
        episode.sense();
        Ok(episode)
    }
}

impl Episode {
    fn act(&mut self, action: &[f32; ACTION_LEN]) {
        let output = self.law.decide(&self.input, action);
        self.duty = output.duty();
        self.plan = output.trajectory;
        self.law.applied(self.duty);
        self.predictor.advance(self.duty, true);
        self.plant.tick(self.duty, true);
        self.tick += 1;
        self.sense();
    }

    /// Measures, predicts, and lets the law take the tick in.
    fn sense(&mut self) {
        let volts = self.sensors.sample(self.plant.readings_kpa(), [&[], &[]]);
        let scales = self.sensors.scales();
        self.input.measured_kpa = std::array::from_fn(|c| scales[c].gauge_kpa(f64::from(volts[c])));
        self.input.goals_kpa = std::array::from_fn(|j| {
            let goal = self.reference.get(self.tick + j).or(self.reference.last()).copied().unwrap_or_default();
            let offset = self.soft_start.offset_kpa((self.tick + j) as f64 * TICK_S);
            std::array::from_fn(|c| goal[c] + offset[c])
        });
        self.shown_kpa = self.shown_reference.goals_kpa(1, &self.input.goals_kpa);
        self.input.undelayed_kpa = self.predictor.observe(self.input.measured_kpa);
        self.predicted_kpa = self.predictor.predict(&self.plan.remaining(), true);
        if !self.predicted_kpa.as_flattened().iter().all(|p| p.is_finite()) {
            self.predicted_kpa = [self.input.measured_kpa; AHEAD];
        }
        self.law.observe(&self.input);
    }

    fn observation(&self) -> Vec<u8> {
        let mut observation = [0.0f32; OBSERVATION_LEN];
        self.law.write_observation(&self.input, &self.predicted_kpa, &mut observation);
        bytes_of(observation, f32::to_le_bytes)
    }

    fn info(&self, [p_pos_kpa, p_neg_kpa]: Pair) -> Info {
        let [ref_pos_kpa, ref_neg_kpa] = self.input.goals_kpa[0];
        let [u_pos, u_neg] = self.duty;
        [
            ("p_pos_kpa", p_pos_kpa),
            ("p_neg_kpa", p_neg_kpa),
            ("ref_pos_kpa", ref_pos_kpa),
            ("ref_neg_kpa", ref_neg_kpa),
            ("u_pos", u_pos),
            ("u_neg", u_neg),
        ]
    }
}

// The observation's length is that of the measured past, the predictions and the goals on both sides.
const _: () = assert!(OBSERVATION_LEN == CHANNELS * (PAST + 1 + AHEAD + PAST + 1 + GOALS_AHEAD));
