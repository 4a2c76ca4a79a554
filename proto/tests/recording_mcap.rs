//! Recordings in MCAP: what goes in comes out, whatever happens to the end of the file.

#![allow(clippy::unwrap_used, reason = "the helpers of a test fail by panicking, as the test does")]

mod recorded;

use std::path::Path;

use proptest::prelude::*;
use proto::recording::{
    Arrival, Attachment, EventLevel, LawParts, LogTime, Recording, RecordingWriter, TickRecord, WriteMcapError,
    parse_mcap, read_mcap, unfinished_path,
};
use recorded::{Folder, all_bits, info, run, write};

fn any_law() -> impl Strategy<Value = LawParts> {
    any::<[u64; 6]>().prop_map(|bits| {
        let [feed_forward, backlash, correction, proportional, integral, u_raw] = bits.map(f64::from_bits);
        LawParts { feed_forward, backlash, correction, proportional, integral, u_raw }
    })
}

prop_compose! {
    /// Any record at all: numbers are any bits, so NaN with payloads, infinities and −0.0 too.
    fn any_tick()(
        head in any::<(u32, u32, u64, i64)>(),
        arrival in 0_u8..4,
        sense in proptest::option::of(any::<[u8; 32]>()),
        command in proptest::option::of(any::<[u8; 32]>()),
        singles in any::<[u32; 6]>(),
        doubles in any::<[u64; 18]>(),
        laws in (any_law(), any_law()),
        bytes in any::<(u8, u8, u8, u8, u16)>(),
        flags in any::<(bool, bool, bool)>(),
        decided in any::<(u64, u32, u64, [u32; 12], u8, u32, [u64; 3])>(),
        ns in any::<[u32; 6]>(),
        planned in any::<[u32; 10]>(),
    ) -> TickRecord {
        let [v0, v1, v2, v3, echo_pos, echo_neg] = singles.map(f32::from_bits);
        let doubles = doubles.map(f64::from_bits);
        let mut tick = TickRecord {
            session: head.0, tick: head.1, receive_ns: head.2, arrival_lateness_ns: head.3,
            arrival: Arrival::from_code(arrival).unwrap(),
            volts: [v0, v1, v2, v3], echo_pos, echo_neg,
            p_pos_kpa: doubles[0], p_neg_kpa: doubles[1],
            ref_pos_kpa: doubles[2], ref_neg_kpa: doubles[3],
            predicted_pos_kpa: std::array::from_fn(|i| doubles[4 + i]),
            predicted_neg_kpa: std::array::from_fn(|i| doubles[9 + i]),
            u_pos: doubles[14], u_neg: doubles[15],
            law_pos: laws.0, law_neg: laws.1,
            crio_state: bytes.0, crio_trip: bytes.1, mode: bytes.2, state: bytes.3, fault: bytes.4,
            pump_on: flags.0, deadline_missed: flags.1,
            receive_check_ns: ns[0], predict_ns: ns[1], law_ns: ns[2], send_ns: ns[3],
            compute_ns: ns[4], records_dropped: ns[5],
            findings: decided.0, inputs: decided.1, observation_hash: decided.2,
            policy_output: decided.3.map(f32::from_bits), policy_stage: decided.4, swap_id: decided.5,
            authority: f64::from_bits(decided.6[0]),
            command_before_filter: [f64::from_bits(decided.6[1]), f64::from_bits(decided.6[2])],
            filter_active: flags.2,
            experiment: bytes.0 ^ bytes.1, exploration_pos: doubles[16], exploration_neg: doubles[17],
            exploration_plan: planned.map(f32::from_bits),
            ..TickRecord::default()
        };
        if let Some(fill) = sense {
            tick.sense_present = true;
            tick.sense = std::array::from_fn(|i| fill[i % 32]);
        }
        if let Some(fill) = command {
            tick.command_present = true;
            tick.command = std::array::from_fn(|i| fill[i % 32]);
        }
        tick
    }
}

proptest! {
    // Each case writes and syncs files; 48 runs of up to 40 random records take about a second.
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn every_bit_of_every_tick_comes_back(
        ticks in proptest::collection::vec(any_tick(), 1..40),
        lockstep: bool,
    ) {
        let folder = Folder::new("bits");
        let path = folder.join("run.mcap");
        let mut info = info();
        info.log_time = if lockstep { LogTime::Tick } else { LogTime::Arrival };
        let mut writer = RecordingWriter::create(&path, &info, &[]).unwrap();
        for tick in &ticks {
            writer.write(tick).unwrap();
        }
        writer.finish().unwrap();
        let content = read_mcap(&path).unwrap();
        prop_assert!(content.complete, "{:?}", content.notes);
        prop_assert_eq!(all_bits(&content.ticks), all_bits(&ticks));
    }

    #[test]
    fn damage_anywhere_never_panics_and_never_invents_a_tick(
        place in 8_usize..20_000,
        flip in 1_u8..=255,
    ) {
        let folder = Folder::new("damage");
        let path = folder.join("run.mcap");
        let ticks = run(20);
        write(&path, &ticks, 5);
        let mut bytes = std::fs::read(&path).unwrap();
        let place = 8 + place % (bytes.len() - 8);
        bytes[place] ^= flip;
        if let Ok(content) = parse_mcap("run.mcap", &bytes) {
            let written = all_bits(&ticks);
            for tick in all_bits(&content.ticks) {
                prop_assert!(written.contains(&tick), "byte {place}: a tick that was not written");
            }
        }
    }
}

#[test]
fn a_file_cut_anywhere_gives_every_whole_tick() {
    let folder = Folder::new("cut");
    let path = folder.join("run.mcap");
    let ticks = run(20);
    // What is on the disk after each flush, by its length.
    let mut writer = RecordingWriter::create(&path, &info(), &[]).unwrap();
    let partial = unfinished_path(&path);
    let length = || std::fs::metadata(&partial).unwrap().len() as usize;
    let mut whole = vec![(length(), 0)];
    for (second, some) in ticks.chunks(5).enumerate() {
        for tick in some {
            writer.write(tick).unwrap();
        }
        writer.flush().unwrap();
        whole.push((length(), 5 * (second + 1)));
    }
    drop(writer);
    let bytes = std::fs::read(&partial).unwrap();
    let near_an_end = |length: usize| whole.iter().any(|(end, _)| length.abs_diff(*end) < 40);
    let mut within = 0;
    // Every byte around the ends of chunks, every 13th between them (13 is no record's length).
    for length in (8..whole.last().unwrap().0).filter(|n| n % 13 == 0 || near_an_end(*n)) {
        // Message indexes follow a chunk, so a chunk can be whole before its flush is.
        let least = whole.iter().rfind(|(end, _)| *end <= length).map_or(0, |(_, ticks)| *ticks);
        match parse_mcap("cut.mcap", &bytes[..length]) {
            Ok(content) => {
                let got = content.ticks.len();
                assert!(got >= least && got <= least + 5, "{length}: {got}");
                within += usize::from(got % 5 != 0);
                assert_eq!(all_bits(&content.ticks), all_bits(&ticks[..got]), "cut at {length}");
                assert!(!content.complete);
                assert_eq!(content.notes.len(), 1, "{:?}", content.notes);
            }
            Err(error) => assert_eq!(least, 0, "cut at {length}: {error}"),
        }
    }
    assert!(within > 10, "chunks that are cut give what is whole in them: {within}");
}

#[test]
fn a_crash_leaves_the_partial_file_and_all_that_was_flushed() {
    let folder = Folder::new("crash");
    let path = folder.join("run.mcap");
    let ticks = run(120);
    let mut writer = RecordingWriter::create(&path, &info(), &[]).unwrap();
    for tick in &ticks[..100] {
        writer.write(tick).unwrap();
    }
    writer.flush().unwrap();
    for tick in &ticks[100..] {
        writer.write(tick).unwrap();
    }
    // As a killed process leaves it: nothing runs any more, not even destructors.
    std::mem::forget(writer);
    assert!(!path.exists());
    let partial = folder.join("run.partial.mcap");
    let content = read_mcap(&partial).unwrap();
    assert_eq!(all_bits(&content.ticks), all_bits(&ticks[..100]));
    assert!(!content.complete);
    let recording = Recording::read(&partial).unwrap();
    assert_eq!(recording.rows(), 100);
    assert!(recording.notes()[0].contains("read 100 ticks"), "{:?}", recording.notes());
}

#[test]
fn nothing_is_written_over() {
    let folder = Folder::new("over");
    let path = folder.join("run.mcap");
    let first = RecordingWriter::create(&path, &info(), &[]).unwrap();
    let error = RecordingWriter::create(&path, &info(), &[]).unwrap_err();
    assert!(matches!(error, WriteMcapError::Exists { path } if path.ends_with("run.partial.mcap")));
    first.finish().unwrap();
    let error = RecordingWriter::create(&path, &info(), &[]).unwrap_err();
    assert!(matches!(&error, WriteMcapError::Exists { path } if path.ends_with("run.mcap")));
    assert!(error.to_string().contains("never written over"));
}

#[test]
fn a_missing_folder_is_named_in_one_line() {
    let error = RecordingWriter::create(Path::new("/nowhere/run.mcap"), &info(), &[]).unwrap_err();
    let message = error.to_string();
    assert!(message.starts_with("/nowhere/run.partial.mcap: cannot create"), "{message}");
    assert!(!message.contains('\n'));
}

#[test]
fn metadata_attachments_and_events_come_back() {
    let folder = Folder::new("about");
    let path = folder.join("run.mcap");
    let mut info = info();
    info.policy = Some(("default".to_owned(), "ab12".to_owned()));
    info.seed = Some(42);
    info.extra.insert("rig".to_owned(), "bench".to_owned());
    let config = Attachment {
        name: "config.toml".to_owned(),
        media_type: "application/toml".to_owned(),
        data: b"[link]\naddress = \"localhost:50500\"\n".to_vec(),
    };
    let mut writer = RecordingWriter::create(&path, &info, std::slice::from_ref(&config)).unwrap();
    writer.event(1_000, EventLevel::Info, "link", "connected").unwrap();
    writer.write(&run(1)[0]).unwrap();
    writer.event(60_001_000, EventLevel::Error, "safety", "link lost 60 ms at tick 0; vented").unwrap();
    writer.finish().unwrap();

    let content = read_mcap(&path).unwrap();
    assert!(content.complete, "{:?}", content.notes);
    assert_eq!(content.attachments, [config]);
    let value = |key: &str| content.metadata.get(key).map(String::as_str);
    assert_eq!(value("program"), Some("controller 0.1.0"));
    assert_eq!(value("started"), Some("2026-11-20T02:04:05.000Z"));
    assert_eq!(value("policy_name"), Some("default"));
    assert_eq!(value("policy_sha256"), Some("ab12"));
    assert_eq!(value("seed"), Some("42"));
    assert_eq!(value("rig"), Some("bench"));
    assert_eq!(value("format"), Some("1"));
    let events: Vec<_> =
        content.events.iter().map(|e| (e.unix_ns, e.level, e.part.as_str(), e.message.as_str())).collect();
    let start = 1_795_140_245_000_000_000;
    assert_eq!(
        events,
        [
            (start, EventLevel::Info, "link", "connected"),
            (start + 60_000_000, EventLevel::Error, "safety", "link lost 60 ms at tick 0; vented"),
        ]
    );
}

#[test]
fn a_minute_stays_below_three_megabytes() {
    let folder = Folder::new("size");
    let path = folder.join("run.mcap");
    write(&path, &run(3_000), 50);
    let bytes = std::fs::metadata(&path).unwrap().len();
    assert!(bytes < 3_000_000, "{bytes} bytes for 60 s");
}

/// Cost of a tick to the recorder thread: `cargo test --release --test recording_mcap -- --ignored --nocapture`.
#[test]
#[ignore = "a measurement, not a check"]
fn cost_of_a_minute() {
    let folder = Folder::new("cost");
    let path = folder.join("run.mcap");
    let ticks = run(3_000);
    let mut writer = RecordingWriter::create(&path, &info(), &[]).unwrap();
    let (mut writes, mut flushes) = (Vec::new(), Vec::new());
    for second in ticks.chunks(50) {
        for tick in second {
            let start = std::time::Instant::now();
            writer.write(tick).unwrap();
            writes.push(start.elapsed());
        }
        let start = std::time::Instant::now();
        writer.flush().unwrap();
        flushes.push(start.elapsed());
    }
    writer.finish().unwrap();
    for (name, times) in [("write", &mut writes), ("flush", &mut flushes)] {
        times.sort();
        println!("{name}: p50 {:?}, max {:?}", times[times.len() / 2], times[times.len() - 1]);
    }
    println!("{} bytes", std::fs::metadata(&path).unwrap().len());
    let start = std::time::Instant::now();
    let rows = Recording::read(&path).unwrap().rows();
    println!("read {rows} rows in {:?}", start.elapsed());
}

#[test]
fn the_writer_can_move_to_the_recorder_thread() {
    fn movable<T: Send>() {}
    movable::<RecordingWriter>();
}
