//! Where the crank of a pump stood when recordings began.

use std::f64::consts::TAU;

use model::rig::PistonPump;

/// Length of the mean of unit vectors from which on angles are one angle: 20° of spread.
const TOGETHER: f64 = 0.94;

/// Turns a pump's pistons on to where `crank_rev` (revolutions at the start of each recording) says, if that is one place.
pub(crate) fn turn_to(pump: &mut PistonPump, crank_rev: &[f64]) {
    if let Some(rev) = common_angle(crank_rev, period_rev(&pump.phases_deg)) {
        for phase in &mut pump.phases_deg {
            *phase = (*phase + 360.0 * rev).rem_euclid(360.0);
        }
    }
}

/// Tells whether a pump stood at one place when each of several recordings began, which chance seldom does.
pub(crate) fn stood_alike(pump: &PistonPump, crank_rev: &[f64]) -> bool {
    crank_rev.len() > 1 && common_angle(crank_rev, period_rev(&pump.phases_deg)).is_some()
}

/// After what part of a revolution strokes repeat themselves.
fn period_rev(phases_deg: &[f64]) -> f64 {
    let mut sorted: Vec<f64> = phases_deg.iter().map(|phase| phase.rem_euclid(360.0)).collect();
    sorted.sort_by(f64::total_cmp);
    let even = 360.0 / sorted.len().max(1) as f64;
    let is_even = sorted.windows(2).all(|pair| (pair[1] - pair[0] - even).abs() < 1.0);
    if is_even { even / 360.0 } else { 1.0 }
}

/// The mean of angles in revolutions that repeat themselves after `period_rev`; `None` where they are spread.
fn common_angle(angles_rev: &[f64], period_rev: f64) -> Option<f64> {
    let (mut sine, mut cosine) = (0.0, 0.0);
    for angle in angles_rev {
        let (s, c) = (TAU * angle / period_rev).sin_cos();
        (sine, cosine) = (sine + s, cosine + c);
    }
    let together = sine.hypot(cosine) / angles_rev.len().max(1) as f64;
    (together > TOGETHER).then(|| sine.atan2(cosine) / TAU * period_rev)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_that_agree_are_one_angle() {
        // Of two pistons half a revolution is the same again.
        let half = period_rev(&[180.0, 0.0]);
        assert_eq!((half, period_rev(&[0.0]), period_rev(&[0.0, 120.0])), (0.5, 1.0, 1.0));
        let mean = common_angle(&[0.02, 0.51, -0.01, 0.98], half).unwrap();
        // (0.02 + 0.01 − 0.01 − 0.02)/4, each within half a revolution of the others.
        assert!(mean.abs() < 1e-3, "{mean}");
        assert!(common_angle(&[0.02, 0.51], 1.0).is_none());
        assert!(common_angle(&[], 0.5).is_none());
    }
}
