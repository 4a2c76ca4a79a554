//! Flow through a valve whose area is no plain line in duty: one that is limited, held by friction, tabled, or in series with
//! something else.

use crate::mechanism::Stick;
use crate::orifice::FlowFunction;
use crate::plant::elements::ShapedVent;
use crate::real::Real;

/// Steps at most for a valve with something in series: a line as wide as the valve takes four, one fifty times narrower
/// eighteen.
const SERIES_STEPS: usize = 40;
/// Chords among them before every other step halves the bracket instead: a valve that its spring keeps shut up to some
/// difference has a kink that chords are slow at.
const SERIES_CHORDS: usize = 10;
/// Share of the squared flow at which they stop.
const SERIES_TOLERANCE: f64 = 1e-10;

/// Areas that forces on a flapper open.
#[derive(Clone, Copy)]
struct Lifted<R> {
    /// By duty, spring and a table, in m².
    by: R,
    /// By the pressure difference, in m²/Pa, and by its square, in m²/Pa².
    pushed: [R; 2],
}

impl<R: Real> ShapedVent<R> {
    /// A P Φ through the valve in N: mass flow times √(R T). `held` is what friction holds the flapper at, in duty.
    #[inline(always)]
    pub(crate) fn flow(&self, law: &FlowFunction<R>, duty: R, held: Option<R>, extra_area: R, [up, down]: [R; 2]) -> R {
        let pulled = held.unwrap_or(duty);
        let pushed = if held.is_some() { [R::splat(0.0); 2] } else { [self.pressure_area, self.pressure_curvature] };
        let lifted = Lifted { by: self.input_area.mul_add(pulled, extra_area) - self.spring_area, pushed };
        if self.restricted { self.in_series(law, lifted, up, down) } else { self.through(law, lifted, up, down) }
    }

    /// Valve with its ports exchanged, for gas that passes the other way: what pushed the flapper open now pushes it shut.
    #[inline(always)]
    pub(super) fn mirrored(&self) -> Self {
        ShapedVent {
            pressure_area: -self.pressure_area,
            upstream_drop: self.downstream_drop,
            downstream_drop: self.upstream_drop,
            ..*self
        }
    }

    /// Where friction holds the flapper (in duty) once a duty and pressures act that may break it loose; `swing` is how far
    /// the pumps take the difference of the pressures (in Pa) below and above these within a revolution.
    pub(crate) fn held_at(&self, held: R, duty: R, [up, down]: [R; 2], swing: [R; 2]) -> R {
        let difference = up - down;
        let slope = ((self.pressure_curvature + self.pressure_curvature).mul_add(difference, self.pressure_area))
            / self.input_area;
        let balance = self.balance(duty, up, down);
        let ends = swing.map(|pa| slope.mul_add(pa, balance));
        Stick { band: self.band, short: self.short }.moved_within(held, balance, ends)
    }

    /// All forces on the flapper but the spring's, in duty.
    #[inline(always)]
    pub(crate) fn balance(&self, duty: R, up: R, down: R) -> R {
        let difference = up - down;
        let pushed = self.pressure_curvature.mul_add(difference, self.pressure_area) * difference;
        duty + pushed / self.input_area
    }

    /// A P Φ of the valve alone.
    // A method, as is all that it takes below: closures would not be compiled for the instruction set of the tick.
    #[inline(always)]
    fn through(&self, law: &FlowFunction<R>, lifted: Lifted<R>, up: R, down: R) -> R {
        let difference = up - down;
        let [linear, curvature] = lifted.pushed;
        let lift = curvature.mul_add(difference, linear).mul_add(difference, lifted.by);
        let area = lift.at_least(R::splat(0.0));
        let full = area * self.inverse_full_area;
        let full2 = full * full;
        let limited = area / full2.mul_add(full2, R::splat(1.0)).sqrt().sqrt();
        limited * up * law.at_drop(difference / up)
    }

    /// By how much `y` exceeds the square of the flow that it leaves the valve.
    #[inline(always)]
    fn excess(&self, law: &FlowFunction<R>, lifted: Lifted<R>, up2: R, down2: R, y: R) -> R {
        let before = (up2 - self.upstream_drop * y).at_least(R::splat(0.0)).sqrt();
        let after = self.downstream_drop.mul_add(y, down2).sqrt();
        let flow = self.through(law, lifted, before, after);
        y - flow * flow
    }

    /// Solves for the flow through what is upstream, the valve, and what is downstream.
    ///
    /// With `y = (ṁ √(R T))²` the pressures at the valve are `P_up² − y/A²` and `P_down² + y/A²`, and `y` is where the
    /// square of the valve's own flow meets it. The difference `y − (valve)²` rises from below zero to above it between
    /// no flow and the flow that leaves the valve nothing. It is nearly straight, except where a narrow line meets a
    /// valve that opens with its pressure difference (then it goes with the third power of what is left); so chords
    /// keep the root bracketed, with the end that stays behind weighted down (Anderson and Björck, *BIT* 13, 1973). It
    /// is found to 1e-10 for lines of 1/5000 of the valve's area and wider.
    #[inline(always)]
    fn in_series(&self, law: &FlowFunction<R>, lifted: Lifted<R>, up: R, down: R) -> R {
        let (zero, one) = (R::splat(0.0), R::splat(1.0));
        let (up2, down2) = (up * up, down * down);
        // The flow that would leave the valve no difference.
        let most = ((up2 - down2) / (self.upstream_drop + self.downstream_drop)).at_least(zero);
        let (mut low, mut high) = (zero, most);
        let (mut below, mut above) = (self.excess(law, lifted, up2, down2, zero), most);
        // The first chord: the answer for a constant area and incompressible flow.
        let mut y = chord([low, high], [below, above], most);
        let mut open = one;
        let mut last = zero;
        for step in 0..SERIES_STEPS {
            let g = self.excess(law, lifted, up2, down2, y);
            // A lane that has arrived stays where it is, so that it has the bits it would have alone.
            open = open * R::from_lanes(|l| f64::from(g.lane(l).abs() > SERIES_TOLERANCE * y.lane(l)));
            if !open.any_above(zero) {
                break;
            }
            let side = g.map(|g| if g > 0.0 { 1.0 } else { -1.0 });
            let (is_above, is_below) = ((one + side) * R::splat(0.5), (one - side) * R::splat(0.5));
            // Twice on one side: the other end counts for less.
            let weight = R::from_lanes(|l| {
                let before = if side.lane(l) > 0.0 { above.lane(l) } else { below.lane(l) };
                let left = 1.0 - g.lane(l) / before;
                let weight = if left > 0.0 { left } else { 0.5 };
                if side.lane(l) == last.lane(l) { weight } else { 1.0 }
            });
            below = is_below * g + is_above * below * weight;
            above = is_above * g + is_below * above * weight;
            low = is_below * y + is_above * low;
            high = is_above * y + is_below * high;
            last = side;
            let next = if step < SERIES_CHORDS || step % 2 == 1 {
                chord([low, high], [below, above], most)
            } else {
                (low + high) * R::splat(0.5)
            };
            y = R::from_lanes(|l| if open.lane(l) > 0.0 { next.lane(l) } else { y.lane(l) });
        }
        y.sqrt()
    }
}

/// Where the line through a bracket's ends crosses zero, within 0 … `most`.
#[inline(always)]
fn chord<R: Real>([low, high]: [R; 2], [below, above]: [R; 2], most: R) -> R {
    let y = low + below * (high - low) / (below - above - R::splat(1e-300));
    y.limited(R::splat(0.0), most)
}
