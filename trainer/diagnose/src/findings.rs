//! What a diagnosis found, as the files are written from it.

use crate::bench::{Bench, Explanation};
use crate::candidate::Candidate;
use crate::event::Event;
use crate::experiment::Plan;
use crate::figures::Figures;
use crate::heard::Heard;
use crate::judge::Judgement;
use crate::locate::Missing;
use crate::search::Found;
use crate::unknown::UnknownTerm;

/// Everything that the files are written from.
pub(crate) struct Findings<'a, 'r> {
    pub(crate) bench: &'a Bench<'r>,
    pub(crate) candidates: &'a [Candidate],
    pub(crate) found: &'a Found,
    pub(crate) judgement: &'a Judgement,
    pub(crate) missing: &'a Missing,
    pub(crate) given: Figures,
    pub(crate) reidentified: Figures,
    pub(crate) extended: Figures,
    pub(crate) unknown: Option<&'a UnknownTerm>,
    pub(crate) plan: Option<Plan>,
    /// What was read off the pump's ripple and has a name.
    pub(crate) heard: Option<&'a Heard>,
    /// What happened in a span that everything else leaves out.
    pub(crate) event: Option<Event>,
    pub(crate) notes: Vec<String>,
}

impl Findings<'_, '_> {
    /// The explanation that the extended rig is made from.
    pub(crate) fn extended_by(&self) -> &Explanation {
        self.unknown.map_or(&self.found.best, |term| &term.explanation)
    }
}
