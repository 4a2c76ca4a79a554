//! An allocator that counts what each thread asks of it, for tests to look at from another thread.
// A `GlobalAlloc` cannot be written without unsafe code; this one hands everything on to the system's allocator.
#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::atomic::{AtomicI32, AtomicU64, AtomicUsize, Ordering};

/// Threads that are told apart; a process that starts more counts the rest together.
const SLOTS: usize = 4096;

static COUNTS: [AtomicU64; SLOTS] = [const { AtomicU64::new(0) }; SLOTS];
static TASKS: [AtomicI32; SLOTS] = [const { AtomicI32::new(0) }; SLOTS];
static TAKEN: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    // Made without allocation and never dropped, so the allocator itself may use it.
    static SLOT: Cell<usize> = const { Cell::new(usize::MAX) };
}

fn count() {
    SLOT.with(|slot| {
        if slot.get() == usize::MAX {
            let taken = TAKEN.fetch_add(1, Ordering::Relaxed).min(SLOTS - 1);
            TASKS[taken].store(rustix::thread::gettid().as_raw_nonzero().get(), Ordering::Release);
            slot.set(taken);
        }
        COUNTS[slot.get()].fetch_add(1, Ordering::Relaxed);
    });
}

/// Allocations and frees of the thread with this number so far; `None` if it never asked for anything.
pub fn allocations(task: i32) -> Option<u64> {
    let taken = TAKEN.load(Ordering::Acquire).min(SLOTS);
    // The newest first: the kernel gives numbers out again.
    (0..taken).rev().find(|n| TASKS[*n].load(Ordering::Acquire) == task).map(|n| COUNTS[n].load(Ordering::Relaxed))
}

/// The allocator; frees count as well, for they take the same locks.
pub struct CountingAllocator;

// SAFETY: every call goes to the system's allocator unchanged, which keeps the contract of `GlobalAlloc`.
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller's promises are those that `System` asks for.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count();
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        // SAFETY: as above.
        unsafe { System.realloc(pointer, layout, size) }
    }
}
