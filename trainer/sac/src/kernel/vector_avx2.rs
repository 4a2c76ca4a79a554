//! Sixteen floats in two 256-bit registers.
#![allow(unsafe_code)] // reason: instructions that the target may lack, and unchecked loads

use std::arch::x86_64::*;

use super::vector::{Vector, transpose_by_element};

/// Sixteen floats in two registers.
#[derive(Clone, Copy)]
pub(crate) struct Avx2(__m256, __m256);

// SAFETY: every method needs AVX2 and FMA alone, which Cpu::run has checked; pointers are the caller's promise.
unsafe impl Vector for Avx2 {
    // 8 of the 16 registers hold sums, enough to cover the latency of two FMA units.
    const ROWS: usize = 2;

    #[inline(always)]
    unsafe fn splat(x: f32) -> Self {
        // SAFETY: AVX is there.
        let x = unsafe { _mm256_set1_ps(x) };
        Self(x, x)
    }
    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: AVX is there and the caller vouches for 16 floats.
        unsafe { Self(_mm256_loadu_ps(from), _mm256_loadu_ps(from.add(8))) }
    }
    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        // SAFETY: AVX is there and the caller vouches for 16 floats.
        unsafe {
            _mm256_storeu_ps(to, self.0);
            _mm256_storeu_ps(to.add(8), self.1);
        }
    }
    #[inline(always)]
    unsafe fn plus_product(self, a: Self, b: Self) -> Self {
        // SAFETY: FMA is there.
        unsafe { Self(_mm256_fmadd_ps(a.0, b.0, self.0), _mm256_fmadd_ps(a.1, b.1, self.1)) }
    }
    #[inline(always)]
    unsafe fn rectified(self) -> Self {
        // SAFETY: AVX is there. With a NaN the instruction gives its second operand, which is `self`.
        unsafe {
            let zero = _mm256_setzero_ps();
            Self(_mm256_max_ps(zero, self.0), _mm256_max_ps(zero, self.1))
        }
    }
    #[inline(always)]
    unsafe fn positive(self) -> u16 {
        // SAFETY: AVX is there.
        unsafe {
            let zero = _mm256_setzero_ps();
            let low = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(self.0, zero));
            let high = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(self.1, zero));
            (low | high << 8) as u16
        }
    }
    #[inline(always)]
    unsafe fn where_set(self, bits: u16) -> Self {
        // SAFETY: AVX2 is there.
        unsafe {
            let bits = _mm256_set1_epi32(i32::from(bits));
            let low = _mm256_set_epi32(128, 64, 32, 16, 8, 4, 2, 1);
            let high = _mm256_slli_epi32::<8>(low);
            let set = |lane| _mm256_castsi256_ps(_mm256_cmpeq_epi32(_mm256_and_si256(bits, lane), lane));
            Self(_mm256_and_ps(set(low), self.0), _mm256_and_ps(set(high), self.1))
        }
    }
    #[inline(always)]
    unsafe fn transpose(from: *const f32, from_step: usize, to: *mut f32, to_step: usize) {
        // SAFETY: the caller's promise is the same.
        unsafe { transpose_by_element(from, from_step, to, to_step) }
    }
}
