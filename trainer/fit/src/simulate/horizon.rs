//! Errors of a rig after 1 s, 10 s, or for ever.
//!
//! Errors at short horizons show what is fast (delay, sensors), at long ones what the balances lack; a one-step
//! error alone flatters every model, so no figure here goes without its horizon.

use model::rig::Rig;

use super::arcs::Arcs;
use super::simulator::Simulator;
use super::start::{refined_starts, smoothed_kpa};
use crate::FitError;

/// Time for which the commands alone decide.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Horizon {
    /// From the first row of a segment to its last.
    Free,
    /// Windows of this many seconds, each from smoothed readings.
    Windows {
        /// Length in s.
        seconds: f64,
    },
}

/// The error of one channel.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ChannelError {
    /// Root of the mean squared error, in kPa.
    pub rmse_kpa: f64,
    /// Mean error (simulated less recorded), in kPa.
    pub bias_kpa: f64,
    /// The largest error, in kPa.
    pub worst_kpa: f64,
    /// Readings that count.
    pub rows: usize,
}

/// The trace of a rig at a horizon, starts refined.
///
/// # Errors
/// The rig cannot be simulated.
pub fn trace_at(simulator: &Simulator<'_>, rig: &Rig, horizon: Horizon) -> Result<Vec<f64>, FitError> {
    Ok(traces_at(simulator, rig, &[horizon])?.pop().unwrap_or_default())
}

/// Traces of a rig at several horizons, for which one free run serves.
///
/// # Errors
/// The rig cannot be simulated.
pub fn traces_at(simulator: &Simulator<'_>, rig: &Rig, horizons: &[Horizon]) -> Result<Vec<Vec<f64>>, FitError> {
    let records = simulator.records();
    let arcs = refined_starts(simulator, rig, &Arcs::led(records))?;
    let free = simulator.one(rig, &arcs)?;
    let smoothed = smoothed_kpa(records, &free);
    horizons
        .iter()
        .map(|horizon| match horizon {
            Horizon::Free => Ok(free.clone()),
            Horizon::Windows { seconds } => {
                let rows = ((seconds / proto::recording::PERIOD_S).round() as usize).max(1);
                simulator.one(rig, &Arcs::windows(records, rows, &smoothed).with_flappers_of(&arcs))
            }
        })
        .collect()
}

/// Errors by channel, over the readings whose weight is not zero.
///
/// # Errors
/// The rig cannot be simulated.
pub fn errors_at(
    simulator: &Simulator<'_>,
    rig: &Rig,
    horizon: Horizon,
    weights: &[f64],
) -> Result<Vec<ChannelError>, FitError> {
    let trace = trace_at(simulator, rig, horizon)?;
    Ok(errors(simulator, &trace, weights))
}

/// Errors of a trace by channel, over the readings whose weight is not zero.
pub fn errors(simulator: &Simulator<'_>, trace: &[f64], weights: &[f64]) -> Vec<ChannelError> {
    let records = simulator.records();
    let layout = records.layout();
    let mut sums = vec![ChannelError::default(); layout.channels()];
    for (_, channel, range) in layout.all() {
        let Some(sum) = sums.get_mut(channel) else { continue };
        for index in range {
            let at = |vector: &[f64]| vector.get(index).copied().unwrap_or(0.0);
            if at(weights) != 0.0 {
                let off = at(trace) - at(records.readings_kpa());
                sum.rows += 1;
                sum.bias_kpa += off;
                sum.rmse_kpa += off * off;
                sum.worst_kpa = sum.worst_kpa.max(off.abs());
            }
        }
    }
    for sum in &mut sums {
        let rows = sum.rows.max(1) as f64;
        sum.bias_kpa /= rows;
        sum.rmse_kpa = (sum.rmse_kpa / rows).sqrt();
    }
    sums
}
