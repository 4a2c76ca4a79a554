//! `pump_droop`: a pump runs slower the more it works against.
//!
//! ```text
//! ω = ω₀ (1 − k ΔP),      ΔP = P_outlet − P_inlet,      ω ≥ 0
//! ```
//!
//! A DC motor without speed control falls along a straight line of speed over torque, and the mean torque of a
//! compressor goes with its pressure difference. `k` per bar: 0 … 0.15 for a motor of ample size, 0.3 for a weak one;
//! 1/k is the difference at which it stalls. For a piston pump the speed is taken anew at the start of each tick
//! (the rotor's inertia does not let it follow within one); for a pump given by its flow the flow falls at once:
//! `Q = Q₀ (1 − k ΔP)`, diaphragm pumps' data sheets, where leakage and dead volume do the same as the motor.
//! Any change of speed makes the pump's ripple beat against the sampling, a tachometer for free.

use serde::{Deserialize, Serialize};

use super::{Form, Mechanism, Physics, Place};
use crate::rig::{Number, Pump, Rig, numbers};

/// A pump that slows down under load.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PumpDroop {
    /// k: share of the speed lost per bar (100 kPa) between outlet and inlet.
    pub speed_loss_per_bar: f64,
}

numbers!(PumpDroop {
    // 100 per bar stalls a fan at 1 kPa.
    speed_loss_per_bar: Number::new("1/bar", 0.0, 100.0)
        .plausible(0.0, 0.3)
        .starts(&[0.01, 0.04, 0.12])
        .hint("a share of the speed for each 100 kPa"),
});

impl Physics for PumpDroop {
    const ID: &'static str = "pump_droop";
    const PLACES: &'static [Place] = &[Place::Pump];
    const SETTLED: bool = true;

    fn forms(rig: &Rig, component: &str) -> Vec<Form> {
        let form = Form::of("", Mechanism::PumpDroop(PumpDroop { speed_loss_per_bar: 0.0 }), &[0]);
        match rig.pumps.get(component) {
            // Small pumps without pistons stall anywhere between 5 and 500 kPa.
            Some(Pump::Flow(pump)) => {
                // One that its sensor's range is made for stalls no lower than at a fifth of it.
                let at_a_fifth = super::scale::load_kpa(rig, &pump.outlet).map_or(0.0, |kpa| 500.0 / kpa);
                vec![form.ranging(0, [0.0, at_a_fifth.clamp(20.0, 100.0)], vec![0.2, 0.5, 1.0, 2.0, 6.0])]
            }
            _ => vec![form],
        }
    }
}
