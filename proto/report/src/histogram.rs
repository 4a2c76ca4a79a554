//! Counts of values in bins.

/// Numbers of values between neighbouring edges.
#[derive(Debug, Clone, PartialEq)]
pub struct Histogram {
    /// Bin edges, one more than counts, ascending.
    pub edges: Vec<f64>,
    /// Values in each bin: from its lower edge up to, not including, its upper one.
    pub counts: Vec<u64>,
}

impl Histogram {
    /// Even bins from the lowest to the highest value; values that are not finite do not count.
    ///
    /// Empty when nothing counts or `bins` is 0.
    pub fn linear(values: &[f64], bins: usize) -> Self {
        let finite: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
        Self::of(&finite, bins, |share, low, high| low + share * (high - low))
    }

    /// Logarithmic bins from the lowest to the highest value above 0; others do not count.
    ///
    /// For times of computing: most lie together, and the few that matter lie decades above.
    pub fn logarithmic(values: &[f64], bins: usize) -> Self {
        let positive: Vec<f64> = values.iter().copied().filter(|value| value.is_finite() && *value > 0.0).collect();
        Self::of(&positive, bins, |share, low, high| low * (high / low).powf(share))
    }

    fn of(values: &[f64], bins: usize, edge: impl Fn(f64, f64, f64) -> f64) -> Self {
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let mut high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if values.is_empty() || bins == 0 {
            return Self { edges: Vec::new(), counts: Vec::new() };
        }
        if low == high {
            // One value still gets a bar that can be seen.
            high = low + low.abs().max(1.0) * 0.01;
        }
        let mut edges: Vec<f64> = (0..=bins).map(|k| edge(k as f64 / bins as f64, low, high)).collect();
        // The outer edges are the extremes themselves, whatever rounding made of them.
        if let Some(first) = edges.first_mut() {
            *first = low;
        }
        if let Some(last) = edges.last_mut() {
            *last = high;
        }
        let mut counts = vec![0; bins];
        for value in values {
            // The highest value belongs to the last bin, not to one above it.
            let bin = edges.partition_point(|edge| edge <= value).saturating_sub(1).min(bins - 1);
            if let Some(count) = counts.get_mut(bin) {
                *count += 1;
            }
        }
        Self { edges, counts }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_is_counted_once_in_its_bin() {
        let histogram = Histogram::linear(&[0.0, 0.5, 1.0, 1.5, 4.0, f64::NAN, f64::INFINITY], 4);
        assert_eq!(histogram.edges, [0.0, 1.0, 2.0, 3.0, 4.0]);
        assert_eq!(histogram.counts, [2, 2, 0, 1]);
    }

    #[test]
    fn logarithmic_bins_are_even_in_their_ratio() {
        let histogram = Histogram::logarithmic(&[1.0, 5.0, 10.0, 99.0, 1000.0, 0.0, -3.0], 3);
        let ratios: Vec<f64> = histogram.edges.windows(2).map(|pair| pair[1] / pair[0]).collect();
        assert!(ratios.iter().all(|ratio| (ratio - 10.0).abs() < 1e-9), "{ratios:?}");
        assert_eq!(histogram.counts.iter().sum::<u64>(), 5);
    }

    #[test]
    fn nothing_and_one_value_are_no_trouble() {
        assert!(Histogram::linear(&[f64::NAN], 5).counts.is_empty());
        assert!(Histogram::logarithmic(&[], 5).edges.is_empty());
        assert_eq!(Histogram::linear(&[3.0; 7], 5).counts.iter().sum::<u64>(), 7);
        assert!(Histogram::linear(&[1.0, 2.0], 0).counts.is_empty());
    }
}
