//! A recording is followed while it is written: the same ticks, in whatever pieces the file comes and wherever it ends.
#![allow(clippy::unwrap_used, clippy::expect_used)] // a test's own set-up

use std::io::Write;
use std::path::PathBuf;

use proto::recording::{
    Attachment, FollowEnd, McapFollower, RecordingInfo, RecordingWriter, TickRecord, parse_mcap, unfinished_path,
};

fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("follow-{}-{name}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

fn tick(number: u32) -> TickRecord {
    TickRecord { session: 7, tick: number, p_pos_kpa: f64::from(number) * 0.1, ..TickRecord::default() }
}

fn writer(path: &std::path::Path) -> RecordingWriter {
    let mut info = RecordingInfo::new("test", 0);
    info.extra.insert("part".to_owned(), "2".to_owned());
    let file = Attachment { name: "a.csv".to_owned(), media_type: "text/csv".to_owned(), data: b"1,2".to_vec() };
    RecordingWriter::create(path, &info, &[file]).unwrap()
}

fn numbers(ticks: &[TickRecord]) -> Vec<u32> {
    ticks.iter().map(|tick| tick.tick).collect()
}

#[test]
fn grows_with_the_file_and_over_its_renaming() {
    let folder = folder("grows");
    let path = folder.join("run.mcap");
    let mut writer = writer(&path);
    let mut follower = McapFollower::open(&unfinished_path(&path)).unwrap();
    let mut seen = Vec::new();
    for second in 0..4 {
        (0..50).for_each(|n| writer.write(&tick(50 * second + n)).unwrap());
        writer.flush().unwrap();
        seen.extend(follower.read_on().unwrap());
        assert_eq!(seen.len(), 50 * (second as usize + 1), "a flushed second is there at once");
        assert_eq!(follower.end(), FollowEnd::Waiting);
    }
    assert_eq!(follower.metadata("part"), Some("2"));
    assert_eq!(follower.attachments("a.csv").collect::<Vec<_>>(), [b"1,2"]);
    writer.write(&tick(200)).unwrap();
    writer.finish().unwrap();
    seen.extend(follower.read_on().unwrap());
    assert_eq!(follower.end(), FollowEnd::Finished);
    assert_eq!(numbers(&seen), (0..=200).collect::<Vec<_>>());
    assert!(follower.read_on().unwrap().is_empty() && follower.give_up().unwrap().is_empty());
    std::fs::remove_dir_all(folder).unwrap();
}

/// Cut anywhere, and fed in two pieces parted anywhere: what the reader of whole files makes of the same bytes.
#[test]
fn gives_what_a_reader_of_the_cut_file_gives() {
    let folder = folder("cut");
    let path = folder.join("run.mcap");
    let mut writer = writer(&path);
    for second in 0..2 {
        (0..5).for_each(|n| writer.write(&tick(5 * second + n)).unwrap());
        writer.flush().unwrap();
    }
    let bytes = std::fs::read(unfinished_path(&path)).unwrap();
    let cut_path = folder.join("cut.mcap");
    for cut in (0..=bytes.len()).step_by(7).chain([bytes.len()]) {
        let parted = cut * 2 / 3;
        let mut file = std::fs::File::create(&cut_path).unwrap();
        file.write_all(&bytes[..parted]).unwrap();
        let mut follower = McapFollower::open(&cut_path).unwrap();
        let mut seen = follower.read_on().unwrap();
        file.write_all(&bytes[parted..cut]).unwrap();
        seen.extend(follower.read_on().unwrap());
        seen.extend(follower.give_up().unwrap());
        let whole = parse_mcap("cut", &bytes[..cut]).map(|content| content.ticks).unwrap_or_default();
        assert_eq!(numbers(&seen), numbers(&whole), "cut at {cut} of {}", bytes.len());
    }
    std::fs::write(&cut_path, b"no recording").unwrap();
    assert!(McapFollower::open(&cut_path).unwrap().read_on().unwrap_err().to_string().contains("not an MCAP file"));
    std::fs::remove_dir_all(folder).unwrap();
}
