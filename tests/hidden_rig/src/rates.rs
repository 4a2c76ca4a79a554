//! The rates of the plant: what its parts do to each other while commands are held.
//!
//! Balances of mass and energy for the four stores (two cylinders, two chambers), with every flow taking its enthalpy
//! along (White, *Fluid Mechanics*, section 3.6):
//! ```text
//! ṁ = Σ ṁ_in − Σ ṁ_out
//! U̇ = Σ ṁ_in c_p T_up − Σ ṁ_out c_p T − G (T − T_wall) − p V̇
//! ```
//! Small spaces between metal walls (pockets) are isothermal.

use crate::chamber::{LEAK_CRITICAL_RATIO, WALL_FOLLOWS_S};
use crate::gas::{Gas, HEAT_AT_PRESSURE, isothermal_pressure};
use crate::integrate::Switched;
use crate::orifice::{iso6358, laminar_gap, sonic_conductance};
use crate::plant::{NEGATIVE, POSITIVE, Plant};
use crate::series::{VentFlow, vent_flow};
use crate::state::{
    CHAMBER, CRANK, CURRENT, CYLINDER, LEDGER, LIFT, LIFT_SPEED, POCKET, SENSING, SNUBBER, SPEED, STATES, State, VOLUME,
};

/// The check valves, each a switch of the integration: inlets of both cylinders, then outlets.
pub const CHECK_VALVES: usize = 4;
/// Stores in the order of the balances: cylinder 1, cylinder 2, positive chamber, negative chamber.
const STORES: usize = 4;

/// Commands and surroundings that drive the plant over a stretch of time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drive {
    /// Current that each coil tends to, as share of full scale.
    pub current: [f64; 2],
    /// Share of each vent's throat that is free.
    pub throat: [f64; 2],
    /// True where the motor is fed.
    pub pump_on: bool,
}

/// A plant under a drive, with its switches: what is integrated.
#[derive(Debug, Clone)]
pub struct Driven<'a> {
    /// The plant.
    pub plant: &'a Plant,
    /// Drive that is in force.
    pub drive: Drive,
    /// Which check valves are open.
    pub open: [bool; CHECK_VALVES],
    /// Which flappers friction holds.
    pub held: [bool; 2],
}

/// Flows into the stores, of mass (kg/s) and of energy (W).
#[derive(Debug, Default)]
struct Balance {
    mass: [f64; STORES],
    energy: [f64; STORES],
}

impl Balance {
    #[inline]
    fn take(&mut self, store: usize, flow: f64, temperature_k: f64) {
        self.mass[store] += flow;
        self.energy[store] += flow * HEAT_AT_PRESSURE * temperature_k;
    }

    #[inline]
    fn pass(&mut self, from: usize, to: usize, flow: f64, temperature_k: f64) {
        self.take(from, -flow, temperature_k);
        self.take(to, flow, temperature_k);
    }
}

impl Driven<'_> {
    /// Mass flow (kg/s) through a vent, out of the rig for the positive and into it for the negative one.
    pub fn vent_flow(&self, state: &State, channel: usize) -> f64 {
        self.vent(state, channel, self.plant.chamber_gas(state, channel)).forward
    }

    #[inline]
    fn vent(&self, state: &State, c: usize, chamber: Gas) -> VentFlow {
        let vent = &self.plant.vents[c];
        let conductance = sonic_conductance(vent.area(state[LIFT + c])) * self.drive.throat[c];
        vent_flow(vent, c, conductance, chamber, self.plant.atmosphere)
    }

    /// Where the balance of forces puts a flapper (m).
    #[inline]
    fn resting_lift(&self, state: &State, c: usize, flow: &VentFlow) -> f64 {
        let vent = &self.plant.vents[c];
        let current = if vent.coil_is_instant() { self.drive.current[c] } else { state[CURRENT + c] };
        let over = flow.inner.pressure_pa - flow.outer.pressure_pa;
        vent.resting_lift(current, if c == POSITIVE { over } else { -over })
    }

    #[inline]
    fn pump_rates(&self, time_s: f64, state: &State, chambers: [Gas; 2], balance: &mut Balance, rates: &mut State) {
        let pump = &self.plant.pump;
        let speed = state[SPEED];
        let across_pa = chambers[POSITIVE].pressure_pa - chambers[NEGATIVE].pressure_pa;
        let target = if self.drive.pump_on { pump.motor.target_speed(time_s, across_pa) } else { 0.0 };
        rates[CRANK] = speed;
        rates[SPEED] = (target - speed) / pump.motor.spin_up_s;
        let (cylinders, swept) = self.plant.cylinders(state);
        for (i, gas) in cylinders.into_iter().enumerate() {
            if self.open[i] {
                let over_pa = chambers[NEGATIVE].pressure_pa - gas.pressure_pa;
                let conductance = pump.inlet.conductance * pump.inlet.lift(over_pa);
                let flow = iso6358(conductance, pump.inlet.critical_ratio, chambers[NEGATIVE], gas.pressure_pa);
                balance.pass(3, i, flow, chambers[NEGATIVE].temperature_k);
            }
            if self.open[2 + i] {
                let over_pa = gas.pressure_pa - chambers[POSITIVE].pressure_pa;
                let conductance = pump.outlet.conductance * pump.outlet.lift(over_pa);
                let flow = iso6358(conductance, pump.outlet.critical_ratio, gas, chambers[POSITIVE].pressure_pa);
                balance.pass(i, 2, flow, gas.temperature_k);
            }
            if pump.ring_leak != 0.0 {
                let outside = self.plant.atmosphere;
                let flow = laminar_gap(pump.ring_leak, outside.pressure_pa, gas.pressure_pa);
                // Air that comes in past the rings has the wall's temperature.
                balance.take(i, flow, if flow > 0.0 { pump.wall_k } else { gas.temperature_k });
            }
            let heat = pump.wall_conductance_w_k * (gas.temperature_k - pump.wall_k);
            balance.energy[i] -= heat + gas.pressure_pa * swept.slope_m3[i] * speed;
        }
    }

    #[inline]
    fn vent_rates(&self, state: &State, c: usize, chamber: Gas, balance: &mut Balance, rates: &mut State) {
        let vent = &self.plant.vents[c];
        let flow = self.vent(state, c, chamber);
        let resting = self.resting_lift(state, c, &flow);
        [rates[LIFT + c], rates[LIFT_SPEED + c]] =
            vent.motion(state[LIFT + c], state[LIFT_SPEED + c], resting, self.held[c]);
        if !vent.coil_is_instant() {
            rates[CURRENT + c] = vent.current_rate(state[CURRENT + c], self.drive.current[c]);
        }
        let out = flow.forward * if c == POSITIVE { 1.0 } else { -1.0 };
        let temperature_k = if out > 0.0 { chamber.temperature_k } else { self.plant.atmosphere.temperature_k };
        balance.take(2 + c, -out, temperature_k);
    }

    #[inline]
    fn chamber_rates(
        &self,
        time_s: f64,
        state: &State,
        c: usize,
        chamber: Gas,
        balance: &mut Balance,
        rates: &mut State,
    ) {
        let plant = self.plant;
        let built = &plant.chambers[c];
        let air = plant.atmosphere;
        let store = 2 + c;
        if built.leak.laminar != 0.0 {
            let inwards = laminar_gap(built.leak.laminar, air.pressure_pa, chamber.pressure_pa);
            balance.take(store, inwards, if inwards > 0.0 { air.temperature_k } else { chamber.temperature_k });
        }
        if built.leak.sharp != 0.0 {
            let outwards = iso6358(built.leak.sharp, LEAK_CRITICAL_RATIO, chamber, air.pressure_pa);
            let inwards = iso6358(built.leak.sharp, LEAK_CRITICAL_RATIO, air, chamber.pressure_pa);
            balance.take(store, -outwards, chamber.temperature_k);
            balance.take(store, inwards, air.temperature_k);
        }
        if let Some(pocket) = built.pocket {
            let inside_pa = isothermal_pressure(state[POCKET + c], pocket.volume_m3, built.wall_k);
            let into = laminar_gap(pocket.capillary, chamber.pressure_pa, inside_pa);
            balance.take(store, -into, if into > 0.0 { chamber.temperature_k } else { built.wall_k });
            rates[POCKET + c] = into;
        }
        if c == POSITIVE
            && let Some(gland) = plant.gland_leak
        {
            let conductance = gland.conductance_at(chamber.pressure_pa - air.pressure_pa);
            let lost = iso6358(conductance, LEAK_CRITICAL_RATIO, chamber, air.pressure_pa);
            balance.take(store, -lost, chamber.temperature_k);
        }
        if !built.is_stiff() {
            let resting = built.resting_volume(time_s, chamber.pressure_pa - air.pressure_pa);
            rates[VOLUME + c] = (resting - state[VOLUME + c]) / WALL_FOLLOWS_S;
            balance.energy[store] -= chamber.pressure_pa * rates[VOLUME + c];
        }
        balance.energy[store] -= built.wall_conductance_w_k * (chamber.temperature_k - built.wall_k);
    }

    #[inline]
    fn sensor_rates(&self, state: &State, c: usize, over_atmosphere_pa: f64, rates: &mut State) {
        let sensor = &self.plant.sensors[c];
        let snubber = [state[SNUBBER + 2 * c], state[SNUBBER + 2 * c + 1]];
        let line = [state[SENSING + 2 * c], state[SENSING + 2 * c + 1]];
        let driven = if sensor.lag_s == 0.0 { over_atmosphere_pa } else { snubber[1] };
        [rates[SNUBBER + 2 * c], rates[SNUBBER + 2 * c + 1]] = sensor.snubber_rates(over_atmosphere_pa, snubber);
        [rates[SENSING + 2 * c], rates[SENSING + 2 * c + 1]] = sensor.line_rates(driven, line);
    }
}

impl Switched<STATES, CHECK_VALVES> for Driven<'_> {
    fn rates(&self, time_s: f64, state: &State, rates: &mut State) {
        *rates = [0.0; STATES];
        let chambers: [Gas; 2] = std::array::from_fn(|c| self.plant.chamber_gas(state, c));
        let mut balance = Balance::default();
        self.pump_rates(time_s, state, chambers, &mut balance, rates);
        // What cylinders and chambers pass to each other is in the balances already; the ledger counts the rest.
        if self.plant.cross_leak != 0.0 {
            let from = chambers[POSITIVE];
            let flow = laminar_gap(self.plant.cross_leak, from.pressure_pa, chambers[NEGATIVE].pressure_pa);
            balance.pass(2, 3, flow, from.temperature_k);
        }
        for (c, &chamber) in chambers.iter().enumerate() {
            self.vent_rates(state, c, chamber, &mut balance, rates);
            self.chamber_rates(time_s, state, c, chamber, &mut balance, rates);
            self.sensor_rates(state, c, chamber.pressure_pa - self.plant.atmosphere.pressure_pa, rates);
        }
        for i in 0..2 {
            rates[CYLINDER + 2 * i] = balance.mass[i];
            rates[CYLINDER + 2 * i + 1] = balance.energy[i];
            rates[CHAMBER + 2 * i] = balance.mass[2 + i];
            rates[CHAMBER + 2 * i + 1] = balance.energy[2 + i];
        }
        rates[LEDGER] = balance.mass.iter().sum();
        rates[LEDGER + 1] = balance.energy.iter().sum();
    }

    fn guards(&self, _time_s: f64, state: &State) -> [f64; CHECK_VALVES] {
        let pump = &self.plant.pump;
        let (cylinders, _) = self.plant.cylinders(state);
        let positive_pa = self.plant.chamber_gas(state, POSITIVE).pressure_pa;
        let negative_pa = self.plant.chamber_gas(state, NEGATIVE).pressure_pa;
        let [first, second] = cylinders.map(|gas| gas.pressure_pa);
        [
            negative_pa - first - pump.inlet.cracking_pa,
            negative_pa - second - pump.inlet.cracking_pa,
            first - positive_pa - pump.outlet.cracking_pa,
            second - positive_pa - pump.outlet.cracking_pa,
        ]
    }

    fn switches(&self) -> [bool; CHECK_VALVES] {
        self.open
    }

    fn flip(&mut self, switch: usize) {
        self.open[switch] = !self.open[switch];
    }

    /// Dry friction lets a flapper go once the balance has moved far enough, and catches it when it has arrived.
    fn settle(&mut self, _time_s: f64, state: &State) -> bool {
        let mut jumped = false;
        for c in 0..2 {
            let vent = &self.plant.vents[c];
            let Some(friction) = vent.friction else { continue };
            let flow = self.vent(state, c, self.plant.chamber_gas(state, c));
            let missing_m = (self.resting_lift(state, c, &flow) - state[LIFT + c]).abs();
            let breakaway_m = friction.breakaway_n / vent.stiffness_n_m;
            let held =
                if self.held[c] { missing_m <= breakaway_m } else { missing_m < friction.residual * breakaway_m };
            jumped |= held != self.held[c];
            self.held[c] = held;
        }
        jumped
    }
}
