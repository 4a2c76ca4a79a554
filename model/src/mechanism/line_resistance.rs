//! `line_resistance`: a hose or fitting in series with a valve, a pump or a capillary.
//!
//! A rough tube of effective area `A` (friction and fittings lumped: `A = A_tube/√(λ L/D + Σζ)`), isothermal and
//! quasi-static (Shapiro, *Compressible Fluid Flow* I, 1953, ch. 6, without the logarithm, which matters only near
//! choking):
//!
//! ```text
//! P₁² − P₂² = R T (ṁ/A)²
//! ```
//!
//! For small drops it passes what an orifice of area `A` does. It holds no gas of its own, so it adds no state:
//!
//! * on a valve it lies between the valve and its chamber, and the flapper feels what is left of the pressure. The
//!   flow through both is found by secants in `ṁ²`, in which the problem is nearly straight;
//! * on a pump of kind `piston` it lies between one port (`port = "inlet"` or `"outlet"`) and the cylinders, which
//!   draw in turns: there it is `1/C² = 1/C_check² + 1/A²`, the same as a smaller check valve;
//! * on a line of kind `laminar` it adds the part of the drop that grows with the square of the flow, a parabolic
//!   resistor: `P₁² − P₂² = ṁ/k + R T (ṁ/A)²`.
//!
//! It costs most where the flow is greatest, much like a valve whose opening ends (`valve_force_curve`).

use serde::{Deserialize, Serialize};

use super::{Form, Mechanism, Physics, Place};
use crate::rig::{Line, Number, Pump, Rig, RigError, numbers};

/// A restriction in series with a component.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LineResistance {
    /// Effective area A in mm².
    pub area_mm2: f64,
    /// At which port, on a pump; left out elsewhere.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub port: Option<PumpPort>,
}

/// A port of a pump.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PumpPort {
    /// Where it draws from.
    Inlet,
    /// Where it delivers to.
    Outlet,
}

/// The area of a restriction in series; large is none.
pub(super) const AREA: Number = Number::new("mm²", 1e-3, 1e4)
    .plausible(0.2, 100.0)
    .starts(&[12.0, 5.0, 2.5, 1.2])
    .acts_with_power(-2.0)
    .hint("the area of the restriction; leave it out where there is none");

numbers!(LineResistance { area_mm2: AREA });

impl Physics for LineResistance {
    const ID: &'static str = "line_resistance";
    const PLACES: &'static [Place] = &[Place::Valve, Place::Pump, Place::Line];
    const SETTLED: bool = true;

    fn check(&self, rig: &Rig, component: &str, key: &str) -> Result<(), RigError> {
        let refuse = |key: String, problem: String| Err(RigError::at(key, problem));
        let on_pump = !rig.valves.contains_key(component) && rig.pumps.contains_key(component);
        match (self.port, rig.pumps.get(component)) {
            (None, Some(Pump::Piston(_))) if on_pump => {
                refuse(format!("{key}.port"), "missing; on a pump say port = \"inlet\" or \"outlet\"".to_owned())
            }
            (_, Some(Pump::Flow(_))) if on_pump => refuse(
                format!("{key}.component"),
                format!("`{component}` delivers its stated flow through any line; `pump_droop` makes it give way"),
            ),
            (Some(_), _) if !on_pump => {
                refuse(format!("{key}.port"), format!("`{component}` is no pump; leave `port` out"))
            }
            _ if !rig.valves.contains_key(component)
                && matches!(rig.lines.get(component), Some(Line::Orifice { .. })) =>
            {
                refuse(
                    format!("{key}.component"),
                    format!("`{component}` is an orifice: a restriction in series is a smaller `area_mm2`"),
                )
            }
            _ => Ok(()),
        }
    }

    fn forms(rig: &Rig, component: &str) -> Vec<Form> {
        let line = |port| Mechanism::LineResistance(LineResistance { area_mm2: 1e3, port });
        // A restriction shows once it is not much wider than what it is in series with.
        let sized = |name, port, area: f64| {
            let starts = [6.0, 2.5, 1.2, 0.6].map(|times| times * area).to_vec();
            Form::of(name, line(port), &[0]).ranging(0, [0.1 * area, 30.0 * area], starts)
        };
        if let Some(valve) = rig.valves.get(component) {
            return vec![sized("", None, 0.25 * valve.input_area_mm2)];
        }
        match rig.pumps.get(component) {
            Some(Pump::Piston(pump)) => vec![
                sized("inlet", Some(PumpPort::Inlet), pump.inlet_check_area_mm2),
                sized("outlet", Some(PumpPort::Outlet), pump.outlet_check_area_mm2),
            ],
            Some(Pump::Flow(_)) => Vec::new(),
            None if matches!(rig.lines.get(component), Some(Line::Laminar { .. })) => {
                let form = Form::of("", line(None), &[0]).ranging(0, [0.1, 1e3], vec![100.0, 30.0, 10.0, 3.0]);
                vec![form.scaled(0, super::scale::of_line(rig, component))]
            }
            None => Vec::new(),
        }
    }
}
