//! Protocol buffers on the wire, as far as ONNX needs them.
//!
//! A message is a row of fields, each a tag `(number << 3) | kind` and its value: kind 0 is a base-128 number, kind 2
//! a length and that many bytes (text, raw data, or a message inside). Fields may stand in any order; a list is its
//! field written again and again. (Protocol Buffers, "Encoding".)

use crate::error::ImportError;

const NUMBER: u64 = 0;
const EIGHT_BYTES: u64 = 1;
const BYTES: u64 = 2;
const FOUR_BYTES: u64 = 5;

/// A message under construction.
#[derive(Debug, Default, Clone)]
pub(crate) struct Message(Vec<u8>);

impl Message {
    /// Adds an unsigned number, or an enumeration's value.
    pub(crate) fn number(mut self, field: u64, value: u64) -> Self {
        self.varint(field << 3 | NUMBER);
        self.varint(value);
        self
    }

    /// Adds bytes.
    pub(crate) fn bytes(mut self, field: u64, value: &[u8]) -> Self {
        self.varint(field << 3 | BYTES);
        self.varint(value.len() as u64);
        self.0.extend_from_slice(value);
        self
    }

    /// Adds text.
    pub(crate) fn text(self, field: u64, value: &str) -> Self {
        self.bytes(field, value.as_bytes())
    }

    /// Adds a message inside this one.
    pub(crate) fn message(self, field: u64, value: Message) -> Self {
        self.bytes(field, &value.0)
    }

    /// Adds a list: one field for each item.
    pub(crate) fn each<T>(self, items: impl IntoIterator<Item = T>, add: impl Fn(Self, T) -> Self) -> Self {
        items.into_iter().fold(self, add)
    }

    /// The bytes.
    pub(crate) fn into_bytes(self) -> Vec<u8> {
        self.0
    }

    /// Seven bits a byte, the lowest first; the top bit says that more follow.
    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
    }
}

/// A field's value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Value<'b> {
    /// An unsigned number, or an enumeration's value.
    Number(u64),
    /// Text, raw data, or a message.
    Bytes(&'b [u8]),
}

/// The fields of a message, in order. Fields of the two fixed lengths, which ONNX files of this crate do not have, are
/// passed over.
pub(crate) struct Fields;

impl Fields {
    /// Reads them all.
    ///
    /// # Errors
    /// [`ImportError::Damaged`]: the bytes end within a field, or are no message.
    pub(crate) fn of(mut bytes: &[u8]) -> Result<Vec<(u64, Value<'_>)>, ImportError> {
        let mut fields = Vec::new();
        while !bytes.is_empty() {
            let tag = varint(&mut bytes)?;
            match tag & 7 {
                NUMBER => fields.push((tag >> 3, Value::Number(varint(&mut bytes)?))),
                BYTES => {
                    let length = usize::try_from(varint(&mut bytes)?).map_err(|_| ImportError::Damaged)?;
                    fields.push((tag >> 3, Value::Bytes(part(&mut bytes, length)?)));
                }
                EIGHT_BYTES => drop(part(&mut bytes, 8)?),
                FOUR_BYTES => drop(part(&mut bytes, 4)?),
                _ => return Err(ImportError::Damaged),
            }
        }
        Ok(fields)
    }
}

/// Takes the first `length` bytes off.
fn part<'b>(bytes: &mut &'b [u8], length: usize) -> Result<&'b [u8], ImportError> {
    let (first, rest) = bytes.split_at_checked(length).ok_or(ImportError::Damaged)?;
    *bytes = rest;
    Ok(first)
}

fn varint(bytes: &mut &[u8]) -> Result<u64, ImportError> {
    let mut value = 0;
    for shift in (0..64).step_by(7) {
        let &[byte] = part(bytes, 1)? else { return Err(ImportError::Damaged) };
        value |= u64::from(byte & 0x7f) << shift;
        if byte < 0x80 {
            return Ok(value);
        }
    }
    Err(ImportError::Damaged)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The three examples of the "Encoding" page: 150 in field 1, "testing" in field 2, the first inside field 3.
    #[test]
    fn the_specifications_examples() {
        let number = Message::default().number(1, 150);
        assert_eq!(number.clone().into_bytes(), [0x08, 0x96, 0x01]);
        let text = Message::default().text(2, "testing");
        assert_eq!(text.into_bytes(), [0x12, 0x07, 0x74, 0x65, 0x73, 0x74, 0x69, 0x6e, 0x67]);
        let inside = Message::default().message(3, number);
        assert_eq!(inside.into_bytes(), [0x1a, 0x03, 0x08, 0x96, 0x01]);
    }

    /// Field numbers from 16 on need a second byte, and the largest number ten.
    #[test]
    fn long_tags_and_numbers() {
        assert_eq!(Message::default().number(16, 0).into_bytes(), [0x80, 0x01, 0x00]);
        let longest = Message::default().number(1, u64::MAX).into_bytes();
        assert_eq!((longest.len(), longest[10]), (11, 0x01));
        assert_eq!(Fields::of(&longest).unwrap(), [(1, Value::Number(u64::MAX))]);
        // An eleventh byte of a number is one too many.
        assert_eq!(Fields::of(&[[0x08].as_slice(), &[0xff; 11]].concat()).unwrap_err(), ImportError::Damaged);
    }
}
