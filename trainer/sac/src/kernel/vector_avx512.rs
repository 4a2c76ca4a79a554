//! Sixteen floats in one 512-bit register.
#![allow(unsafe_code)] // reason: instructions that the target may lack, and unchecked loads

use std::arch::x86_64::*;

use super::vector::Vector;

/// Sixteen floats in one register.
#[derive(Clone, Copy)]
pub(crate) struct Avx512(__m512);

// SAFETY: every method needs AVX-512 F alone, which Cpu::run has checked; pointers are the caller's promise.
unsafe impl Vector for Avx512 {
    // 24 of the 32 registers hold sums; 8 rows (16 sums) read a panel half as often again and are a tenth slower.
    const ROWS: usize = 12;

    #[inline(always)]
    unsafe fn splat(x: f32) -> Self {
        // SAFETY: AVX-512 F is there.
        Self(unsafe { _mm512_set1_ps(x) })
    }
    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: AVX-512 F is there and the caller vouches for 16 floats.
        Self(unsafe { _mm512_loadu_ps(from) })
    }
    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        // SAFETY: AVX-512 F is there and the caller vouches for 16 floats.
        unsafe { _mm512_storeu_ps(to, self.0) }
    }
    #[inline(always)]
    unsafe fn plus_product(self, a: Self, b: Self) -> Self {
        // SAFETY: AVX-512 F is there.
        Self(unsafe { _mm512_fmadd_ps(a.0, b.0, self.0) })
    }
    #[inline(always)]
    unsafe fn rectified(self) -> Self {
        // SAFETY: AVX-512 F is there. With a NaN the instruction gives its second operand, which is `self`.
        Self(unsafe { _mm512_max_ps(_mm512_setzero_ps(), self.0) })
    }
    #[inline(always)]
    unsafe fn positive(self) -> u16 {
        // SAFETY: AVX-512 F is there.
        unsafe { _mm512_cmp_ps_mask::<_CMP_GT_OQ>(self.0, _mm512_setzero_ps()) }
    }
    #[inline(always)]
    unsafe fn where_set(self, bits: u16) -> Self {
        // SAFETY: AVX-512 F is there.
        Self(unsafe { _mm512_maskz_mov_ps(bits, self.0) })
    }
    /// Four rounds of swapping ever larger quarters, in registers.
    #[inline(always)]
    unsafe fn transpose(from: *const f32, from_step: usize, to: *mut f32, to_step: usize) {
        // SAFETY: AVX-512 F is there, and the caller vouches for 16 rows of 16 floats on both sides.
        unsafe {
            let mut rows = [_mm512_setzero_ps(); 16];
            for (i, row) in rows.iter_mut().enumerate() {
                *row = _mm512_loadu_ps(from.add(i * from_step));
            }
            // Within each 128-bit lane: a 4 x 4 transposition of four neighbouring rows.
            let mut fours = [_mm512_setzero_ps(); 16];
            for (quad, out) in rows.chunks_exact(4).zip(fours.chunks_exact_mut(4)) {
                let low = [_mm512_unpacklo_ps(quad[0], quad[1]), _mm512_unpacklo_ps(quad[2], quad[3])];
                let high = [_mm512_unpackhi_ps(quad[0], quad[1]), _mm512_unpackhi_ps(quad[2], quad[3])];
                out[0] = _mm512_shuffle_ps::<0b01_00_01_00>(low[0], low[1]);
                out[1] = _mm512_shuffle_ps::<0b11_10_11_10>(low[0], low[1]);
                out[2] = _mm512_shuffle_ps::<0b01_00_01_00>(high[0], high[1]);
                out[3] = _mm512_shuffle_ps::<0b11_10_11_10>(high[0], high[1]);
            }
            // Then a 4 x 4 transposition of whole lanes: column 4 lane + j takes lane `lane` of out[j] of each quad.
            for j in 0..4 {
                let [a, b, c, d] = [fours[j], fours[4 + j], fours[8 + j], fours[12 + j]];
                let even = [_mm512_shuffle_f32x4::<0b10_00_10_00>(a, b), _mm512_shuffle_f32x4::<0b10_00_10_00>(c, d)];
                let odd = [_mm512_shuffle_f32x4::<0b11_01_11_01>(a, b), _mm512_shuffle_f32x4::<0b11_01_11_01>(c, d)];
                let columns = [
                    _mm512_shuffle_f32x4::<0b10_00_10_00>(even[0], even[1]),
                    _mm512_shuffle_f32x4::<0b10_00_10_00>(odd[0], odd[1]),
                    _mm512_shuffle_f32x4::<0b11_01_11_01>(even[0], even[1]),
                    _mm512_shuffle_f32x4::<0b11_01_11_01>(odd[0], odd[1]),
                ];
                for (lane, column) in columns.into_iter().enumerate() {
                    _mm512_storeu_ps(to.add((4 * lane + j) * to_step), column);
                }
            }
        }
    }
}
