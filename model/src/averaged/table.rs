//! A pump as a table: flows, content and ripple over the pressures at its ports.
//!
//! Without springs, rings or droop nothing in a pump knows an absolute pressure, so flow per pressure depends on the
//! ratio of the two alone: one row over `s = √(P_inlet/P_outlet)`, in which the flow is nearly straight right up to
//! the stall. With them there are several rows over `ln P_outlet`. Springs on check valves mostly act like ports at
//! other pressures (gas enters at `P_inlet − p_c` and has to reach `P_outlet + p_c`), so places are counted in those:
//! the stall then stays at one `s` in all rows. Between nodes: cubics with Catmull-Rom slopes, so that first
//! derivatives are continuous.

use std::sync::Arc;

use super::cycle::PHASES;
use super::grid::{CELLS, Grid, NODES, PADDED, QUANTITIES};
use super::pump_geometry::PumpGeometry;
use crate::plant::lanes_of;
use crate::real::Real;

/// Quantities that the table holds, each per outlet pressure (beyond its spring) or in 1/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Flows<R> {
    /// Mean flow at the inlet and at the outlet in kg/s.
    pub(crate) drawn: R,
    pub(crate) delivered: R,
    /// Mean gas in the cylinders in kg.
    pub(crate) content: R,
    /// Growth of the two flows with gas beyond the mean, in 1/s.
    pub(crate) drawn_response: R,
    pub(crate) delivered_response: R,
    /// With what rate gas beyond the mean disappears, in 1/s.
    pub(crate) relaxation: R,
}

impl<R: Real> Flows<R> {
    /// A share of the way to others.
    #[inline(always)]
    pub(crate) fn towards(self, other: &Self, share: R) -> Self {
        let between = |here: R, there: R| share.mul_add(there - here, here);
        Flows {
            drawn: between(self.drawn, other.drawn),
            delivered: between(self.delivered, other.delivered),
            content: between(self.content, other.content),
            drawn_response: between(self.drawn_response, other.drawn_response),
            delivered_response: between(self.delivered_response, other.delivered_response),
            relaxation: between(self.relaxation, other.relaxation),
        }
    }
}

/// The table of one pump, or of one pump in each lane.
#[derive(Debug, Clone)]
pub(crate) struct PumpTable<R> {
    lowest: R,
    inverse_step: R,
    rows: usize,
    lowest_ln_outlet: R,
    inverse_ln_step: R,
    /// Cracking pressures of the check valves at inlet and outlet, in Pa.
    springs: [R; 2],
    /// One for each lane. Lanes mostly share theirs: a fit's rigs seldom differ in the pump.
    grids: Vec<Arc<Grid>>,
    /// Gas in all cylinders per pressure once they stand, in kg/Pa.
    pub(crate) content_per_pa: R,
    /// With what rate a standing pump evens out with its inlet and its outlet, in 1/s.
    pub(crate) standing: [R; 2],
}

impl PumpTable<f64> {
    /// The table of a pump; `smooth` ones are worked out where they are asked for, others at once: some milliseconds, or a few times
    /// that where absolute pressure matters.
    pub(crate) fn new(machine: &PumpGeometry, smooth: bool) -> Self {
        let grid = Grid::new(machine, smooth);
        if !smooth {
            grid.fill();
        }
        let content_per_pa = machine.content_per_pa();
        // Half open on average, the check valve of either side against all cylinders; choked flow's slope.
        let standing =
            [(machine.areas[0], machine.inlet_inverse_speed), (machine.areas[1], machine.cylinder_inverse_speed)].map(
                |(area, inverse_speed)| {
                    let rate = machine.phases.len() as f64 * area * inverse_speed / content_per_pa;
                    // No faster than the averaged plant's steps can follow.
                    rate.min(150.0)
                },
            );
        let places = grid.places();
        PumpTable {
            lowest: places.lowest,
            inverse_step: 1.0 / places.step,
            rows: places.rows,
            lowest_ln_outlet: places.lowest_ln_outlet,
            inverse_ln_step: 1.0 / places.ln_step,
            springs: places.springs,
            grids: vec![Arc::new(grid)],
            content_per_pa,
            standing,
        }
    }
}

impl<R: Real> PumpTable<R> {
    /// Merges twins; `None` if one knows absolute pressures and another does not.
    pub(crate) fn side_by_side(parts: &[&PumpTable<f64>]) -> Option<Self> {
        let first = parts.first()?;
        if parts.iter().any(|p| p.rows != first.rows) {
            return None;
        }
        let of_lane = |lane: usize| parts.get(lane).or(parts.last())?.grids.first().cloned();
        Some(PumpTable {
            lowest: lanes_of(parts, |p| p.lowest),
            inverse_step: lanes_of(parts, |p| p.inverse_step),
            rows: first.rows,
            lowest_ln_outlet: lanes_of(parts, |p| p.lowest_ln_outlet),
            inverse_ln_step: lanes_of(parts, |p| p.inverse_ln_step),
            springs: std::array::from_fn(|port: usize| lanes_of(parts, |p| p.springs[port])),
            grids: (0..R::LANES).map(of_lane).collect::<Option<_>>()?,
            content_per_pa: lanes_of(parts, |p| p.content_per_pa),
            standing: std::array::from_fn(|port: usize| lanes_of(parts, |p| p.standing[port])),
        })
    }

    /// Everything about the pump at port pressures in Pa; beyond the table it stays what it is at its edge.
    #[inline(always)]
    pub(crate) fn at(&self, inlet: R, outlet: R) -> Flows<R> {
        let [entering, beyond] = self.beyond_springs(inlet, outlet);
        let (cell, t) = self.place(entering, beyond);
        let [drawn, delivered, content, drawn_response, delivered_response, relaxation] =
            if self.rows == 1 { self.row(0, &cell, t) } else { self.between_rows(beyond, &cell, t) };
        Flows {
            drawn: drawn * beyond,
            delivered: delivered * beyond,
            content: content * beyond,
            drawn_response,
            delivered_response,
            relaxation,
        }
    }

    /// The pressures at which gas enters the cylinders and has to leave them, in Pa.
    #[inline(always)]
    fn beyond_springs(&self, inlet: R, outlet: R) -> [R; 2] {
        [inlet - self.springs[0], outlet + self.springs[1]]
    }

    /// The cell along `s` in each lane (lanes beyond the last repeat it), and the place within it.
    #[inline(always)]
    fn place(&self, entering: R, beyond: R) -> ([usize; MOST_LANES], R) {
        let s = (entering / beyond).at_least(R::splat(0.0)).sqrt();
        let at = ((s - self.lowest) * self.inverse_step).limited(R::splat(0.0), R::splat(CELLS as f64 - 1e-9));
        let cell: [usize; MOST_LANES] =
            std::array::from_fn(|lane| if lane < R::LANES { at.lane(lane) as usize } else { 0 });
        (cell, at - R::from_lanes(|lane| cell[lane] as f64))
    }

    /// Values of a row at a place of a cell in each lane. No closure: it would not be compiled for the instruction set
    /// of the tick around it.
    #[inline(always)]
    fn row(&self, row: usize, cell: &[usize; MOST_LANES], t: R) -> [R; QUANTITIES] {
        let mut values = [[0.0; PADDED]; MOST_LANES];
        for lane in 0..R::LANES {
            values[lane] = self.grids[lane].cell(row * CELLS + cell[lane]).at(t.lane(lane));
        }
        let mut row = [R::splat(0.0); QUANTITIES];
        for (q, slot) in row.iter_mut().enumerate() {
            *slot = R::from_lanes(|lane| values[lane][q]);
        }
        row
    }

    /// A cubic through four rows at an outlet pressure beyond its spring.
    #[inline(always)]
    fn between_rows(&self, beyond: R, cell: &[usize; MOST_LANES], t: R) -> [R; QUANTITIES] {
        let last = self.rows - 1;
        let at = self.row_at(beyond);
        let mut sum = [R::splat(0.0); QUANTITIES];
        for n in 0..self.rows {
            // The weight of row `n`: Catmull-Rom's, with the ends' neighbours standing in for what is beyond.
            let weight = at.map(|at| row_weight(at, n, last));
            if weight.any_above(R::splat(0.0)) || (-weight).any_above(R::splat(0.0)) {
                for (sum, value) in sum.iter_mut().zip(self.row(n, cell, t)) {
                    *sum = weight.mul_add(value, *sum);
                }
            }
        }
        sum
    }

    /// Gas drawn and delivered beyond the mean at a phase of the crank (in revolutions), in kg.
    #[inline(always)]
    pub(crate) fn ripple(&self, inlet: R, outlet: R, phase: R) -> [R; 2] {
        let mut at_phase = [AtPhase { first: 0, share: 0.0 }; MOST_LANES];
        for (lane, slot) in at_phase.iter_mut().enumerate().take(R::LANES) {
            let phase = phase.lane(lane);
            let turned = (phase - phase.floor()) * PHASES as f64;
            *slot = AtPhase { first: turned as usize, share: turned.fract() };
        }
        self.between_nodes(inlet, outlet, &at_phase)
    }

    /// The least and the most gas drawn, and delivered, beyond the mean within a revolution, in kg.
    #[inline(always)]
    pub(crate) fn swing(&self, inlet: R, outlet: R) -> [[R; 2]; 2] {
        let [least_drawn, most_drawn, least_delivered, most_delivered] =
            self.between_nodes(inlet, outlet, &[Swing; MOST_LANES]);
        [[least_drawn, most_drawn], [least_delivered, most_delivered]]
    }

    /// Values of nodes of each lane's grid per outlet pressure, on straight lines between them.
    #[inline(always)]
    fn between_nodes<const N: usize>(&self, inlet: R, outlet: R, held: &[impl Held<N>; MOST_LANES]) -> [R; N] {
        let [entering, beyond] = self.beyond_springs(inlet, outlet);
        let (cell, t) = self.place(entering, beyond);
        let row = self.row_at(beyond);
        let mut lanes = [[0.0; N]; MOST_LANES];
        for lane in 0..R::LANES {
            let (grid, held, t) = (&self.grids[lane], &held[lane], t.lane(lane));
            let (below, between) = (row.lane(lane) as usize, row.lane(lane).fract());
            let node = below * NODES + cell[lane];
            let mut value = line(held.at(grid, node), held.at(grid, node + 1), t);
            if between > 0.0 {
                let above = line(held.at(grid, node + NODES), held.at(grid, node + NODES + 1), t);
                value = line(value, above, between);
            }
            lanes[lane] = value;
        }
        let mut all = [R::splat(0.0); N];
        for (i, slot) in all.iter_mut().enumerate() {
            *slot = R::from_lanes(|lane| lanes[lane][i]) * beyond;
        }
        all
    }

    /// The place among the rows, 0 … the last.
    #[inline(always)]
    fn row_at(&self, beyond: R) -> R {
        if self.rows == 1 {
            return R::splat(0.0);
        }
        ((beyond.map(f64::ln) - self.lowest_ln_outlet) * self.inverse_ln_step)
            .limited(R::splat(0.0), R::splat((self.rows - 1) as f64 - 1e-9))
    }
}

/// The most lanes of a bundle.
const MOST_LANES: usize = 8;

/// Quantity that a node of a grid holds. A trait and not a closure, for the same reason as [`PumpTable::row`].
trait Held<const N: usize> {
    fn at(&self, grid: &Grid, node: usize) -> [f64; N];
}

/// The ripple at a phase: the one tabled before it, and the share of the way to the next.
#[derive(Clone, Copy)]
struct AtPhase {
    first: usize,
    share: f64,
}

impl Held<2> for AtPhase {
    #[inline(always)]
    fn at(&self, grid: &Grid, node: usize) -> [f64; 2] {
        let [a, b] = [self.first, self.first + 1].map(|phase| grid.ripple(node, phase % PHASES));
        line(a, b, self.share)
    }
}

/// The ripple's least and most: of what is drawn, then of what is delivered.
#[derive(Clone, Copy)]
struct Swing;

impl Held<4> for Swing {
    #[inline(always)]
    fn at(&self, grid: &Grid, node: usize) -> [f64; 4] {
        let [drawn, delivered] = grid.swing(node);
        [drawn[0], drawn[1], delivered[0], delivered[1]]
    }
}

/// Values on the straight line from `a` to `b`.
#[inline(always)]
fn line<const N: usize>(a: [f64; N], b: [f64; N], share: f64) -> [f64; N] {
    let mut values = a;
    for (value, b) in values.iter_mut().zip(b) {
        *value += share * (b - *value);
    }
    values
}

/// The weight of node `n` of 0 … `last` at a place between nodes, for a cubic with Catmull-Rom slopes.
fn row_weight(at: f64, n: usize, last: usize) -> f64 {
    let cell = (at as usize).min(last - 1);
    let t = at - cell as f64;
    let (t2, t3) = (t * t, t * t * t);
    let (h10, h11) = (t3 - 2.0 * t2 + t, t3 - t2);
    let h01 = 3.0 * t2 - 2.0 * t3;
    let slope = |i: usize| {
        let (before, after) = (i.saturating_sub(1), (i + 1).min(last));
        let per = 1.0 / (after - before) as f64;
        (if n == after { per } else { 0.0 }) - (if n == before { per } else { 0.0 })
    };
    let value = |i: usize| if n == i { 1.0 } else { 0.0 };
    (1.0 - h01) * value(cell) + h01 * value(cell + 1) + h10 * slope(cell) + h11 * slope(cell + 1)
}
