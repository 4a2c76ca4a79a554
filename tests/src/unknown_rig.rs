//! Rigs that the programs under test do not know: `bench`, rigs around it, and rigs of another maker that conceal their physics.

use evaluate::rigs_around::rigs_around;
use hidden_rig::case;
use hidden_rig::suite::Suite;
use hidden_rig::truth::Class;
use model::rig::Rig;
use proto::emulator::{CrioConfig, EmulatedPlant, rig_and_crio};
use proto::reference::Reference;

use crate::hidden_plant::HiddenPlant;

/// Seed of the rigs around `bench` in `trainer evaluate`.
const DRAWN_SEED: u64 = 2026;
/// Number of rigs.
const DRAWN: usize = 20;
/// Length of the reference that a rig of another maker must reach, in s.
const SECONDS: f64 = 60.0;

/// A rig of whose physics only a test knows.
pub enum UnknownRig {
    /// One of our own physics.
    Ours(Box<Rig>),
    /// One of another maker.
    Hidden(Box<hidden_rig::run::Rig>, Vec<String>),
}

impl UnknownRig {
    /// `bench`, `drawn:N` (the Nth of 20 rigs around `bench`, as in `trainer evaluate`) or `hidden:SEED:N` (the Nth rig of another
    /// maker from suite `SEED` of `hidden_rig` that conceals something and reaches the paper's reference).
    ///
    /// # Panics
    /// If there is no such rig.
    pub fn of(name: &str) -> Self {
        let parts: Vec<&str> = name.split(':').collect();
        let number = |text: &str| text.parse::<usize>().unwrap_or_else(|_| panic!("{name}: {text} is no number"));
        match parts.as_slice() {
            ["bench"] => UnknownRig::Ours(Box::new(Rig::builtin("bench").unwrap())),
            ["drawn", n] => {
                let mut rigs = rigs_around(&Rig::builtin("bench").unwrap(), DRAWN, DRAWN_SEED).unwrap();
                UnknownRig::Ours(Box::new(rigs.swap_remove(number(n) - 1)))
            }
            ["hidden", seed, n] => hidden(number(seed) as u64, number(n)),
            _ => panic!("{name}: bench, drawn:N or hidden:SEED:N"),
        }
    }

    /// The plant at rest, as the cRIO would have it behind its sensors.
    ///
    /// # Panics
    /// If it cannot be built.
    pub fn plant(&self) -> Box<dyn EmulatedPlant> {
        match self {
            UnknownRig::Ours(rig) => Box::new(rig_and_crio(rig).unwrap().0),
            UnknownRig::Hidden(rig, _) => Box::new(HiddenPlant::at_rest((**rig).clone())),
        }
    }

    /// Behaviour of its cRIO towards commands.
    ///
    /// # Panics
    /// If the rig's file cannot be understood.
    pub fn crio(&self) -> CrioConfig {
        match self {
            UnknownRig::Ours(rig) => rig_and_crio(rig).unwrap().1,
            UnknownRig::Hidden(..) => CrioConfig::default(),
        }
    }

    /// Mechanisms at work in it that the nominal model leaves out.
    pub fn conceals(&self) -> Vec<String> {
        match self {
            UnknownRig::Ours(rig) => {
                rig.mechanisms.iter().map(|m| format!("{} {}", m.mechanism.id(), m.component)).collect()
            }
            UnknownRig::Hidden(_, effects) => effects.clone(),
        }
    }
}

/// The Nth case of a suite that conceals effects of the library on a rig that reaches the paper's reference.
fn hidden(seed: u64, n: usize) -> UnknownRig {
    let reference = Reference::paper();
    let rows = (0..=(SECONDS * 50.0) as usize).map(|k| reference.at(k as f64 / 50.0));
    let needs: Vec<[f64; 2]> = rows.collect();
    let reaches =
        |range: &[[f64; 2]; 2]| needs.iter().all(|goal| (0..2).all(|c| range[c][0] < goal[c] && goal[c] < range[c][1]));
    let conceals = |class: Class| matches!(class, Class::Single | Class::Pair | Class::Triple);
    Suite::Full
        .plans(seed)
        .into_iter()
        .filter(|plan| conceals(plan.class))
        .filter_map(|plan| Some(case::make(&plan, &case::Making::QUICK).ok()?.truth))
        .filter(|truth| reaches(&truth.range.pressure_kpa))
        .nth(n - 1)
        .map(|truth| {
            let effects = truth.truth.iter().map(|planted| format!("{:?} {:?}", planted.effect, planted.place));
            UnknownRig::Hidden(Box::new(truth.rig()), effects.collect())
        })
        .unwrap_or_else(|| panic!("suite {seed} has no {n} such rigs"))
}
