//! A recording is followed while it is written: the same ticks, in whatever pieces the file comes, wherever it ends, and over what is
//! damaged in it.
#![allow(clippy::unwrap_used, clippy::panic, reason = "the helpers of a test fail by panicking, as the test does")]

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

/// The files that a recording began with are the same ones whenever it is read: those that came later are told from them, also where
/// they came before the first second was over.
#[test]
fn files_that_a_recording_began_with_are_told_from_later_ones() {
    let folder = folder("began-with");
    let path = folder.join("run.mcap");
    let mut writer = writer(&path);
    let mut follower = McapFollower::open(&unfinished_path(&path)).unwrap();
    let begun_with =
        |follower: &McapFollower| follower.first_attachments("a.csv").map(<[u8]>::to_vec).collect::<Vec<_>>();
    follower.read_on().unwrap();
    assert_eq!(begun_with(&follower), [b"1,2"]);
    writer.write(&tick(0)).unwrap();
    let data = b"3,4".to_vec();
    writer.attach(&Attachment { name: "a.csv".to_owned(), media_type: "text/csv".to_owned(), data }).unwrap();
    (1..50).for_each(|n| writer.write(&tick(n)).unwrap());
    let path = writer.finish().unwrap();
    let mut whole = McapFollower::open(&path).unwrap();
    for follower in [&mut follower, &mut whole] {
        assert_eq!(follower.read_on().unwrap().len(), 50);
        assert_eq!(begun_with(follower), [b"1,2"]);
        assert_eq!(follower.attachments("a.csv").collect::<Vec<_>>(), [b"1,2", b"3,4"]);
    }
    std::fs::remove_dir_all(folder).unwrap();
}

/// A file that is fed piece by piece to a follower.
struct Fed {
    path: PathBuf,
    follower: McapFollower,
    seen: Vec<TickRecord>,
    /// Places in these before which some are lost.
    lost_before: Vec<usize>,
    notes: Vec<String>,
}

impl Fed {
    fn new(folder: &std::path::Path) -> Self {
        let path = folder.join("fed.mcap");
        std::fs::write(&path, b"").unwrap();
        let follower = McapFollower::open(&path).unwrap();
        Fed { path, follower, seen: Vec::new(), lost_before: Vec::new(), notes: Vec::new() }
    }

    /// Adds bytes; the ticks that come of them.
    fn add(&mut self, bytes: &[u8]) -> usize {
        let mut file = std::fs::File::options().append(true).open(&self.path).unwrap();
        file.write_all(bytes).unwrap();
        let before = self.seen.len();
        // So many pieces of 4 MiB at most: whoever reads on while there is more comes to an end.
        for _ in 0..2 + bytes.len() / (4 << 20) {
            let ticks = self.follower.read_on().unwrap();
            self.take(&ticks);
            if self.follower.end() != FollowEnd::More {
                return self.seen.len() - before;
            }
        }
        panic!("there is always more");
    }

    fn give_up(&mut self) {
        let ticks = self.follower.give_up().unwrap();
        self.take(&ticks);
    }

    fn take(&mut self, ticks: &[TickRecord]) {
        self.lost_before.extend(self.follower.lost_before().iter().map(|at| self.seen.len() + at));
        // A chunk that is damaged and what is lost behind it may have the same place.
        self.lost_before.dedup();
        self.seen.extend(ticks);
        self.notes.extend(self.follower.take_notes());
    }
}

/// Ends of the flushed seconds of a recording, and its bytes; the last end is that of the unfinished file.
fn seconds(folder: &std::path::Path, count: u32, ticks: u32) -> (Vec<usize>, Vec<u8>, Vec<u8>) {
    let path = folder.join("run.mcap");
    let mut writer = writer(&path);
    let mut ends = Vec::new();
    for second in 0..count {
        (0..ticks).for_each(|n| writer.write(&tick(ticks * second + n)).unwrap());
        writer.flush().unwrap();
        ends.push(std::fs::metadata(unfinished_path(&path)).unwrap().len() as usize);
    }
    let unfinished = std::fs::read(unfinished_path(&path)).unwrap();
    let finished = std::fs::read(writer.finish().unwrap()).unwrap();
    (ends, unfinished, finished)
}

/// Damage as disks leave it: zeros, or what stood in other files.
fn damages() -> [fn(usize) -> u8; 2] {
    [|_| 0, |at| ((at as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 37) as u8]
}

/// Bytes are erased in the middle of a file that grows: what is behind them is waited for, and read on from.
#[test]
fn goes_on_behind_what_is_erased_once_a_whole_chunk_is_there() {
    let folder = folder("erased");
    let (ends, unfinished, finished) = seconds(&folder, 5, 50);
    for damage in damages() {
        let mut bytes = unfinished.clone();
        // From within the second chunk of ticks to within the third.
        let erased = (ends[0] + ends[1]) / 2..(ends[1] + ends[2]) / 2;
        erased.clone().for_each(|at| bytes[at] = damage(at));
        let mut fed = Fed::new(&folder);
        assert_eq!(fed.add(&bytes[..ends[0]]), 50);
        assert_eq!(fed.add(&bytes[ends[0]..ends[1]]), 0);
        // Nothing sound is there: it may be an end that is still written.
        assert_eq!(fed.add(&bytes[ends[1]..ends[2]]), 0);
        assert_eq!(fed.add(b""), 0);
        assert_eq!((fed.follower.end(), fed.notes.as_slice()), (FollowEnd::Waiting, &[][..]));
        // Half a chunk is none.
        let half = (ends[2] + ends[3]) / 2;
        assert_eq!(fed.add(&bytes[ends[2]..half]), 0);
        assert_eq!(fed.add(&bytes[half..ends[3]]), 50);
        assert_eq!(fed.lost_before, [50]);
        assert_eq!(fed.notes.len(), 1, "{:?}", fed.notes);
        assert!(fed.notes[0].ends_with("; 100 ticks (2.00 s) are lost"), "{:?}", fed.notes);
        // And on as if nothing had been.
        assert_eq!(fed.add(&bytes[ends[3]..]), 50);
        assert_eq!(fed.add(&finished[unfinished.len()..]), 0);
        assert_eq!((fed.follower.end(), fed.notes.len()), (FollowEnd::Finished, 1), "told once: {:?}", fed.notes);
        assert_eq!(numbers(&fed.seen), (0..50).chain(150..250).collect::<Vec<_>>());
        assert_eq!(fed.lost_before, [50], "what is sound behind it lacks nothing");
    }
    std::fs::remove_dir_all(folder).unwrap();
}

/// A damaged file in two pieces parted anywhere, cut anywhere: the ticks that the reader of whole files finds in it, and the places
/// where some are lost.
#[test]
fn finds_behind_damage_what_a_reader_finds() {
    let folder = folder("damaged");
    let (ends, unfinished, finished) = seconds(&folder, 4, 5);
    for damage in damages() {
        let mut bytes = finished.clone();
        ((ends[0] + ends[1]) / 2..ends[1] + 40).for_each(|at| bytes[at] = damage(at));
        for cut in (ends[0]..=unfinished.len()).step_by(11).chain([unfinished.len(), bytes.len()]) {
            let parted = ends[0] + (cut - ends[0]) * 2 / 3;
            let mut fed = Fed::new(&folder);
            fed.add(&bytes[..parted]);
            fed.add(&bytes[parted..cut]);
            fed.give_up();
            let whole = parse_mcap("cut", &bytes[..cut]).unwrap();
            assert_eq!(numbers(&fed.seen), numbers(&whole.ticks), "cut at {cut} of {}", bytes.len());
            // What is lost at its end is no place in it.
            let within = |mut lost_before: Vec<usize>| {
                lost_before.retain(|at| *at < whole.ticks.len());
                lost_before.dedup();
                lost_before
            };
            assert_eq!(within(fed.lost_before), within(whole.lost_before.clone()), "cut at {cut} of {}", bytes.len());
        }
    }
    std::fs::remove_dir_all(folder).unwrap();
}

/// The last chunk is erased and the file finished: its index says that nothing follows.
#[test]
fn a_finished_file_ends_though_its_last_chunk_is_erased() {
    let folder = folder("end");
    let (ends, unfinished, mut bytes) = seconds(&folder, 3, 50);
    bytes[ends[1] + 30..ends[2]].fill(0);
    let mut fed = Fed::new(&folder);
    assert_eq!(fed.add(&bytes[..unfinished.len()]), 100);
    assert_eq!((fed.follower.end(), fed.notes.len()), (FollowEnd::Waiting, 0));
    assert_eq!(fed.add(&bytes[unfinished.len()..]), 0);
    assert_eq!((fed.follower.end(), fed.lost_before), (FollowEnd::Finished, vec![100]));
    assert!(fed.notes.len() == 1 && fed.notes[0].ends_with("; 50 ticks (1.00 s) are lost"), "{:?}", fed.notes);
    std::fs::remove_dir_all(folder).unwrap();
}

/// More is erased than is kept in memory, and the chunk behind it comes byte by byte.
#[test]
fn a_long_erased_stretch_is_passed_over() {
    let folder = folder("long");
    let (ends, bytes, _) = seconds(&folder, 2, 5);
    for damage in damages() {
        let mut fed = Fed::new(&folder);
        assert_eq!(fed.add(&bytes[..ends[0]]), 5);
        // A head with code 0 first: no length that is there by chance leads into what follows.
        let stretch: Vec<u8> = (0..9 << 20).map(|at| if at == 0 { 0 } else { damage(at) }).collect();
        assert_eq!(fed.add(&stretch), 0);
        let (last, behind) = bytes[ends[0]..].split_last().unwrap();
        let came: usize = behind.chunks(97).map(|piece| fed.add(piece)).sum();
        assert_eq!(came + fed.add(&[*last]), 5);
        assert!(fed.notes.len() == 1 && fed.notes[0].ends_with("; no tick is lost"), "{:?}", fed.notes);
    }
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
        assert!(follower.lost_before().is_empty(), "an end that grows is no damage: {cut}");
        file.write_all(&bytes[parted..cut]).unwrap();
        seen.extend(follower.read_on().unwrap());
        assert!(follower.take_notes().is_empty() && follower.lost_before().is_empty(), "nor is it here: {cut}");
        let last = follower.give_up().unwrap();
        assert_eq!(follower.lost_before(), [last.len()], "it was not finished: {cut}");
        seen.extend(last);
        let whole = parse_mcap("cut", &bytes[..cut]).map(|content| content.ticks).unwrap_or_default();
        assert_eq!(numbers(&seen), numbers(&whole), "cut at {cut} of {}", bytes.len());
    }
    std::fs::write(&cut_path, b"no recording").unwrap();
    assert!(McapFollower::open(&cut_path).unwrap().read_on().unwrap_err().to_string().contains("not an MCAP file"));
    std::fs::remove_dir_all(folder).unwrap();
}
