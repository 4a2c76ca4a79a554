//! Parts that make a page one to work with: the plots' numbers as data, and the script that draws them anew.
//!
//! The pictures in the page are complete without it: a mail program that runs no scripts shows them, and so does paper.
//! Where scripts run, the same plots are drawn from their numbers, as wide as the window, with values under the pointer,
//! zoom, series that can be switched off, and both pictures and numbers to be saved. Nothing is loaded from elsewhere.
//!
//! Numbers are carried in single precision (seven digits), little-endian in base 64; an array that several series share
//! stands once. More than [`MOST_POINTS`] points of a curve are thinned out to the extremes of even stretches.

use std::collections::HashMap;
use std::fmt::Write;

use crate::axis::{Axis, Scale};
use crate::color::DARK;
use crate::decimate::decimate;
use crate::draw::NO_VALUES;
use crate::legend::styled;
use crate::path::parts;
use crate::plot::{Panel, Plot};
use crate::series::Series;

/// Points of a curve that are carried in full: two minutes at 50 Hz.
const MOST_POINTS: usize = 6_000;

/// The page's script: one function, so that nothing of it is seen outside.
const SCRIPT: &str = concat!(
    "'use strict';\n(() => {\n",
    include_str!("script/numbers.js"),
    include_str!("script/arrangement.js"),
    include_str!("script/drawing.js"),
    include_str!("script/pointing.js"),
    include_str!("script/saving.js"),
    include_str!("script/view.js"),
    include_str!("script/page.js"),
    "})();\n"
);

/// The script element with the data and the one that uses them; empty without a plot.
pub(crate) fn scripts(plots: &[(String, &Plot)]) -> String {
    if plots.is_empty() {
        return String::new();
    }
    let mut arrays = Arrays::default();
    let plots: Vec<String> =
        plots.iter().map(|(name, plot)| format!("{}:{}", string(name), plot_json(plot, &mut arrays))).collect();
    let dark: Vec<String> = DARK.iter().map(|(light, dark)| format!("\"{light}\":\"{dark}\"")).collect();
    format!(
        "<script type=\"application/json\" id=\"plot-data\">{{\"dark\":{{{}}},\"plots\":{{{}}},\"arrays\":[{}]}}</script>\n<script>\n{}</script>\n",
        dark.join(","),
        plots.join(","),
        arrays.texts.join(","),
        SCRIPT
    )
}

/// Arrays of numbers, each content once.
#[derive(Default)]
struct Arrays {
    texts: Vec<String>,
    places: HashMap<Vec<u8>, usize>,
}

impl Arrays {
    /// The place of an array among all.
    fn put(&mut self, values: impl IntoIterator<Item = f64>) -> usize {
        let bytes: Vec<u8> = values.into_iter().flat_map(|value| (value as f32).to_le_bytes()).collect();
        if let Some(place) = self.places.get(&bytes) {
            return *place;
        }
        let place = self.texts.len();
        self.texts.push(format!("\"{}\"", base64(&bytes)));
        self.places.insert(bytes, place);
        place
    }
}

fn plot_json(plot: &Plot, arrays: &mut Arrays) -> String {
    let panels: Vec<String> = plot.panels.iter().map(|panel| panel_json(panel, arrays)).collect();
    let names: Vec<String> = plot.x_names.iter().map(|name| string(name)).collect();
    let names = if names.is_empty() { String::new() } else { format!(",\"names\":[{}]", names.join(",")) };
    format!(
        "{{\"t\":{},\"xl\":{},\"x\":{}{names},\"panels\":[{}]}}",
        string(&plot.title),
        string(&plot.x_label),
        axis_json(&plot.x_axis()),
        panels.join(",")
    )
}

fn panel_json(panel: &Panel, arrays: &mut Arrays) -> String {
    let series: Vec<String> = styled(&panel.series)
        .into_iter()
        .filter_map(|styled| {
            let kind = series_json(styled.series, arrays)?;
            let dash = if styled.dashed { ",\"dash\":1" } else { "" };
            Some(format!("{{\"n\":{},\"c\":\"{}\"{dash},{kind}}}", string(styled.series.name()), styled.color))
        })
        .collect();
    let words = if panel.is_empty() { format!("\"words\":{},", string(NO_VALUES)) } else { String::new() };
    format!(
        "{{{words}\"l\":{},\"h\":{},\"y\":{},\"s\":[{}]}}",
        string(&panel.y_label),
        panel.height,
        axis_json(&panel.y_axis()),
        series.join(",")
    )
}

/// A series without its name and colour; `None` for one that shows nothing.
fn series_json(series: &Series, arrays: &mut Arrays) -> Option<String> {
    let finite = |value: &f64| value.is_finite();
    match series {
        Series::Line(line) => {
            let (x, y) = thinned(&line.x, &line.y);
            let step = if line.stepped { ",\"step\":1" } else { "" };
            Some(format!("\"k\":\"line\",\"w\":{}{step},\"x\":{},\"y\":{}", line.width, arrays.put(x), arrays.put(y)))
        }
        Series::Scatter(scatter) => {
            let (x, y) = thinned(&scatter.x, &scatter.y);
            Some(format!("\"k\":\"dots\",\"x\":{},\"y\":{}", arrays.put(x), arrays.put(y)))
        }
        Series::Band(band) => {
            let every = band.x.len().div_ceil(MOST_POINTS).max(1);
            let mut put = |values: &[f64]| arrays.put(values.iter().copied().step_by(every));
            let (x, low, high) = (put(&band.x), put(&band.low), put(&band.high));
            Some(format!("\"k\":\"band\",\"x\":{x},\"y\":{low},\"y2\":{high}"))
        }
        Series::Bars { histogram, .. } => {
            let edges: Vec<String> = histogram.edges.iter().map(|edge| number(*edge)).collect();
            let counts: Vec<String> = histogram.counts.iter().map(u64::to_string).collect();
            Some(format!("\"k\":\"bars\",\"edges\":[{}],\"counts\":[{}]", edges.join(","), counts.join(",")))
        }
        Series::Level { y, .. } => {
            Some(y).filter(|y| finite(y)).map(|y| format!("\"k\":\"level\",\"at\":{}", number(*y)))
        }
        Series::Moment { x, .. } => {
            Some(x).filter(|x| finite(x)).map(|x| format!("\"k\":\"moment\",\"at\":{}", number(*x)))
        }
        Series::Span { from, to, .. } if finite(from) && finite(to) => {
            Some(format!("\"k\":\"span\",\"from\":{},\"to\":{}", number(from.min(*to)), number(from.max(*to))))
        }
        Series::Span { .. } => None,
    }
}

/// The points that can be drawn, with a gap between parts: a point without a y, where the part before ends.
fn thinned(x: &[f64], y: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let (mut xs, mut ys) = (Vec::new(), Vec::new());
    let sorted = x.is_sorted();
    for part in parts(x, |index| y.get(index).is_some_and(|y| y.is_finite())) {
        let (Some(x_part), Some(y_part)) = (x.get(part.clone()), y.get(part.clone())) else { continue };
        if let Some(last) = xs.last().copied() {
            xs.push(last);
            ys.push(f64::NAN);
        }
        let share = MOST_POINTS * part.len() / x.len().max(1);
        let kept: Vec<usize> = if sorted && x.len() > MOST_POINTS {
            decimate(x_part, y_part, (share / 4).max(1))
        } else {
            (0..x_part.len()).collect()
        };
        for (x, y) in kept.iter().filter_map(|index| Some((x_part.get(*index)?, y_part.get(*index)?))) {
            xs.push(*x);
            ys.push(*y);
        }
    }
    (xs, ys)
}

fn axis_json(axis: &Axis) -> String {
    format!("[{},{},{}]", number(axis.low), number(axis.high), u8::from(axis.scale == Scale::Log))
}

/// A number as JSON has it; what JSON has no number for is null.
fn number(value: f64) -> String {
    if value.is_finite() { format!("{value:?}") } else { "null".to_owned() }
}

/// A text as JSON has it, with nothing in it that could end a script element.
fn string(text: &str) -> String {
    let mut out = String::from("\"");
    for character in text.chars() {
        match character {
            '"' | '\\' => {
                out.push('\\');
                out.push(character);
            }
            '<'
            | '>'
            | '&'
            | '\u{2028}'
            | '\u{2029}'
            | '\u{fffe}'
            | '\u{ffff}'
            | '\u{7f}'..='\u{9f}'
            | '\0'..='\u{1f}' => {
                // Writing to a String cannot fail.
                let _ = write!(out, "\\u{:04x}", u32::from(character));
            }
            _ => out.push(character),
        }
    }
    out.push('"');
    out
}

/// Base 64 (RFC 4648) with padding.
fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let at = |index: usize| u32::from(chunk.get(index).copied().unwrap_or(0));
        let word = at(0) << 16 | at(1) << 8 | at(2);
        for place in 0..4 {
            let letter = LETTERS.get((word >> (18 - 6 * place) & 63) as usize).copied().unwrap_or(b'A');
            out.push(if place <= chunk.len() { char::from(letter) } else { '=' });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_the_standards() {
        // The vectors of RFC 4648, section 10.
        let encoded = ["", "f", "fo", "foo", "foob", "fooba", "foobar"].map(|text| base64(text.as_bytes()));
        assert_eq!(encoded, ["", "Zg==", "Zm8=", "Zm9v", "Zm9vYg==", "Zm9vYmE=", "Zm9vYmFy"]);
    }

    #[test]
    fn an_array_stands_once_and_a_gap_is_kept() {
        let mut arrays = Arrays::default();
        assert_eq!([arrays.put([1.0, 2.0]), arrays.put([3.0]), arrays.put([1.0, 2.0])], [0, 1, 0]);
        let (x, y) = thinned(&[0.0, 1.0, 2.0, 3.0], &[5.0, f64::NAN, 6.0, 7.0]);
        assert_eq!(x, [0.0, 0.0, 2.0, 3.0]);
        assert!(y[1].is_nan() && y[0] == 5.0 && y[2..] == [6.0, 7.0]);
    }

    #[test]
    fn a_long_curve_keeps_its_extremes() {
        let x: Vec<f64> = (0..50_000).map(f64::from).collect();
        let y: Vec<f64> = x.iter().map(|x| if *x == 31_417.0 { 9.0 } else { (x * 0.01).sin() }).collect();
        let (kept, values) = thinned(&x, &y);
        assert!(kept.len() <= MOST_POINTS + 4, "{}", kept.len());
        assert_eq!(kept[values.iter().position(|y| *y == 9.0).unwrap()], 31_417.0);
    }

    #[test]
    fn no_text_ends_the_script() {
        assert_eq!(string("</script>\"\\\u{1}"), "\"\\u003c/script\\u003e\\\"\\\\\\u0001\"");
    }
}
