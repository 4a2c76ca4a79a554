//! A fit: rounds of least squares, scale, uncertainty.
//!
//! Free runs far from the truth lead a search astray (a wrong volume is hidden behind a wrong valve), short windows
//! determine slow effects badly. So a fit from each start goes through windows first and ends with free runs. Residuals
//! are weighted by the noise, or by their own scale where that is larger: a model that is wrong by ten times the
//! noise would otherwise make Student's loss look at the rows it already fits and at no others.

use model::rig::Rig;

use super::problem::RigProblem;
use crate::FitError;
use crate::data::{Records, Stretch};
use crate::least_squares::{Information, Linearised, Loss, Settings, Stop, minimise};
use crate::parameters::{Parameter, ParameterSet};
use crate::simulate::{Arcs, Fidelity, Simulator, refined_starts, smoothed_kpa};

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

/// How to fit.
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
    /// What the search runs on. The minimum is that of the simulator's own fidelity all the same.
    pub search: Fidelity,
}

impl Default for FitSettings {
    fn default() -> Self {
        FitSettings {
            loss: Loss::Student { freedom: 5.0 },
            stages: vec![Shooting::Windows { seconds: 2.0 }, Shooting::Free],
            rounds: 12,
            least_gain: 0.01,
            search: Fidelity::Coarse,
        }
    }
}

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
    /// Interval that holds the value with 90 %.
    pub fn interval(&self) -> [f64; 2] {
        let z = self.parameter.coordinate(self.value);
        self.parameter.interval(z, 1.645 * self.undetermined)
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
    /// Arcs with refined starts.
    pub arcs: Arcs,
}

/// Fits from several starts and returns the best; the others' costs tell whether they agree.
///
/// `weights` is 1 at readings that are fitted and 0 elsewhere, `sigma_kpa` the noise by channel. `blocks` are the
/// stretches of time that count as independent for uncertainties.
///
/// # Errors
/// No start can be simulated.
pub fn fit(
    simulator: Simulator<'_>,
    set: &ParameterSet,
    starts: &[Vec<f64>],
    weights: &[f64],
    sigma_kpa: &[f64],
    blocks: &[Stretch],
    settings: &FitSettings,
) -> Result<(Fitted, Vec<f64>), FitError> {
    let mut fits = Vec::new();
    let mut failed = None;
    for start in starts {
        match fit_from(simulator, set, start, weights, sigma_kpa, blocks, settings) {
            Ok(fitted) => fits.push(fitted),
            Err(error) => failed = Some(error),
        }
    }
    // Costs are relative to each fit's own scale; likelihoods make them comparable.
    let likelihoods: Vec<f64> = fits.iter().map(|f| f.comparable_cost(simulator.records(), weights, settings.loss)).collect();
    let best = (0..fits.len()).min_by(|a, b| likelihoods[*a].total_cmp(&likelihoods[*b]));
    match best {
        Some(best) => Ok((fits.swap_remove(best), likelihoods)),
        None => Err(failed.unwrap_or(FitError::NoRecordings)),
    }
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
    let records = simulator.records();
    let ends = ends(records, weights);
    let fast = simulator.at(settings.search);
    let mut point = start.to_vec();
    let mut rounds = 0;
    let mut last = None;
    for (stage, shooting) in settings.stages.iter().enumerate() {
        let final_stage = stage + 1 == settings.stages.len();
        // Scale and correction depend on the fit and the fit on them; two or three passes settle all three.
        let mut before: Option<(Vec<f64>, Vec<f64>)> = None;
        for pass in 0..if final_stage { PASSES } else { 1 } {
            let rig = set.rig_at(&point).map_err(FitError::rig(set.rig()))?;
            let arcs = arcs_for(fast, &rig, *shooting, &ends)?;
            let mut trace = fast.one(&rig, &arcs)?;
            let mut correction_kpa = Vec::new();
            if final_stage && settings.search != simulator.fidelity() {
                let close = simulator.one(&rig, &arcs)?;
                correction_kpa = close.iter().zip(&trace).map(|(c, f)| c - f).collect();
                trace = close;
            }
            let scale = scales(records, &trace, weights, sigma_kpa);
            if before.as_ref().is_some_and(|(old, at)| settled(old, &scale) && near(at, &point)) {
                break;
            }
            before = Some((scale.clone(), point.clone()));
            let mut problem =
                RigProblem::new(fast, set, arcs, over(records, weights, &scale)).corrected(correction_kpa);
            let search = Settings {
                loss: settings.loss,
                prior: set.prior(),
                bounds: set.bounds(),
                rounds: if final_stage { settings.rounds } else { settings.rounds.min(6) },
                trials: 4,
                least_gain: if final_stage && pass > 0 { settings.least_gain } else { 1.0 },
            };
            let outcome = minimise(&mut problem, &point, &search)?;
            point.clone_from(&outcome.point);
            rounds += outcome.rounds;
            last = Some((outcome, scale, problem.arcs().clone()));
        }
    }
    let Some((outcome, scale_kpa, arcs)) = last else { return Err(FitError::NoRecordings) };
    let rig = set.rig_at(&point).map_err(FitError::rig(set.rig()))?;
    let information =
        Information::of(&outcome.linearised, settings.loss, &set.prior(), &block_numbers(records, blocks));
    let sd = information.as_ref().map_or_else(|| vec![f64::INFINITY; set.len()], Information::cautious_sd);
    Ok(Fitted {
        estimates: estimates(set, &point, &sd),
        rmse_kpa: rmse(records, &outcome.linearised.residuals, weights, &scale_kpa),
        rig,
        point,
        cost: outcome.cost,
        converged: outcome.stop != Stop::Rounds,
        rounds,
        information,
        linearised: outcome.linearised,
        scale_kpa,
        arcs,
    })
}

impl Fitted {
    /// Negative log-likelihood with the scale of each channel at its own best, and the prior: comparable between fits of
    /// the same readings, whatever scale each was weighted by.
    pub fn comparable_cost(&self, records: &Records, weights: &[f64], loss: Loss) -> f64 {
        let layout = records.layout();
        let prior: f64 =
            self.estimates.iter().map(|e| 0.5 * e.parameter.prior_weight() * e.shift * e.shift).sum();
        let data: f64 = (0..layout.channels())
            .map(|channel| {
                let residuals: Vec<f64> = (0..layout.records())
                    .flat_map(|record| layout.channel(record, channel))
                    .filter(|i| weights.get(*i).is_some_and(|w| *w != 0.0))
                    .filter_map(|i| self.linearised.residuals.get(i).copied())
                    .collect();
                let scale = self.scale_kpa.get(channel).copied().unwrap_or(1.0);
                profiled(&residuals, loss) + residuals.len() as f64 * scale.ln()
            })
            .sum();
        data + prior
    }
}

/// `min over s of Σ ρ(r/s) + n ln s`, by reweighting: s² = Σ w(r/s) r²/n.
fn profiled(residuals: &[f64], loss: Loss) -> f64 {
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

/// Passes of the last stage.
const PASSES: usize = 4;

/// Whether a scale has hardly changed.
fn settled(old: &[f64], new: &[f64]) -> bool {
    old.iter().zip(new).all(|(a, b)| (a / b - 1.0).abs() < 0.1)
}

/// Whether a point has hardly moved: by so little the correction of the fast simulation does not change.
fn near(old: &[f64], new: &[f64]) -> bool {
    old.iter().zip(new).all(|(a, b)| (a - b).abs() < 0.1)
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
    let free = refined_starts(&simulator, rig, &Arcs::free(records).until(ends))?;
    match shooting {
        Shooting::Free => Ok(free),
        Shooting::Windows { seconds } => {
            let trace = simulator.one(rig, &free)?;
            let rows = ((seconds / proto::recording::PERIOD_S).round() as usize).max(2);
            Ok(Arcs::windows(records, rows, &smoothed_kpa(records, &trace)).until(ends))
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
            let middle = sizes.len() / 2;
            let median = if sizes.is_empty() { 0.0 } else { *sizes.select_nth_unstable_by(middle, f64::total_cmp).1 };
            // The median of |N(0, 1)| is 0.6745.
            (median / 0.6745).max(sigma_kpa.get(channel).copied().unwrap_or(0.0)).max(1e-6)
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

fn rmse(records: &Records, residuals: &[f64], weights: &[f64], scale_kpa: &[f64]) -> Vec<f64> {
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

/// The block of each reading; `usize::MAX` for none.
fn block_numbers(records: &Records, blocks: &[Stretch]) -> Vec<usize> {
    let layout = records.layout();
    let mut numbers = vec![usize::MAX; layout.len()];
    for (number, block) in blocks.iter().enumerate() {
        for channel in 0..layout.channels() {
            if let Some(part) = numbers.get_mut(layout.stretch(block.record, channel, block.rows.clone())) {
                part.fill(number);
            }
        }
    }
    numbers
}

fn estimates(set: &ParameterSet, point: &[f64], sd: &[f64]) -> Vec<Estimate> {
    set.parameters()
        .iter()
        .zip(point)
        .zip(sd)
        .map(|((parameter, z), sd)| {
            let value = parameter.value(*z);
            let [low, high] = [parameter.value(z - sd), parameter.value(z + sd)];
            Estimate { parameter: parameter.clone(), value, sd: 0.5 * (high - low), shift: *z, undetermined: *sd }
        })
        .collect()
}
