//! Chambers whose gas is not at the temperature of their walls (`chamber_thermal`), in the feed-forward.
//!
//! The energy balance solved for the valve's flow instead of the pressure's rate:
//!
//! ```text
//! Ṗ (V + κ P V') = κ R (Σ ṁ_in T_in − Σ ṁ_out T) + (κ − 1) G (T_wall − T)
//! Ṫ = T (Ṗ/P + V̇/V − ṁ R T/(P V))
//! ```
//!
//! The second line moves the temperature on along the reference. The pump's mean flow is that of the map; it takes hardly
//! less from a warm chamber than from a cold one, as what it draws takes the cylinder's temperature.

use super::Capacity;
use crate::mechanism::Mechanism;
use crate::rig::{Pump, Rig};

/// Temperatures that a chamber's gas may have, in K: beyond, a balance is not to be trusted.
const PLAUSIBLE_K: [f64; 2] = [200.0, 600.0];

/// A chamber with an energy balance.
#[derive(Debug, Clone, Copy)]
pub(super) struct WarmChamber {
    conductance_w_per_k: f64,
    wall_k: f64,
    /// Temperature of what the pump brings.
    pump_k: f64,
    atmosphere_k: f64,
    gas_constant: f64,
    heat_capacity_ratio: f64,
}

/// Pressure (absolute Pa), its rate (Pa/s) and the pump's net flow into the chamber (kg/s).
#[derive(Debug, Clone, Copy)]
pub(super) struct Wanted {
    pub(super) pressure_pa: f64,
    pub(super) rate_pa_per_s: f64,
    pub(super) pump_kg_per_s: f64,
}

impl WarmChamber {
    /// The balance of chamber `name`, if it has one.
    pub(super) fn of(rig: &Rig, name: &str) -> Option<Self> {
        let thermal =
            rig.mechanisms.iter().filter(|m| m.enabled && m.component == name).find_map(|m| {
                if let Mechanism::ChamberThermal(thermal) = &m.mechanism { Some(thermal) } else { None }
            })?;
        let wall_k = rig.volumes.get(name)?.temperature_k;
        let pump_k = rig
            .pumps
            .values()
            .find_map(|pump| if let Pump::Piston(piston) = pump { Some(piston.gas_temperature_k) } else { None });
        Some(WarmChamber {
            conductance_w_per_k: thermal.wall_conductance_w_per_k,
            wall_k,
            pump_k: pump_k.unwrap_or(wall_k),
            atmosphere_k: rig.atmosphere.temperature_k,
            gas_constant: rig.gas.gas_constant_j_per_kg_k,
            heat_capacity_ratio: rig.gas.heat_capacity_ratio,
        })
    }

    /// Temperature of the walls in K: what the gas starts from.
    pub(super) fn wall_k(&self) -> f64 {
        self.wall_k
    }

    /// The flow into the chamber through the valve, in kg/s, at which the pressure changes at the wanted rate.
    pub(super) fn valve_inflow(&self, capacity: &Capacity, wanted: &Wanted, gas_k: f64) -> f64 {
        let (kappa, r) = (self.heat_capacity_ratio, self.gas_constant);
        // Capacity is (V + P V')/(R T_wall), and grows by 2 V'/(R T_wall) per pressure.
        let rt = r * self.wall_k;
        let swept = 0.5 * capacity.growth * rt * wanted.pressure_pa;
        let volume = capacity.at(wanted.pressure_pa) * rt + (kappa - 1.0) * swept;
        let pumped = wanted.pump_kg_per_s * if wanted.pump_kg_per_s > 0.0 { self.pump_k } else { gas_k };
        let wall = (kappa - 1.0) * self.conductance_w_per_k * (self.wall_k - gas_k);
        let needed = (wanted.rate_pa_per_s * volume - wall) / (kappa * r) - pumped;
        needed / if needed > 0.0 { self.atmosphere_k } else { gas_k }
    }

    /// The pressure's rate in Pa/s while `valve_kg_per_s` flow in through the valve.
    pub(super) fn rate_pa_per_s(
        &self,
        capacity: &Capacity,
        pressure_pa: f64,
        [pump, valve]: [f64; 2],
        gas_k: f64,
    ) -> f64 {
        let (kappa, r) = (self.heat_capacity_ratio, self.gas_constant);
        let rt = r * self.wall_k;
        let volume = capacity.at(pressure_pa) * rt + (kappa - 1.0) * 0.5 * capacity.growth * rt * pressure_pa;
        let pumped = pump * if pump > 0.0 { self.pump_k } else { gas_k };
        let vented = valve * if valve > 0.0 { self.atmosphere_k } else { gas_k };
        let wall = (kappa - 1.0) * self.conductance_w_per_k * (self.wall_k - gas_k);
        (kappa * r * (pumped + vented) + wall) / volume
    }

    /// By what the flow out through a valve at the wall's temperature is to be divided for that of gas at `gas_k`.
    pub(super) fn thinning(&self, gas_k: f64) -> f64 {
        (self.wall_k / gas_k).sqrt()
    }

    fn rate_k_per_s(&self, capacity: &Capacity, wanted: &Wanted, gas_k: f64) -> f64 {
        let inflow = wanted.pump_kg_per_s + self.valve_inflow(capacity, wanted, gas_k);
        let rt = self.gas_constant * self.wall_k;
        let growth = 0.5 * capacity.growth * rt;
        let volume = capacity.at(wanted.pressure_pa) * rt - growth * wanted.pressure_pa;
        gas_k
            * (wanted.rate_pa_per_s / wanted.pressure_pa + growth * wanted.rate_pa_per_s / volume
                - inflow * self.gas_constant * gas_k / (wanted.pressure_pa * volume))
    }

    /// The temperature in K `duration_s` later. Linearly implicit: walls may be far faster than a tick.
    pub(super) fn warmed(&self, capacity: &Capacity, wanted: &Wanted, gas_k: f64, duration_s: f64) -> f64 {
        let rate = |gas_k: f64| self.rate_k_per_s(capacity, wanted, gas_k);
        let slope = rate(gas_k + 0.5) - rate(gas_k - 0.5);
        let warmed = gas_k + duration_s * rate(gas_k) / (1.0 - duration_s * slope.min(0.0));
        if warmed.is_finite() { warmed.clamp(PLAUSIBLE_K[0], PLAUSIBLE_K[1]) } else { self.wall_k }
    }
}
