//! Transitions of recordings that are damaged, and of runs of which a part is missing.

use std::ops::Range;
use std::path::PathBuf;

use model::rig::Rig;
use proto::recording::{Attachment, RecordingInfo, RecordingWriter, unfinished_path};
use proto::reference::Reference;

use super::*;

/// Damage to a second of a recording that has these bytes.
type Damage = fn(&mut [u8]);

const ONE_BYTE: Damage = |second| second[second.len() / 2] ^= 0x40;
const ERASED: Damage = |second| second.fill(0);

/// A part of a run. The first reference is for 80 kPa, one that takes over in a second for as many more, and whatever took over in the
/// parts before stands in a part as well.
struct Part<'a> {
    part: u32,
    seconds: Range<u32>,
    /// Seconds of the run, those of the parts before included, in which a reference takes over.
    exchanging: &'a [u32],
    damaged: &'a [(u32, Damage)],
    /// Second from which on the session is another.
    connected_anew: Option<u32>,
    is_finished: bool,
}

impl Part<'_> {
    fn name(&self) -> String {
        format!("run-20261127-1210{:02}.mcap", self.seconds.start)
    }

    /// Writes it as the part behind one of this name, or with no part before it.
    fn write(&self, folder: &Path, previous: Option<&str>) {
        let file = |name: &str, text: String| Attachment {
            name: name.to_owned(),
            media_type: "text/plain".to_owned(),
            data: text.into_bytes(),
        };
        let reference =
            |second: u32| file(attached::REFERENCE, Reference::constant(80.0 + f64::from(second), -60.0).to_csv());
        let mut files = vec![file(attached::MODEL, Rig::builtin("dual_pressure").unwrap().to_toml().unwrap())];
        files.push(reference(0));
        let carried = self.exchanging.iter().filter(|second| self.part > 1 && **second < self.seconds.start);
        files.extend(carried.map(|second| reference(*second)));
        let path = folder.join(self.name());
        let mut info = RecordingInfo::new("test", 0);
        info.extra.insert("part".to_owned(), self.part.to_string());
        info.extra.extend(previous.map(|name| ("previous_file".to_owned(), name.to_owned())));
        let mut writer = RecordingWriter::create(&path, &info, &files).unwrap();
        let partial = unfinished_path(&path);
        let length = || std::fs::metadata(&partial).unwrap().len() as usize;
        let mut ticks_at = Vec::new();
        for second in self.seconds.clone() {
            if self.exchanging.contains(&second) {
                writer.attach(&reference(second)).unwrap();
            }
            let begin = length();
            let session = if self.connected_anew.is_some_and(|anew| second >= anew) { 8 } else { 7 };
            for tick in 50 * second..50 * second + 50 {
                let mut record = TickRecord { session, tick, ..TickRecord::default() };
                if tick == 50 * second + 20 && self.exchanging.contains(&second) {
                    TickInput::Reference.append(&mut record.inputs);
                }
                writer.write(&record).unwrap();
            }
            writer.flush().unwrap();
            ticks_at.push(begin..length());
        }
        let path = if self.is_finished { writer.finish().unwrap() } else { partial };
        let mut bytes = std::fs::read(&path).unwrap();
        for (second, damage) in self.damaged {
            damage(&mut bytes[ticks_at[(second - self.seconds.start) as usize].clone()]);
        }
        std::fs::write(&path, bytes).unwrap();
    }
}

/// A folder of its own, gone with the test.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("finetune-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        Folder(folder)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Tells whether the loop is still known behind these parts, and the ticks that were looked at: all at once, or as they come.
fn behind(name: &str, parts: &[Part<'_>]) -> (bool, u64) {
    let (growing, whole) = (Folder::new(&format!("{name}-growing")), Folder::new(&format!("{name}-whole")));
    let mut followed = Transitions::new(&growing.0, &TrainingSettings::default());
    let mut previous: Option<String> = None;
    for part in parts {
        let name = previous.replace(part.name()).filter(|_| part.part > 1);
        part.write(&growing.0, name.as_deref());
        part.write(&whole.0, name.as_deref());
        assert!(followed.next_transition().unwrap().is_none(), "nothing was controlled");
    }
    let mut read = Transitions::new(&whole.0, &TrainingSettings::default());
    assert!(read.next_transition().unwrap().is_none(), "nothing was controlled");
    let [of_followed, of_read] = [&followed, &read].map(|of| (of.model().is_some(), of.tally().ticks));
    assert_eq!(of_followed, of_read, "{name}: whenever it is read");
    of_read
}

/// Files inside count by their order: behind lost ticks nobody knows which of them takes over, and where some of them are lost as well
/// nothing waits for them.
#[test]
fn what_takes_over_behind_lost_ticks_is_not_guessed() {
    let with = |name: &str, damaged: &[(u32, Damage)]| {
        let run =
            Part { part: 1, seconds: 0..4, exchanging: &[1, 3], damaged, connected_anew: None, is_finished: false };
        behind(name, &[run])
    };
    assert_eq!(with("sound", &[]), (true, 200));
    assert_eq!(with("damaged", &[(1, ONE_BYTE)]), (false, 150));
    assert_eq!(with("erased", &[(1, ERASED)]), (false, 150));
}

/// A later part holds the files of those before, in the order in which they took over: what was lost in a part is lost for the next one.
#[test]
fn a_loss_counts_in_the_parts_behind_it() {
    let with = |name: &str, exchanging: &[u32], damaged: &[(u32, Damage)], is_finished: bool, next: u32| {
        let first = Part { part: 1, seconds: 0..3, exchanging, damaged, connected_anew: None, is_finished };
        let second = Part { part: next, seconds: 3..5, damaged: &[], is_finished: false, ..first };
        behind(name, &[first, second])
    };
    for (kind, damage) in [("damaged", ONE_BYTE), ("erased", ERASED)] {
        for is_finished in [true, false] {
            let name = |what: &str| format!("{what}-{kind}-{is_finished}");
            // At the end of the part, in its middle, and with an exchange in the part behind the loss already.
            assert_eq!(with(&name("end"), &[2, 4], &[(2, damage)], is_finished, 2), (false, 200));
            assert_eq!(with(&name("middle"), &[1, 4], &[(1, damage)], is_finished, 2), (false, 200));
            assert_eq!(with(&name("known"), &[1, 2], &[(1, damage)], is_finished, 2), (false, 200));
            // A daemon that begins anew begins with what it has then.
            assert_eq!(with(&name("anew"), &[2, 4], &[(2, damage)], is_finished, 1), (true, 200));
        }
    }
    assert_eq!(with("parts", &[2, 4], &[], true, 2), (true, 250));
}

/// A loss counts from its place on: one further on in what is read at once, or another session, is none.
#[test]
fn a_loss_counts_from_its_place_on() {
    let run = Part {
        part: 1,
        seconds: 0..5,
        exchanging: &[1, 2],
        damaged: &[(3, ONE_BYTE)],
        connected_anew: Some(1),
        is_finished: false,
    };
    assert_eq!(behind("later", &[run]), (true, 200));
    // Nothing says what was lost before the first tick.
    let run = Part {
        part: 1,
        seconds: 0..3,
        exchanging: &[2],
        damaged: &[(0, ONE_BYTE)],
        connected_anew: None,
        is_finished: true,
    };
    assert_eq!(behind("first", &[run]), (false, 100));
}

/// The rig under another name, by which it is known again.
fn model(name: &str) -> Attachment {
    let rig = Rig { name: name.to_owned(), ..Rig::builtin("dual_pressure").unwrap() };
    let data = rig.to_toml().unwrap().into_bytes();
    Attachment { name: attached::MODEL.to_owned(), media_type: "text/plain".to_owned(), data }
}

/// A part of 150 ticks with these states of the daemon, 50 each, in which a third model takes over in tick 120 of the part.
fn later_part(folder: &Path, number: u32, previous: &str, states: [u8; 3]) {
    let reference = Attachment {
        name: attached::REFERENCE.to_owned(),
        media_type: "text/plain".to_owned(),
        data: Reference::constant(80.0, -60.0).to_csv().into_bytes(),
    };
    let mut info = RecordingInfo::new("test", 0);
    info.extra.insert("part".to_owned(), number.to_string());
    info.extra.insert("previous_file".to_owned(), previous.to_owned());
    let path = folder.join("run-20261127-121500.mcap");
    let files = [model("first"), reference, model("second")];
    let mut writer = RecordingWriter::create(&path, &info, &files).unwrap();
    for k in 0..150_u32 {
        let state = states[k as usize / 50];
        let mut record = TickRecord { session: 7, tick: 1000 + k, state, ..TickRecord::default() };
        if k == 100 {
            writer.attach(&model("third")).unwrap();
        }
        if k == 120 {
            TickInput::Model.append(&mut record.inputs);
        }
        writer.write(&record).unwrap();
    }
    writer.finish().unwrap();
}

/// Reads all; the model in force, the ticks that no model explains, and what was said.
fn read_through(folder: &Path) -> (Option<String>, u64, Vec<String>) {
    let mut read = Transitions::new(folder, &TrainingSettings::default());
    while read.next_transition().unwrap().is_some() {}
    let unexplained = read.tally().left_out.get(LeftOut::LawDiffers.words()).copied().unwrap_or(0);
    (read.model().map(|rig| rig.name.clone()), unexplained, read.take_notes())
}

/// A second part whose first was removed begins with what had taken over in that one, and says that it is missing. Nobody knows where
/// reference and law stood until nothing controls.
#[test]
fn a_run_is_taken_up_in_a_later_part_and_the_missing_one_is_named() {
    const RUN: u8 = 1;
    let folder = Folder::new("orphan");
    later_part(&folder.0, 2, "run-20261127-121000.mcap", [RUN, 0, RUN]);
    let (model, unexplained, notes) = read_through(&folder.0);
    assert_eq!((model.as_deref(), unexplained), (Some("third"), 50), "{notes:?}");
    let said = "run-20261127-121500.mcap: part 2 of a run, and the part before it, run-20261127-121000.mcap, is not in the folder";
    assert!(notes.len() == 1 && notes[0].starts_with(said) && !notes[0].contains('\n'), "{notes:?}");
    // Where nothing stands by nothing is known.
    let folder = Folder::new("orphan-busy");
    later_part(&folder.0, 2, "run-20261127-121000.mcap", [RUN; 3]);
    assert_eq!(read_through(&folder.0).1, 150);
}

/// In a run whose middle part is missing the last one is no part that goes on, and what took over in the middle counts.
#[test]
fn a_part_behind_a_missing_one_is_taken_up_anew() {
    let folder = Folder::new("gap");
    let first = Part { part: 1, seconds: 0..2, exchanging: &[], damaged: &[], connected_anew: None, is_finished: true };
    first.write(&folder.0, None);
    later_part(&folder.0, 3, "run-20261127-121200.mcap", [0; 3]);
    let (model, unexplained, notes) = read_through(&folder.0);
    assert_eq!((model.as_deref(), unexplained), (Some("third"), 0));
    assert!(notes.len() == 1 && notes[0].contains("the part before it, run-20261127-121200.mcap, is not"), "{notes:?}");
    // The same part behind the one that it names goes on with that one's loop, in which no second model has taken over.
    let folder = Folder::new("whole");
    first.write(&folder.0, None);
    later_part(&folder.0, 2, &first.name(), [0; 3]);
    let (model, _, notes) = read_through(&folder.0);
    assert_eq!((model.as_deref(), notes.as_slice()), (Some("second"), [].as_slice()));
}
