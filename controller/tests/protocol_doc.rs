//! `docs/protocol.md` says what the wire is: its frames are decoded, and its cRIO in Python is controlled.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use proto::recording::read_mcap;
use proto::wire::{Frame, FrameReader, Mode};

mod process;
use process::{Folder, controller, finish};

fn docs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs")
}

#[test]
fn the_documented_bytes_are_frames_of_the_documented_content() {
    let text = std::fs::read_to_string(docs().join("protocol.md")).unwrap();
    let mut frames = Vec::new();
    for block in text.split("```hex\n").skip(1) {
        let hex = block.split("```").next().unwrap();
        let bytes: Vec<u8> = hex.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect();
        let mut reader = FrameReader::new();
        assert_eq!(reader.push(&bytes), bytes.len());
        let received = reader.next_frame().unwrap().expect("a whole frame");
        assert_eq!(received.frame.encode().as_bytes(), bytes, "encoded again");
        frames.push(received.frame);
    }
    let [Frame::Hello(hello), Frame::Sense(sense), Frame::Command(command), Frame::Bye(bye)] = frames.as_slice() else {
        panic!("{frames:?}");
    };
    hello.check().unwrap();
    let session = 0x1234_5678;
    assert_eq!([hello.session, sense.session, command.session, bye.session], [session; 4]);
    assert_eq!((sense.tick, sense.command_in_force, sense.volts[0], sense.pump_running), (7, 8, 1.36, true));
    assert_eq!((command.tick, command.duty, command.mode, command.ttl_ticks), (7, [0.75, 0.5], Mode::Run, 2));
    assert_eq!(crc32(b"123456789"), 0xCBF4_3926);
    assert!(text.contains("0xCBF43926"));
}

/// Bit by bit, from the polynomial in the standard.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg()))
    })
}

/// A child that is gone with its handle.
struct Stub(Child);

impl Drop for Stub {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn the_python_crio_is_controlled() {
    let python = Command::new("python3").arg("--version").stdout(Stdio::null()).status();
    if !python.is_ok_and(|status| status.success()) {
        println!("SKIPPED: no python3 here, so the stub of docs/protocol.md cannot run");
        return;
    }
    let mut command = Command::new("python3");
    command.arg(docs().join("examples/crio_stub.py")).args(["0", "--lockstep"]).stdout(Stdio::piped());
    let mut stub = Stub(command.spawn().unwrap());
    let mut line = String::new();
    BufReader::new(stub.0.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let port = line.trim().rsplit(' ').next().unwrap();
    let folder = Folder::new();
    let config = folder.write(
        "c.toml",
        format!(
            "[link]\naddress = \"127.0.0.1:{port}\"\npacing = \"lockstep\"\n[policy]\nactive = \"fallback\"\n[control]\n\
             socket = \"s\"\nauto_arm = true\n[record]\ndirectory = \"r\"\nmin_free_mib = 16\n[realtime]\nenforce = false\n"
        ),
    );
    let ended = finish(controller(&["run", "--seconds", "3", "--config"], &config).stdin(Stdio::null()));
    assert_eq!(ended.status, Some(0), "{ended:?}");
    let names = folder.names("r");
    assert_eq!(names.len(), 1, "{names:?}");
    let content = read_mcap(&folder.join("r").join(&names[0])).unwrap();
    let run: Vec<_> = content.ticks.iter().filter(|tick| tick.mode == Mode::Run.code()).collect();
    assert!(run.len() >= 25, "armed and running for half a second at least: {} ticks; {}", run.len(), ended.stderr);
    assert!(run.iter().any(|tick| tick.p_pos_kpa > 10.0), "its pressure rises");
}
