//! From volts to pressures: the first thing that happens to a frame, and the first that can be wrong with it.

use model::observation::{CHANNELS, Pair};
use model::predict::DualPressurePorts;
use model::rig::{Rig, RigError, Sensor};
use proto::emulator::WIRE_V;

/// Below this a sensor or its wire is broken (V); the sensors' range is 1 … 5 V.
pub const LOWEST_V: f64 = WIRE_V[0];
/// Above this a sensor or its wire is broken (V).
pub const HIGHEST_V: f64 = WIRE_V[1];

/// A voltage that no sound sensor gives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BrokenSensor {
    /// 0 positive, 1 negative.
    pub channel: usize,
    /// Reading in V; NaN where nothing was.
    pub volts: f64,
}

/// The scales of the two sensors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensing {
    /// Gauge kPa at 0 V and gauge kPa per V.
    scales: [(f64, f64); CHANNELS],
}

impl Sensing {
    /// Takes the scales from a rig.
    ///
    /// # Errors
    /// If the rig lacks one of the two sensors.
    pub fn of(rig: &Rig) -> Result<Self, RigError> {
        let mut scales = [(0.0, 0.0); CHANNELS];
        for (scale, column) in scales.iter_mut().zip(DualPressurePorts::READING) {
            let sensor = rig.sensor_of(column).map(|(_, sensor)| sensor);
            *scale =
                sensor.map(scale_of).ok_or_else(|| RigError::at("sensors", format!("no sensor writes `{column}`")))?;
        }
        Ok(Sensing { scales })
    }

    /// Readings in kPa gauge from the first two voltages of a frame; of each channel by itself, an error where the voltage is
    /// outside [`LOWEST_V`] … [`HIGHEST_V`], NaN included.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn readings_kpa(&self, volts: &[f32; 4]) -> [Result<f64, BrokenSensor>; CHANNELS] {
        std::array::from_fn(|channel| {
            let volts = f64::from(volts[channel]);
            let (offset, slope) = self.scales[channel];
            if (LOWEST_V..=HIGHEST_V).contains(&volts) {
                Ok(offset + slope * volts)
            } else {
                Err(BrokenSensor { channel, volts })
            }
        })
    }

    /// Pressures in kPa gauge from the first two voltages of a frame.
    ///
    /// # Errors
    /// The first broken channel, as in [`Sensing::readings_kpa`].
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn pressures_kpa(&self, volts: &[f32; 4]) -> Result<Pair, BrokenSensor> {
        let [positive, negative] = self.readings_kpa(volts);
        Ok([positive?, negative?])
    }
}

fn scale_of(sensor: &Sensor) -> (f64, f64) {
    let ([p0, p1], [v0, v1]) = (sensor.range_kpa_gauge, sensor.range_v);
    let slope = (p1 - p0) / (v1 - v0);
    (p0 - slope * v0, slope)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_sheet_points() {
        let sensing = Sensing::of(&Rig::builtin("dual_pressure").unwrap()).unwrap();
        let near = |a: Pair, b: Pair| assert!((a[0] - b[0]).abs() < 1e-9 && (a[1] - b[1]).abs() < 1e-9, "{a:?} {b:?}");
        near(sensing.pressures_kpa(&[1.0, 1.0, f32::NAN, f32::NAN]).unwrap(), [0.0, 0.0]);
        near(sensing.pressures_kpa(&[5.0, 5.0, 0.0, 0.0]).unwrap(), [1000.0, -101.0]);
        near(sensing.pressures_kpa(&[1.5, 4.0, 0.0, 0.0]).unwrap(), [125.0, -75.75]);
    }

    #[test]
    fn broken_wires_are_named() {
        let sensing = Sensing::of(&Rig::builtin("dual_pressure").unwrap()).unwrap();
        for (volts, channel) in
            [([0.79, 2.0], 0), ([5.21, 2.0], 0), ([f32::NAN, 2.0], 0), ([2.0, 0.0], 1), ([2.0, f32::INFINITY], 1)]
        {
            let broken = sensing.pressures_kpa(&[volts[0], volts[1], 0.0, 0.0]).unwrap_err();
            assert_eq!(broken.channel, channel);
        }
    }
}
