//! A folder of recordings as one sequence of ticks, across rotation and restarts of the daemon, as it grows.
//!
//! Recordings are taken in the order of their names, which are times: `STEM-YYYYMMDD-HHMMSS[-N].mcap`. The newest one may
//! still be written; an older one is over, finished or not. Recordings of experiments are left out: nothing controls there.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use proto::recording::{FollowEnd, McapFollower, ReadMcapError, TickRecord};

use crate::FinetuneError;

/// Beginning of the names of recordings in which commands are played and nothing controls.
const PLAYED: &str = "experiment";

/// Outcome of a look at the folder.
#[derive(Debug)]
pub enum Read {
    /// A recording begins; what stands in it is read through [`RecordingFolder::current`].
    Begins,
    /// Ticks of the recording under way.
    Ticks(Piece),
    /// Nothing more is there now.
    Nothing,
}

/// Ticks of a recording that were read at once, and where ticks may be lost.
#[derive(Debug, Default)]
pub struct Piece {
    /// The ticks, in their order.
    pub ticks: Vec<TickRecord>,
    /// Places in the ticks before which some may be lost; their number stands for a place behind all of them.
    pub lost_before: Vec<usize>,
}

impl Piece {
    /// Adds what a recording gave last.
    fn add(&mut self, ticks: Vec<TickRecord>, follower: &McapFollower) {
        self.lost_before.extend(follower.lost_before().iter().map(|at| self.ticks.len() + at));
        self.ticks.extend(ticks);
    }

    fn is_empty(&self) -> bool {
        self.ticks.is_empty() && self.lost_before.is_empty()
    }
}

/// A folder that is followed.
#[derive(Debug)]
pub struct RecordingFolder {
    folder: PathBuf,
    current: Option<(Place, McapFollower)>,
    /// Remarks on recordings that are damaged.
    notes: Vec<String>,
}

/// The place of a recording in the order of a folder: its name without number and ending, and its number.
type Place = (String, u32);

impl RecordingFolder {
    /// Follows a folder from its first recording on.
    pub fn new(folder: &Path) -> Self {
        RecordingFolder { folder: folder.to_owned(), current: None, notes: Vec::new() }
    }

    /// Says what a folder holds instead of recordings that can be learned from, where it holds none of those.
    ///
    /// # Errors
    /// The folder cannot be read.
    pub fn lacks_recordings(folder: &Path) -> Result<Option<String>, FinetuneError> {
        let this = Self::new(folder);
        if this.next()?.is_some() {
            return Ok(None);
        }
        let unreadable = |source| FinetuneError::Folder { folder: folder.display().to_string(), source };
        let mut has_tables = false;
        for entry in std::fs::read_dir(folder).map_err(unreadable)? {
            has_tables |= entry.map_err(unreadable)?.path().extension().is_some_and(|kind| kind == "csv");
        }
        let besides = if has_tables { ", but CSV files, which hold too little".to_owned() } else { String::new() };
        Ok(Some(format!("no recording of `controller run` or `demo` (*.mcap){besides}")))
    }

    /// The recording under way.
    pub fn current(&self) -> Option<&McapFollower> {
        self.current.as_ref().map(|(_, follower)| follower)
    }

    /// Name of the recording under way, as it is called once it is finished.
    pub fn current_name(&self) -> String {
        let name = |((stem, number), _): &(Place, McapFollower)| match number {
            1 => format!("{stem}.mcap"),
            number => format!("{stem}-{number}.mcap"),
        };
        self.current.as_ref().map_or_else(String::new, name)
    }

    /// Reads on: a piece of the recording under way, or the beginning of the next.
    ///
    /// # Errors
    /// A folder or a recording that cannot be read.
    pub fn read_on(&mut self) -> Result<Read, FinetuneError> {
        let read = self.read_piece();
        self.hear();
        read
    }

    /// Remarks on what is damaged in the recordings, each of them once.
    pub fn take_notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notes)
    }

    fn hear(&mut self) {
        if let Some((_, follower)) = &mut self.current {
            self.notes.extend(follower.take_notes());
        }
    }

    fn read_piece(&mut self) -> Result<Read, FinetuneError> {
        if let Some((_, follower)) = &mut self.current
            && follower.end() != FollowEnd::Finished
        {
            let mut piece = Piece::default();
            piece.add(follower.read_on()?, follower);
            // A loss at the end of a recording is handed on before the next one begins, with no tick behind it.
            if !piece.is_empty() || follower.end() == FollowEnd::More {
                return Ok(Read::Ticks(piece));
            }
        }
        let Some((place, path)) = self.next()? else { return Ok(Read::Nothing) };
        if let Some((_, follower)) = &mut self.current
            && follower.end() != FollowEnd::Finished
        {
            // The next one is there, so this one is over; it may have grown between the last look and now.
            let mut piece = Piece::default();
            loop {
                piece.add(follower.read_on()?, follower);
                if follower.end() != FollowEnd::More {
                    break;
                }
            }
            piece.add(follower.give_up()?, follower);
            return Ok(Read::Ticks(piece));
        }
        match McapFollower::open(&path) {
            Ok(follower) => self.current = Some((place, follower)),
            // It got its final name between the two looks.
            Err(ReadMcapError::Read { source, .. }) if source.kind() == ErrorKind::NotFound => {
                return Ok(Read::Nothing);
            }
            Err(error) => return Err(error.into()),
        }
        Ok(Read::Begins)
    }

    /// Ends the recording under way as one that nobody goes on with.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn give_up(&mut self) -> Result<Piece, FinetuneError> {
        let mut piece = Piece::default();
        if let Some((_, follower)) = &mut self.current {
            piece.add(follower.give_up()?, follower);
        }
        self.hear();
        Ok(piece)
    }

    /// The first recording behind the one under way.
    fn next(&self) -> Result<Option<(Place, PathBuf)>, FinetuneError> {
        let unreadable = |source| FinetuneError::Folder { folder: self.folder.display().to_string(), source };
        let mut next: Option<(Place, PathBuf)> = None;
        for entry in std::fs::read_dir(&self.folder).map_err(unreadable)? {
            let path = entry.map_err(unreadable)?.path();
            let Some(place) = place(&path) else { continue };
            let is_behind = self.current.as_ref().is_none_or(|(current, _)| place > *current);
            if is_behind && next.as_ref().is_none_or(|(first, _)| place < *first) {
                next = Some((place, path));
            }
        }
        Ok(next)
    }
}

/// Where a file stands in the order; nothing for what is no recording of a controller.
fn place(path: &Path) -> Option<Place> {
    let name = path.file_name()?.to_str()?.strip_suffix(".mcap")?;
    let name = name.strip_suffix(".partial").unwrap_or(name);
    if name.starts_with(PLAYED) || name.starts_with('.') {
        return None;
    }
    // A time has six digits; the number of a second recording in one second has at most three.
    match name.rsplit_once('-') {
        Some((stem, number)) if number.len() <= 3 => {
            Some(number.parse().map_or_else(|_| (name.to_owned(), 1), |number| (stem.to_owned(), number)))
        }
        _ => Some((name.to_owned(), 1)),
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Seek, SeekFrom, Write};

    use proto::recording::{RecordingInfo, RecordingWriter, unfinished_path};

    use super::*;

    /// A recording that grows, with a second of it erased: what is whole behind it is read, and the loss is told once.
    #[test]
    fn what_is_erased_in_a_recording_is_passed_over_and_told_once() {
        let folder = std::env::temp_dir().join(format!("finetune-erased-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join("run-20261127-121000.mcap");
        let mut writer = RecordingWriter::create(&path, &RecordingInfo::new("test", 0), &[]).unwrap();
        let (path, mut ends) = (unfinished_path(&path), Vec::new());
        let mut second = |from: u32| {
            (from..from + 50)
                .for_each(|tick| writer.write(&TickRecord { session: 7, tick, ..TickRecord::default() }).unwrap());
            writer.flush().unwrap();
            ends.push(std::fs::metadata(&path).unwrap().len());
            ends.clone()
        };
        second(0);
        let ends = second(50);
        let mut file = std::fs::File::options().write(true).open(&path).unwrap();
        file.seek(SeekFrom::Start(ends[0])).unwrap();
        file.write_all(&vec![0; (ends[1] - ends[0]) as usize]).unwrap();
        let mut of = RecordingFolder::new(&folder);
        let mut read = || {
            let (mut ticks, mut notes) = (Vec::new(), Vec::new());
            loop {
                match of.read_on().unwrap() {
                    Read::Nothing => return (ticks, notes),
                    Read::Begins => {}
                    Read::Ticks(more) => ticks.extend(more.ticks.iter().map(|tick| tick.tick)),
                }
                notes.extend(of.take_notes());
            }
        };
        assert_eq!(read(), ((0..50).collect(), Vec::new()), "it may be an end that is still written");
        second(100);
        let (ticks, notes) = read();
        assert_eq!(ticks, (100..150).collect::<Vec<u32>>());
        assert!(notes.len() == 1 && notes[0].ends_with("; 50 ticks (1.00 s) are lost"), "{notes:?}");
        second(150);
        assert_eq!(read(), ((150..200).collect(), Vec::new()));
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn recordings_come_in_the_order_of_their_times() {
        let names = [
            "run-20261127-121000.mcap",
            "run-20261127-121000-2.mcap",
            "run-20261127-121000-10.partial.mcap",
            "run-20261127-121500.mcap",
        ];
        let places: Vec<Place> = names.iter().map(|name| place(Path::new(name)).unwrap()).collect();
        assert!(places.is_sorted(), "{places:?}");
        for other in ["experiment-20261127-121000.mcap", "policies.audit.jsonl", ".a.mcap"] {
            assert_eq!(place(Path::new(other)), None, "{other}");
        }
        assert_eq!(place(Path::new("flight.mcap")), Some(("flight".to_owned(), 1)));
    }
}
