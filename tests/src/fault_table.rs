//! The tables of `docs/safety.md` that say where each fault leads, as a test reads them.

use controller::state::State;

use crate::root;

/// Heading of the section on all faults but those that are a matter of time.
pub const EVERY_FAULT: &str = "## Every fault in every state";
/// Heading of the section on what comes late or not at all.
pub const WHAT_IS_LATE: &str = "## What is late, in every state";
/// States in which faults begin, in the order of the table's columns.
pub const BEGINNINGS: [State; 4] = [State::Standby, State::Run, State::Hold, State::Revert];

/// State to which a fault leads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// To a state.
    In(State),
    /// To the end of the program, with both vents open and a BYE.
    Stopped,
}

/// Way in which the daemon comes back once the fault is over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Return {
    /// By itself.
    ByItself,
    /// A person has to acknowledge.
    ByAPerson,
}

/// A row of the table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FaultRow {
    /// The problem.
    pub fault: String,
    /// For so many ticks.
    pub ticks: u32,
    /// State to which it leads, by the state in which it begins ([`BEGINNINGS`]).
    pub ends: [End; 4],
    /// Way back once it is over.
    pub afterwards: Return,
}

/// The rows of the section with this heading.
///
/// # Panics
/// If the document has no such table, or a cell of it makes no sense.
pub fn fault_rows(heading: &str) -> Vec<FaultRow> {
    let file = root().join("docs/safety.md");
    let text = std::fs::read_to_string(&file).expect("docs/safety.md");
    let section = text.split_once(heading).expect("the table's section").1;
    let section = section.split("\n## ").next().unwrap_or_default();
    section.lines().filter(|line| line.starts_with('|')).skip(2).map(row).collect()
}

fn row(line: &str) -> FaultRow {
    let cells: Vec<&str> = line.split('|').map(str::trim).collect();
    let [_, fault, ticks, standby, run, hold, revert, afterwards, _] = cells[..] else { panic!("{line}") };
    FaultRow {
        fault: fault.to_owned(),
        ticks: ticks.parse().unwrap_or_else(|e| panic!("{line}: {ticks}: {e}")),
        ends: [standby, run, hold, revert].map(|cell| end(cell).unwrap_or_else(|| panic!("{line}: {cell}"))),
        afterwards: match afterwards {
            "by itself" => Return::ByItself,
            "a person" => Return::ByAPerson,
            other => panic!("{line}: {other}"),
        },
    }
}

fn end(cell: &str) -> Option<End> {
    Some(End::In(match cell {
        "STANDBY" => State::Standby,
        "RUN" => State::Run,
        "HOLD" => State::Hold,
        "REVERT" => State::Revert,
        "VENT" => State::Vent,
        "FAULT" => State::Fault,
        "CONNECT" => State::Connect,
        "STOP" => return Some(End::Stopped),
        _ => return None,
    }))
}
