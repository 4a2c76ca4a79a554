//! The tick, and the ripple that is read between ticks, compiled for each instruction set, chosen once when a simulation is made.
//!
//! The same source, inlined under `#[target_feature]`; since every operation is correctly rounded, both
//! give the same bits. Without fused multiply-add in hardware (before 2013) the fallback calls the
//! software one: right, and still fast enough for the daemon, but an order of magnitude slower.
//!
//! AVX-512 was tried and left out: on the machine of `docs/performance.md`, whose 512-bit operations are
//! pairs of 256-bit ones, eight lanes ran at 0.5 to 1.0 times the speed of AVX2; on one with whole units, fits ran at 0.96.

use super::integrate::tick;
use super::sensor::Filter;
use super::{Plant, Scratch, State};
use crate::real::{Lanes, Real};

/// An instruction set the tick is compiled for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InstructionSet {
    /// AVX2 with fused multiply-add.
    Avx2,
    /// Whatever the build targets.
    Baseline,
}

impl InstructionSet {
    /// The fastest that this machine runs.
    pub fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("fma") && is_x86_feature_detected!("avx2") {
            return InstructionSet::Avx2;
        }
        InstructionSet::Baseline
    }

    /// Tells whether this machine runs it.
    pub fn is_available(self) -> bool {
        self == InstructionSet::Baseline || self == Self::detect()
    }
}

/// The bundles that the tick is compiled for: one rig, and four or eight side by side.
///
/// A closed list, so that the tick is compiled here once and not again in every crate that simulates.
pub trait Simulated: Real + sealed::Tick {}

impl Simulated for f64 {}
impl Simulated for Lanes<4> {}
impl Simulated for Lanes<8> {}

pub(crate) mod sealed {
    use super::{Filter, InstructionSet, Plant, Scratch, State};

    /// Code that is compiled for a set, which must be available.
    pub trait Tick: Sized {
        /// One tick.
        #[doc(hidden)]
        fn advance(
            set: InstructionSet,
            plant: &Plant<Self>,
            state: &mut State<Self>,
            scratch: &mut Scratch<Self>,
            inputs: &[Self],
        );

        /// Addition of averaged pumps' ripple to a chamber's pressure, [`Plant::ripple_at`].
        #[doc(hidden)]
        fn ripple(
            set: InstructionSet,
            plant: &Plant<Self>,
            state: &State<Self>,
            speeds: &[Self],
            node: usize,
            seen: &Filter<Self>,
        ) -> Self;
    }
}

macro_rules! compile_tick {
    ($bundle:ty) => {
        impl sealed::Tick for $bundle {
            fn advance(
                set: InstructionSet,
                plant: &Plant<Self>,
                state: &mut State<Self>,
                scratch: &mut Scratch<Self>,
                inputs: &[Self],
            ) {
                #[cfg(target_arch = "x86_64")]
                #[target_feature(enable = "avx2,fma")]
                fn avx2(
                    plant: &Plant<$bundle>,
                    state: &mut State<$bundle>,
                    scratch: &mut Scratch<$bundle>,
                    inputs: &[$bundle],
                ) {
                    tick(plant, state, scratch, inputs);
                }
                match set {
                    // SAFETY: simulations are only made with a set that `is_available`, so the CPU has these features.
                    #[cfg(target_arch = "x86_64")]
                    #[allow(unsafe_code)]
                    InstructionSet::Avx2 => unsafe { avx2(plant, state, scratch, inputs) },
                    _ => tick(plant, state, scratch, inputs),
                }
            }

            fn ripple(
                set: InstructionSet,
                plant: &Plant<Self>,
                state: &State<Self>,
                speeds: &[Self],
                node: usize,
                seen: &Filter<Self>,
            ) -> Self {
                #[cfg(target_arch = "x86_64")]
                #[target_feature(enable = "avx2,fma")]
                fn avx2(
                    plant: &Plant<$bundle>,
                    state: &State<$bundle>,
                    speeds: &[$bundle],
                    node: usize,
                    seen: &Filter<$bundle>,
                ) -> $bundle {
                    plant.ripple_at(state, speeds, node, seen)
                }
                match set {
                    // SAFETY: as above.
                    #[cfg(target_arch = "x86_64")]
                    #[allow(unsafe_code)]
                    InstructionSet::Avx2 => unsafe { avx2(plant, state, speeds, node, seen) },
                    _ => plant.ripple_at(state, speeds, node, seen),
                }
            }
        }
    };
}

// A module each, for that is what the compiler works on side by side (`codegen-units` in `Cargo.toml`).
mod one {
    use super::*;
    compile_tick!(f64);
}
mod four {
    use super::*;
    compile_tick!(Lanes<4>);
}
mod eight {
    use super::*;
    compile_tick!(Lanes<8>);
}
