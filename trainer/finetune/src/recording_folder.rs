//! A folder of recordings as one sequence of ticks, across rotation and restarts of the daemon, as it grows.
//!
//! Recordings are taken in the order of their names, which are times: `STEM-YYYYMMDD-HHMMSS[-N].mcap`. The newest one may
//! still be written; an older one is over, finished or not. Recordings of experiments are left out: nothing controls there.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use proto::recording::{FollowEnd, McapFollower, ReadMcapError, TickRecord};

use crate::FinetuneError;

/// How names of recordings begin in which commands are played and nothing controls.
const PLAYED: &str = "experiment";

/// What a look at the folder brought.
#[derive(Debug)]
pub enum Read {
    /// A recording begins; what stands in it is read through [`RecordingFolder::current`].
    Begins,
    /// Ticks of the recording under way.
    Ticks(Vec<TickRecord>),
    /// Nothing more is there now.
    Nothing,
}

/// A folder that is followed.
#[derive(Debug)]
pub struct RecordingFolder {
    folder: PathBuf,
    current: Option<(Place, McapFollower)>,
}

/// The place of a recording in the order of a folder: its name without number and ending, and its number.
type Place = (String, u32);

impl RecordingFolder {
    /// Follows a folder from its first recording on.
    pub fn new(folder: &Path) -> Self {
        RecordingFolder { folder: folder.to_owned(), current: None }
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
        if let Some((_, follower)) = &mut self.current
            && follower.end() != FollowEnd::Finished
        {
            let ticks = follower.read_on()?;
            if !ticks.is_empty() || follower.end() == FollowEnd::More {
                return Ok(Read::Ticks(ticks));
            }
        }
        let Some((place, path)) = self.next()? else { return Ok(Read::Nothing) };
        if let Some((_, follower)) = &mut self.current
            && follower.end() != FollowEnd::Finished
        {
            // The next one is there, so this one is over; it may have grown between the last look and now.
            let mut ticks = Vec::new();
            loop {
                ticks.extend(follower.read_on()?);
                if follower.end() != FollowEnd::More {
                    break;
                }
            }
            ticks.extend(follower.give_up()?);
            return Ok(Read::Ticks(ticks));
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
    pub fn give_up(&mut self) -> Result<Vec<TickRecord>, FinetuneError> {
        match &mut self.current {
            Some((_, follower)) => Ok(follower.give_up()?),
            None => Ok(Vec::new()),
        }
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
    use super::*;

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
