//! Inputs of a run, in one line: plant, model, start.

use model::rig::{Numbers as _, Rig};

use super::Run;
use crate::settings::TrainingSettings;

impl Run {
    /// Plant, model behind MPObs and feed-forward, and where the policy starts, in one line.
    pub fn taken(&self) -> String {
        taken(&self.settings, &self.trained_on, &self.model)
    }
}

/// Inputs of a run with these settings, in words.
pub(crate) fn taken(settings: &TrainingSettings, trained_on: &Rig, model: &Rig) -> String {
    let is_randomised = !settings.environment.mechanisms.is_empty() || settings.environment.spread.is_any();
    let plant = format!(
        "plant {}{}{}",
        settings.rig.trained_on,
        mechanisms(trained_on),
        if is_randomised { ", randomised around that" } else { "" }
    );
    let model = if model == trained_on {
        "model the same rig".to_owned()
    } else {
        format!("model {}{}", settings.rig.model(), mechanisms(model))
    };
    let start = match &settings.run.from {
        Some(from) if settings.run.critics_from.is_some() => format!("policy and critics from {from}"),
        Some(from) => format!("policy from {from}"),
        None => "policy from nothing".to_owned(),
    };
    format!("{plant}; {model}; {start}")
}

/// The mechanisms of a rig with their first number each; empty where it has none.
fn mechanisms(rig: &Rig) -> String {
    let named: Vec<String> = rig
        .mechanisms
        .iter()
        .filter(|m| m.enabled)
        .map(|m| {
            let numbers = m.mechanism.numbers();
            let first = numbers.first().map(|n| format!(" {} {}", significant(m.mechanism.number(0)), n.unit));
            format!("{} {}{}", m.mechanism.id(), m.component, first.unwrap_or_default().trim_end())
        })
        .collect();
    if named.is_empty() { String::new() } else { format!(" ({})", named.join(", ")) }
}

/// Three significant digits.
fn significant(value: f64) -> String {
    match value.abs() {
        0.0 => "0".to_owned(),
        size if (1e-3..1e4).contains(&size) => {
            let digits = (2 - size.log10().floor() as i32).clamp(0, 6) as usize;
            format!("{value:.digits$}")
        }
        _ => format!("{value:.2e}"),
    }
}
