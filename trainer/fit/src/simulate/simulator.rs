//! Many rigs through all recordings, on all cores.

use std::num::NonZero;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc as Shared, Mutex, PoisonError};

use model::averaged::PumpTables;
use model::plant::{Plant, Simulated, Unknown};
use model::real::{Lanes, Real};
use model::rig::{Rig, RigError};
use proto::recording::PERIOD_S;

use super::arcs::{Arc, Arcs, Flapper, share_of};
use super::lanes::sweep;
use crate::FitError;
use crate::data::Records;

/// Rigs that run side by side.
const SIDE_BY_SIDE: usize = 8;
/// Fewer rigs are run one by one: a bundle takes as long as three of them, however many of its lanes are wanted.
const WORTH_A_BUNDLE: usize = 3;

/// How closely the pump is simulated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fidelity {
    /// Every stroke of the pistons, at the rig's own step: what figures are reported from.
    Detailed,
    /// Every stroke, at a step of 0.4 ms: off by about 0.05 kPa, four times as fast.
    Coarse,
    /// Pumps averaged over a revolution ([`model::averaged`]), their ripple put back onto the readings: smooth in the
    /// parameters and, rig by rig, some twenty times as fast as in detail.
    Averaged,
    /// The same without the ripple: for readings that were freed from it ([`crate::simulate::Track`]), and rigs whose
    /// crank angles nobody knows.
    Smooth,
}

/// The coarse step in ms.
const COARSE_STEP_MS: f64 = 0.4;
/// The step at which pumps are turned for their tables, in ms: twice that of the paper's rig, for half the time.
const TABLE_STEP_MS: f64 = 0.2;
/// Rigs whose pumps' tables are all remembered at once; more are a grid over something else than the pump.
const FEW: usize = 64;
/// The step of averaged plants in ms. With 20 ms a diagnosis takes a fifth less time, and a delay that ends within a tick takes
/// the chamber's compliance along: 1.24 mL/kPa for 1.3, and 40.6 ms for 40.
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

/// Recordings, and what it takes to run rigs over them.
#[derive(Debug, Clone, Copy)]
pub struct Simulator<'r> {
    records: &'r Records,
    fidelity: Fidelity,
    threads: usize,
}

/// What became of one run: a trace of the recordings' layout, or why the rig cannot be simulated.
pub(super) type Outcome = Result<Vec<f64>, RigError>;

/// Rigs of one structure, compiled.
enum Bundle {
    One(Shared<Plant<f64>>),
    Several(Shared<Plant<Lanes<SIDE_BY_SIDE>>>),
}

/// A compiled bundle and the runs that are in it, by index.
struct Group {
    bundle: Bundle,
    ticks_per_row: u32,
    runs: Vec<usize>,
}

/// What became of a bundle: groups that can be run, and runs whose rigs cannot be simulated.
#[derive(Default)]
struct Compiled {
    groups: Vec<Group>,
    unsound: Vec<(usize, RigError)>,
}

impl<'r> Simulator<'r> {
    /// Runs rigs over `records` on all cores.
    pub fn new(records: &'r Records, fidelity: Fidelity) -> Self {
        let threads = std::thread::available_parallelism().map_or(1, NonZero::get);
        Simulator { records, fidelity, threads }
    }

    /// The same on a given number of cores.
    #[must_use]
    pub fn on(self, threads: usize) -> Self {
        Simulator { threads: threads.max(1), ..self }
    }

    /// The same at another fidelity.
    #[must_use]
    pub fn at(self, fidelity: Fidelity) -> Self {
        Simulator { fidelity, ..self }
    }

    /// The recordings.
    pub fn records(&self) -> &'r Records {
        self.records
    }

    /// How closely the pump is simulated.
    pub fn fidelity(&self) -> Fidelity {
        self.fidelity
    }

    /// Readings (gauge kPa, in the recordings' layout) of every run, in the order of `runs`; rows in no arc hold what
    /// was recorded. A run that diverges holds NaN or infinities.
    ///
    /// # Errors
    /// By run: a rig that fails its checks, or has other inputs or sensors than the recordings.
    pub fn run(&self, runs: &[Run], arcs: &Arcs) -> Vec<Result<Vec<f64>, RigError>> {
        let mut outcomes: Vec<Outcome> = runs.iter().map(|_| Ok(self.records.readings_kpa().to_vec())).collect();
        let groups = self.groups(runs, &mut outcomes);
        let records = self.records.records().len();
        let items: Vec<(usize, usize)> =
            (0..groups.len()).flat_map(|g| (0..records).map(move |record| (g, record))).collect();
        let outcomes = Mutex::new(outcomes);
        self.shared_out(items.len(), |item| {
            let Some((group, record)) = items.get(item) else { return };
            let Some(group) = groups.get(*group) else { return };
            match &group.bundle {
                Bundle::One(plant) => self.through(plant, group, runs, *record, arcs, &outcomes),
                Bundle::Several(plant) => self.through(plant, group, runs, *record, arcs, &outcomes),
            }
        });
        outcomes.into_inner().unwrap_or_else(PoisonError::into_inner)
    }

    /// Does `count` pieces of work on all cores.
    fn shared_out(&self, count: usize, work: impl Fn(usize) + Sync) {
        let next = AtomicUsize::new(0);
        let all = || {
            loop {
                let item = next.fetch_add(1, Ordering::Relaxed);
                if item >= count {
                    break;
                }
                work(item);
            }
        };
        std::thread::scope(|scope| {
            for _ in 1..self.threads.min(count) {
                scope.spawn(all);
            }
            all();
        });
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

    /// One group through one recording.
    fn through<R: Simulated>(
        &self,
        plant: &Shared<Plant<R>>,
        group: &Group,
        runs: &[Run],
        record: usize,
        arcs: &Arcs,
        outcomes: &Mutex<Vec<Outcome>>,
    ) {
        let Some(columns) = self.records.records().get(record) else { return };
        let layout = self.records.layout();
        let place = layout.channel(record, 0).start..layout.channel(record, layout.channels().saturating_sub(1)).end;
        let recorded = self.records.readings_kpa().get(place.clone()).unwrap_or_default();
        let mut out: Vec<R> = recorded.iter().map(|kpa| R::splat(*kpa)).collect();
        let run_of = |lane: usize| group.runs.get(lane).or(group.runs.last()).and_then(|run| runs.get(*run));
        let shift: Vec<R> = (0..layout.channels())
            .map(|channel| {
                R::from_lanes(|lane| run_of(lane).and_then(|run| run.shift_kpa.get(channel)).copied().unwrap_or(0.0))
            })
            .collect();
        let crank = R::from_lanes(|lane| columns.crank_rev + run_of(lane).map_or(0.0, |run| run.crank_rev));
        sweep(
            plant,
            self.fidelity == Fidelity::Smooth,
            group.ticks_per_row,
            columns,
            arcs.numbered(record),
            &shift,
            crank,
            &|number, arc, unknown| share(&run_of, number, arc, unknown),
            &mut out,
        );
        let mut outcomes = outcomes.lock().unwrap_or_else(PoisonError::into_inner);
        for (lane, run) in group.runs.iter().enumerate() {
            if let Some(Ok(trace)) = outcomes.get_mut(*run)
                && let Some(part) = trace.get_mut(place.clone())
            {
                for (slot, value) in part.iter_mut().zip(&out) {
                    *slot = value.lane(lane);
                }
            }
        }
    }

    /// Compiles the runs in bundles of one structure; what cannot be compiled becomes an error.
    fn groups(&self, runs: &[Run], outcomes: &mut [Outcome]) -> Vec<Group> {
        let mut kinds: Vec<(String, Vec<usize>)> = Vec::new();
        for (index, run) in runs.iter().enumerate() {
            let kind = structure(&run.rig);
            match kinds.iter_mut().find(|(known, _)| *known == kind) {
                Some((_, members)) => members.push(index),
                None => kinds.push((kind, vec![index])),
            }
        }
        let bundles: Vec<Vec<usize>> = kinds
            .iter()
            .flat_map(|(_, members)| members.chunks(SIDE_BY_SIDE))
            .flat_map(|members| members.chunks(if members.len() < WORTH_A_BUNDLE { 1 } else { SIDE_BY_SIDE }))
            .map(<[usize]>::to_vec)
            .collect();
        // Compiled on all cores: tables of pumps take as long as a run. Rig by rig before bundle by bundle, for the rigs that
        // differ in the pump often lie in the same bundle.
        let averaged = matches!(self.fidelity, Fidelity::Averaged | Fidelity::Smooth);
        if averaged && (2..=FEW).contains(&runs.len()) {
            self.shared_out(runs.len(), |item| {
                if let Some(run) = runs.get(item) {
                    // What is wrong with it shows below; the table is kept.
                    let _ = self.plant(&self.prepared(&run.rig));
                }
            });
        }
        let compiled: Vec<Mutex<Compiled>> = bundles.iter().map(|_| Mutex::default()).collect();
        self.shared_out(bundles.len(), |item| {
            if let (Some(members), Some(slot)) = (bundles.get(item), compiled.get(item)) {
                let compiled = self.compile(runs, members);
                *slot.lock().unwrap_or_else(PoisonError::into_inner) = compiled;
            }
        });
        let mut groups = Vec::new();
        for compiled in compiled {
            let compiled = compiled.into_inner().unwrap_or_else(PoisonError::into_inner);
            groups.extend(compiled.groups);
            for (run, problem) in compiled.unsound {
                if let Some(outcome) = outcomes.get_mut(run) {
                    *outcome = Err(problem);
                }
            }
        }
        groups
    }

    fn compile(&self, runs: &[Run], members: &[usize]) -> Compiled {
        let rigs: Vec<Rig> = members.iter().filter_map(|m| runs.get(*m)).map(|run| self.prepared(&run.rig)).collect();
        let bundle = match rigs.as_slice() {
            [rig] => self.plant(rig).and_then(|plant| {
                let ticks = self.fits(&plant)?;
                Ok((Bundle::One(Shared::new(plant)), ticks))
            }),
            several => self.side_by_side(several).and_then(|plant| {
                let ticks = self.fits(&plant)?;
                Ok((Bundle::Several(Shared::new(plant)), ticks))
            }),
        };
        match bundle {
            Ok((bundle, ticks_per_row)) => {
                Compiled { groups: vec![Group { bundle, ticks_per_row, runs: members.to_vec() }], unsound: Vec::new() }
            }
            // One of them is unsound, or numbers (a compliance of zero) changed the structure after all.
            Err(_) if members.len() > 1 => {
                let (front, back) = members.split_at(members.len() / 2);
                let (mut compiled, mut rest) = (self.compile(runs, front), self.compile(runs, back));
                compiled.groups.append(&mut rest.groups);
                compiled.unsound.append(&mut rest.unsound);
                compiled
            }
            Err(problem) => Compiled {
                groups: Vec::new(),
                unsound: members.first().map(|run| (*run, problem)).into_iter().collect(),
            },
        }
    }

    fn plant(&self, rig: &Rig) -> Result<Plant<f64>, RigError> {
        match self.fidelity {
            Fidelity::Averaged | Fidelity::Smooth => Plant::averaged(rig, AVERAGED_STEP_MS, &TABLES),
            Fidelity::Detailed | Fidelity::Coarse => Plant::new(rig),
        }
    }

    fn side_by_side(&self, rigs: &[Rig]) -> Result<Plant<Lanes<SIDE_BY_SIDE>>, RigError> {
        match self.fidelity {
            Fidelity::Averaged | Fidelity::Smooth => Plant::averaged_side_by_side(rigs, AVERAGED_STEP_MS, &TABLES),
            Fidelity::Detailed | Fidelity::Coarse => Plant::side_by_side(rigs),
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

    /// Ticks from row to row, if the plant has the inputs and sensors of the recordings.
    fn fits<R: Real>(&self, plant: &Plant<R>) -> Result<u32, RigError> {
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
        // Between 1 and 20: a rig's tick is at least 1 ms.
        Ok(ticks.round() as u32)
    }
}

/// Where an unknown stands at the start of an arc, lane by lane; `None` where no lane says so.
fn share<'a, R: Real>(
    run_of: &dyn Fn(usize) -> Option<&'a Run>,
    number: usize,
    arc: &Arc,
    unknown: &Unknown,
) -> Option<R> {
    let own = |lane: usize| run_of(lane).and_then(|run| share_of(run.flappers.get(number)?, &unknown.name));
    let arcs = share_of(&arc.flappers, &unknown.name);
    if arcs.is_none() && (0..R::LANES).all(|lane| own(lane).is_none()) {
        return None;
    }
    Some(R::from_lanes(|lane| own(lane).or(arcs).unwrap_or(unknown.usual)))
}

/// What must be equal for rigs to lie side by side, as far as it shows without compiling them.
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
