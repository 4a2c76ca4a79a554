//! Requests of operators for policies: list, swap, rollback.
//!
//! Nothing here touches a file, or takes a lock that is held while a file is waited for. [`PolicyDesk::swap`] and
//! [`PolicyDesk::rollback`] wait for the tick's answer, for a bounded time: not for the thread that serves other operators.

use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use handover::{Candidate, Haste, Loss, Permit, PolicyEvent, PolicyTag, Snapshot, StoreEnd, WayBack};
use model::rig::Rig;
use policy::{Policy, PolicySignature};

use crate::board::Board;
use crate::chronicle::Chronicle;
use crate::entry::{Entry, EntryState};
use crate::following::{Follower, Reason};
use crate::locked;
use crate::orders::{KeepOrder, Order, Orders};

/// The name that stands for no policy at all.
pub const FALLBACK: &str = "fallback";

/// Time in which a tick carries an order out where the rig is under control: twenty ticks.
const ANSWER_TIME: Duration = Duration::from_millis(400);
/// Between two looks whether it has.
const LOOK: Duration = Duration::from_millis(2);

/// A handle to the policies of a running daemon; cheap to clone.
#[derive(Clone)]
pub struct PolicyDesk {
    pub(crate) board: Arc<Mutex<Board>>,
    follower: Arc<Mutex<Follower>>,
    pub(crate) chronicle: Chronicle,
    orders: Orders,
    signatures: Arc<[PolicySignature]>,
    /// A model that was put in force and that nothing was tried on yet.
    pub(crate) new_model: Arc<Mutex<Option<Rig>>>,
}

/// Way of a policy that is to control.
enum Way {
    /// It is sent to the tick; nothing but the name for the fallback.
    Send { haste: Haste, file: Option<(String, Arc<[u8]>)> },
    /// It has all of the command, or is about to: there is nothing to do.
    Already,
}

/// Outcome of sending a policy on.
pub(crate) enum Sent {
    /// The tick was given this order.
    Order { number: u32, haste: Haste },
    /// Nothing: it has all of the command, or is about to.
    Already,
}

impl PolicyDesk {
    pub(crate) fn new(
        board: Board,
        end: StoreEnd,
        chronicle: Chronicle,
        reasons: Sender<Reason>,
        keep: KeepOrder,
        signatures: Arc<[PolicySignature]>,
    ) -> Self {
        let board = Arc::new(Mutex::new(board));
        let follower = Follower::new(Arc::clone(&board), end.clone(), chronicle.clone(), reasons);
        PolicyDesk {
            board,
            follower: Arc::new(Mutex::new(follower)),
            chronicle,
            orders: Orders::new(end, keep),
            signatures,
            new_model: Arc::default(),
        }
    }

    /// Takes in what the tick has said since.
    pub(crate) fn follow(&self) {
        locked(&self.follower).follow();
    }

    /// All policies, by name.
    pub fn list(&self) -> Vec<Entry> {
        self.follow();
        locked(&self.board).list()
    }

    /// State of the loop, as of the newest tick.
    pub fn snapshot(&self) -> Snapshot {
        self.follow();
        locked(&self.board).snapshot()
    }

    /// Name and SHA-256 of what has all of the command; `fallback` and nothing where no policy has.
    pub fn active(&self) -> (String, String) {
        self.follow();
        locked(&self.board).in_command()
    }

    /// Reason why the fallback controls in place of a policy, one line.
    pub fn why_fallback(&self) -> Option<String> {
        locked(&self.board).why_fallback()
    }

    /// Another model is in force: policies are examined on it from now on, and what controls is held against the fallback
    /// there.
    pub fn model_changed(&self, model: Rig) {
        *locked(&self.new_model) = Some(model);
    }

    /// Waits until the audit file says all that was done, or cannot, for so long at most: before the end of a daemon.
    pub fn settle(&self, most: Duration) {
        self.chronicle.audit().settle(most);
    }

    /// Problem of the directory or the audit file, if there is one.
    pub fn problem(&self) -> Option<String> {
        let problem = locked(&self.board).problem.clone();
        let problems: Vec<String> = problem.into_iter().chain(self.chronicle.audit().problem()).collect();
        (!problems.is_empty()).then(|| problems.join("; "))
    }

    /// Sends a policy that has passed its stages on to the rig, or back to it, while the permit counts; `who` asked. What comes
    /// of it in the tick is waited for, for a bounded time.
    ///
    /// # Errors
    /// Why not, one line.
    pub fn swap(&self, name: &str, who: &str, permit: &Permit) -> Result<String, String> {
        let sent = self.send(name, who, permit)?;
        // Whoever names what is to control has decided, whatever the trial on the model says.
        locked(&self.board).set_aside(None);
        // The fallback is the last resort: nothing is held against it.
        let probation = if name == FALLBACK { "" } else { ", and is on probation for 10 s" };
        let Sent::Order { number, haste } = sent else {
            return Ok(format!("{name} takes over already{probation}"));
        };
        Ok(match (self.answer(number), haste) {
            (Some(PolicyEvent::Lost(other, _, Loss::Withdrawn)), _) => {
                format!("{} is withdrawn; {name} controls on", locked(&self.board).name_of(other))
            }
            (Some(PolicyEvent::Active(_)), _) => format!("{name} controls on"),
            (Some(_), Haste::Straight) => format!("{name} takes over within half a second{probation}"),
            (Some(_), Haste::Proving) => {
                format!("{name} is in shadow; it comes to full authority step by step (`controller policies`)")
            }
            (None, Haste::Straight) => format!("{name} takes over once the rig is under control{probation}"),
            (None, Haste::Proving) => format!(
                "{name} begins in shadow once the rig is under control, and comes to full authority step by step (`controller policies`)"
            ),
        })
    }

    /// Answers that no policy has a name, with those that there are; `None` where one has it.
    pub fn unknown(&self, name: &str) -> Option<String> {
        let board = locked(&self.board);
        (name != FALLBACK && board.entry(name).is_none()).then(|| no_such(&board, name))
    }

    /// Sends a policy or the fallback on to the rig; waits for no tick.
    pub(crate) fn send(&self, name: &str, who: &str, permit: &Permit) -> Result<Sent, String> {
        self.follow();
        let ready = ready(&locked(&self.board), name)?;
        let Way::Send { haste, file } = ready else { return Ok(Sent::Already) };
        let candidate = match &file {
            None => Candidate::fallback(),
            Some((_, bytes)) => {
                // Read again rather than kept: the tick owns the one that flies.
                let policy = Policy::from_bytes(name.to_owned(), bytes, &self.signatures);
                Candidate::new(policy.map_err(|fault| format!("{name}: {fault}"))?)
            }
        };
        let (tag, sha256) = (candidate.tag, file.as_ref().map(|(sha256, _)| sha256.clone()).unwrap_or_default());
        let number = self.orders.give(&self.board, |board| {
            // Others may have asked for something while it was read.
            match ready_again(board, name, tag)? {
                Way::Already => Err(format!("{name} is on its way already")),
                Way::Send { .. } => {
                    permit.redeem().map_err(|late| format!("{name}: {late}"))?;
                    board.call(tag, name);
                    Ok(Order::to_try(candidate, haste, file))
                }
            }
        })?;
        self.chronicle.audit().note(who, "swap", name, &sha256, "");
        Ok(Sent::Order { number, haste })
    }

    /// Goes back, while the permit counts: from a candidate to what flies, or from what flies to what flew before; `who`
    /// asked. What comes of it in the tick is waited for, for a bounded time, and is the answer.
    ///
    /// # Errors
    /// Why not, one line.
    pub fn rollback(&self, who: &str, permit: &Permit) -> Result<String, String> {
        self.follow();
        let mut way_back = WayBack::Nowhere;
        let number = self.orders.give(&self.board, |board| {
            way_back = board.expected().way_back();
            if way_back == WayBack::Nowhere {
                return Err(NOWHERE.to_owned());
            }
            permit.redeem().map_err(|late| late.to_string())?;
            Ok(Order::to_go_back())
        })?;
        let answer = self.answer(number);
        let name_of = |tag: PolicyTag| locked(&self.board).name_of(tag);
        let (name, text, detail) = match (answer, way_back) {
            (Some(PolicyEvent::Taken(tag)), _) => (name_of(tag), format!("back to {}", name_of(tag)), ""),
            (Some(PolicyEvent::Lost(tag, ..)), _) => (name_of(tag), format!("{} is withdrawn", name_of(tag)), ""),
            // The tick found nothing: what was on its way has come to its end meanwhile.
            (Some(_), _) | (None, WayBack::Nowhere) => return Err(NOWHERE.to_owned()),
            (None, WayBack::Returns(tag)) => {
                (name_of(tag), format!("back to {} once the rig is under control", name_of(tag)), WAITS)
            }
            (None, WayBack::Withdraws(tag)) => {
                (name_of(tag), format!("{} is withdrawn once the rig is under control", name_of(tag)), WAITS)
            }
        };
        locked(&self.board).set_aside(None);
        self.chronicle.audit().note(who, "rollback", &name, "", detail);
        Ok(text)
    }

    /// Waits for the tick's answer to an order; `None` where no tick has carried it out in time, as while the rig is not under
    /// control.
    fn answer(&self, number: u32) -> Option<PolicyEvent> {
        let until = Instant::now() + ANSWER_TIME;
        loop {
            let is_last = Instant::now() >= until;
            self.follow();
            let answer = locked(&self.board).answer(number);
            if answer.is_some() || is_last {
                return answer;
            }
            std::thread::sleep(LOOK);
        }
    }
}

/// Answered where there is nothing to go back to.
const NOWHERE: &str = "nothing flew before; swap to a policy or to fallback by name";
/// Noted of an order that no tick has carried out yet.
const WAITS: &str = "waits until the rig is under control";

/// Finds the way to the tick of a name, or why it has none.
fn ready(board: &Board, name: &str) -> Result<Way, String> {
    if name == FALLBACK {
        return free(board, name, PolicyTag::FALLBACK, || Ok(Way::Send { haste: Haste::Straight, file: None }));
    }
    let Some(entry) = board.entry(name) else {
        return Err(no_such(board, name));
    };
    match (entry.state, entry.tag()) {
        (EntryState::Checking, _) => Err(format!("{name} is still being checked; ask again in some seconds")),
        (EntryState::Refused, _) => Err(match &entry.refusal {
            Some(refusal) => format!("{name} was refused, {refusal}"),
            None => format!("{name} was refused"),
        }),
        (_, Some(tag)) => free(board, name, tag, || {
            let Some(bytes) = board.bytes(tag) else {
                return Err(format!("{name} is no longer held; publish it again"));
            };
            let haste = if board.is_proven(tag) { Haste::Straight } else { Haste::Proving };
            Ok(Way::Send { haste, file: Some((entry.sha256.clone(), bytes)) })
        }),
        (_, None) => Err(format!("{name} is no longer held; publish it again")),
    }
}

/// Finds it again ([`ready`]) after the file of `tag` was read.
fn ready_again(board: &Board, name: &str, tag: PolicyTag) -> Result<Way, String> {
    let now = if name == FALLBACK { Some(PolicyTag::FALLBACK) } else { board.entry(name).and_then(|e| e.tag()) };
    if now == Some(tag) { ready(board, name) } else { Err(format!("{name} holds something else now; ask again")) }
}

/// Refuses what controls alone or is on its way already; what controls may be asked for while another one is on its way.
fn free(board: &Board, name: &str, tag: PolicyTag, send: impl FnOnce() -> Result<Way, String>) -> Result<Way, String> {
    let expected = board.expected();
    match expected.candidate {
        None if expected.incumbent == tag => Err(format!("{name} controls already")),
        Some(candidate) if candidate == tag => match board.state_of(tag) {
            Some(EntryState::Probation) => Ok(Way::Already),
            Some(state) if state.is_on_its_way() => Err(format!("{name} is on its way already ({})", state.name())),
            _ => Err(format!("{name} is on its way already (it waits until the rig is under control)")),
        },
        _ => send(),
    }
}

/// Says that no policy has a name, with those that there are.
fn no_such(board: &Board, name: &str) -> String {
    let known: Vec<&str> = board.names().chain([FALLBACK]).collect();
    format!("no policy {name}; there are: {}", known.join(", "))
}
