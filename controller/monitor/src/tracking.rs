//! Pressures that stay away from their references, whatever model is used.

use model::observation::{CHANNELS, Pair};
use supervisor::{Condition, ConditionSet};

/// Error from which on a pressure counts as away from its reference, in kPa (chosen: several times the worst policy that
/// was ever admitted, half of what the true pressure may move).
pub const AWAY_KPA: f64 = 15.0;
/// Ticks that it must stay away without coming nearer before the fallback takes over: 5 s (chosen: where both references step
/// down at once, the air that enters the negative chamber keeps the positive one up for two seconds).
pub const TICKS_TO_REVERT: u32 = 250;
/// Ticks beyond its reference with the vent open, without coming nearer, before the rig is vented: 5 s (chosen, as above).
pub const TICKS_TO_VENT: u32 = 250;
/// Duty from which on a vent counts as open.
const OPEN: f64 = 0.95;
/// Progress that counts as coming nearer, in kPa a tick: 1 kPa/s, an eighth of what an open vent makes of a running pump's
/// delivery on the rig `dual_pressure` (measured: 8 kPa/s from 85 kPa).
const NEARER_KPA: f64 = 0.02;

const POOR: [Condition; CHANNELS] = [Condition::TrackingPositive, Condition::TrackingNegative];

/// Watches both errors.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tracking {
    channels: [Channel; CHANNELS],
}

#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Channel {
    /// Smallest error since it is away, less what it should have come nearer since.
    bound_kpa: f64,
    away: u32,
    beyond: u32,
}

impl Tracking {
    /// Begins anew.
    pub fn new() -> Self {
        Tracking::default()
    }

    /// Takes references, readings and duties of a tick under control.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn judge(&mut self, reference_kpa: Pair, measured_kpa: Pair, duty: Pair, found: &mut ConditionSet) {
        for (c, channel) in self.channels.iter_mut().enumerate() {
            let error = measured_kpa[c] - reference_kpa[c];
            // More pressure or more vacuum than was asked for, with the vent as open as it gets.
            let beyond = measured_kpa[c].abs() - reference_kpa[c].abs() > AWAY_KPA && duty[c] >= OPEN;
            channel.beyond = if beyond { channel.beyond + 1 } else { 0 };
            if error.abs() > AWAY_KPA {
                if channel.away == 0 || error.abs() < channel.bound_kpa {
                    // On its way: the wait begins anew.
                    (channel.bound_kpa, channel.away) = (error.abs(), 1);
                }
                channel.bound_kpa -= NEARER_KPA;
                channel.away += 1;
            } else {
                channel.away = 0;
            }
            if channel.away > TICKS_TO_REVERT {
                found.insert(POOR[c], error);
            }
            if channel.beyond > TICKS_TO_VENT && error.is_finite() && channel.away > TICKS_TO_VENT {
                found.insert(Condition::Uncontrolled, measured_kpa[c]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ticks until something is found of a positive channel, and what, over a course of its reading; 90 kPa are asked for.
    fn found(duty: f64, reading_kpa: impl Fn(u32) -> f64) -> Option<(u32, Vec<Condition>)> {
        let mut tracking = Tracking::new();
        (0..2_000).find_map(|k| {
            let mut set = ConditionSet::EMPTY;
            tracking.judge([90.0, -70.0], [reading_kpa(k), -70.0], [duty, 0.8], &mut set);
            (!set.is_empty()).then(|| (k, set.iter().collect()))
        })
    }

    #[test]
    fn what_stays_away_is_given_up_and_what_comes_nearer_is_not() {
        assert_eq!(found(0.8, |_| 80.0), None, "near enough");
        assert_eq!(found(0.0, |k| 0.0 + 0.05 * f64::from(k)), None, "on its way, by 2.5 kPa/s");
        let poor = Some((TICKS_TO_REVERT - 1, vec![Condition::TrackingPositive]));
        assert_eq!(found(0.0, |_| 60.0), poor);
        assert_eq!(found(0.8, |_| 120.0), poor, "above it, the vent not open");
    }

    #[test]
    fn an_open_vent_that_does_not_lower_a_pressure_is_more_than_poor_tracking() {
        let found = found(1.0, |_| 120.0).unwrap();
        assert!(found.1.contains(&Condition::TrackingPositive), "{found:?}");
        let mut tracking = Tracking::new();
        let mut set = ConditionSet::EMPTY;
        for _ in 0..TICKS_TO_VENT + 2 {
            set = ConditionSet::EMPTY;
            tracking.judge([90.0, -70.0], [120.0, -70.0], [1.0, 0.8], &mut set);
        }
        assert!(set.contains(Condition::Uncontrolled), "{set:?}");
    }
}
