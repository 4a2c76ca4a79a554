//! The scalar that the physics is written over: one rig (`f64`) or many at once (`Lanes<N>`).
//!
//! Every formula in this crate is generic over [`Real`]. Instantiated with `f64` it is the daemon's
//! low-latency model; with [`Lanes`] each operation works on `N` rigs side by side, which the compiler
//! turns into SIMD. All operations are IEEE-754 and correctly rounded (`mul_add` included, fused by
//! definition), taken in the same order whatever the instantiation, so lane `i` of a lane run has the
//! bits of a single run of the same rig, on every machine. That is why nothing here is "fast math".
//!
//! Left out on purpose: comparison operators. Branches on lanes go through [`Real::any_above`] and
//! [`Real::all_at_least`], which makes every place visible where lanes must agree.

use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// A number, or a bundle of independent numbers, that the physics can be evaluated on.
///
/// # Real-time
/// All methods are branch-free or bounded, and none allocates.
pub trait Real:
    Copy
    + Send
    + Sync
    + std::fmt::Debug
    + PartialEq
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
{
    /// Number of independent rigs that one value carries.
    const LANES: usize;

    /// Value with one number in every lane.
    fn splat(value: f64) -> Self;

    /// Builds a value lane by lane.
    fn from_lanes(value: impl FnMut(usize) -> f64) -> Self;

    /// The number in lane `lane`; lanes beyond the last read as the last.
    fn lane(self, lane: usize) -> f64;

    /// Applies a scalar function to each lane (for per-tick work, where SIMD does not matter).
    fn map(self, f: impl FnMut(f64) -> f64) -> Self;

    /// `self * factor + addend`, rounded once.
    fn mul_add(self, factor: Self, addend: Self) -> Self;

    /// Square root; the argument is at least zero wherever the physics calls it.
    fn sqrt(self) -> Self;

    /// The larger of two numbers, lane by lane; `other` where either is NaN.
    fn at_least(self, other: Self) -> Self;

    /// The smaller of two numbers, lane by lane; `other` where either is NaN.
    fn at_most(self, other: Self) -> Self;

    /// Tells whether any lane of `self` exceeds `other`.
    fn any_above(self, other: Self) -> bool;

    /// Tells whether every lane of `self` is at least `other`.
    fn all_at_least(self, other: Self) -> bool;

    /// Tells whether in any lane exactly one of the two numbers is above zero.
    fn any_across_zero(self, other: Self) -> bool;

    /// Limits to `[low, high]`, lane by lane.
    #[inline(always)]
    fn limited(self, low: Self, high: Self) -> Self {
        self.at_least(low).at_most(high)
    }

    /// Tells whether every lane is finite.
    fn is_finite(self) -> bool;
}

impl Real for f64 {
    const LANES: usize = 1;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn from_lanes(mut value: impl FnMut(usize) -> f64) -> Self {
        value(0)
    }

    #[inline(always)]
    fn lane(self, _lane: usize) -> f64 {
        self
    }

    #[inline(always)]
    fn map(self, mut f: impl FnMut(f64) -> f64) -> Self {
        f(self)
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, addend: Self) -> Self {
        f64::mul_add(self, factor, addend)
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }

    // Written as comparisons: `f64::max` must look for NaN and costs three instructions instead of one.
    #[inline(always)]
    fn at_least(self, other: Self) -> Self {
        if self > other { self } else { other }
    }

    #[inline(always)]
    fn at_most(self, other: Self) -> Self {
        if self < other { self } else { other }
    }

    #[inline(always)]
    fn any_above(self, other: Self) -> bool {
        self > other
    }

    #[inline(always)]
    fn all_at_least(self, other: Self) -> bool {
        self >= other
    }

    #[inline(always)]
    fn any_across_zero(self, other: Self) -> bool {
        (self > 0.0) != (other > 0.0)
    }

    #[inline(always)]
    fn is_finite(self) -> bool {
        f64::is_finite(self)
    }
}

/// `N` independent numbers that travel together.
///
/// Aligned to a cache line so that eight of them are one AVX-512 register or two AVX2 registers.
///
/// Lanes are counted in plain `while` loops: an iterator's `next` is a function, which in a tick as long as ours the compiler at
/// some places does not inline but calls lane by lane.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(64))]
pub struct Lanes<const N: usize>(pub [f64; N]);

macro_rules! lanewise {
    ($trait:ident, $method:ident, $assign:tt) => {
        impl<const N: usize> $trait for Lanes<N> {
            type Output = Self;
            #[inline(always)]
            fn $method(mut self, other: Self) -> Self {
                let mut lane = 0;
                while lane < N {
                    self.0[lane] $assign other.0[lane];
                    lane += 1;
                }
                self
            }
        }
    };
}
lanewise!(Add, add, +=);
lanewise!(Sub, sub, -=);
lanewise!(Mul, mul, *=);
lanewise!(Div, div, /=);

impl<const N: usize> Neg for Lanes<N> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.each(|a| -a)
    }
}

impl<const N: usize> AddAssign for Lanes<N> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<const N: usize> Lanes<N> {
    #[inline(always)]
    fn each(mut self, f: impl Fn(f64) -> f64) -> Self {
        let mut lane = 0;
        while lane < N {
            self.0[lane] = f(self.0[lane]);
            lane += 1;
        }
        self
    }

    #[inline(always)]
    fn with(mut self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        let mut lane = 0;
        while lane < N {
            self.0[lane] = f(self.0[lane], other.0[lane]);
            lane += 1;
        }
        self
    }
}

impl<const N: usize> Real for Lanes<N> {
    const LANES: usize = N;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        Lanes([value; N])
    }

    #[inline(always)]
    fn from_lanes(mut value: impl FnMut(usize) -> f64) -> Self {
        // `array::from_fn` is compiled by itself, and calls `value` lane by lane.
        let mut lanes = [0.0; N];
        let mut lane = 0;
        while lane < N {
            lanes[lane] = value(lane);
            lane += 1;
        }
        Lanes(lanes)
    }

    #[inline(always)]
    fn lane(self, lane: usize) -> f64 {
        self.0.get(lane).or(self.0.last()).copied().unwrap_or(f64::NAN)
    }

    #[inline(always)]
    fn map(mut self, mut f: impl FnMut(f64) -> f64) -> Self {
        let mut lane = 0;
        while lane < N {
            self.0[lane] = f(self.0[lane]);
            lane += 1;
        }
        self
    }

    #[inline(always)]
    fn mul_add(mut self, factor: Self, addend: Self) -> Self {
        let mut lane = 0;
        while lane < N {
            self.0[lane] = self.0[lane].mul_add(factor.0[lane], addend.0[lane]);
            lane += 1;
        }
        self
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        self.each(f64::sqrt)
    }

    #[inline(always)]
    fn at_least(self, other: Self) -> Self {
        self.with(other, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    fn at_most(self, other: Self) -> Self {
        self.with(other, |a, b| if a < b { a } else { b })
    }

    #[inline(always)]
    fn any_above(self, other: Self) -> bool {
        let mut any = false;
        let mut lane = 0;
        while lane < N {
            any |= self.0[lane] > other.0[lane];
            lane += 1;
        }
        any
    }

    #[inline(always)]
    fn all_at_least(self, other: Self) -> bool {
        let mut all = true;
        let mut lane = 0;
        while lane < N {
            all &= self.0[lane] >= other.0[lane];
            lane += 1;
        }
        all
    }

    #[inline(always)]
    fn any_across_zero(self, other: Self) -> bool {
        let mut any = false;
        let mut lane = 0;
        while lane < N {
            any |= (self.0[lane] > 0.0) != (other.0[lane] > 0.0);
            lane += 1;
        }
        any
    }

    #[inline(always)]
    fn is_finite(self) -> bool {
        let mut all = true;
        let mut lane = 0;
        while lane < N {
            all &= self.0[lane].is_finite();
            lane += 1;
        }
        all
    }
}
