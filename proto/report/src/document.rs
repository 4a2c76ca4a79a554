//! The page: parts in the order in which they were added.

use std::fmt::Write;

use crate::axis::with_minus;
use crate::color::dark_rules;
use crate::interactive::scripts;
use crate::markup::escape;
use crate::plot::Plot;
use crate::table::Table;

/// Verdict on a key figure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Within its limit.
    Good,
    /// Near it, or worth a look.
    Warning,
    /// Beyond it.
    Bad,
}

/// A number that a reader looks for first.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct KeyFigure {
    label: String,
    value: String,
    note: String,
    verdict: Option<Verdict>,
}

impl KeyFigure {
    /// A figure with its unit, for example `RMSE positive`, `0.12 kPa`.
    pub fn new(label: &str, value: &str) -> Self {
        Self { label: label.to_owned(), value: value.to_owned(), note: String::new(), verdict: None }
    }

    /// A few words below it, for example its limit.
    #[must_use]
    pub fn note(mut self, note: &str) -> Self {
        self.note = note.to_owned();
        self
    }

    /// Says whether it is as it should be: by a sign and a word, not by colour alone.
    #[must_use]
    pub fn verdict(mut self, verdict: Verdict) -> Self {
        self.verdict = Some(verdict);
        self
    }

    fn to_html(&self) -> String {
        let (class, sign) = match self.verdict {
            None => ("", ""),
            Some(Verdict::Good) => (" good", "<span class=\"sign\" aria-label=\"good\">✓</span>"),
            Some(Verdict::Warning) => (" warning", "<span class=\"sign\" aria-label=\"warning\">!</span>"),
            Some(Verdict::Bad) => (" bad", "<span class=\"sign\" aria-label=\"bad\">✗</span>"),
        };
        format!(
            "<div class=\"figure{class}\"><div class=\"label\">{}</div><div class=\"value\">{sign}{}</div><div class=\"note\">{}</div></div>",
            escape(&self.label),
            escape(&numbers_with_minus(&self.value)),
            escape(&self.note)
        )
    }
}

/// A text whose negative numbers have a true minus; words keep their hyphens.
fn numbers_with_minus(text: &str) -> String {
    let word = |word: &str| if word.parse::<f64>().is_ok() { with_minus(word) } else { word.to_owned() };
    text.split(' ').map(word).collect::<Vec<_>>().join(" ")
}

#[derive(Debug, Clone, PartialEq)]
enum Part {
    Heading(String),
    Text(String),
    Commands(Vec<String>),
    List(Vec<String>),
    Figures(Vec<KeyFigure>),
    Table(Table),
    Plot(Box<Plot>),
    Verbatim { name: String, text: String },
}

/// A report that grows part by part.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    title: String,
    subtitle: String,
    parts: Vec<Part>,
}

impl Report {
    /// An empty report.
    pub fn new(title: &str) -> Self {
        Self { title: title.to_owned(), subtitle: String::new(), parts: Vec::new() }
    }

    /// A line below the title: when, where, with what.
    #[must_use]
    pub fn subtitle(mut self, subtitle: &str) -> Self {
        self.subtitle = subtitle.to_owned();
        self
    }

    /// Begins a section.
    #[must_use]
    pub fn heading(self, heading: &str) -> Self {
        self.with(Part::Heading(heading.to_owned()))
    }

    /// Adds a paragraph.
    #[must_use]
    pub fn text(self, text: &str) -> Self {
        self.with(Part::Text(text.to_owned()))
    }

    /// Adds lines for a shell, one below the other, to be copied.
    #[must_use]
    pub fn commands(self, lines: impl IntoIterator<Item = impl Into<String>>) -> Self {
        self.with(Part::Commands(lines.into_iter().map(Into::into).collect()))
    }

    /// Adds a list of points.
    #[must_use]
    pub fn list(self, points: impl IntoIterator<Item = impl Into<String>>) -> Self {
        self.with(Part::List(points.into_iter().map(Into::into).collect()))
    }

    /// Adds a row of key figures.
    #[must_use]
    pub fn summary(self, figures: impl IntoIterator<Item = KeyFigure>) -> Self {
        self.with(Part::Figures(figures.into_iter().collect()))
    }

    /// Adds a table.
    #[must_use]
    pub fn table(self, table: Table) -> Self {
        self.with(Part::Table(table))
    }

    /// Adds a plot.
    #[must_use]
    pub fn plot(self, plot: Plot) -> Self {
        self.with(Part::Plot(Box::new(plot)))
    }

    /// Adds a text as it is, in a fixed-width font, folded away behind its name: a configuration.
    #[must_use]
    pub fn verbatim(self, name: &str, text: &str) -> Self {
        self.with(Part::Verbatim { name: name.to_owned(), text: text.to_owned() })
    }

    /// The whole page.
    pub fn to_html(&self) -> String {
        let title = escape(&self.title);
        let mut out = format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n<meta name=\"color-scheme\" content=\"light dark\"/>\n<title>{title}</title>\n<style>\n{}{}</style>\n</head>\n<body>\n<main>\n<header><h1>{title}</h1>",
            include_str!("report.css"),
            dark_pictures(),
        );
        // Writing to a String cannot fail.
        if !self.subtitle.is_empty() {
            let _ = write!(out, "<p class=\"subtitle\">{}</p>", escape(&self.subtitle));
        }
        out.push_str("</header>\n");
        for (index, part) in self.parts.iter().enumerate() {
            out.push_str(&part.to_html(index));
            out.push('\n');
        }
        out.push_str("</main>\n");
        let plots = self.parts.iter().enumerate().filter_map(|(index, part)| match part {
            Part::Plot(plot) => Some((plot_name(index), plot.as_ref())),
            _ => None,
        });
        out.push_str(&scripts(&plots.collect::<Vec<_>>()));
        out.push_str("</body>\n</html>\n");
        out
    }

    fn with(mut self, part: Part) -> Self {
        self.parts.push(part);
        self
    }
}

/// A plot's name, unlike that of every other on the page.
fn plot_name(index: usize) -> String {
    format!("plot{index}")
}

/// The pictures' dark colours: where the reader's system is dark, and where he chose it; never on paper.
fn dark_pictures() -> String {
    format!(
        "@media screen and (prefers-color-scheme: dark) {{{}}}\n@media screen {{{}}}\n",
        dark_rules(":root:not([data-theme=light])"),
        dark_rules(":root[data-theme=dark]")
    )
}

impl Part {
    fn to_html(&self, index: usize) -> String {
        match self {
            Self::Heading(heading) => format!("<h2>{}</h2>", escape(heading)),
            Self::Text(text) => format!("<p>{}</p>", escape(text)),
            Self::Commands(lines) if lines.is_empty() => String::new(),
            Self::Commands(lines) => format!("<pre>{}</pre>", escape(&lines.join("\n"))),
            Self::List(points) => {
                let points: String = points.iter().map(|point| format!("<li>{}</li>", escape(point))).collect();
                format!("<ul>{points}</ul>")
            }
            Self::Figures(figures) => {
                let figures: String = figures.iter().map(KeyFigure::to_html).collect();
                format!("<div class=\"figures\">{figures}</div>")
            }
            Self::Table(table) => table.to_html(),
            Self::Plot(plot) => {
                let caption = plot.caption.as_deref().map(|text| format!("<p>{}</p>", escape(text)));
                format!(
                    "<figure><figcaption><h3>{}</h3>{}</figcaption>{}</figure>",
                    escape(&plot.title),
                    caption.unwrap_or_default(),
                    plot.to_svg(&plot_name(index))
                )
            }
            Self::Verbatim { name, text } => {
                format!("<details><summary>{}</summary><pre>{}</pre></details>", escape(name), escape(text))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figures_numbers_have_a_true_minus_and_its_words_keep_their_hyphens() {
        let html = KeyFigure::new("worst", "126.4 / -80.8 kPa, re-fitted").to_html();
        assert!(html.contains(">126.4 / \u{2212}80.8 kPa, re-fitted<"), "{html}");
    }
}
