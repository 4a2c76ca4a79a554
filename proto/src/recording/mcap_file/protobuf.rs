//! The little of Protocol Buffers that recordings need: writing and reading fields.
//!
//! A message is a run of fields, each a key `number << 3 | wire type` and a value. Wire types: 0 a
//! varint (seven bits per byte, low first, top bit says more follows), 1 eight bytes, 2 a length and
//! that many bytes, 5 four bytes; multi-byte values are little-endian. (Protocol Buffers encoding
//! guide.)
//!
//! Every field is written, zero or not: −0.0 and NaN payloads then survive, where the usual rule
//! (leave out defaults) would turn −0.0 into 0.0.
//!
//! Left out: groups, maps, presence; and a code generator with its compiler, for some 50 fields.

/// Types of a field descriptor (`FieldDescriptorProto.Type`).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u64)]
pub(crate) enum FieldType {
    Double = 1,
    Float = 2,
    Int64 = 3,
    Uint64 = 4,
    Int32 = 5,
    Bool = 8,
    String = 9,
    Message = 11,
    Bytes = 12,
    Uint32 = 13,
    Enum = 14,
    Sint64 = 18,
}

/// Why bytes are no message of ours.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(crate) enum DecodeError {
    #[error("it ends within a field")]
    Truncated,
    #[error("a number runs over 64 bits")]
    LongVarint,
    #[error("a field has the unknown wire type {0}")]
    WireType(u8),
    #[error("field {0} holds what it cannot")]
    Value(u32),
}

/// A field's value as it stands in the bytes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Raw<'a> {
    Varint(u64),
    Eight([u8; 8]),
    Bytes(&'a [u8]),
    Four([u8; 4]),
}

/// A Rust value that is one field of a message.
pub(crate) trait FieldValue: Sized {
    const TYPE: FieldType;
    const REPEATED: bool = false;
    /// Appends key and value.
    fn put(&self, number: u32, out: &mut Vec<u8>);
    /// Takes the value; `None` when the bytes cannot be one.
    fn take(&mut self, raw: Raw<'_>) -> Option<()>;
}

pub(crate) fn put_varint(mut value: u64, out: &mut Vec<u8>) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

pub(crate) fn put_uint(number: u32, value: u64, out: &mut Vec<u8>) {
    put_varint(u64::from(number) << 3, out);
    put_varint(value, out);
}

pub(crate) fn put_bytes(number: u32, bytes: &[u8], out: &mut Vec<u8>) {
    put_varint(u64::from(number) << 3 | 2, out);
    put_varint(bytes.len() as u64, out);
    out.extend_from_slice(bytes);
}

/// Calls `each` for every field of a message.
pub(crate) fn for_each_field<'a>(
    mut bytes: &'a [u8],
    mut each: impl FnMut(u32, Raw<'a>) -> Result<(), DecodeError>,
) -> Result<(), DecodeError> {
    while !bytes.is_empty() {
        let key = take_varint(&mut bytes)?;
        let number = u32::try_from(key >> 3).map_err(|_| DecodeError::LongVarint)?;
        let raw = match key as u8 & 7 {
            0 => Raw::Varint(take_varint(&mut bytes)?),
            1 => Raw::Eight(take_array(&mut bytes)?),
            2 => {
                let length = take_varint(&mut bytes)?;
                let length = usize::try_from(length).map_err(|_| DecodeError::Truncated)?;
                let (head, rest) = bytes.split_at_checked(length).ok_or(DecodeError::Truncated)?;
                bytes = rest;
                Raw::Bytes(head)
            }
            5 => Raw::Four(take_array(&mut bytes)?),
            other => return Err(DecodeError::WireType(other)),
        };
        each(number, raw)?;
    }
    Ok(())
}

fn take_varint(bytes: &mut &[u8]) -> Result<u64, DecodeError> {
    let mut value = 0_u64;
    for shift in (0..64).step_by(7) {
        let (byte, rest) = bytes.split_first().ok_or(DecodeError::Truncated)?;
        *bytes = rest;
        let bits = u64::from(byte & 0x7f);
        if bits << shift >> shift != bits {
            return Err(DecodeError::LongVarint);
        }
        value |= bits << shift;
        if byte & 0x80 == 0 {
            return Ok(value);
        }
    }
    Err(DecodeError::LongVarint)
}

fn take_array<const N: usize>(bytes: &mut &[u8]) -> Result<[u8; N], DecodeError> {
    let (head, rest) = bytes.split_first_chunk::<N>().ok_or(DecodeError::Truncated)?;
    *bytes = rest;
    Ok(*head)
}

macro_rules! unsigned {
    ($($rust:ty => $type:ident),*) => { $(
        impl FieldValue for $rust {
            const TYPE: FieldType = FieldType::$type;
            fn put(&self, number: u32, out: &mut Vec<u8>) {
                put_uint(number, u64::from(*self), out);
            }
            fn take(&mut self, raw: Raw<'_>) -> Option<()> {
                let Raw::Varint(value) = raw else { return None };
                *self = value.try_into().ok()?;
                Some(())
            }
        }
    )* };
}
unsigned!(u8 => Uint32, u16 => Uint32, u32 => Uint32, u64 => Uint64);

impl FieldValue for bool {
    const TYPE: FieldType = FieldType::Bool;
    fn put(&self, number: u32, out: &mut Vec<u8>) {
        put_uint(number, u64::from(*self), out);
    }
    fn take(&mut self, raw: Raw<'_>) -> Option<()> {
        let Raw::Varint(value @ 0..=1) = raw else { return None };
        *self = value == 1;
        Some(())
    }
}

impl FieldValue for i64 {
    const TYPE: FieldType = FieldType::Sint64;
    fn put(&self, number: u32, out: &mut Vec<u8>) {
        // Zigzag: small numbers of either sign stay short.
        put_uint(number, ((self << 1) ^ (self >> 63)) as u64, out);
    }
    fn take(&mut self, raw: Raw<'_>) -> Option<()> {
        let Raw::Varint(value) = raw else { return None };
        *self = (value >> 1) as i64 ^ -((value & 1) as i64);
        Some(())
    }
}

impl FieldValue for f64 {
    const TYPE: FieldType = FieldType::Double;
    fn put(&self, number: u32, out: &mut Vec<u8>) {
        put_varint(u64::from(number) << 3 | 1, out);
        out.extend_from_slice(&self.to_le_bytes());
    }
    fn take(&mut self, raw: Raw<'_>) -> Option<()> {
        let Raw::Eight(bytes) = raw else { return None };
        *self = f64::from_le_bytes(bytes);
        Some(())
    }
}

impl FieldValue for f32 {
    const TYPE: FieldType = FieldType::Float;
    fn put(&self, number: u32, out: &mut Vec<u8>) {
        put_varint(u64::from(number) << 3 | 5, out);
        out.extend_from_slice(&self.to_le_bytes());
    }
    fn take(&mut self, raw: Raw<'_>) -> Option<()> {
        let Raw::Four(bytes) = raw else { return None };
        *self = f32::from_le_bytes(bytes);
        Some(())
    }
}

macro_rules! packed {
    ($($rust:ty),*) => { $(
        impl<const N: usize> FieldValue for [$rust; N] {
            const TYPE: FieldType = <$rust as FieldValue>::TYPE;
            const REPEATED: bool = true;
            fn put(&self, number: u32, out: &mut Vec<u8>) {
                put_varint(u64::from(number) << 3 | 2, out);
                put_varint(size_of::<Self>() as u64, out);
                for value in self {
                    out.extend_from_slice(&value.to_le_bytes());
                }
            }
            fn take(&mut self, raw: Raw<'_>) -> Option<()> {
                let Raw::Bytes(bytes) = raw else { return None };
                let (chunks, rest) = bytes.as_chunks::<{ size_of::<$rust>() }>();
                if chunks.len() != N || !rest.is_empty() {
                    return None;
                }
                for (value, chunk) in self.iter_mut().zip(chunks) {
                    *value = <$rust>::from_le_bytes(*chunk);
                }
                Some(())
            }
        }
    )* };
}
packed!(f32, f64);

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn bytes_agree_with_the_encoding_guide() {
        // The guide's own examples: field 1 = 150, field 2 = "testing", sint64 −2 → 3.
        let mut out = Vec::new();
        put_uint(1, 150, &mut out);
        put_bytes(2, b"testing", &mut out);
        (-2_i64).put(3, &mut out);
        assert_eq!(out, b"\x08\x96\x01\x12\x07testing\x18\x03");
    }

    #[test]
    fn broken_bytes_are_named() {
        let decode = |bytes: &[u8]| for_each_field(bytes, |_, _| Ok(())).unwrap_err();
        assert_eq!(decode(b"\x08"), DecodeError::Truncated);
        assert_eq!(decode(b"\x0a\x05abc"), DecodeError::Truncated);
        assert_eq!(decode(b"\x09\0\0\0"), DecodeError::Truncated);
        assert_eq!(decode(b"\x0b"), DecodeError::WireType(3));
        assert_eq!(decode(b"\x08\xff\xff\xff\xff\xff\xff\xff\xff\xff\x02"), DecodeError::LongVarint);
    }

    proptest! {
        #[test]
        fn varints_and_signs_come_back(unsigned: u64, signed: i64) {
            let mut out = Vec::new();
            unsigned.put(1, &mut out);
            signed.put(536_870_911, &mut out);
            let (mut a, mut b) = (0_u64, 0_i64);
            for_each_field(&out, |number, raw| {
                if number == 1 { a.take(raw) } else { b.take(raw) }.ok_or(DecodeError::Value(number))
            }).unwrap();
            prop_assert_eq!((a, b), (unsigned, signed));
        }

        #[test]
        fn no_bytes_make_it_panic(bytes: Vec<u8>) {
            let _ = for_each_field(&bytes, |_, raw| {
                let mut numbers = [0.0_f64; 3];
                let _ = numbers.take(raw);
                Ok(())
            });
        }
    }
}
