//! Rates at which the sensors of a file were read: in every row, or less often, with each reading standing there until the next one.
//!
//! Only the rows in which a sensor was read are evidence on it, whoever wrote the file: a logger that is quicker than its sensors, or the
//! daemon with a cRIO that holds them.

use super::lost_rows::Missing;
use super::own_rows::OwnRows;
use super::repeated::{self, Held, Sensors};
use super::resample::{Kind, Resampling};
use crate::recording::csv::Column;

/// Rates at which the sensors of a file were read.
#[derive(Debug)]
pub(crate) enum HowRead {
    /// In every row, or in all those in which any of them was.
    EveryRow,
    /// All of them together, each reading standing there so many times.
    Together {
        /// By row, whether it is the first one with its readings.
        fresh: Vec<bool>,
        /// Rows for each reading.
        rows_a_reading: usize,
    },
    /// Each of them in rows of its own.
    Own(OwnRows),
}

impl HowRead {
    /// Finds it out, and brings times and columns to rows in which each sensor has readings of its own where that is so, with straight
    /// lines between; with it the rows that are kept, where some are left out.
    ///
    /// # Errors
    /// The place among the sensors of one that was hardly ever read when the others were.
    pub(crate) fn find(
        file: &str,
        time_s: &mut Vec<f64>,
        columns: &mut [(Column, Kind)],
        missing: &mut Missing,
    ) -> Result<(Self, Option<Vec<usize>>), usize> {
        let numbers = readings(columns);
        let is_uneven = |of: &&[f64]| Held::of(time_s, of).is_some_and(|held| !held.is_even());
        let together = repeated::fresh(time_s, &numbers)
            .filter(|_| Resampling::new(time_s).is_as_it_was() && !numbers.iter().any(is_uneven));
        if let Some((fresh, rows_a_reading)) = together {
            return Ok((HowRead::Together { fresh, rows_a_reading }, None));
        }
        let own = OwnRows::put(file, time_s, columns, missing)?;
        Ok(own.map_or((HowRead::EveryRow, None), |(own, kept)| (HowRead::Own(own), Some(kept))))
    }

    /// Takes only rows for readings in which a sensor was read.
    pub(crate) fn mark(&self, resampling: &mut Resampling<'_>) {
        match self {
            HowRead::EveryRow => {}
            HowRead::Together { fresh, rows_a_reading } => {
                resampling.only(fresh, Sensors::Repeated(*rows_a_reading));
            }
            HowRead::Own(own) => resampling.only(&own.any(), Sensors::Own(own.rows_a_reading)),
        }
    }

    /// By sensor that lacks readings its column, and by row of a resampling whether it has none there: for it was not read, or one is
    /// `missing`.
    pub(crate) fn lacking(
        &self,
        missing: &[(String, Vec<bool>)],
        resampling: &Resampling<'_>,
    ) -> Vec<(String, Vec<bool>)> {
        let mut lacking = match self {
            HowRead::Own(own) => own.missing_of(resampling),
            _ => Vec::new(),
        };
        // Where a sensor has rows of its own these know of its missing readings as well.
        let now_and_then: Vec<_> = missing
            .iter()
            .filter(|(name, _)| lacking.iter().all(|(own, _)| own != name))
            .map(|(name, of)| (name.clone(), resampling.missing_of(of)))
            .collect();
        lacking.extend(now_and_then);
        lacking
    }

    /// Remarks on it.
    pub(crate) fn notes(&self) -> &[String] {
        match self {
            HowRead::Own(own) => &own.notes,
            // Told with how the samples were brought to rows.
            _ => &[],
        }
    }
}

/// The numbers of all sensors' columns.
pub(crate) fn readings(columns: &[(Column, Kind)]) -> Vec<&[f64]> {
    let of = columns.iter().filter(|(_, kind)| *kind == Kind::Reading);
    of.filter_map(|(column, _)| column.numbers()).collect()
}
