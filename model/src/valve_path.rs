//! Path between a duty that is sent and the flapper that it moves, as a rig file has it.

use crate::mechanism::{Lags, Mechanism, PLAYS};
use crate::rig::Rig;

/// Delay, lags and play of one valve, as its rig file states them; all zero where it states none.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ValvePath {
    /// Pure delay in s (`command_delay`).
    pub delay_s: f64,
    /// Lag in front of play in s (`valve_lag` of the coil); where rising and falling differ, their mean.
    pub coil_lag_s: f64,
    /// Lag behind play in s (`valve_lag` of the armature).
    pub armature_lag_s: f64,
    /// Half width of play in duty (`valve_hysteresis`): the mean, where there are several side by side.
    pub half_width_duty: f64,
    /// Half widths of the plays side by side, in duty, where they scatter.
    pub scattered_duty: Option<[f64; PLAYS]>,
    /// True where the file says anything of the valve's timing; where it does not, nothing is known.
    pub is_timed: bool,
}

impl ValvePath {
    /// The path of the valve called `name`.
    pub fn of(rig: &Rig, name: &str) -> Self {
        let mut path = ValvePath::default();
        for mechanism in rig.mechanisms.iter().filter(|m| m.enabled && m.component == name).map(|m| &m.mechanism) {
            match mechanism {
                Mechanism::CommandDelay(m) => {
                    path.delay_s += 1e-3 * m.delay_ms;
                    path.is_timed = true;
                }
                Mechanism::ValveLag(m) => {
                    let mean_s = 1e-3 * m.time_constant_ms * 0.5 * (1.0 + m.falling_over_rising);
                    match m.lags {
                        Lags::Coil => path.coil_lag_s += mean_s,
                        Lags::Armature => path.armature_lag_s += mean_s,
                    }
                    path.is_timed = true;
                }
                Mechanism::ValveHysteresis(m) => {
                    path.scattered_duty = (m.spread_duty > 0.0).then(|| m.half_widths_duty());
                    path.half_width_duty = path.scattered_duty.as_ref().map_or(m.half_width_duty, mean_of_plays);
                }
                _ => {}
            }
        }
        path
    }

    /// By how much a slow duty comes late at the flapper, in s.
    pub fn late_s(&self) -> f64 {
        self.delay_s + self.coil_lag_s + self.armature_lag_s
    }
}

/// Mean of a number of each of the plays side by side.
///
/// # Real-time
/// May run in the tick.
pub fn mean_of_plays(of_plays: &[f64; PLAYS]) -> f64 {
    of_plays.iter().sum::<f64>() / PLAYS as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_path_is_what_the_file_states() {
        let bench = ValvePath::of(&Rig::builtin("bench").unwrap(), "valve_pos");
        assert_eq!((bench.delay_s, bench.coil_lag_s, bench.half_width_duty), (0.02, 0.05, 0.03));
        assert!((bench.late_s() - 0.07).abs() < 1e-12 && bench.is_timed);
        assert_eq!(ValvePath::of(&Rig::builtin("dual_pressure").unwrap(), "valve_pos"), ValvePath::default());
        assert_eq!(bench.scattered_duty, None);
        let mut off = Rig::builtin("bench").unwrap();
        off.mechanisms.iter_mut().for_each(|m| m.enabled = false);
        assert_eq!(ValvePath::of(&off, "valve_neg"), ValvePath::default());
    }

    /// None of the plays is narrower than nothing, so the mean of a wide scatter is more than what the file states.
    #[test]
    fn plays_side_by_side_are_told_with_their_mean() {
        let path = |spread_duty: f64| {
            let mut rig = Rig::builtin("bench").unwrap();
            for attached in &mut rig.mechanisms {
                if let Mechanism::ValveHysteresis(m) = &mut attached.mechanism {
                    m.spread_duty = spread_duty;
                }
            }
            ValvePath::of(&rig, "valve_pos")
        };
        let close = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-12, "{found} for {expected}");
        let narrow = path(0.02);
        let expected = [0.014, 0.022, 0.03, 0.038, 0.046];
        narrow.scattered_duty.unwrap().into_iter().zip(expected).for_each(|(found, expected)| close(found, expected));
        close(narrow.half_width_duty, 0.03);
        let wide = path(0.05);
        assert_eq!(wide.scattered_duty.unwrap()[0], 0.0);
        close(wide.half_width_duty, (0.0 + 0.01 + 0.03 + 0.05 + 0.07) / 5.0);
    }
}
