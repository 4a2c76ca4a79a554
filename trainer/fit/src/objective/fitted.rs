//! The result of a fit: values, scale, uncertainty.

use model::rig::Rig;

use super::Projection;
use crate::data::Records;
use crate::least_squares::{Information, Linearised, Loss};
use crate::parameters::{End, Parameter, ParameterSet, Transform};
use crate::simulate::Arcs;

/// z of a two-sided interval of 90 %.
pub const NINETY: f64 = 1.645;

/// A fitted parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// The parameter, with its prior.
    pub parameter: Parameter,
    /// Value of the parameter, in its unit.
    pub value: f64,
    /// Standard error of the value, in the parameter's unit.
    pub sd: f64,
    /// By how many prior standard deviations it moved.
    pub shift: f64,
    /// Standard error over prior standard deviation: 1 means that the recordings say nothing.
    pub undetermined: f64,
}

impl Estimate {
    /// The estimate for a coordinate and its standard error.
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

/// A parameter of which a fit tells only a side on which it is: its value is no answer, and it has no interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Runaway {
    /// The side.
    pub end: End,
    /// The value that it is beyond, in its unit.
    pub beyond: f64,
    /// The reason for which the fit stays where it is.
    pub held_by: HeldBy,
}

/// The reason for which a parameter stays that recordings would move on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HeldBy {
    /// An end of what such a number can be.
    Range,
    /// The statement in the rig file: the recordings say less and less the further it goes.
    Statement,
}

/// Prior standard deviations from which on a parameter did not just scatter.
pub const FAR: f64 = 3.0;
/// Logarithm of the factor by which recordings alone would have a parameter elsewhere, from which on they do not say where it is. One that
/// is nothing, or endless, is always a whole one away, for what it does falls with its size.
const NOWHERE: f64 = 0.5;

impl Runaway {
    /// The runaway in an estimate on which the recordings have so much information, the other parameters as they are; `None` of one
    /// that has a value.
    pub fn of(estimate: &Estimate, information: f64) -> Option<Runaway> {
        let Estimate { parameter, value, shift, .. } = estimate;
        if let Some(end) = parameter.end_at(*value) {
            let [low, high] = parameter.bounds;
            let beyond = if end == End::Low { low } else { high };
            return Some(Runaway { end, beyond, held_by: HeldBy::Range });
        }
        let further = parameter.scale() * shift.abs() / information.max(f64::MIN_POSITIVE);
        let moves_on = shift.abs() > FAR && further > NOWHERE && parameter.prior_weight() > 0.0;
        if parameter.transform != Transform::Log || !moves_on {
            return None;
        }
        let [low, high] = estimate.interval();
        let (end, beyond) = if *shift > 0.0 { (End::High, low) } else { (End::Low, high) };
        Some(Runaway { end, beyond, held_by: HeldBy::Statement })
    }
}

/// Result of a fit.
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
    /// True where the last stage converged.
    pub converged: bool,
    /// Jacobians worked out in all stages.
    pub rounds: usize,
    /// Estimates in the order of the parameters.
    pub estimates: Vec<Estimate>,
    /// Covariance and combinations that are not determined; `None` if some parameter without a prior is not.
    pub information: Option<Information>,
    /// Residuals and Jacobian at the minimum, for screening further terms.
    pub linearised: Linearised,
    /// Effects of the starts, taken out of the residuals and the Jacobian.
    pub starts: Projection,
    /// Arcs with refined starts.
    pub arcs: Arcs,
}

impl Fitted {
    /// Says of one of its estimates on which side it is, where it tells a side alone.
    pub fn runaway(&self, index: usize) -> Option<Runaway> {
        let alone = self.information.as_ref().and_then(|of| of.data().get((index, index)).copied());
        Runaway::of(self.estimates.get(index)?, alone.unwrap_or(f64::INFINITY))
    }

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

/// Estimates in the parameters' units, from the minimum and its standard errors as coordinates.
pub(super) fn estimates(set: &ParameterSet, point: &[f64], sd: &[f64]) -> Vec<Estimate> {
    set.parameters().iter().zip(point).zip(sd).map(|((parameter, z), sd)| Estimate::of(parameter, *z, *sd)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parameter_without_a_limit_or_at_its_end_tells_a_side_alone() {
        let resistance = Parameter::log("lines.leak.resistance_kpa_s_per_l", 4e4, 0.3).within(4.0, 1e8);
        let at = |value: f64, sd: f64| Estimate::of(&resistance, resistance.coordinate(value), sd);
        // What a leak of no size leaves: its information falls with the square of its resistance, to where the prior holds it.
        let moved = at(1.35e6, 0.47);
        let runaway = Runaway::of(&moved, 0.3 * moved.shift).unwrap();
        assert_eq!((runaway.end, runaway.held_by), (End::High, HeldBy::Statement));
        assert!(runaway.beyond > 1e6 && runaway.beyond < 1.35e6, "{runaway:?}");
        // One that is ten times the stated one and shows has a value.
        assert_eq!(Runaway::of(&at(4e5, 0.15), 43.0), None);
        assert_eq!(Runaway::of(&at(4.4e4, 0.9), 0.2), None);
        let ended = Runaway::of(&at(1e8, 0.01), 1e4).unwrap();
        assert_eq!((ended.end, ended.held_by, ended.beyond), (End::High, HeldBy::Range, 1e8));
    }
}
