//! Following the tick: its events and snapshots are taken in, and acted on; no file is touched here.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use admission::Refusal;
use handover::{Permit, StoreEnd};

use crate::board::Board;
use crate::chronicle::Chronicle;
use crate::desk::{FALLBACK, PolicyDesk};
use crate::entry::Entry;
use crate::examination::{Job, StandsAgainst};
use crate::locked;
use crate::store::WhenBehind;

/// Time between two looks at the tick's events where nobody asks.
pub(crate) const ROUND: Duration = Duration::from_millis(100);
/// Name of who asks where a policy is behind the fallback.
const STANDING: &str = "policy.when_behind";
/// Said where the examining thread has ended.
pub(crate) const NOT_EXAMINED: &str = "policies are not examined any more; restart the daemon";

/// A refusal in flight, of which the reason is to be left beside the policy's file.
pub(crate) type Reason = (String, Refusal);

/// Takes in what the tick says; also called by those who ask, so that they are answered by what is.
pub(crate) struct Follower {
    board: Arc<Mutex<Board>>,
    /// The end at which the tick says what has happened.
    end: StoreEnd,
    chronicle: Chronicle,
    reasons: Sender<Reason>,
}

impl Follower {
    pub(crate) fn new(board: Arc<Mutex<Board>>, end: StoreEnd, chronicle: Chronicle, reasons: Sender<Reason>) -> Self {
        Follower { board, end, chronicle, reasons }
    }

    /// Takes in all that the tick has said since.
    pub(crate) fn follow(&mut self) {
        self.end.sweep();
        let mut changes = Vec::new();
        {
            // At once: nobody sees what flies in the middle of it.
            let mut board = locked(&self.board);
            while let Some(told) = self.end.event() {
                changes.extend(board.happened(&told));
            }
            if let Some(snapshot) = self.end.snapshot() {
                board.show(snapshot);
            }
        }
        for change in changes {
            if let Some(refusal) = &change.refusal {
                // Where the folder's thread has ended, so has the daemon.
                let _ = self.reasons.send((change.name.clone(), refusal.clone()));
            }
            self.chronicle.changed(&change, "tick");
        }
    }
}

/// State of the thread that goes round.
pub(crate) struct Rounds {
    pub(crate) desk: PolicyDesk,
    pub(crate) when_behind: WhenBehind,
    pub(crate) jobs: Sender<Job>,
    pub(crate) standings: Receiver<StandsAgainst>,
    pub(crate) show: Box<dyn FnMut(String) + Send>,
    /// Policies as they were shown last.
    pub(crate) shown: String,
    /// State of the audit file at the last look.
    pub(crate) audited: Audited,
}

/// State of the audit file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Audited {
    Sound,
    InTrouble,
}

impl Rounds {
    /// Goes round until `stop` is set.
    pub(crate) fn run(mut self, stop: &AtomicBool) {
        while !stop.load(Ordering::Relaxed) {
            self.desk.follow();
            for standing in self.standings.try_iter().collect::<Vec<_>>() {
                self.stands(&standing);
            }
            let model = locked(&self.desk.new_model).take();
            if let Some(model) = model
                && self.jobs.send(Job::Model(Box::new(model))).is_err()
            {
                self.desk.chronicle.trouble(&self.desk.board, NOT_EXAMINED.to_owned());
            }
            self.watch_audit();
            self.show_all();
            std::thread::sleep(ROUND);
        }
        self.desk.follow();
    }

    /// Tells once that the audit file cannot be written, and that it can again.
    fn watch_audit(&mut self) {
        let chronicle = &self.desk.chronicle;
        match (chronicle.audit().problem(), self.audited) {
            (Some(problem), Audited::Sound) => {
                chronicle.say(problem);
                self.audited = Audited::InTrouble;
            }
            (None, Audited::InTrouble) => {
                chronicle.say("the audit file can be written again".to_owned());
                self.audited = Audited::Sound;
            }
            _ => {}
        }
    }

    /// Takes note that what controls, or was set aside, has been held against the fallback on the model in force.
    fn stands(&self, StandsAgainst { tag, standing, model }: &StandsAgainst) {
        let (tag, standing) = (*tag, *standing);
        let (name, flies, aside, free) = {
            let mut board = locked(&self.desk.board);
            board.stands(tag, standing);
            let expected = board.expected();
            (board.name_of(tag), expected.incumbent == tag, board.is_set_aside(tag), expected.candidate.is_none())
        };
        let found = format!("policy {name} on model {model}: {standing}");
        if !standing.is_behind() {
            if aside {
                locked(&self.desk.board).set_aside(None);
                self.follow_standing(&name, format!("{found} for the fallback; it controls again"));
            }
            return;
        }
        match self.when_behind {
            WhenBehind::Fly => {
                let how = "it controls all the same (policy.when_behind)";
                self.desk.chronicle.say(format!("{found} for the fallback; {how}"));
            }
            WhenBehind::Fallback if flies && free => {
                locked(&self.desk.board).set_aside(Some(tag));
                let how =
                    format!("the fallback controls in its place, `controller swap {name}` has it control all the same");
                self.follow_standing(FALLBACK, format!("{found} for the fallback; {how}"));
            }
            WhenBehind::Fallback if flies => {
                let how = "nothing changes while another policy is on its way";
                self.desk.chronicle.say(format!("{found} for the fallback; {how}"));
            }
            // It is set aside already, or something else has come to control since.
            WhenBehind::Fallback => {}
        }
    }

    /// Sends on what controls by its standing.
    fn follow_standing(&self, name: &str, why: String) {
        let chronicle = &self.desk.chronicle;
        match self.desk.send(name, STANDING, &Permit::unlimited()) {
            Ok(_) => chronicle.say(why),
            Err(problem) => chronicle.say(format!("{why}: not done: {problem}")),
        }
    }

    /// Shows all policies where something about them has changed.
    fn show_all(&mut self) {
        let shown: Vec<_> = locked(&self.desk.board).list().iter().map(shown).collect();
        let json = serde_json::Value::from(shown).to_string();
        if json != self.shown {
            self.shown.clone_from(&json);
            (self.show)(json);
        }
    }
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
