//! What could be there and would not show: what the parameters would take up, and what they are off by because of it.
//!
//! Where nothing is missing by what was recorded, a leak past an open valve may still be there, for to such recordings it is a
//! slightly larger valve; and so may a sensor whose zero is off. How large they may be is not a matter of opinion: with `s` the
//! effect of one on the readings and `s⊥` what the free parameters cannot do instead ([`crate::screen`]), its size is known to
//!
//! ```text
//! a ± 1/√(s⊥·W s⊥),      up to 1.645 times that would show no more than noise does (one side of a 90 % interval)
//! ```
//!
//! to first order. What that much would move the pressures by, all else as it is, tells whether it matters.
//!
//! It matters to numbers as well. A mechanism that moves no pressure by [`REACH_KPA`] is not named, so one may be in any rig beside
//! those that are; a parameter `i` that gives way to it by `h_i` times its size is then known to
//!
//! ```text
//! var_i = cov_ii + Σ h_i² / (1/α² + κ⁻¹ s⊥·W s⊥),      α: as much as moves a pressure by REACH_KPA, one side of a 90 % interval
//! ```
//!
//! over all such mechanisms, each by itself: what a fit with one as well, held near nothing, would state. `κ` is by how much the
//! scores of `s⊥`, added up over groups of readings whose residuals belong together, scatter more than noise does.

use fit::simulate::Run;

use crate::bench::{Bench, Explanation};
use crate::candidate::Candidate;
use crate::glance::weighted;
use crate::screen::Projector;
use crate::search::is_open;
use crate::switched::REACH_KPA;

/// z of a two-sided interval of 90 %.
const NINETY: f64 = 1.645;

/// What would not show.
#[derive(Debug, Clone, PartialEq)]
pub struct Hidden {
    /// The candidate.
    pub candidate: usize,
    /// By what it would move the pressure that it moves most, all else as it is: root mean square in kPa.
    pub moves_kpa: f64,
}

/// What something moves a pressure by where its effect is taken, in kPa: small, for what parameters do not take up of it is a
/// hundredth, and what is out of proportion must be less.
const SMALL_KPA: f64 = 0.3;

/// The mechanism, among those whose id is `of_kind`, of which most could be there beside the `nominal` rig without showing; `None`
/// where none can be asked.
pub fn most_hidden(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    nominal: &Explanation,
    of_kind: impl Fn(&str) -> bool,
) -> Option<Hidden> {
    let projector = Projector::of(&nominal.fitted, &nominal.set.prior())?;
    let hidden =
        small_effects(bench, candidates, nominal, |k| of_kind(&candidates[k].id)).into_iter().filter_map(|small| {
            let (_, information) = projector.gives_way(small.effect, &[]);
            let moves_kpa = NINETY * small.moves_kpa / information.max(0.0).sqrt();
            moves_kpa.is_finite().then_some(Hidden { candidate: small.candidate, moves_kpa })
        });
    hidden.max_by(|a, b| a.moves_kpa.total_cmp(&b.moves_kpa))
}

/// Variance of each coordinate of an explanation, in units of its prior's, by mechanisms that are too small for a name and may be
/// there beside it.
pub fn variance_by_the_unnamed(bench: &Bench<'_>, candidates: &[Candidate], explanation: &Explanation) -> Vec<f64> {
    let mut variance = vec![0.0; explanation.fitted.point.len()];
    let Some(projector) = Projector::of(&explanation.fitted, &explanation.set.prior()) else { return variance };
    let groupings = bench.groupings();
    for small in small_effects(bench, candidates, explanation, |k| is_open(bench, candidates, &explanation.terms, k)) {
        let (shift, information) = projector.gives_way(small.effect, &groupings);
        let most = REACH_KPA / NINETY / small.moves_kpa;
        let of_it = 1.0 / (1.0 / (most * most) + information.max(0.0));
        for (variance, h) in variance.iter_mut().zip(shift) {
            *variance += h * h * of_it;
        }
    }
    variance
}

/// A candidate's effect on the readings where it is small.
struct Small {
    candidate: usize,
    /// On the readings, weighted.
    effect: Vec<f64>,
    /// By what it moves the pressure that it moves most, all else as it is: root mean square in kPa.
    moves_kpa: f64,
}

/// Effects of those candidates that are `asked` for on top of an explanation, as far as the rig can be run with them.
fn small_effects(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    explanation: &Explanation,
    asked: impl Fn(usize) -> bool,
) -> Vec<Small> {
    let fitted = &explanation.fitted;
    let weights = bench.weighted(&fitted.scale_kpa);
    let asked: Vec<(usize, &Candidate, &Vec<f64>)> = candidates
        .iter()
        .enumerate()
        .filter(|(k, _)| asked(*k))
        .filter_map(|(k, candidate)| Some((k, candidate, candidate.starts.first()?)))
        .collect();
    let with = |candidate: &Candidate, values: &[f64]| {
        let mut rig = fitted.rig.clone();
        rig.mechanisms.push(candidate.attached(values));
        Run::from(rig)
    };
    let mut runs = vec![Run::from(fitted.rig.clone())];
    runs.extend(asked.iter().map(|(_, candidate, start)| with(candidate, start)));
    let mut traces = bench.fast.run(&runs, &fitted.arcs).into_iter();
    let Some(Ok(still)) = traces.next() else { return Vec::new() };
    let all = 0..bench.records.records().len();
    let moved = traces.map(|trace| trace.map_or(f64::NAN, |trace| bench.most_moved_kpa(&trace, &still, all.clone())));
    let small: Vec<_> = asked
        .iter()
        .zip(moved)
        .filter(|(_, moved)| *moved > 0.0)
        .map(|((k, candidate, start), moved)| {
            (*k, [1.0, 2.0].map(|times| with(candidate, &candidate.scaled(start, times * SMALL_KPA / moved))))
        })
        .collect();
    let runs: Vec<Run> = small.iter().flat_map(|(_, runs)| runs.clone()).collect();
    let traces = bench.fast.run(&runs, &fitted.arcs);
    let of = |((candidate, _), pair): (&(usize, [Run; 2]), &[Result<Vec<f64>, _>])| {
        // In proportion, to second order: of once and of twice as much.
        let [Ok(once), Ok(twice)] = pair else { return None };
        let at_once: Vec<f64> =
            still.iter().zip(once.iter().zip(twice)).map(|(s, (a, b))| s + 0.5 * (4.0 * a - b - 3.0 * s)).collect();
        let moves_kpa = bench.most_moved_kpa(&at_once, &still, all.clone());
        let effect = weighted(&still, &at_once, &[], &weights);
        (moves_kpa > 0.0 && effect.iter().all(|e| e.is_finite())).then_some(Small {
            candidate: *candidate,
            effect,
            moves_kpa,
        })
    };
    small.iter().zip(traces.chunks_exact(2)).filter_map(of).collect()
}
