//! Sixteen floats at once: what the tiles are written in.
#![allow(unsafe_code)] // reason: unchecked loads in the innermost loops, and instructions that the target may lack

/// Sixteen floats in registers.
///
/// # Safety
/// The methods may only be called where the processor has the implementor's instructions, that is inside
/// [`super::Cpu::run`]; pointers must be good for 16 floats.
pub(crate) unsafe trait Vector: Copy {
    /// Rows of a tile of two vectors a row that fit the registers: 12, 8, 4, 2 or 1.
    const ROWS: usize;
    unsafe fn splat(x: f32) -> Self;
    unsafe fn load(from: *const f32) -> Self;
    unsafe fn store(self, to: *mut f32);
    /// `self + a · b`, rounded once.
    unsafe fn plus_product(self, a: Self, b: Self) -> Self;
    /// `max(self, 0)`; a NaN stays one, so that a diverging run is seen.
    unsafe fn rectified(self) -> Self;
    /// Bit `l` is whether lane `l` is above zero.
    unsafe fn positive(self) -> u16;
    /// Lane `l` where bit `l` is set, else zero.
    unsafe fn where_set(self, bits: u16) -> Self;
    /// Writes `to[j][i] = from[i][j]` for 16 rows of 16, rows `from_step` and `to_step` floats apart.
    unsafe fn transpose(from: *const f32, from_step: usize, to: *mut f32, to_step: usize);
}

/// Sixteen floats in whatever registers the compiler's target has.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(crate) struct Portable([f32; 16]);

/// The transposition without shuffles: 256 loads and stores.
///
/// # Safety
/// As [`Vector::transpose`].
#[inline(always)]
pub(super) unsafe fn transpose_by_element(from: *const f32, from_step: usize, to: *mut f32, to_step: usize) {
    for i in 0..16 {
        for j in 0..16 {
            // SAFETY: the caller vouches for 16 rows of 16 floats on both sides.
            unsafe { *to.add(j * to_step + i) = *from.add(i * from_step + j) };
        }
    }
}

// SAFETY: plain Rust, no instruction that could be missing.
unsafe impl Vector for Portable {
    const ROWS: usize = 2;

    #[inline(always)]
    unsafe fn splat(x: f32) -> Self {
        Self([x; 16])
    }
    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: the caller vouches for 16 floats.
        Self(unsafe { from.cast::<[f32; 16]>().read_unaligned() })
    }
    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        // SAFETY: the caller vouches for 16 floats.
        unsafe { to.cast::<[f32; 16]>().write_unaligned(self.0) };
    }
    #[inline(always)]
    unsafe fn plus_product(mut self, a: Self, b: Self) -> Self {
        for l in 0..16 {
            self.0[l] = a.0[l].mul_add(b.0[l], self.0[l]);
        }
        self
    }
    #[inline(always)]
    unsafe fn rectified(self) -> Self {
        Self(self.0.map(|x| if x < 0.0 { 0.0 } else { x }))
    }
    #[inline(always)]
    unsafe fn positive(self) -> u16 {
        (0..16).fold(0, |bits, l| bits | u16::from(self.0[l] > 0.0) << l)
    }
    #[inline(always)]
    unsafe fn where_set(mut self, bits: u16) -> Self {
        for l in 0..16 {
            self.0[l] = if bits >> l & 1 == 1 { self.0[l] } else { 0.0 };
        }
        self
    }
    #[inline(always)]
    unsafe fn transpose(from: *const f32, from_step: usize, to: *mut f32, to_step: usize) {
        // SAFETY: the caller's promise is the same.
        unsafe { transpose_by_element(from, from_step, to, to_step) }
    }
}
