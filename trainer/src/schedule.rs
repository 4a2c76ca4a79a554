//! The duties of the speed measurement: steps of both valves that never repeat together soon.
//!
//! It is the schedule of the C program that the figures are compared with in `docs/performance.md`, so that both
//! end at the same pressures, which shows that both simulate the same plant.

/// Duties of both valves at tick `tick`: three levels each, 50 and 70 ticks long.
pub(crate) fn duty(tick: u32) -> [f64; 2] {
    let level = |ticks: u32| f64::from(tick / ticks % 3) - 1.0;
    [0.85 + 0.1 * level(50), 0.82 + 0.08 * level(70)]
}

#[cfg(test)]
mod tests {
    use super::duty;

    #[test]
    fn levels_change_every_50_and_70_ticks() {
        let near = |tick: u32, expected: [f64; 2]| {
            let found = duty(tick);
            // One rounding of numbers near one.
            assert!(found.iter().zip(expected).all(|(f, e)| (f - e).abs() < 1e-15), "{tick}: {found:?}");
        };
        near(0, [0.75, 0.74]);
        near(50, [0.85, 0.74]);
        near(70, [0.85, 0.82]);
        near(149, [0.95, 0.90]);
        near(150, [0.75, 0.90]);
        near(210, [0.85, 0.74]);
    }
}
