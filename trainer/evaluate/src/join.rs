//! Tables of one kind put together: what was flown on another day or machine, or the optimum, beside the rest.

use crate::table::{OPTIMUM, Row, Table};

/// Reason why two tables are not of one kind; files are named as they were given.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum JoinError {
    /// Other columns.
    #[error("{file}: its columns are {}, those of {first} {}; join tables of the same columns", .columns.join(", "), .expected.join(", "))]
    Columns {
        /// The later table.
        file: String,
        /// Columns.
        columns: Vec<String>,
        /// The first table.
        first: String,
        /// Columns.
        expected: Vec<String>,
    },
    /// Nothing tells whether the rigs are the same.
    #[error(
        "{file}: no controller stands here and in the tables before, so nothing tells whether the rigs are the same; \
         put a table with one of both between them"
    )]
    NothingInCommon {
        /// The later table.
        file: String,
    },
    /// An entrant of both does not fly alike.
    #[error(
        "{file}: {entrant} errs by {here:.3} kPa on rig {rig} of {column} and by {there:.3} kPa in the tables before: \
         these are other rigs, or another reference"
    )]
    OtherRigs {
        /// The later table.
        file: String,
        /// Who flies in both.
        entrant: String,
        /// Where.
        column: String,
        /// Which of the column's rigs, from 1.
        rig: usize,
        /// RMSE in the later table, in kPa.
        here: f64,
        /// RMSE before, in kPa.
        there: f64,
    },
}

/// Change that other noise may make to an error: a fifth of it, or this many kPa.
const NOISE_SHARE: f64 = 0.2;
const NOISE_KPA: f64 = 0.02;

/// Adds to a table the rows of later ones (each with the name of its file) whose entrants it lacks; the optimum comes last.
///
/// A row's numbers are those of its own table. That the rigs are the same is judged by the entrants that fly in several
/// tables: rig by rig their errors may differ by no more than other noise does to them (a fifth, or 0.02 kPa).
///
/// # Errors
/// Other columns, no entrant in common, an entrant that does not fly alike.
pub fn joined(first: (String, Table), later: Vec<(String, Table)>) -> Result<Table, JoinError> {
    let (first_file, mut table) = first;
    table.provenance = told_of(&first_file, table.provenance);
    for (file, other) in later {
        if other.columns != table.columns {
            let (columns, expected) = (other.columns, table.columns);
            return Err(JoinError::Columns { file, columns, first: first_file, expected });
        }
        let same = |row: &Row| table.rows.iter().find(|known| known.entrant == row.entrant);
        let common: Vec<(&Row, &Row)> = other.rows.iter().filter_map(|row| Some((row, same(row)?))).collect();
        if common.is_empty() {
            return Err(JoinError::NothingInCommon { file });
        }
        for (here, there) in common {
            flew_alike(&file, &table.columns, here, there)?;
        }
        let new: Vec<Row> = other.rows.into_iter().filter(|row| same(row).is_none()).collect();
        table.rows.extend(new);
        table.notes.extend(other.notes.into_iter().filter(|note| !table.notes.contains(note)).collect::<Vec<_>>());
        table.provenance.extend(told_of(&file, other.provenance));
    }
    // Stable: everybody else stays in order.
    table.rows.sort_by_key(|row| row.entrant == OPTIMUM);
    Ok(table)
}

fn told_of(file: &str, provenance: Vec<(String, String)>) -> Vec<(String, String)> {
    provenance.into_iter().map(|(key, value)| (format!("{file}: {key}"), value)).collect()
}

fn flew_alike(file: &str, columns: &[String], here: &Row, there: &Row) -> Result<(), JoinError> {
    for ((column, here_cell), there_cell) in columns.iter().zip(&here.cells).zip(&there.cells) {
        for (n, (a, b)) in here_cell.rigs_kpa.iter().zip(&there_cell.rigs_kpa).enumerate() {
            for (a, b) in a.iter().zip(b) {
                if (a - b).abs() > (NOISE_SHARE * b).max(NOISE_KPA) {
                    return Err(JoinError::OtherRigs {
                        file: file.to_owned(),
                        entrant: here.entrant.clone(),
                        column: column.clone(),
                        rig: n + 1,
                        here: *a,
                        there: *b,
                    });
                }
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::Cell;
    use environment::Score;

    fn row(entrant: &str, rmse: f64) -> Row {
        let score = |rmse_kpa| Score { rmse_kpa, offset_kpa: [0.0; 2], worst_kpa: [0.0; 2], duty_change_rms: [0.0; 2] };
        let cell = Cell::of(&[vec![score([rmse, rmse]), score([2.0 * rmse, rmse])]]);
        Row { entrant: entrant.into(), seeds: 1, cells: vec![cell] }
    }

    fn table(rows: Vec<Row>) -> Table {
        Table {
            title: "t".into(),
            columns: vec!["2 rigs".into()],
            rows,
            paper: vec![],
            notes: vec!["once".into()],
            provenance: vec![("command".into(), "c".into())],
        }
    }

    fn join(first: Table, later: Table) -> Result<Table, JoinError> {
        joined(("a.json".into(), first), vec![("b.json".into(), later)])
    }

    #[test]
    fn rows_come_once_and_the_limit_last() {
        let first = table(vec![row("PI", 0.2), row(OPTIMUM, 0.1), row("ours", 0.15)]);
        let later = table(vec![row("PI", 0.21), row("theirs", 0.3)]);
        let table = join(first, later).unwrap();
        let names: Vec<&str> = table.rows.iter().map(|row| row.entrant.as_str()).collect();
        assert_eq!(names, ["PI", "ours", "theirs", OPTIMUM]);
        assert_eq!(table.rows[0].cells[0].rmse_kpa[1], 0.2, "a row's numbers are those of the first table that has it");
        assert_eq!(table.notes, ["once"]);
        let keys: Vec<&str> = table.provenance.iter().map(|(key, _)| key.as_str()).collect();
        assert_eq!(keys, ["a.json: command", "b.json: command"]);
    }

    #[test]
    fn tables_of_other_rigs_are_refused() {
        let first = || table(vec![row("PI", 0.2)]);
        let mut renamed = first();
        renamed.columns = vec!["bench".into()];
        let problem = |later: Table| join(first(), later).unwrap_err().to_string();
        assert!(problem(renamed).contains("b.json: its columns are bench, those of a.json 2 rigs"));
        assert!(problem(table(vec![row("theirs", 0.2)])).contains("b.json: no controller stands here"));
        let other = problem(table(vec![row("PI", 0.3)]));
        assert!(other.contains("PI errs by 0.300 kPa on rig 1 of 2 rigs and by 0.200"), "{other}");
    }
}
