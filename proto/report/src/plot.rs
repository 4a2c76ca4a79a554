//! Plots: panels stacked over one x axis.

use crate::axis::{Axis, Scale};
use crate::color::Color;
use crate::draw;
use crate::histogram::Histogram;
use crate::series::{Band, Line, Scatter, Series};

/// Panels stacked over one x axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Plot {
    pub(crate) title: String,
    pub(crate) caption: Option<String>,
    pub(crate) x_label: String,
    pub(crate) x_scale: Scale,
    pub(crate) x_range: Option<(f64, f64)>,
    /// Words at 1, 2, 3 … on the x axis; empty for an axis of numbers.
    pub(crate) x_names: Vec<String>,
    pub(crate) panels: Vec<Panel>,
}

impl Plot {
    /// An empty plot; the label names quantity and unit, for example `time (s)`.
    pub fn new(title: &str, x_label: &str) -> Self {
        Self {
            title: title.to_owned(),
            caption: None,
            x_label: x_label.to_owned(),
            x_scale: Scale::Linear,
            x_range: None,
            x_names: Vec::new(),
            panels: Vec::new(),
        }
    }

    /// Names on the x axis instead of numbers: the first stands at 1, the next at 2. The axis runs from 0.5 on.
    #[must_use]
    pub fn x_names(mut self, names: impl IntoIterator<Item = impl Into<String>>) -> Self {
        self.x_names = names.into_iter().map(Into::into).collect();
        self.x_range = Some((0.5, self.x_names.len() as f64 + 0.5));
        self
    }

    /// Adds a panel below the others.
    #[must_use]
    pub fn panel(mut self, panel: Panel) -> Self {
        self.panels.push(panel);
        self
    }

    /// A sentence below the plot: what to see in it.
    #[must_use]
    pub fn caption(mut self, caption: &str) -> Self {
        self.caption = Some(caption.to_owned());
        self
    }

    /// A logarithmic x axis; values not above 0 are left out.
    #[must_use]
    pub fn log_x(mut self) -> Self {
        self.x_scale = Scale::Log;
        self
    }

    /// The x axis from `low` to `high` instead of around the data.
    #[must_use]
    pub fn x_range(mut self, low: f64, high: f64) -> Self {
        self.x_range = Some((low, high));
        self
    }

    /// The plot as one `<svg>` element.
    ///
    /// `name` must be unlike that of every other plot on the page: parts of the picture refer to each
    /// other by it.
    pub fn to_svg(&self, name: &str) -> String {
        draw::svg(self, name)
    }

    pub(crate) fn x_axis(&self) -> Axis {
        let values = self.panels.iter().flat_map(|panel| &panel.series).flat_map(Series::x_values);
        // Time runs from edge to edge; bars and points in a logarithmic plot need some air.
        let margin = if self.x_scale == Scale::Log { 0.03 } else { 0.0 };
        chosen(self.x_range, self.x_scale).unwrap_or_else(|| Axis::around(values, self.x_scale, margin).snapped())
    }
}

/// One pair of axes with what it shows.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    pub(crate) y_label: String,
    pub(crate) y_scale: Scale,
    pub(crate) y_range: Option<(f64, f64)>,
    pub(crate) y_includes: Vec<f64>,
    pub(crate) height: f64,
    pub(crate) series: Vec<Series>,
}

impl Panel {
    /// An empty panel; the label names quantity and unit, for example `pressure (kPa gauge)`.
    pub fn new(y_label: &str) -> Self {
        Self {
            y_label: y_label.to_owned(),
            y_scale: Scale::Linear,
            y_range: None,
            y_includes: Vec::new(),
            height: 190.0,
            series: Vec::new(),
        }
    }

    /// Height of the axes (pixels; 190 unless told).
    #[must_use]
    pub fn height(mut self, height: f64) -> Self {
        self.height = height.clamp(40.0, 2_000.0);
        self
    }

    /// A logarithmic y axis; values not above 0 are left out.
    #[must_use]
    pub fn log_y(mut self) -> Self {
        self.y_scale = Scale::Log;
        self
    }

    /// The y axis from `low` to `high` instead of around the data; what is outside is cut off.
    #[must_use]
    pub fn y_range(mut self, low: f64, high: f64) -> Self {
        self.y_range = Some((low, high));
        self
    }

    /// Widens the y axis so that it holds a value, for example 0.
    #[must_use]
    pub fn include(mut self, value: f64) -> Self {
        self.y_includes.push(value);
        self
    }

    /// Adds a line.
    #[must_use]
    pub fn line(self, line: Line) -> Self {
        self.with(Series::Line(line))
    }

    /// Adds a band.
    #[must_use]
    pub fn band(self, band: Band) -> Self {
        self.with(Series::Band(band))
    }

    /// Adds points.
    #[must_use]
    pub fn scatter(self, scatter: Scatter) -> Self {
        self.with(Series::Scatter(scatter))
    }

    /// Adds a histogram as bars.
    #[must_use]
    pub fn bars(self, name: &str, histogram: Histogram) -> Self {
        self.with(Series::Bars { name: name.to_owned(), histogram, color: None })
    }

    /// Adds a horizontal line with a label: a limit.
    #[must_use]
    pub fn level(self, name: &str, y: f64, color: Color) -> Self {
        self.with(Series::Level { name: name.to_owned(), y, color })
    }

    /// Adds a vertical line with a label: an event or a deadline.
    #[must_use]
    pub fn moment(self, name: &str, x: f64, color: Color) -> Self {
        self.with(Series::Moment { name: name.to_owned(), x, color })
    }

    /// Shades a stretch of the x axis: a fault, a region that a text speaks of.
    #[must_use]
    pub fn span(self, name: &str, from: f64, to: f64, color: Color) -> Self {
        self.with(Series::Span { name: name.to_owned(), from, to, color })
    }

    /// Adds a value at each name of the x axis ([`Plot::x_names`]), the first at the first name: a short stroke, those of
    /// several series beside each other. A value that is no number is left out.
    #[must_use]
    pub fn at_names(mut self, series: &[(&str, &[f64], Color)]) -> Self {
        /// Share of the distance between names that strokes take, and share of a stroke's own place that it fills.
        const SHARES: (f64, f64) = (0.7, 0.75);
        let place = SHARES.0 / series.len().max(1) as f64;
        for (index, (name, values, color)) in series.iter().enumerate() {
            let middle = (index as f64 + 0.5) * place - 0.5 * SHARES.0;
            let (mut x, mut y) = (Vec::new(), Vec::new());
            for (nth, value) in values.iter().enumerate() {
                let at = nth as f64 + 1.0 + middle;
                x.extend([at - 0.5 * SHARES.1 * place, at + 0.5 * SHARES.1 * place, at]);
                y.extend([*value, *value, f64::NAN]);
            }
            self = self.line(Line::new(name, &x, &y).color(*color).width(6.0));
        }
        self
    }

    fn with(mut self, series: Series) -> Self {
        self.series.push(series);
        self
    }

    /// Tells whether there are series and none of them has a number that can be drawn.
    pub(crate) fn is_empty(&self) -> bool {
        let drawn = |value: &f64| value.is_finite() && (self.y_scale == Scale::Linear || *value > 0.0);
        let shows = |series: &Series| match series {
            Series::Moment { .. } | Series::Span { .. } | Series::Level { .. } => false,
            Series::Bars { histogram, .. } => histogram.counts.iter().any(|count| *count > 0),
            curve => curve.y_values().any(|value| drawn(&value)),
        };
        !self.series.is_empty() && !self.series.iter().any(shows)
    }

    pub(crate) fn y_axis(&self) -> Axis {
        if let Some(axis) = chosen(self.y_range, self.y_scale) {
            return axis;
        }
        let has_bars = self.series.iter().any(|series| matches!(series, Series::Bars { .. }));
        // Bars grow from 0; on a logarithmic axis from a half, so that a count of 1 can be seen.
        let foot = match (has_bars, self.y_scale) {
            (false, _) => None,
            (true, Scale::Linear) => Some(0.0),
            (true, Scale::Log) => Some(0.5),
        };
        let values = self.series.iter().flat_map(Series::y_values).chain(self.y_includes.iter().copied()).chain(foot);
        let axis = Axis::around(values, self.y_scale, 0.06);
        Axis { low: foot.unwrap_or(axis.low), ..axis }
    }
}

/// The axis that the caller chose, when it is one.
fn chosen(range: Option<(f64, f64)>, scale: Scale) -> Option<Axis> {
    let (low, high) = range?;
    let sound = low.is_finite() && high.is_finite() && low < high && (scale == Scale::Linear || low > 0.0);
    sound.then_some(Axis { low, high, scale })
}
