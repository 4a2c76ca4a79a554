//! The codec allocates nothing: a counting allocator watches it encode, read and fail.

// A global allocator cannot be written without unsafe code; this one only counts and passes on.
#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use proto::wire::{Command, CrioState, FrameReader, Mode, Sense, SequenceCounter, TripBits};

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: every call is passed on to the system's allocator with the arguments it came with.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's promises about `layout` are the ones asked for here.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above; `pointer` came from `System` by `alloc`.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn encoding_and_reading_allocate_nothing() {
    let mut sequence = SequenceCounter::new();
    let mut reader = FrameReader::new();
    let mut frames = 0_u32;
    let mut damaged = 0_u32;
    let before = ALLOCATIONS.with(Cell::get);
    for tick in 0..1000 {
        let sense = Sense {
            sequence: sequence.advance(),
            clock_ns: 0,
            session: 1,
            tick,
            command_in_force: 0,
            volts: [1.5, 4.0, f32::NAN, f32::NAN],
            duty: [0.7, 0.8],
            state: CrioState::Running,
            pump_running: true,
            trips: TripBits::NONE,
            commands_missed: 0,
        };
        let command = Command {
            sequence: tick + 1,
            clock_ns: 0,
            session: 1,
            tick,
            duty: [0.7, 0.8],
            mode: Mode::Run,
            ttl_ticks: 2,
            digital_outputs: 1,
        };
        let mut bytes = sense.encode();
        if tick % 7 == 0 {
            bytes[40] ^= 1;
        }
        reader.push(&bytes);
        reader.push(&command.encode());
        loop {
            match reader.next_frame() {
                Ok(Some(_)) => frames += 1,
                Ok(None) => break,
                Err(_) => damaged += 1,
            }
        }
    }
    reader.push(b"no frame");
    assert!(reader.next_frame().is_err_and(|damage| damage.is_fatal()));
    let allocations = ALLOCATIONS.with(Cell::get) - before;
    assert_eq!((frames, damaged), (1857, 143));
    assert_eq!(allocations, 0);
    // The counter counts: a box is seen.
    let boxed = std::hint::black_box(Box::new(1_u8));
    assert_eq!(ALLOCATIONS.with(Cell::get) - before, 1, "{boxed}");
}
