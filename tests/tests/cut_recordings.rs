//! Recordings that are not whole: what is lost of them is said by whoever replays them, and is no success.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::path::{Path, PathBuf};
use std::process::Command;

use proto::recording::{LogTime, RecordingInfo, RecordingWriter, read_mcap};
use serde_json::Value;
use tests::{Folder, RunStatus, finish, program};

/// Ticks of the first chunk, and of those that follow.
const FIRST: usize = 100;

/// A run of some seconds in chunks: the recording's bytes.
fn recorded(folder: &Folder) -> Vec<u8> {
    let mut command = Command::new(program("controller"));
    command.args(["demo", "--fast", "--seconds", "6", "--policy", "fallback", "--out"]).arg(folder.join("out"));
    let ended = finish(&mut command);
    let content = read_mcap(&folder.join("out/flight.mcap")).unwrap_or_else(|e| panic!("{e}: {ended:?}"));
    let mut info = RecordingInfo::new("test", 0);
    info.extra = content.metadata.clone();
    info.log_time = LogTime::Tick;
    let file = folder.join("chunks.mcap");
    let mut writer = RecordingWriter::create(&file, &info, &content.attachments).unwrap();
    for (index, tick) in content.ticks.iter().enumerate() {
        if index > 0 && index % FIRST == 0 {
            writer.flush().unwrap();
        }
        writer.write(tick).unwrap();
    }
    writer.finish().unwrap();
    std::fs::read(file).unwrap()
}

fn replay(file: &Path) -> RunStatus {
    finish(Command::new(program("controller")).args(["replay", "--json"]).arg(file))
}

fn found(ended: &RunStatus) -> Value {
    serde_json::from_str(&ended.stdout).unwrap_or_else(|e| panic!("{e}: {ended:?}"))
}

/// Where the bodies of chunks lie in the file; the first has the channels, the second the first ticks.
fn chunks(bytes: &[u8]) -> Vec<std::ops::Range<usize>> {
    const MAGIC: usize = 8;
    const CHUNK: u8 = 6;
    let (mut found, mut at) = (Vec::new(), MAGIC);
    while let Some(length) = bytes.get(at + 1..at + 9) {
        let body = at + 9..at + 9 + u64::from_le_bytes(length.try_into().unwrap()) as usize;
        if bytes[at] == CHUNK {
            found.push(body.clone());
        }
        at = body.end;
    }
    found
}

#[test]
fn a_recording_that_is_cut_or_damaged_is_not_replayed_as_if_it_were_whole() {
    let folder = Folder::new();
    let whole = recorded(&folder);
    let write = |name: &str, bytes: &[u8]| -> PathBuf { folder.write(name, bytes) };
    let sound = replay(&write("sound.mcap", &whole));
    assert_eq!((sound.status, &found(&sound)["ended_early"]), (Some(0), &Value::Null), "{sound:?}");

    let chunks = chunks(&whole);
    assert!(chunks.len() >= 3, "{chunks:?}");
    // Cut in the last chunk but one.
    let cut = replay(&write("cut.mcap", &whole[..chunks[chunks.len() - 2].end - 100]));
    let told = found(&cut);
    assert_eq!((cut.status, &told["ticks_differing"]), (Some(1), &0.into()), "{cut:?}");
    assert!(told["ended_early"].as_str().unwrap().contains("cut short"), "{told}");
    assert!(cut.stderr.contains("not all was compared") && cut.stderr.contains("cut.mcap: cut short"), "{cut:?}");
    assert!(told["ticks"].as_u64().unwrap() < found(&sound)["ticks"].as_u64().unwrap(), "{told}");

    let damaged = |name: &str, chunk: usize| {
        let mut bytes = whole.clone();
        let middle = (chunks[chunk].start + chunks[chunk].end) / 2;
        bytes[middle] ^= 0xff;
        replay(&write(name, &bytes))
    };
    // Behind it nothing can be compared: what the law remembers is lost.
    let within = damaged("within.mcap", 2);
    assert_eq!((within.status, &found(&within)["ticks_differing"]), (Some(1), &0.into()), "{within:?}");
    assert_eq!(found(&within)["ticks"].as_u64(), Some(FIRST as u64));
    assert!(within.stderr.contains("damaged") && within.stderr.contains("are lost"), "{within:?}");
    // Without its beginning none can be replayed, and no other recording would help.
    let first = damaged("first.mcap", 1);
    assert_eq!(first.status, Some(2), "{first:?}");
    assert!(first.stderr.contains("first.mcap: a chunk is damaged") && first.stderr.contains("beginning"), "{first:?}");
    assert!(!first.stderr.contains("give the recording before it"), "{first:?}");
}

/// A part without ticks, as where the disk was full when it was begun: the whole ones are replayed, and it is named. A file without a byte
/// is no recording at all, and nobody can say what it was to hold.
#[test]
fn an_empty_file_beside_whole_recordings_is_named() {
    let folder = Folder::new();
    let whole = recorded(&folder);
    let sound = folder.write("sound.mcap", &whole);
    // Up to the beginning of its first chunk: the head alone.
    let head = folder.write("head.mcap", &whole[..chunks(&whole)[0].start - 9]);
    let both = |one: &Path, other: &Path| {
        finish(Command::new(program("controller")).args(["replay", "--json"]).arg(one).arg(other))
    };
    let alone = found(&replay(&sound));
    for (one, other) in [(&sound, &head), (&head, &sound)] {
        let ended = both(one, other);
        let told = found(&ended);
        assert_eq!((ended.status, &told["ticks"]), (Some(1), &alone["ticks"]), "{ended:?}");
        assert_eq!(told["ticks_differing"], 0, "{ended:?}");
        assert!(ended.stderr.contains("not all was compared") && ended.stderr.contains("head.mcap"), "{ended:?}");
    }
    let nothing = folder.write("nothing.mcap", b"");
    for (one, other) in [(&sound, &nothing), (&nothing, &sound)] {
        let ended = both(one, other);
        assert_eq!(ended.status, Some(2), "{ended:?}");
        assert!(ended.stderr.contains("nothing.mcap: the file is empty"), "{ended:?}");
    }
    let two_heads = both(&head, &folder.write("head-2.mcap", &whole[..chunks(&whole)[0].start - 9]));
    assert_eq!(two_heads.status, Some(2), "none of them holds a tick: {two_heads:?}");
}

/// One wrong byte in a file inside costs the ticks nothing; a replay needs some of these files.
#[test]
fn a_damaged_file_inside_is_named_and_the_ticks_are_read() {
    let folder = Folder::new();
    let whole = recorded(&folder);
    let damaged = |name: &str| {
        let mut bytes = whole.clone();
        // Its record begins with its name, behind the length of that.
        let stored = [&(name.len() as u32).to_le_bytes()[..], name.as_bytes()].concat();
        let at = bytes.windows(stored.len()).position(|window| window == stored).unwrap();
        bytes[at + stored.len() + 60] ^= 1;
        folder.write(&format!("{name}.mcap"), &bytes)
    };
    let needed = damaged("controller-effective.toml");
    let refused = replay(&needed);
    let said = "controller-effective.toml inside is damaged, and without it nothing of the run can be replayed";
    assert!(refused.status == Some(2) && refused.stderr.contains(said), "{refused:?}");
    let exported = finish(Command::new(program("controller")).args(["export", "--csv"]).arg(&needed));
    let told = exported.stderr.contains("the attachment controller-effective.toml is damaged");
    assert!(exported.status == Some(0) && told, "{exported:?}");
    // The rig behind the emulated cRIO takes no part in what is decided.
    let other = replay(&damaged("emulated_rig.toml"));
    assert_eq!((other.status, &found(&other)["ended_early"]), (Some(0), &Value::Null), "{other:?}");
    assert!(other.stderr.contains("the attachment emulated_rig.toml is damaged"), "{other:?}");
}

/// A recording in real time, in which some frames were missed and came late, or were overtaken: such ticks are in no other way
/// damaged, and all that is whole of a file that was cut is compared.
#[test]
fn a_missed_frame_of_a_cut_recording_is_no_damage() {
    let folder = Folder::new();
    let faults = folder
        .write("late.toml", b"[[fault]]\nkind = \"delay\"\nframe = \"sense\"\nby_ms = 15\nfirst = 40\nevery = 20\n");
    let mut command = Command::new(program("controller"));
    command.args(["demo", "--seconds", "4", "--policy", "fallback", "--faults"]).arg(faults);
    finish(command.arg("--out").arg(folder.join("out")));
    let whole = std::fs::read(folder.join("out/flight.mcap")).unwrap();
    let file = folder.write("cut.mcap", &whole[..whole.len() * 3 / 4]);
    let ticks = read_mcap(&file).unwrap().ticks;
    assert!(ticks.iter().any(|tick| !tick.sense_present), "a frame was missed");
    assert!(
        ticks.windows(2).any(|pair| pair[0].tick.wrapping_add(1) != pair[1].tick),
        "and numbers are out of their order"
    );
    let ended = replay(&file);
    let told = found(&ended);
    assert_eq!(
        (ended.status, &told["ticks"], &told["ticks_differing"]),
        (Some(1), &ticks.len().into(), &0.into()),
        "{ended:?}"
    );
    assert!(told["ended_early"].as_str().unwrap().contains("cut short"), "{told}");
}
