//! Narrow lines in a residual: the pump's ripple, folded down by sampling.
//!
//! Two pistons at 3000 rev/min pulse at 100 Hz, twice the sampling rate, and fold to a constant; at 2950 rev/min they
//! show as a line of 1.7 Hz that looks like a slow wave of the pressure. A line is told from what a model lacks by
//! being narrow: its bin of the periodogram (Hann window) stands out of its neighbours, which a broad hump's does not.
//!
//! ```text
//! folded frequency   f = |k n/60 − m · 50 Hz|      n rev/min, k pulses per revolution, m whole
//! ```

use std::f64::consts::TAU;

use proto::recording::PERIOD_S;

/// A narrow line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Frequency in Hz, 0 … 25.
    pub hz: f64,
    /// Amplitude in the residual's unit.
    pub amplitude: f64,
    /// Power of the line over that of its neighbourhood.
    pub contrast: f64,
}

/// Bins on either side that make up the neighbourhood.
const NEIGHBOURS: usize = 25;
/// Bins that a Hann window spreads a line over, on either side.
const SPREAD: usize = 3;

/// Lines in evenly sampled rows (20 ms), strongest first; none in fewer than 10 s.
///
/// `chance` is the probability that white noise shows any line at all: 1e-3 is a sensible choice.
pub fn lines(residual: &[f64], chance: f64) -> Vec<Line> {
    if residual.len() < 500 {
        return Vec::new();
    }
    let n = residual.len();
    let mean = residual.iter().sum::<f64>() / n as f64;
    // Padded to a power of two at least: bins are finer than the window resolves, so no line falls between two.
    let size = (2 * n).next_power_of_two();
    let mut re = vec![0.0; size];
    let mut im = vec![0.0; size];
    let mut gain = 0.0;
    for (i, (slot, r)) in re.iter_mut().zip(residual).enumerate() {
        let window = 0.5 - 0.5 * (TAU * (i as f64 + 0.5) / n as f64).cos();
        *slot = window * (r - mean);
        gain += window;
    }
    transform(&mut re, &mut im);
    let power: Vec<f64> = re.iter().zip(&im).take(size / 2).map(|(a, b)| a * a + b * b).collect();
    // Bins of the padded transform per independent bin.
    let fine = size as f64 / n as f64;
    let spread = (SPREAD as f64 * fine).ceil() as usize;
    let neighbours = (NEIGHBOURS as f64 * fine).ceil() as usize;
    // A bin of white noise is exponential: P(power > x · mean) = e^−x; the padding makes about 3 n/2 chances of n/2.
    let threshold = (1.5 * n as f64 / chance).ln();
    let mut found = Vec::new();
    for bin in spread..power.len().saturating_sub(spread) {
        let here = power[bin];
        let around = bin.saturating_sub(spread)..(bin + spread + 1).min(power.len());
        if power.get(around).is_none_or(|part| part.iter().any(|p| *p > here)) {
            continue;
        }
        let low = bin.saturating_sub(neighbours);
        let high = (bin + neighbours + 1).min(power.len());
        let mut ring: Vec<f64> =
            (low..high).filter(|k| k.abs_diff(bin) > 2 * spread).filter_map(|k| power.get(k)).copied().collect();
        if ring.is_empty() {
            continue;
        }
        let middle = ring.len() / 2;
        // The median of an exponential is ln 2 of its mean.
        let mean = *ring.select_nth_unstable_by(middle, f64::total_cmp).1 / std::f64::consts::LN_2;
        let contrast = here / mean.max(1e-300);
        // The neighbourhood's own mean is known to 1/√(2·25) only.
        if contrast > 1.4 * threshold {
            found.push(Line {
                hz: bin as f64 / (size as f64 * PERIOD_S),
                amplitude: 2.0 * here.sqrt() / gain,
                contrast,
            });
        }
    }
    found.sort_by(|a, b| b.contrast.total_cmp(&a.contrast));
    found
}

/// The frequency at which pulses of `pulses_hz` show when sampled every 20 ms.
pub fn folded_hz(pulses_hz: f64) -> f64 {
    let sampling = 1.0 / PERIOD_S;
    (pulses_hz - (pulses_hz / sampling).round() * sampling).abs()
}

/// Fast Fourier transform in place (Cooley & Tukey), length a power of two.
fn transform(re: &mut [f64], im: &mut [f64]) {
    let n = re.len();
    let bits = n.trailing_zeros();
    for i in 0..n {
        let j = i.reverse_bits() >> (usize::BITS - bits);
        if i < j {
            re.swap(i, j);
            im.swap(i, j);
        }
    }
    let mut half = 1;
    while half < n {
        let angle = -TAU / (2 * half) as f64;
        for k in 0..half {
            let (sin, cos) = (angle * k as f64).sin_cos();
            for i in (k..n).step_by(2 * half) {
                let (a, b) = (re[i + half], im[i + half]);
                let (tr, ti) = (a * cos - b * sin, a * sin + b * cos);
                (re[i + half], im[i + half]) = (re[i] - tr, im[i] - ti);
                (re[i], im[i]) = (re[i] + tr, im[i] + ti);
            }
        }
        half *= 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    fn noise(n: usize, seed: u64) -> Vec<f64> {
        let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
        (0..n).map(|_| StandardNormal.sample(&mut random)).collect()
    }

    #[test]
    fn transform_is_the_sum_it_stands_for() {
        let values = noise(64, 1);
        let (mut re, mut im) = (values.clone(), vec![0.0; 64]);
        transform(&mut re, &mut im);
        for k in [0, 1, 17, 63] {
            let angle = |i: usize| -TAU * (i * k) as f64 / 64.0;
            let sum = |f: fn(f64) -> f64| values.iter().enumerate().map(|(i, v)| v * f(angle(i))).sum::<f64>();
            assert!((re[k] - sum(f64::cos)).abs() < 1e-12 && (im[k] - sum(f64::sin)).abs() < 1e-12, "{k}");
        }
    }

    #[test]
    fn a_line_is_found_where_it_is() {
        // A third of the noise's deviation: invisible by eye, 250 readings per cycle of evidence.
        let mut rows = noise(5000, 2);
        for (i, r) in rows.iter_mut().enumerate() {
            *r += 0.33 * (TAU * 1.667 * i as f64 * PERIOD_S).sin();
        }
        let found = lines(&rows, 1e-3);
        assert_eq!(found.len(), 1, "{found:?}");
        // A padded bin is 0.003 Hz wide; amplitudes scatter by √(2/n) · 1.2 ≈ 0.025.
        assert!((found[0].hz - 1.667).abs() < 0.006 && (found[0].amplitude - 0.33).abs() < 0.08, "{found:?}");
    }

    #[test]
    fn white_and_slow_residuals_have_no_lines() {
        let mut any = 0;
        for seed in 0..40 {
            let white = noise(3000, 100 + seed);
            any += usize::from(!lines(&white, 1e-3).is_empty());
            let mut slow = 0.0;
            let drift: Vec<f64> = noise(3000, 200 + seed)
                .iter()
                .map(|w| {
                    slow = 0.98 * slow + w;
                    slow
                })
                .collect();
            any += usize::from(!lines(&drift, 1e-3).is_empty());
        }
        // 80 chances of 1e-3 in white noise; the drift's steep spectrum may add one.
        assert!(any <= 1, "{any}");
    }

    #[test]
    fn pulses_fold_as_the_study_says() {
        for (rpm, hz) in [(3000.0, 0.0), (2990.0, 1.0 / 3.0), (2950.0, 5.0 / 3.0), (2900.0, 10.0 / 3.0)] {
            assert!((folded_hz(2.0 * rpm / 60.0) - hz).abs() < 1e-9, "{rpm}");
        }
    }
}
