//! What could be there and would not show: what the parameters would take up.
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

use fit::simulate::Run;

use crate::bench::{Bench, Explanation};
use crate::candidate::Candidate;
use crate::glance::weighted;
use crate::screen::Projector;

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
    let fitted = &nominal.fitted;
    let prior = nominal.set.prior();
    let projector = Projector::of(fitted, &prior)?;
    let weights = bench.weighted(&fitted.scale_kpa);
    let asked: Vec<(usize, &Candidate, &Vec<f64>)> = candidates
        .iter()
        .enumerate()
        .filter_map(|(k, candidate)| Some((k, candidate, candidate.starts.first().filter(|_| of_kind(&candidate.id))?)))
        .collect();
    let with = |candidate: &Candidate, values: &[f64]| {
        let mut rig = fitted.rig.clone();
        rig.mechanisms.push(candidate.attached(values));
        Run::from(rig)
    };
    let mut runs = vec![Run::from(fitted.rig.clone())];
    runs.extend(asked.iter().map(|(_, candidate, start)| with(candidate, start)));
    let mut traces = bench.fast.run(&runs, &fitted.arcs).into_iter();
    let still = traces.next()?.ok()?;
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
    let traces = bench.fast.run(&runs, &fitted.arcs).into_iter().collect::<Result<Vec<_>, _>>().ok()?;
    let hidden = small.iter().zip(traces.chunks_exact(2)).filter_map(|((candidate, _), pair)| {
        // In proportion, to second order: of once and of twice as much.
        let [once, twice] = pair else { return None };
        let at_once: Vec<f64> =
            still.iter().zip(once.iter().zip(twice)).map(|(s, (a, b))| s + 0.5 * (4.0 * a - b - 3.0 * s)).collect();
        let known_to = projector.known_to(weighted(&still, &at_once, &[], &weights))?;
        let moves_kpa = NINETY * known_to * bench.most_moved_kpa(&at_once, &still, all.clone());
        moves_kpa.is_finite().then_some(Hidden { candidate: *candidate, moves_kpa })
    });
    hidden.max_by(|a, b| a.moves_kpa.total_cmp(&b.moves_kpa))
}
