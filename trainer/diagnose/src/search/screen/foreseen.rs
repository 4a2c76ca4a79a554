//! Candidates that a screen will put first, by what they did in an earlier one.
//!
//! What a mechanism does to the readings hardly depends on what else is in the rig; what is left to be explained does, and so do the
//! slopes of the free parameters. So of the many that can stand beside a first term few need to be run again: those that come
//! out first when their effects of the first screen are set against what is left now.

use fit::cores::side_by_side;

use super::{Projector, Screening, Try, ranked};
use crate::bench::{Bench, Explanation};
use crate::search::candidate::Candidate;

/// Effects of candidates in a screen.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Seen {
    effects: Vec<Did>,
    /// Scale of the residuals by channel that effects are weighted by, in kPa.
    scale_kpa: Vec<f64>,
}

/// Effect of a candidate at a start. A digit in ten million is more than an order needs, and there are hundreds of them.
#[derive(Debug, Clone, PartialEq)]
struct Did {
    candidate: usize,
    start: Vec<f64>,
    weighted: Vec<f32>,
}

impl Seen {
    /// The effects of tries, weighted by a scale.
    pub(super) fn of(tries: &[Try<'_>], scale_kpa: &[f64]) -> Self {
        let did = |(candidate, start, effect): &Try<'_>| Did {
            candidate: *candidate,
            start: (*start).clone(),
            weighted: effect.of.iter().map(|e| *e as f32).collect(),
        };
        Seen { effects: tries.iter().map(did).collect(), scale_kpa: scale_kpa.to_vec() }
    }
}

impl Screening {
    /// Candidates among `open` that a screen on top of `base` will put among its first `singles`, or the first `doubles` of pairs,
    /// by what this one saw them do, and those that it did not see. All of them where `base` has no slopes.
    pub fn likely(
        &self,
        bench: &Bench<'_>,
        candidates: &[Candidate],
        base: &Explanation,
        open: &[usize],
        [singles, doubles]: [usize; 2],
    ) -> Vec<usize> {
        let Some(projector) = Projector::of(&base.fitted, &base.set.prior()) else { return open.to_vec() };
        let mut over = vec![0.0; bench.records.layout().len()];
        for (_, channel, range) in bench.records.layout().all() {
            let ratio = self.seen.scale_kpa.get(channel).zip(base.fitted.scale_kpa.get(channel));
            over.get_mut(range).unwrap_or_default().fill(ratio.map_or(1.0, |(then, now)| then / now));
        }
        let of = |did: &Did| did.weighted.iter().zip(&over).map(|(e, over)| f64::from(*e) * over).collect();
        let known: Vec<&Did> = self.seen.effects.iter().filter(|did| open.contains(&did.candidate)).collect();
        let effects = side_by_side(&known, |did| projector.seen(of(did)));
        let tries: Vec<Try<'_>> =
            known.iter().zip(effects).map(|(did, effect)| (did.candidate, &did.start, effect)).collect();
        let foreseen = ranked(candidates, &projector, &tries);
        let first = foreseen.single.iter().take(singles).chain(foreseen.double.iter().take(doubles));
        let first: Vec<usize> = first.flat_map(|screened| screened.terms.iter().map(|(k, _)| *k)).collect();
        let unseen = |k: &usize| known.iter().all(|did| did.candidate != *k);
        open.iter().copied().filter(|k| first.contains(k) || unseen(k)).collect()
    }
}
