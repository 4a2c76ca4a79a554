//! Needs of the tick: no allocation, no NaN in or out, a policy that can change threads.
#![allow(clippy::unwrap_used, clippy::panic)]

mod onnx;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use onnx::*;
use policy::{Policy, Refused};

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

fn policy(hidden: &str) -> Policy {
    let bytes = Mlp::new(&[84, 64, 64, 12], 1).torch(hidden, "Sigmoid").bytes();
    Policy::from_bytes("rt".into(), &bytes, &paper()).unwrap()
}

#[test]
fn the_counter_counts() {
    assert_eq!(calls(|| drop(std::hint::black_box(vec![1u8; 100]))), 2);
}

#[test]
fn a_run_allocates_nothing_whether_it_succeeds_or_refuses() {
    for hidden in ["Relu", "Tanh", "Elu", "LeakyRelu", "Softplus", "Sigmoid"] {
        let mut policy = policy(hidden);
        let good = observation(&mut Draw(2), 84);
        let mut bad = good.clone();
        bad[83] = f32::NAN;
        let mut out = [0.0; 12];
        let count = calls(|| {
            for _ in 0..1000 {
                policy.run(&good, &mut out).unwrap();
                assert!(policy.run(&bad, &mut out).is_err());
                assert!(policy.run(&good[1..], &mut out).is_err());
            }
        });
        assert_eq!(count, 0, "{hidden}");
    }
}

/// tract and most runtimes answer a NaN with a plausible duty; each place is tried by itself.
#[test]
fn a_single_value_that_is_not_finite_is_refused_and_named() {
    let mut policy = policy("Relu");
    let good = observation(&mut Draw(3), 84);
    for index in 0..84 {
        for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let mut input = good.clone();
            input[index] = value;
            let mut out = [-7.0; 12];
            match policy.run(&input, &mut out) {
                Err(Refused::InputNotFinite { index: at, value: v }) => {
                    assert_eq!((at, v.to_bits()), (index, value.to_bits()));
                }
                other => panic!("{other:?}"),
            }
            assert_eq!(out, [-7.0; 12], "the old action is left alone");
        }
    }
    // And the next good observation flies as if nothing had been.
    let (mut a, mut b) = ([0.0; 12], [0.0; 12]);
    policy.run(&good, &mut a).unwrap();
    self::policy("Relu").run(&good, &mut b).unwrap();
    assert_eq!(a.map(f32::to_bits), b.map(f32::to_bits));
}

#[test]
fn wrong_lengths_are_refused() {
    let mut policy = policy("Relu");
    let (good, mut out) = ([0.0; 84], [0.0; 12]);
    let short = policy.run(&good[..83], &mut out);
    assert_eq!(short, Err(Refused::InputLength { found: 83, expected: 84 }));
    let narrow = policy.run(&good, &mut out[..6]);
    assert_eq!(narrow, Err(Refused::OutputLength { found: 6, expected: 12 }));
}

/// tract leaves vector registers half in use, which slows SSE code on its thread 6 to 8 times; it must
/// not run on the caller's. Medians of single runs, so that other load on the machine does not count.
#[test]
fn loading_does_not_slow_the_loading_thread() {
    let median = |policy: &mut Policy| {
        let input = observation(&mut Draw(4), 84);
        let mut out = [0.0; 12];
        let mut times: Vec<_> = (0..3001)
            .map(|_| {
                let start = std::time::Instant::now();
                policy.run(std::hint::black_box(&input), &mut out).unwrap();
                start.elapsed()
            })
            .collect();
        times.sort_unstable();
        times[1500].as_secs_f64()
    };
    // This thread never loads: a thread inherits the state of the registers from the one that starts it.
    let loading = std::thread::spawn(move || {
        let bytes = Mlp::new(&[84, 256, 256, 12], 1).torch("Tanh", "Sigmoid").bytes();
        let mut policy = Policy::from_bytes("rt".into(), &bytes, &paper()).unwrap();
        (median(&mut policy), policy)
    });
    let (here, mut policy) = loading.join().unwrap();
    let fresh = median(&mut policy);
    assert!(here < 3.0 * fresh, "{here:.1e} s on the loading thread, {fresh:.1e} s on a fresh one");
}

/// Built on one thread, flown on another, dropped on a third.
#[test]
fn a_policy_may_change_threads() {
    let mut policy = policy("Tanh");
    let input = observation(&mut Draw(5), 84);
    let mut here = [0.0; 12];
    policy.run(&input, &mut here).unwrap();
    let flown = std::thread::spawn(move || {
        let mut there = [0.0; 12];
        policy.run(&input, &mut there).unwrap();
        (policy, there)
    });
    let (policy, there) = flown.join().unwrap();
    assert_eq!(here.map(f32::to_bits), there.map(f32::to_bits));
    std::thread::spawn(move || drop(policy)).join().unwrap();
}
