//! What could be recorded next: short programmes of commands.
//!
//! Each shows what ordinary recordings hide. With a valve shut, nothing can pass for its spring; with the pump off,
//! nothing for its check valves; with everything open, the sensors read zero or tell their bias; triangles at two rates
//! tell play from lag; a soak warms the coils.

use model::plant::Input;
use model::rig::{Pump, Rig};
use proto::recording::PERIOD_S;

/// A programme: commands by input, row by row (20 ms).
#[derive(Debug, Clone, PartialEq)]
pub struct Programme {
    /// What it is, for people.
    pub name: String,
    /// Commands, `[input][row]`.
    pub inputs: Vec<Vec<f64>>,
    /// Whether it stops a pump.
    pub stops_a_pump: bool,
}

impl Programme {
    /// Rows.
    pub fn rows(&self) -> usize {
        self.inputs.first().map_or(0, Vec::len)
    }

    /// How long it lasts, in s.
    pub fn seconds(&self) -> f64 {
        self.rows() as f64 * PERIOD_S
    }
}

/// What an input does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Role {
    Valve,
    Relay,
    Other,
}

/// How each input was used in the recordings.
#[derive(Debug, Clone, PartialEq)]
pub struct Usage {
    /// Middle of what was commanded, by input.
    pub middle: Vec<f64>,
    /// Lower end (5 %), by input.
    pub low: Vec<f64>,
    /// Upper end (95 %), by input.
    pub high: Vec<f64>,
}

/// A programme in the making.
struct Sheet<'a> {
    roles: &'a [Role],
    usage: &'a Usage,
    inputs: Vec<Vec<f64>>,
}

/// The programme in which every leak shows, and by the way both pressures fall, which one it is.
pub(super) const SHUT_IN: &str = "pump off, all valves shut (14 s)";

const ROWS_PER_S: f64 = 50.0;
/// Settling at the middle before a programme begins, in s.
const SETTLE_S: f64 = 3.0;

impl<'a> Sheet<'a> {
    fn new(roles: &'a [Role], usage: &'a Usage) -> Self {
        Sheet { roles, usage, inputs: vec![Vec::new(); roles.len()] }
    }

    /// The commands in the middle of what was recorded, pump on.
    fn middle(&self) -> Vec<f64> {
        let middle = |i: usize| self.usage.middle.get(i).copied().unwrap_or(0.5);
        self.roles.iter().enumerate().map(|(i, role)| if *role == Role::Relay { 1.0 } else { middle(i) }).collect()
    }

    /// Appends rows; `command` gives all inputs at a time since the beginning of this part.
    fn part(mut self, seconds: f64, command: impl Fn(f64, &mut [f64])) -> Self {
        for row in 0..(seconds * ROWS_PER_S).round() as usize {
            let mut now = self.middle();
            command(row as f64 / ROWS_PER_S, &mut now);
            for (column, value) in self.inputs.iter_mut().zip(now) {
                column.push(value.clamp(0.0, 1.0));
            }
        }
        self
    }

    fn hold(self, seconds: f64) -> Self {
        self.part(seconds, |_, _| ())
    }

    fn named(self, name: impl Into<String>) -> Programme {
        let relays = self.roles.iter().zip(&self.inputs).filter(|(role, _)| **role == Role::Relay);
        let stops_a_pump = relays.flat_map(|(_, on)| on).any(|on| *on < 0.5);
        Programme { name: name.into(), inputs: self.inputs, stops_a_pump }
    }
}

/// All programmes for a rig that was used like this.
pub fn menu(rig: &Rig, inputs: &[Input], usage: &Usage) -> Vec<Programme> {
    let roles: Vec<Role> = inputs.iter().map(|input| role(rig, &input.column)).collect();
    let valves: Vec<usize> = (0..roles.len()).filter(|i| roles[*i] == Role::Valve).collect();
    let relays: Vec<usize> = (0..roles.len()).filter(|i| roles[*i] == Role::Relay).collect();
    let sheet = || Sheet::new(&roles, usage).hold(SETTLE_S);
    let set = |now: &mut [f64], which: &[usize], value: f64| {
        for i in which {
            if let Some(slot) = now.get_mut(*i) {
                *slot = value;
            }
        }
    };
    let mut all = Vec::new();
    if !relays.is_empty() && !valves.is_empty() {
        all.push(
            sheet()
                .part(14.0, |_, now| {
                    set(now, &relays, 0.0);
                    set(now, &valves, 0.0);
                })
                .named(SHUT_IN),
        );
        all.push(
            sheet()
                .part(10.0, |t, now| {
                    set(now, &relays, 0.0);
                    set(now, &valves, if t < 6.0 { 1.0 } else { 0.0 });
                })
                .named("pump off, everything open to the air (6 s), then shut (4 s)"),
        );
        all.push(sheet().part(8.0, |_, now| set(now, &relays, 0.0)).named("pump off, valves half open (8 s)"));
        for valve in &valves {
            let name = inputs.get(*valve).map_or("", |input| input.column.as_str());
            all.push(
                sheet()
                    .part(10.0, |_, now| {
                        set(now, &relays, 0.0);
                        set(now, &valves, 0.0);
                        set(now, &[*valve], *usage.high.get(*valve).unwrap_or(&1.0));
                    })
                    .named(format!("pump off, only {name} open (10 s)")),
            );
        }
        all.push(
            sheet()
                .part(12.0, |t, now| set(now, &relays, if ((t / 2.0) as usize).is_multiple_of(2) { 0.0 } else { 1.0 }))
                .named("pump off and on every 2 s"),
        );
    }
    for valve in &valves {
        let name = inputs.get(*valve).map_or("", |input| input.column.as_str());
        let at = |of: &[f64], otherwise: f64| of.get(*valve).copied().unwrap_or(otherwise);
        let (low, high) = (at(&usage.low, 0.3), at(&usage.high, 0.9));
        let triangle = |t: f64, period: f64| {
            let phase = (t / period).fract();
            low + (high - low) * if phase < 0.5 { 2.0 * phase } else { 2.0 - 2.0 * phase }
        };
        all.push(
            sheet()
                .part(16.0, |t, now| set(now, &[*valve], triangle(t, 16.0)))
                .part(6.0, |t, now| set(now, &[*valve], triangle(t, 2.0)))
                .named(format!("triangles of {name}: one of 16 s, three of 2 s")),
        );
        all.push(
            sheet()
                .part(12.0, |t, now| {
                    set(now, &[*valve], if ((t / 1.5) as usize).is_multiple_of(2) { low } else { high })
                })
                .named(format!("steps of {name} every 1.5 s")),
        );
        if valves.len() > 1 {
            all.push(
                sheet()
                    .part(8.0, |t, now| {
                        let others: Vec<usize> = valves.iter().copied().filter(|v| v != valve).collect();
                        set(now, &others, 1.0);
                        set(now, &[*valve], if t % 4.0 < 1.2 { 0.0 } else { high });
                    })
                    .named(format!("{name} shut for 1.2 s at a time, pump on")),
            );
        }
    }
    if !valves.is_empty() {
        // Half as far again as the recordings went down, and all the way up: what acts on both valves at once, or bends where they
        // were seldom, shows there several times as large.
        let wide = |valve: usize, share: f64| {
            let at = |of: &[f64], otherwise: f64| of.get(valve).copied().unwrap_or(otherwise);
            let (low, high) = (at(&usage.low, 0.3), at(&usage.high, 0.9));
            let least = (low - 0.5 * (high - low)).max(0.0);
            least + share * (1.0 - least)
        };
        for (seconds, period, name) in [(12.0, 0.2, "0.2 s"), (20.0, 1.0, "1 s")] {
            all.push(
                sheet()
                    .part(seconds, |t, now| {
                        for (k, valve) in valves.iter().enumerate() {
                            let bit = register_bit((t / period) as u32, 7 + 5 * k as u32);
                            let of = if bit { &usage.high } else { &usage.low };
                            set(now, &[*valve], of.get(*valve).copied().unwrap_or(0.5));
                        }
                    })
                    .named(format!("random steps of all valves every {name}")),
            );
            all.push(
                sheet()
                    .part(seconds, |t, now| {
                        for (k, valve) in valves.iter().enumerate() {
                            let step = (t / period) as u32;
                            let bits = [0, 31, 62].map(|offset| register_bit(step, offset + 7 + 5 * k as u32));
                            let level = bits.iter().fold(0.0, |level, bit| 2.0 * level + f64::from(u8::from(*bit)));
                            set(now, &[*valve], wide(*valve, level / 7.0));
                        }
                    })
                    .named(format!("random steps of all valves over their whole range every {name}")),
            );
        }
        for valve in valves.iter().filter(|_| valves.len() > 1) {
            let name = inputs.get(*valve).map_or("", |input| input.column.as_str());
            all.push(
                sheet()
                    .part(16.0, |t, now| {
                        let level = [1.0, 0.35, 0.7, 0.15].get((t / 2.0) as usize % 4).copied().unwrap_or(1.0);
                        set(now, &[*valve], wide(*valve, level));
                    })
                    .named(format!("{name} over its whole range, the other valves still")),
            );
        }
        all.push(
            sheet()
                .part(50.0, |t, now| {
                    for valve in &valves {
                        let of = if t < 40.0 { &usage.high } else { &usage.middle };
                        set(now, &[*valve], of.get(*valve).copied().unwrap_or(0.5));
                    }
                })
                .named("soak: valves far open for 40 s, then the middle"),
        );
    }
    all
}

/// Whether a rig's pump can be stopped and its valves shut.
pub fn can_be_shut_in(rig: &Rig, inputs: &[Input]) -> bool {
    let has = |wanted: Role| inputs.iter().any(|input| role(rig, &input.column) == wanted);
    has(Role::Relay) && has(Role::Valve)
}

fn role(rig: &Rig, column: &str) -> Role {
    if rig.valves.values().any(|valve| valve.command == column) {
        Role::Valve
    } else if rig.pumps.values().any(|pump| matches!(pump, Pump::Piston(p) if p.relay.as_deref() == Some(column))) {
        Role::Relay
    } else {
        Role::Other
    }
}

/// Bit `k` of a maximum-length sequence of seven bits (period 127), `x⁷ + x⁶ + 1`.
fn register_bit(k: u32, offset: u32) -> bool {
    let mut register = 0x5a_u32;
    for _ in 0..(k + offset * 11) % 127 {
        let bit = ((register >> 6) ^ (register >> 5)) & 1;
        register = ((register << 1) | bit) & 0x7f;
    }
    register & 1 == 1
}
