//! Asking for memory before it is needed.

use std::ops::Range;

/// Asks the caches for these floats; changes nothing else. A replay of hundreds of megabytes is drawn from at
/// random, and each row would otherwise cost the memory's full latency.
#[inline(always)]
pub(crate) fn prefetch(floats: &[f32]) {
    for line in floats.chunks(16) {
        touch(line.as_ptr().cast());
    }
    // Floats that begin amid a line end in one more.
    if let Some(last) = floats.last() {
        touch(std::ptr::from_ref(last).cast());
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

/// Asks the system for large pages under this range, before it is first written. Rows drawn at random from hundreds
/// of megabytes miss the address cache almost every time otherwise. Does nothing where it is not supported.
#[allow(unsafe_code)] // reason: advice about an address range
pub(crate) fn prefer_large_pages<T>(range: Range<*mut T>) {
    #[cfg(target_os = "linux")]
    {
        /// Advice must begin at a page.
        const PAGE: usize = 4096;
        let first = range.start.addr().next_multiple_of(PAGE);
        let length = range.end.addr().saturating_sub(first);
        let skipped = first - range.start.addr();
        if length >= PAGE {
            // SAFETY: this advice changes no content, whatever the range; whether it is followed does not matter.
            let _ = unsafe {
                let start = range.start.wrapping_byte_add(skipped).cast();
                rustix::mm::madvise(start, length, rustix::mm::Advice::LinuxHugepage)
            };
        }
    }
    #[cfg(not(target_os = "linux"))]
    let _ = range;
}
