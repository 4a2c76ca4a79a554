//! Which terms belong into the model: added one by one, swapped, deleted.

use fit::data::Role;

use crate::bench::{Bench, Effort, Explanation};
use crate::candidate::Candidate;
use crate::error::DiagnoseError;
use crate::evidence::{Bar, Evidence, evidence};
use crate::glance::{Footing, Glanced};
use crate::judge::{FLOOR_KPA, UNKNOWN_KPA, excess, explains_most};
use crate::screen::{Screened, Screening, screen};

mod exchange;
mod refine;

pub use exchange::twins;
use exchange::{deletions, pairs, swaps};
use refine::{from_priors, plainer, refined, richer, sharpened};

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

impl SearchSettings {
    /// For a round that is only there to see whether something follows.
    fn looking_ahead(&self) -> Self {
        SearchSettings { polished: 1, ..*self }
    }
}

/// What a round of additions looked like.
#[derive(Debug, Clone, PartialEq)]
pub struct Round {
    /// Terms before the round.
    pub base: Vec<usize>,
    /// Candidates after a glance, best first.
    pub ranked: Vec<Ranked>,
    /// What was added in the best after fits to the end, ascending.
    pub best: Vec<usize>,
    /// Its evidence against the base.
    pub evidence: Option<Evidence>,
    /// Whether it was taken.
    pub taken: bool,
}

impl Round {
    /// Notes the best that was fitted to the end, and its evidence.
    fn shows(&mut self, best: &Explanation, found: Evidence) {
        self.best = best.terms.iter().copied().filter(|term| !self.base.contains(term)).collect();
        self.evidence = Some(found);
    }
}

/// A candidate after a glance.
#[derive(Debug, Clone, PartialEq)]
pub struct Ranked {
    /// Which.
    pub candidate: usize,
    /// What it gained in log-likelihood and prior.
    pub gain: f64,
    /// Values of its parameters there.
    pub values: Vec<f64>,
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
    let mut stood: Vec<Vec<usize>> = Vec::new();
    // What is added and then deleted again would be added once more, and so on.
    while best.terms.len() < settings.most_terms && !stood.contains(&best.terms) {
        if !best.terms.is_empty() && !leaves_room(bench, settings, &best) {
            break;
        }
        stood.push(best.terms.clone());
        let (ranked, polished) = additions(bench, candidates, &best, settings, tell)?;
        let Some(top) = polished.first().cloned() else { break };
        let top = plainer(bench, candidates, top, settings.bar.removed_kpa)?;
        let found = evidence(bench, &top, &best);
        let taken = earns_its_place(bench, candidates, settings, &found, [&top, &best, &nominal]);
        let missed: Vec<usize> = ranked.iter().map(|r| r.candidate).collect();
        let mut round = Round { base: best.terms.clone(), ranked, best: Vec::new(), evidence: None, taken };
        round.shows(&top, found);
        tried.extend(polished);
        if taken {
            best = refined(bench, candidates, top, settings.bar.removed_kpa)?;
        } else {
            let left = excess(bench, &best.trace);
            let unexplained = !explains_most(&excess(bench, &nominal.trace), &left);
            let unexplained = unexplained && left.iter().any(|kpa| *kpa > UNKNOWN_KPA);
            // Each of two may be lost in what the other does.
            let ahead = if unexplained && best.terms.len() + 2 <= settings.most_terms {
                let (_, further) = additions(bench, candidates, &top, &settings.looking_ahead(), tell)?;
                further.into_iter().next().filter(|pair| {
                    let earned = |without: &Explanation| {
                        let found = evidence(bench, pair, without);
                        earns_its_place(bench, candidates, settings, &found, [pair, without, &nominal])
                    };
                    earned(&best) && earned(&top)
                })
            } else {
                None
            };
            // What is far from any known physics may be near one from where the parameters were before they gave way.
            let again = match ahead {
                Some(pair) => Some(pair),
                None if unexplained => from_priors(bench, candidates, &best, &missed, &mut tried, tell)?,
                None => None,
            };
            let passed = |again: &Explanation| {
                earns_its_place(bench, candidates, settings, &evidence(bench, again, &best), [again, &best, &nominal])
            };
            match again.filter(passed) {
                Some(again) => {
                    round.shows(&again, evidence(bench, &again, &best));
                    round.taken = true;
                    best = again;
                }
                None => {
                    next = Some(top);
                    rounds.push(round);
                    break;
                }
            }
        }
        rounds.push(round);
        if best.terms.len() > 1 {
            best = swaps(bench, candidates, best, &rounds, settings, &mut tried, tell)?;
            best = pairs(bench, candidates, best, &rounds, &mut tried, tell)?;
            best = deletions(bench, candidates, &nominal, best, settings, &mut tried)?;
        }
    }
    Ok(Found { nominal, best, next, rounds, tried })
}

/// What a further term must set right beside what is found already, as a share of its error: nobody's formula for the main
/// effect is exact, and what a tenth of it leaves behind looks like some small effect of another kind.
const BESIDE: f64 = 0.15;
/// Log-likelihood that nothing small which is not there gains, and standard errors of it.
const DOUBT: f64 = 100.0;
const DOUBT_SE: f64 = 4.0;
/// Share of the mean squared error that is left.
const MOST_OF_THE_REST: f64 = 0.5;
/// The same of what is beyond doubt. Noise that wanders is not known to be noise and counts as left: of what any term could set
/// right this is more.
const MORE_THAN_A_THIRD: f64 = 0.4;

/// The noise may be this much less than it was taken for, as a share of its variance: what is left beyond it is then more.
const NOISE_DOUBT: f64 = 0.2;

/// Whether a further term could still earn its place beside those of `best`: none sets right more than all that is left beyond
/// the noise.
fn leaves_room(bench: &Bench<'_>, settings: &SearchSettings, best: &Explanation) -> bool {
    reach_beyond_noise(bench, &best.trace) > settings.bar.removed_kpa
}

/// What the free run would gain if nothing but the noise were left, and that less than it was taken for: as
/// [`Evidence::removed_kpa`].
fn reach_beyond_noise(bench: &Bench<'_>, trace: &[f64]) -> f64 {
    let noise: f64 = bench.sigma_kpa().iter().map(|sigma| sigma * sigma).sum();
    let beyond: f64 = excess(bench, trace).iter().map(|kpa| kpa * kpa).sum();
    (beyond + NOISE_DOUBT * noise).sqrt()
}

/// Whether `with`, which has the evidence `found` against `without`, passes the bar, and is more than what the formulas of the
/// terms in `without` may have left of what the `nominal` rig misses: more than a share of it, or, where it shows or is
/// beyond doubt, most of what is left. What a formula leaves is not what some other physics does, and that explains a third of
/// it at best.
fn earns_its_place(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    settings: &SearchSettings,
    found: &Evidence,
    [with, without, nominal]: [&Explanation; 3],
) -> bool {
    let parameters = with.set.len().saturating_sub(without.set.len());
    let blocks = bench.blocks(Role::Fit).len();
    settings.bar.passed(found, parameters, candidates.len(), blocks)
        && (found.removed_kpa > BESIDE * evidence(bench, without, nominal).removed_kpa
            || found.removed_kpa > FLOOR_KPA && found.share > MOST_OF_THE_REST
            || found.share > MORE_THAN_A_THIRD && is_beyond_doubt(found))
}

/// Whether a gain is there in every part of the recordings, and as large in those that nothing was fitted to.
fn is_beyond_doubt(found: &Evidence) -> bool {
    found.fitted > DOUBT && found.fitted > DOUBT_SE * found.fitted_se && found.throughout > DOUBT_SE
}

/// How much more than the screen sees, to first order, a term may come to gain where the rest is explained.
const BEYOND_THE_SCREEN: f64 = 5.0;

/// Whether anything on top of `base`, by what the screen sees in it, could set right `least_kpa` of the free run.
///
/// On `n` readings of a channel fitted with a scale `s`, a root of `k` in the drop of the mean square is a gain of `½ n (k/s)²`,
/// or more where the channel with the larger scale is the one. Where much is unexplained the screen's slopes lead nowhere,
/// and so does this.
fn any_could_earn(bench: &Bench<'_>, base: &Explanation, screening: &Screening, least_kpa: f64) -> bool {
    if excess(bench, &base.trace).iter().any(|kpa| *kpa > UNKNOWN_KPA) {
        return true;
    }
    let most =
        [&screening.single, &screening.double].into_iter().filter_map(|list| list.first()).map(|first| first.gain);
    let weights = bench.weighted(&base.fitted.scale_kpa);
    let mut readings = vec![0.0; bench.records.layout().channels()];
    for (_, channel, range) in bench.records.layout().all() {
        let of_channel = weights.get(range).unwrap_or_default();
        readings[channel] += of_channel.iter().map(|w| w * w).sum::<f64>();
    }
    let least = 0.5 * readings.into_iter().fold(f64::INFINITY, f64::min) * least_kpa * least_kpa;
    BEYOND_THE_SCREEN * most.fold(0.0, f64::max) > least
}

/// Rounds of least squares of a glance.
pub const GLANCE_ROUNDS: usize = 6;
/// Rounds of a glance at a pair: two terms at a time are further from where they will end.
const PAIR_ROUNDS: usize = 12;
/// Drop in cost (half chi-square) that pays for a term, and for a reading of the pump's speed.
pub const PRICE: f64 = 20.0;
/// And for each of its parameters: a mechanism is not worth a richer shape for less.
const PRICE_OF_A_PARAMETER: f64 = 5.0;

/// Cost of an explanation: half chi-square (robust) and prior.
pub fn cost(bench: &Bench<'_>, explanation: &Explanation) -> f64 {
    explanation.fitted.comparable_cost(bench.records, bench.fit_weights())
}

/// Standard deviations of its prior beyond which a parameter has given way to something that it is not.
const FAR_OFF: f64 = 6.0;

/// Whether candidate `k` can and may be put beside `terms`.
fn is_open(bench: &Bench<'_>, candidates: &[Candidate], terms: &[usize], k: usize) -> bool {
    let beside: Vec<&Candidate> = terms.iter().map(|t| &candidates[*t]).collect();
    !terms.contains(&k)
        && !candidates[k].is_refinement()
        && beside.iter().all(|term| !term.excludes(&candidates[k]))
        && candidates[k].is_apt(bench.rig, &beside)
}

/// Tries every candidate on top of `base`; the ranking, and the best ones fitted to the end.
fn additions(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    base: &Explanation,
    settings: &SearchSettings,
    tell: &mut dyn FnMut(&str, f64),
) -> Result<(Vec<Ranked>, Vec<Explanation>), DiagnoseError> {
    let open: Vec<usize> = (0..candidates.len()).filter(|k| is_open(bench, candidates, &base.terms, *k)).collect();
    tell("screening mechanisms", 0.0);
    let screening = screen(bench, candidates, base, &open);
    if !base.terms.is_empty() && !any_could_earn(bench, base, &screening, settings.bar.removed_kpa) {
        return Ok((Vec::new(), Vec::new()));
    }
    let footing = Footing::of(bench, base)?;
    // Parameters that have given way too far lead a fit into a valley of their own.
    let far_off = base.fitted.point.iter().take(bench.nominal.len()).any(|z| z.abs() > FAR_OFF);
    let mut glances = Vec::new();
    let singles = screening.single.iter().take(settings.glanced);
    let pair_fits = base.terms.len() + 2 <= settings.most_terms;
    let doubles = screening.double.iter().take(if pair_fits { settings.polished } else { 0 });
    let count = singles.len() + doubles.len();
    for (done, screened) in singles.chain(doubles).enumerate() {
        tell("trying mechanisms", done as f64 / count.max(1) as f64);
        let terms = screened.terms.iter().fold(base.terms.clone(), |terms, (k, _)| with(&terms, *k));
        let from = base.moved(&screened.shift);
        let starts =
            starts_at(bench, candidates, (base, &from), &terms, &screened.terms, settings.from_prior && far_off);
        let rounds = if screened.terms.len() > 1 { PAIR_ROUNDS } else { GLANCE_ROUNDS };
        if let Some(Glanced { cost, point }) =
            footing.glance(bench, &bench.set_of(candidates, &terms)?, &starts, rounds, f64::INFINITY)
        {
            glances.push(Tried { screened, gain: footing.cost - cost, terms, point });
        }
    }
    glances.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let ranked: Vec<Ranked> = glances.iter().filter_map(|tried| tried.ranked(bench, candidates)).collect();
    let best = ranked.first().map_or(0.0, |first| first.gain);
    // What is far behind after a glance is not worth a fit, nor is a second place that adds next to nothing.
    let double = glances.iter().find(|tried| tried.alone().is_none() && tried.gain > best + PRICE);
    let first = double.map_or(best, |double| double.gain);
    let single =
        glances.iter().filter(|tried| tried.alone().is_some() && tried.gain >= first - 20.0 - 0.5 * first.abs());
    let mut chosen: Vec<&Tried<'_>> = double.into_iter().chain(single.take(settings.polished)).collect();
    let wanted = chosen.len();
    let left_out = glances.iter().filter(|tried| chosen.iter().all(|known| known.terms != tried.terms));
    chosen.extend(left_out.collect::<Vec<_>>());
    let mut polished = Vec::new();
    for (done, tried) in chosen.into_iter().enumerate() {
        // Those behind have their turn where none of the first can be fitted.
        if done >= wanted && !polished.is_empty() {
            break;
        }
        tell("fitting the best", polished.len() as f64 / settings.polished as f64);
        let warm = bench.fit(candidates, &tried.terms, std::slice::from_ref(&tried.point), Effort::Polish);
        // Where much is left, the priors' means may lead to a better end than parameters that have given way.
        let leaves_much = |e: &Explanation| excess(bench, &e.trace).iter().any(|kpa| *kpa > UNKNOWN_KPA);
        let cold = if far_off && warm.as_ref().map_or(true, leaves_much) {
            let values = &tried.screened.terms;
            let from: Vec<_> =
                starts(bench, candidates, base, &tried.terms, values, true).into_iter().skip(1).collect();
            bench.fit(candidates, &tried.terms, &from, Effort::Polish).ok()
        } else {
            None
        };
        // What cannot be run in full where a glance has left it (a wall that gives way by more than its chamber holds) is
        // no explanation.
        let ends = warm.into_iter().chain(cold);
        let Some(fitted) = ends.min_by(|a, b| cost(bench, a).total_cmp(&cost(bench, b))) else { continue };
        polished.push(sharpened(bench, candidates, fitted)?);
    }
    let priced = |explanation: &Explanation| {
        let (terms, parameters) = (explanation.terms.len(), explanation.set.len());
        cost(bench, explanation) + PRICE * terms as f64 + PRICE_OF_A_PARAMETER * parameters as f64
    };
    polished.sort_by(|a, b| priced(a).total_cmp(&priced(b)));
    Ok((ranked, polished))
}

/// Terms after a glance.
struct Tried<'s> {
    screened: &'s Screened,
    gain: f64,
    terms: Vec<usize>,
    point: Vec<f64>,
}

impl Tried<'_> {
    /// The candidate with its values, where it is one.
    fn ranked(&self, bench: &Bench<'_>, candidates: &[Candidate]) -> Option<Ranked> {
        let candidate = self.alone()?;
        let at = position_in(bench, candidates, &self.terms, candidate)?;
        let coordinates = self.point.get(at..).unwrap_or_default();
        let values = candidates[candidate].parameters(0).iter().zip(coordinates).map(|(p, z)| p.value(*z)).collect();
        Some(Ranked { candidate, gain: self.gain, values })
    }

    /// The candidate, where it is one.
    fn alone(&self) -> Option<usize> {
        match self.screened.terms.as_slice() {
            [(k, _)] => Some(*k),
            _ => None,
        }
    }
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
    starts_at(bench, candidates, (base, &base.fitted.point), terms, values, from_prior)
}

/// As [`starts`], from another point of the base.
fn starts_at(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    (base, point): (&Explanation, &[f64]),
    terms: &[usize],
    values: &[(usize, Vec<f64>)],
    from_prior: bool,
) -> Vec<Vec<f64>> {
    let nominal = bench.nominal.len();
    let mut warm: Vec<f64> = point.iter().take(nominal).copied().collect();
    let mut cold = vec![0.0; nominal];
    for term in terms {
        let known = position_of(bench, candidates, base, *term);
        let given = values.iter().find(|(k, _)| k == term).map(|(_, v)| v);
        for (i, parameter) in candidates[*term].parameters(0).iter().enumerate() {
            let of_base = known.and_then(|at| point.get(at + i)).copied();
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
    position_in(bench, candidates, &explanation.terms, term)
}

/// Where the parameters of a term begin in a point of some terms.
fn position_in(bench: &Bench<'_>, candidates: &[Candidate], terms: &[usize], term: usize) -> Option<usize> {
    let before = terms.iter().take(terms.iter().position(|known| *known == term)?);
    Some(bench.nominal.len() + before.map(|known| candidates[*known].len()).sum::<usize>())
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
