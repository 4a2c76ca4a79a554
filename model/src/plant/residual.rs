//! Tabled flows and areas of the mechanism `residual_flow`: what they look up, and its memory.

use super::Scratch;
use super::elements::lanes_of;
use crate::mechanism::Table;
use crate::real::Real;

/// A variable that a table is over (mechanism `residual_flow`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Variable {
    /// The duty that acts along a command path.
    Duty { command: usize },
    /// The gauge pressure of a node in kPa.
    Pressure { node: usize },
    /// The difference between two nodes in kPa.
    Difference { up: usize, down: usize },
}

/// A variable with its memory.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Probe<R> {
    pub(crate) variable: Variable,
    /// Where in the memory its lagged value lives, if it lags.
    pub(crate) memory: Option<usize>,
    /// True where the table is over the way from the lagged value to the present one.
    pub(crate) departure: bool,
    /// Share of the distance covered in one step.
    pub(crate) approach: R,
    /// Part of the variable's way in a step that it goes for.
    pub(crate) ahead: R,
}

/// Where a tabled flow goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Target {
    /// Into a node.
    Node(usize),
    /// On top of the area of the valve that asks for this entry.
    Area,
}

/// A tabled flow or area (mechanism `residual_flow`).
#[derive(Debug, Clone)]
pub(crate) struct Residual<R> {
    pub(crate) target: Target,
    pub(crate) probes: Vec<Probe<R>>,
    pub(crate) table: Table<R>,
    /// Temperature of what comes in, in K.
    pub(crate) temperature: R,
}

impl<R: Real> Residual<R> {
    /// Merges twins; `None` if their structure differs.
    pub(crate) fn side_by_side(parts: &[Residual<f64>]) -> Option<Self> {
        let first = parts.first()?;
        let alike = |p: &Residual<f64>| {
            p.target == first.target
                && p.probes.len() == first.probes.len()
                && p.probes
                    .iter()
                    .zip(&first.probes)
                    .all(|(a, b)| (a.variable, a.memory, a.departure) == (b.variable, b.memory, b.departure))
        };
        if !parts.iter().all(alike) {
            return None;
        }
        let probe = |(i, probe): (usize, &Probe<f64>)| Probe {
            variable: probe.variable,
            memory: probe.memory,
            departure: probe.departure,
            approach: lanes_of(parts, |p| p.probes.get(i).map_or(f64::NAN, |probe| probe.approach)),
            ahead: lanes_of(parts, |p| p.probes.get(i).map_or(f64::NAN, |probe| probe.ahead)),
        };
        Some(Residual {
            target: first.target,
            probes: first.probes.iter().enumerate().map(probe).collect(),
            table: Table::side_by_side(&parts.iter().map(|p| &p.table).collect::<Vec<_>>())?,
            temperature: lanes_of(parts, |p| p.temperature),
        })
    }
}

impl Variable {
    /// Value at instant `k`, for pressures `x` in Pa by node.
    #[inline(always)]
    pub(crate) fn at<R: Real, const NODES: usize>(
        self,
        scratch: &Scratch<R>,
        atmosphere_pa: R,
        x: &[R; NODES],
        k: usize,
    ) -> R {
        match self {
            Variable::Duty { command } => scratch.duty(command, k),
            Variable::Pressure { node } => (x[node % NODES] - atmosphere_pa) * R::splat(1e-3),
            Variable::Difference { up, down } => (x[up % NODES] - x[down % NODES]) * R::splat(1e-3),
        }
    }
}

impl<R: Real> Residual<R> {
    /// The tabled value at instant `k`.
    #[inline(always)]
    pub(crate) fn at<const NODES: usize>(
        &self,
        scratch: &Scratch<R>,
        memory: &[R],
        atmosphere_pa: R,
        x: &[R; NODES],
        k: usize,
    ) -> R {
        let mut place = [R::splat(0.0); 2];
        for (slot, probe) in place.iter_mut().zip(&self.probes) {
            let lagged = probe.memory.and_then(|m| memory.get(m)).copied();
            *slot = match lagged {
                Some(lagged) if !probe.departure => lagged,
                Some(lagged) => probe.variable.at(scratch, atmosphere_pa, x, k) - lagged,
                None => probe.variable.at(scratch, atmosphere_pa, x, k),
            };
        }
        self.table.at(&place[..self.probes.len().min(2)])
    }
}
