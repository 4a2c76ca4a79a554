//! `exhaust_restriction`: a muffler, filter or port between a valve and the open air.
//!
//! The same law as `line_resistance`, on the other side of the valve:
//!
//! ```text
//! P₁² − P₂² = R T (ṁ/A)²
//! ```
//!
//! On a valve that vents it raises the pressure behind the flapper, on one that lets air in it lowers the pressure
//! before it; either way the flapper feels less of the difference and opens less. Clogging is a falling `A`. A valve
//! that stays choked behind a `line_resistance` feels this one only through the flapper, which tells the two apart,
//! if barely.

use serde::{Deserialize, Serialize};

use super::line_resistance::AREA;
use super::{Form, Mechanism, Physics, Place};
use crate::rig::{ATMOSPHERE, Rig, RigError, numbers};

/// A restriction between a valve and the open air.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExhaustRestriction {
    /// Effective area A in mm².
    pub area_mm2: f64,
}

numbers!(ExhaustRestriction { area_mm2: AREA });

impl Physics for ExhaustRestriction {
    const ID: &'static str = "exhaust_restriction";
    const PLACES: &'static [Place] = &[Place::Valve];
    const SETTLED: bool = true;

    fn check(&self, rig: &Rig, component: &str, key: &str) -> Result<(), RigError> {
        let open = rig.valves.get(component).is_some_and(|v| v.from == ATMOSPHERE || v.to == ATMOSPHERE);
        if open {
            return Ok(());
        }
        Err(RigError::at(
            format!("{key}.component"),
            format!("neither end of `{component}` is the atmosphere; use `line_resistance`"),
        ))
    }

    fn forms(rig: &Rig, component: &str) -> Vec<Form> {
        let Some(valve) = rig.valves.get(component) else { return Vec::new() };
        let area = 0.25 * valve.input_area_mm2;
        let starts = [6.0, 2.5, 1.2, 0.6].map(|times| times * area).to_vec();
        let wide = Mechanism::ExhaustRestriction(ExhaustRestriction { area_mm2: 1e3 });
        vec![Form::of("", wide, &[0]).ranging(0, [0.1 * area, 30.0 * area], starts)]
    }
}
