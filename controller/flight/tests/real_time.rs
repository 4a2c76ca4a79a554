//! Proof that what runs in the tick allocates nothing.
#![allow(clippy::unwrap_used)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use flight::{Event, FlightStatistics, Recorder, RecorderOptions, StatisticsOptions};
use proto::recording::{Arrival, EventLevel, RecordingInfo, TickRecord};

/// The system's allocator, counting what this thread asks of it.
struct Counting;

thread_local! {
    static CALLS: Cell<u64> = const { Cell::new(0) };
}

// SAFETY: every call goes on to the system's allocator unchanged; the counter is a plain cell.
#[allow(unsafe_code)]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        CALLS.set(CALLS.get() + 1);
        // SAFETY: the caller's promises are those that `System` asks for.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        CALLS.set(CALLS.get() + 1);
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        CALLS.set(CALLS.get() + 1);
        // SAFETY: as above.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Allocator calls during `work`, on this thread.
fn calls(work: impl FnOnce()) -> u64 {
    let before = CALLS.get();
    work();
    CALLS.get() - before
}

/// Ticks of every kind: good, vented, faulty, late, missing, of another session, out of order.
fn ticks() -> Vec<TickRecord> {
    let tick = |k: u32| TickRecord {
        session: 1 + k / 1_500,
        tick: if k == 900 { 3 } else { k },
        receive_ns: u64::from(k) * 20_000_000,
        arrival: Arrival::from_code((k % 97 == 5).into()).unwrap_or_default(),
        p_pos_kpa: if k % 131 == 7 { f64::NAN } else { 80.0 + f64::from(k % 13) },
        p_neg_kpa: -70.0,
        ref_pos_kpa: 80.0,
        ref_neg_kpa: -70.0,
        mode: u8::from(k % 700 > 20),
        fault: u16::from(k % 700 < 5),
        compute_ns: 300_000 + (k % 1_000) * 1_000,
        predict_ns: 200_000,
        arrival_lateness_ns: i64::from(k % 50) * 10_000 - 100_000,
        deadline_missed: k % 1_100 == 3,
        ..TickRecord::default()
    };
    (0..3_000).map(tick).collect()
}

#[test]
fn the_counter_counts() {
    assert_eq!(calls(|| drop(std::hint::black_box(vec![1_u8; 100]))), 2);
}

#[test]
fn pushing_allocates_nothing_while_the_queue_has_room_and_when_it_is_full() {
    let path = std::env::temp_dir().join(format!("flight-real-time-{}.mcap", std::process::id()));
    let options = RecorderOptions { capacity: 100, ..RecorderOptions::new(|event| format!("{}", event.code)) };
    let (recorder, mut sink) = Recorder::start(&path, &RecordingInfo::new("test", 0), &[], options).unwrap();
    let ticks = ticks();
    let event = Event { at_ns: 0, level: EventLevel::Warning, part: "p", code: 1, values: [1.0; 4] };
    let health = recorder.health();
    let allocated = calls(|| {
        for tick in &ticks {
            sink.push(tick);
            sink.event(event);
            std::hint::black_box((sink.dropped(), sink.room(), health.free_bytes()));
        }
    });
    assert_eq!(allocated, 0);
    assert!(sink.dropped() > 0, "3,000 ticks at once must have filled a queue of 100");
    let done = recorder.finish().unwrap();
    assert_eq!(done.ticks + done.ticks_dropped, 3_000);
    assert_eq!(done.events + done.events_dropped, 3_000);
    let _ = std::fs::remove_file(&path);
}

#[test]
fn counting_a_tick_allocates_nothing() {
    let ticks = ticks();
    let mut statistics = FlightStatistics::new(StatisticsOptions::default());
    let allocated = calls(|| {
        for tick in &ticks {
            std::hint::black_box(statistics.push(tick));
        }
    });
    assert_eq!(allocated, 0);
    assert_eq!(statistics.counts().ticks, 3_000);
}
