//! The result of a fit: values, scale, uncertainty.

use model::rig::Rig;

use super::Projection;
use crate::data::Records;
use crate::least_squares::{Information, Linearised, Loss};
use crate::parameters::{Parameter, ParameterSet};
use crate::simulate::Arcs;

/// z of a two-sided interval of 90 %.
pub const NINETY: f64 = 1.645;

/// A fitted parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// The parameter, with its prior.
    pub parameter: Parameter,
    /// Its value, in its unit.
    pub value: f64,
    /// Its standard error, in its unit.
    pub sd: f64,
    /// By how many prior standard deviations it moved.
    pub shift: f64,
    /// Standard error over prior standard deviation: 1 means that the recordings say nothing.
    pub undetermined: f64,
}

impl Estimate {
    /// Of a coordinate and its standard error.
    fn of(parameter: &Parameter, z: f64, sd: f64) -> Self {
        let [low, high] = [parameter.value(z - sd), parameter.value(z + sd)];
        Estimate {
            parameter: parameter.clone(),
            value: parameter.value(z),
            sd: 0.5 * (high - low),
            shift: z,
            undetermined: sd,
        }
    }

    /// Interval that holds the value with 90 %.
    pub fn interval(&self) -> [f64; 2] {
        let z = self.parameter.coordinate(self.value);
        self.parameter.interval(z, NINETY * self.undetermined)
    }
}

/// What a fit gave.
#[derive(Debug, Clone, PartialEq)]
pub struct Fitted {
    /// The rig at the minimum.
    pub rig: Rig,
    /// Coordinates of the minimum.
    pub point: Vec<f64>,
    /// Cost (negative log-likelihood and prior, but for constants) at [`Fitted::scale_kpa`].
    pub cost: f64,
    /// Scale of the residuals that the cost is relative to, by channel in kPa.
    pub scale_kpa: Vec<f64>,
    /// Root of the mean squared free-run residual on the fitted rows, by channel in kPa, starts projected out.
    pub rmse_kpa: Vec<f64>,
    /// The loss that the cost is made of.
    pub loss: Loss,
    /// Whether the last stage converged.
    pub converged: bool,
    /// Jacobians worked out in all stages.
    pub rounds: usize,
    /// Estimates in the order of the parameters.
    pub estimates: Vec<Estimate>,
    /// Covariance and combinations that are not determined; `None` if some parameter without a prior is not.
    pub information: Option<Information>,
    /// Residuals and Jacobian at the minimum, for screening further terms.
    pub linearised: Linearised,
    /// What the starts could explain: out of the residuals and the Jacobian.
    pub starts: Projection,
    /// Arcs with refined starts.
    pub arcs: Arcs,
}

impl Fitted {
    /// Adds variances, by coordinate in units of the prior's, to those of the estimates.
    pub fn widen(&mut self, variances: &[f64]) {
        for (estimate, variance) in self.estimates.iter_mut().zip(variances) {
            let wider = estimate.undetermined.hypot(variance.max(0.0).sqrt());
            *estimate = Estimate::of(&estimate.parameter, estimate.shift, wider);
        }
    }

    /// Negative log-likelihood with the scale of each channel at its own best, and the prior: comparable between fits of
    /// the same readings, whatever scale each was weighted by.
    pub fn comparable_cost(&self, records: &Records, weights: &[f64]) -> f64 {
        let layout = records.layout();
        let prior: f64 = self.estimates.iter().map(|e| 0.5 * e.parameter.prior_weight() * e.shift * e.shift).sum();
        let data: f64 = (0..layout.channels())
            .map(|channel| {
                let residuals: Vec<f64> = (0..layout.records())
                    .flat_map(|record| layout.channel(record, channel))
                    .filter(|i| weights.get(*i).is_some_and(|w| *w != 0.0))
                    .filter_map(|i| self.linearised.residuals.get(i).copied())
                    .collect();
                let scale = self.scale_kpa.get(channel).copied().unwrap_or(1.0);
                profiled(&residuals, self.loss) + residuals.len() as f64 * scale.ln()
            })
            .sum();
        data + prior
    }
}

/// Negative log-likelihood of residuals with their scale at its own best, but for constants: `min over s of Σ ρ(r/s) + n ln s`, by
/// reweighting: s² = Σ w(r/s) r²/n.
pub fn profiled(residuals: &[f64], loss: Loss) -> f64 {
    let n = residuals.len() as f64;
    if residuals.is_empty() {
        return 0.0;
    }
    let mut scale = 1.0;
    for _ in 0..30 {
        let squares: f64 = residuals.iter().map(|r| loss.weight(r / scale) * r * r).sum();
        let next = (squares / n).sqrt().max(1e-9);
        let moved: f64 = next / scale - 1.0;
        scale = next;
        if moved.abs() < 1e-9 {
            break;
        }
    }
    residuals.iter().map(|r| loss.cost(r / scale)).sum::<f64>() + n * scale.ln()
}

/// Root of the mean squared residual by channel, in kPa.
pub(super) fn rmse(records: &Records, residuals: &[f64], weights: &[f64], scale_kpa: &[f64]) -> Vec<f64> {
    let layout = records.layout();
    (0..layout.channels())
        .map(|channel| {
            let (mut sum, mut rows) = (0.0, 0.0);
            for i in (0..layout.records()).flat_map(|record| layout.channel(record, channel)) {
                if weights.get(i).is_some_and(|w| *w != 0.0) {
                    sum += residuals.get(i).map_or(0.0, |r| r * r);
                    rows += 1.0;
                }
            }
            (sum / f64::max(rows, 1.0)).sqrt() * scale_kpa.get(channel).copied().unwrap_or(1.0)
        })
        .collect()
}

/// What the minimum and its standard errors (both as coordinates) are in the parameters' units.
pub(super) fn estimates(set: &ParameterSet, point: &[f64], sd: &[f64]) -> Vec<Estimate> {
    set.parameters().iter().zip(point).zip(sd).map(|((parameter, z), sd)| Estimate::of(parameter, *z, *sd)).collect()
}
