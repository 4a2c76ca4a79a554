//! The inner loops, once in the source and three times in the program: AVX-512, AVX2 with FMA, portable.
//!
//! Everything is built of [`Line`]s, 16 floats in one cache line. A batch is cut into panels of [`LANES`] = 32
//! samples, and a panel of `F` values per sample lies *feature by feature*, two lines a feature:
//!
//! ```text
//! x[f] = (x_f of samples 0..16), (x_f of samples 16..32)
//! ```
//!
//! so that lanes run over samples. A sum over features or actions is then a sum of lines, in the order of the
//! source, whatever the width of the machine's registers: with fused products everywhere ([`f32::mul_add`] or its
//! instruction) **all three instruction sets and all numbers of threads give the same bits**.
//!
//! Weights `w[n][k]` (output `n`, input `k`) are only ever broadcast, so one copy serves both directions; they lie in
//! panels of 16 inputs, `lines[(k / 16) · row_step(rows) + n]`, which both directions read without a jump. Only the weight
//! gradient needs lanes over features: [`transpose`] turns the inputs of a layer into lines of 16 features of one
//! sample.
//!
//! `unsafe` lives in this module and nowhere else in the crate. A [`Work`] is compiled once per instruction set by
//! [`Cpu::run`]; a [`Cpu`] exists only for a set that the processor was asked for.

mod gradient;
mod line;
mod memory;
mod prefetch;
mod probe;
mod product;
mod transpose;
mod vector;
#[cfg(target_arch = "x86_64")]
mod vector_avx2;
#[cfg(target_arch = "x86_64")]
mod vector_avx512;

pub(crate) use gradient::{BiasStep, MomentumStep, WeightStep};
pub(crate) use line::{LANES, Line, WIDTH, lines_for, row_step};
pub(crate) use memory::{Lines, zeroed};
pub(crate) use prefetch::{prefer_large_pages, prefetch};
pub(crate) use probe::chained_products;
pub(crate) use product::{Backward, Forward, Gate, Rows, Weights};
pub(crate) use transpose::{ToFeatures, ToSamples};
use vector::Portable;
pub(crate) use vector::Vector;

/// The instruction sets that the kernels are compiled for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InstructionSet {
    /// 32 registers of 16 floats; the fastest.
    Avx512,
    /// AVX2 with FMA: 16 registers of 8 floats.
    Avx2,
    /// Whatever the compiler's target has. Exact everywhere; slow where there is no fused multiply-add.
    Portable,
}

/// An instruction set that this processor has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cpu(InstructionSet);

/// Something to compute, compiled for every instruction set. `run` must be `#[inline(always)]`: only then does the
/// compiler use the set's instructions in it.
pub(crate) trait Work {
    type Output;
    fn run<V: Vector>(self) -> Self::Output;
}

impl Cpu {
    /// The fastest set of this processor.
    pub fn best() -> Self {
        Self::all()[0]
    }

    /// All sets of this processor, the fastest first; never empty.
    pub fn all() -> Vec<Self> {
        use InstructionSet::*;
        [Avx512, Avx2, Portable].into_iter().filter_map(Self::with).collect()
    }

    /// This set, where the processor has it.
    pub fn with(set: InstructionSet) -> Option<Self> {
        let present = match set {
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512 => {
                is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("fma")
            }
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2 => is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
            #[cfg(not(target_arch = "x86_64"))]
            InstructionSet::Avx512 | InstructionSet::Avx2 => false,
            InstructionSet::Portable => true,
        };
        present.then_some(Self(set))
    }

    /// Which set it is.
    pub fn instruction_set(self) -> InstructionSet {
        self.0
    }

    /// Runs the work with this set's instructions.
    #[inline]
    #[allow(unsafe_code)] // reason: only here is it known that the processor has the set
    pub(crate) fn run<W: Work>(self, work: W) -> W::Output {
        match self.0 {
            // SAFETY: a Cpu of this set is made by `with` alone, which asked the processor for these features.
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512 => unsafe { on_avx512(work) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2 => unsafe { on_avx2(work) },
            _ => work.run::<Portable>(),
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512bw,avx512dq,avx2,fma")]
fn on_avx512<W: Work>(work: W) -> W::Output {
    work.run::<vector_avx512::Avx512>()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn on_avx2<W: Work>(work: W) -> W::Output {
    work.run::<vector_avx2::Avx2>()
}

#[cfg(test)]
mod tests;
