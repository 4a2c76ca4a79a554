//! Adaptive Dormand–Prince 5(4) with switching surfaces.
//!
//! Dormand and Prince (1980), coefficients and step-size control after Hairer, Nørsett and Wanner, *Solving Ordinary
//! Differential Equations I*, section II.4. A system may carry switches (a check valve that is open or shut), each with
//! a guard whose sign it follows. A step that ends with a guard on the other side is shortened to the crossing, found
//! on the cubic Hermite curve through the step's ends; there the switch is flipped. So no step straddles a kink, and
//! the order of the method holds between the events.

/// A system of `N` states with `G` switches.
pub trait Switched<const N: usize, const G: usize> {
    /// Time derivatives of the states, with the switches as they stand.
    fn rates(&self, time_s: f64, state: &[f64; N], rates: &mut [f64; N]);

    /// One number per switch; it is on while its guard is positive.
    fn guards(&self, time_s: f64, state: &[f64; N]) -> [f64; G];

    /// Positions of the switches.
    fn switches(&self) -> [bool; G];

    /// Turns one switch over.
    fn flip(&mut self, switch: usize);

    /// Called after each accepted step; true if something in the system jumped and the rates must be taken anew.
    fn settle(&mut self, _time_s: f64, _state: &[f64; N]) -> bool {
        false
    }
}

/// Precision of the steps.
#[derive(Debug, Clone, PartialEq)]
pub struct Tolerance<const N: usize> {
    /// Permitted error of a step, relative to the state or its scale, whichever is larger.
    pub relative: f64,
    /// Scale of each state: below it, errors count against the scale.
    pub scales: [f64; N],
    /// Longest step (s).
    pub longest_s: f64,
}

/// Cost of an integration.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Effort {
    /// Accepted steps.
    pub steps: u64,
    /// Steps taken back because their error was too large.
    pub rejected: u64,
    /// Switches turned over.
    pub events: u64,
}

/// The integrator's own memory: the next step's length, and what it has cost so far.
#[derive(Debug, Clone)]
pub struct DormandPrince<const N: usize> {
    tolerance: Tolerance<N>,
    step_s: f64,
    /// Error of the last accepted step, for the proportional part of the step-size control.
    last_error: f64,
    effort: Effort,
}

/// Weight of the last error in the step-size control (Hairer's β): steadies the step where stability limits it.
const BETA: f64 = 0.04;
/// No step is shorter (s): a stuck integration ends in wrong numbers that tests find, not in an endless loop.
const SHORTEST_S: f64 = 1e-9;

impl<const N: usize> DormandPrince<N> {
    /// An integrator at rest.
    pub fn new(tolerance: Tolerance<N>) -> Self {
        let step_s = 0.1 * tolerance.longest_s;
        Self { tolerance, step_s, last_error: 1.0, effort: Effort::default() }
    }

    /// Cost so far.
    pub fn effort(&self) -> Effort {
        self.effort
    }

    /// Carries `state` from `from_s` to `to_s`.
    pub fn advance<const G: usize>(
        &mut self,
        system: &mut impl Switched<N, G>,
        state: &mut [f64; N],
        from_s: f64,
        to_s: f64,
    ) {
        let mut time_s = from_s;
        let mut first = [0.0; N];
        system.rates(time_s, state, &mut first);
        let mut just_rejected = false;
        while time_s < to_s {
            let left_s = to_s - time_s;
            // A last sliver would cost a whole step: stretch or halve instead.
            let wanted_s = self.step_s.min(self.tolerance.longest_s);
            let step_s = if wanted_s >= 0.999 * left_s {
                left_s
            } else if wanted_s > 0.5 * left_s {
                0.5 * left_s
            } else {
                wanted_s
            };
            let trial = Trial::step(system, time_s, state, &first, step_s);
            let error = trial.error(&self.tolerance, state);
            if error > 1.0 && step_s > SHORTEST_S {
                self.effort.rejected += 1;
                self.step_s = step_s * (0.9 * error.powf(-0.2)).max(0.2);
                just_rejected = true;
                continue;
            }
            let crossing = first_crossing(system, time_s, step_s, state, &first, &trial);
            let (taken, length_s) = match crossing {
                Some((switch, share)) if share < 1.0 => {
                    let length_s = (share * step_s).max(SHORTEST_S);
                    let shorter = Trial::step(system, time_s, state, &first, length_s);
                    system.flip(switch);
                    self.effort.events += 1;
                    (shorter, length_s)
                }
                Some((switch, _)) => {
                    system.flip(switch);
                    self.effort.events += 1;
                    (trial, step_s)
                }
                None => (trial, step_s),
            };
            *state = taken.end;
            // The last step of a stretch lands on its end exactly: sums of steps would miss it by rounding.
            time_s = if length_s == left_s { to_s } else { time_s + length_s };
            self.effort.steps += 1;
            let jumped = system.settle(time_s, state);
            if crossing.is_some() || jumped {
                system.rates(time_s, state, &mut first);
            } else {
                first = taken.last;
                // Steps cut short by the end of a stretch say nothing about the next one.
                let error = error.max(1e-6);
                let growth = 0.9 * error.powf(BETA * 0.75 - 0.2) * self.last_error.powf(BETA);
                let grown_s = step_s * growth.clamp(0.2, if just_rejected { 1.0 } else { 4.0 });
                self.step_s = if step_s < wanted_s { self.step_s.max(grown_s) } else { grown_s };
                self.last_error = error.max(1e-4);
            }
            just_rejected = false;
        }
    }
}

/// A step that has been tried.
struct Trial<const N: usize> {
    end: [f64; N],
    last: [f64; N],
    error: [f64; N],
}

impl<const N: usize> Trial<N> {
    #[inline]
    fn step<const G: usize>(
        system: &impl Switched<N, G>,
        time_s: f64,
        start: &[f64; N],
        k1: &[f64; N],
        h: f64,
    ) -> Self {
        let mut k = [[0.0; N]; 5];
        let mut at = [0.0; N];
        for i in 0..N {
            at[i] = start[i] + h * (0.2 * k1[i]);
        }
        system.rates(time_s + 0.2 * h, &at, &mut k[0]);
        for i in 0..N {
            at[i] = start[i] + h * (3.0 / 40.0 * k1[i] + 9.0 / 40.0 * k[0][i]);
        }
        system.rates(time_s + 0.3 * h, &at, &mut k[1]);
        for i in 0..N {
            at[i] = start[i] + h * (44.0 / 45.0 * k1[i] - 56.0 / 15.0 * k[0][i] + 32.0 / 9.0 * k[1][i]);
        }
        system.rates(time_s + 0.8 * h, &at, &mut k[2]);
        for i in 0..N {
            at[i] = start[i]
                + h * (19372.0 / 6561.0 * k1[i] - 25360.0 / 2187.0 * k[0][i] + 64448.0 / 6561.0 * k[1][i]
                    - 212.0 / 729.0 * k[2][i]);
        }
        system.rates(time_s + 8.0 / 9.0 * h, &at, &mut k[3]);
        for i in 0..N {
            at[i] = start[i]
                + h * (9017.0 / 3168.0 * k1[i] - 355.0 / 33.0 * k[0][i]
                    + 46732.0 / 5247.0 * k[1][i]
                    + 49.0 / 176.0 * k[2][i]
                    - 5103.0 / 18656.0 * k[3][i]);
        }
        system.rates(time_s + h, &at, &mut k[4]);
        for i in 0..N {
            at[i] = start[i]
                + h * (35.0 / 384.0 * k1[i] + 500.0 / 1113.0 * k[1][i] + 125.0 / 192.0 * k[2][i]
                    - 2187.0 / 6784.0 * k[3][i]
                    + 11.0 / 84.0 * k[4][i]);
        }
        let mut last = [0.0; N];
        system.rates(time_s + h, &at, &mut last);
        let mut error = [0.0; N];
        for i in 0..N {
            error[i] = h
                * (71.0 / 57600.0 * k1[i] - 71.0 / 16695.0 * k[1][i] + 71.0 / 1920.0 * k[2][i]
                    - 17253.0 / 339_200.0 * k[3][i]
                    + 22.0 / 525.0 * k[4][i]
                    - 1.0 / 40.0 * last[i]);
        }
        Self { end: at, last, error }
    }

    /// The largest error beside what is permitted.
    #[inline]
    fn error(&self, tolerance: &Tolerance<N>, start: &[f64; N]) -> f64 {
        let scaled = |i: usize| self.error[i].abs() / start[i].abs().max(tolerance.scales[i]);
        let worst = (0..N).map(scaled).fold(0.0, worse);
        // A state that is no number must not pass for a precise one.
        if worst.is_finite() { worst / tolerance.relative } else { 1e9 }
    }
}

/// The larger of two errors, where one that is no number is the worst of all.
#[inline]
fn worse(a: f64, b: f64) -> f64 {
    if b > a || b.is_nan() { b } else { a }
}

/// The switch that turns over first in a step, and at which share of it.
fn first_crossing<const N: usize, const G: usize>(
    system: &impl Switched<N, G>,
    time_s: f64,
    step_s: f64,
    start: &[f64; N],
    first: &[f64; N],
    trial: &Trial<N>,
) -> Option<(usize, f64)> {
    let on = system.switches();
    let at_end = system.guards(time_s + step_s, &trial.end);
    let mut earliest: Option<(usize, f64)> = None;
    for switch in 0..G {
        if (at_end[switch] > 0.0) == on[switch] {
            continue;
        }
        let guard = |share: f64| {
            let at = hermite(step_s, share, start, first, trial);
            let value = system.guards(time_s + share * step_s, &at)[switch];
            // Positive where the switch stands right.
            if on[switch] { value } else { -value }
        };
        let wrong = bracket(guard, if on[switch] { -at_end[switch] } else { at_end[switch] });
        if earliest.is_none_or(|(_, share)| wrong < share) {
            earliest = Some((switch, wrong));
        }
    }
    earliest
}

/// Share of a step just past the root of a guard that is positive at its start and `-beyond` (not positive) at its end.
///
/// Regula falsi with the Illinois rule (Dowell and Jarratt, 1971) takes some five calls where halving takes twelve; a
/// guard that bends too much for it is halved. Ends with the root bracketed to 1/4096 of the step (some 25 ns).
fn bracket(guard: impl Fn(f64) -> f64, beyond: f64) -> f64 {
    const CLOSE: f64 = 1.0 / 4096.0;
    let (mut right, mut wrong) = (0.0, 1.0);
    let (mut right_value, mut wrong_value) = (guard(0.0).max(0.0), -beyond.max(0.0));
    let mut moved_right = None;
    for k in 0..24 {
        if wrong - right <= CLOSE {
            break;
        }
        let falsi = (right * wrong_value - wrong * right_value) / (wrong_value - right_value);
        // A point past the root by less than the bracket that is wanted ends the search from the other side.
        let middle = if k % 4 == 3 || !falsi.is_finite() {
            0.5 * (right + wrong)
        } else {
            falsi.clamp(right + 0.5 * CLOSE, wrong - 0.5 * CLOSE)
        };
        let value = guard(middle);
        let stays_right = value > 0.0;
        // The end that stays twice is given half its weight.
        let twice = moved_right == Some(stays_right);
        if stays_right {
            (right, right_value) = (middle, value);
            wrong_value *= if twice { 0.5 } else { 1.0 };
        } else {
            (wrong, wrong_value) = (middle, value);
            right_value *= if twice { 0.5 } else { 1.0 };
        }
        moved_right = Some(stays_right);
    }
    wrong
}

/// The cubic through both ends of a step and their slopes.
fn hermite<const N: usize>(step_s: f64, share: f64, start: &[f64; N], first: &[f64; N], trial: &Trial<N>) -> [f64; N] {
    let (s, r) = (share, 1.0 - share);
    let (from, slope_from) = (r * r * (1.0 + 2.0 * s), r * r * s * step_s);
    let (to, slope_to) = (s * s * (1.0 + 2.0 * r), -s * s * r * step_s);
    std::array::from_fn(|i| from * start[i] + slope_from * first[i] + to * trial.end[i] + slope_to * trial.last[i])
}
