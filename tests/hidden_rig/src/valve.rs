//! The vent valves: a solenoid pulls a flapper off its nozzle, against a preloaded spring and helped by the pressure.
//!
//! The paper's (5) is the balance at rest; here the flapper is a body that moves:
//! ```text
//! x*  = (F_u f(i) + A_n Δp) / k − x₀          resting lift, A_n = π D²/4
//! τ ẋ = x* − x                                 overdamped, or
//! ẍ   = ω² (x* − x) − 2 ζ ω ẋ                  where it may ring
//! area = C_d π D max(x, 0)                     the curtain under the flapper
//! ```
//! In the paper's terms Ĉ_u = C_d π D F_u/k, Ĉ_P = C_d π D/k, Ĉ_k = C_d π D x₀. A flapper with dry friction sticks until
//! the balance has moved by more than the friction, then slides to within a share of it (Karnopp 1985).

use std::f64::consts::{PI, TAU};

/// Nozzle diameter D (m). Not in the paper; 3.0 mm is what the project assumes.
pub const NOZZLE_M: f64 = 3.0e-3;
/// Discharge coefficient of the curtain; the paper knows only its product with the geometry.
pub const DISCHARGE: f64 = 0.72;

/// A flapper that rings instead of creeping to its place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ringing {
    /// Undamped frequency (Hz).
    pub frequency_hz: f64,
    /// Damping ratio.
    pub damping: f64,
}

/// Dry friction on the flapper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Friction {
    /// Force (N) that must build up before it moves.
    pub breakaway_n: f64,
    /// Share of that force it stops short by once it slides.
    pub residual: f64,
}

/// A tube between chamber and valve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tube {
    /// Laminar part of the loss: difference of squared pressures per flow and `R T` (kg/(s m⁴)).
    pub laminar: f64,
    /// Flow area whose dynamic pressure is lost once (m²).
    pub area_m2: f64,
}

/// A silencer behind the positive valve, or a filter before the negative one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Muffler {
    /// Sonic conductance (m³/(s Pa)).
    pub conductance: f64,
    /// Critical ratio: low, as porous bodies have it.
    pub critical_ratio: f64,
}

/// A vent valve with its plumbing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vent {
    /// Solenoid force at full duty (N).
    pub force_n: f64,
    /// Spring stiffness (N/m).
    pub stiffness_n_m: f64,
    /// Lift that the preload takes away (m).
    pub preload_m: f64,
    /// Critical ratio of the curtain.
    pub critical_ratio: f64,
    /// Time constant of the overdamped flapper (s).
    pub follows_s: f64,
    /// Time constant of the coil's current while it rises (s); 0 for a current that follows at once.
    pub coil_rise_s: f64,
    /// Time constant while it falls (s).
    pub coil_fall_s: f64,
    /// Fastest change of the current (full scale per second); infinite if nothing limits it.
    pub slew_per_s: f64,
    /// Saturation of the magnetic circuit: 0 is linear. See [`Vent::force_share`].
    pub saturation: f64,
    /// Dry friction.
    pub friction: Option<Friction>,
    /// A flapper that rings.
    pub ringing: Option<Ringing>,
    /// The tube to the chamber.
    pub tube: Option<Tube>,
    /// Silencer or filter.
    pub muffler: Option<Muffler>,
}

impl Vent {
    /// A valve with the paper's coefficients: Ĉ_u (m²), Ĉ_P (m²/N), Ĉ_k (m²).
    pub fn of_coefficients(input_m2: f64, pressure_m2_n: f64, spring_m2: f64) -> Self {
        let rim_m = DISCHARGE * PI * NOZZLE_M;
        Self {
            force_n: input_m2 / pressure_m2_n,
            stiffness_n_m: rim_m / pressure_m2_n,
            preload_m: spring_m2 / rim_m,
            critical_ratio: 0.5283,
            follows_s: 0.8e-3,
            coil_rise_s: 0.0,
            coil_fall_s: 0.0,
            slew_per_s: f64::INFINITY,
            saturation: 0.0,
            friction: None,
            ringing: None,
            tube: None,
            muffler: None,
        }
    }

    /// The paper's coefficients of this valve: Ĉ_u (m²), Ĉ_P (m²/N), Ĉ_k (m²).
    pub fn coefficients(&self) -> [f64; 3] {
        let rim_m = DISCHARGE * PI * NOZZLE_M;
        let pressure = rim_m / self.stiffness_n_m;
        [self.force_n * pressure, pressure, self.preload_m * rim_m]
    }

    /// Share of the full force at a share `i` of the full current, after Fröhlich and Kennelly:
    /// ```text
    /// f(i) = i (1 + s) / (1 + s i)
    /// ```
    #[inline]
    pub fn force_share(&self, current: f64) -> f64 {
        current * (1.0 + self.saturation) / (1.0 + self.saturation * current)
    }

    /// Resting lift (m) at a current and a pressure difference over the valve; below 0 the flapper sits on its seat.
    #[inline]
    pub fn resting_lift(&self, current: f64, difference_pa: f64) -> f64 {
        let nozzle_area_m2 = 0.25 * PI * NOZZLE_M * NOZZLE_M;
        (self.force_n * self.force_share(current) + nozzle_area_m2 * difference_pa) / self.stiffness_n_m
            - self.preload_m
    }

    /// Flow area (m²) at a lift.
    #[inline]
    pub fn area(&self, lift_m: f64) -> f64 {
        DISCHARGE * PI * NOZZLE_M * lift_m.max(0.0)
    }

    /// Rates of lift (m/s) and of its speed (m/s²) towards a resting lift, unless friction holds it.
    #[inline]
    pub fn motion(&self, lift_m: f64, speed_m_s: f64, resting_m: f64, held: bool) -> [f64; 2] {
        if held {
            return [0.0, 0.0];
        }
        match self.ringing {
            None => [(resting_m - lift_m) / self.follows_s, 0.0],
            Some(ringing) => {
                let omega = TAU * ringing.frequency_hz;
                [speed_m_s, omega * (omega * (resting_m - lift_m) - 2.0 * ringing.damping * speed_m_s)]
            }
        }
    }

    /// Rate of the coil's current towards its target (1/s); only for a coil that takes time.
    #[inline]
    pub fn current_rate(&self, current: f64, target: f64) -> f64 {
        let time_s = if target > current { self.coil_rise_s } else { self.coil_fall_s };
        ((target - current) / time_s.max(FASTEST_COIL_S)).clamp(-self.slew_per_s, self.slew_per_s)
    }

    /// Tells whether the current follows its target at once.
    #[inline]
    pub fn coil_is_instant(&self) -> bool {
        self.coil_rise_s == 0.0 && self.slew_per_s.is_infinite()
    }
}

/// Shortest time constant of a coil that takes time (s).
const FASTEST_COIL_S: f64 = 1.0e-3;

#[cfg(test)]
mod tests {
    use super::*;

    /// At rest the curtain is the paper's (5), for the printed coefficients of both valves.
    #[test]
    fn at_rest_the_curtain_is_the_papers_area() {
        for [c_u, c_p, c_k] in [[4.876e-6, 3.066e-6, 4.474e-6], [7.992e-6, 7.590e-6, 7.339e-6]] {
            let vent = Vent::of_coefficients(c_u, c_p, c_k);
            for (duty, difference_pa) in [(0.6, 60e3), (0.8, 90e3), (1.0, 101_325.0), (0.2, 10e3)] {
                let newton = PI * 9.0e-6 / 4.0 * difference_pa;
                let paper = (c_u * duty + c_p * newton - c_k).max(0.0);
                let area = vent.area(vent.resting_lift(duty, difference_pa));
                assert!((area - paper).abs() < 1e-18);
            }
            for (ours, given) in vent.coefficients().iter().zip([c_u, c_p, c_k]) {
                assert!((ours / given - 1.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn saturation_keeps_both_ends_and_bends_between() {
        let mut vent = Vent::of_coefficients(1.0, 1.0, 1.0);
        vent.saturation = 0.5;
        assert_eq!(vent.force_share(0.0), 0.0);
        assert!((vent.force_share(1.0) - 1.0).abs() < 1e-12);
        assert!(vent.force_share(0.5) > 0.55);
    }
}
