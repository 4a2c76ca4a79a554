//! A table of the paper: who controlled what, how well, with its spread; as JSON, Markdown and page.

use report::{Color, Panel, Plot, Report, Table as Page};
use serde::{Deserialize, Serialize};

/// Figures of one entrant on one rig: means over runs, and their spread (standard deviation over seeds).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// RMSE of the measured pressures after the first 5 s, in kPa; positive, negative.
    pub rmse_kpa: [f64; 2],
    /// Spread over seeds, in kPa; 0 with one seed.
    pub spread_kpa: [f64; 2],
    /// Worst RMSE of any run in the cell, in kPa.
    pub worst_kpa: [f64; 2],
    /// RMS of the duty's change per tick.
    pub duty_change_rms: [f64; 2],
    /// Runs that the cell is the mean of.
    pub flights: usize,
    /// RMSE on each rig of the column, mean over seeds, in kPa.
    pub rigs_kpa: Vec<[f64; 2]>,
}

/// One entrant.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Who controlled.
    #[serde(deserialize_with = "crate::present_names::one")]
    pub entrant: String,
    /// Number of trainings or noise seeds.
    pub seeds: usize,
    /// One cell for each column.
    pub cells: Vec<Cell>,
}

/// A table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Table {
    /// Title.
    pub title: String,
    /// Rig that is controlled in each column.
    #[serde(deserialize_with = "crate::present_names::each")]
    pub columns: Vec<String>,
    /// Entrants.
    pub rows: Vec<Row>,
    /// The paper's own figures, where it has such a table: entrant, positive and negative RMSE in kPa on its rig.
    pub paper: Vec<(String, [f64; 2])>,
    /// Notes that a reader must know.
    #[serde(deserialize_with = "crate::present_names::each")]
    pub notes: Vec<String>,
    /// Command, versions, seeds: how to make it again.
    pub provenance: Vec<(String, String)>,
}

/// The row that others are multiples of.
pub const OPTIMUM: &str = "clairvoyant optimum (rig and reference known)";

impl Cell {
    /// The mean of runs' figures, spread over groups of one seed each.
    pub fn of(seeds: &[Vec<environment::Score>]) -> Self {
        let mean = |values: &mut dyn Iterator<Item = f64>| {
            let (mut sum, mut count) = (0.0, 0.0);
            for value in values {
                sum += value;
                count += 1.0;
            }
            sum / count
        };
        let flights = || seeds.iter().flatten();
        let by_seed = |c: usize| -> Vec<f64> {
            seeds.iter().map(|flights| mean(&mut flights.iter().map(|s| s.rmse_kpa[c]))).collect()
        };
        let spread = |c: usize| {
            let values = by_seed(c);
            if values.len() < 2 {
                return 0.0;
            }
            let middle = mean(&mut values.iter().copied());
            (values.iter().map(|v| (v - middle).powi(2)).sum::<f64>() / (values.len() - 1) as f64).sqrt()
        };
        let each = |f: &dyn Fn(usize) -> f64| std::array::from_fn(f);
        Cell {
            rmse_kpa: each(&|c| mean(&mut by_seed(c).into_iter())),
            spread_kpa: each(&spread),
            worst_kpa: each(&|c| flights().fold(0.0, |worst: f64, s| worst.max(s.rmse_kpa[c]))),
            duty_change_rms: each(&|c| mean(&mut flights().map(|s| s.duty_change_rms[c]))),
            flights: flights().count(),
            rigs_kpa: (0..seeds.first().map_or(0, Vec::len))
                .map(|rig| {
                    each(&|c| mean(&mut seeds.iter().filter_map(|flights| flights.get(rig)).map(|s| s.rmse_kpa[c])))
                })
                .collect(),
        }
    }
}

impl Table {
    /// The cell of the clairvoyant optimum in a column.
    fn optimum(&self, column: usize) -> Option<&Cell> {
        self.rows.iter().find(|row| row.entrant == OPTIMUM).and_then(|row| row.cells.get(column))
    }

    /// Text of a cell, in kPa, with the multiple of the optimum where there is one.
    fn words(&self, row: &Row, column: usize) -> String {
        let Some(cell) = row.cells.get(column) else { return String::new() };
        let channel = |c: usize| {
            let spread = if row.seeds > 1 { format!(" ± {:.3}", cell.spread_kpa[c]) } else { String::new() };
            let times = match self.optimum(column) {
                Some(optimum) if row.entrant != OPTIMUM => format!(" ({:.1}×)", cell.rmse_kpa[c] / optimum.rmse_kpa[c]),
                _ => String::new(),
            };
            format!("{:.3}{spread}{times}", cell.rmse_kpa[c])
        };
        format!("{} / {}", channel(0), channel(1))
    }

    /// Words on what the brackets hold; nothing in a table without the optimum, which has none.
    fn words_on_brackets(&self) -> &'static str {
        let has_optimum = self.rows.iter().any(|row| row.entrant == OPTIMUM);
        if has_optimum { "; in brackets multiples of the clairvoyant optimum" } else { "" }
    }

    /// As Markdown: RMSE positive / negative in kPa, spread, multiple of the optimum; then duty changes.
    pub fn to_markdown(&self) -> String {
        let mut text =
            format!("# {}\n\nRMSE of the measured pressures after the first 5 s, positive / negative, kPa", self.title);
        text += &format!(", mean ± spread over seeds{}.\n\n", self.words_on_brackets());
        text += &format!("| | seeds | {} |\n", self.columns.join(" | "));
        text += &format!("| --- | --- |{}\n", " --- |".repeat(self.columns.len()));
        for row in &self.rows {
            let cells: Vec<String> = (0..self.columns.len()).map(|n| self.words(row, n)).collect();
            text += &format!("| {} | {} | {} |\n", row.entrant, row.seeds, cells.join(" | "));
        }
        text += "\nWorst run of each cell, kPa, and RMS of the duty's change per tick:\n\n";
        text += &format!("| | {} |\n| --- |{}\n", self.columns.join(" | "), " --- |".repeat(self.columns.len()));
        for row in &self.rows {
            let cells: Vec<String> = row
                .cells
                .iter()
                .map(|c| {
                    format!(
                        "{:.3} / {:.3}; {:.4} / {:.4}",
                        c.worst_kpa[0], c.worst_kpa[1], c.duty_change_rms[0], c.duty_change_rms[1]
                    )
                })
                .collect();
            text += &format!("| {} | {} |\n", row.entrant, cells.join(" | "));
        }
        text += &self.each_rig();
        if !self.paper.is_empty() {
            text += "\nThe paper, on its own rig:\n\n| | positive | negative |\n| --- | --- | --- |\n";
            for (entrant, [pos, neg]) in &self.paper {
                text += &format!("| {entrant} | {pos} | {neg} |\n");
            }
        }
        for note in &self.notes {
            text += &format!("\n{note}\n");
        }
        text += "\n";
        for (key, value) in &self.provenance {
            text += &format!("- {key}: {value}\n");
        }
        text
    }

    /// Columns that are the mean of several rigs, rig by rig; empty where there are none.
    fn each_rig(&self) -> String {
        let mut text = String::new();
        for (n, column) in self.columns.iter().enumerate() {
            let cells: Vec<&Cell> = self.rows.iter().filter_map(|row| row.cells.get(n)).collect();
            let rigs = cells.iter().map(|cell| cell.rigs_kpa.len()).max().unwrap_or(0);
            if rigs < 2 {
                continue;
            }
            let entrants: Vec<&str> = self.rows.iter().map(|row| row.entrant.as_str()).collect();
            text += &format!("\nEach of {column}, mean over seeds, kPa:\n\n| | {} |\n", entrants.join(" | "));
            text += &format!("| --- |{}\n", " --- |".repeat(entrants.len()));
            for rig in 0..rigs {
                let words = cells.iter().map(|cell| {
                    cell.rigs_kpa.get(rig).map_or(String::new(), |[pos, neg]| format!("{pos:.3} / {neg:.3}"))
                });
                text += &format!("| {} | {} |\n", rig + 1, words.collect::<Vec<_>>().join(" | "));
            }
        }
        text
    }

    /// As a page with a plot: RMSE of every entrant in every column.
    pub fn to_html(&self) -> String {
        let mut page = Report::new(&self.title).text(&format!(
            "RMSE of the measured pressures after the first 5 s, positive / negative, in kPa: mean ± spread over seeds{}.",
            self.words_on_brackets()
        ));
        let mut table = Page::new(std::iter::once("".to_owned()).chain(self.columns.iter().cloned()));
        for row in &self.rows {
            let cells = (0..self.columns.len()).map(|n| self.words(row, n));
            table.push(std::iter::once(row.entrant.clone()).chain(cells));
        }
        page = page.table(table);
        for (n, column) in self.columns.iter().enumerate() {
            let kpa = |c: usize| -> Vec<f64> {
                self.rows.iter().map(|row| row.cells.get(n).map_or(f64::NAN, |cell| cell.rmse_kpa[c])).collect()
            };
            let panel = Panel::new("RMSE (kPa)")
                .log_y()
                .at_names(&[("positive", &kpa(0), Color::Blue), ("negative", &kpa(1), Color::Vermilion)]);
            let names = self.rows.iter().map(|row| row.entrant.clone());
            page = page.plot(Plot::new(column, "controller").x_names(names).panel(panel));
        }
        for note in &self.notes {
            page = page.text(note);
        }
        let mut provenance = Page::new(["made by", ""]);
        for (key, value) in &self.provenance {
            provenance.push([key.clone(), value.clone()]);
        }
        page.table(provenance).to_html()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use environment::Score;

    fn score(rmse: f64) -> Score {
        Score { rmse_kpa: [rmse, 2.0 * rmse], offset_kpa: [0.0; 2], worst_kpa: [0.0; 2], duty_change_rms: [0.01, 0.02] }
    }

    #[test]
    fn cells_are_means_over_seeds_with_their_spread() {
        let cell = Cell::of(&[vec![score(0.1), score(0.3)], vec![score(0.4)]]);
        assert!((cell.rmse_kpa[0] - 0.3).abs() < 1e-12, "mean of 0.2 and 0.4");
        assert!((cell.spread_kpa[0] - 0.02_f64.sqrt()).abs() < 1e-12);
        assert_eq!((cell.worst_kpa[1], cell.flights), (0.8, 3));
    }

    #[test]
    fn a_column_of_several_rigs_is_told_rig_by_rig() {
        let cell = Cell::of(&[vec![score(0.1), score(0.3)], vec![score(0.4), score(0.5)]]);
        assert!((cell.rigs_kpa[0][0] - 0.25).abs() < 1e-12 && (cell.rigs_kpa[1][1] - 0.8).abs() < 1e-12, "{cell:?}");
        let table = Table {
            title: "t".into(),
            columns: vec!["2 rigs".into()],
            rows: vec![Row { entrant: "ours".into(), seeds: 2, cells: vec![cell] }],
            paper: vec![],
            notes: vec![],
            provenance: vec![],
        };
        let markdown = table.to_markdown();
        assert!(markdown.contains("Each of 2 rigs"), "{markdown}");
        for text in [&markdown, &table.to_html()] {
            assert!(!text.contains("optimum"), "there is none, and no bracket: {text}");
        }
        assert!(markdown.contains("| 2 | 0.400 / 0.800 |"), "{markdown}");
    }

    #[test]
    fn rows_are_told_as_multiples_of_the_optimum() {
        let row = |entrant: &str, rmse: f64| Row {
            entrant: entrant.into(),
            seeds: 1,
            cells: vec![Cell::of(&[vec![score(rmse)]])],
        };
        let table = Table {
            title: "t".into(),
            columns: vec!["bench".into()],
            rows: vec![row("ours", 0.3), row(OPTIMUM, 0.1)],
            paper: vec![("Our RL".into(), [0.6935, 0.2646])],
            notes: vec![],
            provenance: vec![("commit".into(), "abc".into())],
        };
        let markdown = table.to_markdown();
        assert!(markdown.contains("0.300 (3.0×) / 0.600 (3.0×)"), "{markdown}");
        for text in [&markdown, &table.to_html()] {
            assert!(text.contains("in brackets multiples of the clairvoyant optimum"), "{text}");
        }
        assert!(markdown.contains("| Our RL | 0.6935 | 0.2646 |"), "{markdown}");
    }
}
