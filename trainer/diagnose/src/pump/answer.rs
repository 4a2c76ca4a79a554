//! Answer that a search over some recordings comes to.

use fit::data::{Records, Role};
use fit::objective::profiled;
use model::rig::Rig;

use crate::bench::{Bench, Explanation};
use crate::error::DiagnoseError;
use crate::judge::range_ends;
use crate::judge::{Judgement, judge};
use crate::locate::{Missing, reconstruct};
use crate::pump::switched;
use crate::report::figures::{Figures, figures};
use crate::search::candidate::Candidate;
use crate::search::{Found, SearchSettings, cost, search};

/// Standard deviations of its prior up to which a fitted parameter is believed before anything is found.
const BELIEVED: f64 = 3.0;

/// Question that a search is asked.
pub(crate) struct Asked<'a> {
    /// The rig as it was given.
    pub(crate) given: &'a Rig,
    /// Mechanisms that may be missing from it.
    pub(crate) candidates: Vec<Candidate>,
    pub(crate) settings: SearchSettings,
    /// A shorter search.
    pub(crate) quick: bool,
}

impl Asked<'_> {
    /// Has candidates begin at these numbers too, where the search that brought them out had more in its way.
    pub(crate) fn begin_also_at(&mut self, known: Vec<(usize, Vec<f64>)>) {
        for (term, values) in known {
            if let Some(candidate) = self.candidates.get_mut(term) {
                candidate.starts.push(values);
            }
        }
    }

    /// Asks no more what the pump's speed does: its ripple has told.
    pub(crate) fn knows_the_speed(&mut self) {
        self.candidates.retain(|candidate| !["pump_droop", "pump_speed"].contains(&candidate.id.as_str()));
    }
}

/// Answer that a search over some recordings came to.
pub(crate) struct Answer {
    pub(crate) given: Figures,
    /// The recordings less the pump's strokes: what was searched on.
    pub(crate) reduced: Records,
    /// Candidates that were searched for, with ranges as wide as they came to be.
    pub(crate) candidates: Vec<Candidate>,
    pub(crate) found: Found,
    pub(crate) missing: Missing,
    pub(crate) judgement: Judgement,
    /// Cost of what was found: comparable between answers from the same readings.
    pub(crate) cost: f64,
    /// Cost of the free run of what was found on the rows that choose, which nothing was fitted to.
    pub(crate) cost_of_choice: f64,
}

impl Answer {
    /// Searches from the rig's own parameters at `start`, which are near their best. Strokes are those of the rig so fitted, or
    /// `strokes_of` another one.
    ///
    /// # Errors
    /// A fit failed.
    pub(crate) fn of(
        recorded: &Bench<'_>,
        asked: &Asked<'_>,
        start: &[f64],
        strokes_of: Option<&Rig>,
        progress: &mut dyn FnMut(&str, f64),
    ) -> Result<Self, DiagnoseError> {
        // At its own step: a coarser one's error is not the rig's.
        let given = figures(recorded, asked.given, recorded.close.fidelity(), !asked.quick)?;
        // Strokes of a rig whose parameters have given way to something are not the rig's.
        let believed: Vec<f64> = start.iter().map(|z| z.clamp(-BELIEVED, BELIEVED)).collect();
        let fitted = recorded.set(&[])?.rig_at(&believed).map_err(DiagnoseError::rig(recorded.rig))?;
        // Everything is searched with averaged pumps, on readings that lack the strokes; what was found ends on the recordings.
        let reduced = recorded.without_strokes(strokes_of.unwrap_or(&fitted))?;
        let bench = recorded.reduced(&reduced);
        let mut found = search(&bench, &asked.candidates, start, &asked.settings, progress)?;
        found.best = switched::at_work(&bench, &asked.candidates, found.best)?;
        let mut candidates = asked.candidates.clone();
        found.best = range_ends::widened(&bench, &mut candidates, found.best);
        progress("reconstructing what is missing", 0.0);
        let missing = reconstruct(&bench, &found.nominal.fitted.rig, &found.nominal.trace, !asked.quick)?;
        let judgement = judge(&bench, &candidates, &found, &bench.free_run(asked.given)?, progress)?;
        let (cost, cost_of_choice) = (cost(&bench, &found.best), cost_of_choice(&bench, &found.best));
        Ok(Answer { given, reduced, candidates, found, missing, judgement, cost, cost_of_choice })
    }
}

/// Negative log-likelihood of an explanation's free run on the rows that choose, the scale of each channel at its own best.
fn cost_of_choice(bench: &Bench<'_>, explanation: &Explanation) -> f64 {
    let layout = bench.records.layout();
    let chosen = bench.split.weights(layout, Role::Select);
    let of = |values: &[f64], i: usize| values.get(i).copied().unwrap_or(0.0);
    let counts = |i: &usize| of(&chosen, *i) * of(bench.counted(), *i) != 0.0;
    let channel = |channel: usize| {
        let rows = (0..layout.records()).flat_map(|record| layout.channel(record, channel)).filter(counts);
        let off = rows.map(|i| of(&explanation.trace, i) - of(bench.records.readings_kpa(), i));
        profiled(&off.filter(|kpa| kpa.is_finite()).collect::<Vec<_>>(), explanation.fitted.loss)
    };
    (0..layout.channels()).map(channel).sum()
}
