//! Numbers as loggers write them: decimal points or commas, thousands in groups, a typographic minus, exponents of Fortran; and what
//! they write where they have none.

use model::rig::Decimal;

/// Marks between groups of thousands, besides the comma or point that is not the decimal mark: apostrophes, blanks that do not
/// break a line.
const GROUP_MARKS: [char; 5] = ['\'', '\u{2019}', '\u{a0}', '\u{202f}', '\u{2009}'];

/// Words that loggers write where they have nothing, besides nothing at all and NaN.
const NOTHING: [&str; 25] = [
    "-", "--", "---", "na", "n/a", "#n/a", "<na>", "null", "<null>", "none", "nat", "ol", "ovf", "#ovf", "err",
    "error", "bad", "invalid", "no data", "missing", "n.a.", "n.d.", "nd", "over", "under",
];
/// Beginnings of what C's library on Windows writes for NaN and infinity (`1.#QNAN`, `-1.#IND00`, `-nan(ind)`), a sign before them aside.
const NOT_FINITE: [&str; 2] = ["1.#", "nan("];

/// Tells whether a cell says that there is nothing: blank, NaN, a logger's word for it, a spreadsheet's error (`#DIV/0!`).
pub(crate) fn says_nothing(text: &str) -> bool {
    let text = text.trim();
    // Nearly every cell is a number, and a week of them is looked at.
    if text.trim_start_matches('-').starts_with(|c: char| c.is_ascii_digit()) && !text.contains('#') {
        return false;
    }
    let unsigned = text.trim_start_matches(['+', '-']).to_ascii_lowercase();
    let is_full_of = |mark: char| text.chars().all(|c| c == mark);
    text.is_empty()
        || is_not_finite(&unsigned)
        // A display without a reading: `---.--`.
        || (text.contains('-') && text.chars().all(|c| matches!(c, '-' | '.' | ',')))
        // A field that its number was too wide for (Fortran), and a reading that nobody knows.
        || is_full_of('*')
        || is_full_of('?')
        // An oscilloscope's word for what is beyond its range.
        || unsigned == "\u{221e}"
        || NOTHING.iter().any(|nothing| text.eq_ignore_ascii_case(nothing))
        || (text.starts_with('#') && text.ends_with('!'))
}

/// Tells whether a cell without its sign, in small letters, is NaN or one of C's words for what is not finite.
fn is_not_finite(unsigned: &str) -> bool {
    unsigned == "nan" || NOT_FINITE.iter().any(|begin| unsigned.starts_with(begin))
}

/// A number with so many figures, as one reads it: what arithmetic leaves behind them is no part of it.
pub(crate) fn figures(x: f64, figures: usize) -> f64 {
    format!("{x:.*e}", figures.saturating_sub(1)).parse().unwrap_or(x)
}

/// A number with this decimal mark; `true` and `false` are 1 and 0.
pub(crate) fn parse(text: &str, decimal: Decimal) -> Option<f64> {
    let text = text.trim();
    let number = match decimal {
        Decimal::Point => text.parse().ok(),
        // A point beside a comma groups thousands.
        Decimal::Comma if text.contains(',') => text.replace('.', "").replace(',', ".").parse().ok(),
        Decimal::Comma => text.parse().ok(),
    };
    number.or_else(|| rewritten(text, decimal)).or_else(|| hexadecimal(text)).or_else(|| {
        match text.to_ascii_lowercase().as_str() {
            "true" => Some(1.0),
            "false" => Some(0.0),
            _ => None,
        }
    })
}

/// A count in hexadecimal digits behind `0x`.
fn hexadecimal(text: &str) -> Option<f64> {
    let digits = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X"))?;
    u32::from_str_radix(digits, 16).ok().filter(|_| !digits.starts_with('+')).map(f64::from)
}

/// A number that Rust writes in another way.
fn rewritten(text: &str, decimal: Decimal) -> Option<f64> {
    let signed: String = text
        .chars()
        .map(|c| match c {
            '\u{2212}' => '-',
            'd' | 'D' => 'E',
            c => c,
        })
        .collect();
    let mark = match decimal {
        Decimal::Point => '.',
        Decimal::Comma => ',',
    };
    let (whole, broken) = signed.split_once(mark).map_or((signed.as_str(), ""), |(whole, broken)| (whole, broken));
    let joined = if is_grouped(whole, decimal) {
        whole.chars().filter(|c| matches!(c, '0'..='9' | '+' | '-')).collect()
    } else {
        whole.to_owned()
    };
    let plain = if broken.is_empty() { joined } else { format!("{joined}.{broken}") };
    // `inf` and `nan` were read before, and nothing else without a digit is a number.
    plain.contains(|c: char| c.is_ascii_digit()).then(|| plain.parse().ok()).flatten()
}

/// Tells whether digits stand in groups of thousands: one mark throughout, three digits behind each, no zero in front.
pub(crate) fn is_grouped(whole: &str, decimal: Decimal) -> bool {
    let unsigned = whole.trim_start_matches(['+', '-']);
    let Some(mark) = unsigned.chars().find(|c| GROUP_MARKS.contains(c) || (decimal == Decimal::Point && *c == ','))
    else {
        return false;
    };
    let mut groups = unsigned.split(mark);
    let digits = |group: &str| group.chars().all(|c| c.is_ascii_digit());
    let first = groups.next().unwrap_or_default();
    (1..=3).contains(&first.len())
        && !first.starts_with('0')
        && digits(first)
        && groups.all(|g| g.len() == 3 && digits(g))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_way_of_writing_a_number_is_that_number() {
        for (text, number) in [
            ("90,560.9", 90_560.9),
            ("-1,290,560", -1_290_560.0),
            ("90'560.9", 90_560.9),
            ("90\u{2019}560.9", 90_560.9),
            ("90\u{a0}560.9", 90_560.9),
            ("\u{2212}66.69", -66.69),
            ("1.250000D-04", 1.25e-4),
            ("+3.5", 3.5),
            ("TRUE", 1.0),
            ("0x77D", 1917.0),
        ] {
            assert_eq!(parse(text, Decimal::Point), Some(number), "{text}");
        }
        for (text, number) in
            [("90.560,9", 90_560.9), ("90\u{202f}560,9", 90_560.9), ("\u{2212}0,5", -0.5), ("0,00010", 1e-4)]
        {
            assert_eq!(parse(text, Decimal::Comma), Some(number), "{text}");
        }
    }

    #[test]
    fn what_only_looks_like_a_group_is_no_number() {
        for text in [
            "0,123",
            "1,23",
            "1,2345",
            "0x",
            "0xG",
            "0x+1",
            "1,234'567",
            ",234",
            "1234,567",
            "d",
            "D5",
            "12 kPa",
            "run 3",
            "",
        ] {
            assert_eq!(parse(text, Decimal::Point), None, "{text}");
        }
    }
}
