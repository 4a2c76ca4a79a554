//! Legends: which mark is which series, in a row above the panel.

use std::fmt::Write;

use crate::color::Color;
use crate::markup::{coordinate, escape};
use crate::names::{letters_in, shortened};
use crate::series::Series;

/// Size of all text in a plot (pixels).
pub(crate) const FONT: f64 = 13.0;
/// Width of a letter (pixels): a sans-serif letter is about 0.55 of its size wide, and a little too much is better than
/// an overlap.
pub(crate) const LETTER: f64 = FONT * 0.56;
/// Length of a legend's mark (pixels).
const MARK: f64 = 22.0;
/// Space between mark and name, and between entries (pixels).
const GAPS: (f64, f64) = (6.0, 18.0);

/// A series with the looks that it has in its panel.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Styled<'a> {
    pub(crate) series: &'a Series,
    pub(crate) color: &'static str,
    pub(crate) dashed: bool,
}

/// Gives each series its own colour or the next of the cycle; a second round through the cycle is
/// dashed, so that twelve lines can be told apart.
pub(crate) fn styled(series: &[Series]) -> Vec<Styled<'_>> {
    let mut taken = 0;
    let style = |series| {
        let own = Series::color(series);
        let color = own.or_else(|| Color::CYCLE.into_iter().cycle().nth(taken)).unwrap_or(Color::Blue);
        taken += usize::from(own.is_none());
        let second_round = own.is_none() && taken > Color::CYCLE.len();
        let dashed = second_round || matches!(series, Series::Line(line) if line.dashed);
        Styled { series, color: color.hex(), dashed }
    };
    series.iter().map(style).collect()
}

/// Width that a text will take, without a font at hand.
pub(crate) fn text_width(text: &str) -> f64 {
    text.chars().count() as f64 * LETTER
}

/// Name of each series as a legend of a width (pixels) has it; no entry is wider than a row.
pub(crate) fn names(series: &[Styled<'_>], width: f64) -> Vec<String> {
    let whole: Vec<&str> = series.iter().map(|styled| styled.series.name()).collect();
    shortened(&whole, letters_in(width - MARK - GAPS.0))
}

/// Rows of entries, each with its left edge; entries that find no room begin another row.
pub(crate) fn layout(series: &[Styled<'_>], names: &[String], from: f64, to: f64) -> Vec<Vec<(usize, f64)>> {
    let mut rows: Vec<Vec<(usize, f64)>> = vec![Vec::new()];
    let mut x = from;
    for (index, (Styled { series: entry, .. }, name)) in series.iter().zip(names).enumerate() {
        if entry.name().is_empty() || labelled_in_place(entry) {
            continue;
        }
        let width = MARK + GAPS.0 + text_width(name);
        if x + width > to && x > from {
            rows.push(Vec::new());
            x = from;
        }
        if let Some(row) = rows.last_mut() {
            row.push((index, x));
        }
        x += width + GAPS.1;
    }
    rows
}

/// Lines across the panel carry their name where they are.
pub(crate) fn labelled_in_place(series: &Series) -> bool {
    matches!(series, Series::Level { .. } | Series::Moment { .. })
}

/// Draws one entry under a name, with its left edge at `x` and its text on the line `y`.
pub(crate) fn entry(out: &mut String, styled: &Styled<'_>, name: &str, x: f64, y: f64) {
    let Styled { series, color, dashed } = *styled;
    let (left, right, middle) = (coordinate(x), coordinate(x + MARK), coordinate(y - FONT * 0.34));
    // Writing to a String cannot fail.
    let _ = match series {
        Series::Line(line) => {
            let dash = if dashed { " stroke-dasharray=\"6 4\"" } else { "" };
            write!(
                out,
                "<path d=\"M{left} {middle}H{right}\" stroke=\"{color}\" stroke-width=\"{}\" fill=\"none\"{dash}/>",
                line.width.max(2.0)
            )
        }
        Series::Scatter(_) => {
            let center = coordinate(x + MARK / 2.0);
            write!(out, "<circle cx=\"{center}\" cy=\"{middle}\" r=\"3\" fill=\"{color}\"/>")
        }
        Series::Band(_) | Series::Bars { .. } | Series::Span { .. } => {
            let opacity = if matches!(series, Series::Bars { .. }) { "0.85" } else { "0.22" };
            let top = coordinate(y - FONT * 0.75);
            write!(
                out,
                "<rect x=\"{left}\" y=\"{top}\" width=\"{MARK}\" height=\"11\" fill=\"{color}\" fill-opacity=\"{opacity}\" stroke=\"{color}\" stroke-opacity=\"0.6\"/>"
            )
        }
        Series::Level { .. } | Series::Moment { .. } => Ok(()),
    };
    let text = coordinate(x + MARK + GAPS.0);
    let _ = write!(out, "<text x=\"{text}\" y=\"{}\">{}</text>", coordinate(y), escape(name));
}
