//! All that the monitor makes of a rig file: its models by hypothesis, and what venting looks like on it.
//!
//! | hypothesis | the rig is |
//! | --- | --- |
//! | 1 | what its file says |
//! | 2 | the same, with sensors that lag where the file names no lag |
//!
//! A reading is contradicted once no hypothesis explains it.

use model::mechanism::{Mechanism, SensorLag};
use model::observation::{CHANNELS, Pair};
use model::plant::Plant;
use model::predict::{DualPressurePorts, DualPressureRig};
use model::rig::{MechanismInstance, Rig, RigError};
use model::steady::SteadyMap;

use crate::coupling::Coupling;
use crate::hypothesis::HypothesisModels;
use crate::vent_check::VentModel;

/// Hypotheses of what the rig is.
pub const HYPOTHESES: usize = 2;
/// Lag that no file names: what hangs before a sensor on a thin hose, or its own filter (chosen: a quarter more than the slowest
/// that was asked for, 160 ms; what lies between no lag and this one contradicts neither hypothesis).
const UNNAMED_LAG_MS: f64 = 200.0;
/// Pressures at which a model is looked at, kPa gauge: what a rig usually holds.
pub(crate) const HELD_KPA: Pair = [85.0, -70.0];
/// Duties at these pressures: valves as usual.
pub(crate) const HELD_DUTY: Pair = [0.8; CHANNELS];
/// The most ticks that are looked at: 20 s, longer than any rig of use takes.
const MOST_TICKS: u32 = 1_000;

/// The models of a monitor, made outside of the tick and exchanged in it.
pub struct MonitorModels {
    pub(crate) hypotheses: [Option<HypothesisModels>; HYPOTHESES],
    pub(crate) coupling: Coupling,
    pub(crate) vent: VentModel,
}

impl MonitorModels {
    /// The models of a rig, at rest with open vents.
    ///
    /// # Errors
    /// If the rig cannot be flown: unsound, or without the valves and sensors the controller needs.
    ///
    /// # Real-time
    /// Allocates and simulates up to 20 s; not for the tick.
    pub fn new(rig: &Rig) -> Result<Self, RigError> {
        let lagging = lagging(rig).map(|rig| HypothesisModels::new(&rig)).transpose()?;
        let hypotheses = [Some(HypothesisModels::new(rig)?), lagging];
        Ok(MonitorModels { hypotheses, coupling: Coupling::of(rig)?, vent: vent(rig)? })
    }

    /// Runs along with a tick that has been: readings (kPa gauge), then the duties that were sent, and whether the pump ran.
    ///
    /// # Real-time
    /// Up to four ticks of the model.
    pub fn follow(&mut self, readings_kpa: Pair, duty: Pair, pump_on: bool) {
        for models in self.hypotheses.iter_mut().flatten() {
            models.take(readings_kpa);
            models.advance([duty; 2], pump_on);
        }
    }
}

/// The rig with a lag before each sensor that has none; `None` if all have.
fn lagging(rig: &Rig) -> Option<Rig> {
    let mut lagging = rig.clone();
    for (name, _) in rig.sensors.iter().filter(|(_, s)| DualPressurePorts::READING.contains(&s.column.as_str())) {
        let named = rig.mechanisms.iter().any(|m| {
            let late = matches!(m.mechanism, Mechanism::SensorLag(_) | Mechanism::ResidualResponse(_));
            late && m.enabled && m.component == *name
        });
        if !named {
            let lag = SensorLag { time_constant_ms: UNNAMED_LAG_MS, second_time_constant_ms: 0.0 };
            let mechanism = Mechanism::SensorLag(lag);
            lagging.mechanisms.push(MechanismInstance { component: name.clone(), enabled: true, mechanism });
        }
    }
    (lagging.mechanisms.len() > rig.mechanisms.len()).then_some(lagging)
}

/// Venting of the rig by its model: where it comes to rest, and how long its readings take for half of the way.
fn vent(rig: &Rig) -> Result<VentModel, RigError> {
    let relay = Plant::<f64>::new(rig)?.inputs().iter().any(|i| i.column == DualPressurePorts::PUMP_ON);
    // Without a relay the pump runs on, into open valves.
    let rest = if relay { None } else { SteadyMap::new(rig)?.settled_kpa([1.0; CHANNELS]) };
    let rest_kpa = rest.unwrap_or([0.0; CHANNELS]);
    let mut model = DualPressureRig::new(rig)?;
    model.start_from(HELD_KPA, HELD_DUTY);
    let mut half_ticks = [MOST_TICKS; CHANNELS];
    for tick in 1..=MOST_TICKS {
        model.tick([1.0; CHANNELS], !relay);
        let now = model.readings_kpa();
        for c in 0..CHANNELS {
            let left = |kpa: f64| kpa.abs() - rest_kpa[c].abs();
            if half_ticks[c] == MOST_TICKS && left(now[c]) <= 0.5 * left(HELD_KPA[c]) {
                half_ticks[c] = tick;
            }
        }
        if half_ticks.iter().all(|ticks| *ticks < MOST_TICKS) {
            break;
        }
    }
    Ok(VentModel { rest_kpa, half_ticks })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn venting_takes_the_longer_the_later_the_sensor_and_the_larger_the_chambers() {
        let nominal = Rig::builtin("dual_pressure").unwrap();
        let half = |rig: &Rig| vent(rig).unwrap().half_ticks;
        let quick = half(&nominal);
        let late = half(&lagging(&nominal).unwrap());
        let mut large = nominal.clone();
        large.volumes.values_mut().for_each(|v| v.volume_l *= 10.0);
        let slow = half(&large);
        println!("{quick:?} {late:?} {slow:?}");
        for c in 0..CHANNELS {
            assert!(quick[c] < late[c] && quick[c] < slow[c] && slow[c] < MOST_TICKS);
        }
        assert!(lagging(&lagging(&nominal).unwrap()).is_none(), "a lag that is named is believed");
    }
}
