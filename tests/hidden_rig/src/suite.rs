//! Suites: which cases there are, made side by side and written so that recordings and truths are apart.
//!
//! ```text
//! OUT/cases/case_017/rec_a.csv, rec_b.csv, rec_c.csv     what the diagnosis is given
//! OUT/cases.json                                         names, recordings, the rig file to start from
//! OUT/truth/case_017.json                                what was concealed, and the hidden rig
//! OUT/truth/case_017/rec_a.csv …                         the traces without noise
//! OUT/truth/case_017/held_out.csv, held_out_clean.csv    a recording that only the scorer sees, and without noise
//! ```

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use serde::{Deserialize, Serialize};

use crate::case::{Case, Making, NoUsefulRig, Plan, make};
use crate::effects::{Kind, Place};
use crate::recording::{RecordingError, write_whole};
use crate::rng::{Draws, fnv1a};
use crate::truth::{Class, Role, Truth, TruthError};

/// The held-out recording as perfect electronics would have read it.
pub const HELD_OUT_CLEAN: &str = "held_out_clean.csv";

/// The suites.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Suite {
    /// A few cases, made in seconds.
    Ci,
    /// All of them.
    Full,
}

/// The rig file that every diagnosis starts from.
pub const NOMINAL_RIG: &str = "dual_pressure";
/// Raw sizes of single effects (kPa).
const LEVELS_KPA: [f64; 3] = [0.3, 1.0, 3.0];
/// Nulls as built.
const NULLS: usize = 16;
/// Nulls with parameters moved.
const MOVED: usize = 18;
/// Cases of two and of three effects.
const PAIRS: usize = 18;
const TRIPLES: usize = 6;
/// One case in this many has a motor that slips.
const BEATS_EVERY: usize = 12;

impl Suite {
    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ci => "ci",
            Self::Full => "full",
        }
    }

    /// Settings by which its cases are made.
    pub fn making(self) -> Making {
        match self {
            Self::Ci => Making::QUICK,
            Self::Full => Making::FULL,
        }
    }

    /// Cases, in an order that says nothing.
    pub fn plans(self, seed: u64) -> Vec<Plan> {
        let root = Draws::new(seed);
        let mut drafts = match self {
            Self::Ci => ci_drafts(),
            Self::Full => full_drafts(&mut root.stream("combinations")),
        };
        root.stream("order").shuffle(&mut drafts);
        let number = |(k, draft): (usize, Draft)| Plan {
            name: format!("case_{k:03}"),
            seed: root.stream(&draft.label()).bits(),
            class: draft.class,
            effects: draft.effects,
            level_kpa: draft.level_kpa,
            ripple_beats: draft.ripple_beats,
        };
        drafts.into_iter().enumerate().map(number).collect()
    }
}

/// A case before it has a name.
#[derive(Debug, Clone)]
struct Draft {
    class: Class,
    effects: Vec<(Kind, Place)>,
    level_kpa: f64,
    ripple_beats: bool,
    number: usize,
}

impl Draft {
    fn new(class: Class, effects: Vec<(Kind, Place)>, level_kpa: f64, number: usize) -> Self {
        Self { class, effects, level_kpa, ripple_beats: number % BEATS_EVERY == BEATS_EVERY - 1, number }
    }

    /// Names the stream of its draws: what it is, not where it stands, so that new cases leave the others alone.
    fn label(&self) -> String {
        format!("{:?} {:?} {} {}", self.class, self.effects, self.level_kpa, self.number)
    }
}

fn ci_drafts() -> Vec<Draft> {
    let one = |kind, place, level| Draft::new(Class::Single, vec![(kind, place)], level, 0);
    vec![
        Draft::new(Class::Nothing, Vec::new(), 0.0, 0),
        Draft::new(Class::ParametersMoved, Vec::new(), 0.0, 0),
        one(Kind::ValveHysteresis, Place::Negative, 1.0),
        one(Kind::SensorLag, Place::Positive, 1.0),
        one(Kind::ChamberThermal, Place::Positive, 1.0),
        one(Kind::ChamberLeak, Place::Positive, 3.0),
        Draft::new(
            Class::Pair,
            vec![(Kind::CommandDelay, Place::Both), (Kind::VolumeCompliance, Place::Positive)],
            1.0,
            0,
        ),
        Draft::new(Class::Outside, vec![(Kind::LineResonance, Place::Negative)], 1.0, 0),
    ]
}

fn full_drafts(draws: &mut Draws) -> Vec<Draft> {
    let library: Vec<Kind> = Kind::ALL.iter().copied().filter(|kind| kind.in_library()).collect();
    let outside: Vec<Kind> = Kind::ALL.iter().copied().filter(|kind| !kind.in_library()).collect();
    let mut drafts = Vec::new();
    drafts.extend((0..NULLS).map(|k| Draft::new(Class::Nothing, Vec::new(), 0.0, k)));
    drafts.extend((0..MOVED).map(|k| Draft::new(Class::ParametersMoved, Vec::new(), 0.0, k)));
    // Places take turns, so that every kind is seen in each of its places over the levels.
    for (class, kinds, levels) in
        [(Class::Single, &library, &LEVELS_KPA[..]), (Class::Outside, &outside, &LEVELS_KPA[1..])]
    {
        for (k, kind) in kinds.iter().enumerate() {
            for (l, level_kpa) in levels.iter().enumerate() {
                let place = kind.places()[(k + l) % kind.places().len()];
                drafts.push(Draft::new(class, vec![(*kind, place)], *level_kpa, levels.len() * k + l));
            }
        }
    }
    for (class, cases, size) in [(Class::Pair, PAIRS, 2), (Class::Triple, TRIPLES, 3)] {
        for k in 0..cases {
            let mut kinds = library.clone();
            draws.shuffle(&mut kinds);
            let effects =
                kinds.into_iter().take(size).map(|kind| (kind, kind.places()[draws.index(kind.places().len())]));
            drafts.push(Draft::new(class, effects.collect(), LEVELS_KPA[1 + k % 2], k));
        }
    }
    drafts
}

/// Record of what a suite was made from: `truth/suite.json`, for the scorer alone.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Made {
    /// Name.
    pub suite: String,
    /// Seed, as it was given.
    pub seed: String,
}

impl Made {
    /// Reads it from the suite's folder.
    ///
    /// # Errors
    /// The file cannot be read or is not what `make` writes.
    pub fn read(out: &Path) -> Result<Self, TruthError> {
        let file = out.join("truth").join("suite.json");
        let bytes = std::fs::read(&file).map_err(|source| TruthError::Read { file: file.clone(), source })?;
        serde_json::from_slice(&bytes).map_err(|source| TruthError::Parse { file, source })
    }

    /// Writes it into the suite's folder.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, out: &Path) -> Result<(), TruthError> {
        let file = out.join("truth").join("suite.json");
        let mut text =
            serde_json::to_vec_pretty(self).map_err(|source| TruthError::Parse { file: file.clone(), source })?;
        text.push(b'\n');
        Ok(write_whole(&file, &text)?)
    }

    /// Settings by which its cases were made.
    pub fn making(&self) -> Making {
        if self.suite == Suite::Full.name() { Making::FULL } else { Making::QUICK }
    }
}

/// Error while a suite is made.
#[derive(Debug, thiserror::Error)]
pub enum SuiteError {
    /// A file could not be written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// A truth could not be written.
    #[error(transparent)]
    Truth(#[from] TruthError),
    /// A case has no useful rig.
    #[error(transparent)]
    Rig(#[from] NoUsefulRig),
}

/// An entry of `cases.json`: all that the diagnosis may know.
#[derive(Debug, Serialize)]
struct Entry {
    case: String,
    rig: &'static str,
    recordings: Vec<String>,
}

/// Makes every case on `threads` threads and writes it; `told` hears of each that is done, without its case if it was
/// there already: making goes on where it was cut off.
///
/// # Errors
/// A file cannot be written, or a case has no useful rig; the cases made until then stay.
pub fn make_suite(
    plans: &[Plan],
    making: &Making,
    out: &Path,
    threads: usize,
    told: &(dyn Fn(&Plan, Option<&Case>) + Sync),
) -> Result<(), SuiteError> {
    let entries: Vec<Entry> = plans
        .iter()
        .map(|plan| Entry {
            case: plan.name.clone(),
            rig: NOMINAL_RIG,
            recordings: ["rec_a", "rec_b", "rec_c"].map(|rec| format!("cases/{}/{rec}.csv", plan.name)).to_vec(),
        })
        .collect();
    let file = out.join("cases.json");
    let mut text =
        serde_json::to_vec_pretty(&entries).map_err(|source| TruthError::Parse { file: file.clone(), source })?;
    text.push(b'\n');
    write_whole(&file, &text)?;
    let next = AtomicUsize::new(0);
    let first_error: Mutex<Option<SuiteError>> = Mutex::new(None);
    let failed = || first_error.lock().is_ok_and(|error| error.is_some());
    let work = || {
        while let Some(plan) = plans.get(next.fetch_add(1, Ordering::Relaxed)) {
            if failed() {
                return;
            }
            if is_made(plan, out) {
                told(plan, None);
                continue;
            }
            let made = make(plan, making).map_err(SuiteError::from).and_then(|case| {
                write_case(&case, out)?;
                told(plan, Some(&case));
                Ok(())
            });
            if let (Err(error), Ok(mut first)) = (made, first_error.lock()) {
                first.get_or_insert(error);
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..threads.max(1) {
            scope.spawn(work);
        }
    });
    if let Some(error) = first_error.into_inner().unwrap_or_default() {
        return Err(error);
    }
    Ok(())
}

/// Where the truth of a case is written.
pub fn truth_file(out: &Path, case: &str) -> PathBuf {
    out.join("truth").join(format!("{case}.json"))
}

/// Tells whether a case of the same seed lies there whole: its truth is written last.
fn is_made(plan: &Plan, out: &Path) -> bool {
    Truth::read(&truth_file(out, &plan.name)).is_ok_and(|truth| truth.case == plan.name && truth.seed == plan.seed)
}

fn write_case(case: &Case, out: &Path) -> Result<(), SuiteError> {
    let name = &case.truth.case;
    for (entry, recording) in case.truth.recordings.iter().zip(&case.recordings) {
        let aside = out.join("truth").join(name);
        match entry.role {
            Role::Given => {
                recording.write(&out.join("cases").join(name).join(&entry.file))?;
                recording.write_clean(&aside.join(&entry.file))?;
            }
            Role::HeldOut => {
                recording.write(&aside.join(&entry.file))?;
                recording.write_clean(&aside.join(HELD_OUT_CLEAN))?;
            }
        }
    }
    case.truth.write(&truth_file(out, name))?;
    Ok(())
}

/// Seed of a suite from a text, for seeds that are kept back as a word.
pub fn seed_of(text: &str) -> u64 {
    text.parse().unwrap_or_else(|_| fnv1a(text.as_bytes()))
}
