//! The daemon's clock.

use rustix::time::{ClockId, Timespec, clock_gettime};

/// The monotonic clock in ns; never set back, not even when the PC's time is corrected.
///
/// # Real-time
/// May run in the tick.
pub fn now_ns() -> u64 {
    let Timespec { tv_sec, tv_nsec } = clock_gettime(ClockId::Monotonic);
    (tv_sec as u64).wrapping_mul(1_000_000_000).wrapping_add(tv_nsec as u64)
}
