//! Broken inputs by the million: what reads bytes from outside answers or refuses, and never panics or hangs.
//!
//! Sound inputs are mutated (bits flipped, bytes repeated, cut, spliced, lengths made huge) by a seeded generator, so that
//! a failure can be repeated. Each run here is short; ten minutes of one reader, with its count:
//!
//! ```sh
//! cargo test --release -p controller --test mutation -- --ignored --nocapture ten_minutes_of_configurations
//! ```
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::time::{Duration, Instant};

use controller::config::{Config, ReferenceChoice, Safety};
use controller::daemon::contracts;
use controller::operator::desk::DeskOptions;
use controller::operator::mailbox::mailbox;
use controller::operator::socket::{May, Reply, Running, serve};
use flight::{Recorder, RecorderOptions};
use policy::Policy;
use proto::recording::{EventLevel, RecordingInfo, RecordingWriter, TickRecord, read_mcap};
use proto::reference::Reference;
use proto::wire::{Bye, ByeReason, Command, FrameReader, Hello, Mode};

/// Time of a short run, and of a long one.
const SHORT: Duration = Duration::from_millis(1_500);
const LONG: Duration = Duration::from_secs(600);
/// One input may take this long, on a machine that does other things as well.
const ONE: Duration = Duration::from_secs(5);

/// xorshift64*, Vigna 2016: the same inputs everywhere for one seed.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }

    fn below(&mut self, n: usize) -> usize {
        if n == 0 { 0 } else { (self.next() % n as u64) as usize }
    }
}

/// Bytes and words that readers stumble over.
const WORDS: [&[u8]; 18] = [
    b"\0",
    b"\xff",
    b"\n",
    b"\"",
    b"[",
    b"]",
    b"{",
    b"=",
    b"-",
    b"nan",
    b"inf",
    b"1e999",
    b"-9223372036854775808",
    b"\xff\xff\xff\xff",
    b"\x7f\xff\xff\xff",
    b"\x80\x00\x00\x00",
    b"\xf0\x9f\x92\xa9",
    b"\x00\x00\x00\x00\x00\x00\x00\x00",
];

fn mutated(seed: &[u8], other: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    for _ in 0..=random.below(4) {
        let at = random.below(bytes.len() + 1);
        match random.below(7) {
            0 if at < bytes.len() => bytes[at] ^= 1 << random.below(8),
            1 if at < bytes.len() => bytes[at] = random.next() as u8,
            2 => bytes.truncate(at),
            3 => {
                let word = WORDS[random.below(WORDS.len())];
                bytes.splice(at..at, word.iter().copied());
            }
            4 if at < bytes.len() => {
                let end = (at + 1 + random.below(64)).min(bytes.len());
                bytes.drain(at..end);
            }
            5 => {
                let end = (at + random.below(256)).min(bytes.len());
                let piece = bytes[at..end].to_vec();
                bytes.splice(at..at, piece);
            }
            _ => {
                let from = random.below(other.len());
                let piece = other[from..(from + 64).min(other.len())].to_vec();
                bytes.splice(at..at, piece);
            }
        }
    }
    bytes
}

/// Feeds a reader for a while; how many inputs it had.
fn feed(name: &str, seeds: &[Vec<u8>], time: Duration, mut reader: impl FnMut(&[u8])) {
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    let begun = Instant::now();
    let mut count = 0_u64;
    while begun.elapsed() < time {
        let (seed, other) = (&seeds[random.below(seeds.len())], &seeds[random.below(seeds.len())]);
        let input = mutated(seed, other, &mut random);
        let started = Instant::now();
        let ended = catch_unwind(AssertUnwindSafe(|| reader(&input)));
        let took = started.elapsed();
        if ended.is_err() || took > ONE {
            let file = std::env::temp_dir().join(format!("mutation-{name}-{count}"));
            std::fs::write(&file, &input).unwrap();
            panic!("{name}: input {count}, {took:?}, panic {}; kept in {}", ended.is_err(), file.display());
        }
        count += 1;
    }
    println!("{name}: {count} inputs in {:.0} s, no panic, none slow", begun.elapsed().as_secs_f64());
}

fn one_line(error: &dyn std::fmt::Display) {
    let text = error.to_string();
    assert!(!text.contains('\n') && !text.is_empty(), "{text:?}");
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn configurations(time: Duration) {
    let packaged = std::fs::read(root().join("packaging/controller.toml")).unwrap();
    let seeds = [packaged, b"[link]\naddress = \"10.0.0.1:50500\"\n[safety]\nmax_pos_kpa = 120.5\n".to_vec()];
    feed("configuration", &seeds, time, |bytes| {
        if let Ok(text) = std::str::from_utf8(bytes)
            && let Err(error) = Config::parse(text, Path::new("c.toml"))
        {
            one_line(&error);
        }
    });
}

fn rigs(time: Duration) {
    let seeds: Vec<Vec<u8>> = model::rig::Rig::BUILTIN
        .iter()
        .filter_map(|name| model::rig::Rig::builtin_text(name))
        .map(|text| text.as_bytes().to_vec())
        .collect();
    feed("rig file", &seeds, time, |bytes| {
        if let Ok(text) = std::str::from_utf8(bytes)
            && let Err(error) = model::rig::Rig::from_toml(text)
        {
            one_line(&error);
        }
    });
}

fn references(time: Duration) {
    let seeds = [
        b"time_s,ref_pos_kpa,ref_neg_kpa\n0,80,-70\n5,80,-70\n5,100,-75\n".to_vec(),
        Reference::paper().to_csv().into_bytes()[..2_000].to_vec(),
    ];
    feed("reference", &seeds, time, |bytes| match Reference::parse("r.csv", bytes) {
        Ok(reference) => {
            let [pos, neg] = reference.at(1.0);
            assert!(pos.is_finite() && neg.is_finite());
        }
        Err(error) => one_line(&error),
    });
}

fn policies(time: Duration) {
    let shipped = std::fs::read(root().join("controller/policies/default.onnx")).unwrap();
    feed("policy", &[shipped], time, |bytes| match Policy::from_bytes("p.onnx".to_owned(), bytes, &contracts()) {
        Ok(_) => {}
        Err(fault) => one_line(&fault),
    });
}

fn frames(time: Duration) {
    let command = Command {
        sequence: 9,
        clock_ns: 1,
        session: 7,
        tick: 3,
        duty: [0.5, 0.5],
        mode: Mode::Run,
        ttl_ticks: 2,
        digital_outputs: 1,
    };
    let hello = Hello::new(1, 1, 7, "mutation").encode().to_vec();
    let bye = Bye { sequence: 2, clock_ns: 2, session: 7, reason: ByeReason::Normal }.encode().to_vec();
    let seeds = [hello, command.encode().to_vec(), bye];
    feed("wire", &seeds, time, |bytes| {
        let mut reader = FrameReader::new();
        let mut rest = bytes;
        while !rest.is_empty() {
            let taken = reader.push(rest);
            rest = &rest[taken..];
            loop {
                match reader.next_frame() {
                    Ok(None) => break,
                    Ok(Some(received)) => assert_eq!(received.raw.as_bytes().len(), received.frame.kind().length()),
                    Err(damage) if damage.is_fatal() => return,
                    Err(_) => {}
                }
            }
        }
    });
}

fn recordings(time: Duration) {
    let folder = std::env::temp_dir().join(format!("mutation-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let sound = folder.join("sound.mcap");
    let mut writer = RecordingWriter::create(&sound, &RecordingInfo::new("mutation", 0), &[]).unwrap();
    for tick in 0..20 {
        let record =
            TickRecord { session: 1, tick, sense_present: true, command_present: true, ..TickRecord::default() };
        writer.write(&record).unwrap();
        if tick % 7 == 0 {
            writer.event(0, EventLevel::Info, "test", "something").unwrap();
            writer.flush().unwrap();
        }
    }
    writer.finish().unwrap();
    let seed = std::fs::read(&sound).unwrap();
    let file = folder.join("m.mcap");
    feed("recording", &[seed], time, |bytes| {
        std::fs::write(&file, bytes).unwrap();
        if let Err(error) = read_mcap(&file) {
            one_line(&error);
        }
    });
    std::fs::remove_dir_all(folder).unwrap();
}

/// The real socket with the real thread behind it; no tick, so whatever is asked ends in a refusal.
fn requests(time: Duration) {
    let folder = std::env::temp_dir().join(format!("mut-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("s");
    let info = RecordingInfo::new("mutation", 0);
    let options = RecorderOptions::new(|_| String::new());
    let (recorder, _sink) = Recorder::start(&folder.join("r.mcap"), &info, &[], options).unwrap();
    let (_tick, desk) = mailbox();
    let (_reloads, inbox) = channel();
    let stop = Arc::new(AtomicBool::new(false));
    let options = DeskOptions {
        mailbox: desk,
        safety: Safety::default(),
        reference: ReferenceChoice::default(),
        health: recorder.health(),
        notes: recorder.noter(),
        may: May::Fly,
        running: Running::default(),
        followed: None,
        policies: None,
        experiments: None,
        viewers: None,
        exploration: handover::ExplorationRules { seed: 0, std_share: 0.02, most_duty: 0.02 },
        stale: Duration::from_millis(250),
        reloads: inbox,
    };
    let served = serve(&path, options, Arc::clone(&stop)).unwrap();
    let seeds = [
        b"{\"ask\":\"status\"}\n".to_vec(),
        b"{\"ask\":\"arm\"}\n".to_vec(),
        b"{\"ask\":\"disarm\"}\n".to_vec(),
        b"{\"ask\":\"reference\",\"file\":\"/r.csv\",\"csv\":\"time_s,ref_pos_kpa,ref_neg_kpa\\n0,80,-70\\n\"}\n"
            .to_vec(),
    ];
    feed("control socket", &seeds, time, |bytes| {
        let mut client = UnixStream::connect(&path).unwrap();
        client.set_read_timeout(Some(ONE)).unwrap();
        // A line's end, so that the answer need not wait for the request's time.
        let _ = client.write_all(bytes).and_then(|()| client.write_all(b"\n"));
        let mut text = String::new();
        let _ = client.read_to_string(&mut text);
        if let Some(line) = text.lines().next() {
            serde_json::from_str::<Reply>(line).unwrap();
        }
    });
    stop.store(true, Ordering::Relaxed);
    served.join();
    drop(recorder);
    std::fs::remove_dir_all(folder).unwrap();
}

macro_rules! runs {
    ($($short:ident $long:ident $run:ident)*) => {$(
        #[test]
        fn $short() {
            $run(SHORT);
        }

        #[test]
        #[ignore = "ten minutes"]
        fn $long() {
            $run(LONG);
        }
    )*};
}

runs! {
    broken_configurations_are_refused ten_minutes_of_configurations configurations
    broken_rigs_are_refused ten_minutes_of_rigs rigs
    broken_references_are_refused ten_minutes_of_references references
    broken_policies_are_refused ten_minutes_of_policies policies
    broken_frames_are_refused ten_minutes_of_frames frames
    broken_recordings_are_refused ten_minutes_of_recordings recordings
    broken_requests_are_refused ten_minutes_of_requests requests
}
