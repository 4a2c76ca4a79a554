//! The recorder with real files: what it writes reads back, and what a disk can do to it.
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use flight::{Event, RecordError, Recorder, RecorderOptions};
use proto::recording::{EventLevel, RecordingInfo, TickRecord, read_mcap, unfinished_path};

/// A folder of its own, removed at the end.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("flight-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn file(&self) -> PathBuf {
        self.0.join("run.mcap")
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn start(path: &Path) -> Result<(Recorder, flight::RecordSink), RecordError> {
    let info = RecordingInfo::new("test 1.0", 0);
    Recorder::start(path, &info, &[], RecorderOptions::new(|event| format!("code {}", event.code)))
}

fn tick(number: u32) -> TickRecord {
    TickRecord {
        session: 5,
        tick: number,
        receive_ns: u64::from(number) * 20_000_000,
        p_pos_kpa: f64::from(number) * 0.1,
        sense_present: true,
        ..TickRecord::default()
    }
}

fn wait_until(what: &str, mut done: impl FnMut() -> bool) {
    let start = Instant::now();
    while !done() {
        assert!(start.elapsed() < Duration::from_secs(20), "{what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn what_was_pushed_reads_back() {
    let folder = Folder::new("reads-back");
    let (recorder, mut sink) = start(&folder.file()).unwrap();
    let ticks: Vec<TickRecord> = (0..300).map(tick).collect();
    for tick in &ticks {
        assert!(sink.push(tick));
    }
    sink.event(Event { at_ns: 6_000_000_000, level: EventLevel::Error, part: "link", code: 3, values: [0.0; 4] });
    recorder.note(0, EventLevel::Info, "socket", "armed");
    let done = recorder.finish().unwrap();
    assert_eq!((done.ticks, done.events, &done.path), (300, 2, &folder.file()));
    assert_eq!(done.bytes, std::fs::metadata(&done.path).unwrap().len());
    let content = read_mcap(&done.path).unwrap();
    assert!(content.complete && content.notes.is_empty(), "{:?}", content.notes);
    // Compared as text: a NaN is not equal to itself.
    assert_eq!(format!("{:?}", content.ticks), format!("{ticks:?}"));
    let said: Vec<(&str, &str)> = content.events.iter().map(|e| (e.part.as_str(), e.message.as_str())).collect();
    assert!(said.contains(&("link", "code 3")) && said.contains(&("socket", "armed")), "{said:?}");
}

#[test]
fn what_was_flushed_is_there_before_the_end() {
    let folder = Folder::new("flushed");
    let (recorder, mut sink) = start(&folder.file()).unwrap();
    (0..10).for_each(|k| {
        sink.push(&tick(k));
    });
    // As a power cut would find it: read while it is being written.
    wait_until("the first flush", || read_mcap(&unfinished_path(&folder.file())).is_ok_and(|c| c.ticks.len() == 10));
    drop(recorder);
    assert!(read_mcap(&folder.file()).unwrap().complete, "dropped without `finish`, it is finished all the same");
}

#[test]
fn a_file_in_the_way_or_a_missing_folder_is_told_at_the_start() {
    let folder = Folder::new("in-the-way");
    std::fs::write(folder.file(), "precious").unwrap();
    let error = start(&folder.file()).unwrap_err().to_string();
    assert!(error.contains("run.mcap") && error.contains("there already"), "{error}");
    let error = start(&folder.0.join("missing/run.mcap")).unwrap_err().to_string();
    assert!(error.contains("missing") && error.contains("No such file"), "{error}");
}

#[test]
fn a_removed_folder_is_noticed_within_seconds_and_does_not_stop_the_tick() {
    let folder = Folder::new("removed");
    let (recorder, mut sink) = start(&folder.file()).unwrap();
    let health = recorder.health();
    sink.push(&tick(0));
    std::fs::remove_dir_all(&folder.0).unwrap();
    let mut k = 1;
    wait_until("the loss is noticed", || {
        assert!(sink.push(&tick(k)), "the queue must empty all the same");
        k += 1;
        health.error().is_some()
    });
    let told = health.error().unwrap();
    assert!(told.contains("run.partial.mcap") && told.contains("removed"), "{told}");
    assert!(matches!(recorder.finish(), Err(RecordError::Incomplete { .. })));
}

/// A file-size limit makes `write` fail in the middle of the file (EFBIG), as a full disk does (ENOSPC).
///
/// The limit belongs to a process, so the test runs itself again below a shell that sets it.
#[test]
fn a_disk_that_takes_no_more_is_told_and_what_was_flushed_reads_back() {
    let folder = Folder::new("full");
    // 512-byte blocks: 128 KiB, enough for about 220 of the 3,000 ticks.
    let script = "trap '' XFSZ; ulimit -f 256; exec \"$@\"";
    let test = std::env::current_exe().unwrap();
    let output = Command::new("sh")
        .args(["-c", script, "sh"])
        .arg(test)
        .args(["--exact", "writes_until_the_limit", "--ignored", "--nocapture"])
        .env("TMPDIR", &folder.0)
        .output()
        .unwrap();
    let said = format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{said}");
    assert!(said.contains("cannot write the recording: File too large"), "{said}");
}

#[test]
#[ignore = "needs a file-size limit; `a_disk_that_takes_no_more…` runs it with one"]
fn writes_until_the_limit() {
    let folder = Folder::new("limit");
    let (recorder, mut sink) = start(&folder.file()).unwrap();
    let health = recorder.health();
    let flushed = |path: &Path| read_mcap(path).map_or(0, |content| content.ticks.len());
    (0..50).for_each(|k| {
        sink.push(&tick(k));
    });
    let partial = unfinished_path(&folder.file());
    wait_until("the first flush", || flushed(&partial) == 50);
    for k in 50..3_000 {
        assert!(sink.push(&tick(k)));
    }
    wait_until("the error", || health.error().is_some());
    println!("{}", health.error().unwrap());
    let error = recorder.finish().unwrap_err();
    println!("{error}");
    assert!(matches!(error, RecordError::Incomplete { .. }));
    let kept = flushed(&partial);
    assert!((50..3_000).contains(&kept), "{kept} ticks kept");
    assert!(!folder.file().exists(), "half a recording must not look like a whole one");
}
