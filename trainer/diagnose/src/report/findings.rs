//! Findings of a diagnosis, from which its files are written.

use fit::wording::{percent, three_digits};
use model::rig::Rig;
use proto::diagnosis::{ChangeInTime, DoubtfulParameter, RigKind, Unexplained};
use proto::recording::{Recording, short_name};

use crate::bench::Bench;
use crate::event::Event;
use crate::event::other_rig::OtherRig;
use crate::experiment::Plan;
use crate::judge::extrapolated::Extrapolated;
use crate::judge::{Judgement, LESS, furthest_kpa};
use crate::locate::Missing;
use crate::pump::ripple::Heard;
use crate::report::figures::Figures;
use crate::report::unexplained::TIMES_NOISE;
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

/// A channel that fitted parameters explain better than those of the file do, on validation data.
pub(crate) struct BetterFitted<'a> {
    /// Column.
    pub(crate) channel: &'a str,
    /// Root mean square error with the rig as given, in kPa.
    pub(crate) given_kpa: f64,
    /// Error with parameters fitted.
    pub(crate) fitted_kpa: f64,
    /// Furthest from the open air that it comes to, in kPa.
    pub(crate) reach_kpa: f64,
}

impl BetterFitted<'_> {
    /// Share of what the pressure comes to by which the error is less.
    pub(crate) fn share(&self) -> f64 {
        (self.given_kpa - self.fitted_kpa) / self.reach_kpa.max(1e-9)
    }

    /// In words: `off by 0.010 kPa instead of 0.088 kPa in p_kpa (less by 0.7 % of the 10.8 kPa that it comes to)`.
    pub(crate) fn in_words(&self) -> String {
        let BetterFitted { channel, given_kpa, fitted_kpa, reach_kpa } = self;
        format!(
            "off by {fitted_kpa:.3} kPa instead of {given_kpa:.3} kPa in {channel} (less by {} of the {} kPa that it comes to)",
            percent(self.share(), 1),
            three_digits(*reach_kpa)
        )
    }
}

impl Findings<'_, '_> {
    /// The name under which a recording is shown, which no other one has.
    pub(crate) fn shown_as(&self, source: &str) -> String {
        short_name(source, self.request.recordings.iter().map(Recording::source))
    }

    /// Channels in which the headline tells of an unexplained residual of the rig as given that fitted parameters leave much less of;
    /// none where they err more on validation data, all channels together.
    pub(crate) fn better_fitted(&self) -> Vec<BetterFitted<'_>> {
        if self.kind != RigKind::AsGiven || self.reidentified.total_rmse_kpa() >= self.given.total_rmse_kpa() {
            return Vec::new();
        }
        let reach_kpa = furthest_kpa(self.bench);
        let channels = self.unexplained.iter().zip(&reach_kpa).zip(self.given.free.iter().zip(&self.reidentified.free));
        let told = channels.filter(|((left, _), (given, fitted))| {
            left.times_noise > TIMES_NOISE && given.rmse_kpa > LESS * fitted.rmse_kpa
        });
        told.map(|((left, reach_kpa), (given, fitted))| BetterFitted {
            channel: &left.channel,
            given_kpa: given.rmse_kpa,
            fitted_kpa: fitted.rmse_kpa,
            reach_kpa: *reach_kpa,
        })
        .collect()
    }

    /// Root mean square error on validation data in kPa, before and with what was found.
    pub(crate) fn before_and_after_kpa(&self) -> [f64; 2] {
        [&self.reidentified, &self.extended].map(Figures::total_rmse_kpa)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A channel that fitted parameters set right is told with both errors and against what the pressure comes to.
    #[test]
    fn what_fitted_parameters_set_right_is_told() {
        let told = BetterFitted { channel: "p_kpa", given_kpa: 0.088, fitted_kpa: 0.01, reach_kpa: 10.78 }.in_words();
        let expected =
            "off by 0.010 kPa instead of 0.088 kPa in p_kpa (less by 0.7 % of the 10.8 kPa that it comes to)";
        assert_eq!(told, expected);
    }
}
