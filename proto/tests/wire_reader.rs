//! Damage on the wire, case by case: which kind it is, and the one line a person reads.

// A test may stop at the first thing that is not as it must be; helpers here are part of tests.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::io::Cursor;

use proto::wire::{ByeReason, Command, Frame, FrameReader, FrameType, Hello, HelloRefusal, Mode, TripBits, WireError};

fn run_command() -> Command {
    Command {
        sequence: 9,
        clock_ns: 1,
        session: 7,
        tick: 3,
        duty: [0.5, 0.5],
        mode: Mode::Run,
        ttl_ticks: 2,
        digital_outputs: 1,
    }
}

/// A frame with these bytes changed and its CRC made right again, by the bitwise CRC of the
/// textbook rather than by the crate under test.
fn resealed(frame: &[u8], changes: &[(usize, u8)]) -> Vec<u8> {
    let mut bytes = frame.to_vec();
    for (at, value) in changes {
        bytes[*at] = *value;
    }
    let content = bytes.len() - 4;
    let mut crc = 0xFFFF_FFFF_u32;
    for byte in &bytes[..content] {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { (crc >> 1) ^ 0xEDB8_8320 } else { crc >> 1 };
        }
    }
    bytes[content..].copy_from_slice(&(!crc).to_be_bytes());
    bytes
}

fn first_error(bytes: &[u8]) -> WireError {
    let mut reader = FrameReader::new();
    assert_eq!(reader.push(bytes), bytes.len());
    reader.next_frame().unwrap_err().error
}

fn one_line(error: &WireError) -> String {
    let text = error.to_string();
    assert!(!text.contains('\n'));
    text
}

#[test]
fn a_wrong_crc_drops_the_frame_and_keeps_its_bytes() {
    let mut reader = FrameReader::new();
    let mut damaged = run_command().encode();
    damaged[30] ^= 0x10;
    reader.push(&damaged);
    reader.push(&run_command().encode());
    let damage = reader.next_frame().unwrap_err();
    assert!(!damage.is_fatal());
    assert_eq!(damage.raw.as_bytes(), damaged);
    assert!(matches!(damage.error, WireError::Crc { frame: FrameType::Command, .. }));
    assert!(one_line(&damage.error).contains("504E4555 0103002C 00000009"), "{damage}");
    let next = reader.next_frame().unwrap().unwrap();
    assert_eq!(next.frame, Frame::Command(run_command()));
    assert_eq!(reader.dropped(), 1);
}

#[test]
fn another_program_on_the_port_is_told_by_its_first_byte() {
    let error = first_error(b"HTTP/1.1 400 Bad Request");
    assert!(error.is_fatal());
    assert!(one_line(&error).contains("[48545450 2F312E31"), "{error}");
    // A peer that sends three bytes and waits is told apart from a slow one.
    assert!(matches!(first_error(b"SSH"), WireError::Magic { .. }));
    let mut reader = FrameReader::new();
    reader.push(b"PNE");
    assert_eq!(reader.next_frame(), Ok(None));
}

#[test]
fn another_version_names_both() {
    let bytes = resealed(&run_command().encode(), &[(4, 2)]);
    let error = first_error(&bytes);
    assert!(matches!(error, WireError::Version { found: 2, .. }) && error.is_fatal());
    let text = one_line(&error);
    assert!(text.contains("version 2") && text.contains("version 1"), "{text}");
}

#[test]
fn an_impossible_length_is_fatal_even_with_a_right_crc() {
    for (high, low) in [(0, 0), (0, 43), (0, 45), (0, 64), (255, 255)] {
        let error = first_error(&resealed(&run_command().encode(), &[(6, high), (7, low)]));
        let found = u16::from_be_bytes([high, low]);
        assert!(error.is_fatal());
        assert!(matches!(error, WireError::Length { frame: FrameType::Command, found: f, .. } if f == found));
        assert!(one_line(&error).contains("must be 44"), "{error}");
    }
}

#[test]
fn an_unknown_type_is_fatal() {
    for code in [0, 5, 255] {
        let error = first_error(&resealed(&run_command().encode(), &[(5, code)]));
        assert!(matches!(error, WireError::Type { code: c, .. } if c == code) && error.is_fatal());
    }
}

#[test]
fn an_unknown_mode_or_state_is_dropped_and_says_where() {
    let error = first_error(&resealed(&run_command().encode(), &[(36, 3)]));
    assert!(!error.is_fatal());
    assert_eq!(one_line(&error), "a COMMAND frame holds 3 as its mode (byte 36), a code the protocol does not name");
    let golden =
        include_str!("wire_goldens/goldens.txt").lines().find_map(|line| line.strip_prefix("sense_running ")).unwrap();
    let sense: Vec<u8> = (0..64).map(|at| u8::from_str_radix(&golden[2 * at..2 * at + 2], 16).unwrap()).collect();
    let error = first_error(&resealed(&sense, &[(56, 0x84)]));
    assert!(matches!(error, WireError::UnknownCode { field: "state", code: 4, .. }));
    // Bits 4 to 6 of the same byte have no meaning and are ignored.
    assert!(Frame::decode(&resealed(&sense, &[(56, 0xF1)])).is_ok());
}

#[test]
fn unknown_trip_bits_and_reasons_are_kept_and_shown() {
    assert_eq!(TripBits::from_bits(0x42).to_string(), "command lost, unknown bits 0x40");
    assert_eq!(TripBits::NONE.to_string(), "none");
    assert_eq!(ByeReason::from_code(9).code(), 9);
}

#[test]
fn bytes_called_zero_are_ignored_when_they_are_not() {
    assert_eq!(Frame::decode(&resealed(&run_command().encode(), &[(39, 1)])), Ok(Frame::Command(run_command())));
}

#[test]
fn one_frame_alone_must_be_alone() {
    let mut bytes = run_command().encode().to_vec();
    bytes.push(0);
    assert_eq!(Frame::decode(&bytes), Err(WireError::Trailing { frame: FrameType::Command, extra: 1 }));
    assert_eq!(Frame::decode(&[]), Err(WireError::Truncated { needed: 20, found: 0 }));
}

#[test]
fn a_reader_that_is_not_drained_says_so_instead_of_looking_closed() {
    let mut reader = FrameReader::new();
    let frame = run_command().encode();
    while reader.push(&frame) == frame.len() {}
    assert!(reader.space().is_empty());
    let error = reader.read_from(&mut Cursor::new(frame)).unwrap_err();
    assert_eq!(error.kind(), std::io::ErrorKind::StorageFull);
    while let Ok(Some(_)) = reader.next_frame() {}
    assert!(reader.space().len() >= 4032);
}

#[test]
fn a_peers_hello_is_judged() {
    let sound = Hello::new(1, 0, 5, "cRIO-9056");
    assert_eq!(sound.check(), Ok(()));
    assert_eq!(sound.name_text(), "cRIO-9056");
    assert_eq!(Hello { min_version: 1, max_version: 9, ..sound }.check(), Ok(()));
    let refused = [
        (Hello { min_version: 2, max_version: 3, ..sound }, ByeReason::Version, "the peer speaks 2 to 3"),
        (Hello { min_version: 0, max_version: 0, ..sound }, ByeReason::Version, "the peer speaks 0 to 0"),
        (Hello { session: 0, ..sound }, ByeReason::ProtocolError, "session 0"),
        (Hello { rate_millihertz: 100_000, ..sound }, ByeReason::ProtocolError, "100000 mHz"),
        (Hello { sensors: 1, ..sound }, ByeReason::ProtocolError, "1 sensors"),
        (Hello { valves: 0, ..sound }, ByeReason::ProtocolError, "0 valves"),
    ];
    for (hello, reason, says) in refused {
        let refusal: HelloRefusal = hello.check().unwrap_err();
        assert_eq!(refusal.bye_reason(), reason);
        assert!(refusal.to_string().contains(says), "{refusal}");
    }
    assert_eq!(Hello::new(1, 0, 1, "größer als sechzehn").name_text(), "gr??er als sechz");
    assert_eq!(Hello { name: [0xFF; 16], ..sound }.name_text(), "(unreadable)");
}
