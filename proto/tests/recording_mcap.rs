//! Recordings in MCAP: what goes in comes out, whatever happens to the end of the file.

#![allow(clippy::unwrap_used, reason = "the helpers of a test fail by panicking, as the test does")]

use std::path::{Path, PathBuf};
use std::time::{Duration, UNIX_EPOCH};

use proptest::prelude::*;
use proto::recording::{
    Arrival, Attachment, EventLevel, LawParts, LogTime, Recording, RecordingError, RecordingInfo, RecordingWriter,
    TickRecord, WriteMcapError, parse_mcap, read_mcap, unfinished_path,
};

/// A folder of this test's own, gone at the end.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("recording-{}-{name}", std::process::id()));
        let _ = std::fs::remove_dir_all(&path);
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn join(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn info() -> RecordingInfo {
    let mut info = RecordingInfo::new("controller 0.1.0", 1_000);
    info.started = UNIX_EPOCH + Duration::from_secs(1_795_140_245);
    info
}

/// Every bit of a record, so that NaN compares with NaN.
fn bits(tick: &TickRecord) -> Vec<u64> {
    let law = |l: &LawParts| {
        [l.feed_forward, l.backlash, l.correction, l.proportional, l.integral, l.u_raw].map(f64::to_bits)
    };
    let byte = |b: &u8| u64::from(*b);
    let mut all = vec![
        tick.session.into(),
        tick.tick.into(),
        tick.receive_ns,
        tick.arrival.code().into(),
        tick.sense_present.into(),
        tick.command_present.into(),
        tick.crio_state.into(),
        tick.crio_trip.into(),
        tick.pump_on.into(),
        tick.mode.into(),
        tick.state.into(),
        tick.fault.into(),
        tick.arrival_lateness_ns as u64,
        tick.receive_check_ns.into(),
        tick.predict_ns.into(),
        tick.law_ns.into(),
        tick.send_ns.into(),
        tick.compute_ns.into(),
        tick.deadline_missed.into(),
        tick.records_dropped.into(),
        tick.findings,
        tick.inputs.into(),
        tick.observation_hash,
        tick.policy_stage.into(),
        tick.authority.to_bits(),
        tick.swap_id.into(),
        tick.filter_active.into(),
        tick.experiment.into(),
        tick.exploration_pos.to_bits(),
        tick.exploration_neg.to_bits(),
    ];
    all.extend(tick.policy_output.map(|v| u64::from(v.to_bits())));
    all.extend(tick.command_before_filter.map(f64::to_bits));
    all.extend(tick.sense.iter().map(byte));
    all.extend(tick.command.iter().map(byte));
    let single = [tick.echo_pos, tick.echo_neg];
    all.extend(tick.volts.iter().chain(&single).map(|v| u64::from(v.to_bits())));
    let double = [tick.p_pos_kpa, tick.p_neg_kpa, tick.ref_pos_kpa, tick.ref_neg_kpa];
    let predicted = tick.predicted_pos_kpa.iter().chain(&tick.predicted_neg_kpa);
    all.extend(double.iter().chain(predicted).map(|v| v.to_bits()));
    all.extend([tick.u_pos, tick.u_neg].map(f64::to_bits));
    all.extend(law(&tick.law_pos).into_iter().chain(law(&tick.law_neg)));
    all
}

fn all_bits(ticks: &[TickRecord]) -> Vec<Vec<u64>> {
    ticks.iter().map(bits).collect()
}

/// A run as the daemon makes it: readings, a command and both frames in every tick.
fn run(ticks: u32) -> Vec<TickRecord> {
    (0..ticks)
        .map(|tick| {
            let t = f64::from(tick) / 50.0;
            let mut record = TickRecord {
                session: 77,
                tick,
                receive_ns: 1_000 + u64::from(tick) * 20_000_000 + u64::from(tick * 7_919 % 90_001),
                arrival: Arrival::InTime,
                sense_present: true,
                command_present: true,
                p_pos_kpa: 80.0 + t / 3.0 + 6.0 * (t * 0.785).sin(),
                p_neg_kpa: -70.0 - t / 12.0 + 3.0 * (t * 0.628).sin(),
                ref_pos_kpa: 80.0 + t / 3.0,
                ref_neg_kpa: -70.0 - t / 12.0,
                u_pos: 0.7 + 0.1 * t.sin(),
                u_neg: 0.8 + 0.1 * t.cos(),
                pump_on: true,
                mode: 1,
                ..TickRecord::default()
            };
            // Everything else that a tick measures or computes, with noise in its last bits.
            let noise = |k: u32| f64::from((tick * 26_107 + k * 40_503) % 10_007) / 10_007.0 - 0.5;
            record.volts = [4.2 + 0.003 * noise(1) as f32, 3.9 + 0.003 * noise(2) as f32, f32::NAN, f32::NAN];
            (record.echo_pos, record.echo_neg) = (record.u_pos as f32, record.u_neg as f32);
            record.p_pos_kpa += 0.1 * noise(3);
            record.p_neg_kpa += 0.03 * noise(4);
            let ahead = |p: f64| std::array::from_fn(|i| p + 0.02 * noise(5 + i as u32));
            record.predicted_pos_kpa = ahead(record.p_pos_kpa);
            record.predicted_neg_kpa = ahead(record.p_neg_kpa);
            let law = |u: f64, k: u32| LawParts {
                feed_forward: u + 0.01 * noise(k),
                proportional: 0.01 * noise(k + 1),
                integral: 0.02 * noise(k + 2),
                u_raw: u,
                ..LawParts::default()
            };
            (record.law_pos, record.law_neg) = (law(record.u_pos, 10), law(record.u_neg, 20));
            let ns = |typical: f64, k: u32| (typical * (1.0 + 0.2 * noise(k))) as u32;
            record.arrival_lateness_ns = i64::from(ns(60_000.0, 30)) - 60_000;
            record.receive_check_ns = ns(4_000.0, 31);
            record.predict_ns = ns(300_000.0, 32);
            record.law_ns = ns(2_000.0, 33);
            record.send_ns = ns(15_000.0, 34);
            record.compute_ns = ns(321_000.0, 35);
            record.sense = std::array::from_fn(|i| (tick as usize * 31 + i * 17) as u8);
            record.command = std::array::from_fn(|i| (tick as usize * 13 + i * 7) as u8);
            record
        })
        .collect()
}

fn write(path: &Path, ticks: &[TickRecord], flush_every: usize) {
    let mut writer = RecordingWriter::create(path, &info(), &[]).unwrap();
    for seconds in ticks.chunks(flush_every) {
        for tick in seconds {
            writer.write(tick).unwrap();
        }
        writer.flush().unwrap();
    }
    assert_eq!(writer.finish().unwrap(), path);
}

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

#[test]
fn files_that_are_no_recording_say_what_they_are() {
    let folder = Folder::new("foreign");
    let path = folder.join("x.mcap");
    let message = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        let message = read_mcap(&path).unwrap_err().to_string();
        assert!(!message.contains('\n') && message.contains("x.mcap"), "{message}");
        message
    };
    assert!(message(b"").contains("empty"));
    assert!(message(b"time_s,u_pos\n0,1\n").contains("not an MCAP file"));
    assert!(message(mcap::MAGIC).contains("no tick"));

    let mut foreign = Vec::new();
    let mut writer = mcap::Writer::new(std::io::Cursor::new(&mut foreign)).unwrap();
    let schema = writer.add_schema("x", "jsonschema", b"{}").unwrap();
    writer.add_channel(schema, "/tick", "json", &Default::default()).unwrap();
    writer.finish().unwrap();
    drop(writer);
    let said = message(&foreign);
    assert!(said.contains("not a recording of the controller") && said.contains("/tick (x)"), "{said}");

    let mut later = Vec::new();
    let mut writer = mcap::Writer::new(std::io::Cursor::new(&mut later)).unwrap();
    let metadata = [("format".to_owned(), "2".to_owned())].into_iter().collect();
    let metadata = mcap::records::Metadata { name: "recording".to_owned(), metadata };
    writer.write_metadata(&metadata).unwrap();
    writer.finish().unwrap();
    drop(writer);
    assert!(message(&later).contains("recording format 2; this program reads up to 1"));
}

/// A record as MCAP writes it: code, length, body.
fn record(code: u8, body: &[u8]) -> Vec<u8> {
    [&[code][..], &(body.len() as u64).to_le_bytes(), body].concat()
}

/// A zstd frame without compression: blocks of up to 1000 bytes as they are (RFC 8878, raw blocks, content size of eight bytes).
fn zstd_raw(bytes: &[u8]) -> Vec<u8> {
    let mut frame = b"\x28\xb5\x2f\xfd\xe0".to_vec();
    frame.extend_from_slice(&(bytes.len() as u64).to_le_bytes());
    let count = bytes.chunks(1000).count();
    for (at, block) in bytes.chunks(1000).enumerate() {
        let header = (block.len() as u32) << 3 | u32::from(at + 1 == count);
        frame.extend_from_slice(&header.to_le_bytes()[..3]);
        frame.extend_from_slice(block);
    }
    frame
}

fn lz4(bytes: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let info = lz4_flex::frame::FrameInfo::new().block_size(lz4_flex::frame::BlockSize::Max64KB);
    let mut encoder = lz4_flex::frame::FrameEncoder::with_frame_info(info, Vec::new());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// What another tool makes of a file: one compressed chunk, all commands first, then all ticks, then the frames that were sensed.
fn saved_again(bytes: &[u8], compression: &str, compress: fn(&[u8]) -> Vec<u8>) -> Vec<u8> {
    let mut parts: [Vec<u8>; 4] = Default::default();
    let mut topics = std::collections::HashMap::new();
    let mut header = Vec::new();
    let options = mcap::read::Options::IgnoreEndMagic.into();
    for found in mcap::read::ChunkFlattener::new_with_options(bytes, options).unwrap() {
        use mcap::records::Record;
        match found.unwrap() {
            Record::Message { header, data } => {
                let topic: &String = &topics[&header.channel_id];
                let place = match topic.as_str() {
                    "/command" => 1,
                    "/sense" => 3,
                    _ => 2,
                };
                let body = [
                    &header.channel_id.to_le_bytes()[..],
                    &header.sequence.to_le_bytes(),
                    &header.log_time.to_le_bytes(),
                    &header.publish_time.to_le_bytes(),
                    &data,
                ]
                .concat();
                parts[place].extend(record(0x05, &body));
            }
            Record::Schema { header, data } => {
                let string = |text: &str| [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat();
                let body = [
                    &header.id.to_le_bytes()[..],
                    &string(&header.name),
                    &string(&header.encoding),
                    &(data.len() as u32).to_le_bytes(),
                    &data,
                ]
                .concat();
                parts[0].extend(record(0x03, &body));
            }
            Record::Channel(channel) => {
                let string = |text: &str| [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat();
                let body = [
                    &channel.id.to_le_bytes()[..],
                    &channel.schema_id.to_le_bytes(),
                    &string(&channel.topic),
                    &string(&channel.message_encoding),
                    &0_u32.to_le_bytes(),
                ]
                .concat();
                topics.insert(channel.id, channel.topic);
                parts[0].extend(record(0x04, &body));
            }
            Record::Header(_) => header = record(0x01, &[0; 8]),
            _ => {}
        }
    }
    let records = parts.concat();
    let stored = compress(&records);
    let body = [
        &[0; 16][..],
        &(records.len() as u64).to_le_bytes(),
        &crc32fast::hash(&records).to_le_bytes(),
        &(compression.len() as u32).to_le_bytes(),
        compression.as_bytes(),
        &(stored.len() as u64).to_le_bytes(),
        &stored,
    ]
    .concat();
    [mcap::MAGIC, &header, &record(0x06, &body), &record(0x0F, &[0; 4]), &record(0x02, &[0; 20]), mcap::MAGIC].concat()
}

#[test]
fn what_another_tool_compressed_and_put_in_another_order_is_read() {
    let folder = Folder::new("saved-again");
    let path = folder.join("run.mcap");
    let ticks = run(200);
    write(&path, &ticks, 50);
    let bytes = std::fs::read(&path).unwrap();
    for (name, compress) in [("zstd", zstd_raw as fn(&[u8]) -> Vec<u8>), ("lz4", lz4), ("", <[u8]>::to_vec)] {
        let again = saved_again(&bytes, name, compress);
        let content = parse_mcap("again.mcap", &again).unwrap();
        assert_eq!(content.notes, [""; 0], "{name}");
        assert_eq!(all_bits(&content.ticks), all_bits(&ticks), "{name}");
        // Cut, it gives what is whole: ticks stand in the second third of it.
        let cut = parse_mcap("cut.mcap", &again[..again.len() * 6 / 10]).unwrap();
        assert!(cut.ticks.len() > 20 && cut.ticks.len() < 200, "{name}: {}", cut.ticks.len());
        assert!(cut.notes[0].contains("cut short"), "{:?}", cut.notes);
    }
    let said = parse_mcap("x.mcap", &saved_again(&bytes, "brotli", <[u8]>::to_vec)).unwrap_err().to_string();
    assert!(said.contains("compressed with brotli"), "{said}");
}

#[test]
fn the_table_is_the_same_from_mcap_and_from_its_csv() {
    let folder = Folder::new("table");
    let path = folder.join("run.mcap");
    let mut ticks = run(100);
    // Lost frames, a broken sensor and a tick without a command: holes, not invented rows.
    ticks[20].arrival = Arrival::Missing;
    ticks[40].p_neg_kpa = f64::NAN;
    ticks[41].arrival = Arrival::Damaged;
    ticks[60].command_present = false;
    ticks[70].arrival = Arrival::Late;
    write(&path, &ticks, 50);

    let recording = Recording::read(&path).unwrap();
    assert_eq!(recording.rows(), 96);
    assert_eq!(recording.segments(), [0..20, 20..39, 39..57, 57..96]);
    let [time_s, u_pos, p_neg] =
        [recording.time_s(), recording.column("u_pos").unwrap(), recording.column("p_neg_kpa").unwrap()];
    assert_eq!((time_s[0], time_s[1], time_s[20], time_s[95]), (0.0, 0.02, 0.42, 1.98));
    assert_eq!((u_pos[20], p_neg[20]), (ticks[21].u_pos, ticks[21].p_neg_kpa));
    let names: Vec<&str> = recording.names().collect();
    assert_eq!(
        names,
        ["u_pos", "u_neg", "p_pos_kpa", "p_neg_kpa", "ref_pos_kpa", "ref_neg_kpa", "pump_on", "mode", "state", "fault"]
    );

    let csv_path = folder.join("run.csv");
    recording.write_csv(&csv_path).unwrap();
    let from_csv = Recording::read(&csv_path).unwrap();
    assert_eq!(from_csv.time_s(), recording.time_s());
    assert_eq!(from_csv.segments(), recording.segments());
    for name in names {
        assert_eq!(from_csv.column(name), recording.column(name), "{name}");
    }
}

#[test]
fn a_new_session_is_a_gap_as_long_as_it_was() {
    let mut ticks = run(10);
    let mut second = run(10);
    for tick in &mut second {
        tick.session = 78;
        // The cRIO counts from 0 again; 3 s went by.
        tick.receive_ns += 3_000_000_000 + ticks[9].receive_ns;
        tick.ref_pos_kpa = f64::NAN;
    }
    ticks.append(&mut second);
    let recording = Recording::from_ticks("two sessions", &ticks).unwrap();
    assert_eq!(recording.segments(), [0..10, 10..20]);
    let pause_s = recording.time_s()[10] - recording.time_s()[9];
    // On the 20 ms grid, so within half a period of what the clock said.
    assert!((pause_s - 3.0).abs() <= 0.011, "{pause_s}");
    assert!(recording.column("ref_pos_kpa").is_none());
    assert!(recording.notes()[0].contains("10 of 20 rows have a reference"));
}

#[test]
fn ticks_without_any_reading_are_an_error() {
    let error = Recording::from_ticks("empty", &[TickRecord::default(); 3]).unwrap_err();
    assert!(matches!(error, RecordingError::NoReadings { ticks: 3, .. }));
}

/// What a tick costs the recorder thread: `cargo test --release --test recording_mcap -- --ignored --nocapture`.
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
