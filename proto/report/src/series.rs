//! Series that a panel shows.

use crate::color::Color;
use crate::histogram::Histogram;

/// A line through points; a point with a NaN breaks it.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    pub(crate) name: String,
    pub(crate) x: Vec<f64>,
    pub(crate) y: Vec<f64>,
    pub(crate) color: Option<Color>,
    pub(crate) dashed: bool,
    pub(crate) stepped: bool,
    pub(crate) width: f64,
}

impl Line {
    /// A line with a name for the legend; points without a partner are left out.
    pub fn new(name: &str, x: &[f64], y: &[f64]) -> Self {
        let points = x.len().min(y.len());
        Self {
            name: name.to_owned(),
            x: x.iter().copied().take(points).collect(),
            y: y.iter().copied().take(points).collect(),
            color: None,
            dashed: false,
            stepped: false,
            width: 1.4,
        }
    }

    /// A colour of its own instead of the next of the cycle.
    #[must_use]
    pub fn color(mut self, color: Color) -> Self {
        self.color = Some(color);
        self
    }

    /// Drawn in dashes: for references.
    #[must_use]
    pub fn dashed(mut self) -> Self {
        self.dashed = true;
        self
    }

    /// Each value holds until the next: for commands.
    #[must_use]
    pub fn stepped(mut self) -> Self {
        self.stepped = true;
        self
    }

    /// Width of the line (pixels; 1.4 unless told).
    #[must_use]
    pub fn width(mut self, width: f64) -> Self {
        self.width = width;
        self
    }
}

/// An area between two curves; a NaN in either breaks it.
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    pub(crate) name: String,
    pub(crate) x: Vec<f64>,
    pub(crate) low: Vec<f64>,
    pub(crate) high: Vec<f64>,
    pub(crate) color: Option<Color>,
}

impl Band {
    /// A band with a name for the legend; points without partners are left out.
    pub fn new(name: &str, x: &[f64], low: &[f64], high: &[f64]) -> Self {
        let points = x.len().min(low.len()).min(high.len());
        let cut = |values: &[f64]| values.iter().copied().take(points).collect();
        Self { name: name.to_owned(), x: cut(x), low: cut(low), high: cut(high), color: None }
    }

    /// A colour of its own instead of the next of the cycle.
    #[must_use]
    pub fn color(mut self, color: Color) -> Self {
        self.color = Some(color);
        self
    }
}

/// Points without a line; those with a NaN are left out.
#[derive(Debug, Clone, PartialEq)]
pub struct Scatter {
    pub(crate) name: String,
    pub(crate) x: Vec<f64>,
    pub(crate) y: Vec<f64>,
    pub(crate) color: Option<Color>,
}

impl Scatter {
    /// Points with a name for the legend; those without a partner are left out.
    pub fn new(name: &str, x: &[f64], y: &[f64]) -> Self {
        let points = x.len().min(y.len());
        let cut = |values: &[f64]| values.iter().copied().take(points).collect();
        Self { name: name.to_owned(), x: cut(x), y: cut(y), color: None }
    }

    /// A colour of its own instead of the next of the cycle.
    #[must_use]
    pub fn color(mut self, color: Color) -> Self {
        self.color = Some(color);
        self
    }
}

/// Everything a panel can show.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Series {
    Line(Line),
    Band(Band),
    Scatter(Scatter),
    Bars {
        name: String,
        histogram: Histogram,
        color: Option<Color>,
    },
    /// A horizontal line across the panel.
    Level {
        name: String,
        y: f64,
        color: Color,
    },
    /// A vertical line across the panel.
    Moment {
        name: String,
        x: f64,
        color: Color,
    },
    /// A shaded stretch of the x axis.
    Span {
        name: String,
        from: f64,
        to: f64,
        color: Color,
    },
}

impl Series {
    pub(crate) fn name(&self) -> &str {
        match self {
            Self::Line(line) => &line.name,
            Self::Band(band) => &band.name,
            Self::Scatter(scatter) => &scatter.name,
            Self::Bars { name, .. }
            | Self::Level { name, .. }
            | Self::Moment { name, .. }
            | Self::Span { name, .. } => name,
        }
    }

    /// The series' own colour; `None` when it takes the next of the cycle.
    pub(crate) fn color(&self) -> Option<Color> {
        match self {
            Self::Line(Line { color, .. })
            | Self::Band(Band { color, .. })
            | Self::Scatter(Scatter { color, .. })
            | Self::Bars { color, .. } => *color,
            Self::Level { color, .. } | Self::Moment { color, .. } | Self::Span { color, .. } => Some(*color),
        }
    }

    /// Values that the x axis must hold.
    pub(crate) fn x_values(&self) -> Box<dyn Iterator<Item = f64> + '_> {
        match self {
            Self::Line(line) => Box::new(line.x.iter().copied()),
            Self::Band(band) => Box::new(band.x.iter().copied()),
            Self::Scatter(scatter) => Box::new(scatter.x.iter().copied()),
            Self::Bars { histogram, .. } => Box::new(histogram.edges.iter().copied()),
            Self::Moment { x, .. } => Box::new(std::iter::once(*x)),
            Self::Span { from, to, .. } => Box::new([*from, *to].into_iter()),
            Self::Level { .. } => Box::new(std::iter::empty()),
        }
    }

    /// Values that the y axis must hold.
    pub(crate) fn y_values(&self) -> Box<dyn Iterator<Item = f64> + '_> {
        match self {
            Self::Line(line) => Box::new(line.y.iter().copied()),
            Self::Band(band) => Box::new(band.low.iter().chain(&band.high).copied()),
            Self::Scatter(scatter) => Box::new(scatter.y.iter().copied()),
            Self::Bars { histogram, .. } => Box::new(histogram.counts.iter().map(|count| *count as f64)),
            Self::Level { y, .. } => Box::new(std::iter::once(*y)),
            Self::Moment { .. } | Self::Span { .. } => Box::new(std::iter::empty()),
        }
    }
}
