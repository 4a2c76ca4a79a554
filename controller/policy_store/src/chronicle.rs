//! The chronicle of policies: the audit record, and lines for a person.

use std::sync::{Arc, Mutex};

use admission::Refusal;

use crate::audit::Audit;
use crate::board::{Board, Change};
use crate::locked;

/// Takes a line for a person; it waits for nothing.
pub(crate) type Say = Box<dyn FnMut(String) + Send>;

/// The chronicle; cheap to clone. Nothing that is told to it waits for a file.
#[derive(Clone)]
pub(crate) struct Chronicle {
    audit: Audit,
    say: Arc<Mutex<Say>>,
}

impl Chronicle {
    pub(crate) fn new(audit: Audit, say: Say) -> Self {
        Chronicle { audit, say: Arc::new(Mutex::new(say)) }
    }

    /// The audit record.
    pub(crate) fn audit(&self) -> &Audit {
        &self.audit
    }

    /// Says a line to a person.
    pub(crate) fn say(&self, line: String) {
        (locked(&self.say))(line);
    }

    /// Audits a change and says it.
    pub(crate) fn changed(&self, change: &Change, who: &str) {
        let detail = change.refusal.as_ref().map_or_else(String::new, Refusal::to_string);
        self.audit.note(who, change.what, &change.name, &change.sha256, &detail);
        self.say(match &change.refusal {
            None => format!("policy {}: {}", change.name, change.what),
            Some(refusal) => format!("policy {}: refused, {refusal}", change.name),
        });
    }

    /// Says a problem once, and keeps it for `policies`.
    pub(crate) fn trouble(&self, board: &Mutex<Board>, problem: String) {
        let is_news = {
            let mut board = locked(board);
            let is_news = board.problem.as_ref() != Some(&problem);
            board.problem = Some(problem.clone());
            is_news
        };
        if is_news {
            self.say(problem);
        }
    }
}
