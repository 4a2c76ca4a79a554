//! Bytes of a text file to text: UTF-8, UTF-16 with and without a byte-order mark, Latin-1, and lines that end with CR alone.

use std::borrow::Cow;

use crate::recording::csv::CsvError;

/// The byte-order mark as a letter, which shows nothing.
const MARK: char = '\u{feff}';

/// Decodes a text file: UTF-8 or UTF-16 with a byte-order mark, and Latin-1 otherwise; without the zeros at the end of a file of a fixed
/// size.
///
/// # Errors
/// The bytes are no text.
pub(crate) fn decode<'a>(file: &str, bytes: &'a [u8]) -> Result<Cow<'a, str>, CsvError> {
    let text = match letters(file, bytes)? {
        Cow::Borrowed(text) => Cow::Borrowed(text.trim_end_matches('\0')),
        Cow::Owned(mut text) => {
            text.truncate(text.trim_end_matches('\0').len());
            Cow::Owned(text)
        }
    };
    // Lines that end with CR alone, as some instruments write them.
    let is_of_cr = !text.contains('\n') && text.contains('\r');
    let text = if is_of_cr { Cow::Owned(text.replace('\r', "\n")) } else { text };
    // A second byte-order mark, or that of a file which was joined to this one.
    Ok(if text.contains(MARK) { Cow::Owned(text.replace(MARK, "")) } else { text })
}

/// The letters of a text file without the mark at its beginning, its lines as they end.
fn letters<'a>(file: &str, bytes: &'a [u8]) -> Result<Cow<'a, str>, CsvError> {
    let wide = |bytes: &[u8], unit: fn([u8; 2]) -> u16| {
        let units: Vec<u16> = bytes.as_chunks::<2>().0.iter().map(|pair| unit(*pair)).collect();
        String::from_utf16_lossy(&units)
    };
    if let Some(rest) = bytes.strip_prefix(b"\xFF\xFE") {
        return Ok(Cow::Owned(wide(rest, u16::from_le_bytes)));
    }
    if let Some(rest) = bytes.strip_prefix(b"\xFE\xFF") {
        return Ok(Cow::Owned(wide(rest, u16::from_be_bytes)));
    }
    let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    match without_mark(bytes) {
        Some(Wide::Little) => return Ok(Cow::Owned(wide(bytes, u16::from_le_bytes))),
        Some(Wide::Big) => return Ok(Cow::Owned(wide(bytes, u16::from_be_bytes))),
        None => {}
    }
    match std::str::from_utf8(bytes) {
        Ok(text) => Ok(Cow::Borrowed(text)),
        Err(error) => {
            let before = bytes.get(..error.valid_up_to()).unwrap_or_default();
            let line_start = before.iter().rposition(|byte| *byte == b'\n').map_or(0, |at| at + 1);
            let commas = before.get(line_start..).unwrap_or_default().iter().filter(|byte| **byte == b',').count();
            // A zero byte is in no text of one byte a character.
            if bytes.contains(&0) {
                return Err(CsvError::NotUtf8 {
                    file: file.to_owned(),
                    line: before.iter().filter(|byte| **byte == b'\n').count() as u64 + 1,
                    position: commas + 1,
                });
            }
            Ok(Cow::Owned(bytes.iter().map(|byte| char::from(*byte)).collect()))
        }
    }
}

/// Byte order of UTF-16.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Wide {
    Little,
    Big,
}

/// Bytes that UTF-16 without a byte-order mark is told from.
const WIDE_SAMPLE_BYTES: usize = 256;

/// The order of UTF-16 without a mark: every other byte of what tables begin with is zero.
fn without_mark(bytes: &[u8]) -> Option<Wide> {
    let pairs = bytes.get(..bytes.len().min(WIDE_SAMPLE_BYTES)).unwrap_or_default().as_chunks::<2>().0;
    let all = |zero: usize, letter: usize| {
        pairs.len() > 1 && pairs.iter().all(|pair| pair.get(zero) == Some(&0) && pair.get(letter) != Some(&0))
    };
    if all(1, 0) {
        Some(Wide::Little)
    } else if all(0, 1) {
        Some(Wide::Big)
    } else {
        None
    }
}
