//! Factor by which a simulation is integrated more finely than its rig file says.

/// Integrator steps per step of the rig file, unless another number is asked for: at four the result no longer depends on the step.
pub const REFINE: u32 = 4;

/// The finest step that a rig may have, in ms.
const FINEST_STEP_MS: f64 = 0.001;

/// A step (ms) cut into at most `refine` equal parts, none finer than a rig may have.
pub fn refined(step_ms: f64, refine: u32) -> f64 {
    let most = (step_ms / FINEST_STEP_MS * (1.0 + 1e-9)).floor().max(1.0);
    step_ms / f64::from(refine.max(1)).min(most)
}

#[cfg(test)]
mod tests {
    use super::refined;

    #[test]
    fn steps_are_cut_into_whole_parts_down_to_the_finest() {
        assert_eq!([refined(0.1, 1), refined(0.1, 4), refined(1.0, 100)], [0.1, 0.025, 0.01]);
        // A step that is already fine stays what a rig may have.
        assert_eq!([refined(0.002, 4), refined(0.001, 4)], [0.001, 0.001]);
    }
}
