//! Flow through restrictions: ISO 6358 for valves and holes, the laminar law for gaps.
//!
//! ISO 6358-1:2013, with the sonic conductance `C` and the critical ratio `b`:
//! ```text
//! ṁ = C ρ₀ p₁ √(T₀/T₁)                                     p₂/p₁ ≤ b     (choked)
//! ṁ = C ρ₀ p₁ √(T₀/T₁) √(1 − ((p₂/p₁ − b)/(1 − b))²)       p₂/p₁ > b
//! ```
//! with ρ₀ = 1.185 kg/m³ at 100 kPa and T₀ = 293.15 K. Above p₂/p₁ = 0.999 the flow is taken as linear in the pressure
//! difference (the standard's annex knows such a laminar range too), so that the slope stays finite at rest.

use crate::gas::{GAS_CONSTANT, Gas};

/// Density of the reference atmosphere of ISO 8778 (kg/m³).
pub const REFERENCE_DENSITY: f64 = 1.185;
/// Temperature of the reference atmosphere (K).
pub const REFERENCE_TEMPERATURE_K: f64 = 293.15;
/// `√κ (2/(κ+1))^((κ+1)/(2(κ−1)))` at κ = 1.4: mass flow through an area A of ideal nozzle is A p₁ / √(R T₁) times this.
const CHOKED_NUMBER: f64 = 0.684_731_8;
/// Pressure ratio above which the flow is linear in the difference.
const LAMINAR_RATIO: f64 = 0.999;

/// Sonic conductance (m³/(s Pa), reference atmosphere) of an ideal nozzle of that effective area.
///
/// ```text
/// C = A ψ* / (ρ₀ √(R T₀))
/// ```
pub fn sonic_conductance(area_m2: f64) -> f64 {
    area_m2 * CHOKED_NUMBER / (REFERENCE_DENSITY * (GAS_CONSTANT * REFERENCE_TEMPERATURE_K).sqrt())
}

/// Mass flow (kg/s) through a restriction by ISO 6358, from `upstream` to a place at `downstream_pa`; 0 if that is
/// the higher pressure.
#[inline]
pub fn iso6358(conductance: f64, critical_ratio: f64, upstream: Gas, downstream_pa: f64) -> f64 {
    let ratio = downstream_pa / upstream.pressure_pa;
    if ratio >= 1.0 {
        return 0.0;
    }
    let choked = conductance
        * REFERENCE_DENSITY
        * upstream.pressure_pa
        * (REFERENCE_TEMPERATURE_K / upstream.temperature_k).sqrt();
    choked * subsonic(critical_ratio, ratio)
}

/// Share of the choked flow at a pressure ratio below 1.
#[inline]
fn subsonic(critical_ratio: f64, ratio: f64) -> f64 {
    if ratio <= critical_ratio {
        return 1.0;
    }
    let ellipse = |ratio: f64| {
        let x = (ratio - critical_ratio) / (1.0 - critical_ratio);
        (1.0 - x * x).sqrt()
    };
    if ratio > LAMINAR_RATIO { ellipse(LAMINAR_RATIO) * (1.0 - ratio) / (1.0 - LAMINAR_RATIO) } else { ellipse(ratio) }
}

/// Mass flow (kg/s, signed) of a compressible laminar gap: `k (p₁² − p₂²)`, `k` in kg/(s Pa²).
#[inline]
pub fn laminar_gap(conductance: f64, from_pa: f64, to_pa: f64) -> f64 {
    conductance * (from_pa * from_pa - to_pa * to_pa)
}

#[cfg(test)]
mod tests {
    use super::*;

    const AMBIENT: Gas = Gas { pressure_pa: 101_325.0, temperature_k: 293.15 };

    /// Choked flow of air is 0.0404 A p / √T in every textbook (White, eq. 9.46b: 0.6847 √(1/R) = 0.04041).
    #[test]
    fn choked_flow_is_the_textbooks() {
        let flow = iso6358(sonic_conductance(2e-6), 0.5, AMBIENT, 20_000.0);
        let textbook = 0.04041 * 2e-6 * 101_325.0 / 293.15_f64.sqrt();
        assert!((flow / textbook - 1.0).abs() < 3e-4, "{flow} against {textbook}");
        // No further fall downstream changes it.
        assert_eq!(flow, iso6358(sonic_conductance(2e-6), 0.5, AMBIENT, 101_325.0 * 0.5));
    }

    /// With b = 0.5283 the ellipse lies within 0.6 % of the isentropic nozzle over the whole subsonic range.
    #[test]
    fn the_ellipse_is_close_to_the_isentropic_nozzle() {
        for k in 530..999 {
            let ratio = f64::from(k) / 1000.0;
            let isentropic = 7.0_f64.sqrt() * (ratio.powf(2.0 / 1.4) - ratio.powf(2.4 / 1.4)).sqrt() / CHOKED_NUMBER;
            let share = subsonic(0.5283, ratio);
            assert!((share / isentropic - 1.0).abs() < 6e-3, "{ratio}: {share} against {isentropic}");
        }
    }

    #[test]
    fn flow_is_continuous_and_stops_at_equal_pressures() {
        let at = |ratio: f64| iso6358(1e-8, 0.45, AMBIENT, ratio * 101_325.0);
        for edge in [0.45, LAMINAR_RATIO] {
            assert!((at(edge + 1e-9) - at(edge - 1e-9)).abs() < 1e-6 * at(0.2));
        }
        assert_eq!(at(1.0), 0.0);
        assert_eq!(at(1.2), 0.0);
    }
}
