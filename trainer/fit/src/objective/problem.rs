//! Residuals of a rig over arcs as a least-squares problem.

use model::rig::Rig;

use super::projection::Projection;
use crate::FitError;
use crate::least_squares::{Linearised, Problem};
use crate::parameters::{Knowledge, Parameter, ParameterSet, Transform};
use crate::simulate::{Arcs, Fidelity, NUDGE_KPA, Run, Simulator};

/// Half the span of a difference where nothing is rough, in prior standard deviations; of what spans factors no more than this
/// share of the value, and of what may be zero this share of its range.
const STEP: f64 = 0.02;
const MOST_SHARE: f64 = 0.01;
const MOST_OF_RANGE: f64 = 0.002;
/// All of them by this factor in a simulation at fixed steps.
const OVER_ROUGHNESS: f64 = 10.0;

/// Half the span of a difference that slopes are taken from, in coordinates.
///
/// Combinations of parameters that hardly show are small differences of large columns, so columns must be good to a
/// thousandth. In the detailed plant switching check valves leave a roughness of up to 1e-4 kPa (measured): two tenths of a prior
/// of a few per cent move a parameter by a per cent to each side, so that it is a thousandth, and what is left of the curvature
/// 1e-4 of the slope. A one-sided step of 0.01 was off by 15 % there for the pump's displacement, which moves readings by 0.02
/// kPa per standard deviation, and halved the stated uncertainties. The averaged plant is smooth, and it is what fits walk
/// on: with such spans the slopes of springs on check valves were off by 2 to 6 % (of a mechanism's magnitude one knows no
/// more than a factor of five, and two tenths of that are a third), and fits ended 60 of log-likelihood early in a
/// valley that bends.
pub fn difference_step(parameter: &Parameter, fidelity: Fidelity) -> f64 {
    let wide = if matches!(fidelity, Fidelity::Averaged | Fidelity::Smooth) { 1.0 } else { OVER_ROUGHNESS };
    let [low, high] = parameter.bounds;
    let most = match (parameter.transform, parameter.knowledge) {
        (Transform::Log, _) => MOST_SHARE / parameter.scale(),
        (Transform::Linear, Knowledge::Prior { sd }) => MOST_OF_RANGE * (high - low) / sd,
        (Transform::Linear, Knowledge::Nothing { .. }) => f64::INFINITY,
    };
    wide * STEP.min(most)
}

/// Which sides of a point differences are taken on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sides {
    /// Both: what uncertainties and combinations are told from.
    Both,
    /// One: half the runs, slopes good to about a per cent, which a search far from its end does not feel.
    One,
}

/// Changes of readings with starts and parameters, in kPa and not projected, so that they serve under any weights.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Slopes {
    /// Per kPa of a channel's starts, by channel.
    starts: Vec<Vec<f64>>,
    /// Per unit of a coordinate, by coordinate.
    coordinates: Vec<Vec<f64>>,
}

/// Residuals of a parameter set over arcs: `(simulated − recorded) · weight`, starts projected out.
pub struct RigProblem<'p> {
    simulator: Simulator<'p>,
    set: &'p ParameterSet,
    arcs: Arcs,
    /// Weight of each reading: 1/σ where it counts, 0 where not.
    weights: Vec<f64>,
    /// Added to every trace: what a closer simulation says otherwise, at some point nearby.
    correction_kpa: Vec<f64>,
    projection: Projection,
    sides: Sides,
    slopes: Option<Slopes>,
    /// True where the slopes stay what they are, wherever the search goes.
    kept: bool,
    /// Points tried last, and the traces there: with kept slopes the next linearisation needs one of them.
    tried: Vec<(Vec<f64>, Vec<f64>)>,
}

impl<'p> RigProblem<'p> {
    /// Residuals over `arcs`, each reading weighted by `weights` (1/σ in 1/kPa, 0 for none).
    pub fn new(simulator: Simulator<'p>, set: &'p ParameterSet, arcs: Arcs, weights: Vec<f64>) -> Self {
        RigProblem {
            simulator,
            set,
            arcs,
            weights,
            correction_kpa: Vec::new(),
            projection: Projection::default(),
            sides: Sides::Both,
            slopes: None,
            kept: false,
            tried: Vec::new(),
        }
    }

    /// The problem with differences on these sides.
    #[must_use]
    pub fn on(self, sides: Sides) -> Self {
        RigProblem { sides, ..self }
    }

    /// The problem with slopes that are worked out once and then kept (chord method), or that are given from nearby: a
    /// round costs the trials alone.
    #[must_use]
    pub(super) fn keeping(self, slopes: Option<Slopes>) -> Self {
        RigProblem { slopes, kept: true, ..self }
    }

    /// The slopes that the last linearisation used, and the starts that it took out.
    pub(super) fn into_slopes(self) -> Option<(Slopes, Projection)> {
        Some((self.slopes?, self.projection))
    }

    /// The problem with a correction of every trace.
    ///
    /// Two simulations of one rig at two fidelities differ by an error that hardly depends on the parameters (the
    /// pump's ripple, the integrator's error at switching valves). Worked out at one point and added to the fast one,
    /// it gives the close one's minimum at the fast one's price (defect correction, Stetter 1978).
    #[must_use]
    pub fn corrected(self, correction_kpa: Vec<f64>) -> Self {
        RigProblem { correction_kpa, ..self }
    }

    /// The arcs.
    pub fn arcs(&self) -> &Arcs {
        &self.arcs
    }

    /// `(trace − recorded) · weight`.
    fn weighted(&self, trace: &[f64]) -> Vec<f64> {
        let recorded = self.simulator.records().readings_kpa();
        let mut residuals: Vec<f64> = trace
            .iter()
            .zip(recorded)
            .zip(&self.weights)
            .map(|((s, r), w)| if *w == 0.0 { 0.0 } else { (s - r) * w })
            .collect();
        for ((residual, correction), w) in residuals.iter_mut().zip(&self.correction_kpa).zip(&self.weights) {
            *residual += correction * w;
        }
        residuals
    }
}

impl RigProblem<'_> {
    /// Works out the slopes at a point; also gives the trace there.
    fn slopes_at(&self, rig: &Rig, point: &[f64]) -> Result<(Vec<f64>, Slopes), FitError> {
        let channels = self.simulator.records().layout().channels();
        let mut runs = Run::nudged(rig, channels, NUDGE_KPA);
        let spans = self.spans(point);
        for (i, span) in spans.iter().enumerate() {
            for by in span.iter().filter(|by| **by != 0.0) {
                let mut varied = point.to_vec();
                if let Some(z) = varied.get_mut(i) {
                    *z += by;
                }
                runs.push(Run::from(self.set.rig_at(&varied).map_err(FitError::rig(self.set.rig()))?));
            }
        }
        let mut traces = self
            .simulator
            .run(&runs, &self.arcs)
            .into_iter()
            .collect::<Result<Vec<_>, _>>()
            .map_err(FitError::rig(self.set.rig()))?
            .into_iter();
        let Some(base) = traces.next() else { return Err(FitError::NoRecordings) };
        // (above − below)/span, in place of `above`; readings that do not count may be anything.
        let difference = |below: &[f64], mut above: Vec<f64>, span: f64| {
            for ((a, b), w) in above.iter_mut().zip(below).zip(&self.weights) {
                *a = if *w == 0.0 { 0.0 } else { (*a - b) / span };
            }
            above
        };
        let starts = traces.by_ref().take(channels).map(|trace| difference(&base, trace, NUDGE_KPA)).collect();
        let mut coordinates = Vec::with_capacity(spans.len());
        for [low, high] in &spans {
            let mut side = |by: f64| if by == 0.0 { Some(None) } else { traces.next().map(Some) };
            let (Some(below), Some(above)) = (side(*low), side(*high)) else { break };
            let (below, above) = (below.as_deref().unwrap_or(&base), above.unwrap_or_else(|| base.clone()));
            coordinates.push(difference(below, above, high - low));
        }
        Ok((base, Slopes { starts, coordinates }))
    }

    /// Reach of differences below and above a point, by coordinate: one or both sides, within bounds.
    fn spans(&self, point: &[f64]) -> Vec<[f64; 2]> {
        self.set
            .parameters()
            .iter()
            .zip(point)
            .map(|(parameter, z)| {
                let (step, [low, high]) =
                    (difference_step(parameter, self.simulator.fidelity()), parameter.coordinate_bounds());
                let (below, above) = ((z - step).max(low) - z, (z + step).min(high) - z);
                match self.sides {
                    Sides::Both => [below, above],
                    Sides::One if above > 0.5 * step => [0.0, above],
                    Sides::One => [below, 0.0],
                }
            })
            .collect()
    }

    /// The trace of the set at a point, which may have been tried already.
    fn trace(&mut self, rig: &Rig, point: &[f64]) -> Result<Vec<f64>, FitError> {
        if let Some(known) = self.tried.iter().position(|(tried, _)| tried == point) {
            return Ok(self.tried.swap_remove(known).1);
        }
        let outcome = self.simulator.run(&[Run::from(rig.clone())], &self.arcs).pop().ok_or(FitError::NoRecordings)?;
        outcome.map_err(FitError::rig(self.set.rig()))
    }
}

impl Problem for RigProblem<'_> {
    fn linearise(&mut self, point: &[f64]) -> Result<Linearised, FitError> {
        let rig = self.set.rig_at(point).map_err(FitError::rig(self.set.rig()))?;
        let (base, slopes) = match self.slopes.take() {
            Some(slopes) if self.kept => (self.trace(&rig, point)?, slopes),
            _ => self.slopes_at(&rig, point)?,
        };
        if base.iter().any(|kpa| !kpa.is_finite()) {
            return Err(FitError::NotFinite { rig: rig.name });
        }
        let weighted =
            |column: &Vec<f64>| -> Vec<f64> { column.iter().zip(&self.weights).map(|(c, w)| c * w).collect() };
        let effects: Vec<Vec<f64>> = slopes.starts.iter().map(weighted).collect();
        let mut jacobian: Vec<Vec<f64>> = slopes.coordinates.iter().map(weighted).collect();
        self.projection = Projection::new(self.simulator.records(), &self.arcs, &effects);
        self.slopes = Some(slopes);
        let mut residuals = self.weighted(&base);
        self.projection.apply(&mut residuals);
        for column in &mut jacobian {
            self.projection.apply(column);
        }
        Ok(Linearised { residuals, jacobian })
    }

    fn residuals(&mut self, points: &[Vec<f64>]) -> Vec<Option<Vec<f64>>> {
        let rigs: Vec<Option<Rig>> = points.iter().map(|point| self.set.rig_at(point).ok()).collect();
        let runs: Vec<Run> = rigs.iter().flatten().cloned().map(Run::from).collect();
        let mut traces = self.simulator.run(&runs, &self.arcs).into_iter();
        self.tried.clear();
        rigs.iter()
            .zip(points)
            .map(|(rig, point)| {
                rig.as_ref()?;
                let trace = traces.next()?.ok()?;
                let mut residuals = self.weighted(&trace);
                self.projection.apply(&mut residuals);
                if self.kept {
                    self.tried.push((point.clone(), trace));
                }
                residuals.iter().all(|r| r.is_finite()).then_some(residuals)
            })
            .collect()
    }
}
