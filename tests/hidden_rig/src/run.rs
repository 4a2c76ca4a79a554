//! A rig that runs: commands in, tick by tick, pressures out.
//!
//! A run begins settled: pump on, at the duties of its first row, for [`SETTLING_S`]; the clocks of slow things (warm
//! coils, drifts, a warming motor) stand still until then, so that a recording's time is also theirs.

use crate::actuation::{Actuation, ActuationMemory};
use crate::integrate::{DormandPrince, Effort, Switched, Tolerance};
use crate::plant::Plant;
use crate::rates::{CHECK_VALVES, Drive, Driven};
use crate::sensor::Noise;
use crate::state::{self, CRANK, LIFT, STATES, State};

/// Length of a tick (s).
pub const TICK_S: f64 = 0.02;
/// Ticks per second.
pub const TICKS_PER_S: f64 = 50.0;
/// Time that a rig settles before its first row (s): several times the slowest pressure here, a pocket's or a chamber's
/// without wool.
pub const SETTLING_S: f64 = 8.0;

/// A rig: the plant, what drives its coils, and how noisy its readings are.
#[derive(Debug, Clone, PartialEq)]
pub struct Rig {
    /// The plant.
    pub plant: Plant,
    /// Between duties and coils.
    pub actuation: Actuation,
    /// Noise of the readings.
    pub noise: Noise,
}

/// Precision of a run's integration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Precision {
    /// For recordings and truths.
    Fine,
    /// For sizing effects: errors of some pascals do not matter there.
    Coarse,
    /// A relative tolerance of the caller's.
    Relative(f64),
}

impl Precision {
    /// Permitted relative error of a step.
    pub fn relative(self) -> f64 {
        match self {
            Self::Fine => 1e-5,
            Self::Coarse => 3e-5,
            Self::Relative(relative) => relative,
        }
    }
}

/// Longest step (s): an eighth of a turn at 3000 rpm, so that no stroke of a check valve is stepped over.
const LONGEST_STEP_S: f64 = 2.5e-3;

/// A command on its way to a driver.
#[derive(Debug, Clone, Copy)]
struct OnItsWay {
    arrives_s: f64,
    channel: usize,
    duty: f64,
}

/// A rig in motion.
#[derive(Debug, Clone)]
pub struct Run<'a> {
    rig: &'a Rig,
    driven: Driven<'a>,
    state: State,
    integrator: DormandPrince<STATES>,
    memory: ActuationMemory,
    on_their_way: Vec<OnItsWay>,
    ticks: i32,
}

impl<'a> Run<'a> {
    /// A rig that has settled at these duties, at time 0.
    pub fn settled(rig: &'a Rig, duty: [f64; 2], precision: Precision) -> Self {
        Self::settled_for(SETTLING_S, rig, duty, precision)
    }

    /// A rig that has settled for so long (s) at these duties, at time 0.
    pub fn settled_for(seconds: f64, rig: &'a Rig, duty: [f64; 2], precision: Precision) -> Self {
        let mut run = Self::from_rest(rig, duty, precision);
        let settling = (seconds * TICKS_PER_S) as i32;
        run.ticks = -settling;
        for _ in 0..settling {
            run.tick(duty, true);
        }
        run
    }

    /// A rig at the atmosphere, at time 0, with the pump turning.
    pub fn from_rest(rig: &'a Rig, duty: [f64; 2], precision: Precision) -> Self {
        let plant = &rig.plant;
        let mut state = plant.at_rest();
        let mut memory = ActuationMemory::new(&rig.actuation, duty);
        let current = memory.currents(&rig.actuation, 0.0);
        for c in 0..2 {
            state[LIFT + c] = plant.vents[c].resting_lift(current[c], 0.0);
            state[state::CURRENT + c] = current[c];
        }
        let drive = Drive { current, throat: memory.throats(), pump_on: true };
        let mut driven = Driven { plant, drive, open: [false; CHECK_VALVES], held: [false; 2] };
        driven.open = driven.guards(0.0, &state).map(|guard| guard > 0.0);
        let tolerance =
            Tolerance { relative: precision.relative(), scales: state::scales(), longest_s: LONGEST_STEP_S };
        let integrator = DormandPrince::new(tolerance);
        Self { rig, driven, state, integrator, memory, on_their_way: Vec::new(), ticks: 0 }
    }

    /// Time since the first row (s).
    pub fn time_s(&self) -> f64 {
        f64::from(self.ticks) / TICKS_PER_S
    }

    /// One tick under these duties, with the motor fed or not.
    pub fn tick(&mut self, duty: [f64; 2], pump_on: bool) {
        let from_s = self.time_s();
        let to_s = f64::from(self.ticks + 1) / TICKS_PER_S;
        for (channel, &duty) in duty.iter().enumerate() {
            let arrives_s = from_s + self.rig.actuation.delay_s[channel];
            self.on_their_way.push(OnItsWay { arrives_s, channel, duty });
        }
        self.driven.drive.pump_on = pump_on;
        let mut now_s = from_s;
        loop {
            self.arrivals(now_s);
            self.driven.drive.current = self.memory.currents(&self.rig.actuation, now_s);
            let next = self.on_their_way.iter().map(|command| command.arrives_s).fold(to_s, f64::min);
            self.integrator.advance(&mut self.driven, &mut self.state, now_s, next);
            now_s = next;
            if now_s >= to_s {
                break;
            }
        }
        // An angle of many turns would lose digits and be measured against its own size.
        self.state[CRANK] %= std::f64::consts::TAU;
        if self.ticks >= 0 {
            let flow = std::array::from_fn(|c| self.driven.vent_flow(&self.state, c));
            self.memory.pass(&self.rig.actuation, TICK_S, flow);
            self.driven.drive.throat = self.memory.throats();
        }
        self.ticks += 1;
    }

    /// Commands that have arrived take effect, in the order in which they were sent.
    fn arrivals(&mut self, now_s: f64) {
        let memory = &mut self.memory;
        self.on_their_way.retain(|command| {
            let here = command.arrives_s <= now_s;
            if here {
                memory.command(command.channel, command.duty);
            }
            !here
        });
    }

    /// Readings of perfect electronics now (kPa gauge).
    pub fn clean_kpa(&self) -> [f64; 2] {
        self.rig.plant.said(&self.state, self.time_s()).map(|pa| 1e-3 * pa)
    }

    /// Pressures that the elements show `late_s` after the tick (Pa gauge), along the tangent: enough for tenths of a millisecond.
    pub fn said_late_pa(&self, late_s: f64) -> [f64; 2] {
        let mut rates = [0.0; STATES];
        self.driven.rates(self.time_s(), &self.state, &mut rates);
        let later = std::array::from_fn(|i| self.state[i] + late_s * rates[i]);
        self.rig.plant.said(&later, self.time_s() + late_s)
    }

    /// Pressures in the chambers over the atmosphere (kPa).
    pub fn chamber_kpa(&self) -> [f64; 2] {
        self.rig.plant.chamber_pressures(&self.state).map(|pa| 1e-3 * pa)
    }

    /// The plant's states.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Cost of the integration so far.
    pub fn effort(&self) -> Effort {
        self.integrator.effort()
    }
}
