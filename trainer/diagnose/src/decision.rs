//! Decision on what a search found: names that hold or do not, a term without a name, the kind of rig, what could hide beside it.

use fit::cores::side_by_side;
use model::rig::Rig;
use proto::diagnosis::{RigKind, Verdict};

use crate::bench::{Bench, Explanation};
use crate::error::DiagnoseError;
use crate::event::Event;
use crate::experiment::can_be_shut_in;
use crate::judge::added_uncertainty::variance_beyond_noise;
use crate::judge::kind_of_rig::kind_of_rig;
use crate::judge::rejected_names::{are_leaks_too_small, objection};
use crate::judge::step_uncertainty::variance_of_steps;
use crate::judge::undetectable;
use crate::judge::undetermined::unname;
use crate::judge::{Judgement, MOVED, judge_without};
use crate::locate::Missing;
use crate::pump::ripple::Heard;
use crate::pump::switched::REACH_KPA;
use crate::report::figures::{Figures, figures};
use crate::run::Request;
use crate::search::Found;
use crate::search::candidate::{Candidate, names_of};
use crate::search::quick_search::settled;
use crate::unknown::{self, Formula, UnknownTerm, fit_unknown};

/// Findings on an answer so far; asked in this order: [`Self::upheld`], [`Self::tell_of_jumps`], [`Self::without_name`],
/// [`Self::kind_of_rig`], [`Self::tell_what_could_hide`], [`Self::hedge`].
pub(crate) struct Decision<'a, 'r> {
    pub(crate) request: &'a Request,
    pub(crate) bench: &'a Bench<'r>,
    /// The bench of what was searched on: the recordings less the pump's strokes.
    pub(crate) searched: &'a Bench<'r>,
    pub(crate) candidates: Vec<Candidate>,
    pub(crate) found: Found,
    pub(crate) missing: Missing,
    pub(crate) judgement: Judgement,
    /// A formula without a name that may explain what is left.
    pub(crate) formula: Option<Formula>,
    pub(crate) event: Option<Event>,
    pub(crate) notes: Vec<String>,
}

/// Figures without and with what is upheld of what was found.
pub(crate) struct Upheld {
    pub(crate) fitted: Figures,
    pub(crate) extended: Figures,
}

/// A term without a name that holds, and the rig's figures with it.
pub(crate) struct Nameless {
    pub(crate) term: UnknownTerm,
    pub(crate) figures: Figures,
}

impl Decision<'_, '_> {
    /// Rounds in which an explanation is settled on the pump's strokes.
    fn passes(&self) -> usize {
        if self.request.quick { 1 } else { 2 }
    }

    fn figures_of(&self, rig: &Rig) -> Result<Figures, DiagnoseError> {
        Ok(figures(self.bench, rig, self.bench.close.fidelity(), !self.request.quick)?)
    }

    /// Settles what was found on the pump's strokes, and takes back names that do not hold there.
    ///
    /// # Errors
    /// A rig cannot be run.
    pub(crate) fn upheld(&mut self) -> Result<Upheld, DiagnoseError> {
        let shown = |explanation: &&Explanation| -> Result<(Explanation, Figures), DiagnoseError> {
            let settled = settled(self.bench, explanation, self.passes())?;
            let figures = self.figures_of(&settled.fitted.rig)?;
            Ok((settled, figures))
        };
        let mut both = vec![&self.found.nominal];
        both.extend(Some(&self.found.best).filter(|best| !best.terms.is_empty()));
        let mut both = side_by_side(&both, shown).into_iter();
        let (nominal, fitted) = both.next().unwrap_or_else(|| shown(&&self.found.nominal))?;
        let (mut best, mut extended) = both.next().unwrap_or_else(|| Ok((nominal.clone(), fitted.clone())))?;
        let (searched, candidates) = (self.searched, &self.candidates);
        if self.judgement.is_of_names() || are_leaks_too_small(searched, candidates, &self.found.best)? {
            if let Some(objection) = objection(searched, candidates, &self.found, [&fitted, &extended])? {
                self.notes.push(objection.note);
                // Where something has no name, what has none is asked as well; of the rest beside an event it is below.
                self.formula = match objection.formula {
                    None if objection.missing && self.event.is_none() => {
                        unknown::formula(searched, &self.found.nominal)
                    }
                    explains => explains,
                };
                if objection.missing {
                    self.judgement = self.judgement.clone().of_no_name();
                } else {
                    let given = searched.free_run(&self.request.rig)?;
                    self.judgement = judge_without(searched, candidates, &self.found, &given)?;
                }
                (best, extended) = (nominal.clone(), fitted.clone());
            } else if self.judgement.verdict == Verdict::MissingPhysics {
                self.notes.extend(beside_what_is_named(candidates, &self.judgement, &best));
            }
        }
        (self.found.nominal, self.found.best) = (nominal, best);
        Ok(Upheld { fitted, extended })
    }

    /// Notes by what a rig with a valve that sticks was judged.
    pub(crate) fn tell_of_jumps(&mut self) {
        if self.found.best.jumps && self.judgement.verdict == Verdict::MissingPhysics {
            self.notes.push(JUDGED_IN_THE_MIDDLE.to_owned());
        }
    }

    /// A term for what has no name, where one is asked for and holds beside the rig with its parameters `fitted` (and with those of the
    /// file's own pump).
    ///
    /// # Errors
    /// A rig cannot be run.
    pub(crate) fn without_name(
        &mut self,
        [fitted, reidentified]: [&Figures; 2],
        progress: &mut dyn FnMut(&str, f64),
    ) -> Result<Option<Nameless>, DiagnoseError> {
        if self.judgement.verdict != Verdict::UnknownMechanism {
            return Ok(None);
        }
        progress("shaping a term for what has no name", 0.0);
        let (searched, nominal) = (self.searched, &self.found.nominal);
        let formula = match self.event {
            // That one was fitted to what happened as well.
            Some(_) => unknown::formula(searched, nominal),
            None => self.formula.take(),
        };
        let most = if self.request.quick { 2 } else { 4 };
        let Some(mut term) = fit_unknown(searched, nominal, &self.missing, most, formula)? else { return Ok(None) };
        term.explanation = settled(self.bench, &term.explanation, self.passes())?;
        let with_it = self.figures_of(&term.explanation.fitted.rig)?;
        // Also against parameters alone, where the pump's speed was taken from its ripple. What has no name has nothing but its figures to
        // speak for it, so it must err less than they do, not just no more but for chance.
        let holds = |before: &Figures| {
            with_it.holds_against(before, &self.bench.sigma_kpa()) && with_it.total_rmse_kpa() < before.total_rmse_kpa()
        };
        if !(holds(fitted) && holds(reidentified)) {
            let before = if holds(fitted) { reidentified } else { fitted };
            self.notes.push(does_not_hold(&term.depends_on, [before, &with_it]));
            return Ok(None);
        }
        if takes_next_to_nothing(fitted, &with_it, &self.bench.sigma_kpa()) {
            self.notes.push(takes_too_little(&term.depends_on, [fitted, &with_it]));
            return Ok(None);
        }
        if let Some(channel) = term.reading {
            self.missing.settle_on_reading(channel);
        }
        Ok(Some(Nameless { term, figures: with_it }))
    }

    /// Kind of the rig that is written.
    pub(crate) fn kind_of_rig(&mut self, unknown: Option<&UnknownTerm>, given_and_extended: [&Figures; 2]) -> RigKind {
        kind_of_rig(self.bench, &self.found, unknown, given_and_extended, &mut self.judgement, &mut self.notes)
    }

    /// Notes what could be there beside an answer without showing; leaks that could stand behind moved parameters are their rivals: the
    /// experiment ends with a shut-in in any case, and tells.
    pub(crate) fn tell_what_could_hide(&mut self) {
        if !can_be_shut_in(self.bench.rig, self.bench.records.inputs()) {
            return;
        }
        let Decision { judgement, candidates, found, searched, notes, .. } = self;
        let base = if judgement.is_of_names() { &found.best } else { &found.nominal };
        if matches!(judgement.verdict, Verdict::Adequate | Verdict::ParametersMoved | Verdict::MissingPhysics) {
            notes.extend(undetectable::in_words(searched, candidates, base));
        }
        if let Some(group) = judgement.groups.iter_mut().find(|group| group.iter().any(|name| name == MOVED)) {
            let hide = undetectable::leaks_behind(searched, candidates, base);
            group.extend(hide.into_iter().filter(|name| !group.contains(name)).collect::<Vec<_>>());
        }
    }

    /// Widens the uncertainty of what is named by what the readings' noise does not say, and takes names back whose numbers may then as
    /// well be nothing. `heard` is what the pump's ripple told.
    pub(crate) fn hedge(&mut self, heard: Option<&Heard>) {
        if self.judgement.verdict != Verdict::MissingPhysics {
            return;
        }
        let Decision { searched, candidates, found, judgement, notes, .. } = self;
        let beyond_noise = variance_beyond_noise(searched, candidates, &found.best);
        found.best.fitted.widen(&beyond_noise);
        let of_steps = variance_of_steps(searched, candidates, &found.best);
        found.best.fitted.widen(&of_steps);
        let untold = unname(searched, candidates, &found.best, heard.is_some(), judgement);
        notes.extend(may_be_nothing(candidates, &untold));
    }
}

const JUDGED_IN_THE_MIDDLE: &str = "where a valve sticks, one jump that comes late throws the open-loop simulation off until the next: what \
                                    is left was judged by the middle one of all stretches of 2 s";

/// Note on terms that are in the rig and have no name.
fn beside_what_is_named(candidates: &[Candidate], judgement: &Judgement, best: &Explanation) -> Option<String> {
    let contested = |term: &&usize| judgement.contested.iter().all(|contest| contest.term != **term);
    let beside: Vec<usize> = best.terms.iter().filter(contested).copied().collect();
    (!beside.is_empty()).then(|| {
        format!(
            "{} is in the rig file as well: it shows while the pump stands, and moves no pressure by {REACH_KPA} kPa elsewhere",
            names_of(candidates, &beside)
        )
    })
}

/// Note on terms that lost their name since their number may as well be nothing.
fn may_be_nothing(candidates: &[Candidate], untold: &[usize]) -> Option<String> {
    (!untold.is_empty()).then(|| {
        format!(
            "{} is in the rig file as well, since it fits better with it, and has no name: its number may as well be nothing, by what is \
             too small for a name in any rig",
            names_of(candidates, untold)
        )
    })
}

/// Share of the mean squared error beyond the noise, channels together, that a term without a name must take away on validation data:
/// below that it is not what is missing, and a rig file is no better for it.
const WORTH_A_TERM: f64 = 0.05;

/// Tells whether what is missing is all there with a term as without.
fn takes_next_to_nothing(fitted: &Figures, with_it: &Figures, sigma_kpa: &[f64]) -> bool {
    let [before, after] =
        [fitted, with_it].map(|figures| figures.beyond_noise_kpa(sigma_kpa).iter().map(|kpa| kpa * kpa).sum::<f64>());
    after > (1.0 - WORTH_A_TERM) * before
}

/// Note on a term without a name that leaves what is missing.
fn takes_too_little(depends_on: &str, [fitted, with_it]: [&Figures; 2]) -> String {
    format!(
        "{depends_on} was tried and is not what is missing: with it {:.2} kPa of {:.2} are left on validation data, so it is not in \
         the rig file",
        with_it.total_rmse_kpa(),
        fitted.total_rmse_kpa()
    )
}

/// Note on a term without a name that makes rows worse that nothing was fitted to.
fn does_not_hold(depends_on: &str, [fitted, with_it]: [&Figures; 2]) -> String {
    format!(
        "{depends_on} was tried and does not hold on validation data ({:.2} kPa instead of {:.2}): it is not in the rig file",
        with_it.total_rmse_kpa(),
        fitted.total_rmse_kpa()
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use fit::simulate::ChannelError;

    fn off_by(rmse_kpa: [f64; 2]) -> Figures {
        let error = |rmse_kpa| ChannelError { rmse_kpa, rows: 100, ..ChannelError::default() };
        let free = rmse_kpa.map(error).to_vec();
        Figures { free, ten_seconds: Vec::new(), one_second: Vec::new(), accuracy: Vec::new(), trace: Vec::new() }
    }

    /// Of squares beyond the noise a term must take a twentieth: 3 kPa beyond a noise of 4 are there where 5 are left.
    #[test]
    fn a_term_that_leaves_nearly_all_of_what_is_missing_is_not_what_is_missing() {
        let sigma_kpa = [4.0, 0.0];
        let fitted = off_by([5.0, 1.0]);
        assert!(takes_next_to_nothing(&fitted, &fitted, &sigma_kpa));
        // 9 and 1 before; 8.8 and 0.81 are more than 9.5 of these 10, and 8.5 and 0.81 are less.
        assert!(takes_next_to_nothing(&fitted, &off_by([24.8_f64.sqrt(), 0.9]), &sigma_kpa));
        assert!(!takes_next_to_nothing(&fitted, &off_by([24.5_f64.sqrt(), 0.9]), &sigma_kpa));
        let told = takes_too_little("the spare valve", [&off_by([5.0, 5.0]), &off_by([4.9, 4.9])]);
        assert!(told.starts_with("the spare valve was tried and is not what is missing"), "{told}");
        assert!(told.contains("with it 4.90 kPa of 5.00 are left on validation data"), "{told}");
    }
}
