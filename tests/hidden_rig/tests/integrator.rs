//! The integrator against closed forms: accuracy follows the tolerance, switches are met where they are.

use std::f64::consts::{PI, TAU};

use hidden_rig::integrate::{DormandPrince, Switched, Tolerance};

fn integrator<const N: usize>(relative: f64, longest_s: f64) -> DormandPrince<N> {
    DormandPrince::new(Tolerance { relative, scales: [1.0; N], longest_s })
}

/// A mass on a spring: (cos t, −sin t).
struct Oscillator;

impl Switched<2, 0> for Oscillator {
    fn rates(&self, _time_s: f64, state: &[f64; 2], rates: &mut [f64; 2]) {
        *rates = [state[1], -state[0]];
    }
    fn guards(&self, _time_s: f64, _state: &[f64; 2]) -> [f64; 0] {
        []
    }
    fn switches(&self) -> [bool; 0] {
        []
    }
    fn flip(&mut self, _switch: usize) {}
}

#[test]
fn accuracy_follows_the_tolerance_at_the_price_of_a_fifth_order_method() {
    let solve = |relative: f64| {
        let mut state = [1.0, 0.0];
        let mut method = integrator(relative, 10.0);
        method.advance(&mut Oscillator, &mut state, 0.0, 10.0 * TAU);
        ((state[0] - 1.0).hypot(state[1]), method.effort().steps as f64)
    };
    let coarse = solve(1e-5);
    let fine = solve(1e-10);
    // Errors add up over some hundred steps, none larger than permitted.
    assert!(coarse.0 < 100.0 * 1e-5 && fine.0 < 1000.0 * 1e-10, "{coarse:?} {fine:?}");
    // Five decades of tolerance are one of step length for a fifth-order method.
    let ratio = fine.1 / coarse.1;
    assert!((7.0..14.0).contains(&ratio), "{ratio}");
}

/// A clock that runs only while the sine is positive.
struct HalfTime {
    on: bool,
}

impl Switched<1, 1> for HalfTime {
    fn rates(&self, _time_s: f64, _state: &[f64; 1], rates: &mut [f64; 1]) {
        *rates = [f64::from(u8::from(self.on))];
    }
    fn guards(&self, time_s: f64, _state: &[f64; 1]) -> [f64; 1] {
        [time_s.sin()]
    }
    fn switches(&self) -> [bool; 1] {
        [self.on]
    }
    fn flip(&mut self, _switch: usize) {
        self.on = !self.on;
    }
}

#[test]
fn switches_turn_over_where_their_guard_changes_sign() {
    let mut state = [0.0];
    let mut method = integrator(1e-6, 0.3);
    method.advance(&mut HalfTime { on: true }, &mut state, 1e-9, 20.0 * PI - 1e-3);
    assert_eq!(method.effort().events, 19);
    // A crossing is found to 1/4096 of a step of at most 0.3, always late; on and off make up for each other in part.
    assert!((state[0] - 10.0 * PI).abs() < 10.0 * 0.3 / 4096.0, "{}", state[0]);
}

#[test]
fn a_stretch_ends_exactly_and_pieces_make_the_whole() {
    let mut whole = [1.0, 0.0];
    integrator(1e-9, 1.0).advance(&mut Oscillator, &mut whole, 0.0, 3.0);
    let mut pieces = [1.0, 0.0];
    let mut method = integrator(1e-9, 1.0);
    for k in 0..30 {
        method.advance(&mut Oscillator, &mut pieces, 0.1 * f64::from(k), 0.1 * f64::from(k + 1));
    }
    for i in 0..2 {
        assert!((whole[i] - pieces[i]).abs() < 1e-7);
    }
    assert!((whole[0] - 3.0_f64.cos()).abs() < 1e-7);
}
