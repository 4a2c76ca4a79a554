//! Rows whose times are those of the writing: a logger that empties its buffer every so often, and stamps what it writes.
//!
//! Such rows stand close together, so many at a time, with pauses between them that take nearly all of the time. Taken as they stand
//! they would be a fast sampling with a gap after every burst.

/// A pause is longer than the usual step so many times.
const PAUSE_STEPS: f64 = 3.0;
/// Bursts that there are at least.
const LEAST_BURSTS: usize = 8;
/// Rows of a burst, at least: of two, one may well be late.
const LEAST_ROWS: f64 = 2.5;
/// Share of all time that the pauses take at least.
const PAUSED: f64 = 0.6;
/// Share of the bursts, and of the pauses, that are as usual.
const ALIKE: f64 = 0.7;
/// Distance that a usual burst may have from the median, in rows, and a usual pause, as a share.
const ROWS_OFF: usize = 1;
const PAUSE_OFF: f64 = 0.3;

/// Bursts that rows come in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bursts {
    /// Rows of a burst.
    pub(crate) rows: usize,
    /// From row to row within it (s).
    pub(crate) step_s: f64,
    /// From burst to burst (s).
    pub(crate) every_s: f64,
    /// From row to row where they are laid evenly (s).
    pub(crate) even_s: f64,
}

/// The bursts that times (s) come in; `None` where they do not.
pub(crate) fn bursts(time_s: &[f64]) -> Option<Bursts> {
    let steps: Vec<f64> = time_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let all_s = time_s.last()? - time_s.first()?;
    let mean_s = all_s / steps.len() as f64;
    let step_s = median(&steps)?;
    if step_s < 0.0 || mean_s <= step_s * PAUSE_STEPS.sqrt() {
        return None;
    }
    let (mut pauses, mut lengths, mut length) = (Vec::new(), Vec::new(), 1_usize);
    for step in steps {
        if step > PAUSE_STEPS * step_s {
            pauses.push(step);
            lengths.push(length);
            length = 0;
        }
        length += 1;
    }
    if pauses.len() < LEAST_BURSTS || pauses.iter().sum::<f64>() < PAUSED * all_s {
        return None;
    }
    let usual_s = median(&pauses)?;
    let rows = median(&lengths.iter().map(|length| *length as f64).collect::<Vec<_>>())?;
    let alike = |count: usize| count as f64 >= ALIKE * pauses.len() as f64;
    let of_rows = lengths.iter().filter(|length| length.abs_diff(rows.round() as usize) <= ROWS_OFF).count();
    let of_pauses = pauses.iter().filter(|pause| (*pause - usual_s).abs() <= PAUSE_OFF * usual_s).count();
    let is_regular = rows >= LEAST_ROWS && alike(of_rows) && alike(of_pauses);
    let every_s = usual_s + (rows - 1.0) * step_s;
    is_regular.then(|| Bursts { rows: rows.round() as usize, step_s, every_s, even_s: every_s / rows })
}

fn median(values: &[f64]) -> Option<f64> {
    let mut values = values.to_vec();
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_buffer_that_is_emptied_is_told_from_lost_rows_and_slow_samples() {
        let buffered: Vec<f64> = (0..400).map(|k| 0.2 * f64::from(k / 10) + 0.0005 * f64::from(k % 10)).collect();
        let found = bursts(&buffered).unwrap();
        assert_eq!(found.rows, 10);
        assert!((found.every_s - 0.2).abs() < 1e-9 && (found.even_s - 0.02).abs() < 1e-9, "{found:?}");
        // All rows of a burst under one time.
        let stamped: Vec<f64> = (0..400).map(|k| 0.2 * f64::from(k / 10)).collect();
        assert_eq!(bursts(&stamped).unwrap().rows, 10);
        let even: Vec<f64> = (0..400).map(|k| 0.02 * f64::from(k)).collect();
        assert_eq!(bursts(&even), None);
        let lost: Vec<f64> =
            even.iter().enumerate().filter(|(k, _)| k % 7 != 3 && k % 11 > 1).map(|(_, t)| *t).collect();
        assert_eq!(bursts(&lost), None);
        let breaks: Vec<f64> = even.iter().enumerate().map(|(k, t)| t + 30.0 * (k / 100) as f64).collect();
        assert_eq!(bursts(&breaks), None, "runs with long breaks");
    }
}
