//! The walls of all volumes over one tick: the slider-crank of paper eq. (2), and walls that stand still.
//!
//! ```text
//! V(θ) = S (δ − r + l − r cos θ − √(l² − r² sin² θ))
//! V̇    = S ω (r sin θ + r² sin θ cos θ / √(l² − r² sin² θ))
//! ```
//!
//! With a wall that moves, `Ṗ = (R T/V) Σṁ − (V̇/V) P` (paper eq. (1)); with `V̇ = 0` that is the rigid chamber
//! of eqs. (6)-(7), so the integrator treats chambers and cylinders alike.
//!
//! RK4 needs the crank at fixed instants of a tick, and nothing about it depends on pressure, so the
//! table is filled ahead of the pressures and only when phase or speed differ from the last tick. At
//! 3000 rpm a tick is one revolution and the table is filled once for ever. Between instants the
//! crank pin is turned by a fixed rotation instead of taking sines and cosines.

use super::INSTANTS_PER_STEP;
use super::elements::{Cylinder, Drive, Isothermal};
use crate::real::Real;

/// State of a volume's wall at one instant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Wall<R> {
    /// V̇/V in 1/s.
    pub(crate) growth: R,
    /// R T/V in Pa/kg.
    pub(crate) pressure_per_mass: R,
}

/// The walls of all states at the instants of one tick.
#[derive(Debug, Clone)]
pub(crate) struct WallTable<R> {
    /// `[instant][state]`, flattened.
    walls: Vec<Wall<R>>,
    /// Phase and speed of each drive for which the table holds.
    filled_for: Vec<(R, R)>,
    /// States per instant: as many as the integrator carries.
    states: usize,
}

impl<R: Real> WallTable<R> {
    /// Room for `states` over `steps` integration steps, all walls at rest; chambers as given.
    pub(crate) fn new(states: usize, drives: usize, steps: usize, chambers: &[Isothermal<R>]) -> Self {
        let (zero, nan) = (R::splat(0.0), R::splat(f64::NAN));
        let mut row = vec![Wall { growth: zero, pressure_per_mass: zero }; states];
        for chamber in chambers {
            if let Some(wall) = row.get_mut(chamber.node) {
                wall.pressure_per_mass = chamber.pressure_per_mass;
            }
        }
        // NaN equals nothing, so the first call of `turn` fills the cylinders in.
        WallTable { walls: row.repeat(INSTANTS_PER_STEP * steps + 1), filled_for: vec![(nan, nan); drives], states }
    }

    /// The walls at instant `k`; `STATES` is the number the table was made for.
    #[inline(always)]
    pub(crate) fn at<const STATES: usize>(&self, k: usize) -> &[Wall<R>; STATES] {
        &self.walls.as_chunks().0[k]
    }

    /// Fills in the cylinders of drive `index` for a tick that starts at crank angle `phase` (revolutions) and
    /// turns at `speed` (rev/s).
    #[inline(always)]
    pub(crate) fn turn(
        &mut self,
        index: usize,
        drive: &Drive<R>,
        cylinders: &[Cylinder<R>],
        phase: R,
        speed: R,
        instant_s: f64,
    ) {
        let Some(filled_for) = self.filled_for.get_mut(index) else { return };
        if *filled_for == (phase, speed) {
            return;
        }
        *filled_for = (phase, speed);
        for cylinder in cylinders.iter().filter(|c| c.drive == index) {
            let turn = R::splat(std::f64::consts::TAU);
            let omega = speed * turn;
            let angle = (phase + cylinder.phase) * turn;
            let (mut sin, mut cos) = (angle.map(f64::sin), angle.map(f64::cos));
            let step = omega * R::splat(instant_s);
            let (step_sin, step_cos) = (step.map(f64::sin), step.map(f64::cos));
            let (r, l) = (drive.crank_radius, drive.rod_length);
            let (r2, l2) = (r * r, l * l);
            for wall in self.walls.iter_mut().skip(cylinder.node).step_by(self.states) {
                let rod = (l2 - r2 * sin * sin).sqrt();
                let volume = drive.head_area * (drive.effective_length - r + l - r * cos - rod);
                let rate = drive.head_area * omega * (r * sin + r2 * sin * cos / rod);
                *wall = Wall { growth: rate / volume, pressure_per_mass: drive.rt / volume };
                let turned = cos.mul_add(step_cos, -(sin * step_sin));
                sin = sin.mul_add(step_cos, cos * step_sin);
                cos = turned;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn paper() -> (Drive<f64>, Vec<Cylinder<f64>>) {
        let drive = Drive {
            relay: None,
            droops: None,
            warms: false,
            speed: 50.0,
            warm_share: 0.0,
            approach_rate: 0.0,
            droop: 0.0,
            crank_radius: 0.02,
            rod_length: 0.07,
            effective_length: 0.041,
            head_area: 38.485e-4,
            rt: 287.0 * 323.15,
        };
        (
            drive,
            [0.0, 0.5]
                .into_iter()
                .enumerate()
                .map(|(node, phase)| Cylinder { inlet: 0, node, drive: 0, phase })
                .collect(),
        )
    }

    #[test]
    fn table_agrees_with_the_formula_and_its_derivative() {
        let (drive, cylinders) = paper();
        let (phase, speed, instant) = (0.3, 47.0, 0.25e-4);
        let mut table = WallTable::new(2, 1, 200, &[]);
        table.turn(0, &drive, &cylinders, phase, speed, instant);
        let volume = |revolutions: f64| {
            let a = std::f64::consts::TAU * revolutions;
            let (s, c) = a.sin_cos();
            38.485e-4 * (0.041 - 0.02 + 0.07 - 0.02 * c - (0.07f64.powi(2) - (0.02 * s).powi(2)).sqrt())
        };
        for k in 0..=800 {
            for (i, wall) in table.at::<2>(k).iter().enumerate() {
                let turned = |t: f64| phase + 0.5 * i as f64 + speed * t;
                let t = k as f64 * instant;
                let v = volume(turned(t));
                // 800 rotations of one rounding each: 800 · 1.1e-16, amplified by V_max/V_min = 41.
                assert!((wall.pressure_per_mass * v / drive.rt - 1.0).abs() < 1e-11);
                let slope = (volume(turned(t + 1e-7)) - volume(turned(t - 1e-7))) / 2e-7;
                assert!((wall.growth * v - slope).abs() < 1e-6, "central difference at {k}");
            }
        }
    }

    #[test]
    fn dead_and_full_volume_are_the_geometry() {
        let (drive, cylinders) = paper();
        let mut table = WallTable::new(2, 1, 200, &[]);
        table.turn(0, &drive, &cylinders, 0.0, 50.0, 0.25e-4);
        let volumes: Vec<f64> = table.at::<2>(0).iter().map(|w| drive.rt / w.pressure_per_mass).collect();
        assert!((volumes[0] - 38.485e-4 * 0.001).abs() < 1e-15, "clearance δ − 2r = 1 mm");
        assert!((volumes[1] - 38.485e-4 * 0.041).abs() < 1e-15, "whole length δ = 41 mm");
    }
}
