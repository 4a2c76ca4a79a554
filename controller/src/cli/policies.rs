//! `controller policies`: what is known of each policy, for a terminal.

use policy_store::{Entry, EntryState};

use super::console::say;

/// Prints all policies, what controls first.
pub(super) fn print(entries: &[Entry]) {
    if entries.is_empty() {
        say(format_args!("no policies: put NAME.onnx into policy.directory"));
        return;
    }
    let mut sorted: Vec<&Entry> = entries.iter().collect();
    sorted.sort_by_key(|entry| (rank(entry.state), entry.name.clone()));
    let width = sorted.iter().map(|entry| entry.name.len()).max().unwrap_or(0).max(4);
    say(format_args!("{:width$}  state      sha256    trial: error, kPa   times what controlled", "name"));
    for entry in sorted {
        say(format_args!("{}", line(entry, width)));
    }
}

fn line(entry: &Entry, width: usize) -> String {
    let state = match entry.authority_percent {
        Some(percent) if entry.state == EntryState::Ramp => format!("ramp {percent:.0} %"),
        _ => entry.state.name().to_owned(),
    };
    let figures = entry.figures.map_or(String::new(), |f| {
        format!("{:.3} / {:.3}       {:.2} / {:.2}", f.rmse_kpa[0], f.rmse_kpa[1], f.ratio[0], f.ratio[1])
    });
    let row = format!("{:width$}  {state:9}  {:8.8}  {figures}", entry.name, entry.sha256);
    let mut text = row.trim_end().to_owned();
    if let Some(refusal) = &entry.refusal {
        text.push_str(&format!("\n{:width$}  why: {refusal}", ""));
    }
    if let Some(standing) = &entry.behind {
        text.push_str(&format!("\n{:width$}  behind the fallback on this model: {standing}", ""));
    }
    let told: Vec<String> = ["rig", "preset", "variant", "seed", "steps", "commit"]
        .iter()
        .filter_map(|key| entry.provenance.get(*key).map(|value| format!("{key} {value}")))
        .collect();
    if !told.is_empty() {
        text.push_str(&format!("\n{:width$}  from: {}", "", told.join(", ")));
    }
    text.trim_end().to_owned()
}

/// Rank in a list: what controls first, then what is on its way, then what could be, then what must not.
fn rank(state: EntryState) -> u8 {
    match state {
        EntryState::Active => 0,
        EntryState::Probation | EntryState::Recheck | EntryState::Retrial | EntryState::Ramp | EntryState::Shadow => 1,
        EntryState::Previous | EntryState::Passed => 2,
        EntryState::Checking => 3,
        EntryState::Refused => 4,
        EntryState::Gone => 5,
    }
}
