//! The store of policies: its settings and its threads.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::channel;
use std::thread::JoinHandle;

use handover::StoreEnd;
use policy::PolicySignature;

use crate::audit::Audit;
use crate::board::Board;
use crate::chronicle::Chronicle;
use crate::desk::PolicyDesk;
use crate::entry::Entry;
use crate::examination::{Answers, Examination, examine_all};
use crate::folder::Folder;
use crate::following::{Audited, Rounds};
use crate::orders::KeepOrder;

/// Treatment of a policy that has passed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Adoption {
    /// It waits for an operator.
    #[default]
    Manual,
    /// The newest goes on to the rig by itself.
    Newest,
}

/// Treatment of a policy that tracks clearly worse than the fallback on the model in force.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum WhenBehind {
    /// The fallback takes over from it.
    #[default]
    Fallback,
    /// It goes on; that it is behind is told.
    Fly,
}

/// Settings of a store.
pub struct StoreSettings {
    /// The watched directory.
    pub directory: PathBuf,
    /// Treatment of a policy that has passed.
    pub adoption: Adoption,
    /// Treatment of a policy that is behind the fallback.
    pub when_behind: WhenBehind,
    /// The file that says who did what.
    pub audit: PathBuf,
    /// The layouts that policies are read for.
    pub signatures: Vec<PolicySignature>,
}

/// Policy that flies from the start.
pub struct ActivePolicy {
    /// Name.
    pub name: String,
    /// Bytes of its file.
    pub bytes: Arc<[u8]>,
}

/// The running store.
pub struct PolicyStore {
    desk: PolicyDesk,
    thread: JoinHandle<()>,
}

/// Place where the store speaks.
pub struct Voices {
    /// Is told one line for everything that a person should know.
    pub say: Box<dyn FnMut(String) + Send>,
    /// Is given all policies as JSON whenever something about them changes.
    pub show: Box<dyn FnMut(String) + Send>,
    /// Is given each order to the tick, so that a recording can be replayed.
    pub keep: KeepOrder,
}

impl PolicyStore {
    /// Starts the threads; they end once `stop` is set. No file is touched here: one that does not answer holds up no start.
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
        let StoreSettings { directory, adoption, when_behind, audit, signatures } = settings;
        let mut board = Board::default();
        if let Some(ActivePolicy { name, bytes }) = active {
            let sha256 = policy::hash(&bytes).to_string();
            board.begin(Entry { sha256, ..Entry::checking(&name) }, Some(bytes));
        }
        let Voices { say, show, keep } = voices;
        let chronicle = Chronicle::new(Audit::start(audit)?, say);
        let (reason, reasons) = channel();
        let (jobs, todo) = channel();
        let (files, outcomes) = channel();
        let (standing, standings) = channel();
        let desk = PolicyDesk::new(board, end, chronicle, reason, keep, signatures.into());

        let answers = Answers { files, standings: standing };
        let (board, stopped) = (Arc::clone(&desk.board), Arc::clone(&stop));
        thread("examiner", move || examine_all(examination, &board, &todo, &answers, &stopped))?;

        let folder =
            Folder { desk: desk.clone(), directory, adoption, jobs: jobs.clone(), outcomes, reasons, problem: None };
        let stopped = Arc::clone(&stop);
        thread("policies", move || folder.run(&stopped))?;

        let rounds = Rounds {
            desk: desk.clone(),
            when_behind,
            jobs,
            standings,
            show,
            shown: String::new(),
            audited: Audited::Sound,
        };
        let thread = thread("rounds", move || rounds.run(&stop))?;
        Ok(PolicyStore { desk, thread })
    }

    /// The handle for operators.
    pub fn desk(&self) -> PolicyDesk {
        self.desk.clone()
    }

    /// Tells whether the thread that follows the tick has ended; it does within moments of `stop`.
    pub fn is_finished(&self) -> bool {
        self.thread.is_finished()
    }
}

fn thread(name: &str, work: impl FnOnce() + Send + 'static) -> std::io::Result<JoinHandle<()>> {
    std::thread::Builder::new().name(name.to_owned()).spawn(work)
}
