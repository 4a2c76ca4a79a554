//! Recordings as they are read: what another tool made of one, what is none, and the table of rows that is made of one.

#![allow(clippy::unwrap_used, reason = "the helpers of a test fail by panicking, as the test does")]

mod recorded;

use model::rig::Rig;
use proto::recording::{
    Arrival, Attachment, Recording, RecordingError, RecordingWriter, TickRecord, parse_mcap, read_mcap,
};
use recorded::{Folder, all_bits, info, run, write};

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

/// Bytes that another tool makes of a file: one compressed chunk, all commands first, then all ticks, then the frames that were sensed.
fn saved_again(bytes: &[u8], compression: &str, compress: fn(&[u8]) -> Vec<u8>) -> Vec<u8> {
    let (mut parts, mut ticks): ([Vec<u8>; 4], Vec<Vec<u8>>) = Default::default();
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
                let message = record(0x05, &body);
                if place == 2 { ticks.push(message) } else { parts[place].extend(message) }
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
    // The second half of the run first.
    let half = ticks.len() / 2;
    ticks.rotate_left(half);
    parts[2] = ticks.concat();
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

/// For a rig a sensor that gives nothing in a tick costs that reading; the command that was sent and the other sensor stand.
#[test]
fn a_broken_sensor_costs_a_rig_its_readings_and_no_rows() {
    let folder = Folder::new("broken-sensor");
    let path = folder.join("run.mcap");
    let mut ticks = run(100);
    ticks[0].p_pos_kpa = f64::NAN;
    ticks[40..42].iter_mut().for_each(|tick| tick.p_neg_kpa = f64::NAN);
    write(&path, &ticks, 50);
    let recording = Recording::read_for(&path, &Rig::builtin("dual_pressure").unwrap()).unwrap();
    // No run begins without all pressures.
    assert_eq!((recording.rows(), recording.segments().len()), (99, 1));
    let [u_pos, p_pos] = recording.require(["u_pos", "p_pos_kpa"]).unwrap();
    for (row, tick) in ticks[1..].iter().enumerate() {
        assert_eq!((u_pos[row], p_pos[row]), (tick.u_pos, tick.p_pos_kpa), "{row}");
    }
    let missing = recording.missing("p_neg_kpa").unwrap();
    assert!(missing.iter().enumerate().all(|(row, missing)| *missing == matches!(row, 39 | 40)));
    let told = recording.notes().join("\n");
    assert!(told.contains("2 readings of p_neg_kpa are missing (the first at 0.80 s)"), "{told}");
}

/// A chunk that was damaged on the disk is left out, and what is lost with it is told.
#[test]
fn a_damaged_chunk_says_how_much_it_lacks() {
    let folder = Folder::new("damaged-chunk");
    let path = folder.join("run.mcap");
    write(&path, &run(200), 50);
    let whole = std::fs::read(&path).unwrap();
    let chunks = bodies(&whole, 0x06);
    // Of ticks four; the last one is of what stands behind them.
    assert!(chunks.len() >= 4, "{}", chunks.len());
    let mut damaged = whole.clone();
    damaged[(chunks[1].start + chunks[1].end) / 2] ^= 0x10;
    let content = parse_mcap("x.mcap", &damaged).unwrap();
    assert_eq!((content.ticks.len(), content.notes.len()), (150, 1), "{:?}", content.notes);
    let told = &content.notes[0];
    assert!(told.contains("left out") && told.ends_with("; 50 ticks (1.00 s) are lost"), "{told}");
}

/// Bodies of the records with this code.
fn bodies(file: &[u8], code: u8) -> Vec<std::ops::Range<usize>> {
    let (mut at, mut found) = (mcap::MAGIC.len(), Vec::new());
    while let Some(length) = file.get(at + 1..at + 9) {
        let length = u64::from_le_bytes(length.try_into().unwrap()) as usize;
        if file[at] == code {
            found.push(at + 9..at + 9 + length);
        }
        at += 9 + length;
    }
    found
}

/// 200 ticks in chunks of 50, with a configuration and two references inside.
fn with_attachments(folder: &Folder) -> Vec<u8> {
    let path = folder.join("run.mcap");
    let file = |name: &str, data: &[u8]| Attachment {
        name: name.to_owned(),
        media_type: "text/plain".to_owned(),
        data: data.to_vec(),
    };
    let inside =
        [file("controller.toml", b"[link]"), file("reference.csv", b"first"), file("reference.csv", b"second")];
    let mut writer = RecordingWriter::create(&path, &info(), &inside).unwrap();
    for second in run(200).chunks(50) {
        second.iter().for_each(|tick| writer.write(tick).unwrap());
        writer.flush().unwrap();
    }
    std::fs::read(writer.finish().unwrap()).unwrap()
}

/// The content of attachments is nothing to the ticks behind them.
#[test]
fn a_damaged_attachment_is_left_out_and_named() {
    let folder = Folder::new("damaged-attachment");
    let whole = with_attachments(&folder);
    let reference = bodies(&whole, 0x09)[1].clone();
    // In the data, the length of the data, and the name.
    for from_end in [5, 16, 35] {
        let mut damaged = whole.clone();
        damaged[reference.end - from_end] ^= 0x40;
        let content = parse_mcap("x.mcap", &damaged).unwrap();
        assert_eq!(all_bits(&content.ticks), all_bits(&run(200)), "{:?}", content.notes);
        assert!(!content.complete && content.notes.len() == 1, "{:?}", content.notes);
        let told = &content.notes[0];
        assert!(told.contains("the attachment reference.csv is damaged (its") && told.ends_with("left out"), "{told}");
        assert_eq!(content.damaged_attachments, ["reference.csv"]);
        // The second reference is not taken for the first.
        let names: Vec<&str> = content.attachments.iter().map(|file| file.name.as_str()).collect();
        assert_eq!(names, ["controller.toml"]);
    }
    // A length that leads elsewhere, with the index at the end of the file and, of a file that was not finished, without.
    let mut damaged = whole.clone();
    damaged[reference.start - 7] ^= 0x40;
    let unfinished = &damaged[..bodies(&whole, 0x06).last().unwrap().end];
    for file in [&damaged[..], unfinished] {
        let content = parse_mcap("x.mcap", file).unwrap();
        assert_eq!(all_bits(&content.ticks), all_bits(&run(200)), "{:?}", content.notes);
        assert!(content.notes[0].ends_with("; no tick is lost"), "{:?}", content.notes);
        assert!(!content.attachments.iter().any(|file| file.data == b"second"), "no first of its name before it");
    }
    // Without the index nobody knows what was attached in the stretch, so sound ones behind it go too, and the first is named.
    let second = bodies(&whole, 0x09)[2].clone();
    let mut behind = unfinished.to_vec();
    (0..2).for_each(|_| behind.extend_from_slice(&whole[second.start - 9..second.end]));
    let content = parse_mcap("x.mcap", &behind).unwrap();
    assert!(!content.attachments.iter().any(|file| file.data == b"second"));
    let left_out: Vec<&String> = content.notes.iter().filter(|note| note.contains("and all behind it")).collect();
    assert!(left_out.len() <= 1, "told once: {left_out:?}");
    let told = left_out.first().unwrap_or_else(|| panic!("not told: {:?}", content.notes));
    assert!(told.contains("the attachment reference.csv and all behind it were left out"), "{told}");
    let on_attachments: Vec<&String> = content.attachment_notes.iter().map(|at| &content.notes[*at]).collect();
    assert_eq!(on_attachments, left_out);
}

/// Zeros in the middle of a file, as a disk leaves them: what is whole behind them is read.
#[test]
fn reading_goes_on_behind_an_erased_stretch() {
    let folder = Folder::new("erased");
    let whole = with_attachments(&folder);
    let chunks = bodies(&whole, 0x06);
    let ticks = run(200);
    let rest = [&ticks[..50], &ticks[150..]].concat();
    // From within the second chunk of ticks to within the third.
    let erased = (chunks[2].start + chunks[2].end) / 2..(chunks[3].start + chunks[3].end) / 2;
    let mut damaged = whole.clone();
    damaged[erased].fill(0);
    // Unfinished, the file has no index.
    let unfinished = &damaged[..chunks[4].end];
    for (file, notes) in [(&damaged[..], 1), (unfinished, 2)] {
        let content = parse_mcap("x.mcap", file).unwrap();
        assert_eq!(all_bits(&content.ticks), all_bits(&rest), "{:?}", content.notes);
        assert_eq!((content.notes.len(), content.complete), (notes, false), "{:?}", content.notes);
        assert!(content.notes[0].ends_with("; 100 ticks (2.00 s) are lost"), "{:?}", content.notes);
        assert_eq!(content.lost_before.first(), Some(&50));
    }
    // Up to the end, and with the chunk that says which channel is which.
    let mut damaged = whole.clone();
    damaged[chunks[0].start - 9..chunks[2].start].fill(0);
    damaged[chunks[4].start - 9..chunks[4].end].fill(0);
    let content = parse_mcap("x.mcap", &damaged).unwrap();
    assert_eq!(all_bits(&content.ticks), all_bits(&ticks[100..150]), "{:?}", content.notes);
    let lost: Vec<bool> = content.notes.iter().map(|note| note.contains("damaged at byte")).collect();
    assert_eq!(lost, [true, true], "{:?}", content.notes);
    assert!(content.notes[0].ends_with("; 100 ticks (2.00 s) are lost"), "{:?}", content.notes);
    assert!(content.notes[1].ends_with("; 50 ticks (1.00 s) are lost"), "{:?}", content.notes);
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

/// 4 s of coming to rest, 2 s of rows, 1 s after them: rows begin a second before the experiment's own, from rest.
#[test]
fn the_way_to_rest_before_an_experiment_is_left_out() {
    let mut ticks = run(350);
    for (n, tick) in ticks.iter_mut().enumerate() {
        tick.experiment = [1, 2, 3][usize::from(n >= 200) + usize::from(n >= 300)];
    }
    let recording = Recording::from_ticks("experiment", &ticks).unwrap();
    assert_eq!(recording.rows(), 200);
    assert_eq!(recording.column("u_pos").unwrap()[50], ticks[200].u_pos);
    assert!(recording.notes().iter().any(|note| note.contains("150 ticks left out in which the rig came to rest")));
    // Within a run: the run before it stays, and what is left out is a gap.
    let mut within = run(500);
    for (n, tick) in within.iter_mut().enumerate() {
        tick.experiment = [0, 1, 2][usize::from(n >= 100) + usize::from(n >= 300)];
    }
    let recording = Recording::from_ticks("run", &within).unwrap();
    assert_eq!(recording.segments(), [0..100, 100..350]);
    // One that was stopped before its first row leaves all that came.
    for tick in &mut within {
        tick.experiment = tick.experiment.min(1);
    }
    assert_eq!(Recording::from_ticks("stopped", &within).unwrap().rows(), 500);
}
