//! The rig averaged over a revolution: what the pump moves at given pressures, and which duties hold them.
//!
//! With both chambers held at fixed pressures and the valves shut, the cylinders soon repeat themselves and
//! each chamber gains a constant mass per time, `ṁ(P_pos, P_neg)`. That map (from the averaged plant, see
//! [`crate::averaged`], whose pump is at rest with its ports) turns the dynamics into algebra:
//!
//! ```text
//! V/(R T) · Ṗ = ṁ(P) ∓ ṁ_valve(P, u)
//! ```
//!
//! Gas that is in the cylinders follows the pressures a little late. While a pressure moves the pump therefore moves less, in
//! proportion to the rate: the cylinders are a part of the chambers that they are open to,
//!
//! ```text
//! ṁ = ṁ̄(P) − E(P) Ṗ
//! ```
//!
//! a third of the negative chamber's own capacity on the paper's rig. The balance is solved for `u` (feed-forward: [`SteadyMap::duty_for`]) or, with `Ṗ = 0`, for `P`
//! ([`SteadyMap::settled_kpa`]).
//!
//! In it are mechanisms that change the flows of a rig that has settled: of the pump, leaks, another critical ratio,
//! curved forces, a full opening and whatever is in series with a valve; a supply that sags; and another volume or a
//! compliant one. Gas that
//! warms is in [`SteadyMap::warm_duty_for`], whose temperatures the caller moves along. Left out is what else the past
//! decides (stiction; heat of a coil; muscles), and tabled flows that are over a valve's duty. Play, lag and delay of the valves are beside it ([`SteadyMap::valve_paths`]). Pressures are the chambers';
//! [`SteadyMap::chamber_kpa`] undoes what a sensor's gain and bias make of them. Pressures that valves hold, gas warmed, also
//! where the wanted ones are out of their reach, are in `resting` ([`SteadyMap::nearest_held_kpa`]).

use nalgebra::{Matrix2, Vector2};

use crate::mechanism::Mechanism;
use crate::observation::{CHANNELS, Pair};
use crate::plant::{Plant, ValveModel};
use crate::predict::DualPressurePorts;
use crate::rig::{ATMOSPHERE, Rig, RigError, Valve};
use crate::valve_path::ValvePath;

mod pump_map;
mod resting;
mod supply;
mod warm_gas;

use pump_map::{PumpMap, within_map};
use supply::Supply;
use warm_gas::{Wanted, WarmChamber};

/// Net mass flow into both chambers by pressures, and the valves' inverse.
#[derive(Debug, Clone)]
pub struct SteadyMap {
    pump: PumpMap,
    valves: [ValveInverse; CHANNELS],
    chambers: [Capacity; CHANNELS],
    atmosphere_pa: f64,
    warm: [Option<WarmChamber>; CHANNELS],
    paths: [ValvePath; CHANNELS],
    supply: Supply,
    /// Gain (a bare number) and bias (kPa) of each sensor.
    sensors: [(f64, f64); CHANNELS],
}

/// Gas that a chamber takes up per pressure, V/(R T) of one that may be compliant.
#[derive(Debug, Clone, Copy)]
struct Capacity {
    /// In kg/Pa, extrapolated to no pressure.
    at_vacuum: f64,
    /// Growth in kg/Pa².
    growth: f64,
}

impl Capacity {
    fn of(rig: &Rig, name: &str) -> Self {
        let Some(volume) = rig.volumes.get(name) else { return Capacity { at_vacuum: f64::NAN, growth: 0.0 } };
        let (mut litres, mut compliance) = (volume.volume_l, volume.compliance_ml_per_kpa);
        for mechanism in rig.mechanisms.iter().filter(|m| m.enabled && m.component == name).map(|m| &m.mechanism) {
            match mechanism {
                Mechanism::VolumeChange(m) if !m.is_later() => litres += m.extra_volume_l,
                Mechanism::VolumeCompliance(m) => compliance += m.compliance_ml_per_kpa,
                _ => {}
            }
        }
        let rt = rig.gas.gas_constant_j_per_kg_k * volume.temperature_k;
        let growth = compliance * 1e-9 / rt;
        // P V grows by V + P V' per pressure, with V = V₀ + V' (P − P_atm).
        let at_vacuum = litres * 1e-3 / rt - growth * rig.atmosphere.pressure_kpa_abs * 1e3;
        Capacity { at_vacuum, growth: 2.0 * growth }
    }

    fn at(&self, pressure_pa: f64) -> f64 {
        self.growth.mul_add(pressure_pa, self.at_vacuum)
    }
}

/// A valve between a chamber and the atmosphere, solved for its duty.
#[derive(Debug, Clone, Copy)]
struct ValveInverse {
    model: ValveModel,
    /// +1 if it fills its chamber, −1 if it empties it.
    fills: f64,
}

impl ValveInverse {
    fn ports(&self, chamber_pa: f64, atmosphere_pa: f64) -> (f64, f64) {
        if self.fills > 0.0 { (atmosphere_pa, chamber_pa) } else { (chamber_pa, atmosphere_pa) }
    }

    /// Net mass flow into the chamber in kg/s.
    fn inflow(&self, duty: f64, chamber_pa: f64, atmosphere_pa: f64) -> f64 {
        let (up, down) = self.ports(chamber_pa, atmosphere_pa);
        self.fills * self.model.flow(duty, up, down)
    }

    /// The duty that lets `inflow` kg/s into the chamber, beyond 0 … 1 where no duty does.
    fn duty(&self, inflow: f64, chamber_pa: f64, atmosphere_pa: f64) -> f64 {
        let (up, down) = self.ports(chamber_pa, atmosphere_pa);
        self.model.duty(self.fills * inflow, up, down)
    }
}

impl SteadyMap {
    /// Maps a rig; a tenth of a second.
    ///
    /// # Errors
    /// If the rig is unsound, or is not two chambers each with one valve to the atmosphere.
    pub fn new(rig: &Rig) -> Result<Self, RigError> {
        let plant = Plant::new(rig)?;
        DualPressurePorts::of(&plant)?;
        let mut valves = Vec::new();
        let mut capacities = Vec::new();
        let mut chambers = [0; CHANNELS];
        let mut warm = [None; CHANNELS];
        let mut paths = [ValvePath::default(); CHANNELS];
        for (c, column) in DualPressurePorts::DUTY.into_iter().enumerate() {
            let (index, name, valve) = rig
                .valves
                .iter()
                .enumerate()
                .find_map(|(i, (name, v))| (v.command == column).then_some((i, name, v)))
                .ok_or_else(|| RigError::at("valves", column))?;
            let (place, fills) = chamber_of(name, valve)?;
            chambers[c] = rig
                .volumes
                .get_index_of(place)
                .ok_or_else(|| RigError::at(format!("valves.{name}"), format!("`{place}` is no volume")))?;
            let model = plant.valve_model(index).ok_or_else(|| RigError::at("valves", column))?;
            capacities.push(Capacity::of(rig, place));
            warm[c] = WarmChamber::of(rig, place);
            paths[c] = ValvePath::of(rig, name);
            valves.push(ValveInverse { model, fills });
        }
        let ([Some(positive), Some(negative)], [Some(one), Some(other)]) = (
            [valves.first().copied(), valves.get(1).copied()],
            [capacities.first().copied(), capacities.get(1).copied()],
        ) else {
            return Err(RigError::at("valves", "two valves are needed"));
        };
        Ok(SteadyMap {
            pump: PumpMap::of(rig, chambers)?,
            valves: [positive, negative],
            chambers: [one, other],
            atmosphere_pa: rig.atmosphere.pressure_kpa_abs * 1e3,
            warm,
            paths,
            supply: Supply::of(rig),
            sensors: DualPressurePorts::READING.map(|column| calibration(rig, column)),
        })
    }

    /// Delay, lags and play of both valves, as the rig file states them.
    pub fn valve_paths(&self) -> &[ValvePath; CHANNELS] {
        &self.paths
    }

    /// The chambers' pressures at readings that neither lag nor swing, both in kPa gauge.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn chamber_kpa(&self, readings_kpa: Pair) -> Pair {
        std::array::from_fn(|c| (readings_kpa[c] - self.sensors[c].1) / self.sensors[c].0)
    }

    /// The readings at pressures of the chambers that stand, both in kPa gauge.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn readings_kpa(&self, chamber_kpa: Pair) -> Pair {
        std::array::from_fn(|c| chamber_kpa[c].mul_add(self.sensors[c].0, self.sensors[c].1))
    }

    /// The rates of the chambers' pressures at rates of the readings, both in kPa/s.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn chamber_rates_kpa_per_s(&self, rates_kpa_per_s: Pair) -> Pair {
        std::array::from_fn(|c| rates_kpa_per_s[c] / self.sensors[c].0)
    }

    /// Temperatures in K that the gas in both chambers starts from: those of the walls.
    pub fn wall_k(&self) -> Pair {
        self.warm.map(|warm| warm.map_or(f64::NAN, |warm| warm.wall_k()))
    }

    /// As [`SteadyMap::duty_for`], with gas at the given temperatures in K, which count where the rig's chamber
    /// has an energy balance.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn warm_duty_for(&self, pressures_kpa: Pair, rates_kpa_per_s: Pair, gas_k: Pair) -> Pair {
        if self.warm.iter().all(Option::is_none) {
            return self.duty_for(pressures_kpa, rates_kpa_per_s);
        }
        let cold = self.acting_duty_for(pressures_kpa, rates_kpa_per_s);
        let flows = self.moving_flows(pressures_kpa, rates_kpa_per_s);
        self.supply.sent(std::array::from_fn(|c| {
            let Some(warm) = &self.warm[c] else { return cold[c] };
            let wanted = self.wanted(c, pressures_kpa, rates_kpa_per_s, flows);
            let inflow = warm.valve_inflow(&self.chambers[c], &wanted, gas_k[c]);
            let inflow = if inflow < 0.0 { inflow / warm.thinning(gas_k[c]) } else { inflow };
            self.valves[c].duty(inflow, wanted.pressure_pa, self.atmosphere_pa)
        }))
    }

    /// Rate of both pressures in kPa/s at pressures (kPa gauge), duties and gas temperatures in K, which count where the
    /// rig's chamber has an energy balance.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn warm_rate_kpa_per_s(&self, pressures_kpa: Pair, duty: Pair, gas_k: Pair) -> Pair {
        self.rates(pressures_kpa, duty, Some(gas_k))
    }

    /// Rates in kPa/s; without temperatures all gas has that of its walls.
    fn rates(&self, pressures_kpa: Pair, duty: Pair, gas_k: Option<Pair>) -> Pair {
        let (flows, duty) = (self.flows(pressures_kpa), self.supply.acting(duty));
        let (mut still, mut per_flow) = ([0.0; CHANNELS], [0.0; CHANNELS]);
        for c in 0..CHANNELS {
            let chamber = self.atmosphere_pa + pressures_kpa[c] * 1e3;
            let inflow = self.valves[c].inflow(duty[c], chamber, self.atmosphere_pa);
            if let (Some(warm), Some(gas_k)) = (&self.warm[c], gas_k) {
                let inflow = if inflow < 0.0 { inflow * warm.thinning(gas_k[c]) } else { inflow };
                let rate = |pump| 1e-3 * warm.rate_pa_per_s(&self.chambers[c], chamber, [pump, inflow], gas_k[c]);
                still[c] = rate(flows[c]);
                // Straight lines: what is pumped in has one temperature, what is drawn another.
                per_flow[c] = (rate(2.0 * flows[c]) - still[c]) / flows[c];
            } else {
                per_flow[c] = 1e-3 / self.chambers[c].at(chamber);
                still[c] = (flows[c] + inflow) * per_flow[c];
            }
            if !per_flow[c].is_finite() {
                per_flow[c] = 0.0;
            }
        }
        self.with_cylinders(pressures_kpa, still, per_flow)
    }

    /// Temperatures in K of the gas `duration_s` later, while pressures change as given.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn warmed_k(&self, pressures_kpa: Pair, rates_kpa_per_s: Pair, gas_k: Pair, duration_s: f64) -> Pair {
        if self.warm.iter().all(Option::is_none) {
            return gas_k;
        }
        let flows = self.moving_flows(pressures_kpa, rates_kpa_per_s);
        std::array::from_fn(|c| {
            let Some(warm) = &self.warm[c] else { return gas_k[c] };
            let wanted = self.wanted(c, pressures_kpa, rates_kpa_per_s, flows);
            warm.warmed(&self.chambers[c], &wanted, gas_k[c], duration_s)
        })
    }

    fn wanted(&self, c: usize, pressures_kpa: Pair, rates_kpa_per_s: Pair, flows: Pair) -> Wanted {
        Wanted {
            pressure_pa: self.atmosphere_pa + pressures_kpa[c] * 1e3,
            rate_pa_per_s: rates_kpa_per_s[c] * 1e3,
            pump_kg_per_s: flows[c],
        }
    }

    /// Net mass flow into both chambers with the valves shut, in kg/s, by bilinear interpolation.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn flows(&self, pressures_kpa: Pair) -> Pair {
        self.pump.flows(pressures_kpa)
    }

    /// Net mass flow into both chambers with the valves shut while pressures move at rates in kPa/s.
    fn moving_flows(&self, pressures_kpa: Pair, rates_kpa_per_s: Pair) -> Pair {
        let (flows, followed) = (self.flows(pressures_kpa), self.pump.followed(pressures_kpa));
        std::array::from_fn(|c| {
            flows[c] - 1e3 * (followed[c][0] * rates_kpa_per_s[0] + followed[c][1] * rates_kpa_per_s[1])
        })
    }

    /// Rates in kPa/s of pressures whose rates would be `still` if the pump moved what it moves at standing pressures, and
    /// grow by `per_flow` per kg/s more.
    fn with_cylinders(&self, pressures_kpa: Pair, still: Pair, per_flow: Pair) -> Pair {
        let e = self.pump.followed(pressures_kpa);
        let m: [Pair; CHANNELS] =
            std::array::from_fn(|c| std::array::from_fn(|j| f64::from(u8::from(c == j)) + 1e3 * per_flow[c] * e[c][j]));
        let determinant = m[0][0] * m[1][1] - m[0][1] * m[1][0];
        [
            (m[1][1] * still[0] - m[0][1] * still[1]) / determinant,
            (m[0][0] * still[1] - m[1][0] * still[0]) / determinant,
        ]
    }

    /// Rate of both pressures in kPa/s at pressures (kPa gauge) and duties.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn rate_kpa_per_s(&self, pressures_kpa: Pair, duty: Pair) -> Pair {
        self.rates(pressures_kpa, duty, None)
    }

    /// The duties at which pressures (kPa gauge) change at the given rates (kPa/s), not limited to 0 … 1.
    ///
    /// Both channels are solved together, so the coupling through the pump is in it.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn duty_for(&self, pressures_kpa: Pair, rates_kpa_per_s: Pair) -> Pair {
        self.supply.sent(self.acting_duty_for(pressures_kpa, rates_kpa_per_s))
    }

    /// The duties that must act at the valves for these rates, whatever the supply makes of those that are sent.
    fn acting_duty_for(&self, pressures_kpa: Pair, rates_kpa_per_s: Pair) -> Pair {
        let flows = self.moving_flows(pressures_kpa, rates_kpa_per_s);
        std::array::from_fn(|c| {
            let chamber = self.atmosphere_pa + pressures_kpa[c] * 1e3;
            let wanted = self.chambers[c].at(chamber) * rates_kpa_per_s[c] * 1e3 - flows[c];
            self.valves[c].duty(wanted, chamber, self.atmosphere_pa)
        })
    }

    /// By how much each pressure's rate changes with the duty that acts at its own valve, in kPa/s per duty; negative for
    /// the positive channel (opening vents it), positive for the negative one.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn gain_kpa_per_s(&self, pressures_kpa: Pair) -> Pair {
        let followed = self.pump.followed(pressures_kpa);
        std::array::from_fn(|c| {
            let valve = &self.valves[c];
            let chamber = self.atmosphere_pa + pressures_kpa[c] * 1e3;
            let (up, down) = valve.ports(chamber, self.atmosphere_pa);
            let capacity = self.chambers[c].at(chamber) + followed[c][c];
            valve.fills * valve.model.flow_per_duty(up, down) / capacity * 1e-3
        })
    }

    /// Change of each pressure's rate with the duty that is sent to its own valve, in kPa/s per duty, around duties that are sent:
    /// [`SteadyMap::gain_kpa_per_s`], less under a supply that sags.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn sent_gain_kpa_per_s(&self, pressures_kpa: Pair, sent: Pair) -> Pair {
        let (gain, slope) = (self.gain_kpa_per_s(pressures_kpa), self.supply.acting_per_sent(sent));
        std::array::from_fn(|c| gain[c] * slope[c])
    }

    /// The pressures (kPa gauge) at which the rig settles under constant duties, by Newton's method;
    /// `None` if there are none within the map.
    pub fn settled_kpa(&self, duty: Pair) -> Option<Pair> {
        let mut p = Vector2::new(80.0, -70.0);
        for _ in 0..60 {
            let rate = |p: Vector2<f64>| Vector2::from(self.rate_kpa_per_s(p.into(), duty));
            let here = rate(p);
            let by = 0.01;
            let column = |d: Vector2<f64>| (rate(p + d) - rate(p - d)) / (2.0 * by);
            let jacobian = Matrix2::from_columns(&[column(Vector2::new(by, 0.0)), column(Vector2::new(0.0, by))]);
            let step = jacobian.lu().solve(&here)?;
            // Short steps: far from the solution the map is far from linear.
            let limited = step * (20.0 / step.norm().max(20.0));
            p = within_map((p - limited).into()).into();
            if limited.norm() < 1e-9 {
                return (here.norm() < 1e-3).then(|| p.into());
            }
        }
        None
    }
}

/// Gain (a bare number) and bias (kPa) of the sensor that a column holds.
fn calibration(rig: &Rig, column: &str) -> (f64, f64) {
    let mut calibration = (1.0, 0.0);
    let Some((name, _)) = rig.sensor_of(column) else { return calibration };
    for mechanism in rig.mechanisms.iter().filter(|m| m.enabled && m.component == *name).map(|m| &m.mechanism) {
        match mechanism {
            Mechanism::SensorGain(m) => calibration.0 = m.gain,
            Mechanism::SensorBias(m) => calibration.1 = m.bias_kpa,
            _ => {}
        }
    }
    calibration
}

/// The chamber that a valve joins to the atmosphere, and +1 if the valve fills it, −1 if it empties it.
fn chamber_of<'v>(name: &str, valve: &'v Valve) -> Result<(&'v str, f64), RigError> {
    match (valve.from.as_str(), valve.to.as_str()) {
        (ATMOSPHERE, to) => Ok((to, 1.0)),
        (from, ATMOSPHERE) => Ok((from, -1.0)),
        _ => Err(RigError::at(format!("valves.{name}"), "neither end is the atmosphere; no steady map can be made")),
    }
}

#[cfg(test)]
mod tests;
