//! Names of series and of places on an axis, where there is not room for a whole one.

use crate::legend::{LETTER, text_width};

/// Letters of a name that stands upright below the axis.
pub(crate) const UPRIGHT: usize = 28;

/// Names with at most so many letters each: the middle of a longer one is left out.
///
/// Names that differ stay different. Where their beginnings and ends do not tell them apart they keep more letters.
pub(crate) fn shortened(names: &[&str], most: usize) -> Vec<String> {
    let longest = names.iter().map(|name| name.chars().count()).max().unwrap_or(0);
    let distinct = |names: &mut dyn Iterator<Item = &str>| names.collect::<std::collections::HashSet<_>>().len();
    let wanted = distinct(&mut names.iter().copied());
    let mut letters = most.max(3);
    loop {
        let cut: Vec<String> = names.iter().map(|name| without_middle(name, letters)).collect();
        if letters >= longest || distinct(&mut cut.iter().map(String::as_str)) == wanted {
            return cut;
        }
        letters += 8;
    }
}

fn without_middle(name: &str, most: usize) -> String {
    let letters = name.chars().count();
    if letters <= most {
        return name.to_owned();
    }
    let (head, tail) = (most / 2, (most - 1) / 2);
    name.chars().take(head).chain(std::iter::once('…')).chain(name.chars().skip(letters - tail)).collect()
}

/// Letters that find room in a width (pixels).
pub(crate) fn letters_in(width: f64) -> usize {
    (width / LETTER) as usize
}

/// Names along the x axis.
pub(crate) struct Names {
    /// The names as they are drawn.
    pub(crate) shown: Vec<String>,
    /// True where they stand upright because they do not fit beside each other.
    pub(crate) upright: bool,
    /// Room that they need below the axis beside that of numbers (pixels).
    pub(crate) extra_height: f64,
}

impl Names {
    /// The names of an axis so many pixels wide.
    pub(crate) fn of(names: &[String], width: f64) -> Self {
        let longest = |names: &[String]| names.iter().map(|name| text_width(name)).fold(0.0, f64::max);
        let upright = longest(names) > width / names.len().max(1) as f64 - 6.0;
        if !upright {
            return Self { shown: names.to_vec(), upright, extra_height: 0.0 };
        }
        let shown = shortened(&names.iter().map(String::as_str).collect::<Vec<_>>(), UPRIGHT);
        let extra_height = longest(&shown);
        Self { shown, upright, extra_height }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.shown.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_name_keeps_its_beginning_and_its_end() {
        assert_eq!(shortened(&["a/flight.mcap", "abcdefghijklmnopqrst"], 9), ["a/fl…mcap", "abcd…qrst"]);
        assert_eq!(shortened(&["short", ""], 9), ["short", ""]);
    }

    #[test]
    fn names_that_differ_stay_different() {
        let names = ["2026-11-30 holds at ten/run/flight.mcap", "2026-11-30 holds at two/run/flight.mcap"];
        let cut = shortened(&names, 11);
        assert!(cut[0] != cut[1], "{cut:?}");
        assert_eq!(shortened(&["one and the same name", "one and the same name"], 9).len(), 2);
    }
}
