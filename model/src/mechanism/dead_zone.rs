//! `dead_zone`: nothing flows until the command has reached some duty.
//!
//! ```text
//! a = Ĉ_u (u − d)      on a valve, limited to a ≥ 0
//! Q = Q₀ (u − d)/(1 − d)      on a pump given by its flow, limited to Q ≥ 0
//! ```
//!
//! A spring that holds a plunger on its seat, or a motor that a small voltage does not turn (Armstrong-Hélouvry, Dupont &
//! Canudas de Wit, *Automatica* 30, 1994). Data sheets of proportional solenoids open at 0.2 … 0.5 of their range; drivers
//! often start above that, so that little of it is left. On a valve it is a spring of area `Ĉ_u d`: where the rig states
//! one (`spring_area_mm2`, as the paper's valves do) that is what moves, and this is no other physics.

use serde::{Deserialize, Serialize};

use super::command_delay::needs_a_command;
use super::{Form, Mechanism, Physics, Place};
use crate::rig::{Number, Pump, Rig, RigError, numbers};

/// A part of a command's range in which nothing happens.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeadZone {
    /// d: the duty from which on something flows (0 … 0.95).
    pub closed_duty: f64,
}

numbers!(DeadZone {
    closed_duty: Number::new("duty", 0.0, 0.95)
        .plausible(0.0, 0.7)
        .starts(&[0.03, 0.1, 0.25, 0.45])
        .hint("the duty below which nothing flows"),
});

impl Physics for DeadZone {
    const ID: &'static str = "dead_zone";
    const PLACES: &'static [Place] = &[Place::Valve, Place::Pump];
    const SETTLED: bool = true;

    fn check(&self, rig: &Rig, component: &str, key: &str) -> Result<(), RigError> {
        needs_a_command(Self::ID, rig, component, key)
    }

    fn forms(rig: &Rig, component: &str) -> Vec<Form> {
        let stated = match (rig.valves.get(component), rig.pumps.get(component)) {
            // A pressure that pushes the flapper open makes a spring of it, stated or not.
            (Some(valve), _) => valve.spring_area_mm2 != 0.0 || valve.pressure_area_mm2_per_n != 0.0,
            (None, Some(Pump::Flow(pump))) => pump.dead_zone_duty > 0.0,
            _ => true,
        };
        if stated {
            return Vec::new();
        }
        vec![Form::of("", Mechanism::DeadZone(DeadZone { closed_duty: 0.0 }), &[0])]
    }
}
