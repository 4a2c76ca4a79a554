//! Distance of a simulated pressure from a recorded one.
//!
//! For recorded gauge pressures p_k and simulated ones s_k:
//!
//! ```text
//! accuracy = 1 − (1/m) Σ |s_k − p_k| / |p_k|     over the m rows with |p_k| ≥ least
//! RMSE     = √( (1/n) Σ (s_k − p_k)² )           over all n rows
//! ```
//!
//! Accuracy is the paper's (§IV-B: one minus the mean absolute percentage error, of gauge pressures). A
//! percentage of nearly nothing says nothing, and one row at 0 kPa would decide the mean, so rows near the
//! atmosphere are left out of it, and counted. Rows without a sample (lost ones, and those between sparse samples) are no rows here.

/// Errors of one channel, summed up.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Errors {
    rows: u64,
    near_zero: u64,
    shares: f64,
    squares: f64,
    worst_kpa: f64,
    worst_time_s: f64,
}

/// One channel, recorded and simulated, row by row.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Compared<'a> {
    /// Times in s.
    pub(crate) time_s: &'a [f64],
    /// Recorded gauge pressures in kPa.
    pub(crate) recorded_kpa: &'a [f64],
    /// Simulated ones.
    pub(crate) simulated_kpa: &'a [f64],
    /// True where a sample was taken, by row; `None` where one was in all.
    pub(crate) measured: Option<&'a [bool]>,
}

impl Errors {
    /// Sums up the rows of one channel; `least_kpa` is the smallest recorded pressure, in gauge kPa, that counts for the accuracy.
    pub(crate) fn of(channel: Compared<'_>, least_kpa: f64) -> Self {
        let mut errors = Errors::default();
        let Compared { time_s, recorded_kpa, simulated_kpa, measured } = channel;
        let rows = time_s.iter().zip(recorded_kpa).zip(simulated_kpa).enumerate();
        let is_measured = |row: usize| measured.is_none_or(|m| m.get(row).copied().unwrap_or(true));
        for (_, ((time, recorded), simulated)) in rows.filter(|(row, _)| is_measured(*row)) {
            let off = (simulated - recorded).abs();
            errors.rows += 1;
            errors.squares += off * off;
            if recorded.abs() >= least_kpa && *recorded != 0.0 {
                errors.shares += off / recorded.abs();
            } else {
                errors.near_zero += 1;
            }
            if off > errors.worst_kpa {
                (errors.worst_kpa, errors.worst_time_s) = (off, *time);
            }
        }
        errors
    }

    /// Both stretches together, every row with the same weight.
    pub(crate) fn and(self, other: Self) -> Self {
        let worst = if other.worst_kpa > self.worst_kpa { other } else { self };
        Errors {
            rows: self.rows + other.rows,
            near_zero: self.near_zero + other.near_zero,
            shares: self.shares + other.shares,
            squares: self.squares + other.squares,
            ..worst
        }
    }

    /// One minus the mean absolute percentage error, as a share (1 is perfect; below 0 is possible); `None`
    /// where no row is far enough from the atmosphere.
    pub(crate) fn accuracy(&self) -> Option<f64> {
        let rows = self.rows - self.near_zero;
        (rows > 0).then(|| 1.0 - self.shares / rows as f64)
    }

    /// Root of the mean squared error, in kPa.
    pub(crate) fn rmse_kpa(&self) -> f64 {
        (self.squares / self.rows.max(1) as f64).sqrt()
    }

    /// The largest error, in kPa, and its time in s.
    pub(crate) fn worst(&self) -> (f64, f64) {
        (self.worst_kpa, self.worst_time_s)
    }

    /// All rows, and those left out of the accuracy.
    pub(crate) fn rows(&self) -> (u64, u64) {
        (self.rows, self.near_zero)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(time_s: &[f64], recorded_kpa: &[f64], simulated_kpa: &[f64], least_kpa: f64) -> Errors {
        Errors::of(Compared { time_s, recorded_kpa, simulated_kpa, measured: None }, least_kpa)
    }

    #[test]
    fn rows_without_a_sample_do_not_count() {
        let (time_s, recorded_kpa, simulated_kpa) = (&[0.0, 0.02, 0.04], &[50.0; 3], &[51.0, 90.0, 49.0]);
        let measured = Some(&[true, false, true][..]);
        let errors = Errors::of(Compared { time_s, recorded_kpa, simulated_kpa, measured }, 5.0);
        assert_eq!((errors.rmse_kpa(), errors.rows(), errors.worst().0), (1.0, (2, 0), 1.0));
    }

    /// By hand: errors 2, −5, 3 kPa on 100, −50 and 1 kPa; the last is near zero.
    #[test]
    fn figures_are_those_worked_out_by_hand() {
        let errors = of(&[0.0, 0.02, 0.04], &[100.0, -50.0, 1.0], &[102.0, -55.0, 4.0], 5.0);
        // 1 − (2/100 + 5/50)/2 = 0.94; (4 + 25 + 9)/3 = 38/3. Sums of three doubles: a few ulp.
        assert!((errors.accuracy().unwrap() - 0.94).abs() < 1e-15);
        assert!((errors.rmse_kpa() - (38.0_f64 / 3.0).sqrt()).abs() < 1e-15);
        assert_eq!((errors.worst(), errors.rows()), ((5.0, 0.02), (3, 1)));
    }

    #[test]
    fn stretches_add_up_to_the_whole() {
        let time: Vec<f64> = (0..9).map(f64::from).collect();
        let recorded: Vec<f64> = time.iter().map(|t| 20.0 * t - 60.0).collect();
        let simulated: Vec<f64> = time.iter().zip(&recorded).map(|(t, p)| p + (t * 1.7).sin()).collect();
        let whole = of(&time, &recorded, &simulated, 5.0);
        let part =
            |rows: std::ops::Range<usize>| of(&time[rows.clone()], &recorded[rows.clone()], &simulated[rows], 5.0);
        let both = part(0..4).and(part(4..9));
        // The same sums in another order.
        assert!((whole.rmse_kpa() - both.rmse_kpa()).abs() < 1e-14);
        assert!((whole.accuracy().unwrap() - both.accuracy().unwrap()).abs() < 1e-14);
        assert_eq!((whole.worst(), whole.rows()), (both.worst(), both.rows()));
    }

    #[test]
    fn without_a_row_away_from_zero_there_is_no_accuracy() {
        assert_eq!(of(&[0.0], &[0.0], &[3.0], 5.0).accuracy(), None);
        assert_eq!(of(&[0.0], &[0.0], &[3.0], 0.0).accuracy(), None);
    }
}
