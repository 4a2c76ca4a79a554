//! The thread that reads the directory of policies, and leaves there why a policy was refused. It alone hangs with a
//! directory that does not answer.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender};
use std::time::{Duration, Instant};

use admission::{Admitted, Refusal, Stage};
use handover::{Permit, PolicyTag};
use policy::Links;

use crate::desk::{FALLBACK, PolicyDesk};
use crate::examination::{Job, Outcome};
use crate::following::{NOT_EXAMINED, ROUND, Reason};
use crate::store::Adoption;
use crate::watch::{ENDING, Settled, Watcher, policy_name};
use crate::{locked, refusal_file};

/// Time between two readings of the directory.
const READING: Duration = Duration::from_secs(1);
/// A file that ends too early and has not stood still for so long is still being copied.
const COPYING: Duration = Duration::from_secs(15);
/// Name of who asks where nobody does.
const FOLLOWS: &str = "policy.follow";
const STORE: &str = "daemon";

/// State of the thread that reads the directory.
pub(crate) struct Folder {
    pub(crate) desk: PolicyDesk,
    pub(crate) directory: PathBuf,
    pub(crate) adoption: Adoption,
    pub(crate) jobs: Sender<Job>,
    pub(crate) outcomes: Receiver<Outcome>,
    pub(crate) reasons: Receiver<Reason>,
    /// Problem of the directory, as of its last reading.
    pub(crate) problem: Option<String>,
}

impl Folder {
    /// Reads the directory until `stop` is set.
    pub(crate) fn run(mut self, stop: &AtomicBool) {
        let mut watcher = Watcher::new(self.directory.clone());
        let mut next_reading = Instant::now();
        while !stop.load(Ordering::Relaxed) {
            for outcome in self.outcomes.try_iter().collect::<Vec<_>>() {
                match outcome {
                    Outcome::File { settled, outcome } => self.examined(&settled, *outcome, &mut watcher),
                    Outcome::Changed(settled) => {
                        locked(&self.desk.board).gone(&settled.name);
                        watcher.again(&settled.name);
                    }
                }
            }
            self.leave_reasons();
            if Instant::now() >= next_reading {
                next_reading = Instant::now() + READING;
                self.read_directory(&mut watcher);
            }
            std::thread::sleep(ROUND);
        }
        self.leave_reasons();
    }

    fn read_directory(&mut self, watcher: &mut Watcher) {
        let reading = watcher.read();
        for name in &reading.gone {
            locked(&self.desk.board).gone(name);
        }
        for settled in reading.settled {
            if self.holds_what_passed(&settled) {
                locked(&self.desk.board).is_there(&settled.name);
                continue;
            }
            locked(&self.desk.board).checking(&settled.name);
            if self.jobs.send(Job::File(settled)).is_err() {
                self.trouble(NOT_EXAMINED.to_owned());
            }
        }
        let folder = self.directory.display().to_string();
        if reading.is_another_folder {
            self.desk.chronicle.say(format!("{folder}: it is another folder than before"));
        }
        let misnamed = reading.misnamed.map(|name| {
            format!("{folder}: \"{name}\" is passed over: a policy's name is up to 128 letters, digits, '.', '_' and '-', and not {FALLBACK}; rename it")
        });
        self.judge_directory(reading.problem.or(misnamed));
    }

    /// Tells whether a file holds what has passed already, flies or has flown: then only its permissions or dates have changed,
    /// and it must not be shown as being checked.
    fn holds_what_passed(&self, settled: &Settled) -> bool {
        // The file is read without the board: others ask for that meanwhile.
        let passed = locked(&self.desk.board).passed_content(&settled.name).map(str::to_owned);
        passed.is_some_and(|sha256| {
            std::fs::symlink_metadata(&settled.path).is_ok_and(|about| about.is_file())
                && policy::read(&settled.path, Links::Refuse)
                    .is_ok_and(|bytes| policy::hash(&bytes).to_string() == sha256)
        })
    }

    /// Tells what is wrong with the directory once, and that it is over.
    fn judge_directory(&mut self, problem: Option<String>) {
        let before = std::mem::replace(&mut self.problem, problem.clone());
        match problem {
            Some(problem) => self.trouble(problem),
            None if before.is_some() => {
                {
                    let mut board = locked(&self.desk.board);
                    if board.problem == before {
                        board.problem = None;
                    }
                }
                let folder = self.directory.display();
                self.desk.chronicle.say(format!("{folder}: all files of policies can be read again"));
            }
            None => {}
        }
    }

    fn examined(&self, settled: &Settled, outcome: Result<(Admitted, Arc<[u8]>), Refusal>, watcher: &mut Watcher) {
        match outcome {
            Ok((admitted, bytes)) => {
                refusal_file::take_away(&settled.path);
                let tag = PolicyTag::of(&admitted.policy);
                let change = locked(&self.desk.board).passed(&settled.name, admitted, bytes);
                self.desk.chronicle.changed(&change, STORE);
                if self.adoption == Adoption::Newest {
                    self.adopt(&settled.name, tag);
                }
            }
            Err(refusal) if still_copied(settled, &refusal) => watcher.again(&settled.name),
            Err(refusal) => {
                self.leave_reason(&settled.path, &refusal);
                let change = locked(&self.desk.board).refused(&settled.name, refusal);
                self.desk.chronicle.changed(&change, STORE);
            }
        }
    }

    /// Sends a policy on to the rig that has not been there yet. A file that is seen anew, as behind a server that was away for a
    /// while, undoes no rollback and brings back nothing that lost its authority.
    fn adopt(&self, name: &str, tag: PolicyTag) {
        self.desk.follow();
        let (was_tried, now) = {
            let board = locked(&self.desk.board);
            (board.was_tried(tag), board.snapshot())
        };
        if now.incumbent == tag || now.candidate == Some(tag) {
            return;
        }
        let sent = if was_tried {
            Err(format!("it was on the rig in this run; `controller swap {name}` sends it there again"))
        } else {
            self.desk.send(name, FOLLOWS, &Permit::unlimited())
        };
        match sent {
            Ok(_) => locked(&self.desk.board).set_aside(None),
            Err(problem) => self.desk.chronicle.say(format!("policy {name}: not adopted: {problem}")),
        }
    }

    /// Leaves why policies have lost their place in flight.
    fn leave_reasons(&self) {
        for (name, refusal) in self.reasons.try_iter() {
            let file = self.directory.join(format!("{name}.{ENDING}"));
            // What flies under a name with its hash has no file any more.
            if policy_name(&file).is_some() {
                self.leave_reason(&file, &refusal);
            }
        }
    }

    fn leave_reason(&self, policy: &Path, refusal: &Refusal) {
        if let Err(problem) = refusal_file::leave(policy, refusal) {
            self.trouble(problem);
        }
    }

    fn trouble(&self, problem: String) {
        self.desk.chronicle.trouble(&self.desk.board, problem);
    }
}

/// Tells whether a file ends too early and was written just now: somebody copies it without a rename.
fn still_copied(settled: &Settled, refusal: &Refusal) -> bool {
    let young = settled.at_rest() < COPYING;
    let short = refusal.reason.contains("is cut short") || refusal.reason.contains("is empty");
    young && short && refusal.stage <= Stage::Network
}
