//! Findings of a diagnosis, from which its files are written.

use model::rig::Rig;
use proto::diagnosis::{ChangeInTime, DoubtfulParameter, RigKind, Unexplained};
use proto::recording::{Recording, short_name};

use crate::bench::Bench;
use crate::event::Event;
use crate::event::other_rig::OtherRig;
use crate::experiment::Plan;
use crate::judge::Judgement;
use crate::judge::extrapolated::Extrapolated;
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
    /// Findings from the pump's ripple that have a name.
    pub(crate) heard: Option<&'a Heard>,
    /// Event in a span that everything else leaves out.
    pub(crate) event: Option<Event>,
    /// Files that were recorded of another rig, which everything else leaves out.
    pub(crate) other_rig: Option<OtherRig>,
    /// Levels of named terms that no recording came down to.
    pub(crate) extrapolated: Vec<Extrapolated>,
    /// Lasting changes of what the written rig is off by.
    pub(crate) changes: Vec<ChangeInTime>,
    /// Unexplained residual of the written rig.
    pub(crate) unexplained: Vec<Unexplained>,
    /// Parameters of it that nobody would believe.
    pub(crate) doubtful: Vec<DoubtfulParameter>,
    /// Parameters of it of which only a side is known, in words.
    pub(crate) sides_alone: Vec<String>,
    /// True where one of these ends where its range does.
    pub(crate) in_part: bool,
    /// The rig that is written.
    pub(crate) rig: Rig,
    pub(crate) kind: RigKind,
    pub(crate) notes: Vec<String>,
}

impl Findings<'_, '_> {
    /// The name under which a recording is shown, which no other one has.
    pub(crate) fn shown_as(&self, source: &str) -> String {
        short_name(source, self.request.recordings.iter().map(Recording::source))
    }

    /// Root mean square error on validation data in kPa, before and with what was found.
    pub(crate) fn before_and_after_kpa(&self) -> [f64; 2] {
        [&self.reidentified, &self.extended].map(Figures::total_rmse_kpa)
    }
}
