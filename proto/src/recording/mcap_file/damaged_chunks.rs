//! Damaged chunks, and the ticks that a run lacks with them.
//!
//! The index behind a chunk lists its messages by channel, so what was lost of one that is damaged is known to the tick. A file of
//! another tool may have no index; then the head of the chunk says from when to when its messages are, if it is whole.

use std::collections::HashMap;

use crate::recording::table::PERIOD_S;

/// Times in the head of a chunk that are further apart than this (s) are damaged as well: a day.
const LONGEST_S: f64 = 86_400.0;

/// A chunk of which something was left out.
#[derive(Debug)]
pub(crate) struct Damaged {
    /// Place of its note.
    pub(super) note: usize,
    /// Ticks that were read of it.
    read: usize,
    /// Messages that its index lists, by channel.
    indexed: HashMap<u16, usize>,
    /// Time from its first message to its last by its head (s); 0 where that says none.
    span_s: f64,
}

impl Damaged {
    /// The chunk with this body, of which so many ticks were read; `note` is the place of what is told of it.
    pub(crate) fn of(body: &[u8], note: usize, read: usize) -> Self {
        let time = |at: usize| body.get(at..)?.first_chunk::<8>().map(|bytes| u64::from_le_bytes(*bytes));
        let span_ns = time(0).zip(time(8)).and_then(|(first, last)| last.checked_sub(first)).unwrap_or(0);
        let span_s = Some(span_ns as f64 * 1e-9).filter(|span_s| *span_s < LONGEST_S).unwrap_or(0.0);
        Damaged { note, read, indexed: HashMap::new(), span_s }
    }

    /// Takes in how many messages of a channel its index lists.
    pub(crate) fn index(&mut self, channel: u16, messages: usize) {
        *self.indexed.entry(channel).or_default() += messages;
    }

    /// Words for the ticks that it lacks; `None` where it lacks none, or nothing says how many.
    fn lacks(&self, is_of_ticks: impl Fn(u16) -> bool) -> Option<String> {
        let ticks: usize =
            self.indexed.iter().filter(|(channel, _)| is_of_ticks(**channel)).map(|(_, messages)| messages).sum();
        match ticks.saturating_sub(self.read) {
            0 if self.indexed.is_empty() && self.span_s > 0.0 => {
                Some(format!("its messages span {:.2} s", self.span_s))
            }
            0 => None,
            lost => Some(lost_words(lost as u64)),
        }
    }
}

/// Words for ticks that are lost.
pub(super) fn lost_words(ticks: u64) -> String {
    match ticks {
        0 => "no tick is lost".to_owned(),
        1 => format!("1 tick of {PERIOD_S} s is lost"),
        ticks => format!("{ticks} ticks ({:.2} s) are lost", ticks as f64 * PERIOD_S),
    }
}

/// Puts what damaged chunks lack behind their notes.
pub(crate) fn tell(notes: &mut [String], damaged: &[Damaged], is_of_ticks: impl Fn(u16) -> bool) {
    for chunk in damaged {
        if let (Some(note), Some(lacks)) = (notes.get_mut(chunk.note), chunk.lacks(&is_of_ticks)) {
            note.push_str("; ");
            note.push_str(&lacks);
        }
    }
}
