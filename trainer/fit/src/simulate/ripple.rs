//! A piston pump's ripple as each reading shows it, at every angle of the crank.
//!
//! ```text
//! r(t, φ) = Σ_h  a_h(t) cos 2π h φ + b_h(t) sin 2π h φ
//! ```
//!
//! with `φ` the angle of the crank at the start; `a_h`, `b_h` and the mean over all angles are sums over averaged runs whose
//! cranks start at [`ANGLES`] angles.

use std::f64::consts::TAU;

use model::rig::{Pump, Rig};

use super::arcs::Arcs;
use super::simulator::{Fidelity, Run, Simulator};
use super::start::refined_starts;
use crate::FitError;

/// Angles at which cranks start.
const ANGLES: usize = 12;
/// Harmonics of a revolution that the ripple is made of: the first two of a pair of pistons, and what pistons differ by.
pub(super) const HARMONICS: usize = 4;

/// Amplitudes of one harmonic at one reading.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Pair {
    pub(super) cos: f64,
    pub(super) sin: f64,
}

impl Pair {
    /// Contribution to the squared ripple, on average over its angle.
    pub(super) fn energy(&self) -> f64 {
        0.5 * (self.cos * self.cos + self.sin * self.sin)
    }

    /// The harmonic once it has turned by an angle, and the same a quarter of its period on.
    pub(super) fn turned(&self, sin: f64, cos: f64) -> (f64, f64) {
        (self.cos * cos + self.sin * sin, self.sin * cos - self.cos * sin)
    }
}

/// The ripple of a rig's only piston pump over recordings.
pub struct Ripple {
    /// The pump.
    pub(super) pump: String,
    /// Speed of the pump as stated, in rev/min.
    pub(super) speed_rpm: f64,
    /// Volumes that it draws from and delivers to.
    pub(super) inlet: String,
    pub(super) outlet: String,
    /// Readings at the mean of a turn, in kPa, in the recordings' layout.
    pub(super) mean_kpa: Vec<f64>,
    /// Harmonics of each reading.
    pub(super) at: Vec<[Pair; HARMONICS]>,
}

impl Ripple {
    /// The ripple of the only piston pump of `rig`, whose other parameters are already fitted and which turns as fast as
    /// stated; `None` if there is no such pump. It takes twelve averaged runs.
    ///
    /// # Errors
    /// The rig cannot be simulated.
    pub fn of(simulator: &Simulator<'_>, rig: &Rig) -> Result<Option<Ripple>, FitError> {
        let simulator = &simulator.at(Fidelity::Averaged);
        let mut pistons = rig.pumps.iter().filter_map(|(name, pump)| match pump {
            Pump::Piston(piston) => Some((name, piston)),
            Pump::Flow(_) => None,
        });
        let (Some((pump, piston)), None) = (pistons.next(), pistons.next()) else { return Ok(None) };
        let arcs = refined_starts(simulator, rig, &Arcs::led(simulator.records()))?;
        let runs: Vec<Run> =
            (0..ANGLES).map(|k| Run { crank_rev: k as f64 / ANGLES as f64, ..Run::from(rig.clone()) }).collect();
        let traces =
            simulator.run(&runs, &arcs).into_iter().collect::<Result<Vec<_>, _>>().map_err(FitError::rig(rig))?;
        let turned: [[(f64, f64); ANGLES]; HARMONICS] = std::array::from_fn(|h| {
            std::array::from_fn(|k| {
                let (sin, cos) = (TAU * ((h + 1) * k) as f64 / ANGLES as f64).sin_cos();
                (2.0 / ANGLES as f64 * cos, 2.0 / ANGLES as f64 * sin)
            })
        });
        let readings = simulator.records().layout().len();
        let (mut mean_kpa, mut at) = (Vec::with_capacity(readings), Vec::with_capacity(readings));
        for index in 0..readings {
            let kpa: [f64; ANGLES] =
                std::array::from_fn(|k| traces.get(k).and_then(|trace| trace.get(index)).copied().unwrap_or(f64::NAN));
            mean_kpa.push(kpa.iter().sum::<f64>() / ANGLES as f64);
            at.push(turned.map(|turned| Pair {
                cos: kpa.iter().zip(turned).map(|(p, (cos, _))| p * cos).sum(),
                sin: kpa.iter().zip(turned).map(|(p, (_, sin))| p * sin).sum(),
            }));
        }
        Ok(Some(Ripple {
            pump: pump.clone(),
            speed_rpm: piston.speed_rpm,
            inlet: piston.inlet.clone(),
            outlet: piston.outlet.clone(),
            mean_kpa,
            at,
        }))
    }

    /// Index of the harmonic that carries most of the ripple.
    pub(super) fn main(&self) -> usize {
        let energy = |h: usize| -> f64 { self.at.iter().filter_map(|pairs| pairs.get(h)).map(Pair::energy).sum() };
        (0..HARMONICS).max_by(|a, b| energy(*a).total_cmp(&energy(*b))).unwrap_or(0)
    }
}
