//! The plant as the controller sees it: averaged over a revolution, a coil that lags, a delay in front of it.
//!
//! ```text
//! v(k+1) = α v + (1 − α) w          v: the coil's duty, play taken off;   w: the duty that acts, a delay after it was sent
//! f̄      = (1 − m) v + m w          mean over the tick
//! P(k+1) = P + T (Ṗ(P, f̄) + d)      d: what the model errs by, in kPa/s
//! ```

use std::sync::Arc;

use law::TICK_S;
use law::foresight::{UNKNOWN_LATE_TICKS, is_told};
use model::observation::{CHANNELS, Pair};
use model::steady::SteadyMap;

/// Step of numeric derivatives by pressure in kPa and by duty.
const STEP_KPA: f64 = 0.05;
const STEP_DUTY: f64 = 1e-3;

/// Timing of one valve, in ticks.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Timing {
    /// Pure delay in ticks.
    pub(crate) delay_ticks: f64,
    /// α: share of the coil's duty that a tick leaves.
    pub(crate) keeps: f64,
    /// m: share of the duty sent in the coil's mean over the tick.
    pub(crate) mean_share: f64,
}

/// Pressures (kPa gauge) and what acts besides, over one tick.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Acting {
    /// Mean duties of the flappers.
    pub(crate) flapper: Pair,
    /// Error of the model, in kPa/s.
    pub(crate) disturbance: Pair,
    /// Temperatures of the gas, in K.
    pub(crate) gas_k: Pair,
}

/// First derivatives of a step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Slopes {
    /// `by_pressure[i][j]`: of pressure i by pressure j.
    pub(crate) by_pressure: [Pair; CHANNELS],
    /// Slope of each pressure by its own flapper, kPa per duty.
    pub(crate) by_flapper: Pair,
}

/// The reduced plant.
#[derive(Debug, Clone)]
pub(crate) struct ReducedModel {
    pub(crate) map: Arc<SteadyMap>,
    pub(crate) timing: [Timing; CHANNELS],
    /// Half width of play that the rig file states, in duty.
    pub(crate) half_width: Pair,
    /// True where the file says anything of the valves' paths.
    pub(crate) is_told: bool,
}

impl ReducedModel {
    /// Model of the rig that `map` was made of. A valve of which nothing is known is taken to be somewhat late.
    pub(crate) fn new(map: Arc<SteadyMap>) -> Self {
        let paths = *map.valve_paths();
        let timing = paths.each_ref().map(|path| {
            let lag_s = path.coil_lag_s + path.armature_lag_s;
            let keeps = if lag_s > 0.0 { (-TICK_S / lag_s).exp() } else { 0.0 };
            Timing {
                delay_ticks: if is_told(path) { path.delay_s / TICK_S } else { UNKNOWN_LATE_TICKS },
                keeps,
                mean_share: 1.0 - (1.0 - keeps) * lag_s / TICK_S,
            }
        });
        let is_told = paths.iter().all(is_told);
        ReducedModel { map, timing, half_width: paths.map(|path| path.half_width_duty), is_told }
    }

    /// Pressures a tick later, in kPa gauge.
    pub(crate) fn step(&self, pressures_kpa: Pair, acting: &Acting) -> Pair {
        let rate = self.map.warm_rate_kpa_per_s(pressures_kpa, acting.flapper, acting.gas_k);
        std::array::from_fn(|c| pressures_kpa[c] + TICK_S * (rate[c] + acting.disturbance[c]))
    }

    /// Derivatives of [`ReducedModel::step`] there.
    pub(crate) fn slopes(&self, pressures_kpa: Pair, acting: &Acting) -> Slopes {
        let here = self.step(pressures_kpa, acting);
        let mut by_pressure = [[0.0; CHANNELS]; CHANNELS];
        for j in 0..CHANNELS {
            let mut moved = pressures_kpa;
            moved[j] += STEP_KPA;
            let there = self.step(moved, acting);
            for i in 0..CHANNELS {
                by_pressure[i][j] = (there[i] - here[i]) / STEP_KPA;
            }
        }
        let flapper = acting.flapper.map(|duty| duty + STEP_DUTY);
        let there = self.step(pressures_kpa, &Acting { flapper, ..*acting });
        Slopes { by_pressure, by_flapper: std::array::from_fn(|c| (there[c] - here[c]) / STEP_DUTY) }
    }
}
