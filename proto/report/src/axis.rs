//! Axes: where a value lies, and which values are marked.
//!
//! Ticks on a linear axis stand at whole multiples of 1, 2 or 5 times a power of ten; on a
//! logarithmic one at powers of ten, with 2 and 5 between them when there are few.

/// Course of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Scale {
    #[default]
    Linear,
    Log,
}

/// An axis from `low` to `high`, `low < high`, both finite; above 0 when logarithmic.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Axis {
    pub(crate) low: f64,
    pub(crate) high: f64,
    pub(crate) scale: Scale,
}

/// A marked value with its label.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Tick {
    pub(crate) value: f64,
    pub(crate) label: String,
}

impl Axis {
    /// The axis around some values, with a margin on both sides (a share of the span).
    ///
    /// Values that are not finite, or not above 0 on a logarithmic axis, do not count; without any
    /// value it runs from 0 to 1 (1 to 10).
    pub(crate) fn around(values: impl Iterator<Item = f64>, scale: Scale, margin: f64) -> Self {
        let counts = |value: &f64| value.is_finite() && (scale == Scale::Linear || *value > 0.0);
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in values.filter(counts) {
            low = low.min(value);
            high = high.max(value);
        }
        if low > high {
            (low, high) = if scale == Scale::Log { (1.0, 10.0) } else { (0.0, 1.0) };
        }
        Self { low, high, scale }.widened(margin)
    }

    /// Where a value lies: 0 at `low`, 1 at `high`; beyond outside.
    pub(crate) fn place(&self, value: f64) -> f64 {
        match self.scale {
            // Halves, because `high − low` of two large numbers could overflow.
            Scale::Linear => (value / 2.0 - self.low / 2.0) / (self.high / 2.0 - self.low / 2.0),
            Scale::Log => (value / self.low).ln() / (self.high / self.low).ln(),
        }
    }

    /// Marked values within the axis, about `most` of them at most.
    pub(crate) fn ticks(&self, most: usize) -> Vec<Tick> {
        match self.scale {
            Scale::Linear => {
                let values = ticks_linear(self.low, self.high, most);
                let step = values.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
                let label = |value: f64| linear_label(value, step);
                values.into_iter().map(|value| Tick { value, label: label(value) }).collect()
            }
            Scale::Log => ticks_log(self.low, self.high)
                .into_iter()
                .map(|value| Tick { value, label: log_label(value) })
                .collect(),
        }
    }

    /// The axis with an end moved to a round value that lies just beyond it: a minute of 20 ms rows ends
    /// at 59.98 s, and 60 should be marked.
    pub(crate) fn snapped(self) -> Self {
        /// Least share of the span that the eye takes for a difference.
        const SHARE: f64 = 0.005;
        if self.scale == Scale::Log {
            return self;
        }
        let reach = SHARE * (self.high - self.low);
        let beyond = ticks_linear(self.low - reach, self.high + reach, 13);
        let low = beyond.first().copied().unwrap_or(self.low).min(self.low);
        let high = beyond.last().copied().unwrap_or(self.high).max(self.high);
        Self { low, high, ..self }
    }

    fn widened(self, margin: f64) -> Self {
        let Self { low, high, scale } = self;
        let (low, high) = match scale {
            Scale::Log if low == high => (low / 2.0, high * 2.0),
            Scale::Log => {
                let factor = (high / low).powf(margin);
                (low / factor, high * factor)
            }
            Scale::Linear if low == high => {
                let half = if low == 0.0 { 0.5 } else { low.abs() * 0.05 };
                (low - half, high + half)
            }
            Scale::Linear => {
                let span = margin * (high / 2.0 - low / 2.0) * 2.0;
                (low - span, high + span)
            }
        };
        // An axis of the largest numbers there are must not run to infinity.
        Self { low: low.max(f64::MIN), high: high.min(f64::MAX), scale }
    }
}

/// Round values between `low` and `high`, at most `most` (at least 2 are aimed at).
///
/// Neighbours are 1, 2 or 5 times a power of ten apart, and every value is a whole multiple of that.
/// Empty when the ends are not finite or not in order.
pub fn ticks_linear(low: f64, high: f64, most: usize) -> Vec<f64> {
    let span = high - low;
    if !(span > 0.0 && span.is_finite() && low.is_finite()) {
        return Vec::new();
    }
    let most = most.max(2);
    let rough = span / most as f64;
    let mut exponent = rough.log10().floor() as i32;
    loop {
        for digit in [1.0, 2.0, 5.0] {
            let (first, last) = (multiple(low, digit, exponent).ceil(), multiple(high, digit, exponent).floor());
            let count = last - first + 1.0;
            // Multiples beyond 2^53 are no longer whole numbers of their own.
            if !(first.abs() < 9e15 && last.abs() < 9e15) || exponent < -300 {
                return Vec::new();
            }
            if count <= most as f64 {
                // Multiplying back may round to just beyond an end.
                let values = (0..count.max(0.0) as usize).map(|k| value(first + k as f64, digit, exponent));
                return values.filter(|value| (low..=high).contains(value)).collect();
            }
        }
        exponent += 1;
    }
}

/// Values of the form 10^k between `low` and `high`, with 2 and 5 times them when the axis spans fewer
/// than two decades, and only every n-th power when it spans more than ten.
///
/// Empty when the ends are not above 0 and in order.
pub fn ticks_log(low: f64, high: f64) -> Vec<f64> {
    if !(low > 0.0 && high > low && high.is_finite()) {
        return Vec::new();
    }
    let decades = (high / low).log10();
    let digits: &[f64] = if decades < 2.0 { &[1.0, 2.0, 5.0] } else { &[1.0] };
    let every = (decades / 10.0).ceil().max(1.0) as usize;
    let (first, last) = (low.log10().floor() as i32, high.log10().ceil() as i32);
    (first..=last)
        .step_by(every)
        .flat_map(|exponent| digits.iter().map(move |digit| value(1.0, *digit, exponent)))
        .filter(|value| (low..=high).contains(value))
        .collect()
}

/// `value / (digit · 10^exponent)`, dividing by whole numbers only: 0.3 / 0.1 is not 3, 0.3 · 10 is.
fn multiple(value: f64, digit: f64, exponent: i32) -> f64 {
    if exponent < 0 { value * 10_f64.powi(-exponent) / digit } else { value / (digit * 10_f64.powi(exponent)) }
}

/// `k · digit · 10^exponent`, rounded once.
fn value(k: f64, digit: f64, exponent: i32) -> f64 {
    // `+ 0.0` turns −0.0 into 0.0.
    if exponent < 0 { k * digit / 10_f64.powi(-exponent) + 0.0 } else { k * digit * 10_f64.powi(exponent) + 0.0 }
}

fn linear_label(value: f64, step: f64) -> String {
    // What is smaller than a millionth or larger than a million is read faster with an exponent.
    if value != 0.0 && (value.abs() >= 1e6 || (step.is_finite() && step < 1e-6)) {
        return with_minus(&format!("{value:e}"));
    }
    let decimals = if step.is_finite() { (-step.log10().floor()).clamp(0.0, 9.0) as usize } else { 3 };
    with_minus(&format!("{value:.decimals$}"))
}

fn log_label(value: f64) -> String {
    if (1e-3..1e5).contains(&value) { with_minus(&format!("{value}")) } else { with_minus(&format!("{value:e}")) }
}

/// A true minus sign: a hyphen is easily missed before a digit.
pub(crate) fn with_minus(number: &str) -> String {
    number.replace('-', "\u{2212}")
}
