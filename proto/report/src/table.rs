//! Tables: a header, rows of texts; columns of numbers stand right.

use std::fmt::Write;

use crate::axis::with_minus;
use crate::markup::escape;

/// A table of texts.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Table {
    columns: Vec<String>,
    rows: Vec<Vec<String>>,
    caption: Option<String>,
}

impl Table {
    /// An empty table with the names of its columns; units belong into the names.
    pub fn new(columns: impl IntoIterator<Item = impl Into<String>>) -> Self {
        Self { columns: columns.into_iter().map(Into::into).collect(), ..Self::default() }
    }

    /// Adds a row; missing cells stay empty, cells beyond the columns are left out.
    #[must_use]
    pub fn row(mut self, cells: impl IntoIterator<Item = impl Into<String>>) -> Self {
        self.push(cells);
        self
    }

    /// Adds a row, as [`Table::row`], to a table in a loop.
    pub fn push(&mut self, cells: impl IntoIterator<Item = impl Into<String>>) {
        let mut cells: Vec<String> = cells.into_iter().map(Into::into).take(self.columns.len()).collect();
        cells.resize(self.columns.len(), String::new());
        self.rows.push(cells);
    }

    /// A sentence above the table.
    #[must_use]
    pub fn caption(mut self, caption: &str) -> Self {
        self.caption = Some(caption.to_owned());
        self
    }

    pub(crate) fn to_html(&self) -> String {
        let numbers: Vec<bool> = (0..self.columns.len()).map(|column| self.holds_numbers(column)).collect();
        let class = |number: bool| if number { " class=\"number\"" } else { "" };
        let mut out = String::new();
        // Outside of what scrolls: a sentence that is as wide as its table cannot be read on a phone.
        if let Some(caption) = &self.caption {
            // Writing to a String cannot fail.
            let _ = write!(out, "<p class=\"caption\">{}</p>", escape(caption));
        }
        out.push_str("<div class=\"scroll\"><table>");
        out.push_str("<thead><tr>");
        for (column, number) in self.columns.iter().zip(&numbers) {
            let _ = write!(out, "<th scope=\"col\"{}>{}</th>", class(*number), escape(column));
        }
        out.push_str("</tr></thead><tbody>");
        for row in &self.rows {
            out.push_str("<tr>");
            for (cell, number) in row.iter().zip(&numbers) {
                let text = if *number || cell.parse::<f64>().is_ok() { with_minus(cell) } else { cell.clone() };
                let _ = write!(out, "<td{}>{}</td>", class(*number), escape(&text));
            }
            out.push_str("</tr>");
        }
        out.push_str("</tbody></table></div>");
        out
    }

    /// Tells whether every filled cell of a column begins like a number, and one is filled; a time of day is none.
    fn holds_numbers(&self, column: usize) -> bool {
        let mut filled = self.rows.iter().filter_map(|row| row.get(column)).filter(|cell| !cell.is_empty()).peekable();
        filled.peek().is_some()
            && filled.all(|cell| {
                let rest = cell.trim_start_matches(['-', '+', '\u{2212}', '±', '<', '>', '≤', '≥', ' ']);
                (rest.starts_with(|c: char| c.is_ascii_digit()) && !rest.contains(':'))
                    || ["–", "—", "n/a"].contains(&cell.as_str())
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_of_numbers_are_told_from_texts() {
        let table = Table::new(["channel", "rmse", "share", "note"])
            .row(["positive", "0.12", "−3 %", "1 of 2"])
            .row(["negative", "n/a", "", "none"]);
        let holds: Vec<bool> = (0..4).map(|column| table.holds_numbers(column)).collect();
        assert_eq!(holds, [false, true, true, false]);
    }

    #[test]
    fn numbers_have_a_true_minus_and_texts_keep_their_hyphens() {
        let html = Table::new(["gain", "rig"]).row(["-3.1", "re-identified"]).row(["1", "-0.2"]).to_html();
        assert!(html.contains("<td class=\"number\">\u{2212}3.1</td><td>re-identified</td>"), "{html}");
        assert!(html.contains("<td>\u{2212}0.2</td>"), "a number among texts: {html}");
    }

    #[test]
    fn rows_are_made_to_fit_and_cells_are_escaped() {
        let html = Table::new(["a<b"]).row(["<i>", "left out"]).row([] as [&str; 0]).to_html();
        assert!(html.contains("a&lt;b") && html.contains("<td>&lt;i&gt;</td></tr><tr><td></td></tr>"), "{html}");
        assert!(!html.contains("left out"));
    }
}
