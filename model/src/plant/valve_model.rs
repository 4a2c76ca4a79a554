//! A valve of a compiled rig by itself, forwards and backwards: flow for a duty, duty for a flow.

use super::command::Stage;
use super::elements::ShapedVent;
use super::{LAWS, Plant};
use crate::mechanism::Bend;
use crate::orifice::FlowFunction;

/// A valve as the balances see it, without anything that remembers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ValveModel {
    vent: ShapedVent<f64>,
    law: FlowFunction<f64>,
    /// Curvature of the coil's force, if it has any.
    bend: Option<Bend<f64>>,
    /// 1/√(R T) of the gas upstream, in s/m.
    inverse_speed: f64,
}

impl Plant<f64> {
    /// The rig's valve number `index`, in the order of its file.
    pub(crate) fn valve_model(&self, index: usize) -> Option<ValveModel> {
        let plain = self.vents.iter().find(|v| v.command == index).map(ShapedVent::from_plain);
        let vent = plain.or_else(|| self.shaped_vents.iter().find(|v| v.command == index).copied())?;
        let stages = &self.commands.get(index)?.stages;
        Some(ValveModel {
            law: *self.laws.get(vent.law % LAWS)?,
            bend: stages.iter().find_map(|stage| if let Stage::Bend(bend) = stage { Some(*bend) } else { None }),
            inverse_speed: 1.0 / (self.gas_constant * self.temperature.get(vent.up)?).sqrt(),
            vent,
        })
    }
}

impl ValveModel {
    /// Mass flow in kg/s from one port to the other at a duty that has long been commanded.
    pub(crate) fn flow(&self, duty: f64, up: f64, down: f64) -> f64 {
        let duty = self.bend.map_or(duty, |bend| bend.at(duty));
        self.inverse_speed * self.vent.flow(&self.law, duty, None, 0.0, [up, down])
    }

    /// The duty that lets `flow` kg/s through, beyond 0 … 1 where no duty does.
    pub(crate) fn duty(&self, flow: f64, up: f64, down: f64) -> f64 {
        let through = flow / self.inverse_speed;
        // What is in series leaves the valve less of the difference; no flow beyond what leaves it a thousandth.
        let most = 0.999 * ((up * up - down * down) / (self.vent.upstream_drop + self.vent.downstream_drop)).max(0.0);
        let squared = (through * through).min(most);
        let up = (up * up - self.vent.upstream_drop * squared).max(0.0).sqrt();
        let down = (down * down + self.vent.downstream_drop * squared).sqrt();
        let area = through * self.inverse_speed / self.flux(up, down);
        // Undo the full opening: only areas below it can be had.
        let share = (area * self.vent.inverse_full_area).clamp(-0.99, 0.99);
        let lift = area / (1.0 - share.powi(4)).powf(0.25);
        let difference = up - down;
        let held = self.vent.pressure_area * difference + self.vent.pressure_curvature * difference * difference;
        let bent = (lift + self.vent.spring_area - held) / self.vent.input_area;
        self.bend.map_or(bent, |bend| bend.inverse(bent))
    }

    /// By how much the flow grows per duty in kg/s while the valve is open and nothing bends or limits it.
    pub(crate) fn flow_per_duty(&self, up: f64, down: f64) -> f64 {
        self.vent.input_area * self.flux(up, down)
    }

    /// Mass flow in kg/s per m² of area. Near equal pressures no area is enough; a floor keeps answers finite.
    fn flux(&self, up: f64, down: f64) -> f64 {
        (self.inverse_speed * up * self.law.at_drop((up - down) / up)).max(1e-3)
    }
}
