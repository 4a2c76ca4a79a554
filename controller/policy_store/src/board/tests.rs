//! Tests of the board: names, rows and who is in command.

use super::*;

fn entry(name: &str, tag: u64) -> Entry {
    Entry { state: EntryState::Passed, sha256: format!("{tag:016x}{:048}", 0), ..Entry::checking(name) }
}

fn board(names: &[(&str, u64)]) -> Board {
    let entries = names.iter().map(|(name, tag)| ((*name).to_owned(), entry(name, *tag))).collect();
    Board { entries, ..Board::default() }
}

fn told(event: PolicyEvent, snapshot: Snapshot) -> Told {
    Told { event, answers: None, snapshot }
}

fn rows(board: &Board) -> Vec<(String, EntryState)> {
    board.list().into_iter().map(|entry| (entry.name, entry.state)).collect()
}

fn row(name: &str, state: EntryState) -> (String, EntryState) {
    (name.to_owned(), state)
}

const TAG: PolicyTag = PolicyTag(7);

#[test]
fn a_policy_of_several_names_is_called_as_it_was_asked_for_and_all_of_them_say_where_it_stands() {
    use EntryState::{Active, Passed, Refused, Shadow};
    let mut board = board(&[("UPPER", 7), ("a.onnx", 7), ("hard", 7), ("other", 8)]);
    board.call(TAG, "hard");
    let shadow = Snapshot { candidate: Some(TAG), told: 1, ..Snapshot::default() };
    let changes = board.happened(&told(PolicyEvent::Taken(TAG), shadow));
    assert_eq!((changes.len(), changes[0].name.as_str(), changes[0].what), (1, "hard", "in shadow"));
    let expected = [("UPPER", Shadow), ("a.onnx", Shadow), ("fallback", Active), ("hard", Shadow), ("other", Passed)];
    assert_eq!(rows(&board), expected.map(|(name, state)| row(name, state)));
    // What must not fly must not under another name either.
    let alone = Snapshot { told: 2, ..Snapshot::default() };
    let changes = board.happened(&told(PolicyEvent::Lost(TAG, 0, Loss::NotFinite), alone));
    let named: Vec<&str> = changes.iter().map(|change| change.name.as_str()).collect();
    assert_eq!(named, ["UPPER", "a.onnx", "hard"]);
    assert_eq!(board.entry("a.onnx").unwrap().state, Refused);
}

#[test]
fn what_the_rig_needs_is_in_a_row_whatever_becomes_of_its_file() {
    use EntryState::{Active, Checking, Gone, Shadow};
    let mut board = board(&[("a", 7)]);
    // Asked for, and not taken by a tick yet: other content takes its name.
    board.given(1, Asked::Try(TAG));
    board.call(TAG, "a");
    board.checking("a");
    let kept = "a@00000000";
    assert_eq!(rows(&board), [row("a", Checking), row(kept, Gone), row("fallback", Active)]);
    let shadow = Snapshot { candidate: Some(TAG), told: 1, served: 1, ..Snapshot::default() };
    let changes = board.happened(&told(PolicyEvent::Taken(TAG), shadow));
    assert_eq!(changes[0].name, kept);
    // The same content under another name, being checked.
    board.checking("b");
    let expected = [("a", Checking), (kept, Shadow), ("b", Checking), ("fallback", Active)];
    assert_eq!(rows(&board), expected.map(|(name, state)| row(name, state)));
    board.gone("b");
    board.gone(kept);
    assert_eq!(rows(&board), [row("a", Checking), row(kept, Shadow), row("fallback", Active)]);
    board.show(Snapshot { told: 1, served: 1, stage_ticks: 1, ..Snapshot::default() });
    assert_eq!(board.entry(kept).unwrap().state, Gone, "it may still be asked for");
}

/// In the tick in which the fallback has come to all of the command it is named, before it counts as active.
#[test]
fn what_has_all_of_the_command_is_named() {
    use EntryState::{Active, Previous, Probation};
    let mut board = Board::default();
    board.begin(entry("default", 7), None);
    assert_eq!(board.in_command().0, "default");
    let fallback = Some(PolicyTag::FALLBACK);
    let stage = StageNow::Probation.code();
    let probation = Snapshot { incumbent: TAG, candidate: fallback, stage, told: 1, ..Snapshot::default() };
    board.happened(&told(PolicyEvent::Taken(PolicyTag::FALLBACK), probation));
    assert_eq!(board.in_command().0, "default", "it has none of it yet");
    board.show(Snapshot { authority: 1.0, ..probation });
    assert_eq!(board.in_command(), ("fallback".to_owned(), String::new()));
    assert_eq!(rows(&board), [row("default", Active), row("fallback", Probation)]);
    board.show(Snapshot { before: Some(TAG), told: 2, ..Snapshot::default() });
    assert_eq!(rows(&board), [row("default", Previous), row("fallback", Active)]);
}

/// An operator has taken it back, and its file is seen anew: it was on the rig, whatever its entry says.
#[test]
fn what_was_on_the_rig_is_remembered_although_its_file_was_away() {
    let mut board = board(&[("a", 7), ("b", 8)]);
    board.begin(entry("default", 9), None);
    let shadow = Snapshot { candidate: Some(TAG), told: 1, ..Snapshot::default() };
    board.happened(&told(PolicyEvent::Taken(TAG), shadow));
    board.happened(&told(PolicyEvent::Lost(TAG, 0, Loss::Withdrawn), Snapshot { told: 2, ..Snapshot::default() }));
    board.gone("a");
    board.checking("a");
    assert_eq!([7, 8, 9].map(|tag| board.was_tried(PolicyTag(tag))), [true, false, true]);
}
