//! A term without a name: what is missing, as a table over what it turns out to depend on.
//!
//! The reconstructed missing flow (or, over ψ, the missing area of a valve) is regressed on hat functions of one or two
//! variables, with and without memory; the variables that explain most of it, block by block on rows that were left
//! out, make the axes. The table is then fitted in free runs like any other mechanism (`residual_flow`), so that the
//! rig file simulates with it everywhere. It says where, how much, and on what it depends; it does not say what it is.
//! Formulas are tried first: an answer of second order, where a reading is off while its chamber behaves (`unknown/response.rs`), and
//! a dead end of a chamber (`unknown/dead_end.rs`).

use fit::data::Role;
use fit::parameters::{Knowledge, Parameter, ParameterSet, SearchRange, Transform};
use model::mechanism::{Axis, Mechanism, ResidualFlow, Shape, Variable};
use model::rig::{MechanismInstance, Rig};
use nalgebra::{DMatrix, DVector};
use proto::recording::PERIOD_S;

use crate::bench::{Bench, Effort, Explanation};
use crate::error::DiagnoseError;
use crate::judge::evidence::evidence;
use crate::locate::Missing;
use crate::report::wording::three;
use crate::search::place::volumes_at;

mod dead_end;
mod response;

/// Knots of the only axis, and of each of two.
const KNOTS: [usize; 2] = [9, 5];
/// Time constants of memories that are tried, in ms.
const MEMORIES_MS: [f64; 3] = [60.0, 300.0, 1500.0];

/// Variables that a term may depend on.
#[derive(Debug, Clone, PartialEq)]
struct Design {
    volume: String,
    axes: Vec<Axis>,
    /// Variance explained on rows that were left out, 0 … 1.
    explained: f64,
}

/// A fitted term.
#[derive(Debug, Clone)]
pub struct UnknownTerm {
    /// The explanation with the term in it.
    pub explanation: Explanation,
    /// Words for what it depends on.
    pub depends_on: String,
    /// The channel whose reading it is about; `None` for a flow.
    pub reading: Option<usize>,
}

/// A formula for a reading or a chamber, and what it is worth.
#[derive(Debug, Clone)]
pub struct Formula {
    pub(crate) term: UnknownTerm,
    gain: f64,
    /// True where it takes more away than it leaves.
    pub suffices: bool,
}

/// Fits the formulas; the one that gains most, `None` if none makes the rig better on rows that choose.
pub fn formula(bench: &Bench<'_>, base: &Explanation) -> Option<Formula> {
    let response = response::fit_response(bench, base).and_then(|term| Formula::of(bench, base, term));
    [response, dead_end(bench, base)].into_iter().flatten().max_by(|a, b| a.gain.total_cmp(&b.gain))
}

/// Fits a dead end of the chamber that gains most by one; `None` if that makes the rig no better on rows that choose.
pub fn dead_end(bench: &Bench<'_>, base: &Explanation) -> Option<Formula> {
    dead_end::fit_dead_end(bench, base).and_then(|term| Formula::of(bench, base, term))
}

impl Formula {
    fn of(bench: &Bench<'_>, base: &Explanation, term: UnknownTerm) -> Option<Self> {
        let noise = bench.sigma_kpa().iter().map(|s| s * s).sum::<f64>() / bench.noise.len().max(1) as f64;
        let left = bench.squares(&term.explanation.trace, Role::Select) - noise;
        gain(bench, base, &term).map(|gain| Formula { term, gain, suffices: left < gain })
    }
}

/// A fitted number with its interval, for words.
fn told(explanation: &Explanation, index: usize) -> String {
    explanation.fitted.estimates.get(index).map_or_else(String::new, |estimate| {
        let [low, high] = estimate.interval();
        format!("{} ({} … {})", three(estimate.value), three(low), three(high))
    })
}

/// By how much a term lowers the mean squared error (kPa²) on rows that choose, if it does so and is likely as well:
/// likelihood alone forgives what is slow and large.
fn gain(bench: &Bench<'_>, base: &Explanation, term: &UnknownTerm) -> Option<f64> {
    let found = evidence(bench, &term.explanation, base);
    let gain = bench.squares(&base.trace, Role::Select) - bench.squares(&term.explanation.trace, Role::Select);
    (found.chosen > 0.0 && gain > 0.0).then_some(gain)
}

/// Fits a term for what `base` leaves out; `None` if none makes the rig better on rows that choose, both by what is likely
/// and by what the free run is off. `fitted` is how many sets of variables, the most promising first, are fitted in free runs;
/// a `formula` that suffices is better than a table that might take away more.
///
/// # Errors
/// A fit failed for another reason than the term.
pub fn fit_unknown(
    bench: &Bench<'_>,
    base: &Explanation,
    missing: &Missing,
    fitted: usize,
    formula: Option<Formula>,
) -> Result<Option<UnknownTerm>, DiagnoseError> {
    let mut best = match formula {
        Some(formula) if formula.suffices => return Ok(Some(formula.term)),
        other => other.map(|formula| (formula.gain, formula.term)),
    };
    let mut designs = Vec::new();
    for (channel, volume) in channels(bench) {
        for axes in variables(&base.fitted.rig, &volume) {
            let columns: Option<Vec<_>> = axes.iter().map(|axis| column(bench, base, axis)).collect();
            let Some(columns) = columns else { continue };
            let axes = with_knots(axes, &columns);
            let explained = explained(bench, missing, channel, &axes, &columns);
            designs.push(Design { volume: volume.clone(), axes, explained });
        }
    }
    designs.sort_by(|a, b| b.explained.total_cmp(&a.explained));
    for design in designs.iter().take(fitted) {
        let Ok(explanation) = fit_design(bench, base, design, missing) else { continue };
        let term = UnknownTerm { explanation, depends_on: words(design), reading: None };
        if let Some(gain) = gain(bench, base, &term)
            && best.as_ref().is_none_or(|(most, _)| gain > *most)
        {
            best = Some((gain, term));
        }
    }
    Ok(best.map(|(_, term)| term))
}

/// Channels with the volume that each reads.
fn channels(bench: &Bench<'_>) -> Vec<(usize, String)> {
    bench
        .records
        .sensors()
        .iter()
        .enumerate()
        .filter_map(|(c, column)| {
            let (_, sensor) = bench.rig.sensor_of(column)?;
            Some((c, sensor.volume.clone()))
        })
        .collect()
}

/// Sets of axes (without knots) that are tried for a flow into `volume`.
fn variables(rig: &Rig, volume: &str) -> Vec<Vec<Axis>> {
    let axis = |variable, of: &str, memory: Option<f64>, departure| Axis {
        variable,
        of: of.to_owned(),
        time_constant_ms: memory,
        departure,
        knots: Vec::new(),
    };
    let mut own = vec![axis(Variable::Pressure, volume, None, false)];
    for valve in rig.valves.keys().filter(|v| volumes_at(rig, v).contains(&volume)) {
        own.push(axis(Variable::Duty, valve, None, false));
        own.extend(MEMORIES_MS.map(|ms| axis(Variable::Duty, valve, Some(ms), true)));
    }
    own.extend(MEMORIES_MS.map(|ms| axis(Variable::Pressure, volume, Some(ms), true)));
    for other in rig.volumes.keys().filter(|v| *v != volume) {
        own.push(axis(Variable::Pressure, other, None, false));
    }
    let mut all: Vec<Vec<Axis>> = own.iter().cloned().map(|a| vec![a]).collect();
    for (i, one) in own.iter().enumerate() {
        for other in own.iter().skip(i + 1) {
            all.push(vec![one.clone(), other.clone()]);
        }
    }
    all
}

/// The values of an axis along the recordings, by recording and row; `None` for what cannot be worked out here.
fn column(bench: &Bench<'_>, base: &Explanation, axis: &Axis) -> Option<Vec<Vec<f64>>> {
    let records = bench.records;
    let layout = records.layout();
    let raw: Vec<Vec<f64>> = match axis.variable {
        Variable::Duty => {
            let command = &bench.rig.valves.get(&axis.of)?.command;
            (0..layout.records()).map(|r| records.input(r, command).map(<[f64]>::to_vec)).collect::<Option<_>>()?
        }
        Variable::Pressure => {
            let channel = crate::search::place::channel_of(bench.rig, &axis.of)?;
            (0..layout.records())
                .map(|r| base.trace.get(layout.channel(r, channel)).map(<[f64]>::to_vec))
                .collect::<Option<_>>()?
        }
        Variable::Difference => return None,
    };
    let Some(ms) = axis.time_constant_ms else { return Some(raw) };
    let keep = (-PERIOD_S / (1e-3 * ms)).exp();
    Some(
        raw.into_iter()
            .map(|values| {
                let mut lagged = values.first().copied().unwrap_or(0.0);
                values
                    .into_iter()
                    .map(|v| {
                        let now = if axis.departure { v - lagged } else { lagged };
                        lagged = v + keep * (lagged - v);
                        now
                    })
                    .collect()
            })
            .collect(),
    )
}

/// Puts knots where the values are: at even shares of them, the ends included.
fn with_knots(mut axes: Vec<Axis>, columns: &[Vec<Vec<f64>>]) -> Vec<Axis> {
    let count = KNOTS[axes.len().min(2) - 1];
    for (axis, column) in axes.iter_mut().zip(columns) {
        let mut values: Vec<f64> = column.iter().flatten().copied().filter(|v| v.is_finite()).collect();
        values.sort_by(f64::total_cmp);
        let at = |share: f64| values.get(((values.len() as f64 - 1.0) * share) as usize).copied().unwrap_or(0.0);
        let (low, high) = (at(0.01), at(0.99));
        let even = |k: usize| low + (high - low) * k as f64 / (count - 1) as f64;
        // Half way between even spacing and even shares: tails keep some resolution, the crowd gets more.
        axis.knots = (0..count).map(|k| 0.5 * (even(k) + at(0.01 + 0.98 * k as f64 / (count - 1) as f64))).collect();
        axis.knots.dedup_by(|b, a| *b - *a < 1e-9 + 1e-6 * (high - low));
        if axis.knots.len() < 2 {
            axis.knots = vec![low, low + 1e-3];
        }
    }
    axes
}

/// Weights of the knots at a value: one or two that are not zero.
fn hats(knots: &[f64], value: f64) -> [(usize, f64); 2] {
    let last = knots.len() - 1;
    let above = knots.partition_point(|k| *k <= value);
    if above == 0 {
        return [(0, 1.0), (0, 0.0)];
    }
    if above > last {
        return [(last, 1.0), (last, 0.0)];
    }
    let (low, high) = (knots[above - 1], knots[above]);
    let share = (value - low) / (high - low);
    [(above - 1, 1.0 - share), (above, share)]
}

/// A row that was left out: knots with their weights, the flow, its weight.
type Held = (Vec<(usize, f64)>, f64, f64);

/// Share of the missing flow's variance that a table over these axes explains, on every second block of 5 s, fitted on
/// the others.
fn explained(bench: &Bench<'_>, missing: &Missing, channel: usize, axes: &[Axis], columns: &[Vec<Vec<f64>>]) -> f64 {
    const BLOCK: usize = 250;
    let size: usize = axes.iter().map(|a| a.knots.len()).product();
    let mut normal = DMatrix::<f64>::zeros(size, size);
    let mut right = DVector::<f64>::zeros(size);
    let mut held: Vec<Held> = Vec::new();
    for flow in missing.flows.iter().filter(|f| f.channel == channel) {
        for row in (0..bench.records.layout().rows(flow.record)).step_by(3) {
            let (Some(y), Some(sd)) = (flow.flow_kg_s.get(row), flow.sd_kg_s.get(row)) else { continue };
            let mut terms = vec![(0, 1.0)];
            for (axis, column) in axes.iter().zip(columns) {
                let value = column.get(flow.record).and_then(|c| c.get(row)).copied().unwrap_or(0.0);
                let hats = hats(&axis.knots, value);
                terms = terms
                    .iter()
                    .flat_map(|(i, w)| hats.map(|(k, h)| (i * axis.knots.len() + k, w * h)))
                    .filter(|(_, w)| *w != 0.0)
                    .collect();
            }
            let weight = 1.0 / (sd * sd).max(1e-24);
            if (row / BLOCK).is_multiple_of(2) {
                for (i, a) in &terms {
                    right[*i] += weight * a * y;
                    for (k, b) in &terms {
                        normal[(*i, *k)] += weight * a * b;
                    }
                }
            } else {
                held.push((terms, *y, weight));
            }
        }
    }
    let ridge = 1e-4 * normal.trace() / size as f64 + 1e-12;
    for i in 0..size {
        normal[(i, i)] += ridge;
    }
    let Some(solved) = normal.cholesky().map(|c| c.solve(&right)) else { return 0.0 };
    let (mut left, mut all) = (0.0, 0.0);
    for (terms, y, weight) in &held {
        let predicted: f64 = terms.iter().map(|(i, a)| a * solved[*i]).sum();
        left += weight * (y - predicted).powi(2);
        all += weight * y * y;
    }
    if all > 0.0 { 1.0 - left / all } else { 0.0 }
}

/// Fits a table in free runs, on top of `base`.
fn fit_design(
    bench: &Bench<'_>,
    base: &Explanation,
    design: &Design,
    missing: &Missing,
) -> Result<Explanation, DiagnoseError> {
    let size: usize = design.axes.iter().map(|a| a.knots.len()).product();
    // Sizes that the reconstruction calls for, in mg/s.
    let scale = missing.flows.iter().flat_map(|f| &f.flow_kg_s).map(|v| (1e6 * v).powi(2)).sum::<f64>()
        / missing.flows.iter().map(|f| f.flow_kg_s.len()).sum::<usize>().max(1) as f64;
    let scale = scale.sqrt().max(1.0);
    let mut rig = base.fitted.rig.clone();
    let at = rig.mechanisms.len();
    rig.mechanisms.push(MechanismInstance {
        component: design.volume.clone(),
        enabled: true,
        mechanism: Mechanism::ResidualFlow(ResidualFlow {
            shape: Shape::Linear,
            flow_mg_per_s: vec![0.0; size],
            area_mm2: Vec::new(),
            axes: design.axes.clone(),
        }),
    });
    let table = (0..size).map(|i| Parameter {
        path: format!("mechanisms.{at}.flow_mg_per_s.{i}"),
        transform: Transform::Linear,
        mean: 0.0,
        knowledge: Knowledge::Prior { sd: 2.0 * scale },
        bounds: [-50.0 * scale, 50.0 * scale],
        range: SearchRange::Whole,
    });
    let start = base.fitted.point.clone();
    fit_further(bench, base, &rig, table, [start])
}

/// Fits `rig`, which has something that `base` has not, with the parameters of that beside the base's; from these points of the
/// base, and the means of what is new.
fn fit_further(
    bench: &Bench<'_>,
    base: &Explanation,
    rig: &Rig,
    further: impl IntoIterator<Item = Parameter>,
    starts: impl IntoIterator<Item = Vec<f64>>,
) -> Result<Explanation, DiagnoseError> {
    let free = base.set.parameters().iter().cloned().chain(further).collect();
    let set = ParameterSet::new(rig, free).map_err(DiagnoseError::rig(rig))?;
    let mut starts: Vec<Vec<f64>> = starts.into_iter().collect();
    starts.iter_mut().for_each(|start| start.resize(set.len(), 0.0));
    bench.fit_set(&base.terms, set, &starts, Effort::Polish)
}

fn words(design: &Design) -> String {
    let of = |axis: &Axis| {
        let what = match axis.variable {
            Variable::Duty => format!("the duty of {}", axis.of),
            Variable::Pressure => format!("the {} pressure", axis.of),
            Variable::Difference => format!("the pressure across {}", axis.of),
        };
        match axis.time_constant_ms {
            Some(ms) if axis.departure => format!("how far {what} is from where it was {:.2} s ago", 1e-3 * ms),
            Some(ms) => format!("{what} of the last {:.2} s", 1e-3 * ms),
            None => what,
        }
    };
    format!(
        "a flow into the {} chamber that depends on {}",
        design.volume,
        design.axes.iter().map(of).collect::<Vec<_>>().join(" and ")
    )
}
