//! Another model behind predictions, feed-forward, safety filter and monitor, put in at a tick's edge.
//!
//! `controller model FILE` compiles a rig off the tick, compares its predictions with those of the model in force on the
//! last minutes of the run, and hands all that is made of it to the tick in one box; what was in force goes back in the
//! same box, to be dropped here. The command goes on without a bump: what differs decays within half a second.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use admission::model_comparison::{ModelFigures, Sample, compare, seconds_lacking, warmed};
use crossbeam::queue::ArrayQueue;
use flight::Noter;
use handover::Permit;
use handover::crossing::{Inbox, Trail};
use law::{FallbackSettings, RepetitionLearning, Repetitions};
use model::predict::Predictor;
use model::rig::{Rig, RigError};
use model::shown_reference::ShownReference;
use model::steady::SteadyMap;
use monitor::MonitorModels;
use proto::recording::{TickOrder, attached};
use safety_filter::{Envelope, SafetyFilter, SlewLimit};

use crate::config::Safety;
use crate::config::sensor_limits::load_within_limits;
use crate::cycle::sensing::Sensing;
use crate::operator::running::ModelIdentity;
use crate::reach::ModelReach;
use crate::session::session_recorder::attachment;
use crate::state::State;

/// Samples that the tick keeps for a comparison: 160 s.
const SAMPLES: usize = 8192;
/// The newest of them that are compared: a minute takes some seconds of computing.
const COMPARED: usize = 3000;
/// The newest samples that the monitor's models run along with before they are put in: 10 s, in which observers settle.
const FOLLOWED: usize = 500;
/// Samples that a replay keeps: a change may have looked at those of 20 min before, where ticks did not wait for it.
const REPLAYED: usize = 1 << 16;
/// Time that the tick may take to put a model in.
pub const PATIENCE: Duration = Duration::from_secs(2);
/// Time in which a model that a tick has taken comes back from it: five ticks.
const IN_TICK: Duration = Duration::from_millis(100);
/// Between two looks whether it has.
const LOOK: Duration = Duration::from_millis(5);

/// All that is made of a model.
pub struct ModelChange {
    /// MPObs.
    pub predictor: Predictor,
    /// Feed-forward.
    pub map: Arc<SteadyMap>,
    /// Readings of its sensors for chambers on a reference, by which policies are judged.
    pub shown_reference: ShownReference,
    /// The safety filter.
    pub filter: SafetyFilter,
    /// Models that the monitor holds readings against.
    pub monitor: MonitorModels,
    /// Learning from flights of references on this model, where that is learned: nothing yet.
    pub repetitions: Option<Box<Repetitions>>,
    compared: Compared,
}

/// A model's standing before it is put in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Compared {
    /// It foresees the run well enough, was in force before, or was put in in the run that is replayed.
    Yes,
    /// Nothing tells yet: it may only come in while the rig is not under control.
    No,
}

/// A change on its way back from the tick.
enum Returned {
    /// It holds what was in force.
    Exchanged(Box<ModelChange>),
    /// It was not put in: the rig is under control, and the model was not compared.
    Refused(Box<ModelChange>),
}

/// Outcome of handing a model to the tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum HandOver {
    PutIn,
    Refused,
}

impl ModelChange {
    /// All that is made of `rig`, having run along with the newest samples.
    fn new(rig: &Rig, run: &[Sample], learning: RepetitionLearning, compared: Compared) -> Result<Self, RigError> {
        let map = Arc::new(SteadyMap::new(rig)?);
        let learns = learning == RepetitionLearning::On;
        Ok(ModelChange {
            predictor: warmed(rig, run)?,
            repetitions: learns.then(|| Box::new(FallbackSettings::default().repetitions(&map))),
            map,
            shown_reference: ShownReference::of(rig),
            // The tick puts the limits of the filter in force into it.
            filter: SafetyFilter::new(rig, Envelope::DEFAULT, SlewLimit::DEFAULT)?,
            monitor: monitor_models(rig, run)?,
            compared,
        })
    }
}

impl ModelInForce {
    /// Puts it into the recording, so that the run can be replayed.
    pub fn keep(&self, notes: &Noter) {
        notes.attach(attachment(attached::MODEL, "application/toml", self.toml.as_str()));
        let order = TickOrder::Model { followed: self.followed };
        notes.attach(attachment(attached::ORDER, "application/json", order.to_json()));
    }
}

/// The tick's end.
pub struct ModelTickEnd {
    shared: Arc<Shared>,
    /// Samples kept since the start.
    kept: u64,
}

struct Shared {
    next: Inbox<Box<ModelChange>>,
    retired: ArrayQueue<Returned>,
    samples: Trail<Numbered>,
    /// True where a change brings what learns from flights.
    learns: AtomicBool,
}

impl Shared {
    fn learning(&self) -> RepetitionLearning {
        if self.learns.load(Ordering::Relaxed) { RepetitionLearning::On } else { RepetitionLearning::Off }
    }
}

/// A sample, and how many there have been with it since the start.
type Numbered = (u64, Sample);

/// A model that has come into force.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelInForce {
    /// One line for whoever asked.
    pub line: String,
    /// The rig file as it was taken.
    pub toml: String,
    /// Samples since the start that it had run along with.
    pub followed: u64,
}

/// The model in force, and the one before it, to which an operator may always go back.
struct Models {
    rig: Rig,
    reach: Arc<ModelReach>,
    /// The identity under which it was put in; `None` for the one that the daemon began with.
    identity: Option<ModelIdentity>,
    before: Option<Rig>,
}

/// The operators' end.
#[derive(Clone)]
pub struct ModelDesk {
    shared: Arc<Shared>,
    /// Held for a moment only, also by those who answer operators.
    models: Arc<Mutex<Models>>,
    /// Samples that were taken off the tick's queue; held for as long as a change takes.
    samples: Arc<Mutex<VecDeque<Numbered>>>,
}

/// Makes both ends for a loop that begins with `rig`, of which `map` was made.
pub fn ends(rig: &Rig, map: Arc<SteadyMap>) -> (ModelTickEnd, ModelDesk) {
    let shared = Arc::new(Shared {
        next: Inbox::new(1),
        retired: ArrayQueue::new(4),
        samples: Trail::new(SAMPLES),
        learns: AtomicBool::new(false),
    });
    let reach = Arc::new(ModelReach::of(map));
    let models = Arc::new(Mutex::new(Models { rig: rig.clone(), reach, identity: None, before: None }));
    (ModelTickEnd { shared: Arc::clone(&shared), kept: 0 }, ModelDesk { shared, models, samples: Arc::default() })
}

impl ModelTickEnd {
    /// The next model, if there is one and what is in force finds room on its way back; asked for in every tick. One that
    /// was not compared goes straight back while the rig is under control: only the tick knows whether it is by then.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn take(&self, state: State) -> Option<Box<ModelChange>> {
        // One slot stays free: the one that is written is never the one that is being read.
        if self.shared.retired.len() + 1 >= self.shared.retired.capacity() {
            return None;
        }
        let change = self.shared.next.take()?;
        if change.compared == Compared::No && state.is_controlling() {
            self.give_back(Returned::Refused(change));
            return None;
        }
        Some(change)
    }

    /// Hands back what was in force.
    ///
    /// # Real-time
    /// Runs in the tick; `take` has seen to it that there is room.
    pub fn retire(&self, change: Box<ModelChange>) {
        self.give_back(Returned::Exchanged(change));
    }

    fn give_back(&self, returned: Returned) {
        if let Err(returned) = self.shared.retired.push(returned) {
            std::mem::forget(returned);
        }
    }

    /// Says whether models that follow bring what learns from flights; before the run.
    pub fn learn_repetitions(&self, learning: RepetitionLearning) {
        self.shared.learns.store(learning == RepetitionLearning::On, Ordering::Relaxed);
    }

    /// Keeps a tick that was flown for later comparisons; the oldest goes.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn keep(&mut self, sample: Sample) {
        self.kept += 1;
        self.shared.samples.leave((self.kept, sample));
    }
}

impl ModelDesk {
    /// The model in force.
    pub fn rig(&self) -> Rig {
        self.models().rig.clone()
    }

    /// The identity of the model in force, where it was put in while the daemon ran.
    pub fn put_in(&self) -> Option<ModelIdentity> {
        self.models().identity.clone()
    }

    /// Reach of the rig by the model in force, and what that says of references.
    pub fn reach(&self) -> Arc<ModelReach> {
        Arc::clone(&self.models().reach)
    }

    fn models(&self) -> MutexGuard<'_, Models> {
        self.models.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Reads a rig file, checks it, compares it, and has the tick put it in while the permit counts. One that foresees
    /// worse is refused, and while the rig is under control also one that cannot be compared yet, unless it was in force
    /// before. Takes seconds; not for the tick nor for the thread that answers other operators.
    ///
    /// # Errors
    /// Why not, one line; nothing has changed then.
    pub fn change(&self, file: &Path, safety: Safety, permit: &Permit) -> Result<ModelInForce, String> {
        let name = file.display();
        let loaded = load_within_limits(&file.to_string_lossy(), None, safety).map_err(|e| e.to_string())?;
        let unfit = |problem: RigError| format!("{name}: rig {}: {problem}", loaded.name);
        // What is recorded is what is taken, to the last bit.
        let toml = loaded.to_toml().map_err(unfit)?;
        let rig = Rig::from_toml(&toml).map_err(unfit)?;
        let mut samples = self.samples.lock().unwrap_or_else(PoisonError::into_inner);
        let old = self.rig();
        if Sensing::of(&rig).map_err(unfit)? != Sensing::of(&old).map_err(unfit)? {
            return Err(format!(
                "{name}: its sensors have other ranges than those in force; restart the daemon with rig.file"
            ));
        }
        self.collect(&mut samples, SAMPLES);
        let followed = samples.back().map_or(0, |(number, _)| *number);
        let run = newest(&samples, followed);
        let figures = compare(&old, &rig, &run).map_err(unfit)?;
        // What was in force before has been flown, and whoever put another one in its place may find that it controls better.
        let is_back = self.models().before.as_ref() == Some(&rig);
        if let Some(reason) = figures.as_ref().and_then(|f| f.refusal()).filter(|_| !is_back) {
            return Err(format!("{name}: {reason}"));
        }
        let compared = if figures.is_some() || is_back { Compared::Yes } else { Compared::No };
        let change = ModelChange::new(&rig, &run, self.shared.learning(), compared).map_err(unfit)?;
        let map = Arc::clone(&change.map);
        permit.redeem().map_err(|late| format!("{name}: {late}"))?;
        if self.hand_over(change)? == HandOver::Refused {
            // Under control one that is far off would vent the rig.
            return Err(format!("{name}: {}, or put it in while disarmed", too_little(&run)));
        }
        let new = rig.name.clone();
        let identity = Some(ModelIdentity::of(&rig, &file.to_string_lossy()));
        let reach = Arc::new(ModelReach::of(map));
        *self.models() = Models { rig, reach, identity, before: Some(old) };
        let again = if is_back { " again" } else { "" };
        let line = told(&new, again, figures.as_ref());
        Ok(ModelInForce { line, toml, followed })
    }

    /// Takes samples off the tick's queue; no more than `most` are kept.
    fn collect(&self, samples: &mut VecDeque<Numbered>, most: usize) {
        samples.extend(std::iter::from_fn(|| self.shared.samples.take()));
        let surplus = samples.len().saturating_sub(most);
        samples.drain(..surplus);
    }

    /// For replays: keeps the samples of the ticks so far.
    pub fn follow_replay(&self) {
        let mut samples = self.samples.lock().unwrap_or_else(PoisonError::into_inner);
        self.collect(&mut samples, REPLAYED);
    }

    /// Number of samples that were taken off the tick's queue.
    #[cfg(test)]
    pub(crate) fn samples_taken(&self) -> usize {
        self.samples.lock().unwrap_or_else(PoisonError::into_inner).len()
    }

    /// For replays: has the next tick put in a model that had run along with so many samples.
    ///
    /// # Errors
    /// The rig cannot be flown.
    pub fn repeat(&self, rig: &Rig, followed: u64) -> Result<(), RigError> {
        let samples = self.samples.lock().unwrap_or_else(PoisonError::into_inner);
        let change = ModelChange::new(rig, &newest(&samples, followed), self.shared.learning(), Compared::Yes)?;
        while self.shared.retired.pop().is_some() {}
        // There is room: each that was put in before was taken in the tick that it was put in for.
        let _ = self.shared.next.put(Box::new(change));
        Ok(())
    }

    /// Waits until the tick has put it in or refused it; takes it back if it does neither.
    fn hand_over(&self, change: ModelChange) -> Result<HandOver, String> {
        while self.shared.retired.pop().is_some() {}
        if self.shared.next.put(Box::new(change)).is_err() {
            return Err("another model is on its way; try again".to_owned());
        }
        if let Some(outcome) = self.returned_within(PATIENCE) {
            return Ok(outcome);
        }
        match self.shared.next.take_back() {
            Some(_) => Err("no tick took it; is the cRIO there?".to_owned()),
            // Taken in the last moment.
            None => Ok(self.returned_within(IN_TICK).unwrap_or(HandOver::PutIn)),
        }
    }

    /// Outcome of the model that was handed to the tick, once it comes back.
    fn returned_within(&self, time: Duration) -> Option<HandOver> {
        let until = Instant::now() + time;
        loop {
            let is_last = Instant::now() >= until;
            match self.shared.retired.pop() {
                Some(Returned::Exchanged(change)) => {
                    drop(change);
                    return Some(HandOver::PutIn);
                }
                Some(Returned::Refused(change)) => {
                    drop(change);
                    return Some(HandOver::Refused);
                }
                None if is_last => return None,
                None => std::thread::sleep(LOOK),
            }
        }
    }
}

/// Answer to whoever asked for a model that has come into force.
fn told(model: &str, again: &str, figures: Option<&ModelFigures>) -> String {
    let Some(f) = figures else {
        return format!("model {model} is in force{again}; too little was run to compare it with the one before");
    };
    if f.rested() {
        return format!(
            "model {model} is in force{again}; the pressures hardly moved, so that only a model that is far off would have shown"
        );
    }
    let ([pos, neg], [before_pos, before_neg]) = (f.after_kpa[1], f.before_kpa[1]);
    format!(
        "model {model} is in force{again}; five ticks ahead it errs by {pos:.3}/{neg:.3} kPa on the last {:.0} s, the one before by {before_pos:.3}/{before_neg:.3}; it errs less in {}/{} seconds, more in {}/{}",
        f.ticks as f64 * 0.02,
        f.better_s[0],
        f.better_s[1],
        f.worse_s[0],
        f.worse_s[1]
    )
}

/// Reason why a model cannot be compared on a run that is too short, and what to do.
fn too_little(run: &[Sample]) -> String {
    format!(
        "too little was run to compare it with the model in force: keep the rig armed for {} s more",
        seconds_lacking(run)
    )
}

/// The samples that a change compares and runs along with, of those up to a number.
fn newest(samples: &VecDeque<Numbered>, followed: u64) -> Vec<Sample> {
    let end = samples.partition_point(|(number, _)| *number <= followed);
    samples.range(end.saturating_sub(COMPARED)..end).map(|(_, sample)| *sample).collect()
}

/// The monitor's models, having run along with the newest samples.
fn monitor_models(rig: &Rig, run: &[Sample]) -> Result<MonitorModels, RigError> {
    let mut models = MonitorModels::new(rig)?;
    for sample in run.iter().skip(run.len().saturating_sub(FOLLOWED)) {
        models.follow(sample.measured_kpa, sample.duty, sample.pump_on);
    }
    Ok(models)
}

#[cfg(test)]
mod tests;
