//! Many rigs through all recordings, on all cores.

use std::sync::{Arc as Shared, Mutex, OnceLock, PoisonError};

use model::averaged::PumpTables;
use model::plant::{Plant, Simulated};
use model::real::Lanes;
use model::rig::{Rig, RigError};
use proto::recording::PERIOD_S;

use super::arcs::{Arcs, Flapper};
use super::chains::{Chain, kinds};
use super::lanes::{Lane, span, sweep};
use crate::FitError;
use crate::cores::{all_cores, any_is_free, share_out};
use crate::data::Records;

/// Number of lanes side by side where there is much to run.
const MANY: usize = 8;
/// Number of lanes side by side where there is little: the recordings of one rig, mostly. A bundle of four takes a tenth to two
/// thirds longer than one rig, a bundle of eight up to three times as long, however many of their lanes are wanted.
const FEW: usize = 4;

/// Closeness with which the pump is simulated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fidelity {
    /// Every stroke of the pistons, at the rig's own step: what figures are reported from.
    Detailed,
    /// Every stroke, at a step of 0.4 ms: off by about 0.05 kPa, four times as fast.
    Coarse,
    /// Pumps averaged over a revolution ([`model::averaged`]), their ripple put back onto the readings: smooth in the
    /// parameters and, rig by rig, some twenty times as fast as in detail.
    Averaged,
    /// Averaged pumps without the ripple: for readings that were freed from it ([`crate::simulate::Track`]), and rigs
    /// whose crank angles nobody knows.
    Smooth,
}

/// The coarse step in ms.
const COARSE_STEP_MS: f64 = 0.4;
/// The step at which pumps are turned for their tables, in ms: twice that of the paper's rig, for half the time.
const TABLE_STEP_MS: f64 = 0.2;
/// The step of averaged plants in ms, or a tick where that is shorter. With 20 ms a diagnosis takes a fifth less time where its fits come to
/// rest, which they do not where parameters stand in for each other.
const AVERAGED_STEP_MS: f64 = 10.0;

/// Tables of averaged pumps, which depend on numbers of rigs alone. Rigs of one Jacobian differ in one number each, which
/// mostly is none of the pump's, and the next run begins where the last one ended.
static TABLES: PumpTables = PumpTables::smooth();

/// One rig to be run, and how its starts differ from the arcs'.
#[derive(Debug, Clone)]
pub struct Run {
    /// The rig.
    pub rig: Rig,
    /// Added to the readings that every arc starts from, in kPa, by channel; empty for nothing.
    pub shift_kpa: Vec<f64>,
    /// Revolutions by which cranks are further on at the start of each recording than [`Records`] says.
    pub crank_rev: f64,
    /// Where flappers lie at the start of each arc, by its number, where that is not what the arc says; empty for nothing.
    pub flappers: Vec<Vec<Flapper>>,
}

impl From<Rig> for Run {
    fn from(rig: Rig) -> Self {
        Run { rig, shift_kpa: Vec::new(), crank_rev: 0.0, flappers: Vec::new() }
    }
}

impl Run {
    /// Runs that show what starts do to a rig: one as it is, and one for each channel that starts `nudge_kpa` higher.
    pub fn nudged(rig: &Rig, channels: usize, nudge_kpa: f64) -> Vec<Run> {
        let nudged = |channel: usize| {
            let shift_kpa = (0..channels).map(|other| if other == channel { nudge_kpa } else { 0.0 }).collect();
            Run { shift_kpa, ..Run::from(rig.clone()) }
        };
        std::iter::once(Run::from(rig.clone())).chain((0..channels).map(nudged)).collect()
    }
}

/// Recordings, and what it takes to run rigs over them.
#[derive(Debug, Clone, Copy)]
pub struct Simulator<'r> {
    records: &'r Records,
    fidelity: Fidelity,
    threads: usize,
}

/// Outcome of one run: a trace of the recordings' layout, or why the rig cannot be simulated.
pub(super) type Outcome = Result<Vec<f64>, RigError>;

/// Rigs of one structure, compiled.
enum Bundle {
    One(Shared<Plant<f64>>),
    Few(Shared<Plant<Lanes<FEW>>>),
    Many(Shared<Plant<Lanes<MANY>>>),
}

/// One run through one chain of arcs, by their indices.
type Flight = (usize, usize);

/// A compiled bundle and what runs in its lanes.
struct Group {
    bundle: Bundle,
    ticks_per_row: u32,
    flights: Vec<Flight>,
}

/// Data that all runs of one call share.
struct Task<'t> {
    runs: &'t [Run],
    /// The runs' rigs, compiled; `None` for those that cannot be.
    plants: &'t [Option<Plant<f64>>],
    chains: &'t [Chain<'t>],
}

impl<'r> Simulator<'r> {
    /// Runs rigs over `records` on all cores.
    pub fn new(records: &'r Records, fidelity: Fidelity) -> Self {
        Simulator { records, fidelity, threads: all_cores() }
    }

    /// The simulator on a given number of cores.
    #[must_use]
    pub fn on(self, threads: usize) -> Self {
        Simulator { threads: threads.max(1), ..self }
    }

    /// The simulator at another fidelity.
    #[must_use]
    pub fn at(self, fidelity: Fidelity) -> Self {
        Simulator { fidelity, ..self }
    }

    /// The recordings.
    pub fn records(&self) -> &'r Records {
        self.records
    }

    /// Fidelity at which pumps are simulated.
    pub fn fidelity(&self) -> Fidelity {
        self.fidelity
    }

    /// Readings (gauge kPa, in the recordings' layout) of every run, in the order of `runs`; rows in no arc hold what
    /// was recorded. A run that diverges holds NaN or infinities.
    ///
    /// # Errors
    /// By run: a rig that fails its checks, or has other inputs or sensors than the recordings.
    pub fn run(&self, runs: &[Run], arcs: &Arcs) -> Vec<Result<Vec<f64>, RigError>> {
        let (plants, outcomes): (Vec<_>, Vec<Outcome>) = self
            .compiled(runs)
            .into_iter()
            .map(|compiled| match compiled {
                Ok(plant) => (Some(plant), Ok(self.records.readings_kpa().to_vec())),
                Err(problem) => (None, Err(problem)),
            })
            .unzip();
        let chains = Chain::all(self.records, arcs);
        let task = Task { runs, plants: &plants, chains: &chains };
        let bundles = self.bundles(&task);
        let outcomes = Mutex::new(outcomes);
        self.shared_out(bundles.len(), |item| {
            for group in bundles.get(item).into_iter().flat_map(|flights| task.groups(flights)) {
                match &group.bundle {
                    Bundle::One(plant) => self.through(plant, &group, &task, &outcomes),
                    Bundle::Few(plant) => self.through(plant, &group, &task, &outcomes),
                    Bundle::Many(plant) => self.through(plant, &group, &task, &outcomes),
                }
            }
        });
        outcomes.into_inner().unwrap_or_else(PoisonError::into_inner)
    }

    /// Does `count` pieces of work on the cores that are free.
    fn shared_out(&self, count: usize, work: impl Fn(usize) + Sync) {
        share_out(count, self.threads, work, &mut |_| ());
    }

    /// Free runs of rigs, from the first readings.
    ///
    /// # Errors
    /// As [`Simulator::run`].
    pub fn free(&self, rigs: &[Rig]) -> Vec<Result<Vec<f64>, RigError>> {
        let runs: Vec<Run> = rigs.iter().cloned().map(Run::from).collect();
        self.run(&runs, &Arcs::free(self.records))
    }

    /// One rig over the arcs.
    ///
    /// # Errors
    /// The rig fails its checks, has other inputs or sensors than the recordings, or diverges.
    pub fn one(&self, rig: &Rig, arcs: &Arcs) -> Result<Vec<f64>, FitError> {
        let outcome = self.run(&[Run::from(rig.clone())], arcs).pop().unwrap_or_else(|| Ok(Vec::new()));
        let trace = outcome.map_err(FitError::rig(rig))?;
        if trace.iter().all(|kpa| kpa.is_finite()) {
            Ok(trace)
        } else {
            Err(FitError::NotFinite { rig: rig.name.clone() })
        }
    }

    /// One group through its chains.
    fn through<R: Simulated>(
        &self,
        plant: &Shared<Plant<R>>,
        group: &Group,
        task: &Task<'_>,
        outcomes: &Mutex<Vec<Outcome>>,
    ) {
        let lanes: Vec<Lane<'_>> = group.flights.iter().filter_map(|flight| task.lane(*flight)).collect();
        let out = sweep(plant, self.fidelity == Fidelity::Smooth, group.ticks_per_row, &lanes);
        let rows = span(&lanes);
        let layout = self.records.layout();
        let mut outcomes = outcomes.lock().unwrap_or_else(PoisonError::into_inner);
        for (index, ((run, _), lane)) in group.flights.iter().zip(&lanes).enumerate() {
            let Some(Ok(trace)) = outcomes.get_mut(*run) else { continue };
            let first = lane.chain.rows().start;
            for (_, arc) in lane.chain.arcs() {
                for channel in 0..layout.channels() {
                    let place = layout.stretch(lane.chain.record, channel, arc.rows.clone());
                    let from = channel * rows + arc.rows.start - first;
                    let read = out.get(from..from + arc.rows.len()).unwrap_or_default();
                    for (slot, value) in trace.get_mut(place).unwrap_or_default().iter_mut().zip(read) {
                        *slot = value.lane(index);
                    }
                }
            }
        }
    }

    /// The rigs of runs, compiled one by one on all cores: tables of pumps take as long as a run.
    fn compiled(&self, runs: &[Run]) -> Vec<Result<Plant<f64>, RigError>> {
        let slots: Vec<OnceLock<Result<Plant<f64>, RigError>>> = runs.iter().map(|_| OnceLock::new()).collect();
        self.shared_out(runs.len(), |item| {
            if let (Some(run), Some(slot)) = (runs.get(item), slots.get(item)) {
                slot.get_or_init(|| self.plant(&self.prepared(&run.rig)).and_then(|plant| self.fitting(plant)));
            }
        });
        let not_there = || Err(RigError::at("", "was not compiled"));
        slots.into_iter().map(|slot| slot.into_inner().unwrap_or_else(not_there)).collect()
    }

    /// Runs and chains in bundles of one structure.
    fn bundles(&self, task: &Task<'_>) -> Vec<Vec<Flight>> {
        let mut structures: Vec<(String, Vec<usize>)> = Vec::new();
        for (index, run) in task.runs.iter().enumerate().filter(|(index, _)| task.plant(*index).is_some()) {
            let structure = structure(&run.rig);
            match structures.iter_mut().find(|(known, _)| *known == structure) {
                Some((_, members)) => members.push(index),
                None => structures.push((structure, vec![index])),
            }
        }
        // One for each core comes before several in one, and few on each before many on one.
        let width = match task.runs.len() * task.chains.len() {
            flights if flights <= self.threads => 1,
            flights if flights <= FEW * self.threads => FEW,
            _ => MANY,
        };
        let kinds = kinds(task.chains);
        let mut bundles = Vec::new();
        for (_, members) in &structures {
            for kind in &kinds {
                let flights: Vec<Flight> =
                    kind.iter().flat_map(|chain| members.iter().map(|run| (*run, *chain))).collect();
                bundles.extend(flights.chunks(width).map(<[Flight]>::to_vec));
            }
        }
        // Of the last one two halves take a little more than half the time each, where a core would wait for it.
        if bundles.len() % self.threads != 0
            && any_is_free()
            && let Some(last) = bundles.pop_if(|last| last.len() > FEW)
        {
            bundles.extend(last.chunks(FEW).map(<[Flight]>::to_vec));
        }
        bundles
    }

    fn plant(&self, rig: &Rig) -> Result<Plant<f64>, RigError> {
        match self.fidelity {
            Fidelity::Averaged | Fidelity::Smooth => {
                Plant::averaged(rig, AVERAGED_STEP_MS.min(rig.integrator.tick_ms), &TABLES)
            }
            Fidelity::Detailed | Fidelity::Coarse => Plant::new(rig),
        }
    }

    fn prepared(&self, rig: &Rig) -> Rig {
        let mut rig = rig.clone();
        let least_ms = match self.fidelity {
            Fidelity::Detailed => 0.0,
            Fidelity::Coarse => COARSE_STEP_MS,
            Fidelity::Averaged | Fidelity::Smooth => TABLE_STEP_MS,
        };
        if rig.integrator.step_ms < least_ms {
            let steps = (rig.integrator.tick_ms / least_ms).round().max(1.0);
            rig.integrator.step_ms = rig.integrator.tick_ms / steps;
        }
        rig
    }

    /// The plant, if it has the inputs and sensors of the recordings and its ticks fit into their rows.
    fn fitting(&self, plant: Plant<f64>) -> Result<Plant<f64>, RigError> {
        if plant.inputs() != self.records.inputs() || plant.sensor_columns() != self.records.sensors() {
            let problem = "the rig has other inputs or sensors than the one that the recordings were read for";
            return Err(RigError::at("", problem));
        }
        let ticks = PERIOD_S / plant.tick_s();
        // Ticks are written in ms with a few digits.
        if ticks < 0.5 || (ticks - ticks.round()).abs() > 1e-6 {
            let problem = format!(
                "rows are {} ms apart, which is no whole number of ticks of {} ms; use {} ms",
                PERIOD_S * 1e3,
                plant.tick_s() * 1e3,
                PERIOD_S * 1e3
            );
            return Err(RigError::at("integrator.tick_ms", problem));
        }
        Ok(plant)
    }
}

impl<'t> Task<'t> {
    /// A run's rig, compiled.
    fn plant(&self, run: usize) -> Option<&'t Plant<f64>> {
        self.plants.get(run)?.as_ref()
    }

    /// The lane of a flight.
    fn lane(&self, (run, chain): Flight) -> Option<Lane<'t>> {
        let (run, chain) = (self.runs.get(run)?, self.chains.get(chain)?);
        Some(Lane {
            chain,
            shift_kpa: &run.shift_kpa,
            crank_rev: chain.columns.crank_rev + run.crank_rev,
            flappers: &run.flappers,
        })
    }

    /// Flights as a bundle; as several where numbers (a compliance of zero) changed the structure after all.
    fn groups(&self, flights: &[Flight]) -> Vec<Group> {
        let plants: Vec<&Plant<f64>> = flights.iter().filter_map(|(run, _)| self.plant(*run)).collect();
        let together = match plants.as_slice() {
            [] => return Vec::new(),
            [plant] => Ok(Bundle::One(Shared::new((*plant).clone()))),
            several => {
                let several: Vec<Plant<f64>> = several.iter().map(|plant| (*plant).clone()).collect();
                if several.len() <= FEW {
                    Plant::together(&several).map(|plant| Bundle::Few(Shared::new(plant)))
                } else {
                    Plant::together(&several).map(|plant| Bundle::Many(Shared::new(plant)))
                }
            }
        };
        let Ok(bundle) = together else {
            let (front, back) = flights.split_at(flights.len() / 2);
            return [front, back].into_iter().flat_map(|half| self.groups(half)).collect();
        };
        // Between 1 and 20: a rig's tick is at least 1 ms.
        let ticks_per_row = plants.first().map_or(1, |plant| (PERIOD_S / plant.tick_s()).round() as u32);
        vec![Group { bundle, ticks_per_row, flights: flights.to_vec() }]
    }
}

/// Key that must be equal for rigs to lie side by side, as far as it shows without compiling them.
fn structure(rig: &Rig) -> String {
    let mut key = rig.name.clone();
    for mechanism in rig.mechanisms.iter().filter(|m| m.enabled) {
        key.push_str(&format!(" {}@{}", mechanism.mechanism.id(), mechanism.component));
    }
    for volume in rig.volumes.values() {
        key.push(if volume.compliance_ml_per_kpa == 0.0 { 'r' } else { 'c' });
    }
    key
}
