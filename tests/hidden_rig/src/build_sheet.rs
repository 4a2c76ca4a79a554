//! The build sheet of one hidden rig: every parameter that is drawn, and the rig that is built from it.
//!
//! Nominal values are the paper's (Table III; nozzle 3.0 mm). A rig's own values differ from them, each by a share
//! drawn uniformly between two bounds, up or down. What no lab would be wrong about by a tenth is drawn closer: room
//! and wall temperatures, the barometer, and the clearance only through the millimetre that it is.

use serde::{Deserialize, Serialize};

use crate::actuation::Actuation;
use crate::chamber::Chamber;
use crate::gas::Gas;
use crate::orifice::sonic_conductance;
use crate::plant::Plant;
use crate::pump::{Motor, Pump, Reed};
use crate::rng::Draws;
use crate::run::Rig;
use crate::sensor::{Noise, Sensor};
use crate::valve::Vent;

/// By how much parameters are off, relative: drawn uniformly between these, with either sign.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// At least.
    pub low: f64,
    /// At most.
    pub high: f64,
}

impl Spread {
    /// A rig built as the sheet says, to the tolerances of a workshop.
    pub const AS_BUILT: Self = Self { low: 0.0, high: 0.01 };
    /// A rig whose parameters have moved.
    pub const MOVED: Self = Self { low: 0.02, high: 0.10 };
}

/// Numbers that a hidden rig is built from; SI units.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BuildSheet {
    /// Barometer (Pa).
    pub atmosphere_pa: f64,
    /// Room temperature (K).
    pub room_k: f64,
    /// Chamber volumes (m³).
    pub volume_m3: [f64; 2],
    /// Heat conductance of the wool in the chambers (W/K).
    pub wool_w_k: [f64; 2],
    /// Ĉ_u, Ĉ_P, Ĉ_k of the positive and of the negative valve (m², m²/N, m²).
    pub valve: [[f64; 3]; 2],
    /// Critical ratios of the vent valves.
    pub vent_critical_ratio: [f64; 2],
    /// Time constants of the flappers (s).
    pub flapper_s: [f64; 2],
    /// Ĉ_cv of inlet and outlet valves (m²).
    pub check_valve_m2: [f64; 2],
    /// Critical ratios of the check valves.
    pub check_critical_ratio: [f64; 2],
    /// Temperature of the cylinder walls (K).
    pub cylinder_k: f64,
    /// Heat conductance between gas and cylinder wall (W/K).
    pub cylinder_w_k: f64,
    /// Piston area (m²).
    pub piston_m2: f64,
    /// Clearance δ − 2 r (m).
    pub clearance_m: f64,
    /// Speed of the motor (rpm).
    pub speed_rpm: f64,
    /// Crank angle at the start of a recording (rad).
    pub crank_rad: f64,
    /// Noise of the readings.
    pub noise: Noise,
}

/// The parameters that a refit of the paper's model may move, by name: for the sensitivities of [`crate::sizing`].
pub const IDENTIFIABLE: [&str; 13] = [
    "c_u_pos",
    "c_p_pos",
    "c_k_pos",
    "c_u_neg",
    "c_p_neg",
    "c_k_neg",
    "volume_pos",
    "volume_neg",
    "c_inlet",
    "c_outlet",
    "cylinder_k",
    "piston_area",
    "clearance",
];

impl BuildSheet {
    /// The paper's plant.
    pub fn paper() -> Self {
        Self {
            atmosphere_pa: 101_325.0,
            room_k: 293.15,
            volume_m3: [0.75e-3, 0.4e-3],
            // 40 g of 25 µm copper wire a litre has 0.7 m² a litre and some 1,000 W/(m² K) (conduction through a film
            // of the wire's own size): hundreds of W/K.
            wool_w_k: [600.0, 400.0],
            valve: [[4.876e-6, 3.066e-6, 4.474e-6], [7.992e-6, 7.590e-6, 7.339e-6]],
            vent_critical_ratio: [0.5283; 2],
            flapper_s: [0.8e-3; 2],
            check_valve_m2: [33.47e-6, 1.46e-6],
            check_critical_ratio: [0.5283; 2],
            cylinder_k: 323.15,
            cylinder_w_k: 150.0,
            piston_m2: 38.485e-4,
            clearance_m: 1e-3,
            speed_rpm: 3000.0,
            crank_rad: 0.0,
            noise: Noise { white_pa: [65.0, 55.0], slow_pa: [20.0, 20.0], slow_correlation: 0.92, jitter_s: 1e-4 },
        }
    }

    /// A rig of its own: parameters off by a spread, formulations' own numbers in the ranges where a refit of the
    /// paper's model takes them up (to some 0.02 kPa), noise between 40 and 90 Pa.
    pub fn draw(draws: &mut Draws, spread: Spread) -> Self {
        let mut off = |scale: f64| 1.0 + scale * draws.sign() * draws.between(spread.low, spread.high);
        let paper = Self::paper();
        let valve = paper.valve.map(|valve| valve.map(|c| c * off(1.0)));
        let volume_m3 = paper.volume_m3.map(|v| v * off(1.0));
        let check_valve_m2 = paper.check_valve_m2.map(|c| c * off(1.0));
        let piston_m2 = paper.piston_m2 * off(1.0);
        let clearance_m = paper.clearance_m * off(1.0);
        let cylinder_k = paper.cylinder_k * off(0.5);
        let room_k = paper.room_k * off(0.15);
        let atmosphere_pa = paper.atmosphere_pa * off(0.1);
        let mut pair = |low: f64, high: f64| [draws.between(low, high), draws.between(low, high)];
        Self {
            atmosphere_pa,
            room_k,
            volume_m3,
            wool_w_k: pair(450.0, 750.0),
            valve,
            vent_critical_ratio: pair(0.52, 0.535),
            flapper_s: pair(0.5e-3, 1.2e-3),
            check_valve_m2,
            check_critical_ratio: pair(0.50, 0.54),
            cylinder_k,
            cylinder_w_k: pair(110.0, 200.0)[0],
            piston_m2,
            clearance_m,
            speed_rpm: 3000.0,
            crank_rad: pair(0.0, std::f64::consts::TAU)[0],
            noise: Noise {
                white_pa: pair(40.0, 85.0),
                slow_pa: pair(10.0, 28.0),
                slow_correlation: pair(0.85, 0.97)[0],
                jitter_s: 1e-4,
            },
        }
    }

    /// The rig, with nothing concealed in it.
    pub fn rig(&self) -> Rig {
        let reed = |k: usize| Reed {
            conductance: sonic_conductance(self.check_valve_m2[k]),
            critical_ratio: self.check_critical_ratio[k],
            cracking_pa: 0.0,
            lift_range_pa: 0.0,
        };
        let nominal = Pump::paper();
        let pump = Pump {
            head_m: 2.0 * nominal.crank_m + self.clearance_m,
            piston_area_m2: self.piston_m2,
            wall_k: self.cylinder_k,
            wall_conductance_w_k: self.cylinder_w_k,
            inlet: reed(0),
            outlet: reed(1),
            motor: Motor { speed_rad_s: self.speed_rpm * std::f64::consts::TAU / 60.0, ..nominal.motor },
            start_angle_rad: self.crank_rad,
            ..nominal
        };
        let chamber =
            |c: usize| Chamber { wall_k: self.room_k, ..Chamber::packed(self.volume_m3[c], self.wool_w_k[c]) };
        let vent = |c: usize| {
            let [input, pressure, spring] = self.valve[c];
            Vent {
                critical_ratio: self.vent_critical_ratio[c],
                follows_s: self.flapper_s[c],
                ..Vent::of_coefficients(input, pressure, spring)
            }
        };
        Rig {
            plant: Plant {
                atmosphere: Gas { pressure_pa: self.atmosphere_pa, temperature_k: self.room_k },
                pump,
                chambers: [chamber(0), chamber(1)],
                vents: [vent(0), vent(1)],
                sensors: [Sensor::sound(); 2],
                cross_leak: 0.0,
                gland_leak: None,
            },
            actuation: Actuation::default(),
            noise: self.noise,
        }
    }

    /// The parameters of [`IDENTIFIABLE`], to change.
    pub fn identifiable(&mut self) -> [&mut f64; 13] {
        let [[u_p, p_p, k_p], [u_n, p_n, k_n]] = &mut self.valve;
        let [v_p, v_n] = &mut self.volume_m3;
        let [inlet, outlet] = &mut self.check_valve_m2;
        [
            u_p,
            p_p,
            k_p,
            u_n,
            p_n,
            k_n,
            v_p,
            v_n,
            inlet,
            outlet,
            &mut self.cylinder_k,
            &mut self.piston_m2,
            &mut self.clearance_m,
        ]
    }

    /// Distance of each of [`IDENTIFIABLE`] from the paper's value, relative.
    pub fn shifts(&self) -> [(&'static str, f64); 13] {
        let (mut own, mut paper) = (self.clone(), Self::paper());
        let paper = paper.identifiable();
        let own = own.identifiable();
        std::array::from_fn(|k| (IDENTIFIABLE[k], *own[k] / *paper[k] - 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_keep_their_bounds_and_their_seed() {
        for seed in 0..50 {
            let sheet = BuildSheet::draw(&mut Draws::new(seed), Spread::MOVED);
            assert_eq!(sheet, BuildSheet::draw(&mut Draws::new(seed), Spread::MOVED));
            for (name, shift) in sheet.shifts() {
                let least = if name == "cylinder_k" { 0.01 } else { 0.02 };
                assert!(shift.abs() >= least - 1e-12 && shift.abs() <= 0.1 + 1e-12, "{name} {shift}");
            }
        }
    }

    #[test]
    fn the_papers_sheet_builds_the_papers_valves() {
        let rig = BuildSheet::paper().rig();
        for (vent, paper) in rig.plant.vents.iter().zip(BuildSheet::paper().valve) {
            for (ours, given) in vent.coefficients().iter().zip(paper) {
                assert!((ours / given - 1.0).abs() < 1e-12);
            }
        }
    }
}
