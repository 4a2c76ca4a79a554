//! Parameters that move in steps, or begin at a moment: least squares leaves them where they start, so they are looked for.

use fit::cores::side_by_side;
use fit::data::Role;
use fit::objective::Fitted;
use fit::simulate::{Flapper, Look, Run, flappers_of};

use super::terms::starts_at;
use super::{cost, position_of, with};
use crate::bench::{Bench, Effort, Explanation, LOSS};
use crate::error::DiagnoseError;
use crate::search::candidate::Candidate;
use crate::search::quick_search::weighted;
use crate::search::screen::Projector;

/// Factor within which [`scanned`] looks, either way, in so many steps, and what a second parameter is set to.
const SCAN: f64 = 4.0;
pub(super) const STEPS: i32 = 36;
/// Steps in a short search.
pub(super) const STEPS_IN_SHORT: i32 = 18;
/// Steps where one slip that comes late does not put off all that follow: the right place shows from further away.
pub(super) const STEPS_IN_PIECES: i32 = 18;
const SCANNED: [f64; 4] = [0.0, 0.1, 0.2, 0.3];
/// Places that are fitted, and by how much they differ.
const SCANNED_FITS: usize = 3;
const ELSEWHERE: f64 = 1.08;

/// Where a stepped candidate may belong.
pub(super) struct Spot {
    /// Start for a fit.
    pub(super) start: Vec<f64>,
    /// Gain before a fit, all other parameters giving way to first order, in log-likelihood.
    pub(super) gain: f64,
}

/// Where a stepped candidate on top of `base` may belong, the best first.
///
/// Between steps that come at the right moments and those that do not there is no slope, and parameters that were fitted beside
/// the wrong ones make them the best there are. So places are tried before anything is fitted beside them, from where the base
/// stands, all other parameters giving way to first order.
pub(super) fn scanned(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    base: &Explanation,
    (k, around): (usize, &[f64]),
    steps: i32,
) -> Vec<Spot> {
    let (fitted, candidate) = (&base.fitted, &candidates[k]);
    let parameters = candidate.parameters(0);
    let Some(projector) = Projector::of(fitted, &base.set.prior()) else {
        return Vec::new();
    };
    let seconds = if parameters.len() > 1 { SCANNED.as_slice() } else { &[0.0] };
    let mut tries: Vec<Vec<f64>> = Vec::new();
    for (step, second) in (-steps..=steps).flat_map(|step| seconds.iter().map(move |second| (step, second))) {
        let mut values = around.to_vec();
        for ((which, value), parameter) in values.iter_mut().enumerate().zip(&parameters) {
            let [low, high] = parameter.bounds;
            let to = match which {
                0 => *value * SCAN.powf(f64::from(step) / f64::from(steps)),
                1 => *second,
                _ => *value,
            };
            *value = to.clamp(low, high);
        }
        if !tries.contains(&values) {
            tries.push(values);
        }
    }
    let run = |values: &Vec<f64>| {
        let mut rig = fitted.rig.clone();
        rig.mechanisms.push(candidate.attached(values));
        Run::from(rig)
    };
    let mut runs: Vec<Run> = tries.iter().map(run).collect();
    let lying = flappers_of(&bench.fast, &runs, &fitted.arcs, Look::Evenly);
    for (run, flappers) in runs.iter_mut().zip(&lying) {
        run.flappers.clone_from(flappers);
    }
    let Ok(still) = bench.fast.one(&fitted.rig, &fitted.arcs) else { return Vec::new() };
    let weights = bench.weighted(&fitted.scale_kpa);
    let traces = bench.fast.run(&runs, &fitted.arcs);
    let seen = side_by_side(&traces, |trace| {
        trace.as_ref().ok().map(|trace| projector.as_is(&weighted(&still, trace, &[], &weights)))
    });
    let mut ranked: Vec<(Vec<f64>, f64, Vec<f64>)> = tries
        .into_iter()
        .zip(seen)
        .filter_map(|(values, seen)| {
            let (gain, shift) = seen?;
            gain.is_finite().then_some((values, gain, shift))
        })
        .collect();
    ranked.sort_by(|a, b| b.1.total_cmp(&a.1));
    let size = |values: &[f64]| values.first().copied().unwrap_or(0.0).abs().max(f64::MIN_POSITIVE);
    let mut places: Vec<(Vec<f64>, f64, Vec<f64>)> = Vec::new();
    for (values, gain, shift) in ranked {
        let elsewhere = |known: &[f64]| (size(&values) / size(known)).ln().abs() > ELSEWHERE.ln();
        if places.len() < SCANNED_FITS && places.iter().all(|(known, ..)| elsewhere(known)) {
            places.push((values, gain, shift));
        }
    }
    let terms = with(&base.terms, k);
    let found = |(values, gain, shift): (Vec<f64>, f64, Vec<f64>)| {
        let starts = starts_at(bench, candidates, (base, &base.moved(&shift)), &terms, &[(k, values)], false);
        starts.into_iter().map(move |start| Spot { start, gain })
    };
    places.into_iter().flat_map(found).collect()
}

/// Onsets that [`timed`] tries: steps of so many seconds, so many either way.
const ONSET_STEPS: (f64, i32) = (0.04, 25);

/// Looks for better times of what begins later, and fits the rest anew.
///
/// A kick that comes a third of a second early is as wrong as none: both are so far off that a robust loss has no slope between
/// them. So times are tried one by one, and judged by that loss; on the rows that choose as well, for the kick takes a second and
/// may lie there in all recordings.
fn timed(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    mut explanation: Explanation,
) -> Result<Explanation, DiagnoseError> {
    for term in explanation.terms.clone() {
        let Some(onset) = candidates[term].onset() else { continue };
        let Some(at) = position_of(bench, candidates, &explanation, term) else { continue };
        let (fitted, set) = (&explanation.fitted, &explanation.set);
        let parameters = candidates[term].parameters(0);
        let Some(parameter) = parameters.get(onset) else { continue };
        let [low, high] = parameter.bounds;
        let (step_s, steps) = ONSET_STEPS;
        let moved = |k: i32| {
            let mut point = fitted.point.clone();
            if let Some(slot) = point.get_mut(at + onset) {
                let begins_s = parameter.value(*slot) + step_s * f64::from(k);
                *slot = parameter.coordinate(begins_s.clamp(low, high));
            }
            point
        };
        let points: Vec<Vec<f64>> = (-steps..=steps).map(moved).collect();
        let rigs: Result<Vec<Run>, _> = points.iter().map(|point| set.rig_at(point).map(Run::from)).collect();
        let traces = bench.fast.run(&rigs.map_err(DiagnoseError::rig(set.rig()))?, &fitted.arcs);
        let (layout, recorded) = (bench.records.layout(), bench.records.readings_kpa());
        let mut weights = vec![0.0; layout.len()];
        for stretch in bench.split.stretches().iter().filter(|stretch| stretch.role != Role::HeldOut) {
            for (channel, scale) in fitted.scale_kpa.iter().enumerate() {
                for i in layout.stretch(stretch.record, channel, stretch.rows.clone()) {
                    if let Some((slot, counted)) = weights.get_mut(i).zip(bench.counted().get(i)) {
                        *slot = counted / scale;
                    }
                }
            }
        }
        let loss = |trace: Vec<f64>| weighted(recorded, &trace, &[], &weights).into_iter().map(|r| LOSS.cost(r)).sum();
        let losses: Vec<f64> = traces.into_iter().map(|trace| trace.map_or(f64::INFINITY, loss)).collect();
        let still = losses.get(points.len() / 2).copied().unwrap_or(f64::INFINITY);
        let Some((point, best)) = points.iter().zip(losses).min_by(|a, b| a.1.total_cmp(&b.1)) else { continue };
        if best < still
            && let Ok(again) = bench.fit(candidates, &explanation.terms, std::slice::from_ref(point), Effort::Polish)
        {
            explanation = again;
        }
    }
    Ok(explanation)
}

/// Factors either way within which [`sharpened`] looks, by round, and what is added to a second parameter, which decides with
/// it when the steps come. A stepped parameter's starts are 1.4 apart, but where one slip that comes too late puts off all that
/// follow, values near the right ones are better than others within a tenth of them alone (measured: 1.5 kPa at 0.09 of duty, 2.2
/// at 0.08, 2.4 at 0.044, where the search had ended): so it first looks all around.
/// After that a step of the round before to either side is enough, a quarter to a sixth as far apart.
const SHARPENING: [Around; 3] = [
    Around { factor: 3.0, added: 0.3, tried: [15, 6] },
    Around { factor: 1.1, added: 0.06, tried: [7, 2] },
    Around { factor: 1.02, added: 0.02, tried: [7, 2] },
];

/// Values around those that a fit has ended at.
struct Around {
    /// Reach either way: of the first parameter as a factor, of the second as what is added.
    factor: f64,
    added: f64,
    /// Values that are tried on either side, of each.
    tried: [i32; 2],
}

/// Where the flappers of a component lie at the starts of a fit's runs once its band is `wider` by a factor: where they lay, which is a
/// smaller share of it.
pub(crate) fn lying_where(fitted: &Fitted, component: &str, wider: f64) -> Vec<Vec<Flapper>> {
    let its_own = |flapper: &&Flapper| flapper.unknown.ends_with(&format!(":{component}"));
    let of = |flapper: &Flapper| Flapper { share: (flapper.share / wider).clamp(-1.0, 1.0), ..flapper.clone() };
    fitted.arcs.arcs().iter().map(|arc| arc.flappers.iter().filter(its_own).map(of).collect()).collect()
}

/// Looks for better values of stepped parameters and of onsets, which least squares leaves where they start, and fits the rest
/// anew. Stepped parameters of `known` terms were looked at when those came in.
pub(super) fn sharpened(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    explanation: Explanation,
    known: &[usize],
) -> Result<Explanation, DiagnoseError> {
    let mut explanation = timed(bench, candidates, explanation)?;
    let stepped = explanation.terms.iter().copied().filter(|t| candidates[*t].stepped() && !known.contains(t));
    let stepped: Vec<usize> = stepped.collect();
    for (around, term) in SHARPENING.iter().flat_map(|around| stepped.iter().map(move |term| (around, *term))) {
        let (fitted, set) = (&explanation.fitted, &explanation.set);
        let Some(at) = position_of(bench, candidates, &explanation, term) else { continue };
        let parameters = candidates[term].parameters(0);
        let Around { factor, added, tried: [firsts, seconds] } = *around;
        let moved = |point: &mut [f64], which: usize, by: &dyn Fn(f64) -> f64| {
            if let (Some(parameter), Some(slot)) = (parameters.get(which), point.get_mut(at + which)) {
                let [low, high] = parameter.bounds;
                *slot = parameter.coordinate(by(parameter.value(*slot)).clamp(low, high));
            }
        };
        let mut points = vec![fitted.point.clone()];
        let seconds = if parameters.len() > 1 { seconds } else { 0 };
        for (k, m) in (-firsts..=firsts).flat_map(|k| (-seconds..=seconds).map(move |m| (k, m))) {
            let mut point = fitted.point.clone();
            moved(&mut point, 0, &|v| v * factor.powf(f64::from(k) / f64::from(firsts)));
            moved(&mut point, 1, &|v| v + added * f64::from(m) / f64::from(seconds.max(1)));
            points.push(point);
        }
        let band = |point: &[f64]| parameters.first().zip(point.get(at)).map_or(1.0, |(p, z)| p.value(*z));
        let lying = |point: &[f64]| lying_where(fitted, &candidates[term].component, band(point) / band(&fitted.point));
        let run = |point: &Vec<f64>| set.rig_at(point).map(|rig| Run { flappers: lying(point), ..Run::from(rig) });
        let rigs: Result<Vec<Run>, _> = points.iter().map(run).collect();
        let mut traces = bench.fast.run(&rigs.map_err(DiagnoseError::rig(set.rig()))?, &fitted.arcs).into_iter();
        let (Some(Ok(still)), Some(projector)) = (traces.next(), Projector::of(fitted, &set.prior())) else {
            continue;
        };
        let weights = bench.weighted(&fitted.scale_kpa);
        let traces: Vec<_> = traces.collect();
        let gain = |trace: &Vec<f64>| projector.as_is(&weighted(&still, trace, &[], &weights)).0;
        let gains = side_by_side(&traces, |trace| trace.as_ref().map_or(f64::NEG_INFINITY, gain));
        let sound = points.iter().skip(1).zip(gains).filter(|(_, gain)| gain.is_finite());
        let best = sound.max_by(|a, b| a.1.total_cmp(&b.1));
        let Some((point, _)) = best else { continue };
        let again = bench.fit(candidates, &explanation.terms, std::slice::from_ref(point), Effort::Polish);
        let Ok(again) = again else { continue };
        if cost(bench, &again) < cost(bench, &explanation) {
            explanation = again;
        }
    }
    Ok(explanation)
}
