//! From TOML text to a checked rig, with line numbers in the errors.

use std::ops::Range;

use toml::Spanned;
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

/// Rewrites TOML's picture of an error as one line that names the key.
fn parse_error(text: &str, error: &toml::de::Error) -> RigError {
    let problem = error.message().replace('\n', "; ");
    let mut span = error.span().unwrap_or_default();
    // Errors inside tagged components carry the span of the component at best; the offending word is
    // quoted in the message, so the place that holds it is the better answer.
    if problem.starts_with("unknown") {
        let word = problem.split('`').nth(1).unwrap_or_default();
        if let Some(at) = word_after(text, span.start, word).or_else(|| word_after(text, 0, word)) {
            span = at..at + word.len();
        }
    }
    let (key, at) = DeTable::parse(text)
        .ok()
        .and_then(|table| {
            let (mut key, found) = entries(table.get_ref()).find_map(|entry| innermost(entry, &span))?;
            let blamed = if found.span() == span { offender(found.get_ref(), &problem) } else { None };
            if let Some((rest, at)) = blamed {
                key = format!("{key}.{rest}");
                span = at;
            }
            Some((key, span.start))
        })
        .unwrap_or_else(|| (section_at(text, span.start), span.start));
    RigError { line: Some(line_of(text, at)), key, problem }
}

/// A key as the user knows it, where it stands, and its value; elements of arrays count from 1.
type Entry<'t, 'd> = (String, Option<Range<usize>>, &'t Spanned<DeValue<'d>>);

fn entries<'t, 'd>(table: &'t DeTable<'d>) -> impl Iterator<Item = Entry<'t, 'd>> {
    table.iter().map(|(key, value)| (key.get_ref().to_string(), Some(key.span()), value))
}

fn children<'t, 'd>(value: &'t DeValue<'d>) -> Box<dyn Iterator<Item = Entry<'t, 'd>> + 't> {
    match value {
        DeValue::Table(table) => Box::new(entries(table)),
        DeValue::Array(items) => Box::new(items.iter().enumerate().map(|(i, v)| ((i + 1).to_string(), None, v))),
        _ => Box::new(std::iter::empty()),
    }
}

/// The dotted key and the value of the innermost entry that the bytes of `span` lie in.
fn innermost<'t, 'd>(
    (key, key_span, value): Entry<'t, 'd>,
    span: &Range<usize>,
) -> Option<(String, &'t Spanned<DeValue<'d>>)> {
    // A table's own span is its header, which does not enclose its entries: they are asked first.
    if let Some((inner, found)) = children(value.get_ref()).find_map(|entry| innermost(entry, span)) {
        return Some((format!("{key}.{inner}"), found));
    }
    let holds = |outer: Range<usize>| outer.start <= span.start && span.end <= outer.end;
    (holds(value.span()) || key_span.is_some_and(holds)).then_some((key, value))
}

/// The only entry below `value` whose value is the one that the message complains about.
fn offender(value: &DeValue<'_>, problem: &str) -> Option<(String, Range<usize>)> {
    let (_, complaint) = problem.split_once("invalid type: ").or_else(|| problem.split_once("invalid value: "))?;
    let (blamed, _) = complaint.split_once(", expected")?;
    let mut found = Vec::new();
    let mut open: Vec<Entry<'_, '_>> = children(value).collect();
    while let Some((key, _, value)) = open.pop() {
        if described(value.get_ref()).is_some_and(|words| words == blamed) {
            found.push((key.clone(), value.span()));
        }
        open.extend(children(value.get_ref()).map(|(inner, span, value)| (format!("{key}.{inner}"), span, value)));
    }
    if found.len() == 1 { found.pop() } else { None }
}

/// Description of a value of the wrong type as serde's messages have it.
fn described(value: &DeValue<'_>) -> Option<String> {
    match value {
        DeValue::String(text) => Some(format!("string {text:?}")),
        DeValue::Integer(number) => Some(format!("integer `{}`", number.as_str())),
        DeValue::Float(number) => number.as_str().parse::<f64>().ok().map(|x| format!("floating point `{x:?}`")),
        DeValue::Boolean(truth) => Some(format!("boolean `{truth}`")),
        DeValue::Array(_) => Some("sequence".to_owned()),
        DeValue::Table(_) => Some("map".to_owned()),
        DeValue::Datetime(_) => None,
    }
}

/// Where `word` stands alone, outside comments, at or after byte `start`.
fn word_after(text: &str, start: usize, word: &str) -> Option<usize> {
    let rest = text.get(start..)?;
    let found = rest.match_indices(word).find(|(at, _)| {
        !word.is_empty() && rest.get(..*at).is_none_or(|before| !is_comment(before)) && is_word(rest, *at, word.len())
    })?;
    Some(start + found.0)
}

/// Tells whether the text ends inside a comment.
fn is_comment(before: &str) -> bool {
    before.rsplit('\n').next().is_some_and(|line| line.contains('#'))
}

/// Tells whether the `len` bytes at `at` stand alone as a word.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::DUAL_PRESSURE;

    /// Values of the wrong type, in plain tables and in tagged ones (where TOML loses the position).
    #[test]
    fn wrong_types_name_their_own_key_and_line() {
        let cases = [
            ("format = 1", "format = -1", "format"),
            ("volume_l = 0.75", "volume_l = \"big\"", "volumes.positive.volume_l"),
            ("volume_l = 0.4", "volume_l = [0.4]", "volumes.negative.volume_l"),
            ("range_v = [1.0, 5.0]", "range_v = [1.0, \"5 V\"]", "sensors.sensor_pos.range_v.2"),
            ("range_v = [1.0, 5.0]", "range_v = [1.0]", "sensors.sensor_pos.range_v"),
            ("speed_rpm = 3000.0", "speed_rpm = \"fast\"", "pumps.pump.speed_rpm"),
            ("inlet = \"negative\"", "inlet = 7", "pumps.pump.inlet"),
            ("phases_deg = [0.0, 180.0]", "phases_deg = [0.0, true]", "pumps.pump.phases_deg.2"),
            ("kind = \"piston\"", "kind = \"pistons\"", "pumps.pump.kind"),
            ("crank_radius_mm = 20.0", "crank_radius_cm = 2.0", "pumps.pump.crank_radius_cm"),
        ];
        for (good, bad, key) in cases {
            let text = DUAL_PRESSURE.replacen(good, bad, 1);
            let error = Rig::from_toml(&text).expect_err(bad);
            assert_eq!(error.key, key, "{error}");
            let line = text.lines().nth(error.line.unwrap() - 1).unwrap();
            assert!(line.starts_with(bad), "line {line:?} is not that of {bad:?}");
        }
        let mechanism = "[[mechanisms]]\nid = \"valve_lag\"\ncomponent = \"valve_pos\"\ntime_constant_ms = \"x\"\n";
        let error = Rig::from_toml(&format!("{DUAL_PRESSURE}\n{mechanism}")).unwrap_err();
        assert_eq!(error.key, "mechanisms.1.time_constant_ms", "{error}");
    }

    #[test]
    fn what_is_missing_names_the_table_that_lacks_it() {
        for (line, key) in [("volume_l = 0.75\n", "volumes.positive"), ("kind = \"piston\"\n", "pumps.pump")] {
            let error = Rig::from_toml(&DUAL_PRESSURE.replacen(line, "", 1)).unwrap_err();
            assert_eq!(error.key, key, "{error}");
            assert!(error.problem.starts_with("missing field"), "{error}");
        }
    }

    #[test]
    fn broken_toml_names_its_line_and_table() {
        let error = Rig::from_toml(&DUAL_PRESSURE.replacen("volume_l = 0.75", "volume_l = ", 1)).unwrap_err();
        assert_eq!((error.line, error.key.as_str()), (Some(20), "volumes.positive"), "{error}");
    }
}
