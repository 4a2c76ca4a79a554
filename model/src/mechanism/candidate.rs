//! Candidates for what is missing from a rig: every mechanism at every place where it could be attached.
//!
//! A search for missing physics goes through this list. Each candidate says which numbers to fit, between
//! which limits and from which first magnitudes, and turns fitted numbers into an entry of a rig file. What
//! only a person can know (`actuator_load`: is there a muscle?) or only data can shape (`residual_flow`,
//! `residual_response`) is not in it.

use super::Mechanism;
use crate::rig::{MechanismInstance, Numbers as _, Rig};

/// A mechanism that a rig does not have yet, at one of its components.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// The mechanism's id.
    pub id: &'static str,
    /// The component it would be attached to.
    pub component: String,
    /// Which of its shapes this is, where it has several (`"inlet"`); empty otherwise.
    pub form: &'static str,
    /// Parameters to fit.
    pub parameters: Vec<CandidateParameter>,
    /// True where pressures change in steps as its first parameter does, so that they have no slope with it.
    pub stepped: bool,
    /// Mechanisms at the same component without which this shape is no different from another one; empty for none.
    pub beside: &'static [&'static str],
    /// True where this is a richer shape that is only worth trying in place of a plainer one that was found.
    pub refinement: bool,
    template: Mechanism,
    /// Index of each parameter among the mechanism's numbers.
    fitted: Vec<usize>,
}

/// A number of a candidate that is to be fitted.
#[derive(Debug, Clone, PartialEq)]
pub struct CandidateParameter {
    /// Key in the rig file.
    pub key: &'static str,
    /// Unit; empty for a bare number.
    pub unit: &'static str,
    /// Lowest plausible value.
    pub low: f64,
    /// Highest plausible value.
    pub high: f64,
    /// Lowest and highest value that a rig file may hold: how far a range that is too narrow can be widened.
    pub accepted: [f64; 2],
    /// First magnitudes, weak to strong, both signs where it has two; at least one.
    pub starts: Vec<f64>,
    /// True where it can be negative.
    pub signed: bool,
    /// Usual value, and the standard deviation of its logarithm, where that was measured.
    pub usual: Option<[f64; 2]>,
    /// The effect grows with this power of it.
    pub power: f64,
    /// True where what fits best at its lowest value is something faster.
    pub slow: bool,
}

impl CandidateParameter {
    /// Sets the range, as far as a rig file may hold it, and keeps the first magnitudes inside.
    fn limit(&mut self, low: f64, high: f64) {
        let [least, most] = self.accepted;
        (self.low, self.high) = (low.clamp(least, most), high.clamp(least, most));
        let (low, high) = (self.low, self.high);
        self.starts.iter_mut().for_each(|start| *start = start.clamp(low, high));
    }
}

impl Candidate {
    /// The mechanism with these values of its parameters (in their order; what is missing stays neutral), as an
    /// entry for [`Rig::mechanisms`]. Values are taken as they are; [`Rig::check`] judges them.
    pub fn attached(&self, values: &[f64]) -> MechanismInstance {
        let mut mechanism = self.template.clone();
        for (index, value) in self.fitted.iter().zip(values) {
            if let Some(slot) = mechanism.number_mut(*index) {
                *slot = *value;
            }
        }
        MechanismInstance { component: self.component.clone(), enabled: true, mechanism }
    }

    /// A copy of the rig with this mechanism attached.
    pub fn on(&self, rig: &Rig, values: &[f64]) -> Rig {
        let mut rig = rig.clone();
        rig.mechanisms.push(self.attached(values));
        rig
    }
}

/// One shape of a mechanism that can be fitted.
#[derive(Debug, Clone)]
pub(crate) struct Form {
    name: &'static str,
    mechanism: Mechanism,
    fitted: Vec<usize>,
    parameters: Vec<CandidateParameter>,
    stepped: bool,
    beside: &'static [&'static str],
    refinement: bool,
}

impl Form {
    /// The mechanism, neutral or nearly so, and which of its numbers are to be fitted.
    pub(crate) fn of(name: &'static str, mechanism: Mechanism, fitted: &[usize]) -> Self {
        let numbers = mechanism.numbers();
        let parameter = |index: &usize| {
            numbers.get(*index).map(|number| CandidateParameter {
                key: number.key,
                unit: number.unit,
                low: number.plausible[0],
                high: number.plausible[1],
                accepted: number.accepted,
                starts: number.starts.to_vec(),
                signed: number.is_signed(),
                usual: number.usual,
                power: number.power,
                slow: number.slow,
            })
        };
        let parameters = fitted.iter().filter_map(parameter).collect();
        Form { name, mechanism, fitted: fitted.to_vec(), parameters, stepped: false, beside: &[], refinement: false }
    }

    /// Candidate that is stepped in its first parameter.
    pub(crate) fn stepped(self) -> Self {
        Form { stepped: true, ..self }
    }

    /// Candidate as a richer shape to be tried in place of a plainer one that was found.
    pub(crate) fn refinement(self) -> Self {
        Form { refinement: true, ..self }
    }

    /// Candidate that is of interest only beside one of these mechanisms.
    pub(crate) fn beside(self, beside: &'static [&'static str]) -> Self {
        Form { beside, ..self }
    }

    /// Candidate with the range and the first magnitudes of parameter `index` times `scale` ([`super::scale`]).
    pub(crate) fn scaled(mut self, index: usize, scale: f64) -> Self {
        if let Some(parameter) = self.parameters.get_mut(index)
            && scale != 1.0
        {
            parameter.starts.iter_mut().for_each(|start| *start *= scale);
            parameter.limit(scale * parameter.low, scale * parameter.high);
        }
        self
    }

    /// Candidate with a range and first magnitudes of parameter `index` that suit the component's size.
    pub(crate) fn ranging(mut self, index: usize, range: [f64; 2], starts: Vec<f64>) -> Self {
        if let Some(parameter) = self.parameters.get_mut(index) {
            parameter.starts = starts;
            parameter.limit(range[0], range[1]);
        }
        self
    }
}

/// Every mechanism at every component of `rig` where it could be attached and is not (or is switched off).
///
/// Works for any rig: what makes no sense at a component (check valves of a pump without pistons) is left out.
pub fn candidates(rig: &Rig) -> Vec<Candidate> {
    let mut found = Vec::new();
    super::each_kind(&mut |id, places, forms| {
        for component in places.iter().flat_map(|place| place.components(rig)) {
            for form in forms(rig, &component) {
                let candidate = Candidate {
                    id,
                    component: component.clone(),
                    form: form.name,
                    parameters: form.parameters,
                    stepped: form.stepped,
                    beside: form.beside,
                    refinement: form.refinement,
                    template: form.mechanism,
                    fitted: form.fitted,
                };
                let weakest: Vec<f64> = candidate.parameters.iter().filter_map(|p| p.starts.first().copied()).collect();
                let attached = candidate.attached(&weakest);
                let there = rig.mechanisms.iter().any(|m| m.enabled && m.is_twin_of(&attached));
                if !there && attached.mechanism.check(rig, &component, "").is_ok() {
                    found.push(candidate);
                }
            }
        }
    });
    found
}
