//! A recording that is read while the daemon still writes it.
//!
//! The file is read from its beginning, record by record as far as whole ones go, and from there on again as it grows; the
//! daemon flushes a whole chunk every second. It is followed by its open handle, so that its renaming at the end changes
//! nothing. Of a file that nobody goes on with, [`McapFollower::give_up`] gives what [`read_mcap`](super::read_mcap) would
//! give: every whole message of the chunk that was cut. The ticks are the same ones in the same order, whenever it is read
//! and in however many pieces.
//!
//! Damage in the middle is left out as the reader of whole files leaves it out ([`Way`]): reading goes on with the next
//! sound chunk as soon as that is there, or by the index once the file is finished. Until then what cannot be read may be the
//! end of a file that is being written, and is waited for.
//!
//! Left out: frames that follow their tick, as other tools may write them; our own files have them before it.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use super::file_index::FileIndex;
use super::gathering::{FileEnd, Gathering};
use super::reader::ReadMcapError;
use super::tick::TickRecord;
use super::way_through_file::{Bytes, Growth, Way};
use crate::recording::MOST_BYTES;

/// Bytes that are read at a time: four chunks, so that a file of any size is followed in little memory.
const PIECE_BYTES: u64 = 4 << 20;

/// Place up to which a file has been followed.
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
    /// Bytes that were read and are still needed.
    kept: Vec<u8>,
    /// Place in the file of the first of them.
    kept_from: usize,
    way: Way,
    /// Places in the ticks that were given last before which some are lost.
    lost_before: Vec<usize>,
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
            kept: Vec::new(),
            kept_from: 0,
            way: Way::new(),
            lost_before: Vec::new(),
            end: FollowEnd::More,
        })
    }

    /// Reads a piece of what is there, and gives the ticks that are whole in it.
    ///
    /// # Errors
    /// The file cannot be read, is no MCAP file, or one of a later format.
    pub fn read_on(&mut self) -> Result<Vec<TickRecord>, ReadMcapError> {
        self.lost_before.clear();
        if self.end == FollowEnd::Finished {
            return Ok(Vec::new());
        }
        let read =
            (&self.file).take(PIECE_BYTES).read_to_end(&mut self.kept).map_err(|source| self.unreadable(source))?;
        self.end = if read as u64 == PIECE_BYTES { FollowEnd::More } else { FollowEnd::Waiting };
        if self.kept_from == 0 {
            let known = self.kept.len().min(mcap::MAGIC.len());
            if self.kept.get(..known) != mcap::MAGIC.get(..known) {
                return Err(ReadMcapError::NotMcap { file: self.gathering.file.clone() });
            }
            if known < mcap::MAGIC.len() {
                return Ok(Vec::new());
            }
        }
        match self.go_on(Growth::Goes)? {
            // Behind the data stands the index, which repeats what was read.
            Some(_) => self.end = FollowEnd::Finished,
            None if read > 0 && self.way.is_held_up() && self.kept.ends_with(mcap::MAGIC) => self.go_on_by_index()?,
            None => {}
        }
        self.forget();
        Ok(self.taken())
    }

    fn go_on(&mut self, growth: Growth) -> Result<Option<FileEnd>, ReadMcapError> {
        let file = Bytes { bytes: &self.kept, begin: self.kept_from };
        self.gathering.go_on(file, &mut self.way, None, growth)
    }

    /// Goes on over what is damaged in a file that ends as finished ones do: by its index, if that is sound.
    fn go_on_by_index(&mut self) -> Result<(), ReadMcapError> {
        let mut bytes = Vec::new();
        let mut file = &self.file;
        let read = file.seek(SeekFrom::Start(0)).and_then(|_| file.take(MOST_BYTES).read_to_end(&mut bytes));
        read.map_err(|source| self.unreadable(source))?;
        // It may have grown since: what is read next is what follows this.
        self.kept = bytes.get(self.kept_from..).unwrap_or_default().to_vec();
        if let Some(index) = FileIndex::of(&bytes) {
            self.end = FollowEnd::Finished;
            let end = self.gathering.read_whole(&bytes, &mut self.way, Some(&index))?;
            self.note_end(&end);
        }
        Ok(())
    }

    /// Lets go of bytes that are no longer needed. What is lost is kept until there is much of it: it may be a record that is still
    /// being written.
    fn forget(&mut self) {
        let is_much = self.kept.len() as u64 >= PIECE_BYTES;
        let lost_until = self.way.needed_to_find().filter(|_| is_much);
        let needed_from = lost_until.unwrap_or(0).max(self.way.needed_from());
        // The last bytes tell whether the file was finished.
        let most = self.kept.len().saturating_sub(mcap::MAGIC.len());
        let past = needed_from.saturating_sub(self.kept_from).min(most);
        self.kept.drain(..past);
        self.kept_from += past;
    }

    fn note_end(&mut self, end: &FileEnd) {
        if let FileEnd::Unreadable(problem) = end {
            self.gathering.note_unreadable(problem);
        }
        if !matches!(end, FileEnd::Reached) {
            // Whatever its writer wrote behind this is lost.
            self.gathering.content.lost_before.push(self.gathering.content.ticks.len());
        }
    }

    fn unreadable(&self, source: std::io::Error) -> ReadMcapError {
        ReadMcapError::Read { file: self.gathering.file.clone(), source }
    }

    /// Reads what is whole of the last chunk of a file that nobody goes on with; it is finished then.
    ///
    /// # Errors
    /// As [`McapFollower::read_on`].
    pub fn give_up(&mut self) -> Result<Vec<TickRecord>, ReadMcapError> {
        if self.end != FollowEnd::Finished {
            self.end = FollowEnd::Finished;
            let end = self.go_on(Growth::Done)?;
            end.iter().for_each(|end| self.note_end(end));
            self.kept = Vec::new();
        }
        Ok(self.taken())
    }

    /// Place up to which it has been followed.
    pub fn end(&self) -> FollowEnd {
        self.end
    }

    /// Remarks on what is damaged, a line each, each of them once. What is lost is told once something is read behind it.
    pub fn take_notes(&mut self) -> Vec<String> {
        if self.gathering.is_to_be_told() && self.end != FollowEnd::Finished {
            return Vec::new();
        }
        self.gathering.take_notes()
    }

    /// Places in the ticks that were given last before which something is damaged, so that ticks may be lost there. Their number stands
    /// for a place behind all of them.
    pub fn lost_before(&self) -> &[usize] {
        &self.lost_before
    }

    /// An entry of the recording's metadata, once that has been read.
    pub fn metadata(&self, key: &str) -> Option<&str> {
        self.gathering.content.metadata.get(key).map(String::as_str)
    }

    /// The files of a name inside, as far as they have been read, in their order.
    pub fn attachments(&self, name: &str) -> impl Iterator<Item = &[u8]> {
        self.gathering.content.attachments.iter().filter(move |file| file.name == name).map(|file| file.data.as_slice())
    }

    /// The files of a name that the recording began with, in their order: of a later part of a run those that took over in the parts before.
    pub fn first_attachments(&self, name: &str) -> impl Iterator<Item = &[u8]> {
        let files = self.gathering.first_attachments().iter();
        files.filter(move |file| file.name == name).map(|file| file.data.as_slice())
    }

    /// Tells whether files of a name may be lost, so that those behind them are left out.
    pub fn has_lost(&self, name: &str) -> bool {
        self.gathering.lost.has(name)
    }

    fn taken(&mut self) -> Vec<TickRecord> {
        self.lost_before = std::mem::take(&mut self.gathering.content.lost_before);
        // Neither events nor the places of ticks that are gone are of use to anybody here.
        self.gathering.content.events.clear();
        self.gathering.ticks.clear();
        std::mem::take(&mut self.gathering.content.ticks)
    }
}
