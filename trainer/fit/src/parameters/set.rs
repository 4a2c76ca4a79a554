//! Several free parameters of one rig: from coordinates to rigs and back.

use model::rig::{Rig, RigError};

use super::parameter::Parameter;
use super::path;

/// The free parameters of a rig; everything else is as in the rig.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterSet {
    rig: Rig,
    parameters: Vec<Parameter>,
}

impl ParameterSet {
    /// Frees `parameters` of `rig`.
    ///
    /// # Errors
    /// A path that is not one of the rig's.
    pub fn new(rig: &Rig, parameters: Vec<Parameter>) -> Result<Self, RigError> {
        for parameter in &parameters {
            path::value(rig, &parameter.path)?;
        }
        Ok(ParameterSet { rig: rig.clone(), parameters })
    }

    /// The rig that everything but the free parameters is taken from.
    pub fn rig(&self) -> &Rig {
        &self.rig
    }

    /// The free parameters.
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// Number of free parameters.
    pub fn len(&self) -> usize {
        self.parameters.len()
    }

    /// Tells whether none is free.
    pub fn is_empty(&self) -> bool {
        self.parameters.is_empty()
    }

    /// The set with some more parameters free; those that are free already stay as they are.
    #[must_use]
    pub fn and(mut self, more: impl IntoIterator<Item = Parameter>) -> Self {
        for parameter in more {
            if self.parameters.iter().all(|known| known.path != parameter.path) {
                self.parameters.push(parameter);
            }
        }
        self
    }

    /// The set without those whose path `drop` says yes to: they are held at the rig's values.
    #[must_use]
    pub fn without(mut self, drop: impl Fn(&str) -> bool) -> Self {
        self.parameters.retain(|parameter| !drop(&parameter.path));
        self
    }

    /// The rig at a point.
    ///
    /// # Errors
    /// A value out of the range that the rig's checks allow.
    pub fn rig_at(&self, point: &[f64]) -> Result<Rig, RigError> {
        let values = self.parameters.iter().zip(point).map(|(p, z)| (p.path.as_str(), p.value(*z)));
        path::with_values(&self.rig, values)
    }

    /// The values at a point, in the parameters' units.
    pub fn values(&self, point: &[f64]) -> Vec<f64> {
        self.parameters.iter().zip(point).map(|(p, z)| p.value(*z)).collect()
    }

    /// The point at which a rig of the same structure stands, put within the bounds.
    ///
    /// # Errors
    /// The rig lacks one of the parameters.
    pub fn point_of(&self, rig: &Rig) -> Result<Vec<f64>, RigError> {
        self.parameters
            .iter()
            .map(|p| {
                let [low, high] = p.coordinate_bounds();
                Ok(p.coordinate(path::value(rig, &p.path)?).clamp(low, high))
            })
            .collect()
    }

    /// Coordinate zero everywhere: the priors' means.
    pub fn origin(&self) -> Vec<f64> {
        vec![0.0; self.parameters.len()]
    }

    /// Prior weights, for [`crate::least_squares::Settings::prior`].
    pub fn prior(&self) -> Vec<f64> {
        self.parameters.iter().map(Parameter::prior_weight).collect()
    }

    /// Cost of the priors at a point: `½ Σ p z²` over its coordinates `z`, with the weights `p` of [`ParameterSet::prior`].
    pub fn prior_cost(&self, point: &[f64]) -> f64 {
        self.prior().iter().zip(point).map(|(p, z)| 0.5 * p * z * z).sum()
    }

    /// Bounds as coordinates of a search that begins at a point, for [`crate::least_squares::Settings::bounds`].
    pub fn search_bounds(&self, point: &[f64]) -> Vec<[f64; 2]> {
        self.parameters.iter().zip(point).map(|(p, z)| p.search_bounds(*z)).collect()
    }

    /// Says whether a search between two points ended where a range did that may grow.
    pub fn was_cut_off(&self, began: &[f64], ended: &[f64]) -> bool {
        self.parameters.iter().zip(began.iter().zip(ended)).any(|(p, (began, ended))| p.was_cut_off(*began, *ended))
    }

    /// The widest bounds as coordinates.
    pub fn bounds(&self) -> Vec<[f64; 2]> {
        self.parameters.iter().map(Parameter::coordinate_bounds).collect()
    }
}
