//! Integral action with anti-windup by back-calculation, as the paper adds to its policy.
//!
//! ```text
//! u = sat(a + I),      İ = ± K_i e + K_a (u_applied − u_raw)
//! ```
//!
//! with K_i = 0.01 and K_a = 10 (paper, Table IV). The paper gives no units; they are read as duty/(kPa s)
//! and 1/s. The sign follows the vent: opening the positive valve lowers its pressure, opening the
//! negative one raises it, so `I` grows with a negative error there and with a positive error here.

use model::observation::{CHANNELS, Pair};

use crate::TICK_S;

/// Gains of the integral action.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IntegralSettings {
    /// K_i in duty/(kPa s).
    pub gain: f64,
    /// K_a in 1/s.
    pub anti_windup: f64,
}

impl Default for IntegralSettings {
    fn default() -> Self {
        IntegralSettings { gain: 0.01, anti_windup: 10.0 }
    }
}

/// Sign of a valve's effect on its pressure: opening vents the positive chamber and fills the negative one.
pub const VENT_SIGN: Pair = [-1.0, 1.0];

/// The integral part of both channels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IntegralAction {
    settings: IntegralSettings,
    state: Pair,
}

impl IntegralAction {
    /// Starts at zero.
    pub fn new(settings: IntegralSettings) -> Self {
        IntegralAction { settings, state: [0.0; CHANNELS] }
    }

    /// The integral part of each channel in duty.
    pub fn duty(&self) -> Pair {
        self.state
    }

    /// Sets the integral part, for a bumpless change of controller.
    pub fn set(&mut self, duty: Pair) {
        self.state = duty;
    }

    /// Moves the integral part of a channel, in duty.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn shift(&mut self, channel: usize, duty: f64) {
        if let Some(state) = self.state.get_mut(channel) {
            *state = (*state + duty).clamp(-1.0, 1.0);
        }
    }

    /// Takes in one tick of a channel: error in kPa, and the duty before and after all limits.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn update(&mut self, channel: usize, error_kpa: f64, raw: f64, applied: f64) {
        if let Some(sign) = VENT_SIGN.get(channel) {
            let rate = sign * self.settings.gain * error_kpa + self.settings.anti_windup * (applied - raw);
            // A whole duty of integral means that something else is wrong; it must not hide it for long.
            self.shift(channel, rate * TICK_S);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integrates_a_constant_error_with_the_vents_sign() {
        let mut integral = IntegralAction::new(IntegralSettings::default());
        for _ in 0..50 {
            integral.update(0, 2.0, 0.5, 0.5);
            integral.update(1, 2.0, 0.5, 0.5);
        }
        // One second of 2 kPa at 0.01 duty/(kPa s).
        assert!((integral.duty()[0] + 0.02).abs() < 1e-12);
        assert!((integral.duty()[1] - 0.02).abs() < 1e-12);
    }

    #[test]
    fn saturation_settles_where_back_calculation_says() {
        let mut integral = IntegralAction::new(IntegralSettings::default());
        for _ in 0..2000 {
            let raw = 0.9 + integral.duty()[1];
            integral.update(1, 50.0, raw, raw.clamp(0.0, 1.0));
        }
        // At rest 0.01 · 50 = 10 · (raw − 1): the integral stops 0.05 above the limit instead of growing.
        assert!((0.9 + integral.duty()[1] - 1.05).abs() < 1e-9);
    }
}
