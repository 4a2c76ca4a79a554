//! A policy that a run starts from: an ONNX file of ours, or the folder of a run.
//!
//! What the policy was trained on may differ from what the run trains on; what it is told, how that is put to the network,
//! the widths of its layers and the range of its answers go with it and replace the settings'.

use std::path::Path;

use model::observation::ObservationLayout;
use onnx_file::{Exported, FeatureTerm, OutputMap};
use proto::regular_file;
use sac::{Feature, FeatureMap, Network};

use crate::TrainingError;
use crate::plan_fit;
use crate::settings::{Features, Plan, TrainingSettings, Variant};
use crate::trained_policy::{MOST_POLICY_BYTES, TrainedPolicy, network_of};

/// A policy that a run starts from.
#[derive(Debug, Clone, PartialEq)]
pub struct PolicyStart {
    label: String,
    layout: ObservationLayout,
    network: Network,
    /// Answer to an action of 0, and what an action of 1 adds to it.
    range: OutputMap,
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
        Ok(PolicyStart { label, layout, network, range })
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

    /// Its weights, for an actor that answers as much as `plan` says.
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
