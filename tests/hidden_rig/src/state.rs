//! The states of the plant: what each of the numbers that are integrated stands for.

/// Crank angle (rad).
pub const CRANK: usize = 0;
/// Speed of the crank (rad/s).
pub const SPEED: usize = 1;
/// Mass (kg) and energy (J) of cylinder 1, then of cylinder 2.
pub const CYLINDER: usize = 2;
/// Mass (kg) and energy (J) of the positive, then of the negative chamber.
pub const CHAMBER: usize = 6;
/// Volume of the chambers (m³).
pub const VOLUME: usize = 10;
/// Lift of the flappers (m); below 0 it counts as shut.
pub const LIFT: usize = 12;
/// Speed of the flappers (m/s).
pub const LIFT_SPEED: usize = 14;
/// Current of the coils, as share of full scale.
pub const CURRENT: usize = 16;
/// Mass (kg) in the pockets.
pub const POCKET: usize = 18;
/// The two snubber states (Pa gauge) of the positive, then of the negative sensor.
pub const SNUBBER: usize = 20;
/// Pressure (Pa gauge) and rate (Pa/s) of the positive, then of the negative sensing line.
pub const SENSING: usize = 24;
/// Mass (kg) and energy (J) that cylinders and chambers have received from all that is not cylinder or chamber.
pub const LEDGER: usize = 28;
/// Number of states.
pub const STATES: usize = 30;

/// All states of the plant.
pub type State = [f64; STATES];

/// Scales below which errors count absolutely (the states' own units).
pub fn scales() -> State {
    let mut scales = [1.0; STATES];
    // An angle grows without end; its error must not be measured against it. 0.1 rad of 0.1 % is 0.3 µs of a turn.
    scales[SPEED] = 300.0;
    for k in 0..4 {
        scales[CYLINDER + k] = if k % 2 == 0 { 5e-6 } else { 1.0 };
        scales[CHAMBER + k] = if k % 2 == 0 { 1e-4 } else { 10.0 };
        scales[SNUBBER + k] = 1e4;
        scales[SENSING + k] = if k % 2 == 0 { 1e4 } else { 1e5 };
    }
    for c in 0..2 {
        scales[VOLUME + c] = 1e-4;
        scales[LIFT + c] = 1e-4;
        scales[LIFT_SPEED + c] = 1e-2;
        scales[CURRENT + c] = 0.3;
        scales[POCKET + c] = 1e-5;
        scales[LEDGER + c] = if c == 0 { 1e-3 } else { 100.0 };
    }
    scales
}
