//! A made-up flight, to look at the report and the terminal lines without a rig:
//! `cargo run -p flight --example synthetic_flight -- [FOLDER] [trouble]`.
//!
//! The plant is a first-order lag per channel with the sensors' noise, the law a plain PI; both are
//! there to make curves of the right kind, not to prove anything. `trouble` adds what can go wrong. The
//! ticks go through the recorder, come back from its file, and the report is made from that.

use std::error::Error;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use flight::{CodeNames, Event, FlightInfo, FlightStatistics, Recorded, Recorder, RecorderOptions, StatisticsOptions};
use proto::recording::{
    Arrival, Attachment, COMMAND_BYTES, EventLevel, LawParts, RecordingInfo, SENSE_BYTES, TickRecord, read_mcap,
};
use proto::reference::Reference;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let folder = arguments.first().map_or_else(|| PathBuf::from("."), PathBuf::from);
    let trouble = arguments.iter().any(|argument| argument == "trouble");
    let path = folder.join(format!("synthetic-{}.mcap", std::process::id()));

    let mut info = RecordingInfo::new(concat!("flight example ", env!("CARGO_PKG_VERSION")), 0);
    for (key, value) in [
        ("rig", "made up: first-order lags"),
        ("model_rig", "the same lags, 3 % off"),
        ("reference", "the paper's"),
        ("command", "synthetic_flight"),
    ] {
        info.extra.insert(key.to_owned(), value.to_owned());
    }
    let config = Attachment {
        name: "controller.toml".to_owned(),
        media_type: "application/toml".to_owned(),
        data: b"[link]\naddress = \"192.168.1.20:50500\"\n".to_vec(),
    };
    let options = StatisticsOptions { rmse_limit_kpa: Some([0.6, 0.25]), ..StatisticsOptions::default() };
    let live = Arc::new(Mutex::new(FlightStatistics::new(options)));
    println!("{}", FlightStatistics::live_header());
    let shared = live.clone();
    let recorder_options = RecorderOptions::new(|event: &Event| match event.code {
        1 => format!("positive pressure {:.1} kPa above {:.1} kPa; vented", event.values[0], event.values[1]),
        code => format!("event {code}"),
    })
    .observer(move |seen| {
        let (Recorded::Tick(tick), Ok(mut live)) = (seen, shared.lock()) else { return };
        live.push(tick);
        if tick.tick % 250 == 249 {
            println!("{}", live.live_line(if tick.fault == 0 { "" } else { "FAULT" }));
        }
    });
    let (recorder, mut sink) = Recorder::start(&path, &info, &[config], recorder_options)?;
    recorder.note(0, EventLevel::Info, "demo", "a made-up flight begins");
    for tick in synthetic(trouble) {
        if trouble && tick.tick == 2_000 {
            let values = [161.2, 160.0, 0.0, 0.0];
            sink.event(Event { at_ns: tick.receive_ns, level: EventLevel::Error, part: "safety", code: 1, values });
        }
        while sink.room() == 0 {
            std::thread::yield_now();
        }
        sink.push(&tick);
    }
    let recorded = recorder.finish()?;
    let content = read_mcap(&recorded.path)?;
    let codes = CodeNames {
        state: |state| ["standby", "run", "safe"].get(usize::from(state)).copied().unwrap_or("?"),
        fault: |fault| if fault == 1 { "over-pressure" } else { "link lost" },
    };
    let mut info = FlightInfo::from_recording("Synthetic flight: the paper's reference", &content, codes, options);
    info.deadline_ms = Some(14.0);
    let report = folder.join("flight.html");
    proto::atomic_file::write(&report, flight::flight_report(&content.ticks, &info).as_bytes())?;
    let summary = FlightStatistics::of(&content.ticks, options).summary();
    println!("\n{}", summary.table());
    println!("{}", serde_json::to_string_pretty(&summary)?);
    println!("{} ({} bytes), {}", recorded.path.display(), recorded.bytes, report.display());
    Ok(())
}

/// A lag with its noise and PI.
struct Channel {
    kpa: f64,
    integral: f64,
    duty: f64,
    /// Steady pressure is `open` at duty 1 and `open + gain` at duty 0.
    gain: f64,
    noise: f64,
}

impl Channel {
    fn step(&mut self, reference: f64, steer: bool, noise: f64) -> (f64, LawParts) {
        let measured = self.kpa + self.noise * noise;
        let error = reference - measured;
        let feed_forward = 1.0 - 1.03 * reference / self.gain;
        let proportional = -4.0 * error / self.gain;
        if steer {
            self.integral -= 0.08 * error / self.gain;
        }
        let u_raw = feed_forward + proportional + self.integral;
        let parts = LawParts { feed_forward, proportional, integral: self.integral, u_raw, ..LawParts::default() };
        self.duty = if steer { u_raw.clamp(0.0, 1.0) } else { 1.0 };
        (measured, parts)
    }

    fn advance(&mut self) {
        self.kpa += 0.06 * ((1.0 - self.duty) * self.gain - self.kpa);
    }

    fn predict(&self, measured: f64) -> [f64; 5] {
        let mut kpa = measured;
        std::array::from_fn(|_| {
            kpa += 0.061 * ((1.0 - self.duty) * self.gain * 0.995 - kpa);
            kpa
        })
    }
}

fn synthetic(trouble: bool) -> Vec<TickRecord> {
    let reference = Reference::paper();
    let mut draw = noise();
    let mut pos = Channel { kpa: 0.0, integral: 0.0, duty: 1.0, gain: 400.0, noise: 0.06 };
    let mut neg = Channel { kpa: 0.0, integral: 0.0, duty: 1.0, gain: -300.0, noise: 0.007 };
    let mut ticks = Vec::new();
    for k in 0..3_060_u32 {
        // One second of standby, then the reference starts.
        let safe = trouble && (2_000..2_060).contains(&k);
        let steer = k >= 50 && !safe;
        let [ref_pos, ref_neg] = reference.at(f64::from(k.saturating_sub(50)) / 50.0);
        let (p_pos, law_pos) = pos.step(ref_pos, steer, draw());
        let (p_neg, law_neg) = neg.step(ref_neg, steer, draw());
        let missing = trouble && (900..903).contains(&k);
        let stalled = trouble && [1_200, 1_201, 2_700].contains(&k);
        let predict_ns = (2.4e5 * (0.04 * draw()).exp() * if k % 331 == 7 { 3.2 } else { 1.0 }) as u32;
        let [receive_check_ns, law_ns, send_ns] =
            [9e3, 2.1e3, 1.4e4].map(|ns: f64| (ns * (0.12 * draw()).exp()) as u32);
        let stall_ns = if stalled { 24_000_000 } else { 0 };
        let lateness_ns = (6e4 * draw().abs()) as i64 + if k % 500 == 123 { 900_000 } else { 0 };
        let tick = TickRecord {
            session: 0x5EED_0001,
            tick: k,
            receive_ns: u64::from(k) * 20_000_000 + lateness_ns.unsigned_abs(),
            arrival: if missing { Arrival::Missing } else { Arrival::InTime },
            sense_present: !missing,
            sense: [0; SENSE_BYTES],
            command_present: true,
            command: [0; COMMAND_BYTES],
            p_pos_kpa: if missing { f64::NAN } else { p_pos },
            p_neg_kpa: if missing { f64::NAN } else { p_neg },
            ref_pos_kpa: if k >= 50 { ref_pos } else { f64::NAN },
            ref_neg_kpa: if k >= 50 { ref_neg } else { f64::NAN },
            predicted_pos_kpa: pos.predict(p_pos),
            predicted_neg_kpa: neg.predict(p_neg),
            law_pos,
            law_neg,
            u_pos: pos.duty,
            u_neg: neg.duty,
            pump_on: steer,
            mode: u8::from(steer),
            state: if safe { 2 } else { u8::from(steer) },
            fault: u16::from(safe),
            arrival_lateness_ns: lateness_ns,
            receive_check_ns: if missing { 0 } else { receive_check_ns },
            predict_ns,
            law_ns,
            send_ns,
            compute_ns: receive_check_ns + predict_ns + law_ns + send_ns + 1_500 + stall_ns,
            deadline_missed: stalled,
            ..TickRecord::default()
        };
        ticks.push(tick);
        pos.advance();
        neg.advance();
    }
    if trouble {
        // Ticks that a full queue refused.
        ticks.drain(1_500..1_540);
    }
    ticks
}

/// Repeatable noise of about unit size: sums of a linear congruential generator's draws.
fn noise() -> impl FnMut() -> f64 {
    let mut state = 1_u64;
    let mut uniform = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    move || (0..12).map(|_| uniform()).sum::<f64>() - 6.0
}
