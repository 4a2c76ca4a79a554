//! Asking for memory before it is needed.

/// Asks the caches for these floats; changes nothing else. A replay of hundreds of megabytes is drawn from at
/// random, and each row would otherwise cost the memory's full latency.
#[inline(always)]
pub(crate) fn prefetch(floats: &[f32]) {
    for line in floats.chunks(16) {
        touch(line.as_ptr().cast());
    }
}

/// Asks for the cache line that holds this address.
#[inline(always)]
#[allow(unsafe_code)] // reason: a hint; it may name any address
pub(super) fn touch(address: *const u8) {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: SSE belongs to the architecture, and a prefetch never faults, whatever the address.
    unsafe {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        _mm_prefetch::<_MM_HINT_T0>(address.cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = address;
}
