//! The two chambers: tanks with walls that take heat, that may stretch, leak, and hold a pocket behind a capillary.
//!
//! Nominal chambers are packed with metal wool, as laboratories do to keep a tank isothermal (Kawashima, Fujita and
//! Kagawa 2004): the wool's conductance of tens of W/K holds the air within a fraction of a kelvin of the wall. Without
//! the wool (`chamber_thermal`) only the bare wall is left, and the air warms while it is compressed.

/// Which way a chamber's air can be lost without passing its vent valve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leak {
    /// Laminar part: `k (p₁² − p₂²)` (kg/(s Pa²)).
    pub laminar: f64,
    /// Sharp-edged part: sonic conductance (m³/(s Pa)), with b = 0.4.
    pub sharp: f64,
}

/// A volume that changes at some time after a recording starts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VolumeStep {
    /// Relative change once it is done.
    pub relative: f64,
    /// When it begins (s).
    pub time_s: f64,
    /// Duration (s).
    pub duration_s: f64,
}

impl VolumeStep {
    /// Relative change at a time: a smooth half cosine from none to all.
    #[inline]
    pub fn at(&self, time_s: f64) -> f64 {
        let share = ((time_s - self.time_s) / self.duration_s).clamp(0.0, 1.0);
        self.relative * 0.5 * (1.0 - (std::f64::consts::PI * share).cos())
    }
}

/// A dead-end volume behind a capillary.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pocket {
    /// Volume (m³).
    pub volume_m3: f64,
    /// The capillary's laminar conductance (kg/(s Pa²)).
    pub capillary: f64,
}

/// A chamber.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chamber {
    /// Volume at atmospheric pressure (m³).
    pub volume_m3: f64,
    /// Temperature of wall and wool (K).
    pub wall_k: f64,
    /// Heat conductance between air and wall (W/K).
    pub wall_conductance_w_k: f64,
    /// Growth of the volume per pressure over the atmosphere (m³/Pa).
    pub compliance_m3_pa: f64,
    /// A change of volume during the recording.
    pub volume_step: Option<VolumeStep>,
    /// Leak to the atmosphere.
    pub leak: Leak,
    /// A pocket behind a capillary.
    pub pocket: Option<Pocket>,
}

impl Chamber {
    /// A tight, stiff tank packed with wool.
    pub fn packed(volume_m3: f64, wall_conductance_w_k: f64) -> Self {
        Self {
            volume_m3,
            wall_k: 293.15,
            wall_conductance_w_k,
            compliance_m3_pa: 0.0,
            volume_step: None,
            leak: Leak { laminar: 0.0, sharp: 0.0 },
            pocket: None,
        }
    }

    /// Tells whether the volume can change at all.
    #[inline]
    pub fn is_stiff(&self) -> bool {
        self.compliance_m3_pa == 0.0 && self.volume_step.is_none()
    }

    /// The volume (m³) it tends to at a time and a pressure over the atmosphere.
    #[inline]
    pub fn resting_volume(&self, time_s: f64, over_atmosphere_pa: f64) -> f64 {
        let change = self.volume_step.map_or(0.0, |step| step.at(time_s));
        self.volume_m3 * (1.0 + change) + self.compliance_m3_pa * over_atmosphere_pa
    }
}

/// Time constant by which an elastic wall follows its pressure (s): rubber is that quick, and the pressure stays a plain state.
pub const WALL_FOLLOWS_S: f64 = 4e-3;
/// Critical ratio of a sharp-edged leak.
pub const LEAK_CRITICAL_RATIO: f64 = 0.4;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_of_the_volume_is_smooth_and_complete() {
        let step = VolumeStep { relative: 0.2, time_s: 30.0, duration_s: 0.5 };
        assert_eq!(step.at(29.9), 0.0);
        assert!((step.at(30.25) - 0.1).abs() < 1e-12);
        assert!((step.at(31.0) - 0.2).abs() < 1e-12);
    }
}
