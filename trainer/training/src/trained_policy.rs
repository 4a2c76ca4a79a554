//! A policy as it was trained: network, settings and origin in one file; flown in evaluations, exported for the daemon.
//!
//! ```text
//! "DPPOL001"   u32 length   card as JSON   u32 length   settings as TOML   the network's own bytes, checksum included
//! ```

use environment::fleet;
use model::contract::{ACTION_LEN, AHEAD, CHANNELS, CORRECTION_LIMIT, Contract, GOALS_AHEAD, PAST};
use model::rig::Rig;
use onnx_file::{Dense, FeatureTerm, GoldenPair, OutputMap, PolicyGraph, Ports, Provenance};
use sac::{Network, Workspace};
use serde::{Deserialize, Serialize};
use std::path::Path;

use crate::TrainingError;
use crate::checkpoint::part;
use crate::settings::TrainingSettings;

const MAGIC: &[u8; 8] = b"DPPOL001";

/// What a policy was trained on.
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
}

#[derive(Serialize, Deserialize)]
struct Card {
    origin: Origin,
    steps: u64,
}

impl TrainedPolicy {
    /// Puts a policy together.
    pub fn new(settings: TrainingSettings, origin: Origin, steps: u64, network: Network) -> Self {
        TrainedPolicy { settings, origin, steps, network }
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

    /// Reads a policy, by its file or by the folder of its run.
    ///
    /// # Errors
    /// Names the file and what is wrong with it.
    pub fn load(path: &Path) -> Result<Self, TrainingError> {
        let path = if path.is_dir() { path.join("policy.bin") } else { path.to_owned() };
        let bytes = std::fs::read(&path).map_err(|error| {
            TrainingError::file(&path, &format!("cannot be read: {error}; give the folder of a run or its policy.bin"))
        })?;
        Self::from_bytes(&bytes).map_err(|problem| TrainingError::file(&path, &problem))
    }

    /// Reads a policy's bytes.
    ///
    /// # Errors
    /// What is wrong with them.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        let damaged = || "is no policy of this program, or is damaged".to_owned();
        let rest = bytes.strip_prefix(MAGIC).ok_or_else(damaged)?;
        let (card, rest) = part(rest).ok_or_else(damaged)?;
        let (settings, rest) = part(rest).ok_or_else(damaged)?;
        let Card { origin, steps } = serde_json::from_slice(card).map_err(|_| damaged())?;
        let settings = std::str::from_utf8(settings).map_err(|_| damaged())?;
        let settings = TrainingSettings::parse("its settings", settings).map_err(|error| error.to_string())?;
        let network = Network::restore(rest).map_err(|error| error.to_string())?;
        Ok(TrainedPolicy { settings, origin, steps, network })
    }

    /// The policy's bytes.
    ///
    /// # Errors
    /// If its settings cannot be written.
    pub fn to_bytes(&self) -> Result<Vec<u8>, TrainingError> {
        let card = Card { origin: self.origin.clone(), steps: self.steps };
        let card = serde_json::to_vec(&card).map_err(|error| TrainingError::learner("policy", &error))?;
        let settings = self.settings.to_toml()?;
        let mut bytes = MAGIC.to_vec();
        for part in [card.as_slice(), settings.as_bytes()] {
            bytes.extend((part.len() as u32).to_le_bytes());
            bytes.extend(part);
        }
        bytes.extend(self.network.save());
        Ok(bytes)
    }

    /// Flies it.
    pub fn runner(&self) -> Runner<'_> {
        Runner { policy: self, workspace: Workspace::default() }
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
        let contract = self.settings.contract();
        let at = |action: f32| fleet::outputs(contract, &self.settings.environment, &[action; ACTION_LEN])[0];
        let (low, middle) = (at(-1.0), at(0.0));
        PolicyGraph {
            inputs: contract.observation_len(),
            features: self.network.features.features().iter().map(term).collect(),
            layers: self.network.layers.iter().map(layer).collect(),
            outputs: vec![OutputMap { scale: middle - low, shift: middle }; ACTION_LEN],
        }
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
            more: more.to_vec(),
        };
        onnx_file::to_onnx(&self.graph(), &Ports::of(contract), &provenance, &golden)
            .map_err(|error| TrainingError::learner("export", &error))
    }
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
        fleet::outputs(settings.contract(), &settings.environment, action)
    }
}

/// Observations that a flight could make: on the reference, off it, and at the ends of the range.
fn golden_inputs(contract: Contract) -> Vec<Vec<f32>> {
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
            if contract == Contract::Correction {
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
