//! One case from start to end: diagnose, experiment if undecided, diagnose again, free runs, judgement.

use std::fs;
use std::path::{Path, PathBuf};

use hidden_rig::case::Making;
use hidden_rig::oracle::{self, Oracle};
use hidden_rig::recording::{RecordingError, read_commands, ticks};
use hidden_rig::suite::{HELD_OUT_CLEAN, truth_file};
use hidden_rig::truth::{Class, Role, Truth, TruthError};
use serde::{Deserialize, Serialize};

use crate::diagnosis::{Diagnosis, DiagnosisError, Verdict};
use crate::free_run::{Error, HeldOut, TraceError, error};
use crate::judge::{Name, Outcome, column, name, outcome, row};
use crate::numbers::{Compared, compare};
use crate::trainer::{Took, Trainer, TrainerError};

/// Bounds of what a proposed experiment may do to the rig (kPa gauge), and for how long (s).
const SAFE_KPA: [f64; 2] = [-95.0, 160.0];
const LONGEST_S: f64 = 120.0;

/// An experiment that was proposed and run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Experiment {
    /// Length (s).
    pub seconds: f64,
    /// Lowest and highest pressure that it drove the hidden rig to (kPa gauge), over both chambers.
    pub reached_kpa: [f64; 2],
    /// True where it kept to the interface: at most 120 s, −95 … 160 kPa.
    pub safe: bool,
    /// The answer after it.
    pub answer: String,
    /// Time and memory of the second answer.
    pub took: Took,
}

/// The line of a case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CaseScore {
    /// The case.
    pub case: String,
    /// Purpose of the case.
    pub class: Class,
    /// Raw size of what is concealed (kPa).
    pub level_kpa: f64,
    /// True where the ripple beats.
    pub ripple_beats: bool,
    /// Concealed effects: a row of the confusion table.
    pub concealed: String,
    /// The first answer: a column of it.
    pub first_answer: String,
    /// The last answer.
    pub answer: String,
    /// The first answer beside the truth.
    pub first: Outcome,
    /// The last one.
    pub last: Outcome,
    /// Each name of the last answer beside the truth.
    pub names: Vec<(String, Name)>,
    /// Explanations that the first answer leaves open.
    pub rivals: Vec<String>,
    /// Experiments that were run.
    pub experiments: Vec<Experiment>,
    /// Why there is no answer, or no experiment.
    pub trouble: Option<String>,
    /// Findings that an oracle could make from the recordings.
    pub oracle: Oracle,
    /// True where it could tell the truth from all else.
    pub separable: bool,
    /// Errors of free runs on the held-out recording.
    pub held_out: HeldOut,
    /// Parameters found beside the concealed ones.
    pub numbers: Vec<Compared>,
    /// Time and memory of the first answer.
    pub took: Took,
    /// Time and memory of fitting parameters alone.
    pub refit_took: Option<Took>,
}

/// Effects that change how fast the pump turns.
const MOVES_THE_PUMP: [&str; 2] = ["pump_droop", "pump_speed"];

impl CaseScore {
    /// Tells whether the goals count it as right: at once, or undecided with the truth among the rivals and decided rightly by
    /// the proposed experiment.
    pub fn right(&self) -> bool {
        self.first == Outcome::Right || (self.first == Outcome::Undecided && self.last == Outcome::Right)
    }

    /// Tells whether nothing is concealed in it.
    pub fn is_null(&self) -> bool {
        matches!(self.class, Class::Nothing | Class::ParametersMoved)
    }

    /// Tells whether the pump's ripple keeps no step with the rows, so that no rig file can tell where in it a row of another
    /// recording lies: a motor that slips, or one whose concealed effect is that it turns otherwise.
    pub fn ripple_is_lost(&self) -> bool {
        self.ripple_beats || self.concealed.split(" + ").any(|id| MOVES_THE_PUMP.contains(&id))
    }

    /// Tells whether something was named that is not there, be it beside an answer that leaves the rest undecided or unknown. The name of
    /// a neighbour of what the library lacks does not count.
    pub fn falsely_named(&self) -> bool {
        let beside = self.last != Outcome::Adjacent && self.names.iter().any(|(_, name)| *name == Name::False);
        beside || self.last == Outcome::FalseName || self.first == Outcome::FalseName
    }
}

/// Settings of a scoring.
#[derive(Debug, Clone)]
pub struct Scoring {
    /// The program.
    pub trainer: Trainer,
    /// Folder of the suite.
    pub suite: PathBuf,
    /// Settings by which its cases were made.
    pub making: Making,
    /// Folder for what the program writes.
    pub work: PathBuf,
    /// Experiments that an undecided answer may ask for, one after the other.
    pub experiments: usize,
    /// True where the parameters alone are fitted as well, for the share of the gain.
    pub refit: bool,
}

/// Why a case cannot be scored; what the program under test does wrong is part of its score instead.
#[derive(Debug, thiserror::Error)]
pub enum ScoringError {
    /// The truth cannot be read.
    #[error(transparent)]
    Truth(#[from] TruthError),
    /// A file of ours cannot be written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The program is not there.
    #[error(transparent)]
    Trainer(#[from] TrainerError),
    /// A folder cannot be made.
    #[error("{}: cannot be made: {source}", folder.display())]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
}

/// Trouble of the program under test.
#[derive(Debug, thiserror::Error)]
enum Trouble {
    #[error(transparent)]
    Trainer(#[from] TrainerError),
    #[error(transparent)]
    Diagnosis(#[from] DiagnosisError),
    #[error(transparent)]
    Trace(#[from] TraceError),
    #[error("proposed experiment: {0}")]
    Experiment(#[from] RecordingError),
}

/// Scores a case.
///
/// # Errors
/// The truth cannot be read, a folder cannot be made, or the program cannot be started at all.
pub fn score(case: &str, scoring: &Scoring) -> Result<CaseScore, ScoringError> {
    let truth = Truth::read(&truth_file(&scoring.suite, case))?;
    let work = scoring.work.join(case);
    fs::create_dir_all(&work).map_err(|source| ScoringError::Folder { folder: work.clone(), source })?;
    let oracle = oracle::ask(&truth, &scoring.making);
    let given = truth.recordings.iter().filter(|entry| entry.role == Role::Given);
    let mut recordings: Vec<PathBuf> =
        given.map(|entry| scoring.suite.join("cases").join(case).join(&entry.file)).collect();
    let noise_kpa = truth.recordings.last().map_or([0.0; 2], |entry| entry.noise_kpa);
    let mut line = CaseScore {
        case: case.to_owned(),
        class: truth.class,
        level_kpa: truth.level_kpa,
        ripple_beats: truth.ripple_beats,
        concealed: row(&truth),
        first_answer: "none".to_owned(),
        answer: "none".to_owned(),
        first: Outcome::Failed,
        last: Outcome::Failed,
        names: Vec::new(),
        rivals: Vec::new(),
        experiments: Vec::new(),
        trouble: None,
        separable: oracle.separates(),
        oracle,
        held_out: HeldOut { noise_kpa, floor_kpa: truth.nuisances_together.net_kpa, ..HeldOut::default() },
        numbers: Vec::new(),
        took: Took::default(),
        refit_took: None,
    };
    let free_run = FreeRuns { scoring, work: &work, case };
    line.held_out.nominal_kpa = free_run.of(None, "nominal").ok();
    if scoring.refit {
        let refit = work.join("refit.toml");
        // The recordings as they were at first: what the refit is a peer of.
        line.refit_took = scoring.trainer.identify(&recordings, &refit).ok();
        line.held_out.refit_kpa = free_run.of(Some(&refit), "refit").ok();
    }
    match answers(&mut line, &truth, &mut recordings, &free_run) {
        Ok(()) => {}
        Err(Trouble::Trainer(error @ TrainerError::Start { .. })) => return Err(error.into()),
        Err(trouble) => line.trouble = Some(trouble.to_string()),
    }
    Ok(line)
}

/// Asks, experiments and asks again; enters what is answered.
fn answers(
    line: &mut CaseScore,
    truth: &Truth,
    recordings: &mut Vec<PathBuf>,
    free_run: &FreeRuns<'_>,
) -> Result<(), Trouble> {
    let scoring = free_run.scoring;
    let mut folder = free_run.work.join("answer_1");
    line.took = scoring.trainer.diagnose(recordings, &folder)?;
    let mut diagnosis = Diagnosis::read(&folder)?;
    line.first_answer = column(&diagnosis);
    line.first = outcome(&diagnosis, truth);
    line.rivals = diagnosis.in_the_race();
    enter(line, &diagnosis, truth);
    line.held_out.first_kpa = Some(free_run.of(Some(&folder.join("rig.toml")), "first")?);
    line.held_out.extended_kpa = line.held_out.first_kpa;
    for number in 1..=scoring.experiments {
        let Some(file) = diagnosis.next_experiment.clone().filter(|_| diagnosis.verdict == Verdict::Undecided) else {
            break;
        };
        let recording = free_run.work.join(format!("experiment_{number}.csv"));
        let mut experiment = run_on_hidden_rig(truth, &folder.join(file), &recording)?;
        recordings.push(recording);
        folder = free_run.work.join(format!("answer_{}", number + 1));
        experiment.took = scoring.trainer.diagnose(recordings, &folder)?;
        diagnosis = Diagnosis::read(&folder)?;
        enter(line, &diagnosis, truth);
        experiment.answer = line.answer.clone();
        line.experiments.push(experiment);
        line.held_out.extended_kpa = Some(free_run.of(Some(&folder.join("rig.toml")), "extended")?);
    }
    Ok(())
}

/// Enters an answer as the last one.
fn enter(line: &mut CaseScore, diagnosis: &Diagnosis, truth: &Truth) {
    line.answer = column(diagnosis);
    line.last = outcome(diagnosis, truth);
    line.names = diagnosis
        .mechanisms
        .iter()
        .map(|named| (format!("{}:{}", named.id, named.place), name(named, truth)))
        .collect();
    if diagnosis.verdict != Verdict::MissingPhysics {
        line.numbers.clear();
        return;
    }
    let compared = diagnosis.mechanisms.iter().filter(|named| name(named, truth) == Name::True).filter_map(|named| {
        let planted = truth.truth.iter().find(|planted| planted.effect.kind().name() == named.id)?;
        compare(named, planted, truth)
    });
    line.numbers = compared.collect();
}

fn run_on_hidden_rig(truth: &Truth, commands: &Path, out: &Path) -> Result<Experiment, RecordingError> {
    let commands = read_commands(commands)?;
    let recording = truth.experiment(&commands);
    recording.write(out)?;
    let extremes = recording.extremes_kpa();
    let reached_kpa = [
        extremes.iter().map(|[low, _]| *low).fold(f64::INFINITY, f64::min),
        extremes.iter().map(|[_, high]| *high).fold(f64::NEG_INFINITY, f64::max),
    ];
    let seconds = commands.len() as f64 / ticks(1.0) as f64;
    let safe = seconds <= LONGEST_S && reached_kpa[0] >= SAFE_KPA[0] && reached_kpa[1] <= SAFE_KPA[1];
    Ok(Experiment { seconds, reached_kpa, safe, answer: String::new(), took: Took::default() })
}

/// Free runs on a case's held-out recording.
struct FreeRuns<'a> {
    scoring: &'a Scoring,
    work: &'a Path,
    case: &'a str,
}

impl FreeRuns<'_> {
    fn of(&self, rig: Option<&Path>, name: &str) -> Result<Error, Trouble> {
        let aside = self.scoring.suite.join("truth").join(self.case);
        let simulated = self.work.join(format!("held_out_{name}.csv"));
        self.scoring.trainer.simulate(rig, &aside.join("held_out.csv"), &simulated)?;
        Ok(error(&simulated, &aside.join(HELD_OUT_CLEAN))?)
    }
}
