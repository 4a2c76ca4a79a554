//! Uncertainty of the number of something that moves in steps.
//!
//! Slopes say nothing about a band: between the moments at which a flapper slips nothing changes with it, and by slopes a wrong band is
//! known to a thousandth like a right one. What tells is what is left. Were the band off, the slips would come at other moments, and
//! the free run would show it by as much as it changes from one band to the other:
//!
//! ```text
//! |p(b) − p(b̂)| ≤ 2 √(|r|² − σ²)      r: free run at b̂ less recorded, in the pressure that is off most; σ: noise
//! ```
//!
//! So the interval reaches beyond the furthest band `b` whose change is no larger than twice what the best one, `b̂`, leaves, to the
//! next that was looked at: once for what is left, once for what the other parameters, fitted beside `b̂`, may have taken up.

use fit::objective::NINETY;
use fit::simulate::Run;

use crate::bench::{Bench, Explanation};
use crate::judge::excess;
use crate::search::candidate::Candidate;
use crate::search::{lying_where, position_of};

/// Distances from the best band at which others are looked at, as shares of it, either way.
const AWAY: [f64; 10] = [0.001, 0.002, 0.004, 0.007, 0.012, 0.02, 0.035, 0.06, 0.1, 0.2];
/// Multiple of what is left that allows for that and for what the other parameters may have taken up.
const TAKEN_UP: f64 = 2.0;

/// Variance of each coordinate of an explanation, in units of its prior's, by what its steps leave unexplained: that of the first
/// parameter of whatever moves in steps, none elsewhere. Of a fit whose free run can be simulated; none otherwise.
pub fn variance_of_steps(bench: &Bench<'_>, candidates: &[Candidate], explanation: &Explanation) -> Vec<f64> {
    let (fitted, set) = (&explanation.fitted, &explanation.set);
    let mut variance = vec![0.0; fitted.point.len()];
    for (term, candidate) in explanation.terms.iter().filter_map(|k| Some((*k, candidates.get(*k)?))) {
        let at = position_of(bench, candidates, explanation, term).filter(|_| candidate.stepped());
        let Some((at, parameter)) = at.zip(candidate.parameters(0).into_iter().next()) else { continue };
        let Some(best) = fitted.point.get(at).copied() else { continue };
        let [low, high] = parameter.bounds;
        let band = parameter.value(best);
        let away: Vec<f64> = AWAY.iter().flat_map(|share| [1.0 - share, 1.0 + share]).collect();
        let bands = std::iter::once(1.0).chain(away).map(|times| (times * band).clamp(low, high));
        let coordinates: Vec<f64> = bands.map(|band| parameter.coordinate(band)).collect();
        let run = |z: &f64| {
            let mut point = fitted.point.clone();
            if let Some(slot) = point.get_mut(at) {
                *slot = *z;
            }
            let flappers = lying_where(fitted, &candidate.component, parameter.value(*z) / band);
            Some(Run { flappers, ..Run::from(set.rig_at(&point).ok()?) })
        };
        let Some(runs) = coordinates.iter().map(run).collect::<Option<Vec<Run>>>() else { continue };
        let mut traces = bench.fast.run(&runs, &fitted.arcs).into_iter();
        let Some(Ok(still)) = traces.next() else { continue };
        let doubtful_kpa = TAKEN_UP * excess(bench, &still).into_iter().fold(0.0, f64::max);
        let all = 0..bench.records.records().len();
        let changes: Vec<f64> = traces
            .map(|trace| trace.map_or(f64::INFINITY, |t| bench.most_moved_kpa(&t, &still, all.clone())))
            .collect();
        let doubted = |pair: &[f64]| pair.iter().any(|change| *change < doubtful_kpa);
        // The next one is the first that is known to be wrong.
        let wrong = changes.chunks(2).rposition(doubted).map_or(0, |last| (last + 1).min(AWAY.len() - 1));
        let to = coordinates.iter().skip(1 + 2 * wrong).take(2);
        let furthest = to.map(|z| (z - best).abs()).fold(0.0, f64::max);
        if let Some(slot) = variance.get_mut(at) {
            *slot = (furthest / NINETY).powi(2);
        }
    }
    variance
}
