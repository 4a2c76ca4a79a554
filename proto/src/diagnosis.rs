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
    /// Its value.
    pub value: f64,
    /// Its unit.
    pub unit: String,
    /// Lower end of the interval that holds it with 90 %.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// What speaks for a mechanism.
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
    /// What speaks for it.
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
    /// Its share of what the re-identified rig does not explain, 0 … 1.
    pub share_of_residual: f64,
    /// The operating region, in words and numbers.
    pub region: String,
    /// First and last time in s.
    pub time_s: [f64; 2],
    /// How fast the mismatch comes and goes, in s.
    pub time_scale_s: f64,
    /// Whether it enters the mass balance or the reading.
    pub enters: String,
}

/// How well a rig runs freely over rows that nothing was fitted to.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Fit {
    /// RMSE of the positive channel in kPa.
    pub pos_rmse_kpa: f64,
    /// RMSE of the negative channel in kPa.
    pub neg_rmse_kpa: f64,
    /// 1 − mean absolute percentage error of the positive channel.
    pub pos_accuracy: f64,
    /// 1 − mean absolute percentage error of the negative channel.
    pub neg_accuracy: f64,
}

/// Three rigs on the same held-out rows.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Fits {
    /// The rig as it was given.
    pub nominal: Fit,
    /// The same with its parameters fitted.
    pub reidentified: Fit,
    /// With what was found.
    pub extended: Fit,
}

/// A diagnosis, as `diagnosis.json` holds it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Diagnosis {
    /// The answer.
    pub verdict: Verdict,
    /// The answer in one sentence that needs no knowledge of the method.
    pub summary: String,
    /// What was found.
    pub mechanisms: Vec<FoundMechanism>,
    /// Where the mismatch lives.
    pub location: Vec<Location>,
    /// Before and after, on held-out stretches.
    pub fit: Fits,
    /// What these recordings cannot tell apart, as `id:where`.
    pub rivals: Vec<Vec<String>>,
    /// Name of the experiment's file, if one is needed.
    pub next_experiment: Option<String>,
    /// Plain words on recordings that are too short, flat, clipped, or otherwise poor.
    pub notes: Vec<String>,
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
                FoundParameter { value: 0.031, unit: "duty".to_owned(), low: 0.028, high: 0.034 },
            )]),
            evidence: FoundEvidence { delta_log_likelihood: 1234.5, held_out_rmse_gain: 0.62 },
            rivals: vec!["valve_stiction".to_owned()],
        };
        let diagnosis = Diagnosis {
            verdict: Verdict::MissingPhysics,
            summary: String::new(),
            mechanisms: vec![found],
            location: Vec::new(),
            fit: Fits::default(),
            rivals: vec![vec!["chamber_leak:positive".to_owned(), "piston_blowby:both".to_owned()]],
            next_experiment: None,
            notes: Vec::new(),
        };
        let text = diagnosis.to_json().unwrap();
        assert_eq!(Diagnosis::from_json(&text).unwrap(), diagnosis);
        let value: serde_json::Value = serde_json::from_str(&text).unwrap();
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
