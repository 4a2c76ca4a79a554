//! What a diagnosis found, as the files are written from it.

use model::rig::Rig;
use proto::diagnosis::{ChangeInTime, DoubtfulParameter, RigKind, Unexplained};
use proto::recording::short_name;

use crate::bench::Bench;
use crate::event::Event;
use crate::experiment::Plan;
use crate::judge::Judgement;
use crate::locate::Missing;
use crate::pump::ripple::Heard;
use crate::report::figures::Figures;
use crate::run::Request;
use crate::search::Found;
use crate::search::candidate::Candidate;
use crate::unknown::UnknownTerm;

/// Everything that the files are written from.
pub(crate) struct Findings<'a, 'r> {
    pub(crate) request: &'a Request,
    pub(crate) bench: &'a Bench<'r>,
    pub(crate) candidates: &'a [Candidate],
    pub(crate) found: &'a Found,
    pub(crate) judgement: &'a Judgement,
    pub(crate) missing: &'a Missing,
    pub(crate) given: Figures,
    pub(crate) reidentified: Figures,
    /// The re-identified rig with what the pump's ripple told, where it told anything.
    pub(crate) fitted: Figures,
    pub(crate) extended: Figures,
    pub(crate) unknown: Option<&'a UnknownTerm>,
    pub(crate) plan: Option<Plan>,
    /// What was read off the pump's ripple and has a name.
    pub(crate) heard: Option<&'a Heard>,
    /// What happened in a span that everything else leaves out.
    pub(crate) event: Option<Event>,
    /// Lasting changes of what the written rig is off by.
    pub(crate) changes: Vec<ChangeInTime>,
    /// What the written rig is off by.
    pub(crate) unexplained: Vec<Unexplained>,
    /// Parameters of it that nobody would believe.
    pub(crate) doubtful: Vec<DoubtfulParameter>,
    /// Parameters of it of which only a side is known, in words.
    pub(crate) sides_alone: Vec<String>,
    /// Whether one of these ends where its range does.
    pub(crate) in_part: bool,
    /// The rig that is written.
    pub(crate) rig: Rig,
    pub(crate) kind: RigKind,
    pub(crate) notes: Vec<String>,
}

impl Findings<'_, '_> {
    /// The name under which a recording is shown, which no other one has.
    pub(crate) fn shown_as(&self, source: &str) -> String {
        short_name(source, self.bench.records.records().iter().map(|r| r.source.as_str()))
    }

    /// Root mean square error on validation data in kPa, before and with what was found.
    pub(crate) fn before_and_after_kpa(&self) -> [f64; 2] {
        [&self.reidentified, &self.extended].map(Figures::total_rmse_kpa)
    }
}
