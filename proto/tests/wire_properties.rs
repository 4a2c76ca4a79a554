//! Properties of the codec and the frame reader over random frames, splits, damage and garbage.

// A test may stop at the first thing that is not as it must be; helpers here are part of tests.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use proptest::collection::vec;
use proptest::prelude::*;
use proto::wire::{
    Bye, ByeReason, Command, CrioState, Frame, FrameReader, Hello, Mode, Sense, TripBits, WireError, is_newer,
    sequence_distance,
};

fn hello() -> impl Strategy<Value = Frame> {
    (any::<[u32; 3]>(), any::<u64>(), any::<[u8; 4]>(), any::<[u8; 16]>()).prop_map(|(words, clock_ns, bytes, name)| {
        Frame::Hello(Hello {
            sequence: words[0],
            clock_ns,
            session: words[1],
            rate_millihertz: words[2],
            sensors: bytes[0],
            valves: bytes[1],
            min_version: bytes[2],
            max_version: bytes[3],
            name,
        })
    })
}

fn sense() -> impl Strategy<Value = Frame> {
    (any::<[u32; 4]>(), any::<u64>(), any::<[u32; 6]>(), 0_u8..4, any::<bool>(), any::<u8>(), any::<u16>()).prop_map(
        |(words, clock_ns, floats, state, pump_running, trips, commands_missed)| {
            // From raw bits, so that NaN payloads, infinities and subnormals come too.
            let floats = floats.map(f32::from_bits);
            Frame::Sense(Sense {
                sequence: words[0],
                clock_ns,
                session: words[1],
                tick: words[2],
                command_in_force: words[3],
                volts: [floats[0], floats[1], floats[2], floats[3]],
                duty: [floats[4], floats[5]],
                state: CrioState::from_code(state).unwrap(),
                pump_running,
                trips: TripBits::from_bits(trips),
                commands_missed,
            })
        },
    )
}

fn command() -> impl Strategy<Value = Frame> {
    (any::<[u32; 3]>(), any::<u64>(), any::<[u32; 2]>(), 0_u8..3, any::<u8>(), any::<u8>()).prop_map(
        |(words, clock_ns, duty, mode, ttl_ticks, digital_outputs)| {
            Frame::Command(Command {
                sequence: words[0],
                clock_ns,
                session: words[1],
                tick: words[2],
                duty: duty.map(f32::from_bits),
                mode: Mode::from_code(mode).unwrap(),
                ttl_ticks,
                digital_outputs,
            })
        },
    )
}

fn bye() -> impl Strategy<Value = Frame> {
    (any::<[u32; 2]>(), any::<u64>(), any::<u8>()).prop_map(|(words, clock_ns, reason)| {
        Frame::Bye(Bye { sequence: words[0], clock_ns, session: words[1], reason: ByeReason::from_code(reason) })
    })
}

fn frame() -> impl Strategy<Value = Frame> {
    prop_oneof![hello(), sense(), command(), bye()]
}

/// Every bit of a frame, as text: unlike `==`, equal for equal NaNs.
fn bits(frame: &Frame) -> Vec<u8> {
    frame.encode().as_bytes().to_vec()
}

/// Feeds a stream in pieces of the given sizes (used round and round) and drains after each.
fn feed(stream: &[u8], pieces: &[usize], mut each: impl FnMut(Result<Vec<u8>, WireError>)) -> FrameReader {
    let mut reader = FrameReader::new();
    let mut rest = stream;
    for piece in pieces.iter().cycle() {
        if rest.is_empty() {
            break;
        }
        let (now, later) = rest.split_at((*piece).min(rest.len()));
        rest = later;
        let taken = reader.push(now);
        assert_eq!(taken, now.len(), "a drained reader has room for the largest piece here");
        loop {
            match reader.next_frame() {
                Ok(Some(received)) => {
                    assert_eq!(received.raw.as_bytes(), bits(&received.frame), "raw bytes are not the frame's");
                    each(Ok(received.raw.as_bytes().to_vec()));
                }
                Ok(None) => break,
                Err(damage) => {
                    each(Err(damage.error));
                    if damage.is_fatal() {
                        return reader;
                    }
                }
            }
        }
    }
    reader
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 512, ..ProptestConfig::default() })]

    #[test]
    fn what_is_encoded_decodes_to_the_same_bits(frame in frame()) {
        let bytes = bits(&frame);
        prop_assert_eq!(bytes.len(), frame.kind().length());
        let decoded = Frame::decode(&bytes).unwrap();
        prop_assert_eq!(bits(&decoded), bytes);
        prop_assert_eq!(decoded.sequence(), frame.sequence());
        prop_assert_eq!(decoded.session(), frame.session());
    }

    #[test]
    fn frames_come_out_whole_however_the_stream_is_cut(
        frames in vec(frame(), 1..40),
        pieces in vec(1_usize..200, 1..20),
    ) {
        let stream: Vec<u8> = frames.iter().flat_map(bits).collect();
        let mut received = Vec::new();
        let reader = feed(&stream, &pieces, |frame| received.push(frame.unwrap()));
        prop_assert_eq!(received, frames.iter().map(bits).collect::<Vec<_>>());
        prop_assert_eq!(reader.waiting(), 0);
        prop_assert_eq!(reader.dropped(), 0);
    }

    #[test]
    fn a_damaged_body_costs_that_frame_and_no_other(
        frames in vec((frame(), proptest::option::of((8_usize..64, 0_u8..8))), 1..30),
        pieces in vec(1_usize..200, 1..20),
    ) {
        // Byte 8 on: from the sequence number to the CRC itself. A CRC-32 finds every single bit.
        let mut stream = Vec::new();
        let mut expected = Vec::new();
        for (frame, damage) in &frames {
            let mut bytes = bits(frame);
            match damage {
                Some((at, bit)) => {
                    let at = 8 + (at - 8) % (bytes.len() - 8);
                    bytes[at] ^= 1 << bit;
                    expected.push(None);
                }
                None => expected.push(Some(bytes.clone())),
            }
            stream.extend(bytes);
        }
        let mut received = Vec::new();
        let reader = feed(&stream, &pieces, |frame| received.push(match frame {
            Ok(bytes) => Some(bytes),
            Err(error) => { assert!(matches!(error, WireError::Crc { .. }), "{error}"); None }
        }));
        prop_assert_eq!(reader.dropped(), expected.iter().filter(|frame| frame.is_none()).count() as u64);
        prop_assert_eq!(received, expected);
    }

    #[test]
    fn a_wrong_first_eight_bytes_ends_the_stream_and_stays_an_end(
        before in vec(frame(), 0..5),
        broken in frame(),
        at in 0_usize..8,
        bit in 0_u8..8,
        after in vec(frame(), 0..5),
        pieces in vec(1_usize..200, 1..20),
    ) {
        let mut bytes = bits(&broken);
        bytes[at] ^= 1 << bit;
        let mut stream: Vec<u8> = before.iter().flat_map(bits).collect();
        stream.extend(bytes);
        stream.extend(after.iter().flat_map(bits));
        let mut received = Vec::new();
        let mut errors = Vec::new();
        let mut reader = feed(&stream, &pieces, |frame| match frame {
            Ok(bytes) => received.push(bytes),
            Err(error) => errors.push(error),
        });
        prop_assert_eq!(received, before.iter().map(bits).collect::<Vec<_>>());
        prop_assert_eq!(errors.len(), 1);
        prop_assert!(errors[0].is_fatal());
        prop_assert_eq!(matches!(errors[0], WireError::Magic { .. }), at < 4);
        prop_assert_eq!(matches!(errors[0], WireError::Version { .. }), at == 4);
        // A flipped type bit gives an unknown type, or another type whose length does not fit.
        prop_assert_eq!(matches!(errors[0], WireError::Type { .. } | WireError::Length { .. }), at >= 5);
        // Sound frames behind it change nothing until the reader is reset for a new link.
        let sound = Hello::new(1, 0, 1, "x").encode();
        reader.push(&sound);
        prop_assert_eq!(reader.next_frame().unwrap_err().error, errors[0]);
        reader.reset();
        reader.push(&sound);
        prop_assert!(matches!(reader.next_frame(), Ok(Some(_))));
    }

    #[test]
    fn garbage_is_an_error_and_never_a_panic(bytes in vec(any::<u8>(), 0..300), pieces in vec(1_usize..50, 1..9)) {
        // A random 300 bytes hold a frame with a right CRC less than once in 2^64 tries.
        prop_assert!(Frame::decode(&bytes).is_err());
        let mut frames = 0;
        feed(&bytes, &pieces, |frame| frames += usize::from(frame.is_ok()));
        prop_assert_eq!(frames, 0);
    }

    #[test]
    fn every_truncation_says_how_much_is_missing(frame in frame(), cut in 0_usize..64) {
        let bytes = bits(&frame);
        let cut = cut % bytes.len();
        let needed = if cut < 8 { 20 } else { bytes.len() };
        prop_assert_eq!(Frame::decode(&bytes[..cut]), Err(WireError::Truncated { needed, found: cut }));
    }

    #[test]
    fn newer_is_never_both_ways_and_agrees_with_steps(from in 1_u32.., steps in 1_u32..0x7FFF_FFFF) {
        // Steps counted the slow way round the ring: u64 sums, minus one lap of 2^32 - 1.
        let sum = u64::from(from) + u64::from(steps);
        let to = u32::try_from(if sum > 0xFFFF_FFFF { sum - 0xFFFF_FFFF } else { sum }).unwrap();
        prop_assert!(is_newer(to, from));
        prop_assert!(!is_newer(from, to));
        prop_assert_eq!(sequence_distance(from, to), Some(steps));
    }
}

/// Every single bit of one frame of each type, flipped: none gets through.
#[test]
fn no_single_bit_gets_through() {
    let frames = [
        Frame::Hello(Hello::new(1, 2, 3, "daemon")).encode(),
        Frame::Bye(Bye { sequence: 1, clock_ns: 2, session: 3, reason: ByeReason::Normal }).encode(),
        Frame::Command(Command {
            sequence: 1,
            clock_ns: 2,
            session: 3,
            tick: 4,
            duty: [0.5, 0.25],
            mode: Mode::Run,
            ttl_ticks: 2,
            digital_outputs: 1,
        })
        .encode(),
        Frame::Sense(Sense {
            sequence: 1,
            clock_ns: 2,
            session: 3,
            tick: 4,
            command_in_force: 5,
            volts: [1.0, 2.0, 3.0, 4.0],
            duty: [0.5, 0.25],
            state: CrioState::Running,
            pump_running: true,
            trips: TripBits::NONE,
            commands_missed: 6,
        })
        .encode(),
    ];
    for raw in frames {
        for at in 0..raw.as_bytes().len() {
            for bit in 0..8 {
                let mut bytes = raw.as_bytes().to_vec();
                bytes[at] ^= 1 << bit;
                assert!(Frame::decode(&bytes).is_err(), "byte {at} bit {bit} of {raw:?} got through");
            }
        }
    }
}
