//! Path between a chamber's pressure and the number in the file.
//!
//! ```text
//! chamber → snubber (lag) → sensing line (may ring) → element (gain, bias, drift, crosstalk) → 1–5 V → noise → ADC
//! ```
//! The instruments are the paper's: PSE540A (0 … 1 MPa) and PSE541A (0 … −101 kPa), both 1–5 V, read by an NI 9205
//! (16 bits over ±10 V). One step of the converter is 305 µV, so 76.3 Pa on the positive channel and 7.7 Pa on the
//! negative one. Noise is white with heavy tails plus a slower part (AR(1), as amplifiers and supplies give it).

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use crate::rng::Draws;

/// One step of the converter (V): 20 V over 2¹⁶.
const STEP_V: f64 = 20.0 / 65_536.0;
/// Span of the transducers' output (V).
const SPAN_V: f64 = 4.0;
/// Pressure range of both transducers (kPa), by channel.
const RANGE_KPA: [f64; 2] = [1_000.0, -101.0];

/// A sensing line that rings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineResonance {
    /// Undamped frequency (Hz).
    pub frequency_hz: f64,
    /// Damping ratio.
    pub damping: f64,
    /// Share of the ringing in what is sensed: 1 for the end of the line, less for a tap along it.
    pub gain: f64,
}

/// A zero that creeps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ZeroDrift {
    /// Where it ends (Pa).
    pub final_pa: f64,
    /// Time constant (s).
    pub time_s: f64,
}

/// One pressure sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensor {
    /// Time constant of a snubber or clogged filter before the element (s); 0 for none.
    pub lag_s: f64,
    /// Resonance of the sensing line.
    pub resonance: Option<LineResonance>,
    /// Relative error of the gain.
    pub gain_error: f64,
    /// Error of the zero (Pa).
    pub bias_pa: f64,
    /// Creep of the zero.
    pub drift: Option<ZeroDrift>,
    /// Share of the other channel's pressure that leaks in through the wiring.
    pub crosstalk: f64,
}

impl Sensor {
    /// A sensor without fault.
    pub fn sound() -> Self {
        Self { lag_s: 0.0, resonance: None, gain_error: 0.0, bias_pa: 0.0, drift: None, crosstalk: 0.0 }
    }

    /// Rates of the snubber's two states (Pa/s): the second, ten times as fast, is the element's own cavity.
    #[inline]
    pub fn snubber_rates(&self, pressure_pa: f64, snubber_pa: [f64; 2]) -> [f64; 2] {
        if self.lag_s == 0.0 {
            return [0.0, 0.0];
        }
        [(pressure_pa - snubber_pa[0]) / self.lag_s, (snubber_pa[0] - snubber_pa[1]) / (0.1 * self.lag_s)]
    }

    /// Rates of the line's pressure (Pa/s) and of its rate (Pa/s²).
    #[inline]
    pub fn line_rates(&self, driven_pa: f64, line: [f64; 2]) -> [f64; 2] {
        let Some(ring) = self.resonance else { return [0.0, 0.0] };
        let omega = TAU * ring.frequency_hz;
        [line[1], omega * (omega * (driven_pa - line[0]) - 2.0 * ring.damping * line[1])]
    }

    /// Pressure at the element (Pa) given the chamber's and the states before it.
    #[inline]
    pub fn element_pa(&self, pressure_pa: f64, snubber_pa: [f64; 2], line: [f64; 2]) -> f64 {
        let driven = if self.lag_s == 0.0 { pressure_pa } else { snubber_pa[1] };
        self.resonance.map_or(driven, |ring| driven + ring.gain * (line[0] - driven))
    }

    /// Pressure that the element shows (Pa gauge), given both channels' pressures at the elements, `time_s` after the start.
    pub fn reading_pa(&self, own_pa: f64, other_pa: f64, time_s: f64) -> f64 {
        let drift = self.drift.map_or(0.0, |drift| drift.final_pa * (1.0 - (-time_s.max(0.0) / drift.time_s).exp()));
        own_pa * (1.0 + self.gain_error) + self.crosstalk * other_pa + self.bias_pa + drift
    }
}

/// Noise of a rig's readings.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Noise {
    /// Standard deviation of the white part, by channel (Pa).
    pub white_pa: [f64; 2],
    /// Standard deviation of the slow part, by channel (Pa).
    pub slow_pa: [f64; 2],
    /// Correlation of the slow part from one reading to the next.
    pub slow_correlation: f64,
    /// Standard deviation of how late a reading is taken (s).
    pub jitter_s: f64,
}

impl Noise {
    /// Total standard deviation by channel (Pa), with the converter's step.
    pub fn sigma_pa(&self) -> [f64; 2] {
        std::array::from_fn(|c| {
            let step = 1e3 * converter_step_kpa(c);
            (self.white_pa[c].powi(2) + self.slow_pa[c].powi(2) + step * step / 12.0).sqrt()
        })
    }
}

/// One step of the converter in a channel (kPa).
pub fn converter_step_kpa(channel: usize) -> f64 {
    STEP_V / SPAN_V * RANGE_KPA[channel].abs()
}

/// The electronics of one recording: noise with a memory, and the converter.
#[derive(Debug, Clone)]
pub struct Electronics {
    noise: Noise,
    draws: Draws,
    slow_pa: [f64; 2],
}

impl Electronics {
    /// Electronics whose noise is fixed by a stream of draws.
    pub fn new(noise: Noise, mut draws: Draws) -> Self {
        let slow_pa = noise.slow_pa.map(|sigma| sigma * draws.normal());
        Self { noise, draws, slow_pa }
    }

    /// Lateness of the next reading (s): the loop is late now and then, never early.
    pub fn latency_s(&mut self) -> f64 {
        (self.noise.jitter_s * self.draws.normal().abs()).min(4.0 * self.noise.jitter_s)
    }

    /// Turns what the elements say (Pa gauge) into the numbers of the file (kPa gauge).
    pub fn read_kpa(&mut self, said_pa: [f64; 2]) -> [f64; 2] {
        let phi = self.noise.slow_correlation;
        std::array::from_fn(|c| {
            self.slow_pa[c] =
                phi * self.slow_pa[c] + (1.0 - phi * phi).sqrt() * self.noise.slow_pa[c] * self.draws.normal();
            let noisy = said_pa[c] + self.slow_pa[c] + self.noise.white_pa[c] * self.draws.heavy_tailed();
            // Volts beyond the transducer's 1 V at zero; rounding is the converter's.
            let volts = noisy * 1e-3 / RANGE_KPA[c] * SPAN_V;
            (volts / STEP_V).round() * STEP_V / SPAN_V * RANGE_KPA[c]
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOISE: Noise = Noise { white_pa: [70.0, 60.0], slow_pa: [30.0, 25.0], slow_correlation: 0.9, jitter_s: 1e-4 };

    #[test]
    fn readings_stand_on_the_converters_steps() {
        assert!((converter_step_kpa(0) - 0.0763).abs() < 1e-4 && (converter_step_kpa(1) - 0.0077).abs() < 1e-4);
        let mut electronics = Electronics::new(NOISE, Draws::new(3));
        for _ in 0..200 {
            for (c, reading) in electronics.read_kpa([95_000.0, -70_000.0]).iter().enumerate() {
                let steps = reading / converter_step_kpa(c);
                assert!((steps - steps.round()).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn noise_has_the_stated_size_and_colour() {
        const READINGS: usize = 40_000;
        let mut electronics = Electronics::new(NOISE, Draws::new(4));
        let readings: Vec<f64> = (0..READINGS).map(|_| 1e3 * electronics.read_kpa([9e4, -7e4])[1] + 7e4).collect();
        let variance = readings.iter().map(|r| r * r).sum::<f64>() / READINGS as f64;
        let neighbours = readings.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / READINGS as f64;
        let sigma = NOISE.sigma_pa()[1];
        // Heavy tails and the slow part's memory make the error of the variance 2 % at most here; five of them.
        assert!((variance.sqrt() / sigma - 1.0).abs() < 0.05);
        assert!((neighbours / (0.9 * 25.0 * 25.0) - 1.0).abs() < 0.25);
    }
}
