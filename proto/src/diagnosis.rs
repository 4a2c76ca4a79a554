//! `diagnosis.json`: what `trainer diagnose` found missing from a rig's model.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// The five answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The rig file as it stands explains the recordings.
    Adequate,
    /// Other parameters are all that is needed.
    ParametersMoved,
    /// These mechanisms are missing.
    MissingPhysics,
    /// Something is off, but the recordings do not tell what; an experiment would.
    Undecided,
    /// None of the known mechanisms explains it.
    UnknownMechanism,
}

impl Verdict {
    /// The verdict as `diagnosis.json` writes it.
    pub fn as_str(self) -> &'static str {
        match self {
            Verdict::Adequate => "adequate",
            Verdict::ParametersMoved => "parameters_moved",
            Verdict::MissingPhysics => "missing_physics",
            Verdict::Undecided => "undecided",
            Verdict::UnknownMechanism => "unknown_mechanism",
        }
    }
}

/// A parameter of a mechanism that was found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FoundParameter {
    /// Value.
    pub value: f64,
    /// Unit of the value.
    pub unit: String,
    /// Lower end of the interval that holds it with 90 %.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// The end of the range that was searched at which the value stands, if it does: no answer then, only "this or more".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_end_of_range: Option<RangeEnd>,
    /// True where the interval is nearly all of the range that was searched: the value is no answer then, the recordings do not tell it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub undetermined: bool,
}

/// An end of the range in which a number was searched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RangeEnd {
    /// The lowest value.
    Low,
    /// The highest one.
    High,
}

/// Evidence for a mechanism.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FoundEvidence {
    /// Log-likelihood lost without it, everything else fitted again.
    pub delta_log_likelihood: f64,
    /// Share of the held-out free-run RMSE that goes with it (1 is all).
    pub held_out_rmse_gain: f64,
}

/// A mechanism that was found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FoundMechanism {
    /// The mechanism's id.
    pub id: String,
    /// `positive`, `negative` or `both`.
    #[serde(rename = "where")]
    pub side: String,
    /// The component, or components joined by a comma.
    pub component: String,
    /// One plain sentence.
    pub summary: String,
    /// Parameters by name.
    pub parameters: BTreeMap<String, FoundParameter>,
    /// Evidence for it.
    pub evidence: FoundEvidence,
    /// Mechanisms that explain the recordings as well in its place.
    pub rivals: Vec<String>,
}

/// Where a mismatch lives.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Location {
    /// `positive`, `negative` or `both`.
    #[serde(rename = "where")]
    pub side: String,
    /// The component.
    pub component: String,
    /// Share of what the re-identified rig does not explain, 0 … 1.
    pub share_of_residual: f64,
    /// The operating region, in words and numbers.
    pub region: String,
    /// First and last time in s.
    pub time_s: [f64; 2],
    /// Time in which the mismatch comes and goes (s).
    pub time_scale_s: f64,
    /// The place where it enters: the mass balance or the reading.
    pub enters: String,
}

/// Errors of a rig that runs freely over rows that nothing was fitted to.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Fit {
    /// RMSE of the positive channel in kPa.
    pub pos_rmse_kpa: f64,
    /// RMSE of the negative channel in kPa; `null` on a rig that has one channel only.
    pub neg_rmse_kpa: Option<f64>,
    /// 1 − mean absolute percentage error of the positive channel; `null` where it hardly leaves the atmosphere.
    pub pos_accuracy: Option<f64>,
    /// 1 − mean absolute percentage error of the negative channel; `null` where it hardly leaves the atmosphere, or the rig has
    /// none.
    pub neg_accuracy: Option<f64>,
}

/// Three rigs on the same held-out rows.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Fits {
    /// The rig as it was given.
    pub nominal: Fit,
    /// Given rig with its parameters fitted.
    pub reidentified: Fit,
    /// With what was found.
    pub extended: Fit,
}

/// RMSE of one channel with the same three rigs on the same rows, in kPa: for rigs of any number of channels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ChannelFit {
    /// Column of the recordings.
    pub channel: String,
    /// With the rig as it was given.
    pub nominal_rmse_kpa: f64,
    /// With its parameters fitted.
    pub reidentified_rmse_kpa: f64,
    /// With what was found.
    pub extended_rmse_kpa: f64,
}

/// The unexplained residual of one channel with the rig that was written, beyond the noise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Unexplained {
    /// Column of the recordings.
    pub channel: String,
    /// `positive`, `negative`, or the volume's name in a rig of other volumes.
    #[serde(rename = "where")]
    pub side: String,
    /// Root mean square on validation data, the noise's share taken out, in kPa.
    pub kpa: f64,
    /// Standard deviation of the noise in kPa.
    pub noise_kpa: f64,
    /// `kpa` as a multiple of the noise.
    pub times_noise: f64,
    /// The operating region that holds most of it, in words and numbers.
    pub region: String,
    /// The recording in whose rows that are no validation data the rig is furthest off, where that is much further than on validation data.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub further_off: Option<FurtherOff>,
}

impl Unexplained {
    /// Largest multiple of the noise that is left, on validation data or in other rows of a recording.
    pub fn most_times_noise(&self) -> f64 {
        self.further_off.as_ref().map_or(self.times_noise, |further| self.times_noise.max(further.times_noise))
    }
}

/// The residual of one channel in a recording whose rows were fitted or chose, beyond the noise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FurtherOff {
    /// The recording.
    pub recording: String,
    /// Root mean square on these rows, the noise's share taken out, in kPa.
    pub kpa: f64,
    /// Standard deviation of the noise there in kPa.
    pub noise_kpa: f64,
    /// `kpa` as a multiple of the noise.
    pub times_noise: f64,
}

/// A parameter of the written rig that went where nobody would believe it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DoubtfulParameter {
    /// Dotted key of the rig file.
    pub parameter: String,
    /// Unit.
    pub unit: String,
    /// Value in the rig file that was given.
    pub stated: f64,
    /// Value in the rig file that was written.
    pub fitted: f64,
    /// Distance in standard deviations of what such a part scatters by.
    pub deviations: f64,
}

/// A lasting change of the mismatch at a moment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ChangeInTime {
    /// The file.
    pub recording: String,
    /// Column of the recordings.
    pub channel: String,
    /// When, in s of that recording.
    pub time_s: f64,
    /// Jump of the error (recorded less simulated) in kPa.
    pub jump_kpa: f64,
}

/// Which rig a diagnosis has written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RigKind {
    /// The rig as it was given, for nothing was better on validation data.
    #[default]
    AsGiven,
    /// Given rig with its parameters fitted.
    Fitted,
    /// The rig with what was found, named or not.
    Extended,
}

/// The rig file that was written.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct WrittenRig {
    /// Name of the file.
    pub name: String,
    /// Difference from the one that was given.
    pub kind: RigKind,
}

/// Advice on the next step.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct NextStep {
    /// The reason, in one sentence.
    pub why: String,
    /// Lines for a shell, in order; empty where no command would help.
    pub commands: Vec<String>,
}

/// A diagnosis, as `diagnosis.json` holds it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Diagnosis {
    /// The answer.
    pub verdict: Verdict,
    /// The answer in one sentence that needs no knowledge of the method.
    pub summary: String,
    /// Mechanisms that were found.
    pub mechanisms: Vec<FoundMechanism>,
    /// Where the mismatch lives.
    pub location: Vec<Location>,
    /// Before and after, on held-out stretches.
    pub fit: Fits,
    /// Fits of every channel, in the order of the rig's sensors.
    #[serde(default)]
    pub fit_by_channel: Vec<ChannelFit>,
    /// Groups that these recordings cannot tell apart, as `id:where`.
    pub rivals: Vec<Vec<String>>,
    /// Name of the experiment's file, if one is needed.
    pub next_experiment: Option<String>,
    /// Plain words on recordings that are too short, flat, clipped, or otherwise poor.
    pub notes: Vec<String>,
    /// Unexplained residual by channel, on validation data, with the rig that was written.
    #[serde(default)]
    pub unexplained: Vec<Unexplained>,
    /// Terms of the written rig that have no name of their own, as the rig file states them, with all their numbers.
    #[serde(default)]
    pub unnamed_terms: Vec<serde_json::Value>,
    /// Hypotheses that are not told from each other, the best first: the mechanisms that each adds to the given rig, as a rig file states
    /// them, with all their numbers. One that adds nothing is that parameters moved. Empty where the answer is no choice.
    #[serde(default)]
    pub hypotheses: Vec<Vec<serde_json::Value>>,
    /// Parameters that went where nobody would believe them.
    #[serde(default)]
    pub doubtful_parameters: Vec<DoubtfulParameter>,
    /// Lasting changes at a moment.
    #[serde(default)]
    pub changes: Vec<ChangeInTime>,
    /// The rig file that was written.
    #[serde(default)]
    pub rig: WrittenRig,
    /// Advice on the next step.
    #[serde(default)]
    pub next_step: NextStep,
}

impl Diagnosis {
    /// Reads the text of `diagnosis.json`.
    ///
    /// # Errors
    /// It is no JSON, or not of this form; the message names line and key.
    pub fn from_json(text: &str) -> Result<Self, serde_json::Error> {
        serde_json::from_str(text)
    }

    /// The text of `diagnosis.json`.
    ///
    /// # Errors
    /// A number that JSON has no form for.
    pub fn to_json(&self) -> Result<String, serde_json::Error> {
        serde_json::to_string_pretty(self).map(|text| text + "\n")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_again_under_the_names_of_the_interface() {
        let found = FoundMechanism {
            id: "valve_hysteresis".to_owned(),
            side: "negative".to_owned(),
            component: "valve_neg".to_owned(),
            summary: "It has play.".to_owned(),
            parameters: BTreeMap::from([(
                "half_width_duty".to_owned(),
                FoundParameter {
                    value: 0.031,
                    unit: "duty".to_owned(),
                    low: 0.028,
                    high: 0.034,
                    at_end_of_range: None,
                    undetermined: false,
                },
            )]),
            evidence: FoundEvidence { delta_log_likelihood: 1234.5, held_out_rmse_gain: 0.62 },
            rivals: vec!["valve_stiction".to_owned()],
        };
        let fit =
            Fit { pos_rmse_kpa: 2.5, neg_rmse_kpa: Some(0.5), pos_accuracy: Some(0.97), neg_accuracy: Some(0.99) };
        let diagnosis = Diagnosis {
            verdict: Verdict::MissingPhysics,
            summary: String::new(),
            mechanisms: vec![found],
            location: Vec::new(),
            fit: Fits { nominal: fit, reidentified: fit, extended: fit },
            fit_by_channel: vec![ChannelFit {
                channel: "p_pos_kpa".to_owned(),
                nominal_rmse_kpa: 2.5,
                reidentified_rmse_kpa: 1.25,
                extended_rmse_kpa: 0.75,
            }],
            rivals: vec![vec!["chamber_leak:positive".to_owned(), "piston_blowby:both".to_owned()]],
            next_experiment: None,
            notes: Vec::new(),
            unexplained: vec![Unexplained {
                channel: "p_pos_kpa".to_owned(),
                side: "positive".to_owned(),
                kpa: 0.75,
                noise_kpa: 0.06,
                times_noise: 12.5,
                region: "rising u_pos between 0.70 and 0.85".to_owned(),
                further_off: Some(FurtherOff {
                    recording: "experiment.mcap".to_owned(),
                    kpa: 3.0,
                    noise_kpa: 0.06,
                    times_noise: 50.0,
                }),
            }],
            unnamed_terms: Vec::new(),
            hypotheses: Vec::new(),
            doubtful_parameters: Vec::new(),
            changes: Vec::new(),
            rig: WrittenRig { name: "dual_pressure_extended".to_owned(), kind: RigKind::Extended },
            next_step: NextStep::default(),
        };
        let text = diagnosis.to_json().unwrap();
        assert_eq!(Diagnosis::from_json(&text).unwrap(), diagnosis);
        let value: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(value["unexplained"][0]["further_off"]["recording"], "experiment.mcap");
        assert_eq!(diagnosis.unexplained[0].most_times_noise(), 50.0);
        // Answers of older programs have no such line.
        let mut older = value.clone();
        older["unexplained"][0].as_object_mut().unwrap().remove("further_off").unwrap();
        let older = Diagnosis::from_json(&older.to_string()).unwrap();
        assert_eq!(older.unexplained[0].most_times_noise(), 12.5);
        assert_eq!(value["verdict"], "missing_physics");
        assert_eq!(value["mechanisms"][0]["where"], "negative");
        assert_eq!(value["mechanisms"][0]["parameters"]["half_width_duty"]["low"], 0.028);
        assert_eq!(value["mechanisms"][0]["evidence"]["delta_log_likelihood"], 1234.5);
        assert!(value["fit"]["reidentified"]["neg_rmse_kpa"].is_number() && value["next_experiment"].is_null());
        for verdict in ["adequate", "parameters_moved", "missing_physics", "undecided", "unknown_mechanism"] {
            let read: Verdict = serde_json::from_value(verdict.into()).unwrap();
            assert_eq!(read.as_str(), verdict);
        }
    }
}
