//! Courses that a pump's speed may take, and a grid of the plain ones.
//!
//! ```text
//! s = (1 + ε) (1 + w (1 − e^(−t/τ))) (1 − k ΔP_λ) − 1
//! ```
//!
//! share by which the speed is off: `ε` without load when a recording begins; `w` what it moves by from then on, as a motor does
//! that warms; `k` what it loses under the load `ΔP` between the pump's ports, followed with a lag `λ`.

use proto::recording::PERIOD_S;

/// The course that a speed takes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Course {
    /// ε: share of the stated speed by which it is off without load when a recording begins; negative is slower.
    pub share: f64,
    /// Loss of speed under load.
    pub droop: Option<Droop>,
    /// Speed that it moves towards from the start of each recording on.
    pub warming: Option<Warming>,
}

/// Slower the more the pump works against.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Droop {
    /// k: share of the speed lost per bar between outlet and inlet.
    pub per_bar: f64,
    /// λ: how late the speed follows, in s.
    pub lag_s: f64,
}

/// Towards another speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Warming {
    /// w: share by which the speed changes in the end.
    pub share: f64,
    /// τ: time constant in s.
    pub time_s: f64,
}

/// Steps of the coarse grid: a quarter of a turn of a ripple of 100 Hz in a window.
const SHARE_STEP: f64 = 0.0025;
/// The largest share by which a constant speed may be off: half the way to where the samples repeat themselves.
const REACH: f64 = 0.24;
/// The largest droop per bar.
const DROOP: f64 = 0.3;
/// Lags that are tried, in s.
const LAGS_S: [f64; 3] = [0.02, 0.1, 0.2];
/// The largest change besides a droop, and its steps.
pub(super) const BESIDES: f64 = 0.15;
pub(super) const BESIDES_STEP: f64 = 2.0 * SHARE_STEP;
/// Warming: largest change, and times in s.
const WARMING: f64 = 0.12;
const WARMING_S: [f64; 4] = [15.0, 30.0, 60.0, 120.0];

impl Course {
    /// Off by a share all the time.
    pub fn constant(share: f64) -> Self {
        Course { share, ..Course::default() }
    }

    /// As stated when a recording begins, and towards another speed from then on.
    pub fn warming(share: f64, time_s: f64) -> Self {
        Course { share: 0.0, droop: None, warming: Some(Warming { share, time_s }) }
    }

    /// Courses with each of its numbers a step further or nearer; `size` shrinks the steps, `load_bar` is the mean load. No pump
    /// gains speed under load.
    pub(super) fn neighbours(self, size: f64, load_bar: f64) -> Vec<Self> {
        let off = |s: f64| Course { share: self.share + s * SHARE_STEP, ..self };
        [-size, size]
            .into_iter()
            .flat_map(|s| {
                let mut near = Vec::new();
                if let Some(droop) = self.droop {
                    let per_bar = droop.per_bar + s * SHARE_STEP;
                    let slower = Some(Droop { per_bar, ..droop });
                    near.push(Course { droop: slower, ..self });
                    near.push(off(s));
                    // A faster pump that droops more turns as fast under the mean load.
                    let left = 1.0 - droop.per_bar * load_bar;
                    let faster = self.share + (1.0 + self.share) * s * SHARE_STEP * load_bar / left.max(0.1);
                    near.push(Course { share: faster, droop: slower, ..self });
                    let lag_s = (droop.lag_s * (1.0 + 0.5 * s)).clamp(0.005, 1.0);
                    near.push(Course { droop: Some(Droop { lag_s, ..droop }), ..self });
                }
                if let Some(Warming { share, time_s }) = self.warming {
                    let later_s = time_s * (1.0 + 0.4 * s);
                    let towards = |share, time_s| Course { warming: Some(Warming { share, time_s }), ..self };
                    near.push(towards(share + s * SHARE_STEP, time_s));
                    near.push(towards(share, later_s));
                    // A higher end reached later is nearly the same course.
                    near.push(towards(share * (1.0 + 0.2 * s), later_s));
                    if self.droop.is_some() {
                        // So is one that begins faster and gains less.
                        near.push(Course {
                            share: self.share - s * SHARE_STEP,
                            ..towards(share + s * SHARE_STEP, time_s)
                        });
                    }
                }
                if near.is_empty() {
                    near.push(off(s));
                }
                near
            })
            .filter(|course| course.droop.is_none_or(|droop| droop.per_bar > 0.0))
            .collect()
    }

    /// Every plain course of the coarse grid, by kind: constant, drooping, warming.
    pub(super) fn grid() -> [Vec<Self>; 3] {
        let constant = steps(REACH, SHARE_STEP).map(Course::constant);
        // A pump works against 1 to 2 bar, so its droop is told from its neighbour at half the step.
        let droops = droops(0.5, &LAGS_S).map(|droop| Course { droop: Some(droop), ..Course::default() });
        [constant.collect(), droops.collect(), warmings(WARMING).collect()]
    }

    /// Courses of what a pump that droops may do besides: constant and warming.
    pub(super) fn besides() -> Vec<Self> {
        steps(BESIDES, SHARE_STEP).map(Course::constant).chain(warmings(BESIDES)).collect()
    }

    /// The share by which the speed is off at each row, given times in s since the recording began and loads in bar.
    pub(super) fn shares(self, time_s: &[f64], load_bar: &[f64]) -> Vec<f64> {
        let mut shares = vec![self.share; time_s.len()];
        if let Some(Warming { share, time_s: constant_s }) = self.warming {
            for (slot, t) in shares.iter_mut().zip(time_s) {
                *slot += -(1.0 + self.share) * share * f64::exp_m1(-t / constant_s);
            }
        }
        if let Some(Droop { per_bar, lag_s }) = self.droop {
            let keep = (-PERIOD_S / lag_s).exp();
            let mut load = load_bar.first().copied().unwrap_or(0.0);
            for (slot, now) in shares.iter_mut().zip(load_bar) {
                load = keep * load + (1.0 - keep) * now;
                *slot -= (1.0 + *slot) * per_bar * load;
            }
        }
        shares
    }
}

/// Shares up to `reach` either way, so far apart.
fn steps(reach: f64, step: f64) -> impl Iterator<Item = f64> {
    let n = (reach / step).round() as i64;
    (-n..=n).map(move |k| k as f64 * step)
}

/// Warming ones that end up to `reach` either way.
fn warmings(reach: f64) -> impl Iterator<Item = Course> {
    steps(reach, SHARE_STEP).flat_map(|share| WARMING_S.map(|time_s| Course::warming(share, time_s)))
}

/// Droops, by so many steps of a share, with each of some lags.
fn droops(by: f64, lags_s: &[f64]) -> impl Iterator<Item = Droop> {
    let all = (1..=(DROOP / (by * SHARE_STEP)) as usize).map(move |k| by * SHARE_STEP * k as f64);
    all.flat_map(|per_bar| lags_s.iter().map(move |lag_s| Droop { per_bar, lag_s: *lag_s }))
}

/// Droops on a grid twice as coarse in speed, for windows half as long.
pub(super) fn coarse_droops() -> Vec<Droop> {
    droops(2.0, &LAGS_S[1..2]).collect()
}

/// Shares by which a pump that droops may be off besides at any moment, from the least on, [`BESIDES_STEP`] apart.
pub(super) fn besides() -> Vec<f64> {
    steps(BESIDES, BESIDES_STEP).collect()
}
