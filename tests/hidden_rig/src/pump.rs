//! The two-piston pump, resolved over the crank: swept volume, reed valves, heat and the motor's speed.
//!
//! Head distance from the crank's geometry (slider-crank with crank `r` and rod `l`; the paper's (2) at phase 0°):
//! ```text
//! V(θ) = S (δ − r + l − r cos θ − √(l² − r² sin² θ))
//! ```
//! The gas in a cylinder is not isothermal: it is compressed, gives heat to the wall through `conductance · (T − T_wall)`
//! and leaves at its own temperature. Reed valves open in proportion to the pressure difference beyond the one at which
//! they crack, up to full lift; with no cracking pressure they are open whenever the difference drives flow through.

use crate::orifice::sonic_conductance;

/// A one-way reed valve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reed {
    /// Sonic conductance at full lift (m³/(s Pa)).
    pub conductance: f64,
    /// Critical ratio `b` of ISO 6358.
    pub critical_ratio: f64,
    /// Difference at which it leaves the seat (Pa).
    pub cracking_pa: f64,
    /// Difference beyond that at which it is fully open (Pa); 0 for a reed that has no stiffness.
    pub lift_range_pa: f64,
}

impl Reed {
    /// Share of the full opening at a pressure difference.
    #[inline]
    pub fn lift(&self, difference_pa: f64) -> f64 {
        let beyond_pa = difference_pa - self.cracking_pa;
        if beyond_pa <= 0.0 {
            0.0
        } else if beyond_pa >= self.lift_range_pa {
            1.0
        } else {
            beyond_pa / self.lift_range_pa
        }
    }
}

/// The motor: how fast the crank turns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motor {
    /// Speed without load, cold (rad/s).
    pub speed_rad_s: f64,
    /// Relative loss of speed per bar between the chambers.
    pub droop_per_bar: f64,
    /// Time constant by which the speed follows (s).
    pub spin_up_s: f64,
    /// Relative gain of speed once warm; negative for one that tires.
    pub warming: f64,
    /// Time constant by which it warms (s).
    pub warming_time_s: f64,
}

impl Motor {
    /// The speed (rad/s) it tends to under a pressure difference, `time_s` after the start.
    #[inline]
    pub fn target_speed(&self, time_s: f64, difference_pa: f64) -> f64 {
        let mut speed = self.speed_rad_s;
        if self.warming != 0.0 {
            speed *= 1.0 + self.warming * (1.0 - (-time_s.max(0.0) / self.warming_time_s).exp());
        }
        if self.droop_per_bar != 0.0 {
            speed *= (1.0 - self.droop_per_bar * difference_pa * 1e-5).max(0.0);
        }
        speed
    }
}

/// The pump.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pump {
    /// Crank radius r (m).
    pub crank_m: f64,
    /// Connecting rod l (m).
    pub rod_m: f64,
    /// Distance δ of the head from the piston's lowest point (m): 2 r of it is swept, the rest is clearance.
    pub head_m: f64,
    /// Piston area S (m²).
    pub piston_area_m2: f64,
    /// Temperature of the cylinder walls (K).
    pub wall_k: f64,
    /// Heat conductance between gas and wall of one cylinder (W/K).
    pub wall_conductance_w_k: f64,
    /// Valve from the negative chamber into a cylinder.
    pub inlet: Reed,
    /// Valve from a cylinder into the positive chamber.
    pub outlet: Reed,
    /// Leak past the rings to the crankcase, at the atmosphere (kg/(s Pa²)).
    pub ring_leak: f64,
    /// The motor.
    pub motor: Motor,
    /// Crank angle of the first piston when a recording starts (rad).
    pub start_angle_rad: f64,
}

/// Volume (m³) and its slope over the crank angle (m³/rad) of both cylinders.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Swept {
    /// Volumes (m³).
    pub volume_m3: [f64; 2],
    /// dV/dθ (m³/rad).
    pub slope_m3: [f64; 2],
}

impl Pump {
    /// The paper's pump (Table III), with cylinder walls that take heat well.
    pub fn paper() -> Self {
        let reed = |area_m2: f64| Reed {
            conductance: sonic_conductance(area_m2),
            critical_ratio: 0.5283,
            cracking_pa: 0.0,
            lift_range_pa: 0.0,
        };
        Self {
            crank_m: 0.02,
            rod_m: 0.07,
            head_m: 0.041,
            piston_area_m2: 38.485e-4,
            wall_k: 323.15,
            wall_conductance_w_k: WALL_CONDUCTANCE_W_K,
            inlet: reed(33.47e-6),
            outlet: reed(1.46e-6),
            ring_leak: 0.0,
            motor: Motor {
                speed_rad_s: std::f64::consts::TAU * 50.0,
                droop_per_bar: 0.0,
                spin_up_s: 0.03,
                warming: 0.0,
                warming_time_s: 60.0,
            },
            start_angle_rad: 0.0,
        }
    }

    /// Volumes of both cylinders; the second piston runs half a turn behind.
    #[inline]
    pub fn swept(&self, angle_rad: f64) -> Swept {
        let (sin, cos) = angle_rad.sin_cos();
        let (r, l) = (self.crank_m, self.rod_m);
        // sin² is the same for both pistons, and so is the rod's slant.
        let slant = (l * l - r * r * sin * sin).sqrt();
        let base = self.head_m - r + l - slant;
        let tilt = r * r * sin * cos / slant;
        let area = self.piston_area_m2;
        Swept {
            volume_m3: [area * (base - r * cos), area * (base + r * cos)],
            slope_m3: [area * (r * sin + tilt), area * (tilt - r * sin)],
        }
    }
}

/// Conductance between gas and cylinder wall of the nominal pump (W/K): strokes are then nearly isothermal, which is
/// what the paper's model takes them for; the report of this crate says how far that is off.
pub const WALL_CONDUCTANCE_W_K: f64 = 8.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn volumes_run_between_clearance_and_full_stroke() {
        let pump = Pump::paper();
        let clearance = 38.485e-4 * (0.041 - 0.04);
        // Piston 1 is at the head at θ = 0 and half a turn later at the far end.
        let top = pump.swept(0.0);
        assert!((top.volume_m3[0] - clearance).abs() < 1e-12);
        assert!((top.volume_m3[1] - 38.485e-4 * 0.041).abs() < 1e-12);
        // The slope is the derivative of the volume, at any angle.
        for k in 0..24 {
            let angle = 0.3 * f64::from(k);
            let (low, high, here) = (pump.swept(angle - 1e-5), pump.swept(angle + 1e-5), pump.swept(angle));
            for i in 0..2 {
                let slope = (high.volume_m3[i] - low.volume_m3[i]) / 2e-5;
                assert!((slope - here.slope_m3[i]).abs() < 1e-10);
            }
        }
    }

    #[test]
    fn a_reed_opens_between_cracking_and_full_lift() {
        let reed = Reed { conductance: 1.0, critical_ratio: 0.5, cracking_pa: 2_000.0, lift_range_pa: 1_000.0 };
        assert_eq!(reed.lift(1_999.0), 0.0);
        assert_eq!(reed.lift(2_500.0), 0.5);
        assert_eq!(reed.lift(4_000.0), 1.0);
    }
}
