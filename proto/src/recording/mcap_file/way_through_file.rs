//! The way through a recording from record to record, over what is damaged in it.
//!
//! Lengths lead from one record to the next, so damage to a head loses the way. Then the index at the end of the file says
//! where the next record begins; where the file has none, as one that was not finished, the next chunk counts whose lengths
//! and CRC are right. All between is one damaged stretch. How many ticks are lost with it follows from the numbers of the
//! messages before and behind it.

use mcap::read::parse_record;
use mcap::records::op;

use super::damaged_chunks::lost_words;
use super::file_index::FileIndex;
use super::gathering::{FileEnd, Gathering, Topic};
use super::raw_record::{begins_with_record, next_record, next_sound_chunk};
use super::reader::ReadMcapError;

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

impl Gathering {
    /// Reads as far as the file goes, and tells how it ended.
    pub(super) fn read(&mut self, bytes: &[u8]) -> Result<FileEnd, ReadMcapError> {
        let index = FileIndex::of(bytes);
        // Beginning of the last record of a kind that the format has: one of another kind may be a part of something damaged.
        let (mut before, mut at) = (0, mcap::MAGIC.len());
        while at < bytes.len() {
            if index.as_ref().is_some_and(|index| at >= index.data_end) {
                self.end_of_data(index.as_ref());
                return Ok(FileEnd::Reached);
            }
            let step = self.record_at(bytes, at, index.as_ref())?;
            let next = match &step {
                Step::On(next) => {
                    if begins_with_record(bytes.get(at..).unwrap_or_default()) {
                        before = at;
                    }
                    at = *next;
                    continue;
                }
                Step::End => {
                    self.end_of_data(index.as_ref());
                    return Ok(FileEnd::Reached);
                }
                Step::Cut | Step::Lost(_) => match &index {
                    Some(index) => Some(index.next_behind(at)),
                    // A wrong length of the record before may have led beyond chunks.
                    None => next_sound_chunk(bytes, before.max(mcap::MAGIC.len()) + usize::from(before > 0)),
                },
            };
            match (next, step) {
                (Some(next), _) => {
                    self.leave_out(at, next, index.as_ref())?;
                    (before, at) = (next, next);
                }
                (None, Step::Lost(problem)) => return Ok(FileEnd::Unreadable(problem)),
                (None, _) => {
                    self.cut(bytes.get(at..).unwrap_or_default())?;
                    return Ok(FileEnd::Cut);
                }
            }
        }
        Ok(FileEnd::Missing)
    }

    /// Takes in the record that begins at a place.
    fn record_at(&mut self, bytes: &[u8], at: usize, index: Option<&FileIndex<'_>>) -> Result<Step, ReadMcapError> {
        let Some((code, body, after)) = next_record(bytes.get(at..).unwrap_or_default()) else {
            return Ok(Step::Cut);
        };
        let end = bytes.len() - after.len();
        // No record has code 0, of which an erased stretch consists.
        if code == 0 || index.is_some_and(|index| !index.allows(bytes, at, end, code)) {
            return Ok(Step::Lost("no record begins there".to_owned()));
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
