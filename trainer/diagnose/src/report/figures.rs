//! Before and after: errors of rigs on the rows that nothing was fitted to.

use fit::FitError;
use fit::data::Role;
use fit::simulate::{ChannelError, Fidelity, Horizon, Simulator, errors, traces_at};
use model::rig::Rig;
use proto::diagnosis::Fit;

use crate::bench::Bench;

/// A recorded pressure closer to the atmosphere than this does not count for the accuracy, in kPa: a percentage of
/// nearly nothing says nothing.
const LEAST_KPA: f64 = 5.0;

/// Factor by which a channel may err more beyond its noise, and kPa on top, before that speaks against what was found.
const SPOILT: f64 = 1.25;
const SPOILT_KPA: f64 = 0.04;
/// Ratio of two errors on some tens of seconds that are equal but for chance.
const CHANCE: f64 = 1.05;

/// Errors of one rig at three horizons, by channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Figures {
    /// From the start of each recording.
    pub free: Vec<ChannelError>,
    /// Windows of 10 s.
    pub ten_seconds: Vec<ChannelError>,
    /// Windows of 1 s.
    pub one_second: Vec<ChannelError>,
    /// 1 − mean absolute percentage error of the free run, by channel; NaN where no reading is far from the atmosphere.
    pub accuracy: Vec<f64>,
    /// The free run.
    pub trace: Vec<f64>,
}

/// Weights of the rows that figures are taken from: those kept back, or all where there are none. Readings that the fit leaves
/// out, because they are wild or stand between samples, are no yardstick either.
pub fn held_out(bench: &Bench<'_>) -> Vec<f64> {
    let layout = bench.records.layout();
    let kept = bench.split.weights(layout, Role::HeldOut);
    let counts = |weights: Vec<f64>| -> Vec<f64> { weights.iter().zip(bench.counted()).map(|(w, c)| w * c).collect() };
    let is_any = |weights: &[f64]| weights.iter().any(|w| *w != 0.0);
    [kept, vec![1.0; layout.len()]]
        .into_iter()
        .map(counts)
        .find(|w| is_any(w))
        .unwrap_or_else(|| vec![1.0; layout.len()])
}

/// The figures of a rig. `short` also runs the windows.
///
/// # Errors
/// The rig cannot be simulated.
pub fn figures(bench: &Bench<'_>, rig: &Rig, fidelity: Fidelity, short: bool) -> Result<Figures, FitError> {
    let simulator: Simulator<'_> = bench.simulator.at(fidelity);
    let weights = held_out(bench);
    let mut horizons = vec![Horizon::Free];
    if short {
        horizons.extend([10.0, 1.0].map(|seconds| Horizon::Windows { seconds }));
    }
    let mut traces = traces_at(&simulator, rig, &horizons)?.into_iter();
    let trace = traces.next().unwrap_or_default();
    let mut windows = || traces.next().map_or_else(Vec::new, |trace| errors(&simulator, &trace, &weights));
    Ok(Figures {
        free: errors(&simulator, &trace, &weights),
        ten_seconds: windows(),
        one_second: windows(),
        accuracy: accuracy(bench, &trace, &weights),
        trace,
    })
}

fn accuracy(bench: &Bench<'_>, trace: &[f64], weights: &[f64]) -> Vec<f64> {
    let layout = bench.records.layout();
    let readings = bench.records.readings_kpa();
    (0..layout.channels())
        .map(|channel| {
            let (mut sum, mut rows) = (0.0, 0.0);
            for i in (0..layout.records()).flat_map(|record| layout.channel(record, channel)) {
                let (Some(s), Some(p), Some(w)) = (trace.get(i), readings.get(i), weights.get(i)) else { continue };
                if *w != 0.0 && p.abs() >= LEAST_KPA {
                    sum += (s - p).abs() / p.abs();
                    rows += 1.0;
                }
            }
            1.0 - sum / rows
        })
        .collect()
}

impl Figures {
    /// In the form of `diagnosis.json`; a rig with one channel fills the first.
    pub fn to_fit(&self) -> Fit {
        let rmse = |c: usize| self.free.get(c).map(|e| e.rmse_kpa);
        let accuracy = |c: usize| self.accuracy.get(c).copied().filter(|share| share.is_finite());
        Fit {
            pos_rmse_kpa: rmse(0).unwrap_or_default(),
            neg_rmse_kpa: rmse(1),
            pos_accuracy: accuracy(0),
            neg_accuracy: accuracy(1),
        }
    }

    /// Tells whether what turned a rig with the figures `before` into this one holds on rows that nothing was fitted
    /// to: all channels together err no more (what only an experiment shows changes nothing elsewhere), and none errs
    /// much more. `sigma_kpa` is each channel's noise.
    ///
    /// Real physics of one chamber does not spoil the other: the pump ties the two together, so a formula that is not the
    /// right one but fits shows there first.
    pub fn holds_against(&self, before: &Figures, sigma_kpa: &[f64]) -> bool {
        let [before_kpa, after_kpa] = [before, self].map(|figures| figures.beyond_noise_kpa(sigma_kpa));
        let spoilt = after_kpa.iter().zip(&before_kpa).any(|(after, before)| *after > SPOILT * before + SPOILT_KPA);
        !spoilt && self.total_rmse_kpa() < CHANCE * before.total_rmse_kpa()
    }

    /// Free-run error beyond each channel's noise, by channel in kPa.
    pub fn beyond_noise_kpa(&self, sigma_kpa: &[f64]) -> Vec<f64> {
        let errors = self.free.iter().zip(sigma_kpa);
        errors.map(|(error, sigma)| (error.rmse_kpa.powi(2) - sigma.powi(2)).max(0.0).sqrt()).collect()
    }

    /// Root of the mean squared free-run error of all channels, in kPa.
    pub fn total_rmse_kpa(&self) -> f64 {
        let rows: f64 = self.free.iter().map(|e| e.rows as f64).sum();
        (self.free.iter().map(|e| e.rmse_kpa.powi(2) * e.rows as f64).sum::<f64>() / rows.max(1.0)).sqrt()
    }
}
