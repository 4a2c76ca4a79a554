//! All policies that are known, by name, and where each stands.
//!
//! Findings of the checks before the rig belong to a name. Where a policy stands on the rig belongs to its content, and is the
//! tick's to say ([`crate::flying`]): all names of the same content stand there alike.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::Arc;

use admission::{Admitted, Refusal, Stage, Standing, Tally};
use handover::{Loss, PolicyEvent, PolicyTag, Snapshot, StageNow, Succession, Told};

use crate::desk::FALLBACK;
use crate::entry::{Entry, EntryState, provenance};
use crate::flying::{Asked, Flying};

/// Policies whose bytes are kept for a swap; of more the oldest must be read again.
const MOST_KEPT: usize = 64;

/// The board.
#[derive(Default)]
pub struct Board {
    /// By name; their states are `checking`, `passed`, `refused` and `gone`.
    entries: BTreeMap<String, Entry>,
    /// Bytes of what has passed, by tag, in the order of passing.
    bytes: Vec<(PolicyTag, Arc<[u8]>)>,
    /// Flights of the trial around the model in force, by tag.
    tallies: HashMap<PolicyTag, Vec<Tally>>,
    /// Policies that have been active in this run.
    proven: HashSet<PolicyTag>,
    /// Policies that have been on the rig in this run, as candidates or active.
    tried: HashSet<PolicyTag>,
    flying: Flying,
    /// Name by which a policy was asked for last: of several files with the same content.
    called: HashMap<PolicyTag, String>,
    /// The policy that the fallback controls in place of, because it tracks worse on the model in force.
    set_aside: Option<PolicyTag>,
    /// Problem with directory or files.
    pub problem: Option<String>,
}

/// Change of a policy, for audit and files.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    /// Name.
    pub name: String,
    /// SHA-256.
    pub sha256: String,
    /// Change, in one word or a few.
    pub what: &'static str,
    /// Reason, if it was refused.
    pub refusal: Option<Refusal>,
}

impl Board {
    /// All policies by name, each with where it stands; the fallback where it has a part on the rig.
    pub fn list(&self) -> Vec<Entry> {
        let fallback = self.flying.state_of(PolicyTag::FALLBACK).map(|state| Entry {
            state,
            authority_percent: self.flying.authority_percent(PolicyTag::FALLBACK),
            ..Entry::checking(FALLBACK)
        });
        let mut all: Vec<Entry> = self.entries.values().map(|entry| self.placed(entry)).chain(fallback).collect();
        all.sort_by(|a, b| a.name.cmp(&b.name));
        all
    }

    /// All names.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.entries.keys().map(String::as_str)
    }

    /// The entry of a name, with where it stands.
    pub fn entry(&self, name: &str) -> Option<Entry> {
        self.entries.get(name).map(|entry| self.placed(entry))
    }

    /// An entry with where it stands on the rig, where it has a part there.
    fn placed(&self, entry: &Entry) -> Entry {
        let tag = entry.tag().filter(|_| entry.state.has_passed());
        let Some((tag, state)) = tag.and_then(|tag| Some((tag, self.flying.state_of(tag)?))) else {
            return entry.clone();
        };
        Entry { state, authority_percent: self.flying.authority_percent(tag), ..entry.clone() }
    }

    /// State of the policies, as of the newest tick.
    pub fn snapshot(&self) -> Snapshot {
        self.flying.snapshot()
    }

    /// State of a policy on the rig; nothing where it has no part there.
    pub fn state_of(&self, tag: PolicyTag) -> Option<EntryState> {
        self.flying.state_of(tag)
    }

    /// The succession as it will be once the orders that wait are carried out.
    pub fn expected(&self) -> Succession {
        self.flying.expected()
    }

    /// An order was given to the tick.
    pub fn given(&mut self, number: u32, asked: Asked) {
        self.flying.given(number, asked);
    }

    /// Answer to an order, once a tick has carried it out.
    pub fn answer(&self, number: u32) -> Option<PolicyEvent> {
        self.flying.answer(number)
    }

    /// The bytes of a policy that has passed.
    pub fn bytes(&self, tag: PolicyTag) -> Option<Arc<[u8]>> {
        self.bytes.iter().find(|(of, _)| *of == tag).map(|(_, bytes)| Arc::clone(bytes))
    }

    /// Tells whether a policy has been active since the daemon started.
    pub fn is_proven(&self, tag: PolicyTag) -> bool {
        tag == PolicyTag::FALLBACK || self.proven.contains(&tag)
    }

    /// Tag of the incumbent, its flights of the trial around the model in force where these are known, and its bytes to fly it by; neither
    /// for the fallback.
    pub fn incumbent_flights(&self) -> (PolicyTag, Option<Vec<Tally>>, Option<Arc<[u8]>>) {
        let tag = self.snapshot().incumbent;
        (tag, self.tallies.get(&tag).cloned(), self.bytes(tag))
    }

    /// Tells whether a policy has been on the rig since the daemon started: what became of it there is known, and whoever took it back
    /// had a reason.
    pub fn was_tried(&self, tag: PolicyTag) -> bool {
        self.tried.contains(&tag)
    }

    /// Name and SHA-256 of what has all of the command; `fallback` and nothing where no policy has.
    pub fn in_command(&self) -> (String, String) {
        let tag = self.snapshot().in_command();
        (self.name_of(tag), self.sha256_of(tag))
    }

    /// The name of a tag: the one by which it was asked for, where that still stands for it.
    pub fn name_of(&self, tag: PolicyTag) -> String {
        if tag == PolicyTag::FALLBACK {
            return FALLBACK.to_owned();
        }
        let called = self.called.get(&tag).and_then(|name| self.entries.get(name));
        let named = called.filter(|entry| entry.tag() == Some(tag)).or_else(|| {
            // One that is not gone is the better one.
            self.of(tag).min_by_key(|entry| entry.state == EntryState::Gone)
        });
        named.map_or_else(|| format!("{:016x}", tag.0), |entry| entry.name.clone())
    }

    /// A policy is asked for by a name.
    pub fn call(&mut self, tag: PolicyTag, name: &str) {
        if tag != PolicyTag::FALLBACK {
            self.called.insert(tag, name.to_owned());
        }
    }

    fn of(&self, tag: PolicyTag) -> impl Iterator<Item = &Entry> {
        self.entries.values().filter(move |entry| entry.tag() == Some(tag))
    }

    fn sha256_of(&self, tag: PolicyTag) -> String {
        self.of(tag).next().map(|entry| entry.sha256.clone()).unwrap_or_default()
    }

    /// The policy that flies from the start.
    pub fn begin(&mut self, mut entry: Entry, bytes: Option<Arc<[u8]>>) {
        entry.state = EntryState::Passed;
        if let Some(tag) = entry.tag() {
            self.proven.insert(tag);
            self.tried.insert(tag);
            self.flying.begin(tag);
            self.keep(tag, bytes);
            self.call(tag, &entry.name);
        }
        self.entries.insert(entry.name.clone(), entry);
    }

    /// A file has appeared or changed. What the rig needs under its name is kept under a name with its hash.
    pub fn checking(&mut self, name: &str) {
        let before = self.entries.insert(name.to_owned(), Entry::checking(name));
        if let Some(before) = before.filter(|before| self.is_only_one_of_what_flies(before)) {
            let kept = format!("{name}@{:.8}", before.sha256);
            self.entries.insert(kept.clone(), Entry { name: kept, state: EntryState::Gone, ..before });
        }
    }

    /// A file is gone; what the rig needs is still known by its name.
    pub fn gone(&mut self, name: &str) {
        if let Some(mut entry) = self.entries.remove(name)
            && self.is_only_one_of_what_flies(&entry)
        {
            entry.state = EntryState::Gone;
            self.entries.insert(entry.name.clone(), entry);
        }
    }

    /// Tells whether the rig has or will have what an entry stands for that was taken off the board, and no other stands for it.
    fn is_only_one_of_what_flies(&self, entry: &Entry) -> bool {
        entry.state.has_passed()
            && entry.tag().is_some_and(|tag| self.flying.needs(tag) && self.of(tag).next().is_none())
    }

    /// SHA-256 of the content that a name stood for when it passed.
    pub fn passed_content(&self, name: &str) -> Option<&str> {
        self.entries.get(name).filter(|entry| entry.state.has_passed()).map(|entry| entry.sha256.as_str())
    }

    /// The file of a name holds what it held when it passed.
    pub fn is_there(&mut self, name: &str) {
        if let Some(entry) = self.entries.get_mut(name).filter(|entry| entry.state == EntryState::Gone) {
            entry.state = EntryState::Passed;
        }
    }

    /// A policy has passed all stages before the rig.
    pub fn passed(&mut self, name: &str, admitted: Admitted, bytes: Arc<[u8]>) -> Change {
        let sha256 = admitted.policy.hash().to_string();
        let tag = PolicyTag::of(&admitted.policy);
        let entry = Entry {
            state: EntryState::Passed,
            sha256: sha256.clone(),
            figures: Some(admitted.figures),
            inference_us: Some(admitted.inference_us),
            provenance: provenance(&admitted.policy),
            behind: self.of(tag).next().and_then(|entry| entry.behind),
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

    /// Takes note of a policy's standing against the fallback on the model in force.
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

    /// Policy that is to be held against the fallback: what flies, or what was set aside for it.
    pub fn to_be_held(&self) -> Option<(PolicyTag, Arc<[u8]>)> {
        let flies = Some(self.snapshot().incumbent).filter(|tag| *tag != PolicyTag::FALLBACK);
        let tag = self.set_aside.or(flies)?;
        Some((tag, self.bytes(tag)?))
    }

    /// Reason why the fallback controls in place of a policy, one line.
    pub fn why_fallback(&self) -> Option<String> {
        let tag = self.set_aside?;
        let standing = self.of(tag).next()?.behind?;
        Some(format!("{} is behind the fallback on this model: {standing}", self.name_of(tag)))
    }

    /// Tells whether a policy was set aside for the fallback.
    pub fn is_set_aside(&self, tag: PolicyTag) -> bool {
        self.set_aside == Some(tag)
    }

    /// A policy was refused.
    pub fn refused(&mut self, name: &str, refusal: Refusal) -> Change {
        let entry = self.entries.entry(name.to_owned()).or_insert_with(|| Entry::checking(name));
        entry.state = EntryState::Refused;
        if let Some(sha256) = &refusal.sha256 {
            entry.sha256.clone_from(sha256);
        }
        entry.figures = refusal.figures.or(entry.figures);
        entry.refusal = Some(refusal.clone());
        Change { name: name.to_owned(), sha256: entry.sha256.clone(), what: "refused", refusal: Some(refusal) }
    }

    /// Takes in a snapshot of the tick.
    pub fn show(&mut self, snapshot: Snapshot) {
        self.flying.show(snapshot);
    }

    /// Takes in the tick's events and gives the changes that follow.
    pub fn happened(&mut self, told: &Told) -> Vec<Change> {
        self.flying.happened(told);
        match told.event {
            PolicyEvent::Taken(PolicyTag::FALLBACK) => self.changed(PolicyTag::FALLBACK, "takes over"),
            PolicyEvent::Taken(tag) => {
                self.tried.insert(tag);
                self.changed(tag, what(StageNow::of_code(told.snapshot.stage)))
            }
            PolicyEvent::Passed(tag, stage) => self.changed(tag, what(StageNow::of_code(stage))),
            PolicyEvent::Active(tag) => {
                self.proven.insert(tag);
                self.changed(tag, "active")
            }
            PolicyEvent::Lost(tag, _, Loss::Withdrawn) => self.changed(tag, "withdrawn"),
            PolicyEvent::Lost(tag, stage, loss) => {
                let stage = EntryState::of_stage(StageNow::of_code(stage)).stage();
                self.lost(tag, stage, loss.reason())
            }
            PolicyEvent::Refused(tag) => {
                let reason = "answered something that is not finite; the fallback took over in that tick";
                self.lost(tag, Stage::Probation, reason)
            }
            PolicyEvent::NothingBefore => Vec::new(),
        }
    }

    fn changed(&self, tag: PolicyTag, what: &'static str) -> Vec<Change> {
        vec![Change { name: self.name_of(tag), sha256: self.sha256_of(tag), what, refusal: None }]
    }

    /// A policy must not fly any more, whatever it is called; the fallback may.
    fn lost(&mut self, tag: PolicyTag, stage: Stage, reason: &str) -> Vec<Change> {
        if tag == PolicyTag::FALLBACK {
            return self.changed(tag, "lost its authority");
        }
        self.proven.remove(&tag);
        let known: Vec<Entry> = self.of(tag).filter(|entry| entry.state.has_passed()).cloned().collect();
        let refuse = |entry: Entry| {
            let Entry { name, sha256, figures, .. } = entry;
            self.refused(&name, Refusal { stage, reason: reason.to_owned(), sha256: Some(sha256), figures })
        };
        known.into_iter().map(refuse).collect()
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

/// Words for a candidate's way into a stage.
fn what(stage: StageNow) -> &'static str {
    match stage {
        StageNow::Shadow => "in shadow",
        StageNow::Ramp(_) => "next level of the ramp",
        StageNow::Recheck => "in recheck",
        StageNow::Retrial => "in retrial: it erred more, and both are measured again",
        StageNow::Probation => "in probation",
    }
}

#[cfg(test)]
mod tests;
