//! Cost of recording, counting and reporting: `cargo bench -p flight`.
//!
//! Prints p50, p99.9 and max of each call that may run in the tick, with the recorder's thread at work
//! on the same machine, and the time and size of a report of one hour.

use std::hint::black_box;
use std::time::Instant;

use flight::duration_histogram::DurationHistogram;
use flight::{
    CodeNames, Event, FlightInfo, FlightStatistics, Recorder, RecorderOptions, StatisticsOptions, flight_report,
};
use proto::recording::{Arrival, EventLevel, RecordingInfo, TickRecord};

const HOUR: u32 = 180_000;

fn main() {
    let ticks: Vec<TickRecord> = (0..HOUR).map(tick).collect();
    let path = std::env::temp_dir().join(format!("flight-cost-{}.mcap", std::process::id()));
    let options = RecorderOptions::new(|event| format!("code {}", event.code));
    match Recorder::start(&path, &RecordingInfo::new("bench", 0), &[], options) {
        Ok((recorder, mut sink)) => {
            let (mut pushes, mut events) = (DurationHistogram::new(), DurationHistogram::new());
            let event = Event { at_ns: 0, level: EventLevel::Info, part: "bench", code: 1, values: [0.0; 4] };
            for (k, tick) in ticks.iter().enumerate() {
                while sink.room() == 0 {
                    std::thread::yield_now();
                }
                pushes.add(timed(|| sink.push(tick)));
                if k % 100 == 0 {
                    events.add(timed(|| sink.event(event)));
                }
            }
            show("RecordSink::push", &pushes);
            show("RecordSink::event", &events);
            let begun = Instant::now();
            match recorder.finish() {
                Ok(done) => println!(
                    "recording of {} ticks: {:.1} MB, {} refused; finished {:.2} s after the last tick",
                    done.ticks,
                    done.bytes as f64 / 1e6,
                    done.ticks_dropped,
                    begun.elapsed().as_secs_f64()
                ),
                Err(error) => println!("{error}"),
            }
            let _ = std::fs::remove_file(&path);
        }
        Err(error) => println!("{error}"),
    }

    let mut statistics = FlightStatistics::new(StatisticsOptions::default());
    let mut counting = DurationHistogram::new();
    ticks.iter().for_each(|tick| counting.add(timed(|| statistics.push(tick))));
    show("FlightStatistics::push", &counting);

    let codes = CodeNames { state: |_| "run", fault: |_| "none" };
    let info = FlightInfo::new("One hour", codes, StatisticsOptions::default());
    let begun = Instant::now();
    let page = flight_report(&ticks, &info);
    println!("report of one hour: {:.2} s, {:.2} MB", begun.elapsed().as_secs_f64(), page.len() as f64 / 1e6);
}

fn timed<T>(work: impl FnOnce() -> T) -> u64 {
    let begun = Instant::now();
    black_box(work());
    u64::try_from(begun.elapsed().as_nanos()).unwrap_or(u64::MAX)
}

fn show(what: &str, times: &DurationHistogram) {
    let us = |share: f64| times.percentile_ns(share).unwrap_or(0) as f64 / 1e3;
    println!(
        "{what:<24} p50 {:>7.3} us   p99.9 {:>7.3} us   max {:>9.3} us   ({} calls)",
        us(0.5),
        us(0.999),
        us(1.0),
        times.total()
    );
}

fn tick(k: u32) -> TickRecord {
    let time_s = f64::from(k) / 50.0;
    // Noise of a kind, so that curves cannot be thinned out more than real ones.
    let noise = f64::from(k.wrapping_mul(2_654_435_761) >> 8) / f64::from(1 << 24) - 0.5;
    let (ref_pos_kpa, ref_neg_kpa) = (80.0 + 6.0 * (time_s / 1.3).sin(), -70.0 + 3.0 * (time_s / 1.6).sin());
    TickRecord {
        session: 1,
        tick: k,
        receive_ns: u64::from(k) * 20_000_000,
        arrival: Arrival::InTime,
        sense_present: true,
        command_present: true,
        p_pos_kpa: ref_pos_kpa + 0.2 * noise,
        p_neg_kpa: ref_neg_kpa - 0.1 * noise,
        ref_pos_kpa,
        ref_neg_kpa,
        predicted_pos_kpa: [ref_pos_kpa + 0.1; 5],
        predicted_neg_kpa: [ref_neg_kpa + 0.1; 5],
        u_pos: 0.75 + 0.01 * noise,
        u_neg: 0.7,
        mode: 1,
        arrival_lateness_ns: (1e5 * noise) as i64,
        receive_check_ns: 9_000,
        predict_ns: 250_000 + (1e4 * noise) as u32,
        law_ns: 2_000,
        send_ns: 14_000,
        compute_ns: 280_000 + (2e4 * (noise + 0.5)) as u32,
        ..TickRecord::default()
    }
}
