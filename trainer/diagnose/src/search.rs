//! Which terms belong into the model: added one by one, swapped, deleted.

use fit::data::Role;
use fit::simulate::Run;

use crate::bench::{Bench, Effort, Explanation};
use crate::candidate::Candidate;
use crate::error::DiagnoseError;
use crate::evidence::{Bar, Evidence, evidence};
use crate::glance::{Footing, Glanced};
use crate::judge::{EXPLAINED, UNKNOWN_KPA, excess};
use crate::screen::{Projector, screen};

/// How to search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchSettings {
    /// The most terms.
    pub most_terms: usize,
    /// How many of the best candidates of a round are fitted to the end.
    pub polished: usize,
    /// How many candidates that the screen puts first are fitted at all.
    pub glanced: usize,
    /// Whether candidates are also tried from the priors' means.
    pub from_prior: bool,
    /// What a term must show.
    pub bar: Bar,
}

/// What a round of additions looked like.
#[derive(Debug, Clone, PartialEq)]
pub struct Round {
    /// Terms before the round.
    pub base: Vec<usize>,
    /// Candidates with what they gained in log-likelihood and prior at a glance, best first.
    pub ranked: Vec<(usize, f64)>,
    /// The best one's evidence against the base.
    pub evidence: Option<Evidence>,
    /// Whether it was taken.
    pub taken: bool,
}

/// What a search found.
pub struct Found {
    /// The rig with its parameters fitted and nothing added.
    pub nominal: Explanation,
    /// The best explanation.
    pub best: Explanation,
    /// The strongest candidate that was not taken, on top of the best explanation.
    pub next: Option<Explanation>,
    /// Rounds in order.
    pub rounds: Vec<Round>,
    /// Every explanation that was fitted to the end.
    pub tried: Vec<Explanation>,
}

/// Searches among `candidates`, from the rig's own parameters at `start` (near their best without any term).
///
/// # Errors
/// The rig itself cannot be fitted.
pub fn search(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    start: &[f64],
    settings: &SearchSettings,
    tell: &mut dyn FnMut(&str, f64),
) -> Result<Found, DiagnoseError> {
    let nominal = bench.fit(candidates, &[], &[start.to_vec()], Effort::Polish)?;
    let mut best = nominal.clone();
    let mut rounds = Vec::new();
    let mut tried = Vec::new();
    let mut next = None;
    let blocks = bench.blocks(Role::Fit).len();
    while best.terms.len() < settings.most_terms {
        let (ranked, polished) = additions(bench, candidates, &best, settings, tell)?;
        let Some(top) = polished.first().cloned() else { break };
        let found = evidence(bench, &top, &best);
        let parameters = top.set.len().saturating_sub(best.set.len());
        let taken = settings.bar.passed(&found, parameters, candidates.len(), blocks)
            && counts_beside(&found, &evidence(bench, &best, &nominal));
        let missed: Vec<usize> = ranked.iter().map(|(k, _)| *k).collect();
        rounds.push(Round { base: best.terms.clone(), ranked, evidence: Some(found), taken });
        tried.extend(polished);
        if taken {
            best = top;
        } else {
            // What is far from any known physics may be near one from where the parameters were before they gave way.
            let left = excess(bench, &best.trace);
            let squares = |excess: &[f64]| excess.iter().map(|kpa| kpa * kpa).sum::<f64>();
            let unexplained = squares(&left) > (1.0 - EXPLAINED) * squares(&excess(bench, &nominal.trace));
            let again = if unexplained && left.iter().any(|kpa| *kpa > UNKNOWN_KPA) {
                from_priors(bench, candidates, &best, &missed, &mut tried, tell)?
            } else {
                None
            };
            let passed = |again: &Explanation| {
                let found = evidence(bench, again, &best);
                let parameters = again.set.len().saturating_sub(best.set.len());
                settings.bar.passed(&found, parameters, candidates.len(), blocks)
                    && counts_beside(&found, &evidence(bench, &best, &nominal))
            };
            match again.filter(passed) {
                Some(again) => best = again,
                None => {
                    next = Some(top);
                    break;
                }
            }
        }
        if best.terms.len() > 1 {
            best = swaps(bench, candidates, best, &rounds, settings, &mut tried, tell)?;
            best = deletions(bench, candidates, &nominal, best, settings, &mut tried)?;
        }
    }
    Ok(Found { nominal, best, next, rounds, tried })
}

/// Rounds of least squares of a glance.
pub const GLANCE_ROUNDS: usize = 6;

/// Cost of an explanation: half chi-square (robust) and prior.
pub fn cost(bench: &Bench<'_>, explanation: &Explanation) -> f64 {
    explanation.fitted.comparable_cost(bench.records, bench.fit_weights())
}

type Ranked = Vec<(usize, f64)>;

/// Tries every candidate on top of `base`; the ranking, and the best ones fitted to the end.
fn additions(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    base: &Explanation,
    settings: &SearchSettings,
    tell: &mut dyn FnMut(&str, f64),
) -> Result<(Ranked, Vec<Explanation>), DiagnoseError> {
    let open: Vec<usize> = (0..candidates.len())
        .filter(|k| base.terms.iter().all(|t| !candidates[*t].excludes(&candidates[*k])) && !base.terms.contains(k))
        .collect();
    tell("screening mechanisms", 0.0);
    let screened = screen(bench, candidates, base, &open);
    let footing = Footing::of(bench, base)?;
    let mut glances = Vec::new();
    let count = settings.glanced.min(screened.len());
    for (done, screened) in screened.iter().take(count).enumerate() {
        tell("trying mechanisms", done as f64 / count.max(1) as f64);
        let k = screened.candidate;
        let terms = with(&base.terms, k);
        let from = [(k, screened.start.clone())];
        let starts = starts(bench, candidates, base, &terms, &from, settings.from_prior);
        let of: Vec<&Candidate> = terms.iter().filter_map(|t| candidates.get(*t)).collect();
        let set = bench.set(&of)?;
        if let Some(Glanced { cost, point }) = footing.glance(bench, &set, &starts, GLANCE_ROUNDS) {
            glances.push((k, footing.cost - cost, terms, point));
        }
    }
    glances.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut polished = Vec::new();
    for (_, gain, terms, point) in glances.iter().take(settings.polished) {
        tell("fitting the best", polished.len() as f64 / settings.polished as f64);
        // What is far behind after a glance is not worth a fit.
        let best = glances.first().map_or(0.0, |g| g.1);
        if *gain < best - 20.0 - 0.5 * best.abs() {
            continue;
        }
        let fitted = bench.fit(candidates, terms, std::slice::from_ref(point), Effort::Polish)?;
        polished.push(sharpened(bench, candidates, fitted)?);
    }
    polished.sort_by(|a, b| cost(bench, a).total_cmp(&cost(bench, b)));
    Ok((glances.iter().map(|(k, gain, ..)| (*k, *gain)).collect(), polished))
}

/// Fits each of some candidates on top of `base` anew from the priors' means; the best.
///
/// Parameters that have given way to missing physics (a chamber's volume for warm gas: by a third) stand so far off that the
/// slopes there lead nowhere. A glance uses those slopes; this works them out on the way.
fn from_priors(
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
        Some(best) => Ok(Some(sharpened(bench, candidates, best)?)),
        None => Ok(None),
    }
}

/// Factors either way within which [`sharpened`] looks, by round (a stepped parameter's starts are 1.4 apart), and what is
/// added to a second parameter, which decides with it when the steps come.
const SHARPENING: [(f64, f64); 3] = [(1.5, 0.3), (1.12, 0.1), (1.02, 0.02)];
/// Values that are tried on either side, of each.
const SHARPENED: [i32; 2] = [10, 2];

/// Looks for better values of stepped parameters, which least squares leaves where they start, and fits the rest anew.
fn sharpened(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    mut explanation: Explanation,
) -> Result<Explanation, DiagnoseError> {
    let stepped: Vec<usize> = explanation.terms.iter().copied().filter(|t| candidates[*t].stepped()).collect();
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
        let rigs: Result<Vec<Run>, _> = points.iter().map(|point| set.rig_at(point).map(Run::from)).collect();
        let mut traces = bench.fast.run(&rigs.map_err(DiagnoseError::rig(set.rig()))?, &fitted.arcs).into_iter();
        let (Some(Ok(still)), Some(projector)) =
            (traces.next(), Projector::new(&fitted.linearised, &set.prior(), &fitted.point))
        else {
            continue;
        };
        let weights = bench.weighted(&fitted.scale_kpa);
        let gain = |trace: Vec<f64>| -> f64 {
            let moved = trace.iter().zip(&still).zip(&weights);
            let effect: Vec<f64> = moved.map(|((t, s), w)| if *w == 0.0 { 0.0 } else { (t - s) * w }).collect();
            projector.gain_as_is(&effect)
        };
        let gains: Vec<f64> = traces.map(|trace| trace.map_or(f64::NEG_INFINITY, gain)).collect();
        let sound = points.iter().skip(1).zip(gains).filter(|(_, gain)| gain.is_finite());
        let best = sound.max_by(|a, b| a.1.total_cmp(&b.1));
        let Some((point, _)) = best else { continue };
        let again = bench.fit(candidates, &explanation.terms, std::slice::from_ref(point), Effort::Polish)?;
        if cost(bench, &again) < cost(bench, &explanation) {
            explanation = again;
        }
    }
    Ok(explanation)
}

/// Starts for `terms`: the base's point, and the priors' means of the rig's own parameters. What the base does not have
/// starts from `values`, or from its prior's mean.
pub fn starts(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    base: &Explanation,
    terms: &[usize],
    values: &[(usize, Vec<f64>)],
    from_prior: bool,
) -> Vec<Vec<f64>> {
    let nominal = bench.nominal.len();
    let mut warm: Vec<f64> = base.fitted.point.iter().take(nominal).copied().collect();
    let mut cold = vec![0.0; nominal];
    for term in terms {
        let known = position_of(bench, candidates, base, *term);
        let given = values.iter().find(|(k, _)| k == term).map(|(_, v)| v);
        for (i, parameter) in candidates[*term].parameters(0).iter().enumerate() {
            let of_base = known.and_then(|at| base.fitted.point.get(at + i)).copied();
            let of_values = given.and_then(|v| v.get(i)).map(|v| parameter.coordinate(*v));
            let coordinate = of_base.or(of_values).filter(|z| z.is_finite()).unwrap_or(0.0);
            warm.push(coordinate);
            cold.push(coordinate);
        }
    }
    if from_prior { vec![warm, cold] } else { vec![warm] }
}

/// Where the parameters of a term begin in an explanation's point.
pub fn position_of(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    explanation: &Explanation,
    term: usize,
) -> Option<usize> {
    let mut at = bench.nominal.len();
    for known in &explanation.terms {
        if *known == term {
            return Some(at);
        }
        at += candidates[*known].len();
    }
    None
}

/// `terms` and `k`, ascending.
pub fn with(terms: &[usize], k: usize) -> Vec<usize> {
    let mut all = terms.to_vec();
    all.push(k);
    all.sort_unstable();
    all
}

/// `terms` without `k`.
pub fn without(terms: &[usize], k: usize) -> Vec<usize> {
    terms.iter().copied().filter(|t| *t != k).collect()
}

/// Replaces terms one by one by what stood next to them in earlier rounds, while that lowers the cost.
fn swaps(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    mut best: Explanation,
    rounds: &[Round],
    settings: &SearchSettings,
    tried: &mut Vec<Explanation>,
    tell: &mut dyn FnMut(&str, f64),
) -> Result<Explanation, DiagnoseError> {
    // What came close in any round so far.
    let mut close: Vec<usize> =
        rounds.iter().flat_map(|round| round.ranked.iter().take(settings.polished + 1).map(|(k, _)| *k)).collect();
    close.sort_unstable();
    close.dedup();
    let mut footing = Footing::of(bench, &best)?;
    for term in best.terms.clone() {
        let rest = without(&best.terms, term);
        for k in &close {
            if best.terms.contains(k) || rest.iter().any(|t| candidates[*t].excludes(&candidates[*k])) {
                continue;
            }
            tell("swapping mechanisms", 0.5);
            let terms = with(&rest, *k);
            let starts = starts(bench, candidates, &best, &terms, &[], false);
            let of: Vec<&Candidate> = terms.iter().filter_map(|t| candidates.get(*t)).collect();
            let Some(Glanced { cost: cost_of, point }) =
                footing.glance(bench, &bench.set(&of)?, &starts, GLANCE_ROUNDS)
            else {
                continue;
            };
            // A swap that is far behind after a glance does not overtake.
            if cost_of > footing.cost + FAR_BEHIND {
                continue;
            }
            let swapped = bench.fit(candidates, &terms, &[point], Effort::Polish)?;
            if cost(bench, &swapped) < cost(bench, &best) - 1.0 {
                tried.push(best);
                best = swapped;
                footing = Footing::of(bench, &best)?;
                break;
            }
            tried.push(swapped);
        }
    }
    Ok(best)
}

/// Cost by which something is behind after a glance that no fit is spent on it.
pub const FAR_BEHIND: f64 = 100.0;

/// What a further term must set right beside what is found already, as a share of its error: nobody's formula for the main
/// effect is exact, and what a few per cent of it leaves behind looks like some small effect of another kind.
const BESIDE: f64 = 0.1;

/// Whether a term with the evidence `of` is more than what the formulas of the others may leave.
fn counts_beside(of: &Evidence, others: &Evidence) -> bool {
    of.removed_kpa > BESIDE * others.removed_kpa
}

/// Removes terms that the others have made needless.
fn deletions(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    nominal: &Explanation,
    mut best: Explanation,
    settings: &SearchSettings,
    tried: &mut Vec<Explanation>,
) -> Result<Explanation, DiagnoseError> {
    for term in best.terms.clone() {
        if best.terms.len() < 2 {
            break;
        }
        let terms = without(&best.terms, term);
        let starts = starts(bench, candidates, &best, &terms, &[], false);
        let of: Vec<&Candidate> = terms.iter().filter_map(|t| candidates.get(*t)).collect();
        let footing = Footing::of(bench, &best)?;
        let without_it = footing.glance(bench, &bench.set(&of)?, &starts, GLANCE_ROUNDS);
        if without_it.is_none_or(|glanced| glanced.cost > footing.cost + FAR_BEHIND) {
            continue;
        }
        let reduced = bench.fit(candidates, &terms, &starts, Effort::Polish)?;
        let found = evidence(bench, &best, &reduced);
        let parameters = candidates[term].len();
        if settings.bar.passed(&found, parameters, candidates.len(), bench.blocks(Role::Fit).len())
            && counts_beside(&found, &evidence(bench, &reduced, nominal))
        {
            tried.push(reduced);
        } else {
            best = reduced;
        }
    }
    Ok(best)
}
