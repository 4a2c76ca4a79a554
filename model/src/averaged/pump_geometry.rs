//! A piston pump in SI units, with everything that its mechanisms do to it.

use crate::orifice::FlowFunction;
use crate::plant::{Cylinder, Drive};
use crate::real::Real;

/// Spring that keeps a check valve shut, in Pa (see [`crate::mechanism::CheckValveCracking`]).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Spring {
    /// Difference below which it is shut.
    pub(crate) cracking_pa: f64,
    /// Pressure that is taken from the difference which drives the flow.
    pub(crate) taken_pa: f64,
    /// Difference beyond the cracking pressure over which it opens; 0 at once.
    pub(crate) opening_pa: f64,
}

/// Numbers that a pump's table depends on, and nothing else.
#[derive(Debug, Clone)]
pub(crate) struct PumpGeometry {
    /// Speed in rev/s without load.
    pub(crate) speed: f64,
    /// Share of it lost per Pa between outlet and inlet (mechanism `pump_droop`).
    pub(crate) droop: f64,
    /// Crank phase of each piston in revolutions.
    pub(crate) phases: Vec<f64>,
    /// r, l and δ in m, S in m², R T in the cylinders in J/kg.
    pub(crate) crank_radius: f64,
    pub(crate) rod_length: f64,
    pub(crate) effective_length: f64,
    pub(crate) head_area: f64,
    pub(crate) rt: f64,
    /// Effective areas of inlet and outlet check valves in m², lines in series included.
    pub(crate) areas: [f64; 2],
    /// Springs that keep them shut (mechanism `check_valve_cracking`).
    pub(crate) springs: [Spring; 2],
    /// Conductance of the rings in kg/(s Pa²) (mechanism `piston_blowby`).
    pub(crate) blowby: f64,
    /// 1/√(R T) at the inlet and in the cylinders, in s/m.
    pub(crate) inlet_inverse_speed: f64,
    pub(crate) cylinder_inverse_speed: f64,
    pub(crate) atmosphere_pa: f64,
    pub(crate) law: FlowFunction<f64>,
    /// κ of the gas, which `law` follows from.
    pub(crate) heat_capacity_ratio: f64,
    /// Rise of the pressure at the ports per kilogram, in Pa/kg; 0 where the pressure is given.
    pub(crate) inlet_pa_per_kg: f64,
    pub(crate) outlet_pa_per_kg: f64,
    /// Step of the detailed pump in s.
    pub(crate) step_s: f64,
}

impl PumpGeometry {
    /// Every number of it: two pumps with the same have the same table.
    pub(crate) fn key(&self) -> Vec<u64> {
        let PumpGeometry { areas: [inlet, outlet], springs: [inlet_spring, outlet_spring], .. } = *self;
        let numbers = [
            self.speed,
            self.droop,
            self.crank_radius,
            self.rod_length,
            self.effective_length,
            self.head_area,
            self.rt,
            inlet,
            outlet,
            inlet_spring.cracking_pa,
            inlet_spring.taken_pa,
            inlet_spring.opening_pa,
            outlet_spring.cracking_pa,
            outlet_spring.taken_pa,
            outlet_spring.opening_pa,
            self.blowby,
            self.inlet_inverse_speed,
            self.cylinder_inverse_speed,
            self.atmosphere_pa,
            self.heat_capacity_ratio,
            self.inlet_pa_per_kg,
            self.outlet_pa_per_kg,
            self.step_s,
        ];
        numbers.iter().chain(&self.phases).map(|number| number.to_bits()).collect()
    }

    /// Tells whether all flows scale with all pressures: nothing in it knows an absolute pressure.
    pub(crate) fn scales(&self) -> bool {
        self.droop == 0.0 && self.blowby == 0.0 && self.springs.iter().all(|spring| spring.cracking_pa == 0.0)
    }

    /// Ratio of the pressures at which it stalls: that of the largest to the smallest volume.
    pub(crate) fn compression_ratio(&self) -> f64 {
        self.effective_length / (self.effective_length - 2.0 * self.crank_radius)
    }

    /// Speed in rev/s at port pressures in Pa. A stalled motor is taken to creep, so that a revolution has an end.
    pub(crate) fn speed_at<R: Real>(&self, inlet: R, outlet: R) -> R {
        let left = R::splat(1.0) - R::splat(self.droop) * (outlet - inlet);
        R::splat(self.speed) * left.at_least(R::splat(0.02))
    }

    /// Volume of all cylinders together, on average, per R T: gas in kg per Pa at rest.
    pub(crate) fn content_per_pa(&self) -> f64 {
        // The rod makes each cylinder a little larger than halfway on average: r²/(4 l) of stroke.
        let half = self.effective_length - self.crank_radius + self.crank_radius.powi(2) / (4.0 * self.rod_length);
        self.phases.len() as f64 * self.head_area * half / self.rt
    }

    /// One cylinder at bottom dead centre, for a table of its walls.
    pub(crate) fn crank(&self) -> (Drive<f64>, [Cylinder<f64>; 1]) {
        let drive = Drive {
            relay: None,
            droops: None,
            warms: false,
            speed: self.speed,
            warm_share: 0.0,
            approach_rate: 0.0,
            droop: 0.0,
            crank_radius: self.crank_radius,
            rod_length: self.rod_length,
            effective_length: self.effective_length,
            head_area: self.head_area,
            rt: self.rt,
        };
        (drive, [Cylinder { node: 0, inlet: 0, drive: 0, phase: 0.5 }])
    }
}
