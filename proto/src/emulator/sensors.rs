//! Pressures as the volts a cRIO reads: sensor, wire, and the 16-bit converter of an NI 9205.
//!
//! A sensor gives 1 V at the start and 5 V at the end of its range and is taken as linear beyond it.
//! The converter adds Gaussian noise of 0.24 mV RMS, rounds to steps of 20 V / 65536 = 0.305 mV and
//! clips to its range of −10 V to just under +10 V. Left out: the sensor's own error and lag, which
//! are physics of the rig behind.

use crate::split_mix::SplitMix64;

/// Smallest step of the converter, V.
const STEP_V: f64 = 20.0 / 65536.0;
/// Below this a sensor or its wire is broken, V.
pub(super) const BROKEN_BELOW_V: f32 = 0.8;
/// Above this a sensor or its wire is broken, V.
pub(super) const BROKEN_ABOVE_V: f32 = 5.2;

/// A linear sensor of 1 to 5 V, by the gauge pressures at its ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorScale {
    /// Gauge pressure at 1 V, kPa.
    pub at_1v_kpa: f64,
    /// Gauge pressure at 5 V, kPa.
    pub at_5v_kpa: f64,
}

/// The positive sensor, PSE540A-R06: 1 to 5 V for 0 to 1 MPa gauge.
pub const PSE540A_R06: SensorScale = SensorScale { at_1v_kpa: 0.0, at_5v_kpa: 1000.0 };
/// The negative sensor, PSE541A-R06: 1 to 5 V for 0 to −101 kPa gauge.
pub const PSE541A_R06: SensorScale = SensorScale { at_1v_kpa: 0.0, at_5v_kpa: -101.0 };

impl SensorScale {
    /// Volts at a gauge pressure in kPa.
    #[must_use]
    pub fn volts(&self, gauge_kpa: f64) -> f64 {
        1.0 + 4.0 * (gauge_kpa - self.at_1v_kpa) / (self.at_5v_kpa - self.at_1v_kpa)
    }

    /// Gauge pressure in kPa at these volts.
    #[must_use]
    pub fn gauge_kpa(&self, volts: f64) -> f64 {
        self.at_1v_kpa + (volts - 1.0) / 4.0 * (self.at_5v_kpa - self.at_1v_kpa)
    }
}

/// A fault of one sensor, for as long as it is given to [`Sensors::sample`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SensorFault {
    /// A broken wire: 0 V at the converter.
    BrokenWire,
    /// The reading stays what it was in the tick before.
    Stuck,
    /// The reading is NaN.
    NotANumber,
    /// The sensor shows this gauge pressure, kPa.
    Reading(f64),
    /// The sensor shows this much too much, kPa.
    Offset(f64),
}

/// Two sensors at a converter.
#[derive(Debug, Clone)]
pub struct Sensors {
    scales: [SensorScale; 2],
    noise_v_rms: f64,
    noise: SplitMix64,
    last: [f32; 2],
}

impl Sensors {
    /// Noise of the converter in V RMS, as measured on an NI 9205 in its ±10 V range.
    pub const ADC_NOISE_V_RMS: f64 = 0.24e-3;

    /// Sensors of these scales at a converter with this noise (0: none, negative as 0).
    #[must_use]
    pub fn new(scales: [SensorScale; 2], noise_v_rms: f64, seed: u64) -> Self {
        let ambient = [scales[0].volts(0.0) as f32, scales[1].volts(0.0) as f32];
        Self { scales, noise_v_rms: noise_v_rms.max(0.0), noise: SplitMix64::new(seed), last: ambient }
    }

    /// The scales, positive and negative.
    #[must_use]
    pub fn scales(&self) -> [SensorScale; 2] {
        self.scales
    }

    /// The volts of one tick: positive and negative sensor, two absent ones as NaN.
    ///
    /// `faults` holds, for each of the two sensors, what is wrong with it now.
    pub fn sample(&mut self, gauge_kpa: [f64; 2], faults: [&[SensorFault]; 2]) -> [f32; 4] {
        // Both throws every tick, fault or not, so that a fault of one leaves the other's noise alone.
        let noise_v = [self.throw_v(), self.throw_v()];
        for (((last, scale), (pressure, noise)), faults) in
            self.last.iter_mut().zip(self.scales).zip(gauge_kpa.into_iter().zip(noise_v)).zip(faults)
        {
            let mut shown_kpa = pressure;
            for fault in faults {
                match fault {
                    SensorFault::Reading(kpa) => shown_kpa = *kpa,
                    SensorFault::Offset(kpa) => shown_kpa += kpa,
                    SensorFault::BrokenWire | SensorFault::Stuck | SensorFault::NotANumber => {}
                }
            }
            let wired = if faults.contains(&SensorFault::BrokenWire) { 0.0 } else { scale.volts(shown_kpa) };
            if !faults.contains(&SensorFault::Stuck) {
                *last = convert(wired + noise);
            }
        }
        let mut volts = [self.last[0], self.last[1], f32::NAN, f32::NAN];
        for (shown, faults) in volts.iter_mut().zip(faults) {
            if faults.contains(&SensorFault::NotANumber) {
                *shown = f32::NAN;
            }
        }
        volts
    }

    fn throw_v(&mut self) -> f64 {
        if self.noise_v_rms > 0.0 { self.noise_v_rms * self.noise.gaussian() } else { 0.0 }
    }
}

/// The converter: steps and clipping. Codes of 16 bits times 5 × 2⁻¹⁴ V are exact in an f32.
fn convert(volts: f64) -> f32 {
    ((volts / STEP_V).round().clamp(-32768.0, 32767.0) * STEP_V) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOTH: [SensorScale; 2] = [PSE540A_R06, PSE541A_R06];
    const NONE: [&[SensorFault]; 2] = [&[], &[]];

    #[test]
    fn scales_are_those_of_the_data_sheets() {
        assert_eq!(PSE540A_R06.volts(0.0), 1.0);
        assert_eq!(PSE540A_R06.volts(1000.0), 5.0);
        assert_eq!(PSE540A_R06.volts(100.0), 1.4);
        assert_eq!(PSE541A_R06.volts(-101.0), 5.0);
        assert_eq!(PSE541A_R06.volts(-50.5), 3.0);
        for kpa in [-75.0, 0.0, 33.3] {
            // Rounding of a few f64 operations on numbers of order 100.
            assert!((PSE541A_R06.gauge_kpa(PSE541A_R06.volts(kpa)) - kpa).abs() < 1e-12);
        }
    }

    #[test]
    fn without_noise_a_reading_is_within_half_a_step() {
        let mut sensors = Sensors::new(BOTH, 0.0, 1);
        for step in 0..500 {
            let kpa = [f64::from(step) * 0.31, f64::from(step) * -0.17];
            let volts = sensors.sample(kpa, NONE);
            for channel in 0..2 {
                let exact = BOTH[channel].volts(kpa[channel]);
                assert!((f64::from(volts[channel]) - exact).abs() <= STEP_V / 2.0 + 1e-12);
                let code = f64::from(volts[channel]) / STEP_V;
                assert_eq!(code, code.round(), "not a code of the converter");
            }
            assert!(volts[2].is_nan() && volts[3].is_nan());
        }
    }

    #[test]
    fn noise_has_its_rms_and_its_seed() {
        let mut sensors = Sensors::new(BOTH, Sensors::ADC_NOISE_V_RMS, 3);
        let mut again = Sensors::new(BOTH, Sensors::ADC_NOISE_V_RMS, 3);
        let mut other = Sensors::new(BOTH, Sensors::ADC_NOISE_V_RMS, 4);
        let n = 50_000;
        let (mut sum, mut squares, mut differs) = (0.0, 0.0, false);
        for tick in 0..n {
            // A ramp over many steps, so that rounding is even over the step.
            let kpa = [f64::from(tick) * 0.001_7, -20.0];
            let volts = sensors.sample(kpa, NONE);
            assert_eq!(volts[..2], again.sample(kpa, NONE)[..2]);
            differs |= volts[..2] != other.sample(kpa, NONE)[..2];
            let error = f64::from(volts[0]) - PSE540A_R06.volts(kpa[0]);
            sum += error;
            squares += error * error;
        }
        assert!(differs);
        // Noise and rounding together: √(σ² + step²/12), within 3 % (1/√(2n) is 0.3 %).
        let expected = (Sensors::ADC_NOISE_V_RMS.powi(2) + STEP_V.powi(2) / 12.0).sqrt();
        let rms = (squares / f64::from(n)).sqrt();
        assert!((rms / expected - 1.0).abs() < 0.03, "{rms} against {expected}");
        assert!((sum / f64::from(n)).abs() < 5.0 * expected / f64::from(n).sqrt());
    }

    #[test]
    fn the_converter_clips_at_ten_volts() {
        assert_eq!(convert(50.0), 9.999_695);
        assert_eq!(convert(-50.0), -10.0);
        assert!(convert(f64::NAN).is_nan());
    }

    #[test]
    fn each_fault_shows() {
        let mut sensors = Sensors::new(BOTH, 0.0, 1);
        let before = sensors.sample([100.0, -50.5], NONE);
        let stuck = sensors.sample([120.0, -50.5], [&[SensorFault::Stuck], &[]]);
        assert_eq!(stuck[0], before[0]);
        assert_eq!(sensors.sample([0.0; 2], [&[SensorFault::BrokenWire], &[]])[0], 0.0);
        assert!(sensors.sample([0.0; 2], [&[], &[SensorFault::NotANumber]])[1].is_nan());
        let high = sensors.sample([0.0; 2], [&[SensorFault::Reading(320.0)], &[SensorFault::Offset(-50.5)]]);
        assert!((f64::from(high[0]) - 2.28).abs() <= STEP_V / 2.0);
        assert!((f64::from(high[1]) - 3.0).abs() <= STEP_V / 2.0);
        assert_eq!(sensors.sample([100.0, -50.5], NONE)[..2], before[..2], "a fault leaves nothing behind");
    }
}
