//! The replay on the disk: full pieces that never change, and the piece that is being filled.
//!
//! ```text
//! replay/rows-<first>-<end>.bin      a full piece, written once
//! replay/tail-<first>-<end>.bin      what is left, written by the checkpoint that names `end`
//!     "DPROWS01"   u64 first   u32 rows   u32 floats a row   rows in f32   CRC-32C of everything before (u32)
//! ```
//!
//! Rows are numbered as they were written, from 0. A full replay is half a gigabyte; in pieces a checkpoint writes a few
//! megabytes, whenever it comes. Pieces that a checkpoint does not need any more are removed once it is written.

use std::ops::Range;
use std::path::{Path, PathBuf};

use sac::Learner;

use crate::TrainingError;
use crate::run_files::RunFiles;

/// Rows of a full piece, unless the whole replay holds less than two: about 4 MB (chosen: written in some milliseconds, and
/// few files).
const PIECE_ROWS: u64 = 4096;
const MAGIC: &[u8; 8] = b"DPROWS01";
const HEADER: usize = 8 + 8 + 4 + 4;

/// The pieces of a run's replay.
#[derive(Debug, Clone)]
pub struct ReplayFiles {
    folder: PathBuf,
    piece_rows: u64,
    /// Rows before this one stand in full pieces.
    full_until: u64,
}

impl ReplayFiles {
    /// The pieces in a folder of a replay of so many rows; all full ones before row `written` are there.
    pub fn new(folder: PathBuf, capacity: usize, written: u64) -> Self {
        // A piece must still be whole in the ring when it has become full.
        let piece_rows = PIECE_ROWS.min(capacity as u64 / 2).max(1);
        ReplayFiles { folder, piece_rows, full_until: written - written % piece_rows }
    }

    /// Writes the pieces that have become full since the last call.
    ///
    /// # Errors
    /// If the disk is full, by file.
    pub fn keep_full(&mut self, learner: &Learner) -> Result<(), TrainingError> {
        while learner.replay_rows().end >= self.full_until + self.piece_rows {
            let rows = self.full_until..self.full_until + self.piece_rows;
            self.write(&self.full(&rows), rows.clone(), learner)?;
            self.full_until = rows.end;
        }
        Ok(())
    }

    /// Writes what stands in no full piece yet: with it, the rows of a checkpoint are complete.
    ///
    /// # Errors
    /// If the disk is full, by file.
    pub fn keep_tail(&mut self, learner: &Learner) -> Result<(), TrainingError> {
        self.keep_full(learner)?;
        let rows = self.full_until..learner.replay_rows().end;
        if rows.is_empty() { Ok(()) } else { self.write(&self.tail(&rows), rows, learner) }
    }

    /// Removes what the checkpoint that was just written does not need. What cannot be removed only takes space.
    pub fn tidy(&self, needed: &Range<u64>) {
        let Ok(entries) = std::fs::read_dir(&self.folder) else { return };
        for path in entries.filter_map(|entry| Some(entry.ok()?.path())) {
            let Some(rows) = rows_of(&path) else { continue };
            let is_tail = rows.end - rows.start < self.piece_rows;
            if rows.end <= needed.start || (is_tail && rows.end != needed.end) {
                let _ = std::fs::remove_file(path);
            }
        }
    }

    /// Puts the rows of a checkpoint back into a learner's replay.
    ///
    /// # Errors
    /// A piece that is missing or damaged, by name.
    pub fn restore(&self, rows: Range<u64>, learner: &mut Learner) -> Result<(), TrainingError> {
        let width = learner.replay_width();
        let mut next = rows.start;
        while next < rows.end {
            let first = next - next % self.piece_rows;
            let end = (first + self.piece_rows).min(rows.end);
            let path = if first < self.full_until { self.full(&(first..end)) } else { self.tail(&(first..end)) };
            let bytes = std::fs::read(&path)
                .map_err(|error| TrainingError::file(&path, &format!("cannot be read: {error}")))?;
            let floats = parsed(&bytes, first, (end - first) as usize, width)
                .ok_or_else(|| TrainingError::file(&path, "is no piece of this run's replay, or is damaged"))?;
            learner.restore_replay_rows(next, &floats[(next - first) as usize * width..]);
            next = end;
        }
        Ok(())
    }

    fn write(&self, path: &Path, rows: Range<u64>, learner: &Learner) -> Result<(), TrainingError> {
        let (count, width) = ((rows.end - rows.start) as u32, learner.replay_width() as u32);
        let floats = learner.copy_replay_rows(rows.clone());
        let mut bytes = Vec::with_capacity(HEADER + 4 * floats.len() + 4);
        bytes.extend(MAGIC);
        bytes.extend(rows.start.to_le_bytes());
        bytes.extend(count.to_le_bytes());
        bytes.extend(width.to_le_bytes());
        bytes.extend(floats.iter().flat_map(|x| x.to_le_bytes()));
        bytes.extend(crc32c::crc32c(&bytes).to_le_bytes());
        std::fs::create_dir_all(&self.folder)
            .map_err(|error| TrainingError::file(&self.folder, &format!("cannot be made: {error}")))?;
        RunFiles::write(path, &bytes)
    }

    fn full(&self, rows: &Range<u64>) -> PathBuf {
        self.folder.join(format!("rows-{}-{}.bin", rows.start, rows.end))
    }

    fn tail(&self, rows: &Range<u64>) -> PathBuf {
        self.folder.join(format!("tail-{}-{}.bin", rows.start, rows.end))
    }
}

/// Rows that a file's name says it holds; nothing for files that are none of ours.
fn rows_of(path: &Path) -> Option<Range<u64>> {
    let name = path.file_name()?.to_str()?.strip_suffix(".bin")?;
    let (first, end) = name.strip_prefix("rows-").or(name.strip_prefix("tail-"))?.split_once('-')?;
    Some(first.parse().ok()?..end.parse().ok()?)
}

/// The floats of a piece that holds these rows.
fn parsed(bytes: &[u8], first: u64, rows: usize, width: usize) -> Option<Vec<f32>> {
    let (body, crc) = bytes.split_last_chunk::<4>()?;
    if crc32c::crc32c(body) != u32::from_le_bytes(*crc) {
        return None;
    }
    let (head, floats) = body.split_at_checked(HEADER)?;
    let expected =
        [MAGIC.as_slice(), &first.to_le_bytes(), &(rows as u32).to_le_bytes(), &(width as u32).to_le_bytes()];
    if head != expected.concat() || floats.len() != 4 * rows * width {
        return None;
    }
    let (floats, _) = floats.as_chunks::<4>();
    Some(floats.iter().map(|four| f32::from_le_bytes(*four)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_say_what_is_inside() {
        assert_eq!(rows_of(Path::new("a/rows-8192-12288.bin")), Some(8192..12288));
        assert_eq!(rows_of(Path::new("a/tail-4096-5000.bin")), Some(4096..5000));
        for other in ["a/rows-x-3.bin", "a/tail-3.bin", "a/checkpoint.bin", "a/rows-1-2.txt"] {
            assert_eq!(rows_of(Path::new(other)), None, "{other}");
        }
    }
}
