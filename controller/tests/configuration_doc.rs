//! `docs/configuration.md` says what the program does: its keys, defaults and ranges are compared with the program's.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use controller::config::Config;

const LINK: &str = "[link]\naddress = \"127.0.0.1:1\"\n";
const NAME: &str = "c.toml";

/// A row of the document.
#[derive(Debug)]
struct Row {
    table: String,
    key: String,
    default: String,
    range: String,
}

fn document() -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/configuration.md");
    std::fs::read_to_string(path).unwrap()
}

fn rows() -> Vec<Row> {
    let (mut table, mut rows) = (String::new(), Vec::new());
    for line in document().lines() {
        if let Some(heading) = line.strip_prefix("### `[") {
            table = heading.split(']').next().unwrap().to_owned();
        } else if line.starts_with('#') {
            table.clear();
        }
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        if !table.is_empty() && cells.len() == 7 && cells[1].starts_with('`') {
            let plain = |cell: &str| cell.trim_matches('`').to_owned();
            let [key, default] = [plain(cells[1]), plain(cells[3])];
            rows.push(Row { table: table.clone(), key, default, range: cells[4].to_owned() });
        }
    }
    rows
}

/// The program's own keys: an unknown one is answered with those that there are.
fn keys_of(table: &str) -> BTreeSet<String> {
    let text = if table == "link" { format!("{LINK}zz = 1\n") } else { format!("{LINK}[{table}]\nzz = 1\n") };
    let said = Config::parse(&text, Path::new(NAME)).unwrap_err().to_string();
    let (_, expected) = said.split_once("expected ").unwrap_or_else(|| panic!("{said}"));
    expected.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

fn with(table: &str, key: &str, value: &str) -> Result<Config, String> {
    let text = match (table, key) {
        ("link", "address") => format!("[link]\naddress = {value}\n"),
        ("link", _) => format!("{LINK}{key} = {value}\n"),
        _ => format!("{LINK}[{table}]\n{key} = {value}\n"),
    };
    Config::parse(&text, Path::new(NAME)).map_err(|e| e.to_string())
}

#[test]
fn every_key_is_documented_and_every_documented_key_exists() {
    let mut documented: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for row in rows() {
        documented.entry(row.table).or_default().insert(row.key);
    }
    let said = Config::parse(&format!("{LINK}[zz]\n"), Path::new(NAME)).unwrap_err().to_string();
    let (_, expected) = said.split_once("expected ").unwrap();
    let tables: BTreeSet<&str> = expected.split('`').skip(1).step_by(2).collect();
    assert_eq!(tables, documented.keys().map(String::as_str).collect(), "tables");
    for (table, keys) in &documented {
        assert_eq!(&keys_of(table), keys, "[{table}]");
    }
}

#[test]
fn the_documented_defaults_are_the_programs() {
    let defaults = Config::for_address("127.0.0.1:1");
    for Row { table, key, default, .. } in rows() {
        if ["needed", "none"].contains(&default.as_str()) {
            continue;
        }
        assert_eq!(with(&table, &key, &default).unwrap(), defaults, "{table}.{key} = {default}");
    }
}

#[test]
fn the_documented_ranges_are_the_programs() {
    let mut checked = 0;
    for Row { table, key, range, .. } in rows() {
        if let Some((low, high)) = range.split_once(" … ") {
            checked += 1;
            for end in [low, high] {
                with(&table, &key, end).unwrap_or_else(|e| panic!("{table}.{key} = {end}: {e}"));
            }
            let float = low.contains('.');
            let step = |text: &str, by: f64| {
                let value = text.parse::<f64>().unwrap() + by;
                if float { format!("{value:.1}") } else { format!("{value}") }
            };
            for beyond in [step(low, -1.0), step(high, 1.0)] {
                assert!(with(&table, &key, &beyond).is_err(), "{table}.{key} = {beyond} is accepted");
            }
        } else if range.starts_with('`') && range.contains(',') && !range.contains("letters") {
            checked += 1;
            for choice in range.split(", ") {
                with(&table, &key, choice.trim_matches('`')).unwrap_or_else(|e| panic!("{table}.{key}: {e}"));
            }
            assert!(with(&table, &key, "\"zz\"").is_err(), "{table}.{key}");
        }
    }
    // Eight ranges, two choices of words, three of true and false beside require_signature, which needs its key.
    assert!(checked >= 12, "{checked}");
}

#[test]
fn the_documented_example_is_sound() {
    let text = document();
    let example = text.split("```toml\n").nth(1).and_then(|rest| rest.split("```").next()).unwrap();
    Config::parse(example, Path::new(NAME)).unwrap();
}

/// The page lists all that the socket's answers may say.
#[test]
fn every_state_and_condition_of_an_answer_is_listed() {
    let page = document();
    for state in controller::state::State::ALL {
        let word = serde_json::to_string(&state).unwrap().replace('"', "`");
        assert!(page.contains(&word), "{word}");
        assert_eq!(word.trim_matches('`'), state.as_str());
    }
    for condition in controller::state::Condition::ALL {
        let word = serde_json::to_string(condition).unwrap().replace('"', "`");
        let row = format!("| {word} | {} | {:?} |", condition.code(), condition.severity());
        assert!(page.contains(&row), "{row}");
    }
}
