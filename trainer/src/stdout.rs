//! Standard output: text for people or one JSON object, in one write each.
//!
//! A reader that has seen enough (`| head`) closes the pipe; that is no failure of the command. On a terminal sentences are broken
//! between words; tables and commands to paste stay lines.

use std::io::{self, IsTerminal, Write};

use crate::failure::Failure;

/// Characters of a line of sentences on a terminal that does not say how wide it is.
const WIDTH: usize = 80;
/// Blanks before a command to paste.
const COMMAND_INDENT: usize = 8;

/// Writes sentences and tables, with a line end, and flushes them.
///
/// # Errors
/// Standard output cannot be written, other than because its reader has gone.
pub(crate) fn say(text: &str) -> Result<(), Failure> {
    if io::stdout().is_terminal() { put(&broken(text, terminal_width())) } else { put(text) }
}

/// Writes one JSON object.
///
/// # Errors
/// As [`say`].
pub(crate) fn say_json(value: &serde_json::Value) -> Result<(), Failure> {
    put(&format!("{value:#}"))
}

/// Writes text as it is, with a line end, and flushes it.
///
/// # Errors
/// As [`say`].
pub(crate) fn put(text: &str) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    let end = if text.ends_with('\n') { "" } else { "\n" };
    match out.write_all(format!("{text}{end}").as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(Failure::Stdout(error)),
        _ => Ok(()),
    }
}

/// `COLUMNS` where the shell hands it on.
fn terminal_width() -> usize {
    let columns = std::env::var("COLUMNS").ok().and_then(|columns| columns.parse().ok());
    columns.filter(|columns| *columns >= 40).unwrap_or(WIDTH)
}

/// Sentences broken between words, each further line under the first; what has columns or is a command as it is.
fn broken(text: &str, width: usize) -> String {
    text.split_inclusive('\n')
        .map(|line| if is_sentence(line, width) { broken_line(line, width) } else { line.to_owned() })
        .collect()
}

/// Whether a line is too long and no row of a table, no command and no object.
fn is_sentence(line: &str, width: usize) -> bool {
    let indent = line.chars().take_while(|c| *c == ' ').count();
    let label = line.find(": ").map_or(indent, |at| at + 1);
    let rest = line.get(label..).unwrap_or_default().trim();
    line.trim_end().chars().count() > width && indent < COMMAND_INDENT && !rest.contains("  ")
}

fn broken_line(line: &str, width: usize) -> String {
    let (line, end) = line.strip_suffix('\n').map_or((line, ""), |line| (line, "\n"));
    let mut broken = String::with_capacity(line.len() + 8);
    let mut at = 0;
    for (n, word) in line.split(' ').enumerate() {
        let length = word.chars().count();
        if n > 0 && at > 0 && at + 1 + length > width {
            broken.push('\n');
            at = 0;
        } else if n > 0 {
            broken.push(' ');
            at += 1;
        }
        broken.push_str(word);
        at += length;
    }
    broken + end
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sentences_are_broken_between_words_and_tables_and_commands_are_not() {
        let text = "undecided: one two three four five six seven\n\nrow  1.000   2.000   3.000   4.000   5.000\n        trainer \
                    diagnose --rig a_long_name.toml\nshort\n";
        let said = broken(text, 20);
        let lines: Vec<&str> = said.lines().collect();
        assert_eq!(lines[..3], ["undecided: one two", "three four five six", "seven"]);
        assert_eq!(
            lines[3..],
            [
                "",
                "row  1.000   2.000   3.000   4.000   5.000",
                "        trainer diagnose --rig a_long_name.toml",
                "short"
            ]
        );
        assert_eq!(said.split_whitespace().collect::<Vec<_>>(), text.split_whitespace().collect::<Vec<_>>());
    }
}
