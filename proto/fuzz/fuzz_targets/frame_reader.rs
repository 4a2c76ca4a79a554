//! Any bytes, cut in any way, through the frame reader.
//!
//! The input is a byte of flags, eight piece sizes, and the stream. With flag bit 0 the headers and
//! CRCs of the stream are made right where they stand, so that fuzzing gets behind the CRC, which it
//! cannot guess. Checked, beyond "no panic": the frames and errors do not depend on how the stream is
//! cut; they are those of a plain decoder that walks the whole stream; a frame's raw bytes decode to
//! it; encoding it and decoding again changes no bit; a message is one line.
#![no_main]

use libfuzzer_sys::fuzz_target;
use proto::wire::{Frame, FrameReader, FrameType, WireError};

fuzz_target!(|input: &[u8]| {
    let Some((flags, rest)) = input.split_first() else { return };
    let Some((pieces, stream)) = rest.split_first_chunk::<8>() else { return };
    let mut stream = stream.to_vec();
    if flags & 1 != 0 {
        mend(&mut stream);
    }
    let expected = walk(&stream);
    let cut = read(&stream, pieces);
    assert_eq!(cut, expected, "cut in {pieces:?}");
    assert_eq!(read(&stream, &[255]), expected, "nearly whole");
});

type Outcome = Result<Vec<u8>, WireError>;

/// Frames and errors of the stream, fed in pieces of 1 to 256 bytes; ends at a fatal error.
fn read(stream: &[u8], pieces: &[u8]) -> Vec<Outcome> {
    let mut reader = FrameReader::new();
    let mut outcomes = Vec::new();
    let mut rest = stream;
    for piece in pieces.iter().cycle() {
        if rest.is_empty() {
            break;
        }
        let (now, later) = rest.split_at((usize::from(*piece) + 1).min(rest.len()));
        rest = later;
        assert_eq!(reader.push(now), now.len());
        loop {
            match reader.next_frame() {
                Ok(None) => break,
                Ok(Some(received)) => {
                    let raw = received.raw.as_bytes();
                    assert_eq!(raw.len(), received.frame.kind().length());
                    let encoded = received.frame.encode();
                    let again = Frame::decode(encoded.as_bytes()).expect("what is encoded decodes");
                    assert_eq!(again.encode(), encoded);
                    outcomes.push(Ok(raw.to_vec()));
                }
                Err(damage) => {
                    assert!(!damage.to_string().contains('\n'));
                    outcomes.push(Err(trimmed(damage.error)));
                    if damage.is_fatal() {
                        assert_eq!(reader.next_frame(), Err(damage));
                        return outcomes;
                    }
                }
            }
        }
    }
    outcomes
}

/// Reads them by decoding frame after frame from the whole stream.
fn walk(stream: &[u8]) -> Vec<Outcome> {
    let mut outcomes = Vec::new();
    let mut rest = stream;
    loop {
        match Frame::decode(rest) {
            Ok(_) => {
                outcomes.push(Ok(rest.to_vec()));
                return outcomes;
            }
            Err(WireError::Truncated { .. }) => return outcomes,
            Err(WireError::Trailing { frame, .. }) => {
                let (bytes, later) = rest.split_at(frame.length());
                outcomes.push(Frame::decode(bytes).map(|_| bytes.to_vec()).map_err(trimmed));
                rest = later;
            }
            Err(error) => {
                outcomes.push(Err(trimmed(error)));
                return outcomes;
            }
        }
    }
}

/// Fatal errors show as many header bytes as had come, which depends on the cut: leave them out.
fn trimmed(error: WireError) -> WireError {
    use proto::wire::HeaderBytes;
    let header = HeaderBytes::of(&[]);
    match error {
        WireError::Magic { .. } => WireError::Magic { header },
        WireError::Version { found, .. } => WireError::Version { found, header },
        WireError::Type { code, .. } => WireError::Type { code, header },
        WireError::Length { frame, found, .. } => WireError::Length { frame, found, header },
        other => other,
    }
}

/// Makes headers and CRCs right: byte 5 of each frame picks its type.
fn mend(stream: &mut [u8]) {
    let mut at = 0;
    while let Some(code) = stream.get(at + 5).copied() {
        let kind = [FrameType::Hello, FrameType::Sense, FrameType::Command, FrameType::Bye][usize::from(code % 4)];
        let length = kind.length();
        let Some(frame) = stream.get_mut(at..at + length) else { return };
        frame[..4].copy_from_slice(b"PNEU");
        frame[4] = 1;
        frame[5] = kind.code();
        frame[6..8].copy_from_slice(&(length as u16).to_be_bytes());
        let crc = crc32fast::hash(&frame[..length - 4]);
        // A last byte of 0xFF leaves the CRC as it is, so that damaged frames stand among sound ones.
        if frame[length - 1] != 0xFF {
            frame[length - 4..].copy_from_slice(&crc.to_be_bytes());
        }
        at += length;
    }
}
