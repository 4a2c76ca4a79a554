//! One case: a rig is drawn, effects are concealed in it at a given size, recordings are made.

use crate::build_sheet::{BuildSheet, Spread};
use crate::effects::{Effect, Kind, Place};
use crate::excitation::{OperatingRange, commission, random_holds, references_kpa, triangles_and_stairs};
use crate::recording::{Recording, pump_on, ticks};
use crate::rng::Draws;
use crate::run::Rig;
use crate::sizing::{Probe, Size, difference, larger, rms};
use crate::truth::{Class, Planted, RecordingEntry, Role, Truth};

/// Case that is to be made.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Name of the case: says nothing about what is in it.
    pub name: String,
    /// Purpose of the case.
    pub class: Class,
    /// Effects to be concealed, with their places.
    pub effects: Vec<(Kind, Place)>,
    /// Raw size that each effect is given (kPa).
    pub level_kpa: f64,
    /// True where the motor slips a little, so that the ripple beats.
    pub ripple_beats: bool,
    /// Seed of all its draws.
    pub seed: u64,
}

/// Settings by which the cases of a suite are made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Making {
    /// Lengths of the recordings (s): three that are given, one that is held out.
    pub seconds: [f64; 4],
    /// Length of the first recording's part that effects are sized on (s): all of it where it matters, for what is slow has only
    /// begun to show on a part.
    pub probe_s: f64,
    /// No nuisance is larger than this (kPa, raw): beyond, it would be an effect of its own.
    pub nuisance_ceiling_kpa: f64,
}

impl Making {
    /// For the full suite.
    pub const FULL: Self = Self { seconds: [100.0, 100.0, 100.0, 60.0], probe_s: 100.0, nuisance_ceiling_kpa: 0.06 };
    /// For a suite that is made in seconds.
    pub const QUICK: Self = Self { seconds: [40.0, 40.0, 40.0, 30.0], probe_s: 12.0, nuisance_ceiling_kpa: 0.06 };
}

/// A case that was made.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    /// Truth.
    pub truth: Truth,
    /// Recordings, in the order of the truth's entries.
    pub recordings: Vec<Recording>,
}

/// No rig with these draws has valves that hold pressures over a useful range.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("case {case}: none of {attempts} drawn rigs has a useful operating range; take another seed")]
pub struct NoUsefulRig {
    /// The case.
    pub case: String,
    /// Number of rigs drawn.
    pub attempts: u32,
}

/// Rigs that are drawn before giving up.
const ATTEMPTS: u32 = 40;
/// Nuisances are 5 to 15 % of the concealed effect, in raw size, and at most 15 % of it in net size.
const NUISANCE_SHARE: (f64, f64) = (0.05, 0.15);
/// Where nothing is concealed, nuisances are as beside an effect of this raw size (kPa).
const NULL_LEVEL_KPA: f64 = 0.3;
/// No nuisance is asked to have a smaller net size (kPa): beside a static effect, which a refit takes up whole, there
/// would be none at all.
const LEAST_NET_KPA: f64 = 0.012;
/// And none a larger one (kPa), a quarter to a half of the noise: beyond, it would be worth a name of its own.
const MOST_NET_KPA: f64 = 0.02;
/// Ratio to its wanted size within which a nuisance must come.
const NUISANCE_CLOSE: f64 = 1.3;
/// A motor that slips: the ripple beats once in 25 to 200 s.
const SLIP: (f64, f64) = (5e-5, 4e-4);
/// Kinds that nuisances are drawn from: small everyday imperfections.
const NUISANCES: &[Kind] = &[
    Kind::ValveHysteresis,
    Kind::ValveLag,
    Kind::ValveForceCurve,
    Kind::CoilHeating,
    Kind::SupplySag,
    Kind::ChamberLeak,
    Kind::CrossLeak,
    Kind::PistonBlowby,
    Kind::ChamberThermal,
    Kind::VolumeCompliance,
    Kind::LineResistance,
    Kind::CriticalRatio,
    Kind::CheckValveCracking,
    Kind::SensorDrift,
    Kind::SensorBias,
    Kind::SensorGain,
    Kind::SensorCrosstalk,
    Kind::DeadEndVolume,
    Kind::SupplyHunting,
];

/// Draws the rig, conceals the effects, makes the recordings.
///
/// # Errors
/// No drawn rig has a useful operating range.
pub fn make(plan: &Plan, making: &Making) -> Result<Case, NoUsefulRig> {
    let root = Draws::new(plan.seed);
    let (build, range) = draw_rig(plan, &root)?;
    let holds = random_holds(&mut root.stream("holds"), &range, ticks(making.seconds[0]));
    let probe_rows = ticks(making.probe_s).min(holds.len());
    let probe = Probe::new(&build, &holds[..probe_rows]);
    let truth = conceal(plan, making, &root, &probe);
    let nuisances = nuisances(&truth, plan, making, &root, &probe);
    let nuisances_together = size_together(&build, &nuisances, &probe);
    let mut truth = Truth {
        case: plan.name.clone(),
        seed: plan.seed,
        class: plan.class,
        level_kpa: if plan.effects.is_empty() { 0.0 } else { plan.level_kpa },
        truth,
        nuisances,
        nuisances_together,
        ripple_beats: plan.ripple_beats,
        parameter_shifts: build.shifts().map(|(name, shift)| (name.to_owned(), shift)).to_vec(),
        build: build.clone(),
        range,
        noise_seed: root.stream("noise").bits(),
        recordings: Vec::new(),
    };
    let recordings = record(&mut truth, making, &root, &holds);
    Ok(Case { truth, recordings })
}

/// Draws rigs until one has a useful operating range.
fn draw_rig(plan: &Plan, root: &Draws) -> Result<(BuildSheet, OperatingRange), NoUsefulRig> {
    let spread = if plan.class == Class::Nothing { Spread::AS_BUILT } else { Spread::MOVED };
    for attempt in 0..ATTEMPTS {
        let mut draws = root.stream(&format!("rig {attempt}"));
        let mut build = BuildSheet::draw(&mut draws, spread);
        if plan.ripple_beats {
            build.speed_rpm *= 1.0 + draws.sign() * draws.log_between(SLIP.0, SLIP.1);
        }
        if let Some(range) = commission(&build.rig()) {
            return Ok((build, range));
        }
    }
    Err(NoUsefulRig { case: plan.name.clone(), attempts: ATTEMPTS })
}

/// Gives each effect its shape and the strength that the level asks for.
fn conceal(plan: &Plan, making: &Making, root: &Draws, probe: &Probe<'_>) -> Vec<Planted> {
    let planted = plan.effects.iter().map(|(kind, place)| {
        let shape = kind.draw(&mut root.stream(kind.name()));
        // A volume that is switched in after the probe's end would have no size there.
        let shape = earlier(shape, making.probe_s);
        let (effect, size) = probe.at_size(&shape, *place, plan.level_kpa, 1.1);
        Planted::new(effect, *place, size)
    });
    planted.collect()
}

/// Length of the stretch that the drawn times of switched volumes are meant for (s): 20 to 40 s.
const PROBE_OF_DRAWS_S: f64 = 60.0;

fn earlier(effect: Effect, probe_s: f64) -> Effect {
    match effect {
        Effect::VolumeChange(mut change) => {
            change.time_s = change.time_s.map(|time_s| time_s * (probe_s / PROBE_OF_DRAWS_S).min(1.0));
            Effect::VolumeChange(change)
        }
        other => other,
    }
}

/// Three to six small effects beside the concealed ones.
///
/// What the diagnosis can see of an effect is its net size, so that is what must not compete with the concealed one: a
/// nuisance whose net size comes out above its share is made weaker.
fn nuisances(concealed: &[Planted], plan: &Plan, making: &Making, root: &Draws, probe: &Probe<'_>) -> Vec<Planted> {
    let mut draws = root.stream("nuisances");
    let level_kpa = if plan.effects.is_empty() { NULL_LEVEL_KPA } else { plan.level_kpa };
    let smallest_net_kpa = concealed.iter().map(|planted| larger(planted.size.net_kpa)).fold(f64::INFINITY, f64::min);
    let net_limit_kpa = if concealed.is_empty() { LEAST_NET_KPA } else { NUISANCE_SHARE.1 * smallest_net_kpa };
    let net_limit_kpa = net_limit_kpa.clamp(LEAST_NET_KPA, MOST_NET_KPA);
    let raw_limit_kpa = (NUISANCE_SHARE.1 * level_kpa).min(making.nuisance_ceiling_kpa);
    let mut kinds: Vec<Kind> =
        NUISANCES.iter().copied().filter(|kind| plan.effects.iter().all(|(other, _)| other != kind)).collect();
    draws.shuffle(&mut kinds);
    let count = 3 + draws.index(4);
    let mut planted = Vec::new();
    for kind in kinds {
        let place = kind.places()[draws.index(kind.places().len())];
        let shape = kind.draw(&mut draws);
        let share = draws.between(NUISANCE_SHARE.0, NUISANCE_SHARE.1);
        let wanted_kpa = (level_kpa * share).min(making.nuisance_ceiling_kpa);
        let (mut effect, mut size) = probe.at_size(&shape, place, wanted_kpa, NUISANCE_CLOSE);
        let excess = larger(size.net_kpa) / net_limit_kpa;
        if excess > 1.0 {
            let weaker_kpa = 0.8 * larger(size.raw_kpa) / excess;
            (effect, size) = probe.at_size(&effect, place, weaker_kpa, NUISANCE_CLOSE);
        }
        // The weakest of some kinds is still too strong in some rigs: another kind takes its place.
        if larger(size.net_kpa) <= net_limit_kpa && larger(size.raw_kpa) <= NUISANCE_CLOSE * raw_limit_kpa {
            planted.push(Planted::new(effect, place, size));
        }
        if planted.len() == count {
            break;
        }
    }
    planted
}

fn size_together(build: &BuildSheet, planted: &[Planted], probe: &Probe<'_>) -> Size {
    let mut rig = build.rig();
    for planted in planted {
        planted.effect.install(planted.place, &mut rig);
    }
    probe.size_of(&rig)
}

/// Makes the recordings and enters them in the truth.
fn record(truth: &mut Truth, making: &Making, root: &Draws, holds: &[[f64; 2]]) -> Vec<Recording> {
    let (rig, without) = (truth.rig(), truth.rig_without_effects());
    let range = truth.range;
    let noise = Draws::new(truth.noise_seed);
    let slow = triangles_and_stairs(&mut root.stream("triangles"), &range, ticks(making.seconds[1]));
    let in_loop = |name: &str, seconds: f64| {
        let goals = references_kpa(&mut root.stream(&format!("references {name}")), &range, ticks(seconds));
        Recording::of_references(&rig, range.rest(), &goals, noise.stream(name))
    };
    let start = |duties: &[[f64; 2]]| duties.first().copied().unwrap_or_else(|| range.rest());
    let of_duties = |duties: &[[f64; 2]], name: &str| {
        Recording::of_commands(&rig, start(duties), &pump_on(duties), noise.stream(name))
    };
    // Half of it tracks smoothly and half steps: an effect that shows in one alone is held to account as well.
    let held_out = |seconds: f64| {
        let mut commands = in_loop("held_out", 0.5 * seconds).commands();
        let holds = random_holds(&mut root.stream("holds held_out"), &range, ticks(0.5 * seconds));
        commands.extend(pump_on(&holds));
        Recording::of_commands(&rig, range.rest(), &commands, noise.stream("held_out"))
    };
    let [_, _, tracking_s, held_out_s] = making.seconds;
    let made = [
        ("rec_a.csv", "random_holds", Role::Given, Some(start(holds)), of_duties(holds, "rec_a")),
        ("rec_b.csv", "triangles_and_stairs", Role::Given, None, of_duties(&slow, "rec_b")),
        ("rec_c.csv", "closed_loop", Role::Given, None, in_loop("rec_c", tracking_s)),
        ("held_out.csv", "closed_loop_and_holds", Role::HeldOut, Some(range.rest()), held_out(held_out_s)),
    ];
    let mut recordings = Vec::new();
    for (file, excitation, role, sized_from, recording) in made {
        let effect_kpa = sized_from
            .map(|start| if truth.truth.is_empty() { [0.0; 2] } else { effect_in(&recording, start, &without) });
        truth.recordings.push(RecordingEntry {
            file: file.to_owned(),
            excitation: excitation.to_owned(),
            role,
            effect_kpa,
            noise_kpa: rms(&recording.noise_kpa()),
        });
        recordings.push(recording);
    }
    recordings
}

/// Trace of the concealed effects in a recording (kPa, root mean square), against a rig settled at the same duties.
fn effect_in(recording: &Recording, start: [f64; 2], without: &Rig) -> [f64; 2] {
    let plain = Recording::of_commands(without, start, &recording.commands(), Draws::new(0));
    rms(&difference(&recording.clean_kpa(), &plain.clean_kpa()))
}
