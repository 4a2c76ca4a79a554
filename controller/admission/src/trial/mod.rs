//! The closed-loop trial: a policy flies sixteen simulated rigs before it flies the real one.
//!
//! The rigs are the model itself and rigs drawn around it ([`rigs`]); the reference rests, steps, swings and ramps where
//! the model can follow ([`course`]); eight rigs fly at a time in lanes with averaged pumps ([`bundle`]); what came out is
//! compared with the fallback on the very same rigs and noise, and with the incumbent ([`judgement`]). Errors are of the
//! readings less what the model's sensors show of chambers on the reference ([`model::shown_reference`]).

pub mod bundle;
pub mod course;
pub mod judgement;
pub mod rigs;
pub mod tally;

use std::sync::Arc;

use model::observation::{CHANNELS, Pair};
use model::rig::{Rig, RigError};
use model::shown_reference::ShownReference;
use model::steady::SteadyMap;
use policy::Policy;

pub use bundle::Limits;
pub use judgement::{Judgement, TrialFigures, judge};
pub use tally::Tally;

use bundle::{Bundle, Flyer};
use course::Course;

/// A trial that is laid out for a model, with the fallback's own flights.
pub struct Trial {
    course: Course,
    bundles: Vec<Bundle>,
    fallback: Vec<Tally>,
}

impl Trial {
    /// Lays out the trial around `model` and flies the fallback through it.
    ///
    /// # Errors
    /// If the rig cannot be compiled or lacks what a dual-pressure rig needs.
    ///
    /// # Real-time
    /// About a second; not for the tick.
    pub fn new(model: &Rig, limits: Limits) -> Result<Self, RigError> {
        let map = Arc::new(SteadyMap::new(model)?);
        let course = Course::new(&map, ShownReference::of(model));
        let bundles = rigs::drawn(model)?
            .into_iter()
            .map(|drawn| Bundle::new(model, drawn, &map, limits))
            .collect::<Result<Vec<_>, _>>()?;
        let mut trial = Trial { course, bundles, fallback: Vec::new() };
        trial.fallback = trial.flown(&mut Flyer::Fallback);
        Ok(trial)
    }

    /// Flies a policy on every rig; a tally for each.
    ///
    /// # Real-time
    /// About a second; not for the tick.
    pub fn fly(&self, policy: &mut Policy) -> Vec<Tally> {
        self.flown(&mut Flyer::Policy(policy))
    }

    /// Noise of the converter on both channels, root mean square in kPa.
    pub fn noise_kpa(&self) -> Pair {
        self.bundles.first().map_or([0.0; CHANNELS], Bundle::noise_kpa)
    }

    /// The fallback's tallies, rig by rig.
    pub fn fallback(&self) -> &[Tally] {
        &self.fallback
    }

    fn flown(&self, flyer: &mut Flyer<'_>) -> Vec<Tally> {
        self.bundles.iter().flat_map(|bundle| bundle.fly(&self.course, flyer)).collect()
    }
}
