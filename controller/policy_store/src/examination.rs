//! The thread that examines: files on their way to the rig, and what controls on each model that is put in force.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender};
use std::sync::{Arc, Mutex};

use admission::{Admitted, Examiner, Refusal, Standing, Tally};
use handover::PolicyTag;
use model::rig::Rig;
use policy::Links;

use crate::board::Board;
use crate::locked;
use crate::watch::{Look, Settled};

/// Makes the examiner for a model, in the store's own thread: it flies the fallback through the trial, which takes a second
/// or two.
pub type MakeExaminer = Box<dyn Fn(&Rig) -> Result<Examiner, String> + Send>;

/// The way in which policies are examined, and the model at first.
pub struct Examination {
    /// The model in force at the start.
    pub model: Rig,
    /// Makes the examiner for this model, and for each that is put in force after it.
    pub examiner: MakeExaminer,
}

/// A job for the examining thread.
pub(crate) enum Job {
    /// A file on its way through the stages.
    File(Settled),
    /// Another model is in force.
    Model(Box<Rig>),
}

/// Outcome of a file's examination.
pub(crate) enum Outcome {
    /// It has been through the stages.
    File { settled: Settled, outcome: Box<Result<(Admitted, Arc<[u8]>), Refusal>> },
    /// It was changed or taken away before or while it was examined: whatever was found is of another one.
    Changed(Settled),
}

/// A policy that controls has been held against the fallback on the model of this name.
pub(crate) struct StandsAgainst {
    pub(crate) tag: PolicyTag,
    pub(crate) standing: Standing,
    pub(crate) model: String,
}

/// Ways of the examining thread's answers: those on files may wait for the folder's thread, those on what controls may not.
pub(crate) struct Answers {
    pub(crate) files: Sender<Outcome>,
    pub(crate) standings: Sender<StandsAgainst>,
}

/// Examines what it is given until nobody gives or takes any more.
pub(crate) fn examine_all(
    examination: Examination,
    board: &Mutex<Board>,
    todo: &Receiver<Job>,
    answers: &Answers,
    stop: &AtomicBool,
) {
    let Examination { mut model, examiner: make } = examination;
    let mut examiner = match make(&model) {
        Ok(examiner) => examiner,
        Err(problem) => {
            locked(board).problem = Some(format!("policies cannot be examined: {problem}"));
            return;
        }
    };
    if !hold_against_fallback(&examiner, &model.name, board, answers) {
        return;
    }
    let mut waiting = VecDeque::new();
    while let Some(job) = next_job(todo, &mut waiting) {
        if stop.load(Ordering::Relaxed) {
            return;
        }
        let told = match job {
            Job::File(settled) => {
                if Look::at(&settled.path) != Some(settled.look) {
                    answers.files.send(Outcome::Changed(settled)).is_ok()
                } else {
                    let incumbent = flights_of_incumbent(&examiner, board);
                    let outcome = Box::new(examiner.examine_file(&settled.path, Links::Refuse, &incumbent));
                    if let Ok((admitted, _)) = &*outcome {
                        // From this thread, which alone knows which model they were flown around.
                        locked(board).flown(PolicyTag::of(&admitted.policy), admitted.tallies.clone());
                    }
                    let same = Look::at(&settled.path) == Some(settled.look);
                    let found = if same { Outcome::File { settled, outcome } } else { Outcome::Changed(settled) };
                    answers.files.send(found).is_ok()
                }
            }
            Job::Model(new) => match make(&new) {
                Ok(on_new) => {
                    (examiner, model) = (on_new, *new);
                    locked(board).forget_flights();
                    hold_against_fallback(&examiner, &model.name, board, answers)
                }
                Err(problem) => {
                    let why = format!("policies are still examined on model {}: {problem}", model.name);
                    locked(board).problem = Some(why);
                    true
                }
            },
        };
        if !told {
            return;
        }
    }
}

/// The next job; another model comes before all files that wait, for what controls is held against the fallback on it.
fn next_job(todo: &Receiver<Job>, waiting: &mut VecDeque<Job>) -> Option<Job> {
    if waiting.is_empty() {
        waiting.push_back(todo.recv().ok()?);
    }
    waiting.extend(todo.try_iter());
    let model = waiting.iter().position(|job| matches!(job, Job::Model(_)));
    waiting.remove(model.unwrap_or(0))
}

/// The trial's flights of what controls now, around the model in force: where it was put there since that model was, they are flown
/// here.
fn flights_of_incumbent(examiner: &Examiner, board: &Mutex<Board>) -> Vec<Tally> {
    let (tag, known, bytes) = locked(board).incumbent_flights();
    if let Some(known) = known {
        return known;
    }
    let Some((_, tallies)) = bytes.and_then(|bytes| examiner.stand(&bytes)) else {
        return examiner.fallback().to_vec();
    };
    locked(board).flown(tag, tallies.clone());
    tallies
}

/// Flies what controls through the trial on the model in force; `false` where nobody takes the outcome any more.
fn hold_against_fallback(examiner: &Examiner, model: &str, board: &Mutex<Board>, answers: &Answers) -> bool {
    let held = locked(board).to_be_held();
    let Some((tag, bytes)) = held else { return true };
    let Some((standing, tallies)) = examiner.stand(&bytes) else { return true };
    locked(board).flown(tag, tallies);
    answers.standings.send(StandsAgainst { tag, standing, model: model.to_owned() }).is_ok()
}
