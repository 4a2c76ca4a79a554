//! Two decisions in one, by a share.

use law::{ControlOutput, DutyTerms};
use model::observation::ActionTrajectory;

/// The incumbent's decision with the candidate's share of authority.
///
/// # Real-time
/// Runs in the tick.
pub(crate) fn blended(incumbent: &ControlOutput, candidate: &ControlOutput, authority: f64) -> ControlOutput {
    // Both ends must be what either decided, to the bit.
    if authority == 0.0 {
        return *incumbent;
    }
    if authority == 1.0 {
        return *candidate;
    }
    let mix = |a: f64, b: f64| (1.0 - authority) * a + authority * b;
    ControlOutput {
        parts: std::array::from_fn(|c| {
            let (a, b) = (incumbent.parts[c], candidate.parts[c]);
            DutyTerms {
                feed_forward: mix(a.feed_forward, b.feed_forward),
                play: mix(a.play, b.play),
                correction: mix(a.correction, b.correction),
                proportional: mix(a.proportional, b.proportional),
                integral: mix(a.integral, b.integral),
            }
        }),
        trajectory: ActionTrajectory(std::array::from_fn(|j| {
            std::array::from_fn(|c| mix(incumbent.trajectory.0[j][c], candidate.trajectory.0[j][c]))
        })),
    }
}
