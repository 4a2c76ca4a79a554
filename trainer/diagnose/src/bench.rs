//! The bench on which explanations are tried: recordings, their split and noise, and fits of a rig with terms.

use std::ops::Range;
use std::sync::OnceLock;

use fit::FitError;
use fit::cores::side_by_side;
use fit::data::{Noise, Records, Role, Split, Stretch, noise};
use fit::least_squares::Loss;
use fit::objective::{
    BlockScore, FitSettings, Fitted, NoiseModel, Score, Shooting, blocks_of, by_state, by_time, fit_from, score,
};
use fit::parameters::{Parameter, ParameterSet, Scatter, nominal};
use fit::simulate::{Arcs, Fidelity, Simulator, refined_starts};
use model::rig::Rig;

use crate::candidate::Candidate;
use crate::error::DiagnoseError;
use crate::much::much_kpa;

/// Slow errors that a model is allowed to have when it is compared with another: no formula is exact, no build sheet
/// complete. How large they are is estimated from the better of the two, out of these, in kPa.
const DRIFTS_KPA: [f64; 7] = [0.005, 0.01, 0.02, 0.04, 0.08, 0.16, 0.32];
/// Correlation times of that error in s.
const DRIFT_S: [f64; 2] = [1.0, 0.1];
/// And fast errors, as multiples of the noise: edges that come a few milliseconds early, a meter's own noise that drives the
/// rig. Where a model is right to the noise, 1 is the likeliest.
const ROUGHER: [f64; 4] = [1.0, 2.0, 4.0, 8.0];

/// Errors that a model is allowed to have, by channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Allowed {
    /// Slow ones, in kPa.
    pub drift_kpa: Vec<f64>,
    /// How slow, in s; one time for all channels.
    pub time_s: f64,
    /// Whether single errors far out are as likely as Student's distribution has them.
    pub heavy: bool,
    /// From row to row, noise included, in kPa.
    pub sigma_kpa: Vec<f64>,
}

/// Recordings laid out for fits.
pub struct Bench<'r> {
    /// The rig as it was given.
    pub rig: &'r Rig,
    /// The recordings.
    pub records: &'r Records,
    /// Runs rigs over them, stroke by stroke.
    pub simulator: Simulator<'r>,
    /// Runs rigs over them with the pump averaged: for searches, corrected by what the detailed rig differs by.
    pub fast: Simulator<'r>,
    /// Runs rigs over them as closely as can be: in detail, or smooth where the readings were freed from the ripple.
    pub close: Simulator<'r>,
    /// Which rows are fitted, which choose, which are kept back.
    pub split: Split,
    /// Noise by channel.
    pub noise: Vec<Noise>,
    /// The nominal parameters, with priors.
    pub nominal: Vec<Parameter>,
    /// Whether fits are those of a short search: they come to rest sooner.
    pub short: bool,
    /// Whether a ripple was taken out that turned about once in a recording ([`Bench::beside_slow_ripple`]).
    pub slow_ripple: bool,
    fit_weights: Vec<f64>,
    counted: Vec<f64>,
    much_kpa: Vec<f64>,
}

/// An explanation, fitted.
#[derive(Debug, Clone)]
pub struct Explanation {
    /// Indices of its terms in the list of candidates, ascending.
    pub terms: Vec<usize>,
    /// Free parameters: the nominal ones, then those of the terms in order.
    pub set: ParameterSet,
    /// The fit; residuals and Jacobian are emptied to save memory unless asked to be kept.
    pub fitted: Fitted,
    /// Free run over all rows of all recordings.
    pub trace: Vec<f64>,
    /// Whether a flapper jumps in it: one jump that comes an instant late throws a free run off until the next.
    pub jumps: bool,
    /// Half the squared shifts of the nominal parameters in prior standard deviations.
    pub prior_cost: f64,
    /// [`Explanation::errors`], once they were asked for.
    errors: OnceLock<Allowed>,
}

impl Explanation {
    /// Its point moved `by` that much in each coordinate, within their bounds.
    pub fn moved(&self, by: &[f64]) -> Vec<f64> {
        let moved = self.fitted.point.iter().zip(by).zip(self.set.bounds());
        moved.map(|((z, by), [low, high])| (z + by).clamp(low, high)).collect()
    }

    /// Its point with the rig's own parameters as they were given.
    pub fn as_given(&self, bench: &Bench<'_>) -> Vec<f64> {
        let own = bench.nominal.len();
        self.fitted.point.iter().enumerate().map(|(i, z)| if i < own { 0.0 } else { *z }).collect()
    }

    /// [`Bench::drift_of`] its trace, on the bench that it was fitted on.
    pub fn errors(&self, bench: &Bench<'_>) -> &Allowed {
        self.errors.get_or_init(|| bench.drift_of(&self.trace))
    }
}

/// The loss of all fits.
pub const LOSS: Loss = Loss::Student { freedom: 5.0 };

/// How far a fit moves an onset, in s: a row or two more than the steps in which onsets are looked for.
const ONSET_REACH_S: f64 = 0.1;

/// How thorough a fit is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effort {
    /// Free runs until they converge.
    Polish,
    /// Windows first, then free runs.
    Full,
}

impl Effort {
    fn settings(self, search: Fidelity, short: bool) -> FitSettings {
        let (stages, rounds, least_gain) = match self {
            Effort::Polish => (vec![Shooting::Free], 10, 0.3),
            Effort::Full => (vec![Shooting::Windows { seconds: 2.0 }, Shooting::Free], 12, 0.05),
        };
        let settings = FitSettings { stages, rounds, least_gain, search, ..FitSettings::default() };
        if short { FitSettings { passes: PASSES_IN_SHORT, rest: REST_IN_SHORT, ..settings } } else { settings }
    }
}

/// The most passes of the last stage of a fit in a short search, and the log-likelihood that one gains at rest.
const PASSES_IN_SHORT: usize = 4;
const REST_IN_SHORT: f64 = 3.0;

impl<'r> Bench<'r> {
    /// Lays out recordings; `usable` is 1 at readings that may be trusted, 0 elsewhere.
    pub fn new(rig: &'r Rig, records: &'r Records, usable: &[f64], fidelity: Fidelity) -> Self {
        let simulator = Simulator::new(records, fidelity);
        let split = Split::of(records);
        let noise = noise(records);
        Bench {
            rig,
            records,
            simulator,
            fast: simulator.at(searching(fidelity)),
            close: simulator.at(if fidelity == Fidelity::Smooth { fidelity } else { Fidelity::Detailed }),
            nominal: nominal(rig, Scatter::default()),
            fit_weights: split.weights(records.layout(), Role::Fit).iter().zip(usable).map(|(w, u)| w * u).collect(),
            counted: usable.to_vec(),
            much_kpa: much_kpa(records, usable, &noise),
            short: false,
            slow_ripple: false,
            split,
            noise,
        }
    }

    /// The same with fits of a short search, or of a whole one.
    #[must_use]
    pub fn shortened(self, short: bool) -> Self {
        Bench { short, ..self }
    }

    /// The same with readings that a ripple was taken out of which turned about once in a recording, or with others: what it was
    /// predicted wrong by is left, as slow as a drift.
    #[must_use]
    pub fn beside_slow_ripple(self, slow_ripple: bool) -> Self {
        Bench { slow_ripple, ..self }
    }

    /// The same with other recordings of the rig, `usable` as in [`Bench::new`].
    pub fn over<'p>(&self, records: &'p Records, usable: &[f64], fidelity: Fidelity) -> Bench<'p>
    where
        'r: 'p,
    {
        Bench::new(self.rig, records, usable, fidelity).shortened(self.short).beside_slow_ripple(self.slow_ripple)
    }

    /// The same with readings that lack the pump's strokes, on what searches run on.
    pub fn reduced<'p>(&self, records: &'p Records) -> Bench<'p>
    where
        'r: 'p,
    {
        self.over(records, &self.counted, self.fast.fidelity())
    }

    /// The recordings as they would be had the rig's pump no strokes: less what the detailed simulation of `rig` (the
    /// bench's, with its parameters fitted) differs by from the averaged one.
    ///
    /// That difference (ripple as sampled, filling from stroke to stroke) hardly depends on the parameters: one prior
    /// standard deviation of any of the paper's rig changes it by 0.005 kPa at most. Taken from the readings once, it is
    /// out of every fit that follows, and those need no detailed run. Readings that were freed from the ripple have had
    /// it taken out already.
    ///
    /// # Errors
    /// The rig cannot be simulated.
    pub fn without_strokes(&self, rig: &Rig) -> Result<Records, DiagnoseError> {
        if self.simulator.fidelity() == Fidelity::Smooth {
            return Ok(self.records.clone());
        }
        let arcs = refined_starts(&self.fast, rig, &Arcs::free(self.records))?;
        let close = self.close.one(rig, &arcs)?;
        let fast = self.fast.one(rig, &arcs)?;
        let less = self.records.readings_kpa().iter().zip(close.iter().zip(&fast)).map(|(r, (c, f))| r - (c - f));
        Ok(self.records.with_readings(less.collect())?)
    }

    /// Noise by channel in kPa.
    pub fn sigma_kpa(&self) -> Vec<f64> {
        self.noise.iter().map(|n| n.sigma_kpa).collect()
    }

    /// Weights of the readings that are fitted.
    pub fn fit_weights(&self) -> &[f64] {
        &self.fit_weights
    }

    /// Weights of the fitted readings over the scale of each channel.
    pub fn weighted(&self, scale_kpa: &[f64]) -> Vec<f64> {
        let mut weights = self.fit_weights.clone();
        for (_, channel, range) in self.records.layout().all() {
            let scale = scale_kpa.get(channel).copied().unwrap_or(1.0);
            for w in weights.get_mut(range).unwrap_or_default() {
                *w /= scale;
            }
        }
        weights
    }

    /// 1 at readings that count, 0 elsewhere.
    pub fn counted(&self) -> &[f64] {
        &self.counted
    }

    /// Whether errors beyond the noise by channel, in kPa, are more than a model may leave that lacks nothing ([`crate::much`]).
    pub(crate) fn is_much(&self, excess_kpa: &[f64]) -> bool {
        excess_kpa.iter().zip(&self.much_kpa).any(|(kpa, much)| kpa > much)
    }

    /// The rig with terms attached, each at its first start.
    pub fn with_terms(&self, terms: &[&Candidate]) -> Rig {
        let mut rig = self.rig.clone();
        for term in terms {
            rig.mechanisms.push(term.attached(term.starts.first().map_or(&[], Vec::as_slice)));
        }
        rig
    }

    /// The free parameters of an explanation.
    ///
    /// # Errors
    /// A term whose parameters are not the rig's.
    pub fn set(&self, terms: &[&Candidate]) -> Result<ParameterSet, DiagnoseError> {
        let rig = self.with_terms(terms);
        let before = self.rig.mechanisms.len();
        let of_terms = terms.iter().enumerate().flat_map(|(n, term)| term.parameters(before + n));
        let free = self.nominal.iter().cloned().chain(of_terms).collect();
        ParameterSet::new(&rig, free).map_err(DiagnoseError::rig(&rig))
    }

    /// The free parameters with some of the candidates as terms.
    ///
    /// # Errors
    /// As [`Bench::set`].
    pub fn set_of(&self, candidates: &[Candidate], terms: &[usize]) -> Result<ParameterSet, DiagnoseError> {
        self.set(&terms.iter().filter_map(|t| candidates.get(*t)).collect::<Vec<_>>())
    }

    /// Fits an explanation from the best of some starts (coordinates of [`Bench::set`]). What begins later stays within
    /// a little of when it begins in the first of them: rows that are fitted need not show when.
    ///
    /// # Errors
    /// No start can be simulated.
    pub fn fit(
        &self,
        candidates: &[Candidate],
        terms: &[usize],
        starts: &[Vec<f64>],
        effort: Effort,
    ) -> Result<Explanation, DiagnoseError> {
        let mut set = self.set_of(candidates, terms)?;
        let mut at = self.nominal.len();
        for candidate in terms.iter().filter_map(|term| candidates.get(*term)) {
            let start = |onset: usize| starts.first().and_then(|start| start.get(at + onset));
            if let Some((onset, start)) = candidate.onset().and_then(|onset| Some((onset, start(onset)?))) {
                let mut free = set.parameters().to_vec();
                if let Some(parameter) = free.get_mut(at + onset) {
                    let [low, high] = parameter.bounds;
                    let begins_s = parameter.value(*start);
                    let near = [begins_s - ONSET_REACH_S, begins_s + ONSET_REACH_S];
                    parameter.bounds = near.map(|time_s| time_s.clamp(low, high));
                }
                set = ParameterSet::new(set.rig(), free).map_err(DiagnoseError::rig(set.rig()))?;
            }
            at += candidate.len();
        }
        let fitted = self.fit_set(terms, set, starts, effort)?;
        let jumps = terms.iter().filter_map(|term| candidates.get(*term)).any(Candidate::stepped);
        Ok(Explanation { jumps, ..fitted })
    }

    /// Fits a set of parameters from the best of some starts.
    ///
    /// # Errors
    /// No start can be simulated.
    pub fn fit_set(
        &self,
        terms: &[usize],
        set: ParameterSet,
        starts: &[Vec<f64>],
        effort: Effort,
    ) -> Result<Explanation, DiagnoseError> {
        let blocks = self.split.blocks(Role::Fit, BLOCK_ROWS);
        let settings = effort.settings(self.fast.fidelity(), self.short);
        let mut best: Option<(f64, Fitted)> = None;
        let mut failed = None;
        let from = |start: &Vec<f64>| {
            fit_from(self.simulator, &set, start, &self.fit_weights, &self.sigma_kpa(), &blocks, &settings)
        };
        for fitted in side_by_side(starts, from) {
            match fitted {
                Ok(fitted) => {
                    let cost = fitted.comparable_cost(self.records, &self.fit_weights);
                    if best.as_ref().is_none_or(|(least, _)| cost < *least) {
                        best = Some((cost, fitted));
                    }
                }
                Err(error) => failed = Some(error),
            }
        }
        let Some((_, fitted)) = best else { return Err(failed.unwrap_or(FitError::NoRecordings).into()) };
        let trace = self.free_run(&fitted.rig)?;
        let prior_cost = fitted.point.iter().take(self.nominal.len()).map(|z| 0.5 * z * z).sum();
        Ok(Explanation { terms: terms.to_vec(), set, fitted, trace, jumps: false, prior_cost, errors: OnceLock::new() })
    }

    /// A free run over all rows, starts refined.
    ///
    /// # Errors
    /// The rig cannot be simulated.
    pub fn free_run(&self, rig: &Rig) -> Result<Vec<f64>, DiagnoseError> {
        let arcs = refined_starts(&self.simulator, rig, &Arcs::free(self.records))?;
        Ok(self.simulator.one(rig, &arcs)?)
    }

    /// Mean square of what a trace is off on the rows of a role, channels together, in kPa².
    pub fn squares(&self, trace: &[f64], role: Role) -> f64 {
        let layout = self.records.layout();
        let weights = self.split.weights(layout, role);
        let off = trace.iter().zip(self.records.readings_kpa()).zip(weights.iter().zip(&self.counted));
        let counts = off.filter(|(_, (w, counted))| **w != 0.0 && **counted != 0.0);
        let (sum, rows) = counts.fold((0.0, 0.0), |(sum, rows), ((p, r), _)| (sum + (p - r).powi(2), rows + 1.0));
        sum / f64::max(rows, 1.0)
    }

    /// Mean square of what a trace is off by channel on the rows that are fitted or choose, in kPa²; `in_the_middle`, that of the
    /// middle one of all stretches of 2 s.
    pub fn squares_by_channel(&self, trace: &[f64], in_the_middle: bool) -> Vec<f64> {
        let of_channel = |channel: usize| {
            let all = self.squares_of_those(trace, channel, |_| true);
            if in_the_middle {
                let mut means: Vec<f64> = all.iter().map(|(sum, rows)| sum / rows).collect();
                means.sort_by(f64::total_cmp);
                means.get(means.len() / 2).copied().unwrap_or(0.0)
            } else {
                mean_of(&all)
            }
        };
        (0..self.records.layout().channels()).map(of_channel).collect()
    }

    /// Root mean square difference of two traces over some recordings, in the pressure where it is largest, in kPa.
    pub fn most_moved_kpa(&self, one: &[f64], other: &[f64], recordings: Range<usize>) -> f64 {
        let layout = self.records.layout();
        let off = |i: usize| one.get(i).zip(other.get(i)).map_or(0.0, |(a, b)| (a - b).powi(2));
        let of = |channel: usize| {
            let rows = || recordings.clone().flat_map(|record| layout.channel(record, channel));
            (rows().map(off).sum::<f64>() / rows().count().max(1) as f64).sqrt()
        };
        (0..layout.channels()).map(of).fold(0.0, f64::max)
    }

    /// Whether all pumps run throughout a recording, or a piece of one.
    pub fn pumps_run(&self, record: usize) -> bool {
        self.records.relays(self.rig, record).iter().flatten().all(|on| *on)
    }

    /// Mean square of what a trace is off by, all channels added up, in kPa², on the rows that are fitted or choose, of the recordings
    /// and pieces in which all pumps run; of all of them where there are none.
    pub fn squares_at_work(&self, trace: &[f64]) -> f64 {
        let runs: Vec<bool> = (0..self.records.records().len()).map(|record| self.pumps_run(record)).collect();
        let none = runs.iter().all(|runs| !runs);
        self.mean_squares_of(trace, |record| none || runs.get(record) == Some(&true))
    }

    /// Mean square of what a trace is off by, all channels added up, in kPa², on the rows that are fitted or choose: of each recording by
    /// itself, pieces of one together.
    pub fn squares_by_recording(&self, trace: &[f64]) -> Vec<f64> {
        let records = self.records.records();
        let mut sources: Vec<&str> = records.iter().map(|record| record.source.as_str()).collect();
        sources.dedup();
        let is_of = |source: &str, record: usize| records.get(record).is_some_and(|record| record.source == source);
        sources.into_iter().map(|source| self.mean_squares_of(trace, |record| is_of(source, record))).collect()
    }

    /// Mean square of what a trace is off by in some recordings, all channels added up.
    fn mean_squares_of(&self, trace: &[f64], asked: impl Fn(usize) -> bool) -> f64 {
        let channels = 0..self.records.layout().channels();
        channels.map(|channel| mean_of(&self.squares_of_those(trace, channel, &asked))).sum()
    }

    /// Sum of squares of what a trace is off in a channel, and readings that count, for every stretch of 2 s of the rows of some
    /// recordings that are fitted or choose.
    fn squares_of_those(&self, trace: &[f64], channel: usize, asked: impl Fn(usize) -> bool) -> Vec<(f64, f64)> {
        let layout = self.records.layout();
        let known = self.split.stretches().iter().filter(|s| s.role != Role::HeldOut && asked(s.record));
        let pieces = known.flat_map(|s| {
            s.rows.clone().step_by(SHORT_ROWS).map(|from| (s.record, from..s.rows.end.min(from + SHORT_ROWS)))
        });
        let squares = |(record, rows): (usize, Range<usize>)| -> (f64, f64) {
            let of = |values: &[f64], i: usize| values.get(i).copied().unwrap_or(0.0);
            let counted = layout.stretch(record, channel, rows).filter(|i| of(&self.counted, *i) != 0.0);
            let off = counted.map(|i| of(trace, i) - of(self.records.readings_kpa(), i));
            off.fold((0.0, 0.0), |(sum, rows), off| (sum + off * off, rows + 1.0))
        };
        pieces.map(squares).filter(|(_, rows)| *rows > 0.0).collect()
    }

    /// Groups of readings whose residuals may belong together: blocks of time that are fitted, and states of the plant.
    pub fn groupings(&self) -> [Vec<usize>; 2] {
        [by_time(self.records, &self.split.blocks(Role::Fit, BLOCK_ROWS)), by_state(self.records)]
    }

    /// Log-likelihood of a trace on the blocks of a role, some errors allowed for.
    pub fn score(&self, trace: &[f64], role: Role, allowed: &Allowed) -> Score {
        self.score_on(trace, &self.blocks(role), allowed)
    }

    /// As [`Bench::score`] on the rows that choose, in blocks of 4 s.
    pub fn score_finely(&self, trace: &[f64], allowed: &Allowed) -> Score {
        self.score_on(trace, &self.split.blocks(Role::Select, FINE_ROWS), allowed)
    }

    fn score_on(&self, trace: &[f64], blocks: &[Stretch], allowed: &Allowed) -> Score {
        let Allowed { drift_kpa, time_s, heavy, sigma_kpa } = allowed.clone();
        score(self.records, trace, &self.counted, blocks, &NoiseModel::Drifting { sigma_kpa, drift_kpa, time_s, heavy })
    }

    /// The errors that a trace has: the sizes at which they are likeliest on the fitted rows.
    ///
    /// Estimated from plateaus they would be the noise's own colour, estimated from a model that lacks something they would
    /// explain away what is to be found; so they are asked of the better of two explanations alone.
    pub fn drift_of(&self, trace: &[f64]) -> Allowed {
        let [slow, fast] = DRIFT_S;
        let kinds = [(slow, false), (fast, false), (slow, true), (fast, true)];
        let all = side_by_side(&kinds, |(time_s, heavy)| self.errors_of(trace, *time_s, *heavy));
        // The first of equals.
        let likeliest = all.into_iter().reduce(|best, other| if other.0 > best.0 { other } else { best });
        likeliest.map_or_else(|| self.errors_of(trace, slow, false).1, |(_, allowed)| allowed)
    }

    /// The likeliest sizes of errors of a given correlation time, with their log-likelihood.
    fn errors_of(&self, trace: &[f64], time_s: f64, heavy: bool) -> (f64, Allowed) {
        let noise = self.sigma_kpa();
        let mut best: Vec<(f64, f64, f64)> = noise.iter().map(|s| (f64::NEG_INFINITY, DRIFTS_KPA[0], *s)).collect();
        for rougher in ROUGHER {
            let sigma_kpa: Vec<f64> = noise.iter().map(|s| rougher * s).collect();
            for drift in DRIFTS_KPA {
                let drift_kpa = vec![drift; noise.len()];
                let allowed = Allowed { drift_kpa, time_s, heavy, sigma_kpa: sigma_kpa.clone() };
                let score = self.score(trace, Role::Fit, &allowed);
                for (channel, best) in best.iter_mut().enumerate() {
                    let of = |b: &BlockScore| b.log_likelihood.get(channel).copied().unwrap_or(0.0);
                    let sum: f64 = score.blocks.iter().map(of).sum();
                    if sum > best.0 {
                        *best = (sum, drift, sigma_kpa.get(channel).copied().unwrap_or(0.0));
                    }
                }
            }
        }
        let (drift_kpa, sigma_kpa) = (best.iter().map(|b| b.1).collect(), best.iter().map(|b| b.2).collect());
        (best.iter().map(|b| b.0).sum(), Allowed { drift_kpa, time_s, heavy, sigma_kpa })
    }

    /// Blocks of a role.
    pub fn blocks(&self, role: Role) -> Vec<Stretch> {
        blocks_of(&self.split, role)
    }
}

/// Mean of squares that are told as sums and their rows.
fn mean_of(stretches: &[(f64, f64)]) -> f64 {
    let (sum, rows) = stretches.iter().fold((0.0, 0.0), |(sum, rows), (s, r)| (sum + s, rows + r));
    sum / f64::max(rows, 1.0)
}

/// What searches run on where the recordings are simulated at a fidelity.
pub fn searching(fidelity: Fidelity) -> Fidelity {
    if fidelity == Fidelity::Smooth { fidelity } else { Fidelity::Averaged }
}

/// Rows of a block: 10 s, several time constants of the slowest chamber.
const BLOCK_ROWS: usize = 500;
/// Rows of a short stretch: 2 s.
const SHORT_ROWS: usize = 100;
/// Rows of a fine block: 4 s.
const FINE_ROWS: usize = 200;
