//! `valve_force_curve`: forces on the flapper that are not straight lines, and an opening that ends.
//!
//! The paper's (4) adds three straight lines. With `F = A_n ΔP`:
//!
//! ```text
//! a = Ĉ_u (u + m u (u − 1)) + Ĉ_P F + c F² − Ĉ_k          limited to a ≥ 0
//! A = a / (1 + (a/a_full)⁴)^¼
//! ```
//!
//! * `m`: the coil's force against duty. A solenoid pulls with the square of the current until its iron
//!   saturates (Hayt & Buck, *Engineering Electromagnetics*, ch. 8): `m = 1` is the pure square, `m = 0` the
//!   paper's line, both through the same force at full duty; negative bends the other way (saturation).
//! * `c`: the jet's force on a flapper grows with the gap as well as with the pressure (Merritt, *Hydraulic
//!   Control Systems*, 1967, §5-6), which shows as a curvature in `F`. It depends on pressure alone.
//! * `a_full`: beyond a lift of a quarter of its diameter a nozzle is as open as it gets. Published curves of
//!   the paper's valve family flatten above a duty of 0.85. From outside much like a line in series
//!   (`line_resistance`).
//!
//! All three are optional; left out, each is the straight line.

use serde::{Deserialize, Serialize};

use super::{Form, Mechanism, Physics, Place};
use crate::plant::{Samples, lanes_of};
use crate::real::Real;
use crate::rig::{Number, Rig, numbers};

/// Curvatures of the forces on a valve's flapper, and its full opening.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ValveForceCurve {
    /// m: curvature of the coil's force over duty, a bare number (−1 … 1); 0 is straight.
    #[serde(default)]
    pub duty_curvature: f64,
    /// c: curvature over the force of the pressure, in mm²/N²; 0 is straight.
    #[serde(default)]
    pub pressure_curvature_mm2_per_n2: f64,
    /// 1/a_full in 1/mm²: the inverse of the area of the fully open valve; 0 is no limit.
    #[serde(default)]
    pub inverse_full_area_per_mm2: f64,
}

numbers!(ValveForceCurve {
    duty_curvature: Number::new("", -1.0, 1.0)
        .plausible(-0.8, 1.0)
        .starts(&[0.03, -0.03, 0.1, -0.1, 0.3, -0.3])
        .hint("1 is a force that grows with the square of the duty")
        .optional(),
    pressure_curvature_mm2_per_n2: Number::new("mm²/N²", -1e3, 1e3)
        .plausible(-4.0, 4.0)
        .starts(&[0.1, -0.1, 0.5, -0.5, 2.0, -2.0])
        .optional(),
    inverse_full_area_per_mm2: Number::new("1/mm²", 0.0, 1e3)
        .plausible(0.0, 3.0)
        .starts(&[0.2, 0.5, 0.9, 1.4])
        .hint("one over the area of the open valve")
        .optional(),
});

impl Physics for ValveForceCurve {
    const ID: &'static str = "valve_force_curve";
    const PLACES: &'static [Place] = &[Place::Valve];
    const SETTLED: bool = true;

    fn forms(_rig: &Rig, _component: &str) -> Vec<Form> {
        let straight =
            ValveForceCurve { duty_curvature: 0.0, pressure_curvature_mm2_per_n2: 0.0, inverse_full_area_per_mm2: 0.0 };
        ["duty", "pressure", "full opening"]
            .into_iter()
            .enumerate()
            .map(|(n, name)| Form::of(name, Mechanism::ValveForceCurve(straight.clone()), &[n]))
            .collect()
    }
}

impl ValveForceCurve {
    /// The coil's part, which acts along the command.
    pub(crate) fn operator(&self) -> Bend<f64> {
        Bend { curvature: self.duty_curvature }
    }
}

/// The coil's force over duty, as the duty that would give it on a straight line. It remembers nothing.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bend<R> {
    curvature: R,
}

impl Bend<f64> {
    /// The duty that acts as `bent`.
    pub(crate) fn inverse(&self, bent: f64) -> f64 {
        let (m, straight) = (self.curvature, 1.0 - self.curvature);
        // The root of m u² + (1 − m) u = bent that goes on from m = 0.
        2.0 * bent / (straight + (straight * straight + 4.0 * m * bent).max(0.0).sqrt()).max(1e-9)
    }
}

impl<R: Real> Bend<R> {
    pub(crate) fn side_by_side(parts: &[Bend<f64>]) -> Self {
        Bend { curvature: lanes_of(parts, |p| p.curvature) }
    }

    #[inline(always)]
    pub(crate) fn at(&self, duty: R) -> R {
        (self.curvature * duty).mul_add(duty - R::splat(1.0), duty)
    }

    #[inline(always)]
    pub(crate) fn run(&self, samples: &mut Samples<R>) {
        for duty in samples.in_time() {
            *duty = self.at(*duty);
        }
    }
}
