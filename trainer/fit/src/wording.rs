//! Plain words for numbers: three digits, shares in per cent, a noise and multiples of it.

/// Noise in kPa up to which there is none to speak of: most readings repeat the one before, and multiples of it say nothing.
pub const NO_NOISE_KPA: f64 = 1e-5;
/// The most multiples of a noise that are told as a number.
pub const MOST_TIMES: f64 = 1000.0;
/// The most decimals that a share in per cent is widened to.
const MOST_DECIMALS: usize = 2;

/// A number with three significant digits.
pub fn three_digits(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let magnitude = value.abs().log10().floor() as i32;
    if !(-3..6).contains(&magnitude) {
        return format!("{:.2}·10{}", value / 10f64.powi(magnitude), raised(magnitude));
    }
    let digits = usize::try_from((2 - magnitude).max(0)).unwrap_or(0);
    format!("{value:.digits$}")
}

/// An exponent in raised digits.
fn raised(exponent: i32) -> String {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let raise = |c: char| c.to_digit(10).and_then(|d| DIGITS.get(d as usize).copied()).unwrap_or('⁻');
    exponent.to_string().chars().map(raise).collect()
}

/// A share in per cent with so many decimals (two at most), or as many more as its first digit takes: what is there is never told
/// as zero.
pub fn percent(share: f64, decimals: usize) -> String {
    in_percent(share, decimals, "")
}

/// A relative change in per cent, with its sign, otherwise as [`percent`].
pub fn change_in_percent(change: f64, decimals: usize) -> String {
    in_percent(change, decimals, "+")
}

fn in_percent(share: f64, decimals: usize, plus: &str) -> String {
    let size = 100.0 * share.abs();
    let sign = if share < 0.0 { "-" } else { plus };
    let shows = |decimals: &usize| size * 10f64.powi(*decimals as i32) >= 1.0;
    match (decimals..=MOST_DECIMALS).find(shows) {
        Some(decimals) => format!("{sign}{size:.decimals$} %"),
        None if size > 0.0 => "less than 0.01 %".to_owned(),
        None => format!("{size} %"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_share_that_is_there_is_not_told_as_zero() {
        let shares = [0.1234, 0.0123, 0.004, 3e-4, 4e-5, 0.0];
        assert_eq!(
            shares.map(|share| percent(share, 0)),
            ["12 %", "1 %", "0.4 %", "0.03 %", "less than 0.01 %", "0 %"]
        );
        assert_eq!(shares.map(|share| percent(share, 1))[..4], ["12.3 %", "1.2 %", "0.4 %", "0.03 %"]);
        assert_eq!([percent(0.001, 2), percent(4e-5, 2)], ["0.10 %", "less than 0.01 %"]);
        assert_eq!([percent(-0.03, 0), percent(-0.003, 0)], ["-3 %", "-0.3 %"]);
    }

    #[test]
    fn a_change_has_its_sign() {
        let changes = [0.052, -0.052, 3e-4, -3e-4, -1e-6, 0.0];
        let told = ["+5.2 %", "-5.2 %", "+0.03 %", "-0.03 %", "less than 0.01 %", "0 %"];
        assert_eq!(changes.map(|change| change_in_percent(change, 1)), told);
    }

    #[test]
    fn numbers_have_three_digits() {
        let numbers = [0.0, 33.84, 0.001_234, 1.07e6, -2.5e-5];
        assert_eq!(numbers.map(three_digits), ["0", "33.8", "0.00123", "1.07·10⁶", "-2.50·10⁻⁵"]);
    }
}
