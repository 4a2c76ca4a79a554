//! From TOML text to a checked rig, with line numbers in the errors.

use toml::de::{DeTable, DeValue};

use super::error::RigError;
use super::schema::Rig;

impl Rig {
    /// Reads a rig from TOML text and checks it.
    ///
    /// # Errors
    /// The first thing that is wrong, with its line: bad TOML, an unknown or missing key, a number
    /// outside the range of its unit, a join that leads nowhere.
    pub fn from_toml(text: &str) -> Result<Rig, RigError> {
        let rig: Rig = toml::from_str(text).map_err(|error| parse_error(text, &error))?;
        rig.check().map_err(|error| located(text, error))?;
        Ok(rig)
    }
}

/// Rewrites TOML's picture of an error as one line.
fn parse_error(text: &str, error: &toml::de::Error) -> RigError {
    let message = error.message().replace('\n', "; ");
    // Errors inside tagged components carry the span of the component at best; the offending word is
    // quoted in the message, so the line that holds it is the better answer.
    let quoted = message.split('`').nth(1).unwrap_or_default();
    let from = error.span().map_or(0, |span| span.start);
    let word_at = |start: usize| {
        let rest = text.get(start..)?;
        let found = rest.match_indices(quoted).find(|(at, _)| {
            !quoted.is_empty()
                && rest.get(..*at).is_none_or(|before| !is_comment(before))
                && is_word(rest, *at, quoted.len())
        })?;
        Some(start + found.0)
    };
    let unknown = message.starts_with("unknown");
    let at = if unknown { word_at(from).or_else(|| word_at(0)).unwrap_or(from) } else { from };
    let key = section_at(text, at);
    RigError { line: Some(line_of(text, at)), key, problem: message }
}

/// Whether the text ends inside a comment.
fn is_comment(before: &str) -> bool {
    before.rsplit('\n').next().is_some_and(|line| line.contains('#'))
}

/// Whether the `len` bytes at `at` stand alone as a word.
fn is_word(text: &str, at: usize, len: usize) -> bool {
    let part_of_word = |c: char| c.is_alphanumeric() || c == '_';
    let before = text.get(..at).and_then(|t| t.chars().next_back());
    let after = text.get(at + len..).and_then(|t| t.chars().next());
    !before.is_some_and(part_of_word) && !after.is_some_and(part_of_word)
}

/// The header of the table that the byte at `at` lies in, without brackets.
fn section_at(text: &str, at: usize) -> String {
    let end = text.get(at..).and_then(|rest| rest.find('\n')).map_or(text.len(), |n| at + n);
    text.get(..end)
        .unwrap_or(text)
        .lines()
        .rev()
        .find(|line| line.trim_start().starts_with('['))
        .and_then(|line| line.trim().trim_start_matches('[').split(']').next())
        .unwrap_or_default()
        .to_owned()
}

fn line_of(text: &str, at: usize) -> usize {
    1 + text.bytes().take(at).filter(|b| *b == b'\n').count()
}

/// Adds the line of the error's key, or of the nearest table above it that exists.
fn located(text: &str, mut error: RigError) -> RigError {
    error.line = DeTable::parse(text).ok().map(|table| {
        let mut at = 0;
        let mut here: Option<&DeValue<'_>> = None;
        for part in error.key.split('.') {
            let next = match here {
                None => table.get_ref().get_key_value(part).map(|(k, v)| (k.span(), v)),
                Some(DeValue::Table(inner)) => inner.get_key_value(part).map(|(k, v)| (k.span(), v)),
                Some(DeValue::Array(items)) => {
                    part.parse::<usize>().ok().and_then(|i| items.get(i.saturating_sub(1))).map(|v| (v.span(), v))
                }
                Some(_) => None,
            };
            let Some((span, value)) = next else { break };
            at = span.start;
            here = Some(value.get_ref());
        }
        line_of(text, at)
    });
    error
}
