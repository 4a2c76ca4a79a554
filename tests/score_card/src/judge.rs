//! An answer beside the truth.
//!
//! A mechanism that is named is *true* if the case conceals one of that id in that place (one that sits in both channels
//! may be named once or channel by channel; of what pump and rig share, the place does not count), *misplaced* if only
//! the place is wrong, a *nuisance* if it is one of the small things that are wrong besides, and *false* otherwise.

use hidden_rig::effects::{Effect, Kind, Place};
use hidden_rig::truth::{Class, Planted, Truth};
use serde::{Deserialize, Serialize};

use crate::diagnosis::{Diagnosis, Named, Verdict};

/// Standing of a named mechanism beside the truth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Name {
    /// Concealed there.
    True,
    /// Concealed, but elsewhere.
    Misplaced,
    /// A small thing that is wrong as well.
    Nuisance,
    /// Not there.
    False,
}

/// Standing of an answer to the truth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// All that is concealed is named and nothing else; or nothing is named where nothing is; or `unknown_mechanism`
    /// where the library lacks it.
    Right,
    /// Undecided, and the truth is among the rivals.
    Undecided,
    /// Undecided, and the truth is not among the rivals.
    UndecidedAstray,
    /// Part of it is named, and nothing false.
    Partly,
    /// The mechanism is right and its place wrong.
    Misplaced,
    /// Nothing is named though something is concealed.
    Missed,
    /// `unknown_mechanism` though the library holds it.
    ThoughtUnknown,
    /// Outside the library, and the member that is next to it is named.
    Adjacent,
    /// Something is named that is not there.
    FalseName,
    /// No answer: the program failed or took too long.
    Failed,
}

impl Outcome {
    /// In a few words.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Right => "right",
            Self::Undecided => "undecided, truth among the rivals",
            Self::UndecidedAstray => "undecided, truth not among the rivals",
            Self::Partly => "partly",
            Self::Misplaced => "misplaced",
            Self::Missed => "missed",
            Self::ThoughtUnknown => "thought unknown",
            Self::Adjacent => "adjacent",
            Self::FalseName => "false name",
            Self::Failed => "failed",
        }
    }
}

/// Effects that pump and rig share: the place says nothing there.
const SHARED: &[&str] =
    &["supply_sag", "cross_leak", "piston_blowby", "pump_droop", "pump_speed", "check_valve_cracking"];

/// Members of the library that stand next to what it does not hold: another closure of the same physics.
fn neighbours(kind: Kind) -> &'static [&'static str] {
    match kind {
        Kind::SlewLimit => &["valve_lag"],
        Kind::DeadEndVolume => &["chamber_thermal"],
        Kind::GlandLeak => &["chamber_leak"],
        Kind::LineResonance => &["sensor_lag"],
        Kind::FlapperBounce => &["valve_lag"],
        _ => &[],
    }
}

fn place_of(text: &str) -> Option<Place> {
    match text {
        "positive" => Some(Place::Positive),
        "negative" => Some(Place::Negative),
        "both" => Some(Place::Both),
        _ => None,
    }
}

/// Tells whether a place that is named is that of an effect, or one channel of an effect that sits in both.
fn fits(id: &str, named: &str, place: Place) -> bool {
    SHARED.contains(&id) || place_of(named).is_some_and(|named| named == place || place == Place::Both)
}

/// Tells whether an effect is indistinguishable from another parameter by construction: a tank of another size.
fn is_a_parameter(effect: &Effect) -> bool {
    match effect {
        Effect::VolumeChange(change) => change.time_s.is_none(),
        Effect::PumpSpeed(speed) => speed.warming_time_s.is_none(),
        _ => false,
    }
}

/// Effects that an answer must name: all that is concealed, but what a moved parameter says as well only if there is nothing else.
fn to_be_named(truth: &Truth) -> Vec<&Planted> {
    let physics: Vec<&Planted> = truth.truth.iter().filter(|planted| !is_a_parameter(&planted.effect)).collect();
    if physics.is_empty() { truth.truth.iter().collect() } else { physics }
}

/// Judges the name of one mechanism.
pub fn name(named: &Named, truth: &Truth) -> Name {
    let there = |planted: &&Planted| planted.effect.kind().name() == named.id;
    let fit = |planted: &Planted| fits(&named.id, &named.place, planted.place);
    let mut same: Vec<&Planted> = truth.truth.iter().filter(there).collect();
    if same.iter().any(|planted| fit(planted)) {
        return Name::True;
    }
    let misplaced = !same.is_empty();
    same = truth.nuisances.iter().filter(there).collect();
    match (same.iter().any(|planted| fit(planted)), misplaced) {
        (true, _) => Name::Nuisance,
        (false, true) => Name::Misplaced,
        (false, false) => Name::False,
    }
}

/// Tells whether every channel of a concealed effect is named.
fn is_named(planted: &Planted, mechanisms: &[Named]) -> bool {
    let id = planted.effect.kind().name();
    let places: Vec<&str> =
        mechanisms.iter().filter(|named| named.id == id).map(|named| named.place.as_str()).collect();
    let has = |place: &str| places.contains(&place);
    if SHARED.contains(&id) {
        return !places.is_empty();
    }
    match planted.place {
        Place::Positive => has("positive"),
        Place::Negative => has("negative"),
        Place::Both => has("both") || (has("positive") && has("negative")),
    }
}

/// Tells whether an explanation `id:where` is a concealed effect's.
fn is_rival_of(planted: &Planted, rival: &str) -> bool {
    let (id, place) = rival.split_once(':').unwrap_or((rival, ""));
    id == planted.effect.kind().name() && (place.is_empty() || fits(id, place, planted.place))
}

/// Judges an answer.
pub fn outcome(diagnosis: &Diagnosis, truth: &Truth) -> Outcome {
    let concealed = &truth.truth;
    let race = diagnosis.in_the_race();
    let in_race = |planted: &&Planted| race.iter().any(|rival| is_rival_of(planted, rival));
    let parameters_do = !concealed.is_empty() && concealed.iter().all(|planted| is_a_parameter(&planted.effect));
    match diagnosis.verdict {
        // Where nothing is concealed, a mere shift of parameters is the truth that must be among the rivals.
        Verdict::Undecided if concealed.is_empty() => {
            let shift = race.iter().any(|rival| rival.starts_with(Verdict::ParametersMoved.as_str()));
            if shift { Outcome::Undecided } else { Outcome::UndecidedAstray }
        }
        Verdict::Undecided if truth.class == Class::Outside => Outcome::UndecidedAstray,
        Verdict::Undecided if to_be_named(truth).iter().all(in_race) => Outcome::Undecided,
        Verdict::Undecided => Outcome::UndecidedAstray,
        Verdict::UnknownMechanism => match truth.class {
            Class::Outside => Outcome::Right,
            Class::Nothing | Class::ParametersMoved => Outcome::FalseName,
            _ => Outcome::ThoughtUnknown,
        },
        Verdict::Adequate | Verdict::ParametersMoved => {
            let parameters = diagnosis.verdict == Verdict::ParametersMoved;
            if concealed.is_empty() || (parameters && parameters_do) { Outcome::Right } else { Outcome::Missed }
        }
        Verdict::MissingPhysics => named(diagnosis, truth),
    }
}

fn named(diagnosis: &Diagnosis, truth: &Truth) -> Outcome {
    let names: Vec<Name> = diagnosis.mechanisms.iter().map(|named| name(named, truth)).collect();
    if names.is_empty() {
        return if truth.truth.is_empty() { Outcome::Right } else { Outcome::Missed };
    }
    if truth.class == Class::Outside {
        let near = |named: &Named| {
            truth.truth.iter().any(|planted| {
                neighbours(planted.effect.kind()).contains(&named.id.as_str())
                    && fits(&named.id, &named.place, planted.place)
            })
        };
        let all = diagnosis.mechanisms.iter().zip(&names).all(|(named, name)| *name == Name::Nuisance || near(named));
        return if all && diagnosis.mechanisms.iter().any(near) { Outcome::Adjacent } else { Outcome::FalseName };
    }
    if names.contains(&Name::False) {
        return Outcome::FalseName;
    }
    // In a null a nuisance is there indeed, but far below what is worth a name.
    if truth.truth.is_empty() {
        return Outcome::FalseName;
    }
    if to_be_named(truth).iter().all(|planted| is_named(planted, &diagnosis.mechanisms))
        && !names.contains(&Name::Misplaced)
    {
        Outcome::Right
    } else if names.contains(&Name::True) {
        Outcome::Partly
    } else if names.contains(&Name::Misplaced) {
        Outcome::Misplaced
    } else {
        Outcome::Missed
    }
}

/// Concealed effects, as a row of the confusion table: ids (or kinds outside the library), joined.
pub fn row(truth: &Truth) -> String {
    match truth.class {
        Class::Nothing => "nothing".to_owned(),
        Class::ParametersMoved => "parameters moved".to_owned(),
        Class::Outside => {
            truth.truth.iter().map(|planted| format!("outside: {}", planted.effect.kind().name())).collect()
        }
        _ => joined(truth.truth.iter().map(|planted| planted.effect.kind().name().to_owned())),
    }
}

/// Answer, as a column of the confusion table: the verdict, or the ids that are named.
pub fn column(diagnosis: &Diagnosis) -> String {
    match diagnosis.verdict {
        Verdict::MissingPhysics => joined(diagnosis.mechanisms.iter().map(|named| named.id.clone())),
        verdict => verdict.as_str().to_owned(),
    }
}

fn joined(ids: impl Iterator<Item = String>) -> String {
    let mut ids: Vec<String> = ids.collect();
    ids.sort();
    ids.dedup();
    ids.join(" + ")
}
