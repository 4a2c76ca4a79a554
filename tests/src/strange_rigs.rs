//! Rigs that a nominal model does not know: sensors that lag, chambers of another size.

use model::mechanism::{Mechanism, SensorLag};
use model::rig::{MechanismInstance, Rig};

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
