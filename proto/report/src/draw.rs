//! A plot to SVG.
//!
//! The picture is 920 pixels wide and scales with the page; text is 13 pixels at full size. Curves are
//! written in tenths of a pixel, relative from point to point, which halves the file.

use std::fmt::Write;

use crate::axis::Axis;
use crate::decimate::decimate;
use crate::legend::{self, FONT, Styled, text_width};
use crate::markup::{coordinate, escape};
use crate::names::Names;
use crate::path::{Path, parts};
use crate::plot::{Panel, Plot};
use crate::series::{Band, Line, Series};

/// Width of the picture (pixels).
const WIDTH: f64 = 920.0;
/// Left edge of the axes: room for tick labels like −1000.00.
const LEFT: f64 = 68.0;
/// Right edge of the axes: room for half a tick label.
const RIGHT: f64 = WIDTH - 18.0;
/// Height of a line of text above a panel.
const ROW: f64 = 20.0;
/// Space between panels.
const GAP: f64 = 16.0;
/// Space below the last panel: tick labels and the axis' name.
const FOOT: f64 = 48.0;
/// Diameter of a dot (pixels).
const DOT: f64 = 4.4;
/// Columns that a line is thinned out to: one per pixel of the axes.
const COLUMNS: usize = (RIGHT - LEFT) as usize;

/// Words in a panel whose series have no number that can be drawn.
pub(crate) const NO_VALUES: &str = "no values";

/// A panel with its place in the picture.
struct Placed<'a> {
    panel: &'a Panel,
    series: Vec<Styled<'a>>,
    legend: Vec<Vec<(usize, f64)>>,
    /// Each series' name as the legend has it.
    names: Vec<String>,
    legend_below_label: bool,
    head: f64,
    top: f64,
    bottom: f64,
    x: Axis,
    y: Axis,
}

pub(crate) fn svg(plot: &Plot, name: &str) -> String {
    let name = escape(name);
    let x = plot.x_axis();
    let mut placed = Vec::with_capacity(plot.panels.len());
    let mut at = 4.0;
    for panel in &plot.panels {
        let panel = place(panel, x, at);
        at = panel.bottom + GAP;
        placed.push(panel);
    }
    let names = Names::of(&plot.x_names, RIGHT - LEFT);
    let height = at - GAP + FOOT + names.extra_height;
    let mut out = String::new();
    // Writing to a String cannot fail.
    let _ = write!(
        out,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" data-plot=\"{name}\" viewBox=\"0 0 {WIDTH} {h}\" width=\"{WIDTH}\" height=\"{h}\" role=\"img\" aria-label=\"{label}\" font-family=\"system-ui,-apple-system,'Segoe UI',Roboto,'Liberation Sans',Arial,sans-serif\" font-size=\"{FONT}\" fill=\"#1f2328\">",
        h = coordinate(height),
        label = escape(&plot.title),
    );
    for (index, panel) in placed.iter().enumerate() {
        let names = (index + 1 == placed.len()).then_some(&names);
        draw_panel(&mut out, panel, &format!("{name}-{index}"), names);
    }
    let middle = coordinate((LEFT + RIGHT) / 2.0);
    let _ = write!(
        out,
        "<text x=\"{middle}\" y=\"{}\" text-anchor=\"middle\" font-weight=\"600\">{}</text></svg>",
        coordinate(height - 9.0),
        escape(&plot.x_label)
    );
    out
}

fn place(panel: &Panel, x: Axis, head: f64) -> Placed<'_> {
    let series = legend::styled(&panel.series);
    // The legend stands beside the label when one row of it fits there, else below it.
    let names = legend::names(&series, RIGHT - LEFT);
    let layout = |from: f64| legend::layout(&series, &names, from, RIGHT);
    let beside = layout(LEFT + text_width(&panel.y_label) + 40.0);
    let legend_below_label = beside.len() > 1;
    let legend = if legend_below_label { layout(LEFT) } else { beside };
    let rows = if legend_below_label { 1 + legend.len() } else { 1 };
    let top = head + rows as f64 * ROW + 4.0;
    let bottom = top + panel.height;
    Placed { panel, series, legend, names, legend_below_label, head, top, bottom, x, y: panel.y_axis() }
}

impl Placed<'_> {
    fn px(&self, x: f64) -> f64 {
        LEFT + (RIGHT - LEFT) * bounded(self.x.place(x))
    }

    fn py(&self, y: f64) -> f64 {
        self.bottom - (self.bottom - self.top) * bounded(self.y.place(y))
    }
}

/// Places far outside the picture need not be far: the clip cuts them off anyway.
fn bounded(place: f64) -> f64 {
    place.clamp(-8.0, 9.0)
}

/// Draws a panel; the last one, which carries the x axis' marks, is given the names on it.
fn draw_panel(out: &mut String, panel: &Placed<'_>, id: &str, names: Option<&Names>) {
    let (top, bottom) = (coordinate(panel.top), coordinate(panel.bottom));
    let (left, right) = (coordinate(LEFT), coordinate(RIGHT));
    let label_y = coordinate(panel.head + ROW - 6.0);
    let _ =
        write!(out, "<text x=\"{left}\" y=\"{label_y}\" font-weight=\"600\">{}</text>", escape(&panel.panel.y_label));
    for (row, entries) in panel.legend.iter().enumerate() {
        let down = row + usize::from(panel.legend_below_label);
        for (index, x) in entries {
            if let (Some(styled), Some(name)) = (panel.series.get(*index), panel.names.get(*index)) {
                legend::entry(out, styled, name, *x, panel.head + ROW * (down + 1) as f64 - 6.0);
            }
        }
    }
    grid(out, panel, names);
    // A dot on the edge is not cut in half.
    let has_dots = panel.panel.series.iter().any(|series| matches!(series, Series::Scatter(_)));
    let margin = if has_dots { 0.5 * DOT } else { 0.0 };
    let _ = write!(
        out,
        "<clipPath id=\"{id}\"><rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"/></clipPath><g clip-path=\"url(#{id})\">",
        coordinate(LEFT - margin),
        coordinate(panel.top - margin),
        coordinate(RIGHT - LEFT + 2.0 * margin),
        coordinate(panel.panel.height + 2.0 * margin)
    );
    // Areas first, then curves, then what must stay visible on top of them.
    for layer in 0..3 {
        for styled in panel.series.iter().filter(|styled| layer_of(styled.series) == layer) {
            draw_series(out, panel, styled);
        }
    }
    out.push_str("</g>");
    if panel.panel.is_empty() {
        let (x, y) = (coordinate((LEFT + RIGHT) / 2.0), coordinate((panel.top + panel.bottom) / 2.0));
        let _ = write!(out, "<text x=\"{x}\" y=\"{y}\" text-anchor=\"middle\" fill=\"#57606a\">{NO_VALUES}</text>");
    }
    let _ =
        write!(out, "<path d=\"M{left} {top}V{bottom}H{right}\" fill=\"none\" stroke=\"#57606a\" stroke-width=\"1\"/>");
    labels_in_place(out, panel);
}

fn layer_of(series: &Series) -> usize {
    match series {
        Series::Span { .. } | Series::Band(_) | Series::Bars { .. } => 0,
        Series::Line(_) | Series::Scatter(_) => 1,
        Series::Level { .. } | Series::Moment { .. } => 2,
    }
}

fn grid(out: &mut String, panel: &Placed<'_>, names: Option<&Names>) {
    let y_ticks = panel.y.ticks(((panel.panel.height / 26.0) as usize).clamp(3, 9));
    let mut path = String::new();
    for tick in &y_ticks {
        let y = coordinate(panel.py(tick.value));
        let _ = write!(path, "M{} {y}H{}", coordinate(LEFT), coordinate(RIGHT));
        let _ = write!(
            out,
            "<text x=\"{}\" y=\"{}\" text-anchor=\"end\">{}</text>",
            coordinate(LEFT - 8.0),
            coordinate(panel.py(tick.value) + FONT * 0.35),
            tick.label
        );
    }
    if let Some(names) = names.filter(|names| !names.is_empty()) {
        named_ticks(out, panel, names);
    }
    for tick in panel.x.ticks(13) {
        let x = coordinate(panel.px(tick.value));
        let _ = write!(path, "M{x} {}V{}", coordinate(panel.top), coordinate(panel.bottom));
        if names.is_some_and(Names::is_empty) {
            // A long number at the end of the axis would be cut off by the picture's edge.
            let most = WIDTH - 0.6 * text_width(&tick.label) - 1.0;
            let _ = write!(
                out,
                "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
                coordinate(panel.px(tick.value).min(most)),
                coordinate(panel.bottom + FONT + 5.0),
                tick.label
            );
        }
    }
    let _ = write!(out, "<path d=\"{path}\" fill=\"none\" stroke=\"#d8dee4\" stroke-width=\"1\"/>");
}

/// Names below the x axis: beside each other where there is room, else upright.
fn named_ticks(out: &mut String, panel: &Placed<'_>, names: &Names) {
    for (index, name) in names.shown.iter().enumerate() {
        let (x, text) = (panel.px(index as f64 + 1.0), escape(name));
        let _ = if names.upright {
            let (x, y) = (coordinate(x + FONT * 0.35), coordinate(panel.bottom + 8.0));
            write!(out, "<text transform=\"translate({x} {y}) rotate(-90)\" text-anchor=\"end\">{text}</text>")
        } else {
            let (x, y) = (coordinate(x), coordinate(panel.bottom + FONT + 5.0));
            write!(out, "<text x=\"{x}\" y=\"{y}\" text-anchor=\"middle\">{text}</text>")
        };
    }
}

fn draw_series(out: &mut String, panel: &Placed<'_>, styled: &Styled<'_>) {
    let Styled { series, color, dashed } = *styled;
    let title = match series.name() {
        "" => String::new(),
        name => format!("<title>{}</title>", escape(name)),
    };
    let _ = match series {
        Series::Line(line) => {
            // A tenth of the scale, so ten times the width and the dash.
            let dash = if dashed { " stroke-dasharray=\"60 40\"" } else { "" };
            let (path, lone) = line_path(panel, line);
            if !lone.is_empty() {
                let width = coordinate(10.0 * line.width.max(DOT));
                let _ = write!(
                    out,
                    "<path transform=\"scale(.1)\" d=\"{lone}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"{width}\" stroke-linecap=\"round\"/>"
                );
            }
            write!(
                out,
                "<path transform=\"scale(.1)\" d=\"{path}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"{}\" stroke-linejoin=\"round\" stroke-linecap=\"round\"{dash}>{title}</path>",
                coordinate(line.width * 10.0)
            )
        }
        Series::Band(band) => write!(
            out,
            "<path transform=\"scale(.1)\" d=\"{}\" fill=\"{color}\" fill-opacity=\"0.22\">{title}</path>",
            band_path(panel, band)
        ),
        Series::Scatter(scatter) => {
            // A stroke of no length with round ends is a dot, and a third of a circle's bytes.
            let mut path = Path::default();
            for (x, y) in scatter.x.iter().zip(&scatter.y).filter(|(x, y)| x.is_finite() && y.is_finite()) {
                path.jump(panel.px(*x), panel.py(*y));
                path.dot();
            }
            write!(
                out,
                "<path transform=\"scale(.1)\" d=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-opacity=\"0.65\" stroke-width=\"{}\" stroke-linecap=\"round\">{title}</path>",
                path.text,
                coordinate(10.0 * DOT)
            )
        }
        Series::Bars { histogram, .. } => {
            let mut path = String::new();
            for (edges, count) in histogram.edges.windows(2).zip(&histogram.counts).filter(|(_, count)| **count > 0) {
                let (from, to) = (panel.px(edges[0]), panel.px(edges[1]));
                let _ = write!(
                    path,
                    "M{} {}V{}H{}V{}Z",
                    coordinate(from),
                    coordinate(panel.bottom),
                    coordinate(panel.py(*count as f64)),
                    coordinate(to),
                    coordinate(panel.bottom)
                );
            }
            write!(
                out,
                "<path d=\"{path}\" fill=\"{color}\" fill-opacity=\"0.85\" stroke=\"#ffffff\" stroke-width=\"0.6\">{title}</path>"
            )
        }
        Series::Level { y, .. } if y.is_finite() => {
            let y = coordinate(panel.py(*y));
            write!(
                out,
                "<path d=\"M{} {y}H{}\" stroke=\"{color}\" stroke-width=\"1.3\" stroke-dasharray=\"2 3\">{title}</path>",
                coordinate(LEFT),
                coordinate(RIGHT)
            )
        }
        Series::Moment { x, .. } if x.is_finite() => {
            let x = coordinate(panel.px(*x));
            write!(
                out,
                "<path d=\"M{x} {}V{}\" stroke=\"{color}\" stroke-width=\"1.3\" stroke-dasharray=\"2 3\">{title}</path>",
                coordinate(panel.top),
                coordinate(panel.bottom)
            )
        }
        Series::Span { from, to, .. } if from.is_finite() && to.is_finite() => {
            let (from, to) = (panel.px(from.min(*to)), panel.px(from.max(*to)));
            write!(
                out,
                "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" fill=\"{color}\" fill-opacity=\"0.12\">{title}</rect>",
                coordinate(from),
                coordinate(panel.top),
                // A stretch narrower than a pixel must still be seen.
                coordinate((to - from).max(1.0)),
                coordinate(panel.panel.height)
            )
        }
        Series::Level { .. } | Series::Moment { .. } | Series::Span { .. } => Ok(()),
    };
}

/// Names of levels and moments, beside their lines, on a white ground so that curves do not cross them.
fn labels_in_place(out: &mut String, panel: &Placed<'_>) {
    // Names of moments that would stand on one another go one below the other.
    let mut taken: Vec<(f64, f64)> = Vec::new();
    for Styled { series, color, .. } in &panel.series {
        let (x, y, anchor) = match series {
            Series::Level { y, .. } if y.is_finite() => {
                let at = panel.py(*y);
                // Above the line, or below it where the panel ends.
                let text = if at - FONT - 4.0 < panel.top { at + FONT + 1.0 } else { at - 5.0 };
                (RIGHT - 6.0, text, "end")
            }
            Series::Moment { x, .. } if x.is_finite() => {
                let at = panel.px(*x);
                let fits = at + 6.0 + text_width(series.name()) < RIGHT;
                let (text, anchor) = if fits { (at + 6.0, "start") } else { (at - 6.0, "end") };
                let from = if fits { text } else { text - text_width(series.name()) };
                let to = from + text_width(series.name());
                let above = taken.iter().filter(|(begin, end)| from < end + 6.0 && to > begin - 6.0).count();
                taken.push((from, to));
                (text, panel.top + FONT + 3.0 + above as f64 * (FONT + 3.0), anchor)
            }
            _ => continue,
        };
        let outside = !(LEFT..=RIGHT).contains(&x) || !(panel.top..=panel.bottom + FONT).contains(&y);
        if outside || series.name().is_empty() {
            continue;
        }
        let _ = write!(
            out,
            "<text x=\"{}\" y=\"{}\" text-anchor=\"{anchor}\" fill=\"{color}\" stroke=\"#ffffff\" stroke-width=\"3\" paint-order=\"stroke\">{}</text>",
            coordinate(x),
            coordinate(y),
            escape(series.name())
        );
    }
}

/// A line's path, and that of its points without a neighbour, which are dots: as thin as the line nobody would see them.
fn line_path(panel: &Placed<'_>, line: &Line) -> (String, String) {
    let (mut path, mut lone) = (Path::default(), Path::default());
    for part in parts(&line.x, |index| line.y.get(index).is_some_and(|y| y.is_finite())) {
        let (Some(x), Some(y)) = (line.x.get(part.clone()), line.y.get(part)) else { continue };
        let kept = thinned(x, y);
        let mut before: Option<f64> = None;
        for (x, y) in kept.iter().filter_map(|index| Some((*x.get(*index)?, *y.get(*index)?))) {
            let (x, y) = (panel.px(x), panel.py(y));
            match before {
                None => path.jump(x, y),
                Some(held) if line.stepped => {
                    path.go(x, held);
                    path.go(x, y);
                }
                Some(_) => path.go(x, y),
            }
            before = Some(y);
        }
        if let ([x], [y]) = (x, y) {
            path.dot();
            lone.jump(panel.px(*x), panel.py(*y));
            lone.dot();
        }
    }
    (path.text, lone.text)
}

fn band_path(panel: &Placed<'_>, band: &Band) -> String {
    let mut path = Path::default();
    let sound = |index: usize| {
        band.low.get(index).is_some_and(|y| y.is_finite()) && band.high.get(index).is_some_and(|y| y.is_finite())
    };
    for part in parts(&band.x, sound) {
        let (Some(x), Some(low), Some(high)) =
            (band.x.get(part.clone()), band.low.get(part.clone()), band.high.get(part))
        else {
            continue;
        };
        let point = |values: &[f64], index: usize| Some((panel.px(*x.get(index)?), panel.py(*values.get(index)?)));
        let there = thinned(x, high).into_iter().filter_map(|index| point(high, index));
        let back = thinned(x, low).into_iter().rev().filter_map(|index| point(low, index));
        for (step, (x, y)) in there.chain(back).enumerate() {
            if step == 0 { path.jump(x, y) } else { path.go(x, y) }
        }
        path.text.push('Z');
    }
    path.text
}

fn thinned(x: &[f64], y: &[f64]) -> Vec<usize> {
    if x.is_sorted() { decimate(x, y, COLUMNS) } else { (0..x.len()).collect() }
}
