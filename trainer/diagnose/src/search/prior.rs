//! Priors of candidates' parameters. A magnitude that is never negative is fitted as a logarithm, with a prior so wide that it only
//! keeps it in sight; what may have either sign, or has its neutral value in the middle of its range, is fitted as it is.

use fit::parameters::{Knowledge, Parameter, SearchRange, Transform};
use model::mechanism::CandidateParameter;

/// Standard deviation of the logarithm of a magnitude: a factor of 4.5 either way.
const LOG_SD: f64 = 1.5;

/// Key of the time at which something begins.
pub(super) const ONSET: &str = "begins_s";

/// The value at which a mechanism does nothing, where that is inside its range.
pub(super) fn neutral(id: &str, p: &CandidateParameter) -> Option<f64> {
    match (id, p.key) {
        ("critical_ratio", _) => Some(0.528),
        ("sensor_gain", _) | ("valve_lag", "falling_over_rising") => Some(1.0),
        ("valve_stiction", "short_of_it") => Some(0.0),
        _ => p.signed.then_some(0.0),
    }
}

/// Distance in s by which another onset shows: what joins in an instant moves readings for a second or two, and slopes over
/// more than a part of that lead nowhere.
const ONSET_S: f64 = 0.5;

/// The free parameter that a number of a mechanism is, with what is known of it beforehand.
pub(super) fn parameter(id: &str, p: &CandidateParameter, path: String) -> Parameter {
    if p.key == ONSET {
        return Parameter {
            path,
            transform: Transform::Linear,
            mean: p.starts.first().copied().unwrap_or(p.low),
            knowledge: Knowledge::Nothing { scale: ONSET_S },
            bounds: [p.low, p.high],
            range: SearchRange::Whole,
        };
    }
    match neutral(id, p) {
        Some(neutral) => {
            let reach = p.starts.iter().map(|s| (s - neutral).abs()).fold(0.0, f64::max);
            let sd = if reach > 0.0 { reach } else { 0.1 * (p.high - p.low) };
            Parameter {
                path,
                transform: Transform::Linear,
                mean: neutral,
                knowledge: Knowledge::Prior { sd },
                bounds: [p.low, p.high],
                range: SearchRange::Whole,
            }
        }
        None => {
            let positive: Vec<f64> = p.starts.iter().copied().filter(|s| *s > 0.0).collect();
            let logs = positive.iter().map(|s| s.ln()).sum::<f64>() / positive.len().max(1) as f64;
            let mean = if positive.is_empty() { (p.low.max(1e-3 * p.high) * p.high).sqrt() } else { logs.exp() };
            let [mean, sd] = p.usual.unwrap_or([mean, LOG_SD]);
            let least = positive.iter().copied().fold(f64::INFINITY, f64::min).min(mean);
            Parameter {
                path,
                transform: Transform::Log,
                mean,
                knowledge: Knowledge::Prior { sd },
                bounds: [p.low.max(1e-2 * least), p.high],
                range: SearchRange::Whole,
            }
        }
    }
}
