//! Courses that a pump's speed may take, and a grid of them.
//!
//! ```text
//! constant   s = ε                        off by a share
//! drooping   s = ε − (1 + ε) k ΔP_τ       ΔP between the pump's ports, followed with a lag τ
//! warming    s = ε (1 − e^(−t/τ))         from the start of each recording
//! ```

use proto::recording::PERIOD_S;

/// The course that a speed takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Course {
    /// Off by a share of the stated speed.
    Constant {
        /// That share; negative is slower.
        share: f64,
    },
    /// Slower the more the pump works against.
    Drooping {
        /// Share by which the speed without load is off.
        share: f64,
        /// Share of that speed lost per bar between outlet and inlet.
        per_bar: f64,
        /// How late the speed follows, in s.
        lag_s: f64,
    },
    /// Towards another speed from the start of each recording on.
    Warming {
        /// Share by which the speed is off in the end.
        share: f64,
        /// Time constant in s.
        time_s: f64,
    },
}

/// Steps of the coarse grid: a quarter of a turn of a ripple of 100 Hz in a window.
pub(super) const SHARE_STEP: f64 = 0.0025;
/// The largest share by which a constant speed may be off: half the way to where the samples repeat themselves.
const REACH: f64 = 0.24;
/// The largest droop per bar.
const DROOP: f64 = 0.3;
/// Lags that are tried, in s.
const LAGS_S: [f64; 3] = [0.02, 0.1, 0.2];
/// Warming: largest change, and times in s.
const WARMING: f64 = 0.12;
const WARMING_S: [f64; 4] = [15.0, 30.0, 60.0, 120.0];

impl Course {
    /// The number that the course is about.
    pub fn leading(&self) -> f64 {
        match *self {
            Course::Constant { share } | Course::Warming { share, .. } => share,
            Course::Drooping { per_bar, .. } => per_bar,
        }
    }

    /// The time that it takes to get there, in s; 0 where it is there at once.
    pub fn time_s(&self) -> f64 {
        match *self {
            Course::Warming { time_s, .. } => time_s,
            Course::Constant { .. } | Course::Drooping { .. } => 0.0,
        }
    }

    /// The same with each of its numbers a step further or nearer; `size` shrinks the steps, `load_bar` is the mean load.
    pub(super) fn neighbours(self, size: f64, load_bar: f64) -> Vec<Self> {
        let ends = [-size, size];
        match self {
            Course::Constant { share } => ends.map(|s| Course::Constant { share: share + s * SHARE_STEP }).to_vec(),
            Course::Warming { share, time_s } => ends
                .iter()
                .flat_map(|s| {
                    [
                        Course::Warming { share: share + s * SHARE_STEP, time_s },
                        Course::Warming { share, time_s: time_s * (1.0 + 0.4 * s) },
                        // A higher end reached later is nearly the same course.
                        Course::Warming { share: share * (1.0 + 0.2 * s), time_s: time_s * (1.0 + 0.4 * s) },
                    ]
                })
                .collect(),
            Course::Drooping { share, per_bar, lag_s } => ends
                .iter()
                .flat_map(|s| {
                    let slower = per_bar + s * SHARE_STEP;
                    [
                        Course::Drooping { share, per_bar: slower, lag_s },
                        Course::Drooping { share: share + s * SHARE_STEP, per_bar, lag_s },
                        // A faster pump that droops more turns as fast under the mean load.
                        Course::Drooping {
                            share: share + (1.0 + share) * s * SHARE_STEP * load_bar,
                            per_bar: slower,
                            lag_s,
                        },
                        Course::Drooping { share, per_bar, lag_s: (lag_s * (1.0 + 0.5 * s)).clamp(0.005, 1.0) },
                    ]
                })
                .collect(),
        }
    }

    /// Every course of the coarse grid.
    pub(super) fn grid() -> Vec<Self> {
        let steps = |reach: f64| {
            let n = (reach / SHARE_STEP).round() as i64;
            (-n..=n).map(|k| k as f64 * SHARE_STEP)
        };
        let constant = steps(REACH).map(|share| Course::Constant { share });
        // A pump works against 1 to 2 bar, so its droop is told from its neighbour at half the step.
        let droops = (1..=(2.0 * DROOP / SHARE_STEP) as usize).map(|k| 0.5 * SHARE_STEP * k as f64);
        let drooping = droops.flat_map(|per_bar| LAGS_S.map(|lag_s| Course::Drooping { share: 0.0, per_bar, lag_s }));
        let warming = steps(WARMING).flat_map(|share| WARMING_S.map(|time_s| Course::Warming { share, time_s }));
        constant.chain(drooping).chain(warming).collect()
    }

    /// The share by which the speed is off at each row, given times in s since the recording began and loads in bar.
    pub(super) fn shares(self, time_s: &[f64], load_bar: &[f64]) -> Vec<f64> {
        match self {
            Course::Constant { share } => vec![share; time_s.len()],
            Course::Warming { share, time_s: constant_s } => {
                time_s.iter().map(|t| -share * f64::exp_m1(-t / constant_s)).collect()
            }
            Course::Drooping { share, per_bar, lag_s } => {
                let keep = (-PERIOD_S / lag_s).exp();
                let mut load = load_bar.first().copied().unwrap_or(0.0);
                let slower = |now: &f64| {
                    load = keep * load + (1.0 - keep) * now;
                    share - (1.0 + share) * per_bar * load
                };
                load_bar.iter().map(slower).collect()
            }
        }
    }
}
