//! Lines that a person reads on a terminal: sentences broken between words, at the terminal's width.
//!
//! A terminal breaks a long line in the middle of a word. Sentences are broken before that, each further line under the first one's
//! words; rows of tables, JSON and commands to paste stay lines. A file or a pipe gets every line whole: who looks for it in a log
//! finds it.

use std::borrow::Cow;
use std::io::IsTerminal;
use std::os::fd::AsFd;

/// Characters of a line on a terminal that does not say how wide it is.
const WIDTH: usize = 80;
/// The least width that sentences are broken to, however narrow a terminal is.
const LEAST_WIDTH: usize = 40;
/// Beginnings of commands to paste.
const COMMANDS: [&str; 4] = ["trainer ", "controller ", "cargo ", "sudo "];

/// A text for a stream, its sentences broken where the stream is a terminal.
pub fn for_stream<'t>(text: &'t str, stream: &(impl IsTerminal + AsFd)) -> Cow<'t, str> {
    if stream.is_terminal() { Cow::Owned(broken(text, width(stream))) } else { Cow::Borrowed(text) }
}

/// Characters of a line on a stream: of a terminal `COLUMNS` where somebody exports it, which shells do not, or else what the terminal
/// itself says; 80 where nothing is said, and in files and pipes.
pub fn width(stream: &(impl IsTerminal + AsFd)) -> usize {
    if !stream.is_terminal() {
        return WIDTH;
    }
    let exported = std::env::var("COLUMNS").ok().and_then(|columns| columns.parse().ok());
    exported.filter(|columns| *columns > 0).or_else(|| own_width(stream)).map_or(WIDTH, |width| width.max(LEAST_WIDTH))
}

/// Width that a terminal says it has; many behind a serial line say 0, which is none.
fn own_width(terminal: &impl AsFd) -> Option<usize> {
    let size = rustix::termios::tcgetwinsize(terminal).ok()?;
    Some(usize::from(size.ws_col)).filter(|columns| *columns > 0)
}

/// Sentences of a text broken between words to lines of `width` characters at most, what has columns or is a command as it is.
pub fn broken(text: &str, width: usize) -> String {
    text.split_inclusive('\n')
        .map(|line| if is_sentence(line, width) { broken_line(line, width) } else { line.to_owned() })
        .collect()
}

/// Tells whether a line is too long and no row of a table, no command and no object.
fn is_sentence(line: &str, width: usize) -> bool {
    let words = line.trim();
    // Behind a label (`report:    out/report.html`) there may be blanks.
    let rest = words.split_once(": ").map_or(words, |(_, rest)| rest).trim();
    line.trim_end().chars().count() > width
        && !COMMANDS.iter().any(|command| words.starts_with(command))
        && !words.starts_with(['{', '[', '"'])
        && !rest.contains("  ")
}

fn broken_line(line: &str, width: usize) -> String {
    let (line, end) = line.strip_suffix('\n').map_or((line, ""), |line| (line, "\n"));
    let words = line.trim_start();
    let before = line.len() - words.len();
    let under = before + if words.starts_with("- ") { 2 } else { 0 };
    let mut broken = " ".repeat(before);
    let mut at = before;
    for (n, word) in words.split(' ').enumerate() {
        let length = word.chars().count();
        if n > 0 && at > under && at + 1 + length > width {
            broken.push('\n');
            broken.push_str(&" ".repeat(under));
            at = under;
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

    #[test]
    fn a_file_has_no_width_of_its_own() {
        let file = std::fs::File::open("/dev/null").unwrap();
        assert_eq!((own_width(&file), width(&file)), (None, WIDTH));
    }

    #[test]
    fn further_lines_stand_under_the_first_ones_words() {
        assert_eq!(broken("  - one two three four\n", 12), "  - one two\n    three\n    four\n");
        assert_eq!(
            broken("            why: one two three", 20),
            "            why: one\n            two\n            three"
        );
        assert_eq!(broken("{\"a\": \"one two three four\"}", 12), "{\"a\": \"one two three four\"}");
        assert_eq!(broken("a_word_longer_than_the_line and", 12), "a_word_longer_than_the_line\nand");
    }
}
