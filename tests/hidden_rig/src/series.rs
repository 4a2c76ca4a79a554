//! A vent valve with what stands in series with it: a tube on the chamber's side, a silencer or filter on the other.
//!
//! The few millilitres between them fill within microseconds, so the flow is the same through all three at any time:
//! ```text
//! tube       p_c² − p_i² = R T (a ṁ + ṁ²/A²)            isothermal line, laminar and turbulent loss
//! silencer   ISO 6358 with its own C and b, solved for the pressure before (filter: behind) it
//! valve      ṁ = iso6358(p_i, p_o)                       solved for ṁ
//! ```
//! The line's law is the isothermal compressible one (White, *Fluid Mechanics*, eq. 9.73 without the logarithm, which is
//! small for short tubes).

use crate::gas::{GAS_CONSTANT, Gas};
use crate::orifice::{REFERENCE_DENSITY, REFERENCE_TEMPERATURE_K, iso6358};
use crate::plant::POSITIVE;
use crate::valve::{Muffler, Tube, Vent};

/// Flow through a vent, and the gas at both its ports.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VentFlow {
    /// Mass flow (kg/s): out of the positive, into the negative chamber; below 0 against that.
    pub forward: f64,
    /// At the port that faces the chamber.
    pub inner: Gas,
    /// At the port that faces the atmosphere.
    pub outer: Gas,
}

impl Tube {
    /// Pressure at the valve (Pa) when a flow leaves (`out`) or enters a chamber through the tube.
    #[inline]
    fn inner_pa(&self, chamber: Gas, flow: f64, out: bool) -> f64 {
        let loss =
            GAS_CONSTANT * chamber.temperature_k * (self.laminar * flow + flow * flow / (self.area_m2 * self.area_m2));
        let squared = chamber.pressure_pa * chamber.pressure_pa + if out { -loss } else { loss };
        squared.max(1.0).sqrt()
    }
}

impl Muffler {
    /// Flow (kg/s) per pascal of upstream pressure when it chokes.
    #[inline]
    fn choked_per_pa(&self, temperature_k: f64) -> f64 {
        self.conductance * REFERENCE_DENSITY * (REFERENCE_TEMPERATURE_K / temperature_k).sqrt()
    }

    /// Pressure before a silencer (Pa) that passes a flow into the atmosphere.
    ///
    /// With x = p_a/p the subsonic law is `(ṁ x/(k p_a))² + ((x − b)/(1 − b))² = 1`, a quadratic in x.
    #[inline]
    fn before_pa(&self, air: Gas, flow: f64) -> f64 {
        let (b, k) = (self.critical_ratio, self.choked_per_pa(air.temperature_k));
        let choked_pa = flow / k;
        if choked_pa * b >= air.pressure_pa {
            return choked_pa;
        }
        let q = flow / (k * air.pressure_pa);
        let width = 1.0 / (1.0 - b);
        let (squared, linear, constant) = (q * q + width * width, b * width * width, (b * width).powi(2) - 1.0);
        let x = (linear + (linear * linear - squared * constant).max(0.0).sqrt()) / squared;
        air.pressure_pa / x
    }

    /// Pressure behind a filter (Pa) that passes a flow out of the atmosphere; falls to b p_a where it chokes.
    #[inline]
    fn behind_pa(&self, air: Gas, flow: f64) -> f64 {
        let b = self.critical_ratio;
        let q = flow / (self.choked_per_pa(air.temperature_k) * air.pressure_pa);
        // Beyond its choked flow no pressure fits: falling on steeply keeps the balance below solvable.
        let ratio = if q < 1.0 { b + (1.0 - b) * (1.0 - q * q).sqrt() } else { b - (q - 1.0) };
        air.pressure_pa * ratio.max(1e-3)
    }
}

/// Flow through a vent of this conductance (m³/(s Pa)) between a chamber and the atmosphere.
pub fn vent_flow(vent: &Vent, channel: usize, conductance: f64, chamber: Gas, air: Gas) -> VentFlow {
    let out = channel == POSITIVE;
    let open = |inner: Gas, outer: Gas| {
        let (up, down) = if out { (inner, outer) } else { (outer, inner) };
        // A chamber on the wrong side of the atmosphere breathes the other way.
        if up.pressure_pa >= down.pressure_pa {
            iso6358(conductance, vent.critical_ratio, up, down.pressure_pa)
        } else {
            -iso6358(conductance, vent.critical_ratio, down, up.pressure_pa)
        }
    };
    let free = open(chamber, air);
    if (vent.tube.is_none() && vent.muffler.is_none()) || free <= 0.0 {
        return VentFlow { forward: free, inner: chamber, outer: air };
    }
    let ports = |flow: f64| {
        let inner_pa = vent.tube.map_or(chamber.pressure_pa, |tube| tube.inner_pa(chamber, flow, out));
        let outer_pa = vent.muffler.map_or(air.pressure_pa, |muffler| {
            if out { muffler.before_pa(air, flow) } else { muffler.behind_pa(air, flow) }
        });
        (Gas { pressure_pa: inner_pa, ..chamber }, Gas { pressure_pa: outer_pa, ..air })
    };
    let excess = |flow: f64| {
        let (inner, outer) = ports(flow);
        open(inner, outer) - flow
    };
    let forward = falling_root(excess, free);
    let (inner, outer) = ports(forward);
    VentFlow { forward, inner, outer }
}

/// Root of a falling function between 0 and `high`, by regula falsi with the Illinois rule (Dowell and Jarratt, 1971).
fn falling_root(excess: impl Fn(f64) -> f64, high: f64) -> f64 {
    let (mut low, mut low_value) = (0.0, excess(0.0));
    let (mut top, mut top_value) = (high, excess(high));
    if top_value >= 0.0 || low_value <= 0.0 {
        return if top_value >= 0.0 { high } else { 0.0 };
    }
    let mut last = high;
    // Which end moved last: the one that stays twice is given half its weight.
    let mut moved_low = None;
    for _ in 0..40 {
        let middle = (low * top_value - top * low_value) / (top_value - low_value);
        // Far below the integrator's tolerance, so that the rates stay smooth.
        if (middle - last).abs() < 1e-11 * high {
            return middle;
        }
        last = middle;
        let value = excess(middle);
        if value > 0.0 {
            if moved_low == Some(true) {
                top_value *= 0.5;
            }
            (low, low_value, moved_low) = (middle, value, Some(true));
        } else {
            if moved_low == Some(false) {
                low_value *= 0.5;
            }
            (top, top_value, moved_low) = (middle, value, Some(false));
        }
    }
    last
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orifice::sonic_conductance;

    const AIR: Gas = Gas { pressure_pa: 101_325.0, temperature_k: 293.15 };

    fn vent(tube_m2: Option<f64>, muffler_m2: Option<f64>) -> Vent {
        let mut vent = Vent::of_coefficients(4.876e-6, 3.066e-6, 4.474e-6);
        vent.tube = tube_m2.map(|area_m2| Tube { laminar: 20.0 / area_m2, area_m2 });
        vent.muffler = muffler_m2.map(|area| Muffler { conductance: sonic_conductance(area), critical_ratio: 0.4 });
        vent
    }

    /// Condition on the solution: each part alone passes the same flow between its own two pressures.
    #[test]
    fn every_part_passes_the_same_flow() {
        for (channel, chamber_pa) in [(0, 190e3), (0, 150e3), (1, 31e3), (1, 60e3)] {
            let chamber = Gas { pressure_pa: chamber_pa, temperature_k: 293.15 };
            let vent = vent(Some(4e-6), Some(5e-6));
            let conductance = sonic_conductance(2e-6);
            let flow = vent_flow(&vent, channel, conductance, chamber, AIR);
            let (muffler, tube) = (vent.muffler.unwrap(), vent.tube.unwrap());
            let (up, down) = if channel == 0 { (flow.inner, flow.outer) } else { (flow.outer, flow.inner) };
            let valve = iso6358(conductance, vent.critical_ratio, up, down.pressure_pa);
            let (from, to) = if channel == 0 { (flow.outer, AIR) } else { (AIR, flow.outer) };
            let silencer = iso6358(muffler.conductance, 0.4, from, to.pressure_pa);
            let squares = (chamber_pa.powi(2) - flow.inner.pressure_pa.powi(2)).abs();
            let line = GAS_CONSTANT * 293.15 * flow.forward * (tube.laminar + flow.forward / tube.area_m2.powi(2));
            assert!(flow.forward > 0.0);
            assert!((valve / flow.forward - 1.0).abs() < 1e-8);
            // The silencer's law is linear above a ratio of 0.999 and its inverse is not: nothing here is so wide.
            assert!((silencer / flow.forward - 1.0).abs() < 1e-8, "{channel} {chamber_pa}");
            assert!((line / squares - 1.0).abs() < 1e-6);
        }
    }

    /// Two equal choked throats in series: the second takes all if the first is wide.
    #[test]
    fn a_wide_series_changes_nothing_and_a_narrow_one_rules() {
        let chamber = Gas { pressure_pa: 300e3, temperature_k: 293.15 };
        let free = vent_flow(&vent(None, None), 0, sonic_conductance(2e-6), chamber, AIR).forward;
        let wide = vent_flow(&vent(Some(1e-3), Some(1e-3)), 0, sonic_conductance(2e-6), chamber, AIR).forward;
        assert!((wide / free - 1.0).abs() < 1e-4);
        // A silencer of a hundredth of the valve: the valve loses nothing to speak of, and the silencer chokes.
        let narrow = vent_flow(&vent(None, Some(2e-8)), 0, sonic_conductance(2e-6), chamber, AIR);
        assert!((narrow.forward / iso6358(sonic_conductance(2e-8), 0.4, chamber, 1e5) - 1.0).abs() < 1e-3);
    }
}
