//! MPObs predictions against what came.
//!
//! A prediction made in tick k for tick k + h is compared with the reading of tick k + h:
//!
//! ```text
//! d_h(k + h) = measured(k + h) − predicted_h(k)
//! ```
//!
//! Beside it stands the simplest prediction there is, that nothing changes:
//! measured(k + h) − measured(k). A model that does not beat it is no use to the controller. Both carry
//! the noise of the sensor, twice: once in the reading that the prediction started from, once in the
//! reading that it is compared with; no model gets below that.

use proto::recording::PREDICTED_TICKS;

use crate::flight_rows::Flight;

/// Predictions of one channel, horizon by horizon, over the rows of the flight.
#[derive(Debug)]
pub(crate) struct PredictionCheck {
    /// Measured (kPa gauge).
    pub(crate) measured: Vec<f64>,
    horizons: Vec<Horizon>,
}

/// One horizon over the rows of the flight; NaN where there is nothing to compare.
#[derive(Debug)]
pub(crate) struct Horizon {
    /// Prediction for this row, made that many ticks before (kPa gauge).
    pub(crate) predicted: Vec<f64>,
    /// Measured − predicted (kPa).
    pub(crate) error: Vec<f64>,
    /// Measured − measured that many ticks before (kPa).
    pub(crate) unchanged_error: Vec<f64>,
}

impl PredictionCheck {
    /// The predictions of a channel: 0 positive, 1 negative.
    pub(crate) fn of(flight: &Flight<'_>, channel: usize) -> Self {
        let measured = flight.column(|tick| if channel == 0 { tick.p_pos_kpa } else { tick.p_neg_kpa });
        let number = flight.column(|tick| f64::from(tick.tick));
        let session = flight.column(|tick| f64::from(tick.session));
        let horizons = (1..=PREDICTED_TICKS)
            .map(|horizon| {
                let made = flight.column(|tick| {
                    let all = if channel == 0 { &tick.predicted_pos_kpa } else { &tick.predicted_neg_kpa };
                    all.get(horizon - 1).copied().unwrap_or(f64::NAN)
                });
                // The row that many rows before, when it is that many ticks before in the same session.
                let from = |values: &[f64], row: usize| {
                    let before = row.checked_sub(horizon)?;
                    let ticks = number.get(row)? - number.get(before)?;
                    let same = ticks == horizon as f64 && session.get(row)? == session.get(before)?;
                    values.get(before).copied().filter(|_| same)
                };
                let carried = |values: &[f64]| -> Vec<f64> {
                    (0..measured.len()).map(|row| from(values, row).unwrap_or(f64::NAN)).collect()
                };
                let (predicted, unchanged) = (carried(&made), carried(&measured));
                let error = |from: &[f64]| measured.iter().zip(from).map(|(p, from)| p - from).collect();
                Horizon { error: error(&predicted), unchanged_error: error(&unchanged), predicted }
            })
            .collect();
        Self { measured, horizons }
    }

    /// A horizon from 1 to 5 ticks.
    pub(crate) fn horizon(&self, ticks: usize) -> Option<&Horizon> {
        self.horizons.get(ticks.checked_sub(1)?)
    }

    /// Tells whether the longest prediction is worse than none.
    pub(crate) fn loses_to_nothing(&self, counts: &[bool]) -> bool {
        let figures = self.horizons.last().map(|last| (rms(&last.error, counts), rms(&last.unchanged_error, counts)));
        matches!(figures, Some((Some(predicted), Some(unchanged))) if predicted > unchanged)
    }

    /// All horizons, from 1 tick on.
    pub(crate) fn horizons(&self) -> impl Iterator<Item = &Horizon> {
        self.horizons.iter()
    }
}

/// Root of the mean square over the rows that count; `None` without a finite one.
pub(crate) fn rms(values: &[f64], counts: &[bool]) -> Option<f64> {
    let squares = values.iter().zip(counts).filter(|(value, counts)| **counts && value.is_finite());
    let (sum, number) = squares.fold((0.0, 0_u64), |(sum, number), (value, _)| (sum + value * value, number + 1));
    (number > 0).then(|| (sum / number as f64).sqrt())
}

/// Root of the mean square over the `rows` around each row; NaN where fewer than half are finite.
pub(crate) fn rolling_rms(values: &[f64], rows: usize) -> Vec<f64> {
    let half = rows / 2;
    // Prefix sums: the cost does not grow with the window.
    let mut sums = vec![(0.0, 0_usize)];
    let mut at = (0.0, 0);
    for value in values {
        if value.is_finite() {
            at = (at.0 + value * value, at.1 + 1);
        }
        sums.push(at);
    }
    let between = |row: usize| {
        let (from, to) = (row.saturating_sub(half), (row + half + 1).min(values.len()));
        let (first, last) = (sums.get(from)?, sums.get(to)?);
        let number = last.1 - first.1;
        (2 * number >= to - from && number > 0).then(|| ((last.0 - first.0).max(0.0) / number as f64).sqrt())
    };
    (0..values.len()).map(|row| between(row).unwrap_or(f64::NAN)).collect()
}

/// The `rows` neighbouring rows, all of which count, in which the sum of squares is largest.
pub(crate) fn worst_window(values: &[f64], counts: &[bool], rows: usize) -> Option<std::ops::Range<usize>> {
    let mut best: Option<(f64, usize)> = None;
    let (mut run, mut sum) = (0, 0.0);
    let square = |row: usize| values.get(row).copied().filter(|value| value.is_finite()).map_or(0.0, |v| v * v);
    for (row, counts) in counts.iter().enumerate() {
        if !counts {
            (run, sum) = (0, 0.0);
            continue;
        }
        run += 1;
        sum += square(row);
        if run > rows {
            sum -= square(row - rows);
        }
        if run >= rows && best.is_none_or(|(most, _)| sum > most) {
            best = Some((sum, row + 1));
        }
    }
    best.map(|(_, end)| end - rows..end)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::StatisticsOptions;
    use proto::recording::TickRecord;

    #[test]
    fn predictions_meet_the_tick_they_were_made_for() {
        // p = k²; the prediction for h ticks ahead is k² + 10 h, so d_h = (k+h)² − k² − 10 h.
        let square = |k: u32| f64::from(k * k);
        let tick = |session: u32, k: u32| TickRecord {
            session,
            tick: k,
            p_pos_kpa: square(k),
            predicted_pos_kpa: std::array::from_fn(|h| square(k) + 10.0 * (h + 1) as f64),
            ..TickRecord::default()
        };
        // Ticks 0 … 7, a hole at 8, then 9 … 12, then another session.
        let mut ticks: Vec<TickRecord> = (0..13).filter(|k| *k != 8).map(|k| tick(1, k)).collect();
        ticks.push(tick(2, 13));
        let flight = Flight::new(&ticks, StatisticsOptions::default());
        let check = PredictionCheck::of(&flight, 0);
        let one = check.horizon(1).unwrap();
        let five = check.horizon(5).unwrap();
        // 14 rows: 8 ticks, the hole, 4 ticks, the other session's tick.
        assert_eq!(one.error.len(), 14);
        for k in 1..8_u32 {
            assert_eq!(one.error[k as usize], square(k) - square(k - 1) - 10.0, "tick {k}");
        }
        assert!(one.error[0].is_nan() && one.error[8].is_nan() && one.error[9].is_nan() && one.error[13].is_nan());
        assert_eq!(one.error[10], 100.0 - 81.0 - 10.0);
        assert_eq!(five.error[5], 25.0 - 0.0 - 50.0);
        assert_eq!(five.predicted[7], 4.0 + 50.0);
        assert_eq!(five.unchanged_error[7], 49.0 - 4.0);
        // Row 12 is tick 12 and row 7 tick 7, five ticks before, across the hole's row.
        assert_eq!(five.error[12], 144.0 - 49.0 - 50.0);
        assert!(check.horizon(0).is_none() && check.horizon(6).is_none());
    }

    #[test]
    fn means_by_hand() {
        let values = [3.0, 4.0, f64::NAN, 100.0];
        assert_eq!(rms(&values, &[true, true, true, false]), Some(12.5_f64.sqrt()));
        assert_eq!(rms(&values, &[false; 4]), None);
        let rolled = rolling_rms(&[1.0, 1.0, 7.0, f64::NAN, f64::NAN], 3);
        assert_eq!(rolled[0], 1.0);
        assert!((rolled[1] - 17.0_f64.sqrt()).abs() < 1e-12, "{rolled:?}");
        assert!((rolled[2] - 25.0_f64.sqrt()).abs() < 1e-12 && rolled[3].is_nan() && rolled[4].is_nan(), "{rolled:?}");
        let counts = [true, true, true, true, false, true, true];
        assert_eq!(worst_window(&[9.0, 0.0, 1.0, 2.0, 50.0, 1.0, 1.0], &counts, 2), Some(0..2));
        assert_eq!(worst_window(&[0.0, 0.0, 1.0, 2.0, 50.0, 1.0, 1.0], &counts, 2), Some(2..4));
        assert_eq!(worst_window(&[1.0; 7], &counts, 5), None);
    }
}
