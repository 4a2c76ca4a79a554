//! All policies that are known, and what the tick says flies.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::Arc;

use admission::{Admitted, Refusal, Stage, Standing, Tally};
use handover::{Loss, PolicyEvent, PolicyTag, Snapshot, StageNow};

use crate::entry::{Entry, EntryState, provenance};

/// Policies whose bytes are kept for a swap; of more the oldest must be read again.
const MOST_KEPT: usize = 64;

/// The board.
#[derive(Default)]
pub struct Board {
    /// By name.
    entries: BTreeMap<String, Entry>,
    /// Bytes of what has passed, by tag, in the order of passing.
    bytes: Vec<(PolicyTag, Arc<[u8]>)>,
    /// Flights of the trial around the model in force, by tag.
    tallies: HashMap<PolicyTag, Vec<Tally>>,
    /// What has been active in this run.
    proven: HashSet<PolicyTag>,
    snapshot: Snapshot,
    /// Events heard from the tick.
    heard: u32,
    /// What is active by the tick's own word, and what was before it.
    active: PolicyTag,
    previous: Option<PolicyTag>,
    /// The policy that the fallback controls in place of, because it tracks worse on the model in force.
    set_aside: Option<PolicyTag>,
    /// What is wrong with directory or files.
    pub problem: Option<String>,
    /// What is wrong with the audit file.
    pub audit_problem: Option<String>,
}

/// What became of a policy, for audit and files.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    /// Its name.
    pub name: String,
    /// Its SHA-256.
    pub sha256: String,
    /// What happened, one word or a few.
    pub what: &'static str,
    /// Why, if it was refused.
    pub refusal: Option<Refusal>,
}

impl Board {
    /// All entries, by name.
    pub fn entries(&self) -> impl Iterator<Item = &Entry> {
        self.entries.values()
    }

    /// The entry of a name.
    pub fn entry(&self, name: &str) -> Option<&Entry> {
        self.entries.get(name)
    }

    /// What flies, as of the newest tick.
    pub fn snapshot(&self) -> Snapshot {
        self.snapshot
    }

    /// The bytes of a policy that has passed.
    pub fn bytes(&self, tag: PolicyTag) -> Option<Arc<[u8]>> {
        self.bytes.iter().find(|(of, _)| *of == tag).map(|(_, bytes)| Arc::clone(bytes))
    }

    /// Whether a policy has been active since the daemon started.
    pub fn is_proven(&self, tag: PolicyTag) -> bool {
        tag == PolicyTag::FALLBACK || self.proven.contains(&tag)
    }

    /// Tag of what flies now, its flights of the trial around the model in force where these are known, and its bytes to fly it by; neither
    /// for the fallback.
    pub fn incumbent_flights(&self) -> (PolicyTag, Option<Vec<Tally>>, Option<Arc<[u8]>>) {
        let tag = self.snapshot.incumbent;
        (tag, self.tallies.get(&tag).cloned(), self.bytes(tag))
    }

    /// The name of what flies, `fallback` where none does.
    pub fn active_name(&self) -> String {
        self.name_of(self.snapshot.incumbent)
    }

    /// The name of a tag.
    pub fn name_of(&self, tag: PolicyTag) -> String {
        if tag == PolicyTag::FALLBACK {
            return "fallback".to_owned();
        }
        let named = self.entries.values().filter(|entry| entry.tag() == Some(tag));
        // A file that was copied has two names; one that is not gone is the better one.
        let named = named.min_by_key(|entry| entry.state == EntryState::Gone);
        named.map_or_else(|| format!("{:016x}", tag.0), |entry| entry.name.clone())
    }

    /// The name of what was active before what is.
    pub fn previous_name(&self) -> Option<String> {
        self.previous.map(|tag| self.name_of(tag))
    }

    /// The policy that flies from the start.
    pub fn begin(&mut self, mut entry: Entry, bytes: Option<Arc<[u8]>>) {
        entry.state = EntryState::Active;
        if let Some(tag) = entry.tag() {
            self.proven.insert(tag);
            self.snapshot.incumbent = tag;
            self.active = tag;
            self.keep(tag, bytes);
        }
        self.entries.insert(entry.name.clone(), entry);
    }

    /// A file has appeared or changed. What flies under its name goes on flying under a name with its hash.
    pub fn checking(&mut self, name: &str) {
        let before = self.entries.insert(name.to_owned(), Entry::checking(name));
        let Some(mut before) = before else { return };
        if !matches!(before.state, EntryState::Checking | EntryState::Refused | EntryState::Passed | EntryState::Gone) {
            before.name = format!("{name}@{:.8}", before.sha256);
            self.entries.insert(before.name.clone(), before);
        }
    }

    /// A file is gone; what flies goes on flying.
    pub fn gone(&mut self, name: &str) {
        let Some(entry) = self.entries.get_mut(name) else { return };
        match entry.state {
            EntryState::Checking | EntryState::Refused | EntryState::Passed | EntryState::Gone => {
                self.entries.remove(name);
            }
            _ => {}
        }
    }

    /// A policy has passed all stages before the rig.
    pub fn passed(&mut self, name: &str, admitted: Admitted, bytes: Arc<[u8]>) -> Change {
        let sha256 = admitted.policy.hash().to_string();
        let tag = PolicyTag::of(&admitted.policy);
        let state = if self.snapshot.incumbent == tag { EntryState::Active } else { EntryState::Passed };
        let entry = Entry {
            state,
            sha256: sha256.clone(),
            figures: Some(admitted.figures),
            inference_us: Some(admitted.inference_us),
            provenance: provenance(&admitted.policy),
            behind: self.entries.values().find(|entry| entry.tag() == Some(tag)).and_then(|entry| entry.behind),
            ..Entry::checking(name)
        };
        self.entries.insert(name.to_owned(), entry);
        self.keep(tag, Some(bytes));
        Change { name: name.to_owned(), sha256, what: "passed", refusal: None }
    }

    /// A policy has flown the trial around the model in force.
    pub fn flown(&mut self, tag: PolicyTag, tallies: Vec<Tally>) {
        self.tallies.insert(tag, tallies);
    }

    /// How a policy stands against the fallback on the model in force.
    pub fn stands(&mut self, tag: PolicyTag, standing: Standing) {
        for entry in self.entries.values_mut().filter(|entry| entry.tag() == Some(tag)) {
            entry.behind = Some(standing).filter(Standing::is_behind);
        }
    }

    /// Another model is in force: nothing is known of how policies fly around it, nor how they stand on it.
    pub fn forget_flights(&mut self) {
        self.tallies.clear();
        self.entries.values_mut().for_each(|entry| entry.behind = None);
    }

    /// Remembers the policy that the fallback controls in place of; `None` once an operator or another model decides.
    pub fn set_aside(&mut self, tag: Option<PolicyTag>) {
        self.set_aside = tag;
    }

    /// What is to be held against the fallback: what flies, or what was set aside for it.
    pub fn to_be_held(&self) -> Option<(PolicyTag, Arc<[u8]>)> {
        let flies = Some(self.snapshot.incumbent).filter(|tag| *tag != PolicyTag::FALLBACK);
        let tag = self.set_aside.or(flies)?;
        Some((tag, self.bytes(tag)?))
    }

    /// Why the fallback controls in place of a policy, one line.
    pub fn why_fallback(&self) -> Option<String> {
        let tag = self.set_aside?;
        let standing = self.entries.values().find(|entry| entry.tag() == Some(tag))?.behind?;
        Some(format!("{} is behind the fallback on this model: {standing}", self.name_of(tag)))
    }

    /// Whether a policy was set aside for the fallback.
    pub fn is_set_aside(&self, tag: PolicyTag) -> bool {
        self.set_aside == Some(tag)
    }

    /// A policy was refused.
    pub fn refused(&mut self, name: &str, refusal: Refusal) -> Change {
        let entry = self.entries.entry(name.to_owned()).or_insert_with(|| Entry::checking(name));
        entry.state = EntryState::Refused;
        entry.authority_percent = None;
        if let Some(sha256) = &refusal.sha256 {
            entry.sha256.clone_from(sha256);
        }
        entry.figures = refusal.figures.or(entry.figures);
        entry.refusal = Some(refusal.clone());
        Change { name: name.to_owned(), sha256: entry.sha256.clone(), what: "refused", refusal: Some(refusal) }
    }

    /// What the tick shows; what it showed before an event that is known already says nothing any more.
    pub fn show(&mut self, snapshot: Snapshot) {
        if (snapshot.told.wrapping_sub(self.heard) as i32) < 0 {
            return;
        }
        self.snapshot = snapshot;
        if let Some(candidate) = snapshot.candidate {
            let percent = 100.0 * snapshot.authority;
            let state = EntryState::of_stage(StageNow::of_code(snapshot.stage));
            // A snapshot may be older than the event that ended the way.
            let entries = self.entries.values_mut().filter(|e| e.tag() == Some(candidate));
            for entry in entries.filter(|e| e.state.is_on_its_way()) {
                entry.state = state;
                entry.authority_percent = Some(percent);
            }
        }
    }

    /// What happened in the tick.
    pub fn happened(&mut self, event: PolicyEvent) -> Option<Change> {
        self.heard = self.heard.wrapping_add(1);
        // Until the tick shows what came of it, so that what is asked for now is judged by what is.
        match event {
            PolicyEvent::Taken(tag) => self.snapshot.candidate = Some(tag),
            PolicyEvent::Active(tag) => (self.snapshot.incumbent, self.snapshot.candidate) = (tag, None),
            PolicyEvent::Lost(..) => self.snapshot.candidate = None,
            PolicyEvent::Refused(_) => self.snapshot.incumbent = PolicyTag::FALLBACK,
            PolicyEvent::Passed(..) | PolicyEvent::NothingBefore => {}
        }
        match event {
            PolicyEvent::Taken(tag) => self.changed(tag, EntryState::Shadow, "in shadow"),
            PolicyEvent::Passed(tag, stage) => {
                let stage = StageNow::of_code(stage);
                let what = match stage {
                    StageNow::Shadow => "in shadow",
                    StageNow::Ramp(_) => "next level of the ramp",
                    StageNow::Recheck => "in recheck",
                    StageNow::Retrial => "in retrial: it erred more, and both are measured again",
                    StageNow::Probation => "in probation",
                };
                self.changed(tag, EntryState::of_stage(stage), what)
            }
            PolicyEvent::Active(tag) => {
                for entry in self.entries.values_mut() {
                    entry.state = match entry.state {
                        EntryState::Active => EntryState::Previous,
                        EntryState::Previous => EntryState::Passed,
                        other => other,
                    };
                }
                self.previous = Some(std::mem::replace(&mut self.active, tag));
                self.proven.insert(tag);
                self.changed(tag, EntryState::Active, "active")
            }
            PolicyEvent::Lost(tag, _, Loss::Withdrawn) => {
                let state = if self.is_proven(tag) { EntryState::Previous } else { EntryState::Passed };
                self.changed(tag, state, "withdrawn")
            }
            PolicyEvent::Lost(tag, stage, loss) => {
                let stage = EntryState::of_stage(StageNow::of_code(stage)).stage();
                self.lost(tag, stage, loss.reason())
            }
            PolicyEvent::Refused(tag) => {
                self.active = PolicyTag::FALLBACK;
                let reason = "answered something that is not finite; the fallback took over in that tick";
                self.lost(tag, Stage::Probation, reason)
            }
            PolicyEvent::NothingBefore => None,
        }
    }

    fn changed(&mut self, tag: PolicyTag, state: EntryState, what: &'static str) -> Option<Change> {
        let entry = self.entries.values_mut().find(|entry| entry.tag() == Some(tag))?;
        entry.state = state;
        if matches!(state, EntryState::Active | EntryState::Passed | EntryState::Previous) {
            entry.authority_percent = None;
        }
        Some(Change { name: entry.name.clone(), sha256: entry.sha256.clone(), what, refusal: None })
    }

    fn lost(&mut self, tag: PolicyTag, stage: Stage, reason: &str) -> Option<Change> {
        self.proven.remove(&tag);
        let entry = self.entries.values().find(|entry| entry.tag() == Some(tag))?;
        let (name, sha256, figures) = (entry.name.clone(), entry.sha256.clone(), entry.figures);
        Some(self.refused(&name, Refusal { stage, reason: reason.to_owned(), sha256: Some(sha256), figures }))
    }

    fn keep(&mut self, tag: PolicyTag, bytes: Option<Arc<[u8]>>) {
        let Some(bytes) = bytes else { return };
        self.bytes.retain(|(of, _)| *of != tag);
        self.bytes.push((tag, bytes));
        if self.bytes.len() > MOST_KEPT {
            self.bytes.remove(0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tick shows what flies, and only then tells that something else does from now on; whoever asks in between is told the newer.
    #[test]
    fn what_was_shown_before_an_event_does_not_undo_it() {
        let policy = PolicyTag(7);
        let mut board = Board::default();
        let shown = Snapshot { candidate: Some(policy), told: 1, ..Snapshot::default() };
        board.happened(PolicyEvent::Taken(policy));
        board.show(shown);
        board.happened(PolicyEvent::Active(policy));
        assert_eq!((board.snapshot().incumbent, board.snapshot().candidate), (policy, None));
        board.show(shown);
        assert_eq!((board.snapshot().incumbent, board.snapshot().candidate), (policy, None));
        board.show(Snapshot { incumbent: policy, told: 2, stage_ticks: 9, ..Snapshot::default() });
        assert_eq!((board.snapshot().incumbent, board.snapshot().stage_ticks), (policy, 9));
        // Of events that found no room the tick has told more than was heard.
        board.show(Snapshot { incumbent: PolicyTag::FALLBACK, told: 40, ..Snapshot::default() });
        assert_eq!(board.snapshot().incumbent, PolicyTag::FALLBACK);
    }
}
