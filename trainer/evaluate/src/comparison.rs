//! Entrants fly rigs: the flights behind a table.

use std::sync::Arc;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use environment::closed_loop::{FlightPlan, Flown, PolicyController};
use environment::{EnvironmentError, Score, fly};
use law::{Fallback, FallbackSettings, PolicyLaw};
use model::rig::Rig;
use model::shown_reference::ShownReference;
use model::steady::SteadyMap;
use proto::reference::Reference;
use training::TrainedPolicy;

use crate::dob::Dob;
use crate::mpc::{Mpc, TickTimes};
use crate::optimal_open_loop::OptimalOpenLoop;
use crate::repeated::RepeatedFallback;
use crate::table::{Cell, OPTIMUM, Row};

/// Knowledge of a controller about the rig that it flies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Knowledge {
    /// The comparison's model.
    Model,
    /// The rig's own file: a diagnosis that found everything.
    Rig,
}

impl Knowledge {
    /// Name in tables.
    pub fn label(self) -> &'static str {
        match self {
            Knowledge::Model => "",
            Knowledge::Rig => ", told the rig's own file",
        }
    }
}

/// Who flies.
#[derive(Clone)]
pub enum ControllerUnderTest {
    /// The daemon's fallback.
    Fallback(Knowledge),
    /// The fallback, which has flown the reference before and learned from it.
    Repeated {
        /// Knowledge about the rig.
        knowledge: Knowledge,
        /// Flights, of which the last one counts.
        flights: usize,
    },
    /// Offset-free nonlinear MPC.
    Mpc {
        /// Knowledge about the rig.
        knowledge: Knowledge,
        /// Times of its ticks, for all flights.
        times: Arc<TickTimes>,
    },
    /// The disturbance observer, tuned on the model at its linearisation point.
    Dob(Dob),
    /// Policies that differ in nothing but their seed.
    Policies {
        /// Name in the table.
        label: String,
        /// One for each seed.
        policies: Vec<Arc<TrainedPolicy>>,
    },
    /// The limit.
    OptimalOpenLoop,
}

impl ControllerUnderTest {
    /// Name in tables.
    pub fn label(&self) -> String {
        match self {
            ControllerUnderTest::Fallback(knowledge) => format!("fallback PI{}", knowledge.label()),
            ControllerUnderTest::Repeated { knowledge, flights } => {
                format!("iterative learning, run {flights}{}", knowledge.label())
            }
            ControllerUnderTest::Mpc { knowledge, .. } => format!("offset-free NMPC{}", knowledge.label()),
            ControllerUnderTest::Dob(dob) => {
                let [feedback, observer] = dob.bandwidths_per_s();
                format!("disturbance observer (K {feedback}/s, L {observer}/s)")
            }
            ControllerUnderTest::Policies { label, .. } => label.clone(),
            ControllerUnderTest::OptimalOpenLoop => OPTIMUM.into(),
        }
    }
}

/// Flights of a comparison.
pub struct Comparison {
    /// The model behind MPObs, feed-forward and linearisation.
    pub model: Rig,
    /// Columns: a name and the rigs whose flights it is the mean of.
    pub columns: Vec<(String, Vec<Rig>)>,
    /// The reference.
    pub reference: Reference,
    /// Length of a flight in s.
    pub seconds: f64,
    /// Noise of the converter in V RMS.
    pub noise_v_rms: f64,
    /// Noise seeds of entrants without a seed of their own.
    pub seeds: Vec<u64>,
    /// Threads that fly.
    pub threads: usize,
}

/// One flight to fly.
struct Task {
    row: usize,
    column: usize,
    rig: usize,
    seed: usize,
}

/// A model and its steady map.
struct Told<'a> {
    model: &'a Rig,
    map: Arc<SteadyMap>,
}

impl<'a> Told<'a> {
    fn of(
        comparison: &'a Comparison,
        map: &Arc<SteadyMap>,
        rig: &'a Rig,
        knowledge: Knowledge,
    ) -> Result<Self, EnvironmentError> {
        Ok(match knowledge {
            Knowledge::Model => Told { model: &comparison.model, map: Arc::clone(map) },
            Knowledge::Rig => {
                let unsound = |error| EnvironmentError::Rig { name: rig.name.clone(), error };
                Told { model: rig, map: Arc::new(SteadyMap::new(rig).map_err(unsound)?) }
            }
        })
    }

    /// The model, where its sensors need an observer; its predictions are for policies.
    fn observed_by(&self) -> Option<&'a Rig> {
        ShownReference::of(self.model).is_late().then_some(self.model)
    }
}

impl Comparison {
    /// Flies everything; `told` is called after every flight with how many are done and how many there are.
    ///
    /// # Errors
    /// The first rig that cannot be flown.
    pub fn fly(
        &self,
        entrants: &[ControllerUnderTest],
        told: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<Vec<Row>, EnvironmentError> {
        let map = Arc::new(
            SteadyMap::new(&self.model)
                .map_err(|error| EnvironmentError::Rig { name: self.model.name.clone(), error })?,
        );
        let seeds_of = |entrant: &ControllerUnderTest| match entrant {
            ControllerUnderTest::Policies { policies, .. } => policies.len(),
            // Its duties do not depend on the noise; one solution a rig is enough.
            ControllerUnderTest::OptimalOpenLoop => 1,
            _ => self.seeds.len(),
        };
        let mut tasks = Vec::new();
        for (row, entrant) in entrants.iter().enumerate() {
            for (column, (_, rigs)) in self.columns.iter().enumerate() {
                for rig in 0..rigs.len() {
                    tasks.extend((0..seeds_of(entrant)).map(|seed| Task { row, column, rig, seed }));
                }
            }
        }
        // The longest first, so that no thread is left with one of them at the end.
        tasks.sort_by_key(|task| !matches!(entrants.get(task.row), Some(ControllerUnderTest::OptimalOpenLoop)));
        let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let results: Mutex<Vec<(usize, Result<Score, EnvironmentError>)>> = Mutex::new(Vec::new());
        std::thread::scope(|scope| {
            for _ in 0..self.threads.max(1) {
                scope.spawn(|| {
                    loop {
                        let index = next.fetch_add(1, Ordering::Relaxed);
                        let Some(task) = tasks.get(index) else { break };
                        let score = self.fly_one(&map, entrants, task).map(|flown| Score::of(&flown.ticks));
                        if let Ok(mut results) = results.lock() {
                            results.push((index, score));
                        }
                        told(done.fetch_add(1, Ordering::Relaxed) + 1, tasks.len());
                    }
                });
            }
        });
        let mut results = results.into_inner().unwrap_or_default();
        results.sort_by_key(|(index, _)| *index);
        let mut scores: Vec<Vec<Vec<Vec<Score>>>> =
            entrants.iter().map(|entrant| vec![vec![Vec::new(); seeds_of(entrant)]; self.columns.len()]).collect();
        for (index, score) in results {
            let score = score?;
            if let Some(task) = tasks.get(index)
                && let Some(cell) = scores.get_mut(task.row).and_then(|r| r.get_mut(task.column))
                && let Some(seed) = cell.get_mut(task.seed)
            {
                seed.push(score);
            }
        }
        Ok(entrants
            .iter()
            .zip(scores)
            .map(|(entrant, columns)| Row {
                entrant: entrant.label(),
                seeds: seeds_of(entrant),
                cells: columns.iter().map(|seeds| Cell::of(seeds)).collect(),
            })
            .collect())
    }

    fn fly_one(
        &self,
        map: &Arc<SteadyMap>,
        entrants: &[ControllerUnderTest],
        task: &Task,
    ) -> Result<Flown, EnvironmentError> {
        let missing = || EnvironmentError::Setting { key: "table".into(), problem: "holds no such rig".into() };
        let rig = self.columns.get(task.column).and_then(|(_, rigs)| rigs.get(task.rig)).ok_or_else(missing)?;
        let seed = self.seeds.get(task.seed).copied().unwrap_or(task.seed as u64 + 1);
        let plan = FlightPlan {
            rig,
            model: None,
            reference: &self.reference,
            seconds: self.seconds,
            noise_v_rms: self.noise_v_rms,
            seed,
        };
        match entrants.get(task.row).ok_or_else(missing)? {
            ControllerUnderTest::Fallback(knowledge) => {
                let told = Told::of(self, map, rig, *knowledge)?;
                let plan = FlightPlan { model: told.observed_by(), ..plan };
                fly(&plan, &mut Fallback::new(Arc::clone(&told.map), FallbackSettings::default()))
            }
            ControllerUnderTest::Repeated { knowledge, flights } => {
                let told = Told::of(self, map, rig, *knowledge)?;
                let plan = FlightPlan { model: told.observed_by(), ..plan };
                let mut fallback = RepeatedFallback::new(&told.map, FallbackSettings::default());
                // Another noise in every flight: what is learned of it would show as no error at all.
                let seed = |flight: usize| plan.seed + 1000 * flight as u64;
                for flight in 1..*flights {
                    fly(&FlightPlan { seed: seed(flight), ..plan }, &mut fallback)?;
                }
                fly(&plan, &mut fallback)
            }
            ControllerUnderTest::Mpc { knowledge, times } => {
                let told = Told::of(self, map, rig, *knowledge)?;
                let plan = FlightPlan { model: told.observed_by(), ..plan };
                fly(&plan, &mut Mpc::new(&told.map, Arc::clone(times)))
            }
            ControllerUnderTest::Dob(dob) => fly(&plan, &mut dob.clone()),
            ControllerUnderTest::OptimalOpenLoop => {
                let mut solved = OptimalOpenLoop::solve(map, rig, &self.reference, self.seconds)?;
                fly(&plan, &mut solved)
            }
            ControllerUnderTest::Policies { policies, .. } => {
                let policy = policies.get(task.seed).ok_or_else(missing)?;
                let predicts = policy.settings().policy.variant.predicts();
                let plan = FlightPlan { model: predicts.then_some(&self.model), ..plan };
                let law = PolicyLaw::new(Arc::clone(map), policy.settings().contract());
                let mut runner = policy.runner();
                fly(&plan, &mut PolicyController::new(law, |observation: &[f32]| runner.outputs(observation)))
            }
        }
    }
}
