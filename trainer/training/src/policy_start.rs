//! A policy that a run starts from: an ONNX file of ours, or the folder of a run.
//!
//! What the policy was trained on may differ from what the run trains on; what it is told, how that is put to the network,
//! the widths of its layers and the range of its answers go with it and replace the settings'. A run's folder also has the
//! settings of its training and, where it still holds its checkpoint, critics and a temperature.

use std::path::{Path, PathBuf};

use model::observation::ObservationLayout;
use onnx_file::{Exported, FeatureTerm, OutputMap};
use proto::regular_file;
use sac::{Feature, FeatureMap, Learner, Network};

use crate::TrainingError;
use crate::checkpoint_file;
use crate::plan_fit;
use crate::run_files::RunFiles;
use crate::settings::{Features, Plan, TrainingSettings, Variant};
use crate::trained_policy::{MOST_POLICY_BYTES, TrainedPolicy, network_of};

/// Temperature from which a policy goes on whose critics begin fresh. The paper's 1 is that of a policy that knows nothing: for
/// some thousand updates it would seek entropy alone and forget what it was trained for. Presets end at 0.005 to 0.02; too
/// low a one is learned upwards before much is lost.
const MOST_FIRST_TEMPERATURE: f64 = 0.01;

/// A policy that a run starts from.
#[derive(Debug, Clone, PartialEq)]
pub struct PolicyStart {
    label: String,
    layout: ObservationLayout,
    network: Network,
    /// Answer to an action of 0, and what an action of 1 adds to it.
    range: OutputMap,
    /// Settings that the policy of a run's folder was trained with.
    trained_with: Option<Box<TrainingSettings>>,
    /// Checkpoint of a run's folder that holds one.
    checkpoint: Option<PathBuf>,
}

impl PolicyStart {
    /// Reads a policy: an ONNX file that `trainer` wrote (alone or in the folder of a run), or the folder of a run.
    ///
    /// # Errors
    /// If it cannot be read, or is no policy of ours.
    pub fn load(path: &Path) -> Result<Self, TrainingError> {
        let label = path.display().to_string();
        if path.is_file() && path.extension().is_some_and(|extension| extension == "onnx") {
            let bytes = regular_file::read(path, MOST_POLICY_BYTES)
                .map_err(|error| TrainingError::file(path, &format!("cannot be read: {error}")))?;
            let exported =
                onnx_file::from_onnx(&bytes).map_err(|error| TrainingError::file(path, &error.to_string()))?;
            return Self::of_exported(label, &exported).map_err(|problem| TrainingError::file(path, &problem));
        }
        let policy = TrainedPolicy::load(path)?;
        Ok(PolicyStart {
            label,
            layout: policy.settings().contract(),
            range: policy.output_map(),
            network: policy.network().clone(),
            trained_with: Some(Box::new(policy.settings().clone())),
            checkpoint: RunFiles::open(path).ok().map(|files| files.checkpoint()),
        })
    }

    fn of_exported(label: String, exported: &Exported) -> Result<Self, String> {
        let graph = &exported.graph;
        let layout = [ObservationLayout::Paper, ObservationLayout::Correction]
            .into_iter()
            .find(|layout| layout.observation_len() == graph.inputs)
            .ok_or_else(|| format!("takes {} numbers, which no observation layout has", graph.inputs))?;
        let range = match graph.outputs.as_slice() {
            [first, rest @ ..] if rest.iter().all(|map| map == first) => *first,
            _ => return Err("maps its outputs each by itself; no training can go on from that".into()),
        };
        let feature = |f: &FeatureTerm| Feature { plus: f.plus, minus: f.minus, offset: f.offset, scale: f.scale };
        let features = FeatureMap::new(graph.inputs, graph.features.iter().map(feature).collect());
        let network = network_of(graph, features.map_err(|error| error.to_string())?);
        network.check().map_err(|error| error.to_string())?;
        Ok(PolicyStart { label, layout, network, range, trained_with: None, checkpoint: None })
    }

    /// Where it was read from.
    pub fn label(&self) -> &str {
        &self.label
    }

    /// CRC-32C of its features and weights, eight hexadecimal digits: which policy it is, wherever it was read from.
    pub fn crc32c(&self) -> String {
        format!("{:08x}", crc32c::crc32c(&self.network.save()))
    }

    /// The preset that policies of its layout are trained with.
    pub fn preset(&self) -> &'static str {
        match self.layout {
            ObservationLayout::Paper => "paper",
            ObservationLayout::Correction => "correction",
        }
    }

    /// Settings to go on with: those that it was trained with where they are known, else the preset of its layout.
    ///
    /// # Errors
    /// If the preset cannot be read.
    pub fn settings(&self) -> Result<TrainingSettings, TrainingError> {
        match &self.trained_with {
            Some(settings) => Ok(TrainingSettings::clone(settings)),
            None => TrainingSettings::preset(self.preset()),
        }
    }

    /// Lets a learner of settings that describe this policy ([`Self::adopt_into`]) begin where it stands: its weights, and
    /// the critics and the temperature that belong to them where the settings name a checkpoint.
    ///
    /// # Errors
    /// A learner of another shape, or a checkpoint that is damaged, by name.
    pub fn warm_start(
        &self,
        learner: &mut Learner,
        settings: &TrainingSettings,
        threads: usize,
    ) -> Result<(), TrainingError> {
        let refused = |error: sac::LearnerError| TrainingError::learner("--from", &error);
        learner.warm_start(&self.network(settings.policy.plan)).map_err(refused)?;
        let Some(checkpoint) = &settings.run.critics_from else { return Ok(()) };
        let before = checkpoint_file::learner_of(Path::new(checkpoint), threads)?;
        learner.warm_start_critics(&before).map_err(refused)
    }

    /// Lets a learner remember the last transitions, at most so many, of the run whose critics the settings name: where the
    /// next ones come from a rig that is flown near its goal, they are all that still says what is worth what far from it.
    ///
    /// # Errors
    /// A checkpoint or a piece of its replay that is damaged or missing, by name.
    pub fn remember(&self, learner: &mut Learner, settings: &TrainingSettings, most: u64) -> Result<(), TrainingError> {
        let Some(checkpoint) = settings.run.critics_from.as_ref().filter(|_| most > 0) else { return Ok(()) };
        let files = RunFiles::open(Path::new(checkpoint).parent().unwrap_or(Path::new(".")))?;
        let before = checkpoint_file::learner_with_replay(&files, 1)?;
        let rows = before.replay_rows();
        let first = rows.start.max(rows.end.saturating_sub(most));
        learner.restore_replay_rows(0, &before.copy_replay_rows(first..rows.end));
        Ok(())
    }

    /// Weights, for an actor that answers as much as `plan` says.
    pub fn network(&self, plan: Plan) -> Network {
        match plan {
            Plan::Learned => self.network.clone(),
            Plan::Fitted => plan_fit::without_plan(&self.network),
        }
    }

    /// Lets the settings describe this policy: layout, features, widths, range of answers.
    ///
    /// # Errors
    /// A policy that no settings describe, with what it has that they have not.
    pub fn adopt_into(&self, settings: &mut TrainingSettings) -> Result<(), TrainingError> {
        let refused = |problem: String| TrainingError::File { file: self.label.clone(), problem };
        settings.run.from = Some(self.label.clone());
        settings.run.critics_from = self.critics_for(settings);
        if settings.run.critics_from.is_none() {
            let first = &mut settings.sac.first_temperature;
            *first = first.min(MOST_FIRST_TEMPERATURE);
        }
        settings.policy.contract = self.layout.version();
        // Of what learns: units that only a fitted plan uses are left behind.
        let network = self.network(settings.policy.plan);
        let hidden = network.layers.iter().map(|layer| layer.outputs);
        let hidden: Vec<usize> = hidden.take(network.layers.len().saturating_sub(1)).collect();
        settings.policy.hidden = hidden.try_into().map_err(|found: Vec<usize>| {
            refused(format!("has {} hidden layers; training goes on from policies with two", found.len()))
        })?;
        let OutputMap { scale, shift } = self.range;
        match self.layout {
            ObservationLayout::Paper => {
                settings.environment.duty_low = f64::from(shift - scale);
                settings.environment.duty_high = f64::from(shift + scale);
            }
            ObservationLayout::Correction if shift == 0.0 => {
                settings.environment.correction_duty = rounded_duty(scale);
            }
            ObservationLayout::Correction => {
                return Err(refused(format!("adds {shift} of duty in its middle; corrections lie around zero")));
            }
        }
        self.adopt_features(settings).ok_or_else(|| {
            refused(
                "puts observations to its network in a way that this program does not; train anew without --from"
                    .into(),
            )
        })
    }

    /// The checkpoint whose critics say what this policy is worth under these settings: it was trained for the same reward,
    /// weighed alike, and its actor learned as much of the answer.
    fn critics_for(&self, settings: &TrainingSettings) -> Option<String> {
        let (checkpoint, with) = self.checkpoint.as_ref().zip(self.trained_with.as_ref())?;
        let is_same_worth = with.environment.reward == settings.environment.reward
            && with.sac.discount == settings.sac.discount
            && with.policy.plan == settings.policy.plan;
        is_same_worth.then(|| checkpoint.display().to_string())
    }

    /// The features and the half of the ablation that the policy was trained with; `None` where there are none such.
    fn adopt_features(&self, settings: &mut TrainingSettings) -> Option<()> {
        let asked = settings.policy.variant;
        let other = match asked {
            Variant::Raw => Variant::Mpobs,
            Variant::Mpobs => Variant::Raw,
            Variant::Caps => Variant::Both,
            Variant::Both => Variant::Caps,
        };
        for variant in [asked, other] {
            for features in [Features::Plain, Features::Errors] {
                (settings.policy.variant, settings.policy.features) = (variant, features);
                if settings.feature_map().is_ok_and(|map| map == self.network.features) {
                    return Some(());
                }
            }
        }
        settings.policy.variant = asked;
        None
    }
}

/// A range in f32 as the decimal number that was meant.
fn rounded_duty(range: f32) -> f64 {
    let text = range.to_string();
    text.parse().unwrap_or(f64::from(range))
}
