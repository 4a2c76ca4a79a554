//! Air as an ideal gas kept by mass and energy.
//!
//! A store holds a mass `m` and an internal energy `U = m c_v T`; pressure follows as `p = (κ − 1) U / V`, without the
//! temperature. Gas that leaves takes its enthalpy `c_p T` along. Source: White, *Fluid Mechanics*, 8th ed., section 9.1
//! and the control-volume balances of section 3.6.

/// Specific gas constant of air (J/(kg K)).
pub const GAS_CONSTANT: f64 = 287.05;
/// Ratio of the specific heats of air.
pub const HEAT_RATIO: f64 = 1.4;
/// Specific heat at constant volume (J/(kg K)).
pub const HEAT_AT_VOLUME: f64 = GAS_CONSTANT / (HEAT_RATIO - 1.0);
/// Specific heat at constant pressure (J/(kg K)).
pub const HEAT_AT_PRESSURE: f64 = HEAT_RATIO * HEAT_AT_VOLUME;

/// Pressure and temperature of a gas at one place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gas {
    /// Absolute pressure (Pa).
    pub pressure_pa: f64,
    /// Temperature (K).
    pub temperature_k: f64,
}

impl Gas {
    /// The gas of a store of mass `mass_kg` and internal energy `energy_j` in `volume_m3`.
    #[inline]
    pub fn of_store(mass_kg: f64, energy_j: f64, volume_m3: f64) -> Self {
        Self {
            pressure_pa: (HEAT_RATIO - 1.0) * energy_j / volume_m3,
            temperature_k: energy_j / (mass_kg * HEAT_AT_VOLUME),
        }
    }

    /// Mass (kg) and internal energy (J) of this gas in `volume_m3`.
    pub fn store(self, volume_m3: f64) -> [f64; 2] {
        let mass_kg = self.pressure_pa * volume_m3 / (GAS_CONSTANT * self.temperature_k);
        [mass_kg, mass_kg * HEAT_AT_VOLUME * self.temperature_k]
    }

    /// Density (kg/m³).
    #[inline]
    pub fn density(self) -> f64 {
        self.pressure_pa / (GAS_CONSTANT * self.temperature_k)
    }
}

/// Pressure (Pa) of `mass_kg` in `volume_m3` held at `temperature_k`: small spaces between metal walls.
#[inline]
pub fn isothermal_pressure(mass_kg: f64, volume_m3: f64, temperature_k: f64) -> f64 {
    mass_kg * GAS_CONSTANT * temperature_k / volume_m3
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_store_gives_back_its_gas() {
        let gas = Gas { pressure_pa: 191_325.0, temperature_k: 301.7 };
        let [mass, energy] = gas.store(0.75e-3);
        let back = Gas::of_store(mass, energy, 0.75e-3);
        assert!((back.pressure_pa / gas.pressure_pa - 1.0).abs() < 1e-14);
        assert!((back.temperature_k / gas.temperature_k - 1.0).abs() < 1e-14);
        // Air at 101,325 Pa and 288.15 K has 1.225 kg/m³ in every table (standard atmosphere).
        let standard = Gas { pressure_pa: 101_325.0, temperature_k: 288.15 };
        assert!((standard.density() - 1.225).abs() < 1e-4);
    }
}
