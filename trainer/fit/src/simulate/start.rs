//! Starts that noise does not spoil.
//!
//! A simulation that starts at one noisy reading is off by that reading's error until the chamber forgets it, which
//! in a free run colours the first seconds and in short windows drowns what they should show.

use std::ops::Range;

use model::rig::Rig;
use nalgebra::{DMatrix, DVector};

use super::arcs::{Arc, Arcs};
use super::flappers::{Look, flappers_of};
use super::simulator::{Fidelity, Run, Simulator};
use crate::FitError;
use crate::data::Records;

/// Half the width of the smoother's kernel at which it is cut, in rows.
const REACH: usize = 15;
/// Standard deviation of the kernel in rows: 0.1 s. White noise shrinks to a quarter (1/√(2 √π · 5) = 0.24).
const SPREAD: f64 = 5.0;
/// Rows that a start is fitted to: after 2 s a chamber has forgotten it.
const FITTED_ROWS: usize = 100;
/// Shift of a start by which its effect is measured, in kPa; a chamber's response to it is linear to 1e-3.
pub(crate) const NUDGE_KPA: f64 = 0.1;

/// Readings with the noise smoothed out: the free run, corrected by what the recording differs from it, smoothed.
///
/// The free run has the steep parts already, so the difference is slow and smoothing it blurs no edge. `free_run` and
/// the result are of the recordings' layout.
pub fn smoothed_kpa(records: &Records, free_run: &[f64]) -> Vec<f64> {
    let kernel: Vec<f64> = (0..=REACH).map(|k| (-0.5 * (k as f64 / SPREAD).powi(2)).exp()).collect();
    let mut smoothed = free_run.to_vec();
    for (record, channel, range) in records.layout().all() {
        let recorded = records.channel_kpa(record, channel);
        let Some(simulated) = free_run.get(range.clone()) else { continue };
        let mut difference: Vec<f64> = recorded.iter().zip(simulated).map(|(r, s)| r - s).collect();
        // Where nothing was read the free run is off by what it is off around it.
        if let Some(of) = records.records().get(record) {
            of.over_missing(channel, &mut difference);
        }
        let Some(out) = smoothed.get_mut(range) else { continue };
        let stretches = records.records().get(record).into_iter().flat_map(|r| {
            // A free run starts anew behind a lead.
            let behind = |segment: &Range<usize>| segment.start + r.lead_rows(segment.start);
            r.segments.iter().flat_map(move |segment| [segment.start..behind(segment), behind(segment)..segment.end])
        });
        for segment in stretches {
            for row in segment.clone() {
                // Symmetric, so that a difference that drifts is not shifted; it narrows towards the ends.
                let reach = REACH.min(row - segment.start).min(segment.end - 1 - row);
                let (mut sum, mut weight) = (0.0, 0.0);
                for k in 0..=reach {
                    let w = kernel.get(k).copied().unwrap_or(0.0);
                    let pair = [row - k, row + k];
                    for at in pair.iter().take(if k == 0 { 1 } else { 2 }) {
                        sum += w * difference.get(*at).copied().unwrap_or(0.0);
                        weight += w;
                    }
                }
                if let Some(slot) = out.get_mut(row) {
                    *slot += sum / weight;
                }
            }
        }
    }
    smoothed
}

/// Moves the starts of `arcs` to where the rows after them fit best: flappers with room first ([`flappers_of`]), then
/// pressures (least squares over 2 s, one linear step).
///
/// # Errors
/// The rig cannot be simulated.
pub fn refined_starts(simulator: &Simulator<'_>, rig: &Rig, arcs: &Arcs) -> Result<Arcs, FitError> {
    let records = simulator.records();
    let channels = records.layout().channels();
    let arcs = &with_flappers(simulator, rig, arcs);
    let ends: Vec<usize> = (0..records.records().len())
        .map(|record| arcs.of(record).map(|arc| arc.rows.start + FITTED_ROWS).max().unwrap_or(0))
        .collect();
    let runs = Run::nudged(rig, channels, NUDGE_KPA);
    let traces = simulator
        .run(&runs, &arcs.clone().until(&ends))
        .into_iter()
        .collect::<Result<Vec<_>, _>>()
        .map_err(FitError::rig(rig))?;
    let Some((base, nudged)) = traces.split_first() else { return Ok(arcs.clone()) };
    if base.iter().any(|kpa| !kpa.is_finite()) {
        return Err(FitError::NotFinite { rig: rig.name.clone() });
    }
    let mut refined = arcs.clone();
    for arc in refined.arcs_mut() {
        let moved = moved_start(records, arc, base, nudged);
        for (start, by) in arc.start_kpa.iter_mut().zip(moved) {
            // A model that is far off would ask for a start that no reading supports.
            *start += by.clamp(-2.0, 2.0);
        }
    }
    Ok(refined)
}

/// The arcs with flappers where they lie best. Strokes of the pump say nothing about that, and are not simulated for it.
pub fn with_flappers(simulator: &Simulator<'_>, rig: &Rig, arcs: &Arcs) -> Arcs {
    let mut placed = arcs.clone();
    let simulator = match simulator.fidelity() {
        Fidelity::Detailed | Fidelity::Coarse => simulator.at(Fidelity::Averaged),
        Fidelity::Averaged | Fidelity::Smooth => *simulator,
    };
    let found = flappers_of(&simulator, &[Run::from(rig.clone())], arcs, Look::Closely).pop().unwrap_or_default();
    for (arc, flappers) in placed.arcs_mut().iter_mut().zip(found) {
        if arc.fresh {
            arc.flappers.extend(flappers);
        }
    }
    placed
}

/// The step of one arc's start that fits its first rows best.
fn moved_start(records: &Records, arc: &Arc, base: &[f64], nudged: &[Vec<f64>]) -> Vec<f64> {
    let layout = records.layout();
    let channels = layout.channels();
    let rows = arc.rows.start..arc.rows.end.min(arc.rows.start + FITTED_ROWS);
    let (mut normal, mut gradient) = (DMatrix::<f64>::zeros(channels, channels), DVector::<f64>::zeros(channels));
    let is_missing =
        |channel: usize, row: usize| records.records().get(arc.record).is_some_and(|r| r.is_missing(channel, row));
    for channel in 0..channels {
        for (row, index) in rows.clone().zip(layout.stretch(arc.record, channel, rows.clone())) {
            if is_missing(channel, row) {
                continue;
            }
            let at = |trace: &[f64]| trace.get(index).copied().unwrap_or(0.0);
            let residual = at(records.readings_kpa()) - at(base);
            let effects: Vec<f64> = nudged.iter().map(|trace| (at(trace) - at(base)) / NUDGE_KPA).collect();
            for (i, one) in effects.iter().enumerate() {
                gradient[i] += one * residual;
                for (j, other) in effects.iter().enumerate() {
                    normal[(i, j)] += one * other;
                }
            }
        }
    }
    normal.cholesky().map_or_else(|| vec![0.0; channels], |c| c.solve(&gradient).iter().copied().collect())
}
