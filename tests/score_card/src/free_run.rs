//! Free runs on the held-out recording, beside what the hidden rig did there.
//!
//! ```text
//! share of the achievable gain  G = (MSE_refit − MSE_tool) / (MSE_refit − MSE_floor)
//! ```
//! with mean squares over both channels, against the trace without noise. `refit` is the rig whose parameters alone were
//! fitted. The floor is what the case's nuisances leave after a refit, to first order: a bar that a fit with the true
//! effect reaches only if its law can follow the hidden rig's, so G is stated on the strict side.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

/// Root mean square error of a free run (kPa), positive and negative channel.
pub type Error = [f64; 2];

/// Held-out errors of the three rigs.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct HeldOut {
    /// The rig as it was given.
    pub nominal_kpa: Option<Error>,
    /// Parameters alone fitted.
    pub refit_kpa: Option<Error>,
    /// The first answer's rig.
    pub first_kpa: Option<Error>,
    /// The last answer's rig.
    pub extended_kpa: Option<Error>,
    /// Error that nuisances leave (kPa).
    pub floor_kpa: Error,
    /// Noise of the readings (kPa).
    pub noise_kpa: Error,
}

/// A gain that is worth a share: root of the difference of mean squares (kPa), as a share of the noise.
const WORTH: f64 = 0.5;

/// Root of the mean of both channels' squares (kPa).
pub fn root_mean_square(error: Error) -> f64 {
    mean_square(error).sqrt()
}

fn mean_square(error: Error) -> f64 {
    0.5 * (error[0] * error[0] + error[1] * error[1])
}

impl HeldOut {
    /// The mean square that could be gained over the refit (kPa²), if it is worth speaking of beside the noise.
    pub fn achievable(&self) -> Option<f64> {
        let gain = mean_square(self.refit_kpa?) - mean_square(self.floor_kpa);
        (gain > WORTH * WORTH * mean_square(self.noise_kpa)).then_some(gain)
    }

    /// Share of it that the last answer's rig recovers; below 0 where it runs worse than the refit.
    pub fn share(&self) -> Option<f64> {
        let gained = mean_square(self.refit_kpa?) - mean_square(self.extended_kpa?);
        // Beyond the floor there is nothing to gain: better than it is luck.
        Some((gained / self.achievable()?).min(1.0))
    }
}

/// Why two traces cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum TraceError {
    /// A file cannot be read as a table.
    #[error("{}: {source}", file.display())]
    Table {
        /// The file.
        file: PathBuf,
        /// Error of the CSV reader.
        source: csv::Error,
    },
    /// A column is missing or a cell is no number.
    #[error("{}: column {column} is missing or holds what is no number", file.display())]
    Column {
        /// The file.
        file: PathBuf,
        /// The column.
        column: &'static str,
    },
    /// The rows do not match.
    #[error("{}: {rows} rows where {expected} are expected", file.display())]
    Rows {
        /// The file.
        file: PathBuf,
        /// Rows.
        rows: usize,
        /// Number that there should be.
        expected: usize,
    },
}

/// The pressures of a recording (kPa gauge).
///
/// # Errors
/// No table, a column is missing, or a cell is no number.
pub fn pressures(file: &Path) -> Result<Vec<[f64; 2]>, TraceError> {
    let table = |source| TraceError::Table { file: file.to_owned(), source };
    let mut reader = csv::Reader::from_path(file).map_err(table)?;
    let header = reader.headers().map_err(table)?.clone();
    let missing = |column| TraceError::Column { file: file.to_owned(), column };
    let find = |column: &'static str| header.iter().position(|name| name == column).ok_or_else(|| missing(column));
    let at = [find("p_pos_kpa")?, find("p_neg_kpa")?];
    let mut rows = Vec::new();
    for record in reader.records() {
        let record = record.map_err(table)?;
        let cell = |k: usize, column| {
            let value = record.get(at[k]).and_then(|text| text.parse::<f64>().ok());
            value.filter(|value| value.is_finite()).ok_or_else(|| missing(column))
        };
        rows.push([cell(0, "p_pos_kpa")?, cell(1, "p_neg_kpa")?]);
    }
    Ok(rows)
}

/// Root mean square error of a simulated file against a clean one (kPa), by channel.
///
/// # Errors
/// A file cannot be read, or their rows do not match.
pub fn error(simulated: &Path, clean: &Path) -> Result<Error, TraceError> {
    let (ours, truth) = (pressures(simulated)?, pressures(clean)?);
    if ours.len() != truth.len() || truth.is_empty() {
        return Err(TraceError::Rows { file: simulated.to_owned(), rows: ours.len(), expected: truth.len() });
    }
    let square = |c: usize| ours.iter().zip(&truth).map(|(a, b)| (a[c] - b[c]).powi(2)).sum::<f64>();
    Ok([0, 1].map(|c| (square(c) / truth.len() as f64).sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_that_can_be_gained_is_one_and_a_worse_rig_is_negative() {
        let held_out = |extended: f64| HeldOut {
            nominal_kpa: Some([9.0; 2]),
            refit_kpa: Some([1.0; 2]),
            first_kpa: None,
            extended_kpa: Some([extended; 2]),
            floor_kpa: [0.1; 2],
            noise_kpa: [0.08; 2],
        };
        assert!((held_out(0.1).share().unwrap_or_default() - 1.0).abs() < 1e-12);
        assert!((held_out(1.0).share().unwrap_or(1.0)).abs() < 1e-12);
        assert!(held_out(2.0).share().unwrap_or_default() < 0.0);
        // A refit at the floor leaves nothing to gain: no share is stated.
        let nothing = HeldOut { refit_kpa: Some([0.105; 2]), ..held_out(0.1) };
        assert_eq!(nothing.share(), None);
    }
}
