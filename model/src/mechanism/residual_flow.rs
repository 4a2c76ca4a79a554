//! `residual_flow`: flow or opening that nobody has a name for, as a table.
//!
//! A fitted stand-in for physics that the library lacks:
//!
//! ```text
//! ṁ = f(z₁[, z₂])   into a volume, in mg/s         or
//! a = f(z₁[, z₂])   on top of a valve's area, in mm² (the sum stays at least zero)
//! ```
//!
//! over one or two variables: the duty that acts on a valve, the gauge pressure of a volume, or the difference across
//! a valve. A variable may have a memory: with `time_constant_ms` it is what a first-order lag makes of it,
//! `τ ż = v − z`, and with `departure = true` by how much it is away from that, `v − z`, which is where hysteresis and
//! unmodelled lags show. Between the knots `f` is straight (`linear`) or a cubic through the neighbours (`cubic`,
//! Catmull-Rom slopes, continuous first derivative); beyond the last knots it stays what it is there. What flows in
//! comes from the open air at its temperature, what flows out has the chamber's.
//!
//! Values run over the first axis slowest: `value[i·n₂ + j]` belongs to knot `i` of the first and `j` of the second.
//! It names nothing: it says where something is missing and how much, and lets the rig be simulated with it.

use serde::{Deserialize, Serialize};

use super::{Form, Physics, Place};
use crate::plant::lanes_of;
use crate::real::Real;
use crate::rig::{Number, Numbers, Rig, RigError, names, within};

/// The most knots of an axis.
const MOST_KNOTS: usize = 64;

/// A tabled flow into a volume, or area of a valve.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ResidualFlow {
    /// Shape of the table between its knots.
    #[serde(default)]
    pub shape: Shape,
    /// On a volume: mass flow into it at the knots, in mg/s; left out on a valve.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub flow_mg_per_s: Vec<f64>,
    /// On a valve: area at the knots on top of its own, in mm²; left out on a volume.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub area_mm2: Vec<f64>,
    /// One or two variables.
    pub axes: Vec<Axis>,
}

/// Shape of a table between its knots.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// Straight lines.
    #[default]
    Linear,
    /// Cubics with a continuous first derivative.
    Cubic,
}

/// One variable of a table and its knots.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Axis {
    /// Variable that is looked up.
    pub variable: Variable,
    /// Whose: a valve's name for `duty` and `difference`, a volume's for `pressure`.
    pub of: String,
    /// Time constant in ms of a first-order lag that the variable passes; absent means none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_constant_ms: Option<f64>,
    /// Looks up by how much the variable is away from its lag instead of the lag itself.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub departure: bool,
    /// Knots in the variable's unit, rising: duty, or kPa.
    pub knots: Vec<f64>,
}

/// A variable that a table can be over.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Variable {
    /// The duty that acts on a valve, after everything along its command path.
    Duty,
    /// Gauge pressure of a volume in kPa.
    Pressure,
    /// Pressure difference across a valve in kPa, from its first port to its second.
    Difference,
}

impl ResidualFlow {
    /// The values, whichever they are.
    pub fn values(&self) -> &[f64] {
        if self.area_mm2.is_empty() { &self.flow_mg_per_s } else { &self.area_mm2 }
    }
}

impl Numbers for ResidualFlow {
    fn numbers(&self) -> Vec<Number> {
        let flow = const { Number::new("mg/s", -1e6, 1e6).plausible(-500.0, 500.0).named("flow_mg_per_s") };
        let area = const { Number::new("mm²", -1e4, 1e4).plausible(-2.0, 2.0).named("area_mm2") };
        let mut numbers = vec![flow; self.flow_mg_per_s.len()];
        numbers.extend(vec![area; self.area_mm2.len()]);
        numbers
    }

    fn number(&self, index: usize) -> f64 {
        self.flow_mg_per_s.iter().chain(&self.area_mm2).nth(index).copied().unwrap_or(f64::NAN)
    }

    fn number_mut(&mut self, index: usize) -> Option<&mut f64> {
        self.flow_mg_per_s.iter_mut().chain(&mut self.area_mm2).nth(index)
    }
}

impl Physics for ResidualFlow {
    const ID: &'static str = "residual_flow";
    const PLACES: &'static [Place] = &[Place::Volume, Place::Valve];
    const SETTLED: bool = true;

    fn check(&self, rig: &Rig, component: &str, key: &str) -> Result<(), RigError> {
        let refuse = |part: &str, problem: String| Err(RigError::at(format!("{key}.{part}"), problem));
        let (wanted, unwanted) = if rig.volumes.contains_key(component) {
            (("flow_mg_per_s", &self.flow_mg_per_s), ("area_mm2", &self.area_mm2))
        } else {
            (("area_mm2", &self.area_mm2), ("flow_mg_per_s", &self.flow_mg_per_s))
        };
        if !unwanted.1.is_empty() {
            return refuse(unwanted.0, format!("`{component}` takes `{}`; leave this out", wanted.0));
        }
        if self.axes.is_empty() || self.axes.len() > 2 {
            return refuse("axes", format!("{} axes; give one or two variables", self.axes.len()));
        }
        for (n, axis) in self.axes.iter().enumerate() {
            axis.check(rig, &format!("{key}.axes.{}", n + 1))?;
        }
        let knots: usize = self.axes.iter().map(|axis| axis.knots.len()).product();
        if wanted.1.len() != knots {
            return refuse(wanted.0, format!("{} values for {knots} knots; give one for each", wanted.1.len()));
        }
        Ok(())
    }

    /// None: its shape comes from data.
    fn forms(_rig: &Rig, _component: &str) -> Vec<Form> {
        Vec::new()
    }
}

impl Axis {
    fn check(&self, rig: &Rig, key: &str) -> Result<(), RigError> {
        let (kind, known): (_, Vec<&String>) = match self.variable {
            Variable::Pressure => ("volume", rig.volumes.keys().collect()),
            Variable::Duty | Variable::Difference => ("valve", rig.valves.keys().collect()),
        };
        if !known.contains(&&self.of) {
            return Err(RigError::at(
                format!("{key}.of"),
                format!("there is no {kind} `{}`; there are {}", self.of, names(known.into_iter())),
            ));
        }
        if let Some(lag) = self.time_constant_ms {
            within(&format!("{key}.time_constant_ms"), lag, 0.01, 1e7, "ms", "leave it out for no memory")?;
        } else if self.departure {
            return Err(RigError::at(
                format!("{key}.departure"),
                "it is the departure from a lag: give `time_constant_ms` too",
            ));
        }
        let rising = self.knots.windows(2).all(|pair| pair[0] < pair[1]) && self.knots.iter().all(|k| k.is_finite());
        if !(2..=MOST_KNOTS).contains(&self.knots.len()) || !rising {
            return Err(RigError::at(
                format!("{key}.knots"),
                format!("{} knots; give 2 … {MOST_KNOTS} finite ones, each above the one before", self.knots.len()),
            ));
        }
        Ok(())
    }
}

/// A table of one or two variables; knots are shared by all lanes, values are each lane's own.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Table<R> {
    shape: Shape,
    knots: Vec<Vec<f64>>,
    values: Vec<R>,
}

impl ResidualFlow {
    /// The table with its values multiplied by `unit`.
    pub(crate) fn table(&self, unit: f64) -> Table<f64> {
        Table {
            shape: self.shape,
            knots: self.axes.iter().map(|axis| axis.knots.clone()).collect(),
            values: self.values().iter().map(|value| value * unit).collect(),
        }
    }
}

impl<R: Real> Table<R> {
    /// Merges twins; `None` if their knots differ.
    pub(crate) fn side_by_side(parts: &[&Table<f64>]) -> Option<Self> {
        let first = parts.first()?;
        if parts.iter().any(|p| p.shape != first.shape || p.knots != first.knots) {
            return None;
        }
        let value = |i: usize| lanes_of(parts, |p| p.values.get(i).copied().unwrap_or(f64::NAN));
        Some(Table {
            shape: first.shape,
            knots: first.knots.clone(),
            values: (0..first.values.len()).map(value).collect(),
        })
    }

    /// The table's value; `at` holds as many variables as there are axes.
    #[inline]
    pub(crate) fn at(&self, at: &[R]) -> R {
        R::from_lanes(|lane| {
            let mut rows = Weights::single();
            let mut columns = Weights::single();
            if let (Some(knots), Some(at)) = (self.knots.first(), at.first()) {
                rows = Weights::at(knots, at.lane(lane), self.shape);
            }
            let mut width = 1;
            if let (Some(knots), Some(at)) = (self.knots.get(1), at.get(1)) {
                columns = Weights::at(knots, at.lane(lane), self.shape);
                width = knots.len();
            }
            let mut sum = 0.0;
            for (row, by_row) in rows.terms() {
                for (column, by_column) in columns.terms() {
                    let value = self.values.get(row * width + column).map_or(f64::NAN, |v| v.lane(lane));
                    sum += by_row * by_column * value;
                }
            }
            sum
        })
    }
}

/// Which knots count at a place, and how much; they add up to one.
#[derive(Debug, Clone, Copy)]
struct Weights {
    first: usize,
    weights: [f64; 4],
    terms: usize,
}

impl Weights {
    fn single() -> Self {
        Weights { first: 0, weights: [1.0, 0.0, 0.0, 0.0], terms: 1 }
    }

    fn terms(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.weights.iter().take(self.terms).enumerate().map(|(i, w)| (self.first + i, *w))
    }

    fn at(knots: &[f64], value: f64, shape: Shape) -> Self {
        let last = knots.len() - 1;
        let value = value.max(knots[0]).min(knots[last]);
        let cell = knots.partition_point(|k| *k <= value).clamp(1, last) - 1;
        let width = knots[cell + 1] - knots[cell];
        let t = (value - knots[cell]) / width;
        if shape == Shape::Linear {
            return Weights { first: cell, weights: [1.0 - t, t, 0.0, 0.0], terms: 2 };
        }
        // Hermite's cubic, with slopes from the neighbours (one-sided at the ends).
        let (t2, t3) = (t * t, t * t * t);
        let (h00, h10) = (2.0 * t3 - 3.0 * t2 + 1.0, t3 - 2.0 * t2 + t);
        let (h01, h11) = (-2.0 * t3 + 3.0 * t2, t3 - t2);
        let (before, after) = (cell.saturating_sub(1), (cell + 2).min(last));
        let left = width / (knots[cell + 1] - knots[before]);
        let right = width / (knots[after] - knots[cell]);
        let first = before;
        let mut weights = [0.0; 4];
        weights[cell - first] += h00 - h11 * right;
        weights[cell + 1 - first] += h01 + h10 * left;
        weights[before - first] -= h10 * left;
        weights[after - first] += h11 * right;
        Weights { first, weights, terms: after - first + 1 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(shape: Shape, knots: Vec<Vec<f64>>, f: impl Fn(f64, f64) -> f64) -> Table<f64> {
        let second = knots.get(1).cloned().unwrap_or(vec![0.0]);
        let values = knots[0].iter().flat_map(|x| second.iter().map(|y| f(*x, *y)).collect::<Vec<_>>()).collect();
        Table { shape, knots, values }
    }

    #[test]
    fn tables_reproduce_what_their_shape_can() {
        let knots = vec![vec![-1.0, 0.5, 0.7, 2.0, 3.0], vec![0.0, 1.0, 4.0]];
        let plane = |x: f64, y: f64| 3.0 - 2.0 * x + 0.5 * y + 0.3 * x * y;
        for shape in [Shape::Linear, Shape::Cubic] {
            let table = table(shape, knots.clone(), plane);
            for (x, y) in [(-1.0, 0.0), (0.0, 0.3), (0.6, 2.0), (1.1, 3.9), (3.0, 4.0)] {
                // Bilinear functions are straight along each axis, which both shapes keep; a dozen roundings.
                assert!((table.at(&[x, y]) - plane(x, y)).abs() < 1e-13, "{shape:?} at {x}, {y}");
            }
            assert_eq!(table.at(&[9.0, 9.0]), table.at(&[3.0, 4.0]), "beyond the knots it stays");
        }
    }

    #[test]
    fn a_cubic_has_no_kinks_and_a_line_has() {
        let knots = vec![(0..9).map(|i| 0.25 * f64::from(i)).collect::<Vec<_>>()];
        let f = |x: f64, _| (3.0 * x).sin();
        let (straight, smooth) = (table(Shape::Linear, knots.clone(), f), table(Shape::Cubic, knots, f));
        let slope = |t: &Table<f64>, x: f64| (t.at(&[x + 1e-6]) - t.at(&[x])) / 1e-6;
        let kink = |t: &Table<f64>, x: f64| (slope(t, x) - slope(t, x - 1e-6)).abs();
        assert!(kink(&smooth, 1.0) < 1e-4 && kink(&straight, 1.0) > 0.01);
        // Catmull-Rom is of order three inside, straight lines of order two: h²/8·max f'' = 0.07.
        let off = |t: &Table<f64>| {
            (20..180).map(|i| 0.01 * f64::from(i)).map(|x| (t.at(&[x]) - f(x, 0.0)).abs()).fold(0.0, f64::max)
        };
        assert!(
            off(&smooth) < 0.03 && off(&straight) > 0.06 && off(&straight) < 0.071,
            "{} {}",
            off(&smooth),
            off(&straight)
        );
    }
}
