//! `critical_ratio`: an orifice chokes at another pressure ratio than the ideal nozzle.
//!
//! ISO 6358-1: with `p = P_down/P_up`,
//!
//! ```text
//! Φ = Φ*                              p ≤ b
//! Φ = Φ* √(1 − ((p − b)/(1 − b))²)    p > b
//! ```
//!
//! in place of the paper's (3), with the same choked flow. The ideal nozzle lies within 1 % of `b` = 0.528; real
//! valves have 0.2 … 0.5 and solenoids with winding passages 0.1 and less. It shows where the pressure ratio is
//! between `b` and one, as a flow that falls earlier towards equal pressures.

use serde::{Deserialize, Serialize};

use super::{Form, Mechanism, Physics, Place};
use crate::orifice::FlowFunction;
use crate::rig::{Line, Number, Rig, RigError, numbers};

/// The outflow function of ISO 6358 for a valve or an orifice line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CriticalRatio {
    /// b: pressure ratio at and below which the flow is choked, a bare number.
    pub ratio: f64,
}

numbers!(CriticalRatio {
    ratio: Number::new("", 0.01, 0.95)
        .plausible(0.05, 0.6)
        .starts(&[0.45, 0.35, 0.25, 0.15])
        .hint("a ratio of absolute pressures; 0.528 is the ideal nozzle"),
});

impl Physics for CriticalRatio {
    const ID: &'static str = "critical_ratio";
    const PLACES: &'static [Place] = &[Place::Valve, Place::Line];
    const SETTLED: bool = true;

    fn check(&self, rig: &Rig, component: &str, key: &str) -> Result<(), RigError> {
        if !rig.valves.contains_key(component) && matches!(rig.lines.get(component), Some(Line::Laminar { .. })) {
            return Err(RigError::at(
                format!("{key}.component"),
                format!("`{component}` is a laminar line, which never chokes; `critical_ratio` goes on orifices"),
            ));
        }
        Ok(())
    }

    fn forms(_rig: &Rig, _component: &str) -> Vec<Form> {
        vec![Form::of("", Mechanism::CriticalRatio(CriticalRatio { ratio: 0.528 }), &[0])]
    }
}

impl CriticalRatio {
    /// The outflow function of a gas with heat-capacity ratio `kappa`.
    pub(crate) fn law(&self, kappa: f64) -> FlowFunction<f64> {
        FlowFunction::iso_6358(kappa, self.ratio)
    }
}
