//! The thread that examines what is published and follows what becomes of it in the tick.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use admission::{Admitted, Examiner, Refusal, Stage, Tally};
use handover::{PolicyTag, StoreEnd};
use policy::{Links, PolicySignature};
use proto::atomic_file;

use crate::audit::Audit;
use crate::board::{Board, Change};
use crate::desk::{PolicyDesk, locked};
use crate::entry::Entry;
use crate::watch::{Settled, Watcher};

/// How often the tick's events are looked at.
const ROUND: Duration = Duration::from_millis(100);
/// How often the directory is read.
const READING: Duration = Duration::from_secs(1);
/// A file that ends too early and was written within so many seconds is still being copied.
const COPYING_S: i64 = 15;
/// Who asks where nobody does.
const FOLLOWS: &str = "policy.follow";
const STORE: &str = "daemon";

/// What becomes of a policy that has passed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Adoption {
    /// It waits for an operator.
    #[default]
    Manual,
    /// The newest goes on to the rig by itself.
    Newest,
}

/// What a store works with.
pub struct StoreSettings {
    /// The watched directory.
    pub directory: PathBuf,
    /// Whether the newest is adopted.
    pub adoption: Adoption,
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
    /// Its flights of the trial, where it was examined.
    pub tallies: Option<Vec<Tally>>,
}

/// The running store.
pub struct PolicyStore {
    desk: PolicyDesk,
    thread: JoinHandle<()>,
}

/// Makes the examiner, in the store's own thread: it flies the fallback through the trial, which takes a second or two.
pub type MakeExaminer = Box<dyn FnOnce() -> Result<Examiner, String> + Send>;

impl PolicyStore {
    /// Starts the thread; it ends once `stop` is set. `say` is told one line for everything that a person should know.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub fn start(
        settings: StoreSettings,
        active: Option<ActivePolicy>,
        end: StoreEnd,
        examiner: MakeExaminer,
        stop: Arc<AtomicBool>,
        say: Box<dyn FnMut(String) + Send>,
    ) -> std::io::Result<Self> {
        let mut board = Board::default();
        let mut unflown = None;
        if let Some(active) = active {
            let sha256 = policy::hash(&active.bytes).to_string();
            let entry = Entry { sha256, ..Entry::checking(&active.name) };
            let tag = entry.tag();
            match (active.tallies, tag) {
                (Some(tallies), Some(tag)) => board.flown(tag, tallies),
                _ => unflown = Some(Arc::clone(&active.bytes)),
            }
            board.begin(entry, Some(active.bytes));
        }
        let desk = PolicyDesk {
            board: Arc::new(Mutex::new(board)),
            audit: Arc::new(Mutex::new(Audit::open(settings.audit.clone()))),
            end,
            signatures: settings.signatures.clone().into(),
        };
        let mut round = Round { desk: desk.clone(), settings, say, problem: None };
        let thread = std::thread::Builder::new()
            .name("policies".to_owned())
            .spawn(move || round.run(examiner, unflown, &stop))?;
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
    settings: StoreSettings,
    say: Box<dyn FnMut(String) + Send>,
    problem: Option<String>,
}

/// A file on its way through the stages, and what came out.
struct Job {
    settled: Settled,
    incumbent: Option<Vec<Tally>>,
}
struct Outcome {
    settled: Settled,
    outcome: Result<(Admitted, Arc<[u8]>), Refusal>,
}

impl Round {
    fn run(&mut self, examiner: MakeExaminer, unflown: Option<Arc<[u8]>>, stop: &Arc<AtomicBool>) {
        let (jobs, todo) = channel::<Job>();
        let (done, outcomes) = channel::<Outcome>();
        let board = Arc::clone(&self.desk.board);
        let worker = std::thread::Builder::new().name("examiner".to_owned()).spawn({
            let stop = Arc::clone(stop);
            move || examine_all(examiner, unflown, &board, &todo, &done, &stop)
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
                self.examined(outcome, &mut watcher);
            }
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
            let incumbent = {
                let mut board = locked(&self.desk.board);
                let same = board.entry(&settled.name).is_some_and(|entry| {
                    // What flies is read once more under its name, and must not be shown as being checked.
                    entry.state == crate::EntryState::Active
                        && std::fs::symlink_metadata(&settled.path).is_ok_and(|about| about.is_file())
                        && policy::read(&settled.path, Links::Refuse)
                            .is_ok_and(|bytes| policy::hash(&bytes).to_string() == entry.sha256)
                });
                if same {
                    continue;
                }
                board.checking(&settled.name);
                board.incumbent_tallies().cloned()
            };
            if jobs.send(Job { settled, incumbent }).is_err() {
                self.trouble("policies are not examined any more; restart the daemon".to_owned());
            }
        }
        if let Some(problem) = reading.problem {
            self.trouble(problem);
        }
    }

    fn examined(&mut self, outcome: Outcome, watcher: &mut Watcher) {
        let Outcome { settled, outcome } = outcome;
        match outcome {
            Ok((admitted, bytes)) => {
                let change = locked(&self.desk.board).passed(&settled.name, admitted, bytes);
                self.changed(&change, STORE);
                let _ = std::fs::remove_file(refused_file(&settled.path));
                if self.settings.adoption == Adoption::Newest
                    && let Err(problem) = self.desk.swap(&settled.name, FOLLOWS)
                {
                    (self.say)(format!("policy {}: not adopted: {problem}", settled.name));
                }
            }
            Err(refusal) if still_copied(&settled, &refusal) => watcher.again(&settled.name),
            Err(refusal) => {
                let change = locked(&self.desk.board).refused(&settled.name, refusal);
                self.changed(&change, STORE);
            }
        }
    }

    /// Takes in what the tick says.
    fn follow_tick(&mut self) {
        self.desk.end.sweep();
        while let Some(event) = self.desk.end.event() {
            let change = locked(&self.desk.board).happened(event);
            if let Some(change) = change {
                self.changed(&change, "tick");
            }
        }
        if let Some(snapshot) = self.desk.end.snapshot() {
            locked(&self.desk.board).show(snapshot);
        }
    }

    /// Audits a change, says it, and leaves a refusal beside the file.
    fn changed(&mut self, change: &Change, who: &str) {
        let detail = change.refusal.as_ref().map_or_else(String::new, Refusal::to_string);
        let noted = locked(&self.desk.audit).note(who, change.what, &change.name, &change.sha256, &detail);
        if let Err(problem) = noted {
            self.trouble(problem);
        }
        match &change.refusal {
            None => (self.say)(format!("policy {}: {}", change.name, change.what)),
            Some(refusal) => {
                (self.say)(format!("policy {}: refused, {refusal}", change.name));
                let file = refused_file(&self.settings.directory.join(format!("{}.onnx", change.name)));
                let written = serde_json::to_vec_pretty(refusal)
                    .map_err(|error| error.to_string())
                    .and_then(|text| atomic_file::write(&file, &text).map_err(|error| error.to_string()));
                if let Err(problem) = written {
                    self.trouble(format!(
                        "{}: the reason of a refusal cannot be left there: {problem}",
                        file.display()
                    ));
                }
            }
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

/// The file beside a policy that says why it was refused.
pub fn refused_file(policy: &Path) -> PathBuf {
    let mut name = policy.as_os_str().to_owned();
    name.push(".refused.json");
    PathBuf::from(name)
}

/// Whether a file ends too early and was written just now: somebody copies it without a rename.
fn still_copied(settled: &Settled, refusal: &Refusal) -> bool {
    let now_s = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |t| t.as_secs() as i64);
    let young = (0..COPYING_S).contains(&(now_s - settled.look.written_s()));
    let short = refusal.reason.contains("is cut short") || refusal.reason.contains("is empty");
    young && short && refusal.stage <= Stage::Network
}

fn examine_all(
    examiner: MakeExaminer,
    unflown: Option<Arc<[u8]>>,
    board: &Mutex<Board>,
    todo: &Receiver<Job>,
    done: &Sender<Outcome>,
    stop: &AtomicBool,
) {
    let examiner = match examiner() {
        Ok(examiner) => examiner,
        Err(problem) => {
            locked(board).problem = Some(format!("policies cannot be examined: {problem}"));
            return;
        }
    };
    if let Some(bytes) = unflown
        && let Ok(admitted) = examiner.examine_bytes(String::new(), &bytes, examiner.fallback())
    {
        let tag = PolicyTag::of(&admitted.policy);
        locked(board).flown(tag, admitted.tallies);
    }
    while let Ok(Job { settled, incumbent }) = todo.recv() {
        if stop.load(Ordering::Relaxed) {
            return;
        }
        let incumbent = incumbent.as_deref().unwrap_or(examiner.fallback());
        let outcome = examiner.examine_file(&settled.path, Links::Refuse, incumbent);
        if done.send(Outcome { settled, outcome }).is_err() {
            return;
        }
    }
}
