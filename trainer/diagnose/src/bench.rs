//! The bench on which explanations are tried: recordings, their split and noise, and fits of a rig with terms.

mod errors;
mod explanation;
mod squares;

use std::sync::OnceLock;

use fit::FitError;
use fit::cores::side_by_side;
use fit::data::{Noise, Records, Role, Split, Stretch, noise};
use fit::least_squares::Loss;
use fit::objective::{FitSettings, Fitted, Shooting, blocks_of, by_state, by_time, fit_from};
use fit::parameters::{Parameter, ParameterSet, Scatter, nominal};
use fit::simulate::{Arcs, Fidelity, Simulator, refined_starts};
use model::rig::Rig;

use crate::error::DiagnoseError;
use crate::judge::large_error::{a_name_may_leave_kpa, much_kpa};
use crate::search::candidate::Candidate;

pub use errors::Allowed;
pub use explanation::Explanation;

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
    /// True where fits are those of a short search: they come to rest sooner.
    pub short: bool,
    /// True where a ripple was taken out that turned about once in a recording ([`Bench::beside_slow_ripple`]).
    pub slow_ripple: bool,
    fit_weights: Vec<f64>,
    counted: Vec<f64>,
    much_kpa: Vec<f64>,
}

/// The loss of all fits.
pub const LOSS: Loss = Loss::Student { freedom: 5.0 };

/// Furthest that a fit moves an onset, in s: a row or two more than the steps in which onsets are looked for.
const ONSET_REACH_S: f64 = 0.1;

/// Thoroughness of a fit.
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
            // Further away a parameter takes up what is missing, as a line's resistance of a fortieth takes up a valve's dead zone.
            nominal: nominal(rig, Scatter::default()).into_iter().map(Parameter::near_its_mean).collect(),
            fit_weights: split.weights(records.layout(), Role::Fit).iter().zip(usable).map(|(w, u)| w * u).collect(),
            counted: usable.to_vec(),
            much_kpa: much_kpa(records, usable, &noise),
            short: false,
            slow_ripple: false,
            split,
            noise,
        }
    }

    /// This bench with fits of a short search, or of a whole one.
    #[must_use]
    pub fn shortened(self, short: bool) -> Self {
        Bench { short, ..self }
    }

    /// This bench with readings that a ripple was taken out of which turned about once in a recording, or with others: what it was
    /// predicted wrong by is left, as slow as a drift.
    #[must_use]
    pub fn beside_slow_ripple(self, slow_ripple: bool) -> Self {
        Bench { slow_ripple, ..self }
    }

    /// This bench with readings that were rounded to these steps by channel, in kPa, before something was taken out of them: the
    /// steps show no more, and the rounding's own noise is in the readings as before.
    #[must_use]
    pub(crate) fn rounded_to(mut self, steps_kpa: &[f64]) -> Self {
        for (noise, step_kpa) in self.noise.iter_mut().zip(steps_kpa) {
            noise.step_kpa = noise.step_kpa.max(*step_kpa);
            noise.sigma_kpa = noise.sigma_kpa.max(step_kpa / 12.0_f64.sqrt());
        }
        self.much_kpa = much_kpa(self.records, &self.counted, &self.noise);
        self
    }

    /// Steps by channel that readings were rounded to, in kPa; 0 where none shows.
    pub(crate) fn steps_kpa(&self) -> Vec<f64> {
        self.noise.iter().map(|noise| noise.step_kpa).collect()
    }

    /// A bench over other recordings of the rig, `usable` as in [`Bench::new`].
    pub fn over<'p>(&self, records: &'p Records, usable: &[f64], fidelity: Fidelity) -> Bench<'p>
    where
        'r: 'p,
    {
        Bench::new(self.rig, records, usable, fidelity)
            .shortened(self.short)
            .beside_slow_ripple(self.slow_ripple)
            .rounded_to(&self.steps_kpa())
    }

    /// A bench over readings that lack the pump's strokes, at the fidelity that searches run at.
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
        let arcs = refined_starts(&self.fast, rig, &Arcs::led(self.records))?;
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

    /// Lowest and highest of the open air and of the readings that count, by channel in kPa gauge.
    pub(crate) fn recorded_kpa(&self) -> Vec<[f64; 2]> {
        let layout = self.records.layout();
        let mut recorded = vec![[0.0_f64; 2]; layout.channels()];
        for (_, channel, range) in layout.all() {
            let Some([low, high]) = recorded.get_mut(channel) else { continue };
            let counts = range.filter(|i| self.counted.get(*i).is_some_and(|w| *w != 0.0));
            for kpa in counts.filter_map(|i| self.records.readings_kpa().get(i)).filter(|kpa| kpa.is_finite()) {
                (*low, *high) = (low.min(*kpa), high.max(*kpa));
            }
        }
        recorded
    }

    /// Tells whether errors beyond the noise by channel, in kPa, are more than a model may leave that lacks nothing
    /// ([`crate::judge::large_error`]).
    pub(crate) fn is_much(&self, excess_kpa: &[f64]) -> bool {
        excess_kpa.iter().zip(&self.much_kpa).any(|(kpa, much)| kpa > much)
    }

    /// Tells whether errors beyond the noise by channel, in kPa, are more than what is named may leave, unless it explains most
    /// ([`crate::judge::large_error`]).
    pub(crate) fn is_more_than_a_name_may_leave(&self, excess_kpa: &[f64]) -> bool {
        excess_kpa.iter().zip(&self.noise).any(|(kpa, noise)| *kpa > a_name_may_leave_kpa(noise))
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
        let arcs = refined_starts(&self.simulator, rig, &Arcs::led(self.records))?;
        Ok(self.simulator.one(rig, &arcs)?)
    }

    /// Groups of readings whose residuals may belong together: blocks of time that are fitted, and states of the plant.
    pub fn groupings(&self) -> [Vec<usize>; 2] {
        [by_time(self.records, &self.split.blocks(Role::Fit, BLOCK_ROWS)), by_state(self.records)]
    }

    /// Blocks of a role.
    pub fn blocks(&self, role: Role) -> Vec<Stretch> {
        blocks_of(&self.split, role)
    }
}

/// Fidelity that searches run at where the recordings are simulated at `fidelity`.
pub fn searching(fidelity: Fidelity) -> Fidelity {
    if fidelity == Fidelity::Smooth { fidelity } else { Fidelity::Averaged }
}

/// Rows of a block: 10 s, several time constants of the slowest chamber.
const BLOCK_ROWS: usize = 500;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::made::{made_after, moved};

    /// Readings in steps of 0.5 kPa of a rig that is as stated: less the pump's strokes they lie on no steps, and are as coarse.
    #[test]
    fn readings_less_strokes_are_as_coarse_as_they_came() {
        const STEP_KPA: f64 = 0.5;
        let (rig, _) = moved(&[]);
        let records = Records::new(&rig, &made_after(0, 1500, &rig, 1, 4)).unwrap();
        let usable = vec![1.0; records.layout().len()];
        let exact = Bench::new(&rig, &records, &usable, Fidelity::Detailed).free_run(&rig).unwrap();
        let rounded = exact.iter().map(|kpa| (kpa / STEP_KPA).round() * STEP_KPA).collect();
        let records = records.with_readings(rounded).unwrap();
        let bench = Bench::new(&rig, &records, &usable, Fidelity::Detailed);
        let less = bench.without_strokes(&rig).unwrap();
        let reduced = bench.reduced(&less);
        for sigma_kpa in reduced.sigma_kpa() {
            assert!(sigma_kpa >= STEP_KPA / 12.0_f64.sqrt(), "{sigma_kpa}");
        }
        // What is no larger than the noise is never much: the limit has not shrunk with readings that lie on no steps any more.
        assert!(!reduced.is_much(&[0.99 * STEP_KPA / 12.0_f64.sqrt(); 2]));
    }
}
