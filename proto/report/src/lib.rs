//! Self-contained HTML reports with SVG plots.
//!
//! One file that opens anywhere, in ten years too: no fonts, no images, nothing from the network. It prints, it is readable
//! without colour, and it is complete where no scripts run. Where they do, its plots can be worked with.
//!
//! ```
//! use report::{Color, Line, Panel, Plot, Report, Table};
//!
//! let time_s = [0.0, 0.02, 0.04];
//! let html = Report::new("Flight 7")
//!     .table(Table::new(["channel", "RMSE (kPa)"]).row(["positive", "0.12"]))
//!     .plot(
//!         Plot::new("Pressures", "time (s)").panel(
//!             Panel::new("positive (kPa gauge)")
//!                 .line(Line::new("reference", &time_s, &[80.0, 80.1, 80.2]).color(Color::Black).dashed())
//!                 .line(Line::new("measured", &time_s, &[79.9, 80.2, f64::NAN])),
//!         ),
//!     )
//!     .to_html();
//! assert!(html.starts_with("<!DOCTYPE html>"));
//! ```
//!
//! | module | what |
//! | --- | --- |
//! | `document` | [`Report`]: headings, texts, key figures, tables, plots, in order |
//! | `plot`, `series` | [`Plot`] of stacked [`Panel`]s over one x axis, and what a panel shows |
//! | `histogram` | [`Histogram`]: counts of values in even or logarithmic bins |
//! | `axis` | scales and round tick values |
//! | `decimate` | fewer points without losing a peak |
//! | `draw`, `path`, `legend`, `names` | a plot to SVG |
//! | `interactive` | the plots' numbers for the page's script |
//! | `markup` | escaping |
//!
//! All text that goes in is escaped; there is no way to pass markup through. Writing the file is the
//! caller's business.
//!
//! Left out: second y axes (they invite false comparisons; stack panels instead), and pie charts.

mod axis;
mod color;
mod decimate;
mod document;
mod draw;
mod histogram;
mod interactive;
mod legend;
mod markup;
mod names;
mod path;
mod plot;
mod series;
mod table;

pub use axis::{ticks_linear, ticks_log};
pub use color::Color;
pub use decimate::decimate;
pub use document::{KeyFigure, Report, Verdict};
pub use histogram::Histogram;
pub use plot::{Panel, Plot};
pub use series::{Band, Line, Scatter};
pub use table::Table;
