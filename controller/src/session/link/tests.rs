//! Messages to whoever writes a cRIO about the first mistakes, over a real socket.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::time::Duration;

use monitor::Pacing;
use proto::wire::{CRC_LENGTH, CrioState, Frame, HELLO_LENGTH, Hello, Sense, TripBits};
use socket2::SockRef;

use super::Link;

/// The cRIO's end of the connection that comes next, and the daemon's HELLO.
pub(super) fn greeted(listener: &TcpListener) -> (TcpStream, Hello) {
    let (mut stream, _) = listener.accept().unwrap();
    let mut bytes = [0; HELLO_LENGTH];
    stream.read_exact(&mut bytes).unwrap();
    let Ok(Frame::Hello(hello)) = Frame::decode(&bytes) else { panic!("no HELLO: {bytes:?}") };
    (stream, hello)
}

/// Message about a cRIO that answers the daemon's HELLO with these bytes, and then waits or closes.
fn said(answer: fn(Hello) -> Vec<u8>, then: Then) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let at = listener.local_addr().unwrap();
    let crio = std::thread::spawn(move || {
        let (mut stream, hello) = greeted(&listener);
        stream.write_all(&answer(hello)).unwrap();
        if then == Then::Waits {
            // Until the daemon has given up.
            let _ = stream.read(&mut [0]);
        }
        if then == Then::Resets {
            // A reset that overtakes the bytes takes them along.
            std::thread::sleep(Duration::from_millis(200));
            SockRef::from(&stream).set_linger(Some(Duration::ZERO)).unwrap();
        }
    });
    let address = at.to_string();
    let said = Link::open(&address, &[at], Pacing::RealTime).err().map(|error| error.to_string());
    crio.join().unwrap();
    let said = said.expect("no session");
    assert!(said.starts_with(&address) && !said.contains('\n'), "{said}");
    said
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Then {
    Waits,
    Closes,
    /// Breaks the link off once what it sent has been read.
    Resets,
}

fn with_wrong_crc(hello: Hello) -> Vec<u8> {
    let mut bytes = hello.encode().to_vec();
    bytes[HELLO_LENGTH - 1] ^= 1;
    bytes
}

/// The one of docs/protocol.md, with CRC E3D2C54D: whose session it is shows only once its CRC fits.
fn with_swapped_crc(_: Hello) -> Vec<u8> {
    let mut bytes = Hello::new(1, 1_000_000_000, 0x1234_5678, "controller").encode().to_vec();
    bytes[HELLO_LENGTH - CRC_LENGTH..].reverse();
    bytes
}

fn without_crc(hello: Hello) -> Vec<u8> {
    hello.encode()[..HELLO_LENGTH - CRC_LENGTH].to_vec()
}

fn reading(hello: Hello) -> Vec<u8> {
    let sense = Sense {
        sequence: 1,
        clock_ns: 0,
        session: hello.session,
        tick: 0,
        command_in_force: 0,
        volts: [1.0, 4.0, f32::NAN, f32::NAN],
        duty: [1.0; 2],
        state: CrioState::Idle,
        pump_running: false,
        trips: TripBits::NONE,
        commands_missed: 0,
    };
    sense.encode().to_vec()
}

/// A cRIO that sends a reading too early and then breaks the link off: the break is told.
#[test]
fn an_error_of_the_system_outranks_what_came_early() {
    let broken_off = said(reading, Then::Resets);
    assert!(!broken_off.contains("came before it") && broken_off.contains("reset"), "{broken_off}");
    let damaged = said(with_wrong_crc, Then::Resets);
    assert!(damaged.contains("the CRC of a HELLO that came does not fit its bytes"), "{damaged}");
}

#[test]
fn what_came_instead_of_a_hello_is_told() {
    for then in [Then::Waits, Then::Closes] {
        let wrong = said(with_wrong_crc, then);
        assert!(wrong.contains("the CRC of a HELLO that came does not fit its bytes"), "{wrong}");
        assert!(!wrong.contains("another program"), "{wrong}");
        let swapped = said(with_swapped_crc, then);
        assert!(swapped.contains("the CRC of a HELLO that came has its four bytes in reverse"), "{swapped}");
        let early = said(reading, then);
        assert!(early.contains("a SENSE came before it"), "{early}");
        let short = said(without_crc, then);
        assert!(short.contains("48 bytes came and then no more"), "{short}");
    }
    assert!(said(|_| Vec::new(), Then::Waits).contains("no HELLO came back within 1 s; is another program"));
    assert!(said(|_| Vec::new(), Then::Closes).contains("the link broke during the handshake"));
}

/// A trouble is told once because it has the same words each time.
#[test]
fn the_same_mistake_has_the_same_words_each_time() {
    let words = || said(with_wrong_crc, Then::Closes).split_once(": connected").map(|(_, words)| words.to_owned());
    let first = words();
    assert!(first.is_some());
    assert_eq!(words(), first);
}
