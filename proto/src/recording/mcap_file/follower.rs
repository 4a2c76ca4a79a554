//! A recording that is read while the daemon still writes it.
//!
//! The file is read from its beginning, record by record as far as whole ones go, and from there on again as it grows; the
//! daemon flushes a whole chunk every second. It is followed by its open handle, so that its renaming at the end changes
//! nothing. Of a file that nobody goes on with, [`McapFollower::give_up`] gives what [`read_mcap`](super::read_mcap) would
//! give: every whole message of the chunk that was cut. The ticks are the same ones in the same order, whenever it is read
//! and in however many pieces.
//!
//! Left out: frames that follow their tick, as other tools may write them; our own files have them before it.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use mcap::records::op;

use super::gathering::Gathering;
use super::raw_record::next_record;
use super::reader::ReadMcapError;
use super::tick::TickRecord;

/// Bytes that are read at a time: four chunks, so that a file of any size is followed in little memory.
const PIECE_BYTES: u64 = 4 << 20;

/// How far a file has been followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FollowEnd {
    /// There is more to read now.
    More,
    /// All that is whole has been read; it may grow.
    Waiting,
    /// It was finished, or nothing behind this place can be read.
    Finished,
}

/// A recording that is followed.
#[derive(Debug)]
pub struct McapFollower {
    file: File,
    gathering: Gathering,
    /// What was read and is no whole record yet.
    unread: Vec<u8>,
    begun: bool,
    end: FollowEnd,
}

impl McapFollower {
    /// Opens a recording, finished or not.
    ///
    /// # Errors
    /// If it cannot be opened.
    pub fn open(path: &Path) -> Result<Self, ReadMcapError> {
        let name = path.display().to_string();
        let file = File::open(path).map_err(|source| ReadMcapError::Read { file: name.clone(), source })?;
        Ok(McapFollower {
            file,
            gathering: Gathering::of(&name),
            unread: Vec::new(),
            begun: false,
            end: FollowEnd::More,
        })
    }

    /// Reads a piece of what is there, and gives the ticks that are whole in it.
    ///
    /// # Errors
    /// The file cannot be read, is no MCAP file, or one of a later format.
    pub fn read_on(&mut self) -> Result<Vec<TickRecord>, ReadMcapError> {
        if self.end == FollowEnd::Finished {
            return Ok(Vec::new());
        }
        let name = self.gathering.file.clone();
        let read = (&self.file).take(PIECE_BYTES).read_to_end(&mut self.unread);
        let read = read.map_err(|source| ReadMcapError::Read { file: name.clone(), source })?;
        self.end = if read as u64 == PIECE_BYTES { FollowEnd::More } else { FollowEnd::Waiting };
        if !self.begun {
            let known = self.unread.len().min(mcap::MAGIC.len());
            if self.unread.get(..known) != mcap::MAGIC.get(..known) {
                return Err(ReadMcapError::NotMcap { file: name });
            }
            if known < mcap::MAGIC.len() {
                return Ok(Vec::new());
            }
            self.unread.drain(..known);
            self.begun = true;
        }
        let unread = std::mem::take(&mut self.unread);
        let mut rest = unread.as_slice();
        while let Some((code, body, after)) = next_record(rest) {
            // Behind the data stands the index, which repeats what was read; behind a record that is none nothing is known.
            if code == op::DATA_END || self.gathering.whole_record(code, body)?.is_some() {
                self.end = FollowEnd::Finished;
                return Ok(self.taken());
            }
            rest = after;
        }
        self.unread = rest.to_vec();
        Ok(self.taken())
    }

    /// Reads what is whole of the last chunk of a file that nobody goes on with; it is finished then.
    ///
    /// # Errors
    /// As [`McapFollower::read_on`].
    pub fn give_up(&mut self) -> Result<Vec<TickRecord>, ReadMcapError> {
        if self.end != FollowEnd::Finished {
            self.end = FollowEnd::Finished;
            let unread = std::mem::take(&mut self.unread);
            self.gathering.cut(&unread)?;
        }
        Ok(self.taken())
    }

    /// How far it has been followed.
    pub fn end(&self) -> FollowEnd {
        self.end
    }

    /// An entry of the recording's metadata, once that has been read.
    pub fn metadata(&self, key: &str) -> Option<&str> {
        self.gathering.content.metadata.get(key).map(String::as_str)
    }

    /// The files of a name inside, as far as they have been read, in their order.
    pub fn attachments(&self, name: &str) -> impl Iterator<Item = &[u8]> {
        self.gathering.content.attachments.iter().filter(move |file| file.name == name).map(|file| file.data.as_slice())
    }

    fn taken(&mut self) -> Vec<TickRecord> {
        // Neither events nor the places of ticks that are gone are of use to anybody here.
        self.gathering.content.events.clear();
        self.gathering.ticks.clear();
        std::mem::take(&mut self.gathering.content.ticks)
    }
}
