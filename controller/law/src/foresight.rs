//! Feed-forward: the duties at which the model follows the reference, as much ahead as each valve is late.
//!
//! A duty is held for a tick and acts late by what the rig file states of its valve ([`ValvePath`]): delay and lags. Its
//! middle then meets the reference where
//!
//! ```text
//! lead = ½ + (delay + lags)/T      ticks ahead
//! ```
//!
//! A lag of a sensor is none of the valve's: the chamber is to be on the reference, however late its reading shows it.
//! Where the file says nothing of a valve, [`UNKNOWN_LEAD_TICKS`] hold.

use std::sync::Arc;

use model::observation::{GOALS_AHEAD, Pair};
use model::steady::SteadyMap;
use model::valve_path::ValvePath;

use crate::{ControlInput, TICK_S};

/// Ticks that the feed-forward looks ahead where nothing is known of a valve: what a valve in time needs. Longer leads were
/// measured on `dual_pressure`, `bench` and rigs with delay, lag, play or warm gas, and are worse on all of them as long as
/// play is learned.
pub const UNKNOWN_LEAD_TICKS: f64 = 0.5;
/// Ticks by which a valve of which nothing is known is taken to be late where feedback is designed, to be on the safe side.
pub const UNKNOWN_LATE_TICKS: f64 = 1.5;
/// Ticks ahead for holding a duty over a tick.
const OWN_LEAD_TICKS: f64 = 0.5;
/// Ticks ahead at which play is crossed; a step that is blended over two ticks begins half a tick before its middle.
const CROSSING_LEAD_TICKS: f64 = 1.5;
/// The least and the most that it looks ahead; a slope needs half a tick to both sides.
const LEADS_TICKS: [f64; 2] = [0.5, GOALS_AHEAD as f64 - 0.5];

/// Tells whether a rig file says anything of a valve's path. What it does not state beside that is then taken to be nothing: the valve
/// has been looked at.
pub fn is_told(path: &ValvePath) -> bool {
    path.is_timed || path.half_width_duty > 0.0
}

/// Time after which gas is as warm as it becomes, in s (chosen: many times what a chamber of a litre takes).
const SETTLED_S: f64 = 60.0;

/// Knowledge of the gas.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Gas {
    /// The gas's temperature, tick by tick.
    Followed,
    /// The chambers are taken to have long been where they are wanted.
    LongSettled,
}

/// Feed-forward of both channels.
#[derive(Debug, Clone)]
pub struct Foresight {
    map: Arc<SteadyMap>,
    /// Ticks that each valve is asked ahead.
    leads: Pair,
    /// Lead without the coil's lag, which is undone where play is crossed.
    play_leads: Pair,
    /// Temperatures of the gas in both chambers in K, where the map's leads look.
    gas_k: Pair,
    gas: Gas,
}

impl Foresight {
    /// For the rig that `map` was made of.
    pub fn new(map: Arc<SteadyMap>) -> Self {
        let lead = |late_s: f64| (OWN_LEAD_TICKS + late_s / TICK_S).clamp(LEADS_TICKS[0], LEADS_TICKS[1]);
        let of = |known: &dyn Fn(&ValvePath) -> f64| {
            map.valve_paths().each_ref().map(|path| if is_told(path) { known(path) } else { UNKNOWN_LEAD_TICKS })
        };
        let leads = of(&|path| lead(path.late_s()));
        let play_leads = of(&|path| {
            let ticks = CROSSING_LEAD_TICKS + (path.delay_s + path.armature_lag_s) / TICK_S;
            ticks.clamp(LEADS_TICKS[0], LEADS_TICKS[1])
        });
        let gas_k = map.wall_k();
        Foresight { map, leads, play_leads, gas_k, gas: Gas::Followed }
    }

    /// The feed-forward of a model that is put in while the rig is controlled: how warm its gas is by now nobody has followed.
    pub fn in_flight(map: Arc<SteadyMap>) -> Self {
        Foresight { gas: Gas::LongSettled, ..Foresight::new(map) }
    }

    /// To be called before a tick's duties: gas that nobody has followed is taken to be as warm as it becomes where the
    /// chambers are held.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn begin(&mut self, situation: &ControlInput) {
        if std::mem::replace(&mut self.gas, Gas::Followed) == Gas::LongSettled {
            let (pressures, _) = self.wanted(situation, self.leads[0]);
            self.gas_k = self.map.warmed_k(pressures, [0.0; 2], self.gas_k, SETTLED_S);
        }
    }

    /// Begins anew: gas at the temperature of its walls.
    pub fn restart(&mut self) {
        self.gas_k = self.map.wall_k();
        self.gas = Gas::Followed;
    }

    /// Duties for `ahead` ticks from now, and duties whose turns are those at which play is to be crossed; neither is
    /// limited to 0 … 1.
    ///
    /// # Real-time
    /// Four look-ups of the steady map at most; may run in the tick.
    pub fn duties(&self, situation: &ControlInput, ahead: usize) -> (Pair, Pair) {
        let duty = self.at(situation, self.leads, ahead);
        let turning = if self.play_leads == self.leads { duty } else { self.at(situation, self.play_leads, ahead) };
        (duty, turning)
    }

    /// Moves the gas's temperatures on through the tick.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn advance(&mut self, situation: &ControlInput) {
        let (pressures, rates) = self.wanted(situation, self.leads[0]);
        self.gas_k = self.map.warmed_k(pressures, rates, self.gas_k, TICK_S);
    }

    fn at(&self, situation: &ControlInput, leads: Pair, ahead: usize) -> Pair {
        let one = |lead: f64| {
            let (pressures, rates) = self.wanted(situation, (lead + ahead as f64).min(LEADS_TICKS[1]));
            self.map.warm_duty_for(pressures, rates, self.gas_k)
        };
        let duties = one(leads[0]);
        if leads[0] == leads[1] { duties } else { [duties[0], one(leads[1])[1]] }
    }

    /// Pressures (kPa gauge) and rates (kPa/s) of the chambers that the reference asks for so many ticks from now.
    fn wanted(&self, situation: &ControlInput, ticks: f64) -> (Pair, Pair) {
        let goal = |ticks: f64| -> Pair {
            let below = (ticks.max(0.0) as usize).min(GOALS_AHEAD - 1);
            let share = (ticks - below as f64).clamp(0.0, 1.0);
            let (one, other) = (situation.goals_kpa[below], situation.goals_kpa[below + 1]);
            std::array::from_fn(|c| one[c] + share * (other[c] - one[c]))
        };
        // The widest symmetric stretch up to two ticks: goals of a file are straight between its rows.
        let half = ticks.min(GOALS_AHEAD as f64 - ticks).clamp(0.5, 1.0);
        let (before, after) = (goal(ticks - half), goal(ticks + half));
        let rates = std::array::from_fn(|c| (after[c] - before[c]) / (2.0 * half * TICK_S));
        (self.map.chamber_kpa(goal(ticks)), self.map.chamber_rates_kpa_per_s(rates))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::observation::CHANNELS;
    use model::rig::Rig;

    fn foresight(edit: impl Fn(&mut Rig)) -> Foresight {
        let mut rig = Rig::builtin("bench").unwrap();
        edit(&mut rig);
        Foresight::new(Arc::new(SteadyMap::new(&rig).unwrap()))
    }

    /// A ramp: what is asked of a valve that is late is what one in time is asked for later.
    #[test]
    fn a_late_valve_is_asked_earlier() {
        let goals_kpa = std::array::from_fn(|j| [80.0 + 0.2 * j as f64, -70.0 - 0.1 * j as f64]);
        let now = ControlInput::of_measured([80.0, -70.0], goals_kpa);
        let in_time = foresight(|rig| rig.mechanisms.clear());
        // 20 ms of delay and 50 of lag: three and a half ticks.
        let late = foresight(|rig| rig.mechanisms.retain(|m| m.mechanism.id() != "chamber_thermal"));
        assert_eq!((in_time.leads, late.leads), ([UNKNOWN_LEAD_TICKS; 2], [4.0; 2]));
        let asked = late.duties(&now, 0).0;
        let [before, after] = [3, 4].map(|ahead| in_time.duties(&now, ahead).0);
        for c in 0..CHANNELS {
            assert!((asked[c] - 0.5 * (before[c] + after[c])).abs() < 1e-5, "{asked:?} {before:?} {after:?}");
        }
    }

    #[test]
    fn a_sensors_lag_leads_nothing() {
        let lag = "[[mechanisms]]\nid = \"sensor_lag\"\ncomponent = \"sensor_pos\"\ntime_constant_ms = 160.0\n";
        let rig = Rig::from_toml(&format!("{}\n{lag}", model::rig::DUAL_PRESSURE)).unwrap();
        let lagging = Foresight::new(Arc::new(SteadyMap::new(&rig).unwrap()));
        assert_eq!(lagging.leads, [UNKNOWN_LEAD_TICKS; 2]);
    }
}
