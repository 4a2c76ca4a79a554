//! An oracle that knows the candidates: its findings in a case's first recording.
//!
//! For every concealed effect the oracle asks by how much the best refit fails that has everything but this effect: the
//! identifiable parameters, the case's other effects, and one rival of the library in its place. With d the change that
//! the effect makes, in units of the noise, and P the projection away from all of these,
//! ```text
//! χ²_rival = |P d|² · T_given / T_probe
//! ```
//! to first order, over the time that the diagnosis is given. It is an upper bound of what any tool can see: rivals are
//! linear in their strength here, and the noise is taken for white. A case whose smallest χ² is large can be decided
//! from its recordings; one whose smallest is not is `undecided` for whoever is honest.

use serde::{Deserialize, Serialize};

use crate::build_sheet::BuildSheet;
use crate::case::Making;
use crate::effects::{Effect, Kind, Place};
use crate::excitation::random_holds;
use crate::recording::ticks;
use crate::rng::Draws;
use crate::sizing::Probe;
use crate::truth::Truth;

/// A rival and how far it is from the truth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Rival {
    /// Id.
    pub id: String,
    /// Where it sits.
    #[serde(rename = "where")]
    pub place: Place,
    /// χ² that is left when it stands in for the truth.
    pub chi2: f64,
}

/// Findings of the oracle on one concealed effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sight {
    /// The effect's id.
    pub id: String,
    /// Where it sits.
    #[serde(rename = "where")]
    pub place: Place,
    /// χ² that is left without it, everything else refitted: against a mere shift of parameters.
    pub chi2: f64,
    /// The closest rivals of another id or another channel, the closest first.
    pub rivals: Vec<Rival>,
}

/// Findings of the oracle on a case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Oracle {
    /// The case.
    pub case: String,
    /// χ² of what its nuisances leave after a refit.
    pub nuisance_chi2: f64,
    /// Effects, one by one.
    pub effects: Vec<Sight>,
}

impl Sight {
    /// χ² by which the truth is told from everything else: from no effect, and from each rival.
    pub fn separation(&self) -> f64 {
        self.rivals.iter().map(|rival| rival.chi2).fold(self.chi2, f64::min)
    }
}

impl Oracle {
    /// The smallest separation of the case's effects; infinite where nothing is concealed.
    pub fn separation(&self) -> f64 {
        self.effects.iter().map(Sight::separation).fold(f64::INFINITY, f64::min)
    }

    /// Tells whether the effects stand out of noise and nuisances, each from all else.
    pub fn separates(&self) -> bool {
        self.separation() >= SEPARATES.max(NUISANCE_MARGIN * self.nuisance_chi2)
    }
}

/// χ² that counts as told apart. A factor of three belongs to the noise's colour, which is taken for white, and thirty
/// to forty candidates are looked through (the largest of as many χ² with one degree of freedom stays below 15).
pub const SEPARATES: f64 = 60.0;
/// Ratio to the nuisances' χ² that it must reach.
pub const NUISANCE_MARGIN: f64 = 2.0;
/// Rivals that are listed.
const LISTED: usize = 4;
/// Rows of the probe (s): every rival is run over it.
const PROBE_S: f64 = 16.0;

/// Asks the oracle about a case of a suite that was made like this.
pub fn ask(truth: &Truth, making: &Making) -> Oracle {
    let sheet = &truth.build;
    let holds = random_holds(&mut Draws::new(truth.seed).stream("holds"), &truth.range, ticks(making.seconds[0]));
    let seconds = making.seconds[..3].iter().sum::<f64>();
    let probe = Probe::new(sheet, &holds[..ticks(PROBE_S).min(holds.len())]);
    let planted: Vec<_> =
        truth.truth.iter().map(|planted| probe.change_by(&within(&planted.effect, making), planted.place)).collect();
    let rivals = if planted.is_empty() { Vec::new() } else { changes_of_rivals(truth, sheet, &probe) };
    let effects = truth.truth.iter().enumerate().map(|(k, own)| {
        let mut others = probe.clone();
        for (j, change) in planted.iter().enumerate() {
            if j != k {
                others.also(change);
            }
        }
        let left = others.unexplained(&planted[k]);
        let mut sight = Sight {
            id: own.id.clone(),
            place: own.place,
            chi2: others.chi2_over(seconds, &left),
            rivals: rivals
                .iter()
                .filter(|(kind, place, _)| *kind != own.effect.kind() || *place != own.place)
                .map(|(kind, place, change)| {
                    let with_rival = others.without_direction(&left, &others.unexplained(change));
                    Rival { id: kind.id().to_owned(), place: *place, chi2: others.chi2_over(seconds, &with_rival) }
                })
                .collect(),
        };
        sight.rivals.sort_by(|a, b| a.chi2.total_cmp(&b.chi2));
        sight.rivals.truncate(LISTED);
        sight
    });
    Oracle {
        case: truth.case.clone(),
        nuisance_chi2: truth.nuisances_together.net_chi2_per_s * seconds,
        effects: effects.collect(),
    }
}

/// A volume that is switched in after the probe's end would have no size there.
fn within(effect: &Effect, making: &Making) -> Effect {
    match effect {
        Effect::VolumeChange(change) => {
            let mut change = change.clone();
            change.time_s = change.time_s.map(|time_s| time_s * (PROBE_S / making.probe_s).min(1.0));
            Effect::VolumeChange(change)
        }
        other => other.clone(),
    }
}

/// Change that each member of the library would make in each of its places, at a strength that shows as much as the truth.
fn changes_of_rivals(truth: &Truth, sheet: &BuildSheet, probe: &Probe<'_>) -> Vec<(Kind, Place, Vec<[f64; 2]>)> {
    let mut draws = Draws::new(truth.seed).stream("rivals");
    let mut changes = Vec::new();
    for kind in Kind::ALL.iter().filter(|kind| kind.in_library()) {
        let shape = within(&kind.draw(&mut draws), &Making { probe_s: 60.0, ..Making::FULL });
        for place in kind.places() {
            let effect = shape.at_strength(shape.usual_strength(truth.level_kpa.max(0.1)));
            let mut rig = sheet.rig();
            effect.install(*place, &mut rig);
            changes.push((*kind, *place, probe.change_of(&rig)));
        }
    }
    changes
}
