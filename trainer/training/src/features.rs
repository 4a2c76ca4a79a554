//! Features, as which a network is given the numbers of an observation: a linear map that the exported graph begins with.
//!
//! Plain features are each number by itself, brought to about −1 … 1. They leave it to the network to find a tenth
//! of a kPa in a range of a hundred. Error features take the differences that control is about:
//!
//! | features | of |
//! | --- | --- |
//! | goal − pressure, same tick, −10 … +5 | what is measured and predicted |
//! | goal ahead − goal now, +1 … +15 | where the reference is going |
//! | goal − goal now, −10 … −1 | where it came from |
//! | goal now | the operating point, on which the valves' gains depend |
//! | applied − fallback's duty now, −10 … −1 | contract 2 |
//! | fallback's duty ahead − now, its duty now, its integral, undone play, learned width; travel | contract 2 |
//!
//! Both maps have as many features as the observation has numbers, so variants and contracts share one network
//! shape. Without MPObs the features of predictions are left out (scale 0): the exported policy ignores them.

use model::observation::{AHEAD, CHANNELS, GOALS_AHEAD, OBSERVATION_LEN, ObservationLayout, PAST, STATE_LEN};

use crate::settings::{Features, PolicySettings};

/// One feature: `(x[plus] − x[minus] − offset) · scale`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Term {
    /// Index of the number that counts positively.
    pub plus: usize,
    /// Index of the number that is taken away, if any.
    pub minus: Option<usize>,
    /// Constant that is taken away, in the unit of the numbers.
    pub offset: f64,
    /// Factor, in 1 over that unit.
    pub scale: f64,
}

/// Middle of the pressures in kPa gauge, and the distance that becomes 1.
const MIDDLE_KPA: [f64; CHANNELS] = [85.0, -70.0];
const SPAN_KPA: [f64; CHANNELS] = [40.0, 15.0];
/// Error that becomes 1, in kPa.
const ERROR_KPA: [f64; CHANNELS] = [0.5, 0.25];
/// Change of the goal over a few ticks that becomes 1, in kPa.
const GOAL_CHANGE_KPA: [f64; CHANNELS] = [2.0, 1.0];
/// Difference of duties that becomes 1.
const DUTY_CHANGE: f64 = 0.05;
/// Middle of the duties, and the distance that becomes 1.
const MIDDLE_DUTY: f64 = 0.8;
const SPAN_DUTY: f64 = 0.2;

/// The features of a policy.
pub fn terms(policy: &PolicySettings) -> Vec<Term> {
    let contract = ObservationLayout::of_version(policy.contract).unwrap_or(ObservationLayout::Paper);
    let mut terms = match policy.features {
        Features::Plain => plain(contract),
        Features::Errors => errors(contract),
    };
    if !policy.variant.predicts() {
        let predicted = CHANNELS * (PAST + 1)..STATE_LEN;
        for term in &mut terms {
            if predicted.contains(&term.plus) || term.minus.is_some_and(|m| predicted.contains(&m)) {
                term.scale = 0.0;
            }
        }
    }
    terms
}

fn plain(contract: ObservationLayout) -> Vec<Term> {
    let pressure = |at: usize| {
        let c = at % CHANNELS;
        Term { plus: at, minus: None, offset: MIDDLE_KPA[c], scale: 1.0 / SPAN_KPA[c] }
    };
    let rest = OBSERVATION_LEN..contract.observation_len();
    let small = contract.observation_len() - 4 * CHANNELS;
    let duty = |at: usize| {
        let (offset, span) = if at < small { (MIDDLE_DUTY, SPAN_DUTY) } else { (0.0, DUTY_CHANGE) };
        Term { plus: at, minus: None, offset, scale: 1.0 / span }
    };
    (0..OBSERVATION_LEN).map(pressure).chain(rest.map(duty)).collect()
}

fn errors(contract: ObservationLayout) -> Vec<Term> {
    let goal = |tick: usize, c: usize| STATE_LEN + CHANNELS * tick + c;
    let pairs = |ticks: std::ops::Range<usize>| ticks.flat_map(|tick| (0..CHANNELS).map(move |c| (tick, c)));
    let mut terms: Vec<Term> = Vec::with_capacity(contract.observation_len());
    for (tick, c) in pairs(0..PAST + 1 + AHEAD) {
        let (plus, minus) = (goal(tick, c), Some(CHANNELS * tick + c));
        terms.push(Term { plus, minus, offset: 0.0, scale: 1.0 / ERROR_KPA[c] });
    }
    for (tick, c) in pairs(0..PAST + 1 + GOALS_AHEAD) {
        let plus = goal(tick, c);
        terms.push(if tick == PAST {
            Term { plus, minus: None, offset: MIDDLE_KPA[c], scale: 1.0 / SPAN_KPA[c] }
        } else {
            Term { plus, minus: Some(goal(PAST, c)), offset: 0.0, scale: 1.0 / GOAL_CHANGE_KPA[c] }
        });
    }
    if contract == ObservationLayout::Correction {
        let applied = OBSERVATION_LEN;
        let base = applied + CHANNELS * PAST;
        let small = base + CHANNELS * (AHEAD + 1);
        for (tick, c) in pairs(0..PAST) {
            let plus = applied + CHANNELS * tick + c;
            terms.push(Term { plus, minus: Some(base + c), offset: 0.0, scale: 1.0 / DUTY_CHANGE });
        }
        for (tick, c) in pairs(0..AHEAD + 1) {
            let plus = base + CHANNELS * tick + c;
            terms.push(if tick == 0 {
                Term { plus, minus: None, offset: MIDDLE_DUTY, scale: 1.0 / SPAN_DUTY }
            } else {
                Term { plus, minus: Some(base + c), offset: 0.0, scale: 1.0 / DUTY_CHANGE }
            });
        }
        for at in 0..4 * CHANNELS {
            terms.push(Term { plus: small + at, minus: None, offset: 0.0, scale: 1.0 / DUTY_CHANGE });
        }
    }
    terms
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Variant;

    #[test]
    fn every_map_uses_every_number_of_its_contract() {
        for contract in [1, 2] {
            for features in [Features::Plain, Features::Errors] {
                let policy = PolicySettings { contract, features, ..PolicySettings::default() };
                let terms = terms(&policy);
                let length = ObservationLayout::of_version(contract).unwrap().observation_len();
                assert_eq!(terms.len(), length);
                let used = |n: usize| terms.iter().any(|t| t.plus == n || t.minus == Some(n));
                assert!((0..length).all(used), "contract {contract}, {features:?}");
            }
        }
    }

    #[test]
    fn on_the_reference_all_errors_are_zero_whatever_the_pressures() {
        let policy = PolicySettings { features: Features::Errors, ..PolicySettings::default() };
        let at = |n: usize| if n.is_multiple_of(2) { 97.0 } else { -66.0 };
        let terms = terms(&policy);
        for term in &terms[..STATE_LEN] {
            assert_eq!((at(term.plus) - term.minus.map_or(0.0, at) - term.offset) * term.scale, 0.0);
        }
    }

    #[test]
    fn without_mpobs_no_prediction_counts() {
        for features in [Features::Plain, Features::Errors] {
            let policy = PolicySettings { features, variant: Variant::Caps, ..PolicySettings::default() };
            for term in terms(&policy) {
                let predicted = |n: usize| (22..32).contains(&n);
                if predicted(term.plus) || term.minus.is_some_and(predicted) {
                    assert_eq!(term.scale, 0.0);
                }
            }
        }
    }
}
