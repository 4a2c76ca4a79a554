//! Recordings that are not all of one rig: the whole answer.

#![allow(clippy::unwrap_used)] // What fails here fails the test.

mod made;

use diagnose::search::candidate::candidates;
use diagnose::{Diagnosis, Request, Verdict, run};
use made::two_chambers::{holds, recorded, rig};
use proto::diagnosis::RigKind;

fn diagnosed() -> Diagnosis {
    let (sound, mut leaking) = (rig(), rig());
    let all = candidates(&sound);
    let leak = all.iter().find(|c| c.id == "chamber_leak" && c.component == "a").unwrap();
    leaking.mechanisms.push(leak.attached(&[3e-16]));
    let drive = |seed| holds(1500, [0.1, 0.9], seed);
    let recordings = [(0, &sound), (1, &sound), (2, &leaking)]
        .map(|(n, of)| recorded(of, &format!("flights/run{n}.csv"), &drive(n), n));
    let out_dir = std::env::temp_dir().join(format!("diagnose-other-rig-{}", std::process::id()));
    let request = Request {
        rig: sound,
        rig_argument: "duo.toml".to_owned(),
        recordings: recordings.to_vec(),
        out_dir: out_dir.clone(),
        quick: true,
    };
    let found = run(&request, &mut |_, _| ()).unwrap();
    std::fs::remove_dir_all(&out_dir).unwrap();
    found
}

/// One of three recordings is of a rig that leaks: it is named, nothing is said to have changed in the others, the rig stays as it
/// was given, and the next step asks about that recording alone.
#[test]
fn a_recording_of_another_rig_is_named_and_spoils_no_other() {
    let found = diagnosed();
    assert_eq!((found.verdict, found.rig.kind), (Verdict::Adequate, RigKind::AsGiven), "{}", found.summary);
    let said = "The rig as given explains run0.csv and run1.csv down to their noise; run2.csv is off by";
    assert!(found.summary.starts_with(said), "{}", found.summary);
    assert!(found.changes.is_empty(), "{:?}", found.changes);
    let [command] = &found.next_step.commands[..] else { panic!("{:?}", found.next_step) };
    assert!(command.starts_with("trainer diagnose --rig duo.toml flights/run2.csv --out"), "{command}");
}
