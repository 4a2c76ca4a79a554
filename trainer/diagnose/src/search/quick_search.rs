//! A quick look at an explanation: a search with slopes that another one has worked out already.
//!
//! Nearly all of a fit's time goes into the slopes of the rig's own parameters. Those hardly change when a term is
//! added, so a glance keeps the ones of its base (the chord method) and works out only those of the new terms, anew in
//! every round, for their effect is not linear in a delay or a time constant. It runs with the pump averaged, every
//! trace corrected by what the detailed base differs from its averaged self.

use fit::FitError;
use fit::least_squares::{Linearised, Problem, Settings, minimise};
use fit::objective::{Projection, difference_step};
use fit::parameters::ParameterSet;
use fit::simulate::{Arcs, Run, Simulator, with_flappers};
use model::rig::RigError;

use crate::bench::{Bench, Explanation, LOSS};
use crate::error::DiagnoseError;

/// Steps tried at once.
const TRIALS: usize = 8;
/// Cost by which something is behind after a glance that no fit is spent on it.
const FAR_BEHIND: f64 = 100.0;

/// Arcs, weights, correction and slopes that glances share.
#[derive(Debug, Clone)]
pub struct Footing {
    /// Where simulations start.
    pub arcs: Arcs,
    /// Weight of each reading, 1/kPa.
    pub weights: Vec<f64>,
    /// Detailed less averaged, in kPa.
    pub correction_kpa: Vec<f64>,
    /// Slopes of the rig's own parameters, weighted.
    slopes: Vec<Vec<f64>>,
    /// Effects of the starts, taken out of the slopes and of every residual and slope beside them.
    starts: Projection,
    /// Cost of the base.
    pub cost: f64,
}

/// Where a glance ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Glanced {
    /// Cost, comparable with [`Footing::cost`].
    pub cost: f64,
    /// Coordinates.
    pub point: Vec<f64>,
}

impl Footing {
    /// Footing of glances on top of an explanation.
    ///
    /// # Errors
    /// The explanation's rig cannot be simulated.
    pub fn of(bench: &Bench<'_>, base: &Explanation) -> Result<Footing, DiagnoseError> {
        let (rig, arcs) = (&base.fitted.rig, base.fitted.arcs.clone());
        let close = bench.simulator.one(rig, &arcs)?;
        let correction_kpa = if bench.simulator.fidelity() == bench.fast.fidelity() {
            Vec::new()
        } else {
            let fast = bench.fast.one(rig, &arcs)?;
            close.iter().zip(&fast).map(|(c, f)| c - f).collect()
        };
        let weights = bench.weighted(&base.fitted.scale_kpa);
        let starts = base.fitted.starts.clone();
        let mut residuals = weighted(bench.records.readings_kpa(), &close, &[], &weights);
        starts.apply(&mut residuals);
        let slopes = base.fitted.linearised.jacobian.iter().take(bench.nominal.len()).cloned().collect();
        Ok(Footing {
            cost: residuals.iter().map(|r| LOSS.cost(*r)).sum::<f64>() + base.set.prior_cost(&base.fitted.point),
            arcs,
            weights,
            correction_kpa,
            slopes,
            starts,
        })
    }

    /// Footing of glances from the rig as it was given, with the terms of a fitted `base`, whose cost it has: parameters that have
    /// given way have slopes of their own.
    ///
    /// # Errors
    /// The rig cannot be simulated.
    pub fn of_given(bench: &Bench<'_>, base: &Explanation) -> Result<Footing, DiagnoseError> {
        let mut footing = Footing { slopes: Vec::new(), ..Footing::of(bench, base)? };
        let arcs = footing.arcs.clone();
        let mut problem = Chord { simulator: bench.fast, set: &base.set, footing: &footing, arcs };
        let given = problem.linearise(&base.as_given(bench))?;
        footing.slopes = given.jacobian.into_iter().take(bench.nominal.len()).collect();
        Ok(footing)
    }

    /// A few rounds from each start; the best end. `None` if no start can be simulated. What is not on its way to a cost of
    /// `needed`, or to the best end so far, is followed no further: it ends where it is.
    pub fn glance(
        &self,
        bench: &Bench<'_>,
        set: &ParameterSet,
        starts: &[Vec<f64>],
        rounds: usize,
        needed: f64,
    ) -> Option<Glanced> {
        let (prior, bounds) = (set.prior(), set.bounds());
        let mut settings = Settings { loss: LOSS, prior, bounds, rounds, trials: TRIALS, least_gain: 1.0, needed };
        let mut best: Option<Glanced> = None;
        for start in starts {
            // A flapper that is new to the rig lies where its first seconds fit best.
            let Ok(rig) = set.rig_at(start) else { continue };
            let arcs = with_flappers(&bench.fast, &rig, &self.arcs);
            let mut problem = Chord { simulator: bench.fast, set, footing: self, arcs };
            if let Ok(outcome) = minimise(&mut problem, start, &settings)
                && best.as_ref().is_none_or(|best| outcome.cost < best.cost)
            {
                best = Some(Glanced { cost: outcome.cost, point: outcome.point });
                settings.needed = needed.min(outcome.cost);
            }
        }
        best
    }

    /// A glance at what is to stand in place of this base; `None` where it is far behind.
    pub fn contender(
        &self,
        bench: &Bench<'_>,
        set: &ParameterSet,
        starts: &[Vec<f64>],
        rounds: usize,
    ) -> Option<Glanced> {
        self.contender_within(bench, set, starts, rounds, FAR_BEHIND)
    }

    /// A glance as by [`Footing::contender`] at what may be behind by as much as `behind`, if that is more.
    pub fn contender_within(
        &self,
        bench: &Bench<'_>,
        set: &ParameterSet,
        starts: &[Vec<f64>],
        rounds: usize,
        behind: f64,
    ) -> Option<Glanced> {
        let behind = self.cost + behind.max(FAR_BEHIND);
        self.glance(bench, set, starts, rounds, behind).filter(|glanced| glanced.cost <= behind)
    }
}

/// The explanation at the minimum of the detailed simulation.
///
/// Searches and fits run at coarser steps, whose errors of some hundredths of a kPa the parameters take up. What is
/// written into a rig file must not carry those: other programs simulate it at its own step. The detailed simulation
/// differs from the averaged one by an error that hardly depends on the parameters, so two passes with the known slopes
/// settle it, and one settles all but what the second changes by.
///
/// # Errors
/// The explanation's rig cannot be simulated.
pub fn settled(bench: &Bench<'_>, explanation: &Explanation, passes: usize) -> Result<Explanation, DiagnoseError> {
    let set = &explanation.set;
    let mut settled = explanation.clone();
    let fitted = &mut settled.fitted;
    for _ in 0..passes {
        let close = bench.close.one(&fitted.rig, &fitted.arcs)?;
        let fast = bench.fast.one(&fitted.rig, &fitted.arcs)?;
        let footing = Footing {
            arcs: fitted.arcs.clone(),
            weights: bench.weighted(&fitted.scale_kpa),
            correction_kpa: close.iter().zip(&fast).map(|(c, f)| c - f).collect(),
            slopes: fitted.linearised.jacobian.clone(),
            starts: fitted.starts.clone(),
            cost: fitted.cost,
        };
        let Some(glanced) = footing.glance(bench, set, std::slice::from_ref(&fitted.point), 4, f64::INFINITY) else {
            break;
        };
        fitted.rig = set.rig_at(&glanced.point).map_err(DiagnoseError::rig(set.rig()))?;
        fitted.point = glanced.point;
    }
    for (estimate, z) in fitted.estimates.iter_mut().zip(&fitted.point) {
        (estimate.value, estimate.shift) = (estimate.parameter.value(*z), *z);
    }
    Ok(settled)
}

/// `(trace + correction − recorded) · weight`; zero where the weight is, whatever the trace.
pub(crate) fn weighted(recorded: &[f64], trace: &[f64], correction: &[f64], weights: &[f64]) -> Vec<f64> {
    let mut residuals: Vec<f64> =
        trace.iter().zip(recorded).zip(weights).map(|((s, r), w)| if *w == 0.0 { 0.0 } else { (s - r) * w }).collect();
    for ((residual, correction), w) in residuals.iter_mut().zip(correction).zip(weights) {
        *residual += correction * w;
    }
    residuals
}

/// A rig of the set that fails its checks.
fn unsound(set: &ParameterSet) -> impl Fn(RigError) -> FitError + '_ {
    |problem| FitError::Rig { rig: set.rig().name.clone(), problem }
}

/// The least-squares problem of a glance.
struct Chord<'c> {
    simulator: Simulator<'c>,
    set: &'c ParameterSet,
    footing: &'c Footing,
    /// The footing's, with flappers that are new to it.
    arcs: Arcs,
}

impl Chord<'_> {
    fn residuals_of(&self, trace: &[f64]) -> Vec<f64> {
        let recorded = self.simulator.records().readings_kpa();
        let mut residuals = weighted(recorded, trace, &self.footing.correction_kpa, &self.footing.weights);
        self.footing.starts.apply(&mut residuals);
        residuals
    }

    fn run_at(&self, point: &[f64]) -> Result<Run, FitError> {
        self.set.rig_at(point).map(Run::from).map_err(unsound(self.set))
    }
}

impl Problem for Chord<'_> {
    fn linearise(&mut self, point: &[f64]) -> Result<Linearised, FitError> {
        let mut runs = vec![self.run_at(point)?];
        let mut steps = Vec::new();
        for (i, parameter) in self.set.parameters().iter().enumerate().skip(self.footing.slopes.len()) {
            let mut varied = point.to_vec();
            let (step, [_, high]) =
                (difference_step(parameter, self.simulator.fidelity()), parameter.coordinate_bounds());
            let step = if varied[i] + step > high { -step } else { step };
            varied[i] += step;
            runs.push(self.run_at(&varied)?);
            steps.push(step);
        }
        let mut traces = self
            .simulator
            .run(&runs, &self.arcs)
            .into_iter()
            .collect::<Result<Vec<_>, _>>()
            .map_err(unsound(self.set))?
            .into_iter();
        let base = traces.next().ok_or(FitError::NoRecordings)?;
        if base.iter().any(|kpa| !kpa.is_finite()) {
            return Err(FitError::NotFinite { rig: self.set.rig().name.clone() });
        }
        let own = traces.zip(steps).map(|(trace, step)| -> Vec<f64> {
            let slope = trace.iter().zip(&base).zip(&self.footing.weights).map(|((t, b), w)| w * (t - b) / step);
            let mut slope: Vec<f64> = slope.collect();
            self.footing.starts.apply(&mut slope);
            slope
        });
        let jacobian = self.footing.slopes.iter().cloned().chain(own).collect();
        Ok(Linearised { residuals: self.residuals_of(&base), jacobian })
    }

    fn residuals(&mut self, points: &[Vec<f64>]) -> Vec<Option<Vec<f64>>> {
        let runs: Vec<Option<Run>> = points.iter().map(|point| self.run_at(point).ok()).collect();
        let sound: Vec<Run> = runs.iter().flatten().cloned().collect();
        let mut traces = self.simulator.run(&sound, &self.arcs).into_iter();
        runs.iter()
            .map(|run| {
                run.as_ref()?;
                let residuals = self.residuals_of(&traces.next()?.ok()?);
                residuals.iter().all(|r| r.is_finite()).then_some(residuals)
            })
            .collect()
    }
}
