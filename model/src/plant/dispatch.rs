//! The tick compiled for each instruction set, chosen once when a simulation is made.
//!
//! The same source, inlined under `#[target_feature]`; since every operation is correctly rounded, both
//! give the same bits. Without fused multiply-add in hardware (before 2013) the fallback calls the
//! software one: right, and still fast enough for the daemon, but an order of magnitude slower.
//!
//! AVX-512 was tried and left out: on the machine of `docs/performance.md`, whose 512-bit operations are
//! pairs of 256-bit ones, eight lanes ran at 0.5 to 1.0 times the speed of AVX2.

use super::integrate::tick;
use super::{Plant, Scratch, State};
use crate::real::Real;

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

    /// Whether this machine runs it.
    pub fn is_available(self) -> bool {
        self == InstructionSet::Baseline || self == Self::detect()
    }
}

/// Advances `state` by one tick on `set`, which must be available.
pub(crate) fn advance<R: Real>(
    set: InstructionSet,
    plant: &Plant<R>,
    state: &mut State<R>,
    scratch: &mut Scratch<R>,
    inputs: &[R],
) {
    match set {
        // SAFETY: simulations are only made with a set that `is_available`, so the CPU has these features.
        #[cfg(target_arch = "x86_64")]
        #[allow(unsafe_code)]
        InstructionSet::Avx2 => unsafe { advance_avx2(plant, state, scratch, inputs) },
        _ => tick(plant, state, scratch, inputs),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn advance_avx2<R: Real>(plant: &Plant<R>, state: &mut State<R>, scratch: &mut Scratch<R>, inputs: &[R]) {
    tick(plant, state, scratch, inputs);
}
