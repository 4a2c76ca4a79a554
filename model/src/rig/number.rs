//! Meaning of a rig's numbers: unit, accepted and plausible range, how well one knows them beforehand.
//!
//! Each component and each mechanism declares its numbers once, beside its fields. Reading a file checks
//! them against the accepted range; fits ask for the same numbers by path ([`Rig::parameters`]); a search
//! for missing physics takes ranges and first magnitudes from here.
//!
//! [`Rig::parameters`]: super::Rig::parameters

use super::check::within;
use super::error::RigError;

/// One number of a component or a mechanism.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Number {
    /// Key in the rig file.
    pub key: &'static str,
    /// Unit; empty for a bare number.
    pub unit: &'static str,
    /// Lowest and highest value that a file may hold: beyond, it cannot be meant.
    pub accepted: [f64; 2],
    /// Lowest and highest value that hardware of a laboratory bench has.
    pub plausible: [f64; 2],
    /// Standard deviation of a careful first guess, as a share of the value (for a mechanism, of a magnitude).
    pub prior_sd: f64,
    /// Usual meaning of a value outside the accepted range.
    pub hint: &'static str,
    /// First magnitudes for a fit of a mechanism, weak to strong; empty for components.
    pub starts: &'static [f64],
    /// For a magnitude of a mechanism that was measured on parts of its kind: what is usual, and the standard deviation
    /// of its logarithm.
    pub usual: Option<[f64; 2]>,
    /// True where its key may be left out, which is the same as zero.
    pub optional: bool,
    /// For a magnitude of a mechanism: the effect grows with this power of it. Negative where a large value is no effect.
    pub power: f64,
    /// True where its kind is told by being slow: what fits best at its least plausible value is something faster.
    pub slow: bool,
}

impl Number {
    /// A number with its unit and accepted range, all of it plausible and known to 5 %.
    pub const fn new(unit: &'static str, low: f64, high: f64) -> Self {
        let range = [low, high];
        Number {
            key: "",
            unit,
            accepted: range,
            plausible: range,
            prior_sd: 0.05,
            hint: "",
            starts: &[],
            usual: None,
            optional: false,
            power: 1.0,
            slow: false,
        }
    }

    /// Number with a narrower plausible range.
    pub const fn plausible(self, low: f64, high: f64) -> Self {
        Number { plausible: [low, high], ..self }
    }

    /// Number as a time constant whose kind is told by being no faster than is plausible.
    pub const fn slow(self) -> Self {
        Number { slow: true, ..self }
    }

    /// Number known to another share of its value.
    pub const fn known_to(self, share: f64) -> Self {
        Number { prior_sd: share, ..self }
    }

    /// Number with a hint for values outside the accepted range.
    pub const fn hint(self, hint: &'static str) -> Self {
        Number { hint, ..self }
    }

    /// Number with first magnitudes, weak to strong.
    pub const fn starts(self, starts: &'static [f64]) -> Self {
        Number { starts, ..self }
    }

    /// Number measured on parts of its kind: a usual value, and the standard deviation of the logarithm.
    pub const fn usually(self, value: f64, log_sd: f64) -> Self {
        Number { usual: Some([value, log_sd]), ..self }
    }

    /// Number whose key may be left out.
    pub const fn optional(self) -> Self {
        Number { optional: true, ..self }
    }

    /// Number whose effect grows with a power of it.
    pub const fn acts_with_power(self, power: f64) -> Self {
        Number { power, ..self }
    }

    /// Number under its key.
    pub(crate) const fn named(self, key: &'static str) -> Self {
        Number { key, ..self }
    }

    /// Tells whether it can be negative.
    pub fn is_signed(&self) -> bool {
        self.plausible[0] < 0.0
    }

    /// Checks a value of it that stands at `key`.
    pub(crate) fn check(&self, key: &str, value: f64) -> Result<(), RigError> {
        within(key, value, self.accepted[0], self.accepted[1], self.unit, self.hint)
    }
}

/// Something that holds numbers of a rig.
pub trait Numbers {
    /// Numbers, in a fixed order.
    fn numbers(&self) -> Vec<Number>;

    /// The value of number `index`; NaN beyond the last.
    fn number(&self, index: usize) -> f64;

    /// Where the value of number `index` stands; `None` beyond the last.
    fn number_mut(&mut self, index: usize) -> Option<&mut f64>;

    /// Checks every number against its accepted range; `key` is the component's dotted key.
    ///
    /// # Errors
    /// The first number that is outside.
    fn check_numbers(&self, key: &str) -> Result<(), RigError> {
        let numbers = self.numbers();
        numbers.iter().enumerate().try_for_each(|(i, n)| n.check(&format!("{key}.{}", n.key), self.number(i)))
    }
}

/// Declares the numbers of a struct: each field with what it means.
macro_rules! numbers {
    ($type:ty { $($field:ident: $number:expr),* $(,)? }) => {
        impl $crate::rig::Numbers for $type {
            fn numbers(&self) -> Vec<$crate::rig::Number> {
                vec![$({
                    const NUMBER: $crate::rig::Number = $number.named(stringify!($field));
                    NUMBER
                }),*]
            }

            fn number(&self, index: usize) -> f64 {
                [$(self.$field),*].get(index).copied().unwrap_or(f64::NAN)
            }

            fn number_mut(&mut self, index: usize) -> Option<&mut f64> {
                let slots: [&mut f64; _] = [$(&mut self.$field),*];
                slots.into_iter().nth(index)
            }
        }
    };
}
pub(crate) use numbers;
