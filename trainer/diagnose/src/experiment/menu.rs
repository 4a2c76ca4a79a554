//! Experiments that could be recorded next: short programmes of commands.
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
    /// Name for people.
    pub name: String,
    /// Commands, `[input][row]`.
    pub inputs: Vec<Vec<f64>>,
    /// True where it stops a pump.
    pub stops_a_pump: bool,
}

impl Programme {
    /// Rows.
    pub fn rows(&self) -> usize {
        self.inputs.first().map_or(0, Vec::len)
    }

    /// Duration in s.
    pub fn seconds(&self) -> f64 {
        self.rows() as f64 * PERIOD_S
    }
}

/// Kind of part that an input commands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Role {
    Valve,
    Relay,
    /// A pump that is given by its flow and follows a command.
    Drive,
    Other,
}

/// Use of each input in the recordings.
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
    let of_role = |wanted: Role| (0..roles.len()).filter(|i| roles[*i] == wanted).collect();
    let bench = Levers { inputs, usage, valves: of_role(Role::Valve), relays: of_role(Role::Relay), roles: &roles };
    let drives: Vec<usize> = of_role(Role::Drive);
    let mut all = Vec::new();
    if !bench.valves.is_empty() {
        if !bench.relays.is_empty() {
            all.extend(bench.with_the_pump_off());
        }
        all.extend(bench.valves.iter().flat_map(|valve| bench.with_one_valve(*valve)));
        all.extend(bench.with_all_valves());
    }
    all.extend(drives.iter().flat_map(|drive| bench.with_one_drive(*drive)));
    all
}

/// Inputs that can be commanded, and how far they were.
struct Levers<'a> {
    inputs: &'a [Input],
    usage: &'a Usage,
    roles: &'a [Role],
    valves: Vec<usize>,
    relays: Vec<usize>,
}

/// Sets some of the commands.
fn set(now: &mut [f64], which: &[usize], value: f64) {
    for i in which {
        if let Some(slot) = now.get_mut(*i) {
            *slot = value;
        }
    }
}

/// Tells whether a time falls into every second span of so many seconds.
fn in_second_half(t: f64, seconds: f64) -> bool {
    !((t / seconds) as usize).is_multiple_of(2)
}

impl<'a> Levers<'a> {
    /// A sheet that has settled.
    fn sheet(&self) -> Sheet<'a> {
        Sheet::new(self.roles, self.usage).hold(SETTLE_S)
    }

    fn name(&self, valve: usize) -> &'a str {
        self.inputs.get(valve).map_or("", |input| input.column.as_str())
    }

    /// Ends of what a valve was commanded to.
    fn ends(&self, valve: usize) -> [f64; 2] {
        let at = |of: &[f64], otherwise: f64| of.get(valve).copied().unwrap_or(otherwise);
        [at(&self.usage.low, 0.3), at(&self.usage.high, 0.9)]
    }

    /// A command of a valve between half as far again as the recordings went down, and all the way up: what acts on both valves at
    /// once, or bends where they were seldom, shows there several times as large.
    fn wide(&self, valve: usize, share: f64) -> f64 {
        let [low, high] = self.ends(valve);
        let least = (low - 0.5 * (high - low)).max(0.0);
        least + share * (1.0 - least)
    }

    fn with_the_pump_off(&self) -> Vec<Programme> {
        let stopped = |seconds: f64, valves: &dyn Fn(f64, &mut [f64])| {
            self.sheet().part(seconds, |t, now| {
                set(now, &self.relays, 0.0);
                valves(t, now);
            })
        };
        let mut all = vec![
            stopped(14.0, &|_, now| set(now, &self.valves, 0.0)).named(SHUT_IN),
            stopped(10.0, &|t, now| set(now, &self.valves, if t < 6.0 { 1.0 } else { 0.0 }))
                .named("pump off, everything open to the air (6 s), then shut (4 s)"),
            stopped(8.0, &|_, _| ()).named("pump off, valves half open (8 s)"),
        ];
        all.extend(self.valves.iter().map(|valve| {
            let [_, high] = self.ends(*valve);
            let alone = |_: f64, now: &mut [f64]| {
                set(now, &self.valves, 0.0);
                set(now, &[*valve], high);
            };
            stopped(10.0, &alone).named(format!("pump off, only {} open (10 s)", self.name(*valve)))
        }));
        let switched = |t: f64, now: &mut [f64]| set(now, &self.relays, f64::from(in_second_half(t, 2.0)));
        all.push(self.sheet().part(12.0, switched).named("pump off and on every 2 s"));
        all
    }

    /// A pump within what it was commanded to, and at rest: what leaks, and what it delivers against a pressure.
    fn with_one_drive(&self, drive: usize) -> Vec<Programme> {
        let name = self.name(drive);
        let [low, high] = self.ends(drive);
        vec![
            self.sheet().part(15.0, |_, now| set(now, &[drive], 0.0)).named(format!("{name} at 0 for 15 s")),
            self.sheet()
                .part(16.0, |t, now| set(now, &[drive], low + (high - low) * (1.0 - (t / 8.0 - 1.0).abs())))
                .named(format!("{name} up to its highest and down again in 16 s")),
            self.sheet()
                .part(16.0, |t, now| set(now, &[drive], if in_second_half(t, 4.0) { 0.0 } else { high }))
                .named(format!("{name} at its highest and at 0, 4 s each")),
        ]
    }

    fn with_one_valve(&self, valve: usize) -> Vec<Programme> {
        let name = self.name(valve);
        let [low, high] = self.ends(valve);
        let triangle = |t: f64, period: f64| {
            let phase = (t / period).fract();
            low + (high - low) * if phase < 0.5 { 2.0 * phase } else { 2.0 - 2.0 * phase }
        };
        let mut all = vec![
            self.sheet()
                .part(16.0, |t, now| set(now, &[valve], triangle(t, 16.0)))
                .part(6.0, |t, now| set(now, &[valve], triangle(t, 2.0)))
                .named(format!("triangles of {name}: one of 16 s, three of 2 s")),
            self.sheet()
                .part(12.0, |t, now| set(now, &[valve], if in_second_half(t, 1.5) { high } else { low }))
                .named(format!("steps of {name} every 1.5 s")),
        ];
        if self.valves.len() > 1 {
            let shut = |t: f64, now: &mut [f64]| {
                set(now, &self.valves, 1.0);
                set(now, &[valve], if t % 4.0 < 1.2 { 0.0 } else { high });
            };
            all.push(self.sheet().part(8.0, shut).named(format!("{name} shut for 1.2 s at a time, pump on")));
        }
        all
    }

    fn with_all_valves(&self) -> Vec<Programme> {
        let each = |now: &mut [f64], level: &dyn Fn(u32, usize) -> f64| {
            for (k, valve) in (0..).zip(&self.valves) {
                set(now, &[*valve], level(k, *valve));
            }
        };
        let mut all = Vec::new();
        for (seconds, period, name) in [(12.0, 0.2, "0.2 s"), (20.0, 1.0, "1 s")] {
            let one_of_two = |t: f64, now: &mut [f64]| {
                each(now, &|k, valve| {
                    let [low, high] = self.ends(valve);
                    if register_bit((t / period) as u32, 7 + 5 * k) { high } else { low }
                });
            };
            let one_of_eight = |t: f64, now: &mut [f64]| {
                each(now, &|k, valve| {
                    let bits = [0, 31, 62].map(|offset| register_bit((t / period) as u32, offset + 7 + 5 * k));
                    let level = bits.iter().fold(0.0, |level, bit| 2.0 * level + f64::from(u8::from(*bit)));
                    self.wide(valve, level / 7.0)
                });
            };
            let named = |over: &str| format!("random steps of all valves{over} every {name}");
            all.push(self.sheet().part(seconds, one_of_two).named(named("")));
            all.push(self.sheet().part(seconds, one_of_eight).named(named(" over their whole range")));
        }
        for valve in self.valves.iter().filter(|_| self.valves.len() > 1) {
            let steps = |t: f64, now: &mut [f64]| {
                let level = [1.0, 0.35, 0.7, 0.15].get((t / 2.0) as usize % 4).copied().unwrap_or(1.0);
                set(now, &[*valve], self.wide(*valve, level));
            };
            let name = format!("{} over its whole range, the other valves still", self.name(*valve));
            all.push(self.sheet().part(16.0, steps).named(name));
        }
        let soak = |t: f64, now: &mut [f64]| {
            if t < 40.0 {
                each(now, &|_, valve| self.ends(valve)[1]);
            }
        };
        all.push(self.sheet().part(50.0, soak).named("soak: valves far open for 40 s, then the middle"));
        all
    }
}

/// Says whether a rig's pump can be stopped and its valves shut.
pub fn can_be_shut_in(rig: &Rig, inputs: &[Input]) -> bool {
    has(rig, inputs, Role::Relay) && has(rig, inputs, Role::Valve)
}

/// Says whether a pump of the rig follows a command.
pub(super) fn has_a_drive(rig: &Rig, inputs: &[Input]) -> bool {
    has(rig, inputs, Role::Drive)
}

/// Tells whether the daemon can drive the rig: it has the paper's two sides and commands.
pub(crate) fn drives(rig: &Rig) -> bool {
    let commanded = |column: &str| rig.valves.values().any(|valve| valve.command == column);
    rig.volumes.contains_key("positive")
        && rig.volumes.contains_key("negative")
        && commanded("u_pos")
        && commanded("u_neg")
}

fn has(rig: &Rig, inputs: &[Input], wanted: Role) -> bool {
    inputs.iter().any(|input| role(rig, &input.column) == wanted)
}

fn role(rig: &Rig, column: &str) -> Role {
    if rig.valves.values().any(|valve| valve.command == column) {
        Role::Valve
    } else if rig.pumps.values().any(|pump| matches!(pump, Pump::Piston(p) if p.relay.as_deref() == Some(column))) {
        Role::Relay
    } else if rig.pumps.values().any(|pump| matches!(pump, Pump::Flow(p) if p.command.as_deref() == Some(column))) {
        Role::Drive
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

#[cfg(test)]
mod tests {
    use super::*;

    /// One chamber, a pump that follows a command, and a leak: no valve at all.
    const CELL: &str = r#"
format = 1
name = "cell"
[gas]
gas_constant_j_per_kg_k = 287.0
heat_capacity_ratio = 1.4
[atmosphere]
pressure_kpa_abs = 101.3
temperature_k = 293.15
[integrator]
step_ms = 0.4
tick_ms = 20.0
[volumes.cell]
volume_l = 1.0
temperature_k = 293.15
[pumps.p]
kind = "flow"
outlet = "cell"
command = "pump"
flow_l_per_min = 5.0
[lines.leak]
kind = "laminar"
from = "cell"
to = "atmosphere"
resistance_kpa_s_per_l = 40000.0
[sensors.g]
volume = "cell"
column = "p_cell_kpa"
range_kpa_gauge = [0.0, 200.0]
range_v = [0.0, 5.0]
"#;

    #[test]
    fn a_rig_without_valves_has_programmes_of_its_pump() {
        let rig = Rig::from_toml(CELL).unwrap();
        let plant = model::plant::Plant::<f64>::new(&rig).unwrap();
        let usage = Usage { middle: vec![0.4], low: vec![0.1], high: vec![0.8] };
        let all = menu(&rig, plant.inputs(), &usage);
        assert_eq!(all.len(), 3);
        let within = |p: &Programme| p.inputs.len() == 1 && p.inputs[0].iter().all(|duty| (0.0..=0.8).contains(duty));
        assert!(all.iter().all(within), "{:?}", all.iter().map(|p| &p.name).collect::<Vec<_>>());
        assert!(all[0].inputs[0].ends_with(&[0.0; 700]) && !all[0].stops_a_pump);
    }
}
