//! A policy as it was trained: network, settings and origin in one file; flown in evaluations, exported for the daemon.
//!
//! ```text
//! "DPPOL001"   u32 length   card as JSON   u32 length   settings as TOML   the network's own bytes, checksum included
//! ```

use environment::vector_env;
use model::observation::{ACTION_LEN, AHEAD, CHANNELS, CORRECTION_LIMIT, GOALS_AHEAD, ObservationLayout, PAST};
use model::rig::Rig;
use model::steady::SteadyMap;
use onnx_file::{Dense, Exported, FeatureTerm, GoldenPair, OutputMap, PolicyGraph, Ports, Provenance};
use sac::{Network, Workspace};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use proto::emulator::load_for_loop;
use proto::policy_metadata::{EXPLORATION_STD_KEY, exploration_std, exploration_std_text};
use proto::regular_file;
use proto::rig_file::RigFileError;

use crate::TrainingError;
use crate::checkpoint_file::{append_part, part};
use crate::plan_fit::{self, PlanModel};
use crate::policy_start::PolicyStart;
use crate::settings::{Plan, TrainingSettings};
use crate::spread;

const MAGIC: &[u8; 8] = b"DPPOL001";
/// Largest policy that is read (bytes): the paper's has 0.4 MB, the loader of the daemon takes 32 MB of numbers.
pub(crate) const MOST_POLICY_BYTES: u64 = 256 << 20;
/// In the folder of a run: the policy, the same as it is published, and the settings of its training.
const POLICY: &str = "policy.bin";
const PUBLISHED: &str = "policy.onnx";
const SETTINGS: &str = "settings.toml";

/// Rig that a policy was trained on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Origin {
    /// Name of the rig.
    pub rig: String,
    /// CRC-32C of the rig as it is written, eight hexadecimal digits.
    pub rig_hash: String,
}

impl Origin {
    /// The origin of what is trained on this rig.
    ///
    /// # Errors
    /// If the rig cannot be written as TOML.
    pub fn of(rig: &Rig) -> Result<Self, TrainingError> {
        let text = rig.to_toml().map_err(|error| TrainingError::Settings {
            file: rig.name.clone(),
            line: None,
            problem: error.to_string(),
        })?;
        Ok(Origin { rig: rig.name.clone(), rig_hash: format!("{:08x}", crc32c::crc32c(text.as_bytes())) })
    }
}

/// A policy as it was trained.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainedPolicy {
    settings: TrainingSettings,
    origin: Origin,
    steps: u64,
    network: Network,
    /// Spread of its own distribution, of each output that was learned, once it was measured.
    exploration_std: Option<Vec<f64>>,
}

#[derive(Serialize, Deserialize)]
struct Card {
    origin: Origin,
    steps: u64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    exploration_std: Option<Vec<f64>>,
}

impl TrainedPolicy {
    /// Puts a policy together.
    pub fn new(settings: TrainingSettings, origin: Origin, steps: u64, network: Network) -> Self {
        TrainedPolicy { settings, origin, steps, network, exploration_std: None }
    }

    /// The settings of its training.
    pub fn settings(&self) -> &TrainingSettings {
        &self.settings
    }

    /// Steps it was trained for.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// The network.
    pub fn network(&self) -> &Network {
        &self.network
    }

    /// The spread of its own distribution, in its outputs' unit, where it states one.
    pub fn exploration_std(&self) -> Option<&[f64]> {
        self.exploration_std.as_deref()
    }

    /// Policy with the spread of another one that it came from, of the outputs for now.
    pub(crate) fn with_stated_spread(mut self, std: Option<Vec<f64>>) -> Self {
        self.exploration_std = std.map(|std| std.into_iter().take(CHANNELS).collect());
        self
    }

    /// Policy with another network of the same widths.
    pub fn with_network(&self, network: Network) -> Self {
        TrainedPolicy { network, ..self.clone() }
    }

    /// Tells whether a folder is that of a run with a policy to fly.
    pub fn is_in(folder: &Path) -> bool {
        let has = |name: &str| folder.join(name).is_file();
        has(POLICY) || has(PUBLISHED) && has(SETTINGS)
    }

    /// Reads a policy, by its file or by the folder of its run; one that was published as `policy.onnx` with the
    /// `settings.toml` of its training beside it flies in the same bits.
    ///
    /// # Errors
    /// Names the file and what is wrong with it.
    pub fn load(path: &Path) -> Result<Self, TrainingError> {
        let path = match path.is_dir() {
            true if !path.join(POLICY).is_file() && Self::is_in(path) => path.join(PUBLISHED),
            true => path.join(POLICY),
            false => path.to_owned(),
        };
        if path.extension().is_some_and(|extension| extension == "onnx") {
            return Self::load_published(&path);
        }
        let bytes = regular_file::read(&path, MOST_POLICY_BYTES).map_err(|error| {
            let problem = format!("cannot be read: {error}; give an ONNX file, a policy.bin or the folder of a run");
            TrainingError::file(&path, &problem)
        })?;
        Self::from_bytes(&bytes).map_err(|problem| TrainingError::file(&path, &problem))
    }

    /// Reads a policy that was published, with the settings beside it.
    fn load_published(path: &Path) -> Result<Self, TrainingError> {
        let read = |file: &Path| {
            regular_file::read(file, MOST_POLICY_BYTES)
                .map_err(|error| TrainingError::file(file, &format!("cannot be read: {error}")))
        };
        let beside = path.with_file_name(SETTINGS);
        if !beside.exists() {
            return Self::load_alone(path, &read(path)?);
        }
        let settings = String::from_utf8_lossy(&read(&beside)?).into_owned();
        let settings = TrainingSettings::parse(&beside.display().to_string(), &settings)?;
        let exported =
            onnx_file::from_onnx(&read(path)?).map_err(|error| TrainingError::file(path, &error.to_string()))?;
        Self::published(settings, &exported).map_err(|problem| TrainingError::file(path, &problem))
    }

    /// Reads a policy that was published without the settings beside it: those that describe it, the rest as in the preset of
    /// its layout.
    fn load_alone(path: &Path, bytes: &[u8]) -> Result<Self, TrainingError> {
        let exported = onnx_file::from_onnx(bytes).map_err(|error| TrainingError::file(path, &error.to_string()))?;
        let told = |key: &str| exported.metadata.get(key).cloned().unwrap_or_default();
        let start = PolicyStart::load(path)?;
        let mut settings = TrainingSettings::preset(start.preset())?;
        settings.policy.variant = told("variant").parse().unwrap_or(settings.policy.variant);
        settings.run.seed = told("seed").parse().unwrap_or(settings.run.seed);
        start.adopt_into(&mut settings)?;
        settings.run.from = None;
        settings.run.critics_from = None;
        let origin = Origin { rig: told("rig"), rig_hash: told("rig_hash") };
        let steps = told("steps").parse().unwrap_or_default();
        let mut policy = TrainedPolicy::new(settings, origin, steps, start.network(Plan::Learned));
        policy.exploration_std = stated_std(&exported.metadata);
        Ok(policy)
    }

    /// The policy of a file that was exported, and the settings that it was trained with.
    fn published(settings: TrainingSettings, exported: &Exported) -> Result<Self, String> {
        let told = |key: &str| {
            exported.metadata.get(key).cloned().ok_or_else(|| format!("does not say its {key}; export it again"))
        };
        let trained = |key: &str, with: String| match told(key)? {
            told if told == with => Ok(()),
            told => Err(format!("has {key} {told}, the settings.toml beside it {with}; they are of two runs")),
        };
        trained("seed", settings.run.seed.to_string())?;
        trained("variant", settings.policy.variant.name().into())?;
        trained("preset", format!("contract {}", settings.policy.contract))?;
        let steps =
            told("steps")?.parse().map_err(|_| "does not say its steps in digits; export it again".to_owned())?;
        let origin = Origin { rig: told("rig")?, rig_hash: told("rig_hash")? };
        let feature = |f: &FeatureTerm| sac::Feature { plus: f.plus, minus: f.minus, offset: f.offset, scale: f.scale };
        let graph = &exported.graph;
        let features = sac::FeatureMap::new(graph.inputs, graph.features.iter().map(feature).collect());
        let network = network_of(graph, features.map_err(|error| error.to_string())?);
        network.check().map_err(|error| error.to_string())?;
        let mut policy = TrainedPolicy::new(settings, origin, steps, network);
        policy.exploration_std = stated_std(&exported.metadata);
        match policy.graph() == *graph {
            true => Ok(policy),
            false => Err("maps its outputs otherwise than the settings.toml beside it; they are of two runs".into()),
        }
    }

    /// Reads a policy's bytes.
    ///
    /// # Errors
    /// Values in them that are wrong.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        let damaged = || "is no policy of this program, or is damaged".to_owned();
        let rest = bytes.strip_prefix(MAGIC).ok_or_else(damaged)?;
        let (card, rest) = part(rest).ok_or_else(damaged)?;
        let (settings, rest) = part(rest).ok_or_else(damaged)?;
        let Card { origin, steps, exploration_std } = serde_json::from_slice(card).map_err(|_| damaged())?;
        let settings = std::str::from_utf8(settings).map_err(|_| damaged())?;
        let settings = TrainingSettings::parse("its settings", settings).map_err(|error| error.to_string())?;
        let network = Network::restore(rest).map_err(|error| error.to_string())?;
        Ok(TrainedPolicy { settings, origin, steps, network, exploration_std })
    }

    /// The policy's bytes.
    ///
    /// # Errors
    /// If its settings cannot be written.
    pub fn to_bytes(&self) -> Result<Vec<u8>, TrainingError> {
        let card =
            Card { origin: self.origin.clone(), steps: self.steps, exploration_std: self.exploration_std.clone() };
        let card = serde_json::to_vec(&card).map_err(|error| TrainingError::learner("policy", &error))?;
        let settings = self.settings.to_toml()?;
        let mut bytes = MAGIC.to_vec();
        for part in [card.as_slice(), settings.as_bytes()] {
            append_part(&mut bytes, part);
        }
        bytes.extend(self.network.save());
        Ok(bytes)
    }

    /// Flies it.
    pub fn runner(&self) -> Runner<'_> {
        Runner { policy: self, workspace: Workspace::default() }
    }

    /// Policy with a plan that is what it then does: outputs for later ticks fitted to runs of it on the model that it
    /// was trained with; the duties of now keep every bit.
    ///
    /// # Errors
    /// If a rig of its settings cannot be read or run.
    pub fn with_fitted_plan(&self) -> Result<Self, TrainingError> {
        self.with_plan_fitted_on(&load_for_loop(self.settings.rig.model(), Some("rig.model"))?)
    }

    /// Policy with a plan that holds the duties of now.
    #[must_use]
    pub fn with_held_plan(&self) -> Self {
        self.with_network(plan_fit::held(&self.network))
    }

    /// Policy with a plan fitted to runs on another model.
    ///
    /// # Errors
    /// If it cannot be run.
    pub fn with_plan_fitted_on(&self, rig: &Rig) -> Result<Self, TrainingError> {
        let map = steady_map(rig)?;
        let model = PlanModel { rig, map: &map };
        let measured = self.clone().with_spread(&model)?;
        let mut settings = self.settings.clone();
        settings.policy.plan = Plan::Fitted;
        let network = plan_fit::fitted(&self.network, &settings, &model)?;
        Ok(TrainedPolicy { settings, network, ..measured })
    }

    /// Tells whether the spread of its own distribution is known, where it has one: of each output that was learned.
    pub fn states_spread(&self) -> bool {
        let stated = self.exploration_std.as_ref().map(Vec::len);
        self.network.log_std.as_ref().is_none_or(|log_std| stated == Some(log_std.outputs))
    }

    /// Policy with the spread of its own distribution, measured on runs on a model; a policy that has none is as it was.
    ///
    /// # Errors
    /// If the model cannot be run.
    pub fn with_spread_on(&self, rig: &Rig) -> Result<Self, TrainingError> {
        let map = steady_map(rig)?;
        self.clone().with_spread(&PlanModel { rig, map: &map })
    }

    /// As [`Self::with_spread_on`], on a model whose map is known.
    pub(crate) fn with_spread(mut self, model: &PlanModel<'_>) -> Result<Self, TrainingError> {
        if self.network.log_std.is_some() {
            let hidden = plan_fit::hidden_along_runs(&self.network, &self.settings, model)?;
            let scale = f64::from(self.output_map().scale);
            self.exploration_std = spread::exploration_std(&self.network, hidden.iter().map(Vec::as_slice), scale);
        }
        Ok(self)
    }

    /// The policy as a graph: pressures in, duties or corrections out.
    pub fn graph(&self) -> PolicyGraph {
        let term = |f: &sac::Feature| FeatureTerm { plus: f.plus, minus: f.minus, offset: f.offset, scale: f.scale };
        let layer = |l: &sac::Dense| Dense {
            inputs: l.inputs,
            outputs: l.outputs,
            weights: l.weights.clone(),
            biases: l.bias.clone(),
        };
        PolicyGraph {
            inputs: self.settings.contract().observation_len(),
            features: self.network.features.features().iter().map(term).collect(),
            layers: self.network.layers.iter().map(layer).collect(),
            outputs: vec![self.output_map(); ACTION_LEN],
        }
    }

    /// Map from an action within −1 … 1 to a duty or a correction.
    pub(crate) fn output_map(&self) -> OutputMap {
        let contract = self.settings.contract();
        let at = |action: f32| vector_env::outputs(contract, &self.settings.environment, &[action; ACTION_LEN])[0];
        let (low, middle) = (at(-1.0), at(0.0));
        OutputMap { scale: middle - low, shift: middle }
    }

    /// The policy as an ONNX file, with golden pairs answered by the trainer's own network; `more` are further
    /// keys and values of its metadata, for example command and commit.
    ///
    /// # Errors
    /// If the exported graph does not answer as the network does.
    pub fn to_onnx(&self, more: &[(String, String)]) -> Result<Vec<u8>, TrainingError> {
        let contract = self.settings.contract();
        let mut runner = self.runner();
        let golden: Vec<GoldenPair> = golden_inputs(contract)
            .into_iter()
            .map(|input| GoldenPair { output: runner.outputs(&input).to_vec(), input })
            .collect();
        let provenance = Provenance {
            rig: self.origin.rig.clone(),
            rig_hash: self.origin.rig_hash.clone(),
            seed: self.settings.run.seed,
            steps: self.steps,
            variant: self.settings.policy.variant.name().into(),
            preset: format!("contract {}", self.settings.policy.contract),
            trainer: env!("CARGO_PKG_VERSION").into(),
            more: more.iter().cloned().chain(self.exploration_std.as_deref().map(std_entry)).collect(),
        };
        onnx_file::to_onnx(&self.graph(), &Ports::of(contract), &provenance, &golden)
            .map_err(|error| TrainingError::learner("export", &error))
    }
}

fn steady_map(rig: &Rig) -> Result<Arc<SteadyMap>, TrainingError> {
    let map = SteadyMap::new(rig).map_err(|problem| RigFileError::Rig { file: rig.name.clone(), problem })?;
    Ok(Arc::new(map))
}

fn std_entry(std_duty: &[f64]) -> (String, String) {
    (EXPLORATION_STD_KEY.to_owned(), exploration_std_text(std_duty))
}

fn stated_std(metadata: &BTreeMap<String, String>) -> Option<Vec<f64>> {
    metadata.get(EXPLORATION_STD_KEY).and_then(|text| exploration_std(text))
}

/// The network of a graph, without a deviation.
pub(crate) fn network_of(graph: &PolicyGraph, features: sac::FeatureMap) -> Network {
    let layer = |l: &Dense| sac::Dense {
        inputs: l.inputs,
        outputs: l.outputs,
        weights: l.weights.clone(),
        bias: l.biases.clone(),
    };
    Network { features, layers: graph.layers.iter().map(layer).collect(), log_std: None }
}

/// A policy that answers in the units of its contract.
#[derive(Debug, Clone)]
pub struct Runner<'a> {
    policy: &'a TrainedPolicy,
    workspace: Workspace,
}

impl Runner<'_> {
    /// Duties or corrections for an observation.
    pub fn outputs(&mut self, observation: &[f32]) -> [f32; ACTION_LEN] {
        let settings = &self.policy.settings;
        let action = self.policy.network.mean_action_with(&mut self.workspace, observation);
        vector_env::outputs(settings.contract(), &settings.environment, action)
    }
}

/// Observations that a flight could make: on the reference, off it, and at the ends of the range.
fn golden_inputs(contract: ObservationLayout) -> Vec<Vec<f32>> {
    let places = [[85.0, -72.0], [80.0, -70.0], [104.0, -77.0], [60.0, -60.0], [125.0, -65.0], [0.0, 0.0]];
    places
        .iter()
        .enumerate()
        .map(|(n, place)| {
            let shape = |tick: usize, c: usize| {
                let wave = (0.7 * tick as f32 + 1.3 * n as f32 + c as f32).sin();
                wave * [0.8, 0.3][c]
            };
            let mut input = Vec::with_capacity(contract.observation_len());
            for tick in 0..PAST + 1 + AHEAD {
                input.extend((0..CHANNELS).map(|c| place[c] + shape(tick, c)));
            }
            for tick in 0..PAST + 1 + GOALS_AHEAD {
                input.extend((0..CHANNELS).map(|c| place[c] + 0.1 * tick as f32 * shape(n, c)));
            }
            if contract == ObservationLayout::Correction {
                let limit = CORRECTION_LIMIT as f32;
                for tick in 0..PAST + AHEAD + 1 {
                    input.extend((0..CHANNELS).map(|c| (0.75 + 0.3 * limit * shape(tick, c)).clamp(0.0, 1.0)));
                }
                input.extend([0.01, -0.02, 0.03, -0.03, 0.03, 0.02, 0.05, -0.04]);
            }
            input
        })
        .collect()
}
