//! Mechanisms that could be there and would not show, since the parameters would take them up.
//!
//! Where nothing is missing by what was recorded, a leak past an open valve may still be there, for to such recordings it is a
//! slightly larger valve; and so may a sensor whose zero is off. How large they may be is not a matter of opinion: with `s` the
//! effect of one on the readings and `s⊥` what the free parameters cannot do instead ([`crate::search::screen`]), its size is known to
//!
//! ```text
//! a ± √(κ / s⊥·W s⊥),      a = −s⊥·W r / s⊥·W s⊥
//! ```
//!
//! to first order, so that `a`, or nothing where that is negative, and 1.645 times the rest would show no more than noise does
//! (one side of a 90 % interval). `κ` is by how much the scores scatter more than noise does, as in [`crate::judge::added_uncertainty`]. What that
//! much would move the pressures by, all else as it is, tells whether it matters.

use fit::objective::NINETY;
use fit::simulate::Run;

use crate::bench::{Bench, Explanation};
use crate::pump::switched::REACH_KPA;
use crate::search::candidate::{Candidate, leaks};
use crate::search::quick_search::weighted;
use crate::search::screen::Projector;

/// A mechanism that would not show.
#[derive(Debug, Clone, PartialEq)]
pub struct Hidden {
    /// The candidate.
    pub candidate: usize,
    /// By what it would move the pressure that it moves most, all else as it is: root mean square in kPa.
    pub moves_kpa: f64,
}

/// Size at which an effect is taken, in kPa that it moves a pressure by: small, for what parameters do not take up of it is a
/// hundredth, and what is out of proportion must be less.
const SMALL_KPA: f64 = 0.3;

/// Mechanisms, among those whose id is `of_kind`, that could be there beside the `nominal` rig without showing, the one of which there
/// could be most first.
pub fn hidden(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    nominal: &Explanation,
    of_kind: impl Fn(&str) -> bool,
) -> Vec<Hidden> {
    let Some(projector) = Projector::of(&nominal.fitted, &nominal.set.prior()) else { return Vec::new() };
    let groupings = bench.groupings();
    let small = small_effects(bench, candidates, nominal, |k| of_kind(&candidates[k].id)).into_iter();
    let of = |small: Small| {
        let size = projector.sized(small.effect, &groupings);
        let moves_kpa = small.moves_kpa * (size.best.max(0.0) + NINETY / size.information.sqrt());
        moves_kpa.is_finite().then_some(Hidden { candidate: small.candidate, moves_kpa })
    };
    let mut hidden: Vec<Hidden> = small.filter_map(of).collect();
    hidden.sort_by(|a, b| b.moves_kpa.total_cmp(&a.moves_kpa));
    hidden
}

/// Names of leaks that recordings of open valves do not tell from other parameters, of which there could be as much as is worth
/// a name.
pub fn leaks_behind(bench: &Bench<'_>, candidates: &[Candidate], nominal: &Explanation) -> Vec<String> {
    let much = hidden(bench, candidates, nominal, leaks).into_iter().filter(|h| h.moves_kpa > REACH_KPA);
    much.map(|h| candidates[h.candidate].name()).collect()
}

/// Notes on a leak, a zero error and a wrong gain that would not have shown, and on what rules them out.
pub fn in_words(bench: &Bench<'_>, candidates: &[Candidate], nominal: &Explanation) -> Vec<String> {
    let [a_zero, a_gain] = ["sensor_bias", "sensor_gain"];
    let hidden = hidden(bench, candidates, nominal, |id| leaks(id) || id == a_zero || id == a_gain);
    let most = |of_kind: &dyn Fn(&str) -> bool| {
        let most = hidden.iter().find(|h| of_kind(&candidates[h.candidate].id));
        most.filter(|h| h.moves_kpa > REACH_KPA).map(|h| (candidates[h.candidate].name(), h.moves_kpa))
    };
    let leak = most(&leaks).map(|(name, kpa)| {
        format!(
            "a leak would not show in these recordings ({name}: up to one that moves a pressure by {kpa:.1} kPa): with the valves \
             open it passes for another valve. To rule it out, add a recording of 15 s with the pump off and all valves shut"
        )
    });
    let zero = most(&|id| id == a_zero).map(|(name, kpa)| {
        format!(
            "a zero error would not show either ({name}: up to {kpa:.1} kPa). To rule it out, add 10 s with the pump off and all \
             valves fully open"
        )
    });
    let gain = most(&|id| id == a_gain).map(|(name, kpa)| {
        format!(
            "nor would a wrong gain ({name}: up to {kpa:.1} kPa): other parameters take it up. To rule it out, compare the sensor with \
             a gauge near its highest pressure"
        )
    });
    leak.into_iter().chain(zero).chain(gain).collect()
}

/// A candidate's effect on the readings where it is small.
pub(crate) struct Small {
    pub(crate) candidate: usize,
    /// On the readings, weighted.
    pub(crate) effect: Vec<f64>,
    /// By what it moves the pressure that it moves most, all else as it is: root mean square in kPa.
    pub(crate) moves_kpa: f64,
}

/// Effects of those candidates that are `asked` for on top of an explanation, as far as the rig can be run with them.
pub(crate) fn small_effects(
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
    let pairs = small.iter().map(|(candidate, _)| *candidate).zip(traces.chunks_exact(2));
    let of_pairs = pairs.filter_map(|(candidate, pair)| {
        // In proportion, to second order: of once and of twice as much.
        let [Ok(once), Ok(twice)] = pair else { return None };
        let at_once: Vec<f64> =
            still.iter().zip(once.iter().zip(twice)).map(|(s, (a, b))| s + 0.5 * (4.0 * a - b - 3.0 * s)).collect();
        let moves_kpa = bench.most_moved_kpa(&at_once, &still, all.clone());
        let effect = weighted(&still, &at_once, &[], &weights);
        let known = moves_kpa > 0.0 && effect.iter().all(|e| e.is_finite());
        known.then_some(Small { candidate, effect, moves_kpa })
    });
    of_pairs.collect()
}
