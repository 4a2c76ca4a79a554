//! Rigs that a nominal model does not know: sensors that lag, chambers of another size, every part another one.

use model::mechanism::{Mechanism, SensorLag};
use model::rig::{MechanismInstance, Pump, Rig};

use crate::dice::Dice;

/// The rig with a lag before both sensors.
pub fn with_sensor_lag(rig: &Rig, time_constant_ms: f64) -> Rig {
    let mut rig = rig.clone();
    for name in ["sensor_pos", "sensor_neg"] {
        let lag = SensorLag { time_constant_ms, second_time_constant_ms: 0.0 };
        let mechanism = Mechanism::SensorLag(lag);
        rig.mechanisms.push(MechanismInstance { component: name.to_owned(), enabled: true, mechanism });
    }
    rig.name = format!("{}, sensors lag {time_constant_ms} ms", rig.name);
    rig
}

/// The rig with chambers so many times as large.
pub fn with_volumes(rig: &Rig, times: f64) -> Rig {
    let mut rig = rig.clone();
    rig.volumes.values_mut().for_each(|v| v.volume_l *= times);
    rig.name = format!("{}, {times} times the volume", rig.name);
    rig
}

/// Scatter of a valve's three coefficients among themselves: what is left of its opening is a small difference of large
/// ones, so more than this makes a valve of another kind.
const VALVE_SHAPE: f64 = 0.03;

/// The rig with every part drawn anew within ± `spread` of its own: volumes, what valves let through, heads and check valves
/// of the pump.
pub fn with_other_parts(rig: &Rig, spread: f64, dice: &mut Dice) -> Rig {
    let mut rig = rig.clone();
    let mut drawn = |spread: f64| 1.0 + spread * (2.0 * dice.share() - 1.0);
    rig.volumes.values_mut().for_each(|volume| volume.volume_l *= drawn(spread));
    for valve in rig.valves.values_mut() {
        let area = drawn(spread);
        for coefficient in [&mut valve.input_area_mm2, &mut valve.pressure_area_mm2_per_n, &mut valve.spring_area_mm2] {
            *coefficient *= area * drawn(VALVE_SHAPE);
        }
    }
    for pump in rig.pumps.values_mut() {
        if let Pump::Piston(pump) = pump {
            pump.head_area_cm2 *= drawn(spread);
            pump.inlet_check_area_mm2 *= drawn(spread);
            pump.outlet_check_area_mm2 *= drawn(spread);
        }
    }
    rig.name = format!("{}, parts up to {:.0} % off", rig.name, 100.0 * spread);
    rig
}
