//! Output of a serial monitor, saved as text: a time of day in front of every line, or names in front of every number.
//!
//! ```text
//! 12:34:56.789 -> 0.85,0.77,92.1          the time becomes the first cell
//! u_pos:0.85,u_neg:0.77,p:92.1            names become a header
//! t=20 u_pos=0.85 u_neg=0.77 p=92.1       likewise
//! ```

use std::borrow::Cow;

use crate::recording::times::timestamps::is_clock_alone;

/// Mark between the time of a line and the line.
const ARROW: &str = " -> ";
/// Marks between a name and its number.
const NAMED: [char; 2] = [':', '='];
/// Lines at the beginning that tell; all of them must be such.
const TELLING_LINES: usize = 20;

/// The text as a table; as it is where it is no such text.
pub(crate) fn unfolded(text: Cow<'_, str>) -> Cow<'_, str> {
    let stamped = stamps_as_cells(&text).map_or(text, Cow::Owned);
    names_as_header(&stamped).map_or(stamped, Cow::Owned)
}

fn telling(text: &str) -> impl Iterator<Item = &str> {
    text.lines().filter(|line| !line.trim().is_empty()).take(TELLING_LINES)
}

/// A line's time and the rest of it.
fn stamped(line: &str) -> Option<(&str, &str)> {
    let (clock, rest) = line.split_once(ARROW)?;
    is_clock_alone(clock.trim()).then_some((clock.trim(), rest))
}

fn stamps_as_cells(text: &str) -> Option<String> {
    if telling(text).next().is_none() || !telling(text).all(|line| stamped(line).is_some()) {
        return None;
    }
    let cells = |line: &str| stamped(line).map(|(_, rest)| rest.to_owned()).unwrap_or_default();
    let sample = telling(text).last().map(cells).unwrap_or_default();
    let separator = ['\t', ';', ','].into_iter().find(|mark| sample.contains(*mark)).unwrap_or(' ');
    let mut out = String::with_capacity(text.len());
    for line in text.lines() {
        match stamped(line) {
            // A sketch prints the names of its numbers first.
            Some((_, rest)) if is_names(rest) => out.extend(["time", &separator.to_string(), rest]),
            Some((clock, rest)) => out.extend([clock, &separator.to_string(), rest]),
            None => out.push_str(line),
        }
        out.push('\n');
    }
    Some(out)
}

fn is_names(rest: &str) -> bool {
    rest.trim_start().starts_with(|c: char| c.is_alphabetic() || c == '"') && !rest.contains(NAMED)
}

/// Tells whether every line says numbers behind their names, and other words beside them: logs of programs, line protocols.
pub(crate) fn is_log(text: &str) -> bool {
    let names = |line: &str| -> Vec<String> {
        let words = line.split([',', ';', '\t', ' ']);
        words
            .filter_map(|word| word.split_once('='))
            .filter(|(_, number)| number.parse::<f64>().is_ok())
            .map(|(name, _)| name.to_owned())
            .collect()
    };
    let first = telling(text).next().map(names).unwrap_or_default();
    first.len() > 1 && telling(text).all(|line| names(line) == first)
}

/// A name and a number.
fn pair(cell: &str) -> Option<(&str, &str)> {
    let (name, number) = cell.split_once(NAMED)?;
    let (name, number) = (name.trim(), number.trim());
    (name.starts_with(char::is_alphabetic) && number.parse::<f64>().is_ok()).then_some((name, number))
}

/// Names and numbers of a line whose cells are such pairs, a time of day aside.
fn pairs(line: &str, separator: char) -> Option<(Vec<&str>, Vec<&str>)> {
    let cells = line.split(separator).map(str::trim).filter(|cell| !cell.is_empty());
    let of = |cell| pair(cell).or_else(|| is_clock_alone(cell).then_some(("time", cell)));
    let (names, numbers): (Vec<_>, Vec<_>) = cells.map(of).collect::<Option<Vec<_>>>()?.into_iter().unzip();
    (names.iter().filter(|name| **name != "time").count() > 1).then_some((names, numbers))
}

fn names_as_header(text: &str) -> Option<String> {
    let separator = [',', '\t', ';', ' '].into_iter().find(|separator| {
        let first = telling(text).next().and_then(|line| pairs(line, *separator));
        first.is_some_and(|(names, _)| {
            telling(text).all(|line| pairs(line, *separator).is_some_and(|(others, _)| others == names))
        })
    })?;
    let (names, _) = pairs(telling(text).next()?, separator)?;
    let comma = |cells: Vec<&str>| cells.join(",");
    let mut out = comma(names) + "\n";
    for line in text.lines() {
        out.push_str(&pairs(line, separator).map_or_else(|| line.to_owned(), |(_, numbers)| comma(numbers)));
        out.push('\n');
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_monitor_puts_in_front_becomes_cells() {
        let of = |text: &'static str| unfolded(Cow::Borrowed(text)).into_owned();
        assert_eq!(
            of("01:02:03.004 -> u,p\n01:02:03.024 -> 0.5,90\n"),
            "time,u,p\n01:02:03.004,u,p\n".replace("01:02:03.004,u,p", "01:02:03.024,0.5,90")
        );
        assert_eq!(of("u:0.5,p:90\nu:0.6,p:91\n"), "u,p\n0.5,90\n0.6,91\n");
        assert_eq!(
            of("01:02:03.024 -> u:0.5 p:90\n01:02:03.044 -> u:0.6 p:91\n"),
            "time,u,p\n01:02:03.024,0.5,90\n01:02:03.044,0.6,91\n"
        );
        assert_eq!(of("t=0 u=0.5 p=-9e1\nt=20 u=0.6 p=91\n"), "t,u,p\n0,0.5,-9e1\n20,0.6,91\n");
        let log = "2026-03-29 10:00:00,020 INFO rig: u=0.5 p=90\n";
        assert!(is_log(log) && of(log) == log && !is_log("t,u\nCH=1,CH=2\n0,1\n") && !is_log("k=1,v\nk=2,v\n"));
        for table in ["t,u\n0,1\n", "12:00:01,1\n12:00:02,1\n", "a -> b\n", "", "key:1\nkey:2\n"] {
            assert_eq!(of(table), table);
        }
    }
}
