//! From the commanded duty to the current that each coil tends to: what happens between the controller and the coil.
//!
//! ```text
//! duty → delay → magnetic hysteresis (Preisach) → dry friction of the plunger → supply → warm copper → current
//! ```
//! All of it changes with the 50 Hz frame of the PWM, not within it; the coil's own lag is in [`crate::valve`].
//! Copper: the resistance rises with the coil's temperature, so a coil fed by voltage loses current as it warms; body
//! and winding warm with two time constants (a fifth of the rise comes eight times sooner, as windings do).

use std::f64::consts::TAU;

use crate::preisach::Preisach;

/// Relays of a valve's magnetic circuit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MagneticHysteresis {
    /// Mean half width of the loop (duty).
    pub half_width: f64,
    /// Share by which half widths differ from their mean.
    pub spread: f64,
}

/// A plunger that sticks in its guide: the balance of forces there knows the duty only.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StickyPlunger {
    /// Change of the duty at which it breaks away.
    pub band: f64,
    /// Share of the band by which it then stops short.
    pub residual: f64,
}

/// A coil that warms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WarmCoil {
    /// Rise of the resistance at full duty, relative.
    pub rise: f64,
    /// Time constant of the body (s).
    pub time_s: f64,
}

/// A supply whose regulation hunts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HuntingSupply {
    /// Amplitude of the voltage, relative.
    pub amplitude: f64,
    /// Frequency (Hz).
    pub frequency_hz: f64,
}

/// A throat that clogs with what the air carries (moisture, ice) and clears again.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clogging {
    /// Share of the throat that is lost at [`CLOGGING_FLOW_KG_S`] for long.
    pub share: f64,
    /// Time constant (s).
    pub time_s: f64,
}

/// Flow at which a clogging throat is stated (kg/s): what the pump delivers at the paper's working point.
pub const CLOGGING_FLOW_KG_S: f64 = 5e-4;

/// Path between duties and coils.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Actuation {
    /// Delay of the commands (s), by channel.
    pub delay_s: [f64; 2],
    /// Magnetic hysteresis.
    pub hysteresis: [Option<MagneticHysteresis>; 2],
    /// Dry friction of the plungers.
    pub sticky: [Option<StickyPlunger>; 2],
    /// Relative loss of voltage per unit of summed duty: the resistance that both coils share.
    pub shared_resistance: f64,
    /// Coils that warm.
    pub warm: [Option<WarmCoil>; 2],
    /// A supply that hunts.
    pub hunting: Option<HuntingSupply>,
    /// Throats that clog.
    pub clogging: [Option<Clogging>; 2],
}

/// Share of a warm coil's rise that the winding takes, and how much sooner.
const WINDING_SHARE: f64 = 0.2;
const WINDING_SOONER: f64 = 8.0;

/// The memory of it all.
#[derive(Debug, Clone)]
pub struct ActuationMemory {
    relays: [Option<Preisach>; 2],
    plunger: [f64; 2],
    /// Warmth of body and winding, 0 cold to 1 at full duty for long.
    warmth: [[f64; 2]; 2],
    clogged: [f64; 2],
    duty: [f64; 2],
}

impl ActuationMemory {
    /// Cold coils, clean throats, relays and plungers come up from 0 to the duties of the start.
    pub fn new(actuation: &Actuation, duty: [f64; 2]) -> Self {
        Self {
            relays: actuation.hysteresis.map(|h| h.map(|h| Preisach::new(h.half_width, h.spread))),
            plunger: [0.0; 2],
            warmth: [[0.0; 2]; 2],
            clogged: [0.0; 2],
            duty,
        }
    }

    /// A duty that has arrived at a driver.
    pub fn command(&mut self, channel: usize, duty: f64) {
        self.duty[channel] = duty;
    }

    /// Currents that the coils tend to, `time_s` after the start.
    pub fn currents(&mut self, actuation: &Actuation, time_s: f64) -> [f64; 2] {
        let mut voltage = 1.0 / (1.0 + actuation.shared_resistance * (self.duty[0] + self.duty[1]));
        if let Some(hunting) = actuation.hunting {
            voltage *= 1.0 + hunting.amplitude * (TAU * hunting.frequency_hz * time_s).sin();
        }
        std::array::from_fn(|c| {
            let mut magnetic = self.duty[c];
            if let Some(relays) = &mut self.relays[c] {
                magnetic = relays.apply(magnetic);
            }
            if let Some(sticky) = actuation.sticky[c] {
                let missing = magnetic - self.plunger[c];
                if missing.abs() > sticky.band {
                    self.plunger[c] = magnetic - sticky.residual * sticky.band * missing.signum();
                }
                magnetic = self.plunger[c];
            }
            let resistance = actuation.warm[c].map_or(1.0, |warm| {
                let [body, winding] = self.warmth[c];
                1.0 + warm.rise * ((1.0 - WINDING_SHARE) * body + WINDING_SHARE * winding)
            });
            magnetic * voltage / resistance
        })
    }

    /// Shares of the throats that are free.
    pub fn throats(&self) -> [f64; 2] {
        self.clogged.map(|clogged| 1.0 - clogged.clamp(0.0, 0.95))
    }

    /// Lets time pass: coils warm with the square of their duty, throats clog with the flow through them (kg/s).
    pub fn pass(&mut self, actuation: &Actuation, seconds: f64, vent_flow_kg_s: [f64; 2]) {
        for (c, flow_kg_s) in vent_flow_kg_s.into_iter().enumerate() {
            if let Some(warm) = actuation.warm[c] {
                let power = self.duty[c] * self.duty[c];
                for (warmth, time_s) in self.warmth[c].iter_mut().zip([warm.time_s, warm.time_s / WINDING_SOONER]) {
                    // Exact while the duty is held.
                    *warmth = power + (*warmth - power) * (-seconds / time_s).exp();
                }
            }
            if let Some(clogging) = actuation.clogging[c] {
                let end = clogging.share * (flow_kg_s.abs() / CLOGGING_FLOW_KG_S).powi(2);
                self.clogged[c] = end + (self.clogged[c] - end) * (-seconds / clogging.time_s).exp();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_installed_passes_the_duty_on() {
        let actuation = Actuation::default();
        let mut memory = ActuationMemory::new(&actuation, [0.8, 0.7]);
        assert_eq!(memory.currents(&actuation, 3.0), [0.8, 0.7]);
        assert_eq!(memory.throats(), [1.0, 1.0]);
    }

    #[test]
    fn a_warm_coil_ends_at_the_copper_law() {
        let actuation = Actuation { warm: [Some(WarmCoil { rise: 0.1, time_s: 90.0 }), None], ..Actuation::default() };
        let mut memory = ActuationMemory::new(&actuation, [1.0, 1.0]);
        for _ in 0..200 {
            memory.pass(&actuation, 10.0, [0.0; 2]);
        }
        let [warm, cold] = memory.currents(&actuation, 0.0);
        assert!((warm - 1.0 / 1.1).abs() < 1e-9);
        assert_eq!(cold, 1.0);
    }

    #[test]
    fn a_shared_resistance_couples_the_valves() {
        let actuation = Actuation { shared_resistance: 0.05, ..Actuation::default() };
        let mut memory = ActuationMemory::new(&actuation, [0.8, 0.0]);
        let alone = memory.currents(&actuation, 0.0)[0];
        memory.command(1, 1.0);
        let together = memory.currents(&actuation, 0.0)[0];
        assert!((alone - 0.8 / 1.04).abs() < 1e-12 && (together - 0.8 / 1.09).abs() < 1e-12);
    }

    #[test]
    fn a_sticky_plunger_moves_in_steps() {
        let actuation =
            Actuation { sticky: [Some(StickyPlunger { band: 0.02, residual: 0.0 }), None], ..Actuation::default() };
        let mut memory = ActuationMemory::new(&actuation, [0.5, 0.5]);
        memory.currents(&actuation, 0.0);
        let mut values = Vec::new();
        for k in 0..100 {
            memory.command(0, 0.5 + 1e-3 * f64::from(k));
            values.push(memory.currents(&actuation, 0.0)[0]);
        }
        values.dedup();
        // 0.1 of slow travel in steps of just over 0.02.
        assert!((4..=6).contains(&values.len()), "{values:?}");
    }
}
