//! The plant as it is built: pump, chambers, vents, sensors and the air around.
//!
//! Channel 0 is the positive one, 1 the negative one; pressures are absolute, except where a name says that they are
//! over the atmosphere. What the parts do to each other is in [`crate::rates`].

use crate::chamber::Chamber;
use crate::gas::Gas;
use crate::pump::{Pump, Swept};
use crate::sensor::Sensor;
use crate::state::{CHAMBER, CRANK, CYLINDER, LIFT, POCKET, SENSING, SNUBBER, SPEED, STATES, State, VOLUME};
use crate::valve::Vent;

/// Index of the positive channel.
pub const POSITIVE: usize = 0;
/// Index of the negative channel.
pub const NEGATIVE: usize = 1;
/// A leak past the pump's gland that opens in a band of the positive pressure: no textbook law has that shape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GlandLeak {
    /// Sonic conductance in the middle of the band (m³/(s Pa)).
    pub conductance: f64,
    /// Middle of the band (Pa over the atmosphere).
    pub middle_pa: f64,
    /// Half width (Pa).
    pub half_width_pa: f64,
}

impl GlandLeak {
    /// Conductance (m³/(s Pa)) at a positive pressure over the atmosphere (Pa).
    pub fn conductance_at(&self, over_atmosphere_pa: f64) -> f64 {
        self.conductance * (-((over_atmosphere_pa - self.middle_pa) / self.half_width_pa).powi(2)).exp()
    }
}

/// Everything that is built, and what the surroundings are.
#[derive(Debug, Clone, PartialEq)]
pub struct Plant {
    /// The air around.
    pub atmosphere: Gas,
    /// The pump.
    pub pump: Pump,
    /// Chambers, positive and negative.
    pub chambers: [Chamber; 2],
    /// Vent valves.
    pub vents: [Vent; 2],
    /// Sensors.
    pub sensors: [Sensor; 2],
    /// Laminar leak between the chambers, through the pump's head (kg/(s Pa²)).
    pub cross_leak: f64,
    /// A leak of odd shape at the pump's gland.
    pub gland_leak: Option<GlandLeak>,
}

impl Plant {
    /// The paper's plant (Table III; nozzle 3.0 mm), built the way this crate builds it.
    pub fn paper() -> Self {
        Self {
            atmosphere: Gas { pressure_pa: 101_325.0, temperature_k: 293.15 },
            pump: Pump::paper(),
            chambers: [Chamber::packed(0.75e-3, 60.0), Chamber::packed(0.4e-3, 40.0)],
            vents: [
                Vent::of_coefficients(4.876e-6, 3.066e-6, 4.474e-6),
                Vent::of_coefficients(7.992e-6, 7.590e-6, 7.339e-6),
            ],
            sensors: [Sensor::sound(); 2],
            cross_leak: 0.0,
            gland_leak: None,
        }
    }

    /// Everything at the atmosphere's pressure, flappers at rest, the crank at its starting angle, at full speed.
    pub fn at_rest(&self) -> State {
        let mut state = [0.0; STATES];
        state[CRANK] = self.pump.start_angle_rad;
        state[SPEED] = self.pump.motor.speed_rad_s;
        let swept = self.pump.swept(state[CRANK]);
        let air = self.atmosphere;
        for i in 0..2 {
            let gas = Gas { temperature_k: self.pump.wall_k, ..air };
            [state[CYLINDER + 2 * i], state[CYLINDER + 2 * i + 1]] = gas.store(swept.volume_m3[i]);
            let chamber = &self.chambers[i];
            state[VOLUME + i] = chamber.volume_m3;
            let gas = Gas { temperature_k: chamber.wall_k, ..air };
            [state[CHAMBER + 2 * i], state[CHAMBER + 2 * i + 1]] = gas.store(chamber.volume_m3);
            if let Some(pocket) = chamber.pocket {
                [state[POCKET + i], _] = gas.store(pocket.volume_m3);
            }
            state[LIFT + i] = self.vents[i].resting_lift(0.0, 0.0);
        }
        state
    }

    /// Air in a chamber.
    #[inline]
    pub fn chamber_gas(&self, state: &State, channel: usize) -> Gas {
        let at = CHAMBER + 2 * channel;
        Gas::of_store(state[at], state[at + 1], state[VOLUME + channel])
    }

    /// Air in both cylinders, and their volumes.
    #[inline]
    pub fn cylinders(&self, state: &State) -> ([Gas; 2], Swept) {
        let swept = self.pump.swept(state[CRANK]);
        let gas = |i: usize| Gas::of_store(state[CYLINDER + 2 * i], state[CYLINDER + 2 * i + 1], swept.volume_m3[i]);
        ([gas(0), gas(1)], swept)
    }

    /// Chamber pressures over the atmosphere (Pa).
    pub fn chamber_pressures(&self, state: &State) -> [f64; 2] {
        std::array::from_fn(|c| self.chamber_gas(state, c).pressure_pa - self.atmosphere.pressure_pa)
    }

    /// Pressures that the sensors' elements show (Pa gauge), noise apart, `time_s` after the start.
    pub fn said(&self, state: &State, time_s: f64) -> [f64; 2] {
        let chambers = self.chamber_pressures(state);
        let elements: [f64; 2] = std::array::from_fn(|c| {
            let pair = |at: usize| [state[at + 2 * c], state[at + 2 * c + 1]];
            self.sensors[c].element_pa(chambers[c], pair(SNUBBER), pair(SENSING))
        });
        std::array::from_fn(|c| self.sensors[c].reading_pa(elements[c], elements[1 - c], time_s))
    }
}
