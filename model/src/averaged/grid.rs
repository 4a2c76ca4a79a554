//! Flows of a pump at the nodes of its table, worked out where it is asked for.
//!
//! A fit moves the pump, or a chamber that it breathes into, in every other run, and each has a table of its own; but a rig's
//! pressures stay in a part of it, and where absolute pressure matters in a corner. So nodes are worked out eight at a time when a
//! run first comes near them. What they hold does not depend on when that is.
//!
//! # Real-time
//! A grid that is to be read in a tick is [filled](Grid::fill) before.

use std::sync::OnceLock;

use super::cycle::{Bench, Cells, Eight, PHASES};
use super::pump_geometry::PumpGeometry;
use crate::real::Real;

/// Nodes along `s`: a whole number of eights.
pub(super) const NODES: usize = 48;
/// Cells between them.
pub(super) const CELLS: usize = NODES - 1;
/// Rows over the outlet pressure, where absolute pressure matters.
const ROWS: usize = 7;
/// Outlet pressures of the first and the last row, by the atmosphere's.
const ROWS_FROM: f64 = 0.5;
const ROWS_TO: f64 = 10.0;
/// The highest `s`: an inlet at twice the pressure of the outlet.
const HIGHEST: f64 = 1.41;

pub(super) const QUANTITIES: usize = 6;
/// Quantities rounded up to whole registers.
pub(super) const PADDED: usize = 8;

/// Cubics of all quantities in the place within a cell, `[power][quantity]`, lowest power first: one quantity after the
/// other, so that all of them are worked out at once whatever lane they are for.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(super) struct Cubics([[f64; PADDED]; 4]);

impl Cubics {
    /// All quantities at `t` of the cell.
    #[inline(always)]
    pub(super) fn at(&self, t: f64) -> [f64; PADDED] {
        let [y0, y1, y2, y3] = &self.0;
        let mut value = *y3;
        for power in [y2, y1, y0] {
            for (value, addend) in value.iter_mut().zip(power) {
                *value = value.mul_add(t, *addend);
            }
        }
        value
    }
}

/// Where the nodes lie.
#[derive(Debug, Clone, Copy)]
pub(super) struct Places {
    /// The first `s`, and from each to the next.
    pub(super) lowest: f64,
    pub(super) step: f64,
    pub(super) rows: usize,
    /// The logarithm of the first row's outlet pressure in Pa, and from each to the next.
    pub(super) lowest_ln_outlet: f64,
    pub(super) ln_step: f64,
    /// Cracking pressures of the check valves at inlet and outlet, in Pa.
    pub(super) springs: [f64; 2],
    atmosphere_pa: f64,
}

impl Places {
    fn of(machine: &PumpGeometry) -> Self {
        let lowest = 0.8 / machine.compression_ratio().sqrt();
        let springs = machine.springs.map(|spring| spring.cracking_pa);
        let [from, to] = [ROWS_FROM, ROWS_TO].map(|row| (row * machine.atmosphere_pa + springs[1]).ln());
        Places {
            lowest,
            step: (HIGHEST - lowest) / CELLS as f64,
            rows: if machine.scales() { 1 } else { ROWS },
            lowest_ln_outlet: from,
            ln_step: (to - from) / (ROWS - 1) as f64,
            springs,
            atmosphere_pa: machine.atmosphere_pa,
        }
    }

    /// Pressures at the ports of a node, and the one that its row stands for, in Pa.
    fn pressures_at(&self, node: usize) -> [f64; 3] {
        let (row, node) = (node / NODES, node % NODES);
        // A pump that scales may be worked out anywhere.
        let beyond = if self.rows == 1 {
            2.0 * self.atmosphere_pa
        } else {
            (self.lowest_ln_outlet + self.ln_step * row as f64).exp()
        };
        let s = self.lowest + self.step * node as f64;
        [s * s * beyond + self.springs[0], beyond - self.springs[1], beyond]
    }
}

/// Flows of one pump at its nodes; rows one after the other.
#[derive(Debug)]
pub(super) struct Grid {
    bench: Bench,
    places: Places,
    eights: Vec<OnceLock<EightNodes>>,
    cells: Vec<OnceLock<Cubics>>,
}

/// Eight nodes of one row.
#[derive(Debug)]
struct EightNodes {
    quantities: [[f64; QUANTITIES]; Eight::LANES],
    /// Gas drawn and delivered beyond the mean per outlet pressure, in kg/Pa: `[node][phase]`, flattened.
    ripple: Vec<[f64; 2]>,
    /// The least and the most of it over a revolution, by node.
    swing: [[[f64; 2]; 2]; Eight::LANES],
}

impl Grid {
    pub(super) fn new(machine: &PumpGeometry, smooth: bool) -> Self {
        let places = Places::of(machine);
        let empty = |count: usize| places.rows * count;
        Grid {
            bench: Bench::new(machine, smooth),
            places,
            eights: (0..empty(NODES / Eight::LANES)).map(|_| OnceLock::new()).collect(),
            cells: (0..empty(CELLS)).map(|_| OnceLock::new()).collect(),
        }
    }

    pub(super) fn places(&self) -> Places {
        self.places
    }

    /// Works out all of it.
    pub(super) fn fill(&self) {
        for cell in 0..self.cells.len() {
            self.cell(cell);
        }
    }

    /// A cell, counted through all rows.
    #[inline(always)]
    pub(super) fn cell(&self, cell: usize) -> &Cubics {
        match self.cells[cell].get() {
            Some(known) => known,
            None => self.new_cell(cell),
        }
    }

    /// Gas drawn and delivered beyond the mean per outlet pressure at a phase, in kg/Pa.
    #[inline(always)]
    pub(super) fn ripple(&self, node: usize, phase: usize) -> [f64; 2] {
        self.eight(node).ripple[node % Eight::LANES * PHASES + phase]
    }

    /// The least and the most of it over a revolution, of what is drawn and of what is delivered.
    #[inline(always)]
    pub(super) fn swing(&self, node: usize) -> [[f64; 2]; 2] {
        self.eight(node).swing[node % Eight::LANES]
    }

    #[inline(always)]
    fn eight(&self, node: usize) -> &EightNodes {
        match self.eights[node / Eight::LANES].get() {
            Some(known) => known,
            None => self.new_eight(node / Eight::LANES),
        }
    }

    #[cold]
    #[inline(never)]
    fn new_eight(&self, eight: usize) -> &EightNodes {
        self.eights[eight].get_or_init(|| {
            let at = |lane: usize| self.places.pressures_at(eight * Eight::LANES + lane);
            let [inlet, outlet, beyond] = [0, 1, 2].map(|which: usize| Eight::from_lanes(|lane| at(lane)[which]));
            let cells = self.bench.cells(inlet, outlet);
            let mut ripple = Vec::with_capacity(Eight::LANES * PHASES);
            for lane in 0..Eight::LANES {
                let beyond = beyond.lane(lane);
                let pairs = cells.drawn_ripple.iter().zip(&cells.delivered_ripple);
                ripple
                    .extend(pairs.map(|(drawn, delivered)| [drawn.lane(lane) / beyond, delivered.lane(lane) / beyond]));
            }
            EightNodes {
                quantities: std::array::from_fn(|lane| {
                    quantities(self.bench.machine(), &cells, lane, beyond.lane(lane))
                }),
                swing: std::array::from_fn(|lane| swing(&ripple[lane * PHASES..(lane + 1) * PHASES])),
                ripple,
            }
        })
    }

    #[cold]
    #[inline(never)]
    fn new_cell(&self, cell: usize) -> &Cubics {
        self.cells[cell].get_or_init(|| {
            let (row, cell) = (cell / CELLS, cell % CELLS);
            cubics(cell, |node| {
                let node = row * NODES + node;
                self.eight(node).quantities[node % Eight::LANES]
            })
        })
    }
}

/// The least and the most of a node's ripple, of what is drawn and of what is delivered.
fn swing(phases: &[[f64; 2]]) -> [[f64; 2]; 2] {
    [0, 1].map(|port| {
        let of = |end: fn(f64, f64) -> f64| phases.iter().map(|phase| phase[port]).fold(0.0, end);
        [of(f64::min), of(f64::max)]
    })
}

/// One node's numbers, per outlet pressure.
fn quantities(machine: &PumpGeometry, cells: &Cells, lane: usize, outlet: f64) -> [f64; QUANTITIES] {
    let [drawn, delivered] = [cells.drawn, cells.delivered].map(|flow| flow.lane(lane) / outlet);
    let [a, b] = [cells.drawn_response, cells.delivered_response].map(|response| response.lane(lane));
    // Where nothing but the ports lets gas in or out, what is drawn is delivered, to the last bit.
    let (delivered, relaxation) =
        if machine.blowby == 0.0 { (drawn, b - a) } else { (delivered, cells.relaxation.lane(lane)) };
    [drawn, delivered, cells.content.lane(lane) / outlet, a, b, relaxation]
}

/// The cubics of a cell, given what the nodes of its row hold.
fn cubics(cell: usize, node: impl Fn(usize) -> [f64; QUANTITIES]) -> Cubics {
    // Its own two nodes, and one beyond either, where there is one.
    let near = [cell.saturating_sub(1), cell, cell + 1, (cell + 2).min(CELLS)];
    let [before, here, there, after] = near.map(node);
    let mut powers = [[0.0; PADDED]; 4];
    for q in 0..QUANTITIES {
        let (y0, y1) = (here[q], there[q]);
        let d0 = (y1 - before[q]) / (cell + 1 - near[0]) as f64;
        let d1 = (after[q] - y0) / (near[3] - cell) as f64;
        let cubic = [y0, d0, 3.0 * (y1 - y0) - 2.0 * d0 - d1, 2.0 * (y0 - y1) + d0 + d1];
        for (power, value) in powers.iter_mut().zip(cubic) {
            power[q] = value;
        }
    }
    Cubics(powers)
}
