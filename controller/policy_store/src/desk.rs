//! What operators ask of policies: list, swap, rollback. Called from the socket's threads.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use handover::{Candidate, Haste, Permit, PolicyTag, Snapshot};
use model::rig::Rig;
use policy::{Policy, PolicySignature};

use crate::audit::Audit;
use crate::board::Board;
use crate::entry::{Entry, EntryState};
use crate::orders::Orders;

/// The name that stands for no policy at all.
pub const FALLBACK: &str = "fallback";

/// A handle to the policies of a running daemon; cheap to clone.
#[derive(Clone)]
pub struct PolicyDesk {
    pub(crate) board: Arc<Mutex<Board>>,
    pub(crate) audit: Arc<Mutex<Audit>>,
    pub(crate) orders: Orders,
    pub(crate) signatures: Arc<[PolicySignature]>,
    /// A model that was put in force and that nothing was tried on yet.
    pub(crate) new_model: Arc<Mutex<Option<Rig>>>,
}

/// A lock that a panic elsewhere does not take away.
pub(crate) fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl PolicyDesk {
    /// All policies, by name, and what flies as of the newest tick.
    pub fn list(&self) -> (Vec<Entry>, Snapshot) {
        let board = locked(&self.board);
        (board.entries().cloned().collect(), board.snapshot())
    }

    /// Name and SHA-256 of what flies; `fallback` and nothing where no policy does.
    pub fn active(&self) -> (String, String) {
        let board = locked(&self.board);
        let tag = board.snapshot().incumbent;
        let sha256 = board.entries().find(|entry| entry.tag() == Some(tag)).map(|entry| entry.sha256.clone());
        (board.active_name(), sha256.unwrap_or_default())
    }

    /// Why the fallback controls in place of a policy, one line.
    pub fn why_fallback(&self) -> Option<String> {
        locked(&self.board).why_fallback()
    }

    /// Another model is in force: policies are examined on it from now on, and what controls is held against the fallback there.
    pub fn model_changed(&self, model: Rig) {
        *locked(&self.new_model) = Some(model);
    }

    /// What is wrong with the directory, if anything.
    pub fn problem(&self) -> Option<String> {
        let board = locked(&self.board);
        board.problem.clone().or_else(|| board.audit_problem.clone())
    }

    /// Sends a policy that has passed its stages on to the rig, or back to it, while the permit counts; `who` asked.
    ///
    /// # Errors
    /// Why not, one line.
    pub fn swap(&self, name: &str, who: &str, permit: &Permit) -> Result<String, String> {
        let text = self.send(name, who, permit)?;
        // Whoever names what is to control has decided, whatever the trial on the model says.
        locked(&self.board).set_aside(None);
        Ok(text)
    }

    /// Answers that no policy has a name, with those that there are; `None` where one has it.
    pub fn unknown(&self, name: &str) -> Option<String> {
        let board = locked(&self.board);
        (name != FALLBACK && board.entry(name).is_none()).then(|| no_such(&board, name))
    }

    /// Sends a policy or the fallback on to the rig.
    pub(crate) fn send(&self, name: &str, who: &str, permit: &Permit) -> Result<String, String> {
        let (sha256, haste, bytes) = self.ready(name)?;
        let candidate = match &bytes {
            None => Candidate::fallback(),
            Some(bytes) => {
                // Read again rather than kept: the tick owns the one that flies.
                let policy = Policy::from_bytes(name.to_owned(), bytes, &self.signatures);
                Candidate::new(policy.map_err(|fault| format!("{name}: {fault}"))?)
            }
        };
        permit.redeem().map_err(|late| format!("{name}: {late}"))?;
        self.orders.send(candidate, haste, bytes.map(|bytes| (sha256.clone(), bytes)))?;
        self.note(who, "swap", name, &sha256);
        Ok(match haste {
            Haste::Straight => format!("{name} takes over within half a second, and is on probation for 10 s"),
            Haste::Proving => {
                format!(
                    "{name} is in shadow; once armed it comes to full authority step by step (`controller policies`)"
                )
            }
        })
    }

    /// Goes back: from a candidate to what flies, or from what flies to what flew before; `who` asked.
    ///
    /// # Errors
    /// Why not, one line.
    pub fn rollback(&self, who: &str) -> Result<String, String> {
        let (candidate, previous) = {
            let board = locked(&self.board);
            (board.snapshot().candidate.map(|tag| board.name_of(tag)), board.previous_name())
        };
        let (name, text) = match (candidate, previous) {
            (Some(name), _) => (name.clone(), format!("{name} is withdrawn")),
            (None, Some(name)) => (name.clone(), format!("back to {name}")),
            (None, None) => return Err("nothing flew before; swap to a policy or to fallback by name".to_owned()),
        };
        self.orders.roll_back()?;
        locked(&self.board).set_aside(None);
        self.note(who, "rollback", &name, "");
        Ok(text)
    }

    /// Whether a name may go to the tick, and what is needed for it.
    fn ready(&self, name: &str) -> Result<(String, Haste, Option<Arc<[u8]>>), String> {
        let board = locked(&self.board);
        if name == FALLBACK {
            return if board.snapshot().incumbent == PolicyTag::FALLBACK {
                Err("the fallback controls already".to_owned())
            } else {
                Ok((String::new(), Haste::Straight, None))
            };
        }
        let Some(entry) = board.entry(name) else {
            return Err(no_such(&board, name));
        };
        let known = entry.tag().and_then(|tag| Some((tag, board.bytes(tag)?)));
        match (entry.state, known) {
            (EntryState::Active, _) => Err(format!("{name} controls already")),
            (
                EntryState::Shadow
                | EntryState::Ramp
                | EntryState::Recheck
                | EntryState::Retrial
                | EntryState::Probation,
                _,
            ) => Err(format!("{name} is on its way already ({})", entry.state.name())),
            (EntryState::Checking, _) => Err(format!("{name} is still being checked; ask again in some seconds")),
            (EntryState::Refused, _) => Err(match &entry.refusal {
                Some(refusal) => format!("{name} was refused, {refusal}"),
                None => format!("{name} was refused"),
            }),
            (EntryState::Passed | EntryState::Previous | EntryState::Gone, Some((tag, bytes))) => {
                let haste = if board.is_proven(tag) { Haste::Straight } else { Haste::Proving };
                Ok((entry.sha256.clone(), haste, Some(bytes)))
            }
            (_, None) => Err(format!("{name} is no longer held; publish it again")),
        }
    }

    fn note(&self, who: &str, what: &str, name: &str, sha256: &str) {
        let noted = locked(&self.audit).note(who, what, name, sha256, "");
        locked(&self.board).audit_problem = noted.err();
    }
}

/// Says that no policy has a name, with those that there are.
fn no_such(board: &Board, name: &str) -> String {
    let known: Vec<&str> = board.entries().map(|e| e.name.as_str()).collect();
    format!("no policy {name}; there are: {}", [known.as_slice(), &[FALLBACK]].concat().join(", "))
}
