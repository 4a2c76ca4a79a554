//! Fits that least squares from where things stand would miss: from the priors, and of what moves in steps.

use fit::data::Role;
use fit::simulate::{Flapper, Run};

use super::{cost, position_of, starts, with, without};
use crate::bench::{Bench, Effort, Explanation, LOSS};
use crate::candidate::Candidate;
use crate::error::DiagnoseError;
use crate::evidence::evidence;
use crate::glance::weighted;
use crate::screen::Projector;

/// The same with plainer shapes of its terms, where the richer ones set right less than is worth a name: a number more takes
/// up what the formula is off by, and with it the numbers that were right.
pub(super) fn plainer(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    mut explanation: Explanation,
    least_kpa: f64,
) -> Result<Explanation, DiagnoseError> {
    for term in explanation.terms.clone() {
        let Some(plain) = (0..candidates.len()).find(|k| candidates[*k].is_plainer_than(&candidates[term])) else {
            continue;
        };
        let Some(fitted) = in_shape(bench, candidates, &explanation, term, plain) else { continue };
        if evidence(bench, &explanation, &fitted).removed_kpa < least_kpa {
            explanation = fitted;
        }
    }
    Ok(explanation)
}

/// Richer shapes that are offered in place of a term.
pub(super) fn richer(candidates: &[Candidate], term: usize) -> impl Iterator<Item = usize> + '_ {
    let of_it = move |k: &usize| candidates[*k].is_refinement() && candidates[term].is_plainer_than(&candidates[*k]);
    (0..candidates.len()).filter(of_it)
}

/// The same with richer shapes of its terms that are offered for what was found, where that sets right what is worth a name.
pub(super) fn refined(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    mut explanation: Explanation,
    least_kpa: f64,
) -> Result<Explanation, DiagnoseError> {
    for term in explanation.terms.clone() {
        for rich in richer(candidates, term) {
            let Some(fitted) = in_shape(bench, candidates, &explanation, term, rich) else { continue };
            if evidence(bench, &fitted, &explanation).removed_kpa >= least_kpa {
                explanation = fitted;
                break;
            }
        }
    }
    Ok(explanation)
}

/// The same fitted again with `shape` in place of `term`: the numbers that both have start where they are, the others where
/// the shape's own start; `None` if it cannot be run.
///
/// A shape with more numbers also starts with all of its own: of two time constants a plain shape has found one, and not
/// always the one that it is named for.
fn in_shape(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    explanation: &Explanation,
    term: usize,
    shape: usize,
) -> Option<Explanation> {
    let at = position_of(bench, candidates, explanation, term)?;
    let known = explanation.set.values(&explanation.fitted.point);
    let mut values = candidates[shape].starts.first()?.clone();
    for (value, known) in values.iter_mut().zip(known.iter().skip(at).take(candidates[term].len())) {
        *value = *known;
    }
    let terms = with(&without(&explanation.terms, term), shape);
    let mut from = starts(bench, candidates, explanation, &terms, &[(shape, values)], false);
    if candidates[term].is_plainer_than(&candidates[shape]) {
        let own = candidates[shape].starts.first()?.clone();
        from.extend(starts(bench, candidates, explanation, &terms, &[(shape, own)], false));
    }
    bench.fit(candidates, &terms, &from, Effort::Polish).ok()
}

/// Fits each of some candidates on top of `base` anew from the priors' means; the best.
///
/// Parameters that have given way to missing physics (a chamber's volume for warm gas: by a third) stand so far off that the
/// slopes there lead nowhere. A glance uses those slopes; this works them out on the way.
pub(super) fn from_priors(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    base: &Explanation,
    among: &[usize],
    tried: &mut Vec<Explanation>,
    tell: &mut dyn FnMut(&str, f64),
) -> Result<Option<Explanation>, DiagnoseError> {
    let mut best: Option<Explanation> = None;
    for (done, k) in among.iter().enumerate() {
        tell("trying again from the priors", done as f64 / among.len() as f64);
        let terms = with(&base.terms, *k);
        let middle = candidates[*k].starts.get(candidates[*k].starts.len() / 2).cloned().unwrap_or_default();
        let cold = starts(bench, candidates, base, &terms, &[(*k, middle)], true).into_iter().skip(1);
        // From so far away some cannot be run at all.
        let Ok(fitted) = bench.fit(candidates, &terms, &cold.collect::<Vec<_>>(), Effort::Polish) else { continue };
        if best.as_ref().is_none_or(|best| cost(bench, &fitted) < cost(bench, best)) {
            tried.extend(best.replace(fitted));
        } else {
            tried.push(fitted);
        }
    }
    match best {
        Some(best) => Ok(Some(sharpened(bench, candidates, best, &base.terms)?)),
        None => Ok(None),
    }
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
const SHARPENING: [(f64, f64); 4] = [(3.0, 0.3), (1.5, 0.3), (1.12, 0.1), (1.02, 0.02)];
/// Values that are tried on either side, of each.
const SHARPENED: [i32; 2] = [15, 6];

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
    for (reach, term) in SHARPENING.iter().flat_map(|reach| stepped.iter().map(move |term| (*reach, *term))) {
        let (fitted, set) = (&explanation.fitted, &explanation.set);
        let Some(at) = position_of(bench, candidates, &explanation, term) else { continue };
        let parameters = candidates[term].parameters(0);
        let (factor, added) = reach;
        let moved = |point: &mut [f64], which: usize, by: &dyn Fn(f64) -> f64| {
            if let (Some(parameter), Some(slot)) = (parameters.get(which), point.get_mut(at + which)) {
                let [low, high] = parameter.bounds;
                *slot = parameter.coordinate(by(parameter.value(*slot)).clamp(low, high));
            }
        };
        let mut points = vec![fitted.point.clone()];
        let seconds = if parameters.len() > 1 { SHARPENED[1] } else { 0 };
        for (k, m) in (-SHARPENED[0]..=SHARPENED[0]).flat_map(|k| (-seconds..=seconds).map(move |m| (k, m))) {
            let mut point = fitted.point.clone();
            moved(&mut point, 0, &|v| v * factor.powf(f64::from(k) / f64::from(SHARPENED[0])));
            moved(&mut point, 1, &|v| v + added * f64::from(m) / f64::from(SHARPENED[1]));
            points.push(point);
        }
        // Flappers stay where they lay: of a wider band that is a smaller share.
        let band = |point: &[f64]| parameters.first().zip(point.get(at)).map_or(1.0, |(p, z)| p.value(*z));
        let its_own = |flapper: &&Flapper| flapper.unknown.ends_with(&format!(":{}", candidates[term].component));
        let lying = |point: &[f64]| -> Vec<Vec<Flapper>> {
            let share = |was: f64| (was * band(&fitted.point) / band(point)).clamp(-1.0, 1.0);
            let of = |flapper: &Flapper| Flapper { share: share(flapper.share), ..flapper.clone() };
            fitted.arcs.arcs().iter().map(|arc| arc.flappers.iter().filter(its_own).map(of).collect()).collect()
        };
        let run = |point: &Vec<f64>| set.rig_at(point).map(|rig| Run { flappers: lying(point), ..Run::from(rig) });
        let rigs: Result<Vec<Run>, _> = points.iter().map(run).collect();
        let mut traces = bench.fast.run(&rigs.map_err(DiagnoseError::rig(set.rig()))?, &fitted.arcs).into_iter();
        let (Some(Ok(still)), Some(projector)) =
            (traces.next(), Projector::new(&fitted.linearised, &set.prior(), &fitted.point))
        else {
            continue;
        };
        let weights = bench.weighted(&fitted.scale_kpa);
        let gain = |trace: Vec<f64>| -> f64 { projector.gain_as_is(weighted(&still, &trace, &[], &weights)) };
        let gains: Vec<f64> = traces.map(|trace| trace.map_or(f64::NEG_INFINITY, gain)).collect();
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
