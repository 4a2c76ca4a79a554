//! The thread that reads the directory of policies and follows what becomes of each in the tick.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use admission::{Admitted, Refusal, Stage, Standing};
use handover::{Permit, PolicyTag, StoreEnd};
use policy::{Links, PolicySignature};

use crate::audit::Audit;
use crate::board::{Board, Change};
use crate::desk::{FALLBACK, PolicyDesk, locked};
use crate::entry::{Entry, EntryState};
use crate::examination::{Examination, Job, Outcome, examine_all};
use crate::orders::{KeepOrder, Orders};
use crate::refusal_file;
use crate::watch::{Settled, Watcher};

/// How often the tick's events are looked at.
const ROUND: Duration = Duration::from_millis(100);
/// How often the directory is read.
const READING: Duration = Duration::from_secs(1);
/// A file that ends too early and has not stood still for so long is still being copied.
const COPYING: Duration = Duration::from_secs(15);
/// Who asks where nobody does.
const FOLLOWS: &str = "policy.follow";
const STORE: &str = "daemon";
const STANDING: &str = "policy.when_behind";
/// Said where the examining thread has ended.
const NOT_EXAMINED: &str = "policies are not examined any more; restart the daemon";

/// What becomes of a policy that has passed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Adoption {
    /// It waits for an operator.
    #[default]
    Manual,
    /// The newest goes on to the rig by itself.
    Newest,
}

/// What becomes of a policy that tracks clearly worse than the fallback on the model in force.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum WhenBehind {
    /// The fallback takes over from it.
    #[default]
    Fallback,
    /// It goes on; that it is behind is told.
    Fly,
}

/// What a store works with.
pub struct StoreSettings {
    /// The watched directory.
    pub directory: PathBuf,
    /// Whether the newest is adopted.
    pub adoption: Adoption,
    /// What becomes of a policy that is behind the fallback.
    pub when_behind: WhenBehind,
    /// The file that says who did what.
    pub audit: PathBuf,
    /// The layouts that policies are read for.
    pub signatures: Vec<PolicySignature>,
}

/// What flies from the start.
pub struct ActivePolicy {
    /// Its name.
    pub name: String,
    /// Its file's bytes.
    pub bytes: Arc<[u8]>,
}

/// The running store.
pub struct PolicyStore {
    desk: PolicyDesk,
    thread: JoinHandle<()>,
}

/// Where the store speaks.
pub struct Voices {
    /// Is told one line for everything that a person should know.
    pub say: Box<dyn FnMut(String) + Send>,
    /// Is given all policies as JSON whenever something about them changes.
    pub show: Box<dyn FnMut(String) + Send>,
    /// Is given each order to the tick, so that a recording can be replayed.
    pub keep: KeepOrder,
}

impl PolicyStore {
    /// Starts the thread; it ends once `stop` is set.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub fn start(
        settings: StoreSettings,
        active: Option<ActivePolicy>,
        end: StoreEnd,
        examination: Examination,
        stop: Arc<AtomicBool>,
        voices: Voices,
    ) -> std::io::Result<Self> {
        let mut board = Board::default();
        if let Some(ActivePolicy { name, bytes }) = active {
            let sha256 = policy::hash(&bytes).to_string();
            board.begin(Entry { sha256, ..Entry::checking(&name) }, Some(bytes));
        }
        let Voices { say, show, keep } = voices;
        let desk = PolicyDesk {
            board: Arc::new(Mutex::new(board)),
            audit: Arc::new(Mutex::new(Audit::open(settings.audit.clone()))),
            orders: Orders::new(end.clone(), keep),
            signatures: settings.signatures.clone().into(),
            new_model: Arc::default(),
        };
        let mut round = Round {
            desk: desk.clone(),
            end,
            settings,
            say,
            show,
            shown: String::new(),
            problem: None,
            directory_problem: None,
        };
        let thread =
            std::thread::Builder::new().name("policies".to_owned()).spawn(move || round.run(examination, &stop))?;
        Ok(PolicyStore { desk, thread })
    }

    /// The handle for operators.
    pub fn desk(&self) -> PolicyDesk {
        self.desk.clone()
    }

    /// Whether the thread has ended; it does within an examination of `stop`.
    pub fn is_finished(&self) -> bool {
        self.thread.is_finished()
    }
}

/// What the thread works with.
struct Round {
    desk: PolicyDesk,
    /// Where the tick says what has happened.
    end: StoreEnd,
    settings: StoreSettings,
    say: Box<dyn FnMut(String) + Send>,
    show: Box<dyn FnMut(String) + Send>,
    /// What was shown last.
    shown: String,
    problem: Option<String>,
    /// Problem of the directory, as of its last reading.
    directory_problem: Option<String>,
}

impl Round {
    fn run(&mut self, examination: Examination, stop: &Arc<AtomicBool>) {
        let (jobs, todo) = channel::<Job>();
        let (done, outcomes) = channel::<Outcome>();
        let board = Arc::clone(&self.desk.board);
        let worker = std::thread::Builder::new().name("examiner".to_owned()).spawn({
            let stop = Arc::clone(stop);
            move || examine_all(examination, &board, &todo, &done, &stop)
        });
        if let Err(error) = worker {
            self.trouble(format!("policies cannot be examined: no thread ({error})"));
            return;
        }
        let mut watcher = Watcher::new(self.settings.directory.clone());
        let mut next_reading = Instant::now();
        while !stop.load(Ordering::Relaxed) {
            self.follow_tick();
            for outcome in outcomes.try_iter().collect::<Vec<_>>() {
                match outcome {
                    Outcome::File { settled, outcome } => self.examined(settled, *outcome, &mut watcher),
                    Outcome::Changed(settled) => {
                        locked(&self.desk.board).gone(&settled.name);
                        watcher.again(&settled.name);
                    }
                    Outcome::Standing { tag, standing, model } => self.stands(tag, standing, &model),
                }
            }
            let model = locked(&self.desk.new_model).take();
            if let Some(model) = model
                && jobs.send(Job::Model(Box::new(model))).is_err()
            {
                self.trouble(NOT_EXAMINED.to_owned());
            }
            self.show_all();
            if Instant::now() >= next_reading {
                next_reading = Instant::now() + READING;
                self.read_directory(&mut watcher, &jobs);
            }
            std::thread::sleep(ROUND);
        }
        self.follow_tick();
    }

    fn read_directory(&mut self, watcher: &mut Watcher, jobs: &Sender<Job>) {
        let reading = watcher.read();
        for name in &reading.gone {
            locked(&self.desk.board).gone(name);
        }
        for settled in reading.settled {
            {
                let mut board = locked(&self.desk.board);
                let same = board.entry(&settled.name).is_some_and(|entry| {
                    // What has passed already, flies or has flown is the same where its bytes are, and must not be shown as
                    // being checked: only its permissions or dates have changed.
                    !matches!(entry.state, EntryState::Checking | EntryState::Refused | EntryState::Gone)
                        && std::fs::symlink_metadata(&settled.path).is_ok_and(|about| about.is_file())
                        && policy::read(&settled.path, Links::Refuse)
                            .is_ok_and(|bytes| policy::hash(&bytes).to_string() == entry.sha256)
                });
                if same {
                    continue;
                }
                board.checking(&settled.name);
            }
            if jobs.send(Job::File(settled)).is_err() {
                self.trouble(NOT_EXAMINED.to_owned());
            }
        }
        let folder = self.settings.directory.display().to_string();
        if reading.is_another_folder {
            (self.say)(format!("{folder}: it is another folder than before"));
        }
        let misnamed = reading.misnamed.map(|name| {
            format!("{folder}: \"{name}\" is passed over: a policy's name is up to 128 letters, digits, '.', '_' and '-', and not {FALLBACK}; rename it")
        });
        self.judge_directory(reading.problem.or(misnamed));
        let caught_up = locked(&self.desk.audit).catch_up();
        self.audited(caught_up);
    }

    /// Tells once that the audit file cannot be written, and that it can again.
    fn audited(&mut self, noted: Result<(), String>) {
        let before = std::mem::replace(&mut locked(&self.desk.board).audit_problem, noted.clone().err());
        match (noted, before) {
            (Err(problem), None) => (self.say)(problem),
            (Ok(()), Some(_)) => (self.say)("the audit file can be written again".to_owned()),
            _ => {}
        }
    }

    /// Tells what is wrong with the directory once, and that it is over.
    fn judge_directory(&mut self, problem: Option<String>) {
        let before = std::mem::replace(&mut self.directory_problem, problem.clone());
        match problem {
            Some(problem) => self.trouble(problem),
            None if before.is_some() => {
                self.problem = None;
                let mut board = locked(&self.desk.board);
                if board.problem == before {
                    board.problem = None;
                }
                drop(board);
                (self.say)(format!("{}: all files of policies can be read again", self.settings.directory.display()));
            }
            None => {}
        }
    }

    fn examined(&mut self, settled: Settled, outcome: Result<(Admitted, Arc<[u8]>), Refusal>, watcher: &mut Watcher) {
        match outcome {
            Ok((admitted, bytes)) => {
                refusal_file::take_away(&settled.path);
                let change = locked(&self.desk.board).passed(&settled.name, admitted, bytes);
                self.changed(&change, STORE);
                if self.settings.adoption == Adoption::Newest
                    && let Err(problem) = self.desk.swap(&settled.name, FOLLOWS, &Permit::unlimited())
                {
                    (self.say)(format!("policy {}: not adopted: {problem}", settled.name));
                }
            }
            Err(refusal) if still_copied(&settled, &refusal) => watcher.again(&settled.name),
            Err(refusal) => {
                self.leave_reason(&settled.path, &refusal);
                let change = locked(&self.desk.board).refused(&settled.name, refusal);
                self.changed(&change, STORE);
            }
        }
    }

    /// What controls, or was set aside, has been held against the fallback on the model in force.
    fn stands(&mut self, tag: PolicyTag, standing: Standing, model: &str) {
        let (name, flies, aside, free) = {
            let mut board = locked(&self.desk.board);
            board.stands(tag, standing);
            let snapshot = board.snapshot();
            let free = snapshot.candidate.is_none();
            (board.name_of(tag), snapshot.incumbent == tag, board.is_set_aside(tag), free)
        };
        let found = format!("policy {name} on model {model}: {standing}");
        if !standing.is_behind() {
            if aside {
                locked(&self.desk.board).set_aside(None);
                self.follow_standing(&name, format!("{found} for the fallback; it controls again"));
            }
            return;
        }
        match self.settings.when_behind {
            WhenBehind::Fly => {
                (self.say)(format!("{found} for the fallback; it controls all the same (policy.when_behind)"))
            }
            WhenBehind::Fallback if flies && free => {
                locked(&self.desk.board).set_aside(Some(tag));
                let how =
                    format!("the fallback controls in its place, `controller swap {name}` has it control all the same");
                self.follow_standing(FALLBACK, format!("{found} for the fallback; {how}"));
            }
            WhenBehind::Fallback if flies => {
                (self.say)(format!("{found} for the fallback; nothing changes while another policy is on its way"));
            }
            // It is set aside already, or something else has come to control since.
            WhenBehind::Fallback => {}
        }
    }

    /// Sends on what controls by its standing.
    fn follow_standing(&mut self, name: &str, why: String) {
        match self.desk.send(name, STANDING, &Permit::unlimited()) {
            Ok(_) => (self.say)(why),
            Err(problem) => (self.say)(format!("{why}: not done: {problem}")),
        }
    }

    /// Shows all policies where something about them has changed.
    fn show_all(&mut self) {
        let shown: Vec<_> = locked(&self.desk.board).entries().map(shown).collect();
        let json = serde_json::Value::from(shown).to_string();
        if json != self.shown {
            self.shown.clone_from(&json);
            (self.show)(json);
        }
    }

    /// Takes in what the tick says.
    fn follow_tick(&mut self) {
        self.end.sweep();
        while let Some(event) = self.end.event() {
            let change = locked(&self.desk.board).happened(event);
            if let Some(change) = change {
                if let Some(refusal) = &change.refusal {
                    self.leave_reason(&self.settings.directory.join(format!("{}.onnx", change.name)), refusal);
                }
                self.changed(&change, "tick");
            }
        }
        if let Some(snapshot) = self.end.snapshot() {
            locked(&self.desk.board).show(snapshot);
        }
    }

    /// Audits a change and says it.
    fn changed(&mut self, change: &Change, who: &str) {
        let detail = change.refusal.as_ref().map_or_else(String::new, Refusal::to_string);
        let noted = locked(&self.desk.audit).note(who, change.what, &change.name, &change.sha256, &detail);
        self.audited(noted);
        (self.say)(match &change.refusal {
            None => format!("policy {}: {}", change.name, change.what),
            Some(refusal) => format!("policy {}: refused, {refusal}", change.name),
        });
    }

    fn leave_reason(&mut self, policy: &Path, refusal: &Refusal) {
        if let Err(problem) = refusal_file::leave(policy, refusal) {
            self.trouble(problem);
        }
    }

    /// Tells a problem once, and keeps it for `policies`.
    fn trouble(&mut self, problem: String) {
        if self.problem.as_ref() != Some(&problem) {
            (self.say)(problem.clone());
            self.problem = Some(problem.clone());
        }
        locked(&self.desk.board).problem = Some(problem);
    }
}

/// Whether a file ends too early and was written just now: somebody copies it without a rename.
fn still_copied(settled: &Settled, refusal: &Refusal) -> bool {
    let young = settled.at_rest() < COPYING;
    let short = refusal.reason.contains("is cut short") || refusal.reason.contains("is empty");
    young && short && refusal.stage <= Stage::Network
}

/// A policy as live viewers are shown it.
fn shown(entry: &Entry) -> serde_json::Value {
    let reason = match (&entry.refusal, &entry.behind) {
        (Some(refusal), _) => refusal.to_string(),
        (None, Some(standing)) => format!("behind the fallback on this model: {standing}"),
        (None, None) => String::new(),
    };
    let figures =
        entry.figures.map_or(String::new(), |f| format!("trial: {:.3}/{:.3} kPa", f.rmse_kpa[0], f.rmse_kpa[1]));
    serde_json::json!({
        "name": entry.name,
        "state": entry.state.name(),
        "authority_percent": entry.authority_percent,
        "sha256": entry.sha256,
        "reason": reason,
        "figures": figures,
    })
}
