//! A fit: stages of least squares, from several starts.
//!
//! Free runs far from the truth lead a search astray (a wrong volume is hidden behind a wrong valve), short windows
//! determine slow effects badly. So a fit from each start goes through windows first and ends with free runs. Residuals
//! are weighted by the noise, or by their own scale where that is larger: a model that is wrong by ten times the
//! noise would otherwise make Student's loss look at the rows it already fits and at no others.
//!
//! Slopes cost far more than trials, and close simulations more than fast ones. So all searches run on a fast simulation,
//! corrected by what the close one says otherwise at the point where the search before ended (defect correction, Stetter
//! 1978: the end is the close one's minimum). Windows, and free runs at first, take one-sided slopes; then slopes are
//! worked out once, on both sides, and kept while the search ends and the scale settles (chord method). Other starts are
//! followed to the minimum that they share with borrowed slopes; one that ends elsewhere gets its own.
//!
//! Slopes of the close simulation would not do better. A piston pump at fixed steps is rough: check valves open a step
//! sooner or later, which moves readings by 1e-3 kPa at steps of 0.4 ms, a fine structure in the parameters that no real
//! pump has. As slopes it looks like knowledge of combinations that hardly show (measured: information of 140 along one
//! that has 60, and errors of twice the stated ones). Averaged pumps have none of it.

use super::fitted::{Fitted, estimates, rmse};
use super::groups::{by_state, by_time};
use super::problem::{RigProblem, Sides, Slopes};
use crate::FitError;
use crate::data::{Records, Stretch, deviation};
use crate::least_squares::{Information, Linearised, Loss, Outcome, Problem, Settings, Stop, minimise};
use crate::parameters::ParameterSet;
use crate::simulate::{Arcs, Fidelity, Simulator, refined_starts, smoothed_kpa};
use model::rig::Rig;

/// Where simulations start anew during a stage of a fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shooting {
    /// In windows of this many seconds.
    Windows {
        /// Length in s.
        seconds: f64,
    },
    /// Nowhere: free runs.
    Free,
}

/// Settings of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct FitSettings {
    /// The loss.
    pub loss: Loss,
    /// Stages, in order; each starts where the one before ended.
    pub stages: Vec<Shooting>,
    /// The most Jacobians in a stage.
    pub rounds: usize,
    /// A stage is done when a step gains less log-likelihood than this.
    pub least_gain: f64,
    /// The most passes of the last stage.
    pub passes: usize,
    /// A pass that gains less log-likelihood than this is at rest.
    pub rest: f64,
    /// Fidelity that the search runs at. The minimum is that of the simulator's own fidelity all the same.
    pub search: Fidelity,
}

impl Default for FitSettings {
    fn default() -> Self {
        FitSettings {
            loss: Loss::Student { freedom: 5.0 },
            stages: vec![Shooting::Windows { seconds: 2.0 }, Shooting::Free],
            rounds: 12,
            // Kept slopes converge by about a half a round where parameters hardly show: what is left is a third of this.
            least_gain: 0.05,
            passes: 8,
            rest: 1.0,
            search: Fidelity::Averaged,
        }
    }
}

/// Fits from several starts and returns the best; the others' costs tell whether they agree.
///
/// `weights` is 1 at readings that are fitted and 0 elsewhere, `sigma_kpa` the noise by channel. `blocks` are the
/// stretches of time that count as independent for uncertainties. `watch` is told of every round.
///
/// # Errors
/// No start can be simulated.
#[expect(clippy::too_many_arguments, reason = "what is fitted to what, and who is told")]
pub fn fit(
    simulator: Simulator<'_>,
    set: &ParameterSet,
    starts: &[Vec<f64>],
    weights: &[f64],
    sigma_kpa: &[f64],
    blocks: &[Stretch],
    settings: &FitSettings,
    watch: &mut dyn FnMut(),
) -> Result<(Fitted, Vec<f64>), FitError> {
    Task { simulator, set, weights, sigma_kpa, blocks, settings }.over_starts(starts, watch)
}

/// Fits from one start.
///
/// # Errors
/// The start cannot be simulated.
pub fn fit_from(
    simulator: Simulator<'_>,
    set: &ParameterSet,
    start: &[f64],
    weights: &[f64],
    sigma_kpa: &[f64],
    blocks: &[Stretch],
    settings: &FitSettings,
) -> Result<Fitted, FitError> {
    let task = Task { simulator, set, weights, sigma_kpa, blocks, settings };
    let near = task.approach(start, &mut || {})?;
    Ok(task.finish(near, None, &mut || {})?.0)
}

/// A fit to be made: what is fitted to what, and how.
struct Task<'t> {
    simulator: Simulator<'t>,
    set: &'t ParameterSet,
    weights: &'t [f64],
    sigma_kpa: &'t [f64],
    blocks: &'t [Stretch],
    settings: &'t FitSettings,
}

/// Where the stages before the last one ended, and the Jacobians that took.
struct Near {
    point: Vec<f64>,
    rounds: usize,
}

/// Where runs start, what the fast ones lack, what residuals are weighted by.
struct Setting {
    arcs: Arcs,
    correction_kpa: Vec<f64>,
    scale_kpa: Vec<f64>,
    weights: Vec<f64>,
}

/// Starts whose costs differ by less are at the same minimum: by so much the noise moves a cost anyway.
const SAME_COST: f64 = 2.0;
/// Coordinates within which slopes stay good to a few per cent.
const SLOPES_REACH: f64 = 0.3;

impl Task<'_> {
    fn over_starts(&self, starts: &[Vec<f64>], watch: &mut dyn FnMut()) -> Result<(Fitted, Vec<f64>), FitError> {
        let mut best: Option<(Fitted, Slopes, f64)> = None;
        let mut costs = Vec::new();
        let mut failed = None;
        for start in starts {
            let slopes = best.as_ref().map(|(_, slopes, _)| slopes.clone());
            let known = best.as_ref().map(|(.., cost)| *cost);
            match self.one_start(start, slopes, known, watch) {
                Ok((fitted, slopes, cost)) => {
                    costs.push(cost);
                    if known.is_none_or(|known| cost < known - SAME_COST) {
                        best = Some((fitted, slopes, cost));
                    }
                }
                Err(error) => failed = Some(error),
            }
        }
        match best {
            Some((fitted, ..)) => Ok((fitted, costs)),
            None => Err(failed.unwrap_or(FitError::NoRecordings)),
        }
    }

    /// From one start; `slopes` and cost `known` are those of a minimum that it may share.
    fn one_start(
        &self,
        start: &[f64],
        slopes: Option<Slopes>,
        known: Option<f64>,
        watch: &mut dyn FnMut(),
    ) -> Result<(Fitted, Slopes, f64), FitError> {
        // Costs are relative to each fit's own scale; likelihoods make them comparable.
        let cost = |fitted: &Fitted| fitted.comparable_cost(self.simulator.records(), self.weights);
        let mut near = self.approach(start, watch)?;
        if let (Some(slopes), Some(known)) = (slopes, known) {
            let (fitted, slopes) = self.finish(Near { point: near.point.clone(), ..near }, Some(slopes), watch)?;
            let reached = cost(&fitted);
            if (reached - known).abs() < SAME_COST {
                return Ok((fitted, slopes, reached));
            }
            near = Near { point: fitted.point, rounds: fitted.rounds };
        }
        let (fitted, slopes) = self.finish(near, None, watch)?;
        let reached = cost(&fitted);
        Ok((fitted, slopes, reached))
    }

    fn search(&self, from: &[f64], rounds: usize, least_gain: f64) -> Settings {
        Settings {
            loss: self.settings.loss,
            prior: self.set.prior(),
            bounds: self.set.search_bounds(from),
            rounds,
            // Where slopes are kept two at a time take a third of the time, and more rounds, and ended elsewhere in long valleys.
            trials: 8,
            least_gain,
            needed: f64::INFINITY,
        }
    }

    fn rig_at(&self, point: &[f64]) -> Result<Rig, FitError> {
        self.set.rig_at(point).map_err(FitError::rig(self.set.rig()))
    }

    /// All stages but the last: from anywhere to the neighbourhood of a minimum.
    fn approach(&self, start: &[f64], watch: &mut dyn FnMut()) -> Result<Near, FitError> {
        let records = self.simulator.records();
        let fast = self.simulator.at(self.settings.search);
        let ends = ends(records, self.weights);
        let mut near = Near { point: start.to_vec(), rounds: 0 };
        let stages = self.settings.stages.split_last().map_or(&[][..], |(_, before)| before);
        for shooting in stages {
            let rig = self.rig_at(&near.point)?;
            let arcs = arcs_for(fast, &rig, *shooting, &ends)?;
            let scale = scales(records, &fast.one(&rig, &arcs)?, self.weights, self.sigma_kpa);
            let weighted = over(records, self.weights, &scale);
            let mut problem = RigProblem::new(fast, self.set, arcs, weighted).on(Sides::One);
            let search = self.search(&near.point, self.settings.rounds.min(6), 1.0);
            let outcome = minimise(&mut Watched { problem: &mut problem, watch }, &near.point, &search)?;
            near = Near { point: outcome.point, rounds: near.rounds + outcome.rounds };
        }
        Ok(near)
    }

    /// The last stage: searches with the fast simulation, corrected by what the close one says otherwise where the
    /// search before it ended, until neither the correction nor the scale moves the minimum any more.
    fn finish(
        &self,
        near: Near,
        borrowed: Option<Slopes>,
        watch: &mut dyn FnMut(),
    ) -> Result<(Fitted, Slopes), FitError> {
        let Near { mut point, mut rounds } = near;
        let borrowing = borrowed.is_some();
        let mut known = borrowed.map(|slopes| (slopes, point.clone()));
        let mut before: Option<(Vec<f64>, Vec<f64>)> = None;
        let mut last: Option<(Outcome, Setting)> = None;
        let mut gained = f64::INFINITY;
        let passes = if borrowing { 1 } else { self.settings.passes };
        let (mut pass, mut widened) = (0, 0);
        while pass < passes {
            let setting = self.setting(&self.rig_at(&point)?)?;
            let at_rest =
                |(old, at): &(Vec<f64>, Vec<f64>)| settled(old, &setting.scale_kpa) && near_to(at, &point, 0.1);
            if known.is_some() && gained < self.settings.rest && before.as_ref().is_some_and(at_rest) {
                break;
            }
            before = Some((setting.scale_kpa.clone(), point.clone()));
            // The first pass may have far to go: slopes anew in every round, on one side. The others begin near its end.
            let approaching = pass == 0 && !borrowing;
            // Where parameters can stand in for each other, slopes from a little way off lead on for a little way only.
            let good = |at: &[f64]| gained < self.settings.rest && near_to(at, &point, SLOPES_REACH);
            let slopes = known.take().filter(|(_, at)| borrowing || good(at));
            let at = slopes.as_ref().map_or_else(|| point.clone(), |(_, at)| at.clone());
            rounds += usize::from(slopes.is_none() && !approaching);
            let mut problem = self.problem(&setting);
            problem =
                if approaching { problem.on(Sides::One) } else { problem.keeping(slopes.map(|(slopes, _)| slopes)) };
            let search = match (approaching, borrowing) {
                (true, _) => self.search(&point, self.settings.rounds, APPROACH_GAIN),
                (false, true) => self.search(&point, FOLLOWED, self.settings.least_gain),
                (false, false) => self.search(&point, self.settings.rounds, self.settings.least_gain),
            };
            let outcome = minimise(&mut Watched { problem: &mut problem, watch }, &point, &search)?;
            let cut_off = self.set.was_cut_off(&point, &outcome.point) && widened < WIDENINGS;
            point.clone_from(&outcome.point);
            if approaching {
                rounds += outcome.rounds;
            } else if !cut_off {
                gained = outcome.gained;
                known = problem.into_slopes().map(|(slopes, _)| (slopes, at));
            }
            last = Some((outcome, setting));
            // A number at the end of its range is no answer: the same pass again from there, where the range is wider.
            if cut_off {
                widened += 1;
                gained = f64::INFINITY;
            } else {
                pass += 1;
            }
        }
        let Some(last) = last else { return Err(FitError::NoRecordings) };
        let slopes = known.filter(|(_, at)| near_to(at, &point, SLOPES_REACH)).map(|(slopes, _)| slopes);
        self.fitted(point, rounds, last, slopes)
    }

    /// Residuals by the fast simulation, corrected.
    fn problem(&self, setting: &Setting) -> RigProblem<'_> {
        let fast = self.simulator.at(self.settings.search);
        RigProblem::new(fast, self.set, setting.arcs.clone(), setting.weights.clone())
            .corrected(setting.correction_kpa.clone())
    }

    /// Setting in which the last stage's residuals are made at a point.
    fn setting(&self, rig: &Rig) -> Result<Setting, FitError> {
        let Some(shooting) = self.settings.stages.last() else { return Err(FitError::NoRecordings) };
        let records = self.simulator.records();
        let fast = self.simulator.at(self.settings.search);
        let arcs = arcs_for(fast, rig, *shooting, &ends(records, self.weights))?;
        let trace = self.simulator.one(rig, &arcs)?;
        let correction_kpa = if fast.fidelity() == self.simulator.fidelity() {
            Vec::new()
        } else {
            let quick = fast.one(rig, &arcs)?;
            trace.iter().zip(&quick).map(|(close, quick)| close - quick).collect()
        };
        let scale_kpa = scales(records, &trace, self.weights, self.sigma_kpa);
        let weights = over(records, self.weights, &scale_kpa);
        Ok(Setting { arcs, correction_kpa, scale_kpa, weights })
    }

    fn fitted(
        &self,
        point: Vec<f64>,
        rounds: usize,
        (outcome, setting): (Outcome, Setting),
        slopes: Option<Slopes>,
    ) -> Result<(Fitted, Slopes), FitError> {
        let records = self.simulator.records();
        let groupings = [by_time(records, self.blocks), by_state(records)];
        let mut problem = self.problem(&setting).keeping(slopes);
        let linearised = problem.linearise(&point)?;
        let information = Information::of(&linearised, self.settings.loss, &self.set.prior(), &groupings);
        let sd = information.as_ref().map_or_else(|| vec![f64::INFINITY; self.set.len()], Information::cautious_sd);
        let (slopes, starts) = problem.into_slopes().ok_or(FitError::NoRecordings)?;
        let Setting { arcs, scale_kpa, .. } = setting;
        let fitted = Fitted {
            estimates: estimates(self.set, &point, &sd),
            rmse_kpa: rmse(records, &outcome.linearised.residuals, self.weights, &scale_kpa),
            rig: self.rig_at(&point)?,
            point,
            cost: outcome.cost,
            loss: self.settings.loss,
            converged: !matches!(outcome.stop, Stop::Rounds | Stop::Behind),
            rounds,
            information,
            linearised,
            scale_kpa,
            arcs,
            starts,
        };
        Ok((fitted, slopes))
    }
}

/// A problem whose rounds are told.
struct Watched<'w, 'p> {
    problem: &'w mut RigProblem<'p>,
    watch: &'w mut dyn FnMut(),
}

impl Problem for Watched<'_, '_> {
    fn linearise(&mut self, point: &[f64]) -> Result<Linearised, FitError> {
        (self.watch)();
        self.problem.linearise(point)
    }

    fn residuals(&mut self, points: &[Vec<f64>]) -> Vec<Option<Vec<f64>>> {
        self.problem.residuals(points)
    }
}

/// Gain that a round must have while slopes are taken on one side: they are off by a per cent, and along a valley a search that
/// follows them crawls.
const APPROACH_GAIN: f64 = 5.0;
/// Times that ranges are widened in the last stage: from five times what was stated to ten thousand times takes as many.
const WIDENINGS: usize = 6;
/// Rounds that borrowed slopes are followed for: another minimum shows by then.
const FOLLOWED: usize = 4;

/// Tells whether a scale has hardly changed.
fn settled(old: &[f64], new: &[f64]) -> bool {
    old.iter().zip(new).all(|(a, b)| (a / b - 1.0).abs() < 0.1)
}

/// Tells whether two points are within `reach` of each other in every coordinate. (Within a tenth of a prior deviation
/// the correction of the fast simulation does not change.)
fn near_to(old: &[f64], new: &[f64], reach: f64) -> bool {
    old.iter().zip(new).all(|(a, b)| (a - b).abs() < reach)
}

/// Where simulations may stop: after the last row that counts, by recording.
fn ends(records: &Records, weights: &[f64]) -> Vec<usize> {
    let layout = records.layout();
    let mut ends = vec![0; layout.records()];
    for (record, _, range) in layout.all() {
        let last = weights.get(range).and_then(|w| w.iter().rposition(|w| *w != 0.0)).map_or(0, |row| row + 1);
        if let Some(end) = ends.get_mut(record) {
            *end = last.max(*end);
        }
    }
    ends
}

fn arcs_for(simulator: Simulator<'_>, rig: &Rig, shooting: Shooting, ends: &[usize]) -> Result<Arcs, FitError> {
    let records = simulator.records();
    let free = refined_starts(&simulator, rig, &Arcs::led(records).until(ends))?;
    match shooting {
        Shooting::Free => Ok(free),
        Shooting::Windows { seconds } => {
            let trace = simulator.one(rig, &free)?;
            let rows = ((seconds / proto::recording::PERIOD_S).round() as usize).max(2);
            Ok(Arcs::windows(records, rows, &smoothed_kpa(records, &trace)).with_flappers_of(&free).until(ends))
        }
    }
}

/// Scale of the residuals by channel: the noise, or what they scatter by (median absolute value) where that is more.
fn scales(records: &Records, trace: &[f64], weights: &[f64], sigma_kpa: &[f64]) -> Vec<f64> {
    let layout = records.layout();
    (0..layout.channels())
        .map(|channel| {
            let mut sizes: Vec<f64> = (0..layout.records())
                .flat_map(|record| layout.channel(record, channel))
                .filter(|i| weights.get(*i).is_some_and(|w| *w != 0.0))
                .map(|i| (trace.get(i).unwrap_or(&0.0) - records.readings_kpa().get(i).unwrap_or(&0.0)).abs())
                .collect();
            deviation(&mut sizes).max(sigma_kpa.get(channel).copied().unwrap_or(0.0)).max(1e-6)
        })
        .collect()
}

/// `weights` over the scale of each channel.
fn over(records: &Records, weights: &[f64], scale_kpa: &[f64]) -> Vec<f64> {
    let mut weighted = weights.to_vec();
    for (_, channel, range) in records.layout().all() {
        let scale = scale_kpa.get(channel).copied().unwrap_or(1.0);
        for w in weighted.get_mut(range).unwrap_or_default() {
            *w /= scale;
        }
    }
    weighted
}
