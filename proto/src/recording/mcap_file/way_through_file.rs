//! The way through a recording from record to record, over what is damaged in it.
//!
//! Lengths lead from one record to the next, so damage to a head loses the way. Then the index at the end of the file says
//! where the next record begins; where the file has none, as one that was not finished, the next chunk counts whose lengths
//! and CRC are right. All between is one damaged stretch. How many ticks are lost with it follows from the numbers of the
//! messages before and behind it.
//!
//! A file that grows is gone through in the same way ([`Growth::Goes`]). What is no record yet may become one, and what is lost
//! ends with a sound chunk or not at all: until one or the other is there, the way stays where it is.

use mcap::read::parse_record;
use mcap::records::op;

use super::damaged_chunks::lost_words;
use super::file_index::FileIndex;
use super::gathering::{FileEnd, Gathering, Topic};
use super::raw_record::{Sought, begins_with_record, next_record, next_sound_chunk};
use super::reader::ReadMcapError;
use crate::recording::MOST_BYTES;

/// Bytes of a file from a place on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bytes<'a> {
    pub(super) bytes: &'a [u8],
    /// Place in the file of the first of them.
    pub(super) begin: usize,
}

impl<'a> Bytes<'a> {
    /// Those from a place of the file on; none where it lies outside.
    fn from(&self, at: usize) -> &'a [u8] {
        at.checked_sub(self.begin).and_then(|at| self.bytes.get(at..)).unwrap_or_default()
    }

    fn end(&self) -> usize {
        self.begin + self.bytes.len()
    }
}

/// Tells whether bytes may be added to a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Growth {
    /// All that there is of it is there.
    Done,
    /// It may grow.
    Goes,
}

/// Place on the way through a file.
#[derive(Debug)]
pub(super) struct Way {
    /// Place of the next record.
    at: usize,
    /// Beginning of the last record of a kind that the format has: one of another kind may be a part of something damaged.
    before: usize,
    /// Place before which no sound chunk begins behind `before`, where one was looked for.
    searched: Option<usize>,
    /// True where what stands at `at` can be left behind without a loss, for it is no record and is not about to become one.
    is_lost: bool,
}

impl Way {
    /// The way from the first record on.
    pub(super) fn new() -> Self {
        Way { at: mcap::MAGIC.len(), before: 0, searched: None, is_lost: false }
    }

    fn go_to(&mut self, at: usize) {
        (self.at, self.searched, self.is_lost) = (at, None, false);
    }

    /// Place of the next sound chunk. A wrong length of the record before may have led beyond chunks.
    fn next_sound_chunk(&mut self, file: Bytes<'_>) -> Option<usize> {
        let behind = self.before.max(mcap::MAGIC.len()) + usize::from(self.before > 0);
        let from = self.searched.unwrap_or(behind).max(file.begin);
        match next_sound_chunk(file.bytes, from - file.begin) {
            Sought::Found(at) => Some(file.begin + at),
            Sought::NotYet(at) => {
                self.searched = Some(file.begin + at);
                None
            }
        }
    }

    /// Place before which nothing of the file is needed any more.
    pub(super) fn needed_from(&self) -> usize {
        if self.before == 0 { self.at } else { self.before.min(self.at) }
    }

    /// Place before which nothing is needed to find the next sound chunk; `None` while what stands next may be a record yet.
    pub(super) fn needed_to_find(&self) -> Option<usize> {
        self.searched.filter(|_| self.is_lost)
    }

    /// Tells whether it stands before something that is no whole record.
    pub(super) fn is_held_up(&self) -> bool {
        self.searched.is_some()
    }
}

/// A stretch of the file that was left out, and is not told to its end.
#[derive(Debug)]
pub(super) struct Stretch {
    /// Place of its note.
    note: usize,
    /// Number of the last tick before it.
    last: Option<u32>,
}

/// Outcome of a look at one record.
enum Step {
    /// It was taken in; the next one begins there.
    On(usize),
    /// The data ends here.
    End,
    /// Not all of it is there.
    Cut,
    /// It is none, or has a part of another in it.
    Lost(String),
}

fn no_record() -> Step {
    Step::Lost("no record begins there".to_owned())
}

/// Tells whether bytes begin with a record that is longer than any file that is read.
fn is_too_long(bytes: &[u8]) -> bool {
    let length = bytes.get(1..).and_then(|rest| rest.first_chunk::<8>());
    length.is_some_and(|length| u64::from_le_bytes(*length) > MOST_BYTES)
}

impl Gathering {
    /// Reads as far as the file goes, and tells how it ended.
    pub(super) fn read(&mut self, bytes: &[u8]) -> Result<FileEnd, ReadMcapError> {
        self.read_whole(bytes, &mut Way::new(), FileIndex::of(bytes).as_ref())
    }

    /// Reads a file of which all is there from where the way through it has got to.
    pub(super) fn read_whole(
        &mut self,
        bytes: &[u8],
        way: &mut Way,
        index: Option<&FileIndex<'_>>,
    ) -> Result<FileEnd, ReadMcapError> {
        Ok(self.go_on(Bytes { bytes, begin: 0 }, way, index, Growth::Done)?.unwrap_or(FileEnd::Missing))
    }

    /// Goes on as far as the way is clear; how the file ended, or `None` where more of it is to come.
    pub(super) fn go_on(
        &mut self,
        file: Bytes<'_>,
        way: &mut Way,
        index: Option<&FileIndex<'_>>,
        growth: Growth,
    ) -> Result<Option<FileEnd>, ReadMcapError> {
        while way.at < file.end() {
            let at = way.at;
            if index.is_some_and(|index| at >= index.data_end) {
                self.end_of_data(index);
                return Ok(Some(FileEnd::Reached));
            }
            let step = if at < file.begin { no_record() } else { self.record_at(file, at, index)? };
            let next = match &step {
                Step::On(next) => {
                    if begins_with_record(file.from(at)) {
                        way.before = at;
                    }
                    way.go_to(*next);
                    continue;
                }
                Step::End => {
                    self.end_of_data(index);
                    return Ok(Some(FileEnd::Reached));
                }
                Step::Cut | Step::Lost(_) => match index {
                    Some(index) => Some(index.next_behind(at)),
                    None => way.next_sound_chunk(file),
                },
            };
            match (next, step) {
                (Some(next), _) => {
                    self.leave_out(at, next, index)?;
                    way.before = next;
                    way.go_to(next);
                }
                (None, step) if growth == Growth::Goes => {
                    way.is_lost = matches!(step, Step::Lost(_)) || is_too_long(file.from(at));
                    return Ok(None);
                }
                (None, Step::Lost(problem)) => return Ok(Some(FileEnd::Unreadable(problem))),
                (None, _) => {
                    self.cut(file.from(at))?;
                    return Ok(Some(FileEnd::Cut));
                }
            }
        }
        Ok((growth == Growth::Done).then_some(FileEnd::Missing))
    }

    /// Takes in the record that begins at a place.
    fn record_at(&mut self, file: Bytes<'_>, at: usize, index: Option<&FileIndex<'_>>) -> Result<Step, ReadMcapError> {
        let Some((code, body, after)) = next_record(file.from(at)) else {
            return Ok(Step::Cut);
        };
        let end = file.end() - after.len();
        // No record has code 0, of which an erased stretch consists.
        if code == 0 || index.is_some_and(|index| !index.allows(file.bytes, at, end, code)) {
            return Ok(no_record());
        }
        match code {
            // What follows is the index, which repeats what was read.
            op::DATA_END if body.len() == 4 && index.is_none_or(|index| index.data_end == end) => return Ok(Step::End),
            op::DATA_END => return Ok(Step::Lost("the end of the data stands at a wrong place".to_owned())),
            op::ATTACHMENT => {
                self.attachment(body, index.and_then(|index| index.attachment_at(at)));
                return Ok(Step::On(end));
            }
            _ => {}
        }
        let notes = self.content.notes.len();
        let unreadable = self.whole_record(code, body)?;
        if code == op::CHUNK && self.content.notes.len() > notes {
            self.take_topics(index)?;
        }
        match unreadable {
            None => Ok(Step::On(end)),
            // Its length is right where another record follows.
            Some(problem) if begins_with_record(after) => {
                let what = if code == op::METADATA { "the metadata" } else { "a record" };
                self.note(&format!("{what} cannot be read and was left out: {problem}"));
                Ok(Step::On(end))
            }
            Some(problem) => Ok(Step::Lost(problem)),
        }
    }

    /// Leaves out what lies from a place to the next.
    fn leave_out(&mut self, at: usize, next: usize, index: Option<&FileIndex<'_>>) -> Result<(), ReadMcapError> {
        self.take_topics(index)?;
        if self.stretch.is_none() {
            self.begin_stretch(at);
        }
        let Some(index) = index else {
            // Whatever was attached there is lost.
            self.lost.add(None);
            return Ok(());
        };
        for name in index.attachments_within(at, next) {
            self.lost.add(Some(name));
            self.content.damaged_attachments.push(name.to_owned());
            self.note_on_attachment(&format!("the attachment {name} is damaged and was left out"));
        }
        Ok(())
    }

    fn begin_stretch(&mut self, at: usize) {
        // A damaged chunk just before it is a part of it.
        if self.behind_damaged
            && let Some(chunk) = self.damaged.pop_if(|chunk| chunk.note + 1 == self.content.notes.len())
        {
            self.content.notes.truncate(chunk.note);
        }
        self.behind_damaged = false;
        self.stretch = Some(Stretch { note: self.content.notes.len(), last: self.last_sequence });
        self.content.lost_before.push(self.content.ticks.len());
        self.note(&format!("damaged at byte {at}; what is whole behind it was read"));
    }

    /// Tells how many ticks were lost before the one of this number, where a damaged stretch lies before it.
    pub(super) fn end_stretch(&mut self, sequence: u32) {
        let Some(stretch) = self.stretch.take() else { return };
        // Ticks are numbered from 1. A tool that numbers them anew says nothing of what is lost.
        if let Some(lost) = sequence.checked_sub(stretch.last.unwrap_or(0).saturating_add(1)) {
            self.tell_lost(&stretch, u64::from(lost));
        }
    }

    /// Tells how many ticks were lost with a damaged stretch behind which no tick was read.
    fn end_of_data(&mut self, index: Option<&FileIndex<'_>>) {
        let (Some(stretch), Some(index)) = (self.stretch.take(), index) else { return };
        let all = index.messages(|channel| self.topics.get(&channel) == Some(&Topic::Tick));
        if let Some(lost) = all.checked_sub(u64::from(stretch.last.unwrap_or(0))) {
            self.tell_lost(&stretch, lost);
        }
    }

    fn tell_lost(&mut self, stretch: &Stretch, ticks: u64) {
        if let Some(note) = self.content.notes.get_mut(stretch.note) {
            note.push_str("; ");
            note.push_str(&lost_words(ticks));
        }
    }

    /// Takes schemas and channels from beside the index: the chunk that has them may be the damaged one.
    fn take_topics(&mut self, index: Option<&FileIndex<'_>>) -> Result<(), ReadMcapError> {
        for (code, body) in index.into_iter().flat_map(FileIndex::topics) {
            if let Ok(record) = parse_record(code, body) {
                self.record(record)?;
            }
        }
        Ok(())
    }
}
