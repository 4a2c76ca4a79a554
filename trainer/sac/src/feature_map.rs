//! From the raw observation to the network's inputs.
//!
//! ```text
//! feature = (x[plus] − x[minus] − offset) · scale          (x[minus] may be absent)
//! ```
//!
//! The replay keeps raw observations, so that CAPS disturbs pressures and not normalised numbers; features are made
//! when a batch is. Neighbouring features mostly read neighbouring entries, which is found once: a span is a run of
//! features whose entries follow each other, and is copied rather than gathered.

use crate::settings::SettingsError;

/// One input of the network.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Feature {
    /// Entry of the raw observation.
    pub plus: usize,
    /// Entry taken off it.
    pub minus: Option<usize>,
    /// Offset that is taken off next, in the unit of the entry.
    pub offset: f32,
    /// Factor at last.
    pub scale: f32,
}

/// Features `to..to + length` read entries from `plus` on.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Span {
    to: usize,
    plus: usize,
    length: usize,
}

/// Features `to..to + length` take off entries from `minus` on, `step` apart (0 or 1).
#[derive(Debug, Clone, Copy, PartialEq)]
struct Reference {
    to: usize,
    minus: usize,
    step: usize,
    length: usize,
}

/// A fixed linear map with one or two entries a feature.
#[derive(Debug, Clone, PartialEq)]
pub struct FeatureMap {
    observations: usize,
    features: Vec<Feature>,
    spans: Vec<Span>,
    references: Vec<Reference>,
    offsets: Vec<f32>,
    scales: Vec<f32>,
}

impl FeatureMap {
    /// The map with these features of an observation of this many entries.
    ///
    /// # Errors
    /// An entry beyond the observation, or an offset or scale that is not finite.
    pub fn new(observations: usize, features: Vec<Feature>) -> Result<Self, SettingsError> {
        let fault = |rule| Err(SettingsError { key: "features", rule });
        if features.is_empty() || features.len() > 4096 {
            return fault("needs 1 to 4096 features");
        }
        if features.iter().any(|f| f.plus >= observations || f.minus.is_some_and(|m| m >= observations)) {
            return fault("must read entries within the observation");
        }
        if features.iter().any(|f| !f.offset.is_finite() || !f.scale.is_finite()) {
            return fault("must have finite offsets and scales");
        }
        let offsets = features.iter().map(|f| f.offset).collect();
        let scales = features.iter().map(|f| f.scale).collect();
        let (spans, references) = (spans(&features), references(&features));
        Ok(Self { observations, features, spans, references, offsets, scales })
    }

    /// The map that changes nothing.
    ///
    /// # Errors
    /// More than 4096 entries, or none.
    pub fn identity(observations: usize) -> Result<Self, SettingsError> {
        let same = |plus| Feature { plus, minus: None, offset: 0.0, scale: 1.0 };
        Self::new(observations, (0..observations).map(same).collect())
    }

    /// Entries of the raw observation.
    pub fn observations(&self) -> usize {
        self.observations
    }

    /// The features, one by one.
    pub fn features(&self) -> &[Feature] {
        &self.features
    }

    /// Writes all features of one observation; `out` must have room for them, what is beyond stays.
    #[inline(always)]
    pub fn apply(&self, observation: &[f32], out: &mut [f32]) {
        for span in &self.spans {
            out[span.to..][..span.length].copy_from_slice(&observation[span.plus..][..span.length]);
        }
        for reference in &self.references {
            let out = &mut out[reference.to..][..reference.length];
            if reference.step == 0 {
                let level = observation[reference.minus];
                out.iter_mut().for_each(|x| *x -= level);
            } else {
                let levels = &observation[reference.minus..][..reference.length];
                out.iter_mut().zip(levels).for_each(|(x, level)| *x -= level);
            }
        }
        for ((x, offset), scale) in out.iter_mut().zip(&self.offsets).zip(&self.scales) {
            *x = (*x - offset) * scale;
        }
    }
}

fn spans(features: &[Feature]) -> Vec<Span> {
    let mut spans: Vec<Span> = Vec::new();
    for (to, feature) in features.iter().enumerate() {
        match spans.last_mut() {
            Some(last) if feature.plus == last.plus + last.length => last.length += 1,
            _ => spans.push(Span { to, plus: feature.plus, length: 1 }),
        }
    }
    spans
}

fn references(features: &[Feature]) -> Vec<Reference> {
    let mut references: Vec<Reference> = Vec::new();
    for (to, feature) in features.iter().enumerate() {
        let Some(minus) = feature.minus else { continue };
        if let Some(last) = references.last_mut().filter(|last| to == last.to + last.length) {
            // The second feature decides whether a span steps or stays.
            let step = if last.length == 1 { minus.wrapping_sub(last.minus) } else { last.step };
            if step <= 1 && minus == last.minus + step * last.length {
                (last.step, last.length) = (step, last.length + 1);
                continue;
            }
        }
        references.push(Reference { to, minus, step: 0, length: 1 });
    }
    references
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_give_what_each_feature_says() {
        // Every pattern: runs that step, that stay, that break in either entry, single features in between.
        let minus = [None, Some(3), Some(3), Some(3), Some(4), Some(5), None, Some(0), Some(2), Some(3), Some(3)];
        let plus = [0, 1, 2, 3, 5, 6, 6, 0, 1, 2, 6];
        let feature = |(i, (&plus, &minus)): (usize, (&usize, &Option<usize>))| Feature {
            plus,
            minus,
            offset: i as f32 - 4.0,
            scale: 0.5 + i as f32,
        };
        let features: Vec<_> = plus.iter().zip(&minus).enumerate().map(feature).collect();
        let map = FeatureMap::new(7, features.clone()).unwrap();
        let x = [1.5, -2.0, 3.25, 10.0, -7.0, 0.125, 42.0];
        let mut out = [9.0; 12];
        map.apply(&x, &mut out);
        for (f, &out) in features.iter().zip(&out) {
            let expected = (x[f.plus] - f.minus.map_or(0.0, |m| x[m]) - f.offset) * f.scale;
            assert_eq!(out, expected); // small dyadic numbers: exact
        }
        assert_eq!(out[11], 9.0);
        assert!(map.spans.len() < features.len() && map.references.len() < 7);
    }

    #[test]
    fn entries_beyond_the_observation_are_refused() {
        let feature = Feature { plus: 0, minus: Some(3), offset: 0.0, scale: 1.0 };
        assert!(FeatureMap::new(3, vec![feature]).unwrap_err().to_string().contains("within the observation"));
        assert!(FeatureMap::new(4, vec![feature]).is_ok());
        assert!(FeatureMap::new(4, vec![Feature { scale: f32::NAN, ..feature }]).is_err());
    }
}
