//! A tick allocates nothing.
//!
//! A global allocator that counts per thread, so that the test harness's own threads do not disturb.

// `GlobalAlloc` can only be implemented with unsafe functions; both hand straight over to the system's.
#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::hint::black_box;
use std::sync::Arc;

use model::observation::AHEAD;
use model::plant::{Plant, Simulated, Simulation};
use model::predict::Predictor;
use model::real::Lanes;
use model::rig::Rig;

struct Counting;

thread_local! {
    static CALLS: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: every call is passed on unchanged to the system's allocator; the counter is a plain cell without
// destructor, so touching it neither allocates nor unwinds.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        CALLS.with(|calls| calls.set(calls.get() + 1));
        // SAFETY: the caller's promises are those that `System` asks for.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        CALLS.with(|calls| calls.set(calls.get() + 1));
        // SAFETY: as above.
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn calls_in(work: impl FnOnce()) -> usize {
    let before = CALLS.with(Cell::get);
    work();
    CALLS.with(Cell::get) - before
}

/// 100 ticks with changing duties and the relay going off and on, reading, saving and restoring.
fn calls_in_ticks<R: Simulated>(rig: &Rig) -> usize {
    let mut simulation = Simulation::new(Arc::new(Plant::<R>::side_by_side(std::slice::from_ref(rig)).unwrap()));
    calls_in(|| {
        for tick in 0..100 {
            let duty = R::splat(0.5 + 0.005 * f64::from(tick));
            let pump_on = if tick % 40 < 30 { 1.0 } else { 0.0 };
            simulation.tick(&[duty, duty, R::splat(pump_on)]);
            for reading in simulation.readings_kpa() {
                black_box(reading);
            }
            let here = simulation.state();
            simulation.restore(black_box(&here));
        }
    })
}

#[test]
fn the_counter_counts() {
    assert_eq!(calls_in(|| drop(black_box(Box::new(7)))), 2);
}

#[test]
fn ticks_allocate_nothing() {
    for name in Rig::BUILTIN {
        let rig = Rig::builtin(name).unwrap();
        assert_eq!(calls_in_ticks::<f64>(&rig), 0, "{name}, one rig");
        assert_eq!(calls_in_ticks::<Lanes<4>>(&rig), 0, "{name}, four lanes");
        assert_eq!(calls_in_ticks::<Lanes<8>>(&rig), 0, "{name}, eight lanes");
    }
}

/// MPObs behind sensors that lag and swing, and what they estimate.
#[test]
fn an_observed_tick_allocates_nothing() {
    let late = "\n[[mechanisms]]\nid = \"sensor_lag\"\ncomponent = \"sensor_pos\"\ntime_constant_ms = 160.0\n\
                \n[[mechanisms]]\nid = \"residual_response\"\ncomponent = \"sensor_neg\"\n\
                natural_frequency_hz = 4.0\ndamping_ratio = 0.2\n";
    let rig = Rig::from_toml(&(model::rig::DUAL_PRESSURE.to_owned() + late)).unwrap();
    let mut predictor = Predictor::new(&rig).unwrap();
    predictor.restart([80.0, -70.0], [0.8, 0.8]);
    let calls = calls_in(|| {
        for tick in 0..20 {
            black_box(predictor.observe([80.0 + 0.01 * f64::from(tick), -70.0]));
            black_box(predictor.predict(&[[0.8, 0.8]; AHEAD], true));
            predictor.advance([0.8, 0.8], true);
        }
    });
    assert_eq!(calls, 0);
}
