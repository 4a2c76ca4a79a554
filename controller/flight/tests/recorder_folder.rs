//! The recorder in a folder: one file after another, and what a disk or a person can do to them meanwhile.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::fs::OpenOptions;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use flight::{Destination, RecordSink, Recorder, RecorderOptions, Retention};
use proto::recording::{EventLevel, McapContent, RecordingInfo, TickRecord, read_mcap};

struct Folder(PathBuf);

impl Folder {
    fn new() -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        Self(std::env::temp_dir().join(format!("recorder-folder-{}-{number}", std::process::id())))
    }

    fn files(&self) -> Vec<PathBuf> {
        let mut files: Vec<PathBuf> =
            std::fs::read_dir(&self.0).into_iter().flatten().flatten().map(|e| e.path()).collect();
        files.sort();
        files
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn destination(folder: &Path) -> Destination {
    Destination {
        directory: folder.to_owned(),
        stem: "run",
        stems: &["run"],
        most_bytes: u64::MAX,
        most_time: Duration::from_secs(3600),
        min_free_bytes: 0,
        retention: Retention::default(),
        clock: || 1_000,
    }
}

fn start(destination: Destination) -> (Recorder, RecordSink) {
    let options = RecorderOptions::new(|event| format!("code {}", event.code));
    Recorder::start_in(destination, &RecordingInfo::new("test 1.0", 0), &[], options).unwrap()
}

fn tick(number: u32) -> TickRecord {
    TickRecord { session: 5, tick: number, receive_ns: u64::from(number) * 20_000_000, ..TickRecord::default() }
}

fn push(sink: &mut RecordSink, ticks: std::ops::Range<u32>) {
    for k in ticks {
        assert!(sink.push(&tick(k)), "tick {k}");
    }
}

fn wait_until(what: &str, mut done: impl FnMut() -> bool) {
    let start = Instant::now();
    while !done() {
        assert!(start.elapsed() < Duration::from_secs(30), "{what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn numbers(contents: &[McapContent]) -> Vec<u32> {
    contents.iter().flat_map(|content| content.ticks.iter().map(|t| t.tick)).collect()
}

fn read(files: &[PathBuf]) -> Vec<McapContent> {
    files.iter().map(|file| read_mcap(file).unwrap()).collect()
}

#[test]
fn without_a_tick_there_is_no_file() {
    let folder = Folder::new();
    let (recorder, _sink) = start(destination(&folder.0));
    recorder.note(0, EventLevel::Info, "link", "nobody there");
    std::thread::sleep(Duration::from_millis(50));
    let done = recorder.finish().unwrap();
    assert_eq!((done.ticks, done.files.len(), folder.files().len()), (0, 0, 0));
}

#[test]
fn what_was_said_before_the_first_tick_is_in_the_first_file() {
    let folder = Folder::new();
    let (recorder, mut sink) = start(destination(&folder.0));
    recorder.note(0, EventLevel::Info, "start", "memory is locked");
    std::thread::sleep(Duration::from_millis(50));
    push(&mut sink, 0..3);
    let done = recorder.finish().unwrap();
    let content = read_mcap(&done.path).unwrap();
    assert!(content.complete && content.ticks.len() == 3);
    assert!(content.events.iter().any(|event| event.message == "memory is locked"), "{:?}", content.events);
}

#[test]
fn files_follow_one_another_without_losing_a_tick() {
    let folder = Folder::new();
    // Every second, which is as often as is looked.
    let (recorder, mut sink) = start(Destination { most_time: Duration::from_millis(1), ..destination(&folder.0) });
    let mut next = 0;
    wait_until("three files", || {
        push(&mut sink, next..next + 1);
        next += 1;
        std::thread::sleep(Duration::from_millis(4));
        folder.files().len() >= 3
    });
    let done = recorder.finish().unwrap();
    assert_eq!((done.ticks, done.ticks_dropped), (u64::from(next), 0));
    let contents = read(&done.files);
    assert!(contents.len() >= 3 && contents.iter().all(|content| content.complete));
    assert_eq!(numbers(&contents), (0..next).collect::<Vec<_>>());
    let second = &contents[1].metadata;
    assert_eq!(second["part"], "2");
    assert_eq!(second["previous_file"], done.files[0].file_name().unwrap().to_string_lossy());
}

#[test]
fn a_file_that_is_full_is_followed_by_another() {
    let folder = Folder::new();
    let (recorder, mut sink) = start(Destination { most_bytes: 20_000, ..destination(&folder.0) });
    // About 250 bytes a tick.
    push(&mut sink, 0..500);
    wait_until("the first is finished", || folder.files().iter().any(|f| !f.to_string_lossy().contains("partial")));
    push(&mut sink, 500..510);
    let done = recorder.finish().unwrap();
    assert_eq!(done.files.len(), 2, "{:?}", done.files);
    assert_eq!(numbers(&read(&done.files)), (0..510).collect::<Vec<_>>());
    // The recorder made it; who reads no recording replaces none either.
    let mode = std::fs::metadata(&folder.0).unwrap().permissions().mode();
    assert_eq!(mode & 0o007, 0, "{mode:o}");
}

/// Removed, replaced, cut short, and cut and written on as `logrotate`'s `copytruncate` does.
#[test]
fn a_file_that_is_taken_away_is_told_at_once_and_recording_goes_on_in_another() {
    let cut = |path: &Path| OpenOptions::new().write(true).open(path).unwrap().set_len(0).unwrap();
    let replace = |path: &Path| {
        std::fs::remove_file(path).unwrap();
        std::fs::write(path, vec![0; 1 << 20]).unwrap();
    };
    let remove = |path: &Path| std::fs::remove_file(path).unwrap();
    let harms: [(&str, &dyn Fn(&Path)); 3] = [("cut", &cut), ("removed", &replace), ("removed", &remove)];
    for (word, harm) in harms {
        let folder = Folder::new();
        let seen = std::sync::Arc::new(std::sync::Mutex::new(String::new()));
        let log = std::sync::Arc::clone(&seen);
        let options = RecorderOptions::new(|_| String::new()).observer(move |recorded| {
            if let flight::Recorded::Event { message, .. } = recorded {
                log.lock().unwrap().push_str(message);
            }
        });
        let info = RecordingInfo::new("test 1.0", 0);
        let (recorder, mut sink) = Recorder::start_in(destination(&folder.0), &info, &[], options).unwrap();
        push(&mut sink, 0..5);
        wait_until("a flushed file", || folder.files().iter().any(|f| read_mcap(f).is_ok_and(|c| c.ticks.len() == 5)));
        let begun = Instant::now();
        harm(&folder.files()[0]);
        wait_until("it is told", || seen.lock().unwrap().contains(word));
        // Looked at four times a second; the bound is for a busy machine.
        assert!(begun.elapsed() < Duration::from_secs(5), "{:?}", begun.elapsed());
        wait_until("it goes on", || recorder.health().error().is_none());
        push(&mut sink, 5..9);
        let health = recorder.health();
        assert_eq!(health.last_finished(), None);
        let error = recorder.finish().unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
        let last = folder.files().into_iter().rfind(|f| read_mcap(f).is_ok_and(|c| c.complete)).expect("a whole file");
        assert_eq!(health.last_finished(), Some(last.clone()), "told also where the recorder ends with an error");
        assert_eq!(numbers(&read(&[last])), [5, 6, 7, 8]);
    }
}

/// Something else stands where the folder was: a file, or a link that leads to one or in a circle.
#[test]
fn a_folder_that_is_replaced_is_known_and_bars_arming() {
    let file = |place: &Path| std::fs::write(place, "mine").unwrap();
    let to_file = |place: &Path| std::os::unix::fs::symlink("/dev/null", place).unwrap();
    let circle = |place: &Path| std::os::unix::fs::symlink(place, place).unwrap();
    let harms: [&dyn Fn(&Path); 3] = [&file, &to_file, &circle];
    for harm in harms {
        let folder = Folder::new();
        let (recorder, mut sink) = start(destination(&folder.0));
        push(&mut sink, 0..5);
        wait_until("a flushed file", || folder.files().iter().any(|f| read_mcap(f).is_ok_and(|c| c.ticks.len() == 5)));
        std::fs::remove_dir_all(&folder.0).unwrap();
        harm(&folder.0);
        wait_until("it is known", || recorder.health().error().is_some());
        assert!(!sink.would_record());
        assert!(recorder.finish().unwrap_err().to_string().contains("removed"));
        std::fs::remove_file(&folder.0).unwrap();
    }
}

#[test]
fn too_little_room_is_told_and_bars_arming_but_not_recording() {
    let folder = Folder::new();
    std::fs::create_dir_all(&folder.0).unwrap();
    let (recorder, mut sink) = start(Destination { min_free_bytes: u64::MAX, ..destination(&folder.0) });
    wait_until("it is known", || recorder.health().why_not_arm().is_some());
    let why = recorder.health().why_not_arm().unwrap();
    assert!(why.contains("MiB free") && why.contains("min_free_mib"), "{why}");
    assert!(!sink.would_record() && recorder.health().error().is_none());
    push(&mut sink, 0..3);
    // Room again: other limits.
    recorder.redirect(destination(&folder.0));
    wait_until("there is room", || recorder.health().why_not_arm().is_none());
    assert!(sink.would_record());
    assert_eq!(recorder.finish().unwrap().ticks, 3);
}

#[test]
fn old_files_go_when_a_new_one_begins() {
    let folder = Folder::new();
    std::fs::create_dir_all(&folder.0).unwrap();
    let old = folder.0.join("run-20200101-000000.mcap");
    std::fs::write(&old, "old").unwrap();
    let long_ago = std::time::SystemTime::now() - Duration::from_secs(10 * 86_400);
    OpenOptions::new().write(true).open(&old).unwrap().set_modified(long_ago).unwrap();
    let mine = folder.0.join("mine.mcap");
    std::fs::write(&mine, "mine").unwrap();
    let (recorder, mut sink) =
        start(Destination { retention: Retention { days: 7, bytes: 0 }, ..destination(&folder.0) });
    push(&mut sink, 0..1);
    recorder.finish().unwrap();
    assert!(!old.exists() && mine.exists());
}
