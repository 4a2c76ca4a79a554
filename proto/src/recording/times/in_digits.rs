//! Dates with times of digits alone: the basic format of ISO 8601, and the same without any mark in it.

/// `20260329T015900.020Z`, the basic format of ISO 8601, with its marks; `None` of any other text.
pub(crate) fn in_digits(text: &str) -> Option<String> {
    let joined = marked_fraction(text.trim());
    let text = joined.as_deref().unwrap_or(text.trim());
    let digits = |text: &str, count: usize| {
        let (head, rest) = text.split_at_checked(count)?;
        head.bytes().all(|byte| byte.is_ascii_digit()).then(|| (head.to_owned(), rest.to_owned()))
    };
    let (date, rest) = digits(text, 8)?;
    let behind = rest.strip_prefix(['T', 't', ' ', '_', '-']).or(joined.as_ref().map(|_| rest.as_str()));
    let (clock, rest) = digits(behind?, 6)?;
    let zone = rest.find(['Z', 'z', '+', '-', ' ']).unwrap_or(rest.len());
    let (fraction, zone) = rest.split_at(zone);
    let fraction_digits = if fraction.is_empty() { "0" } else { fraction.strip_prefix(['.', ','])? };
    if !fraction_digits.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    let part = |text: &str, from: usize, to: usize| text.get(from..to).unwrap_or_default().to_owned();
    let [year, month, day] = [part(&date, 0, 4), part(&date, 4, 6), part(&date, 6, 8)];
    let [hours, minutes, seconds] = [part(&clock, 0, 2), part(&clock, 2, 4), part(&clock, 4, 6)];
    Some(format!("{year}-{month}-{day} {hours}:{minutes}:{seconds}{fraction}{zone}"))
}

/// Tells whether a text is a date and a time in digits without any mark but that of a fraction, as a number that means something else may
/// look.
pub(crate) fn is_without_marks(text: &str) -> bool {
    marked_fraction(text.trim()).is_some()
}

/// `20260329015900020` with a point before its milliseconds or microseconds, and what has no more than seconds as it stands; `None` of
/// digits that are no date and time of these years, as counts and epochs are.
fn marked_fraction(text: &str) -> Option<String> {
    let (whole, fraction) = text.split_once(['.', ',']).unwrap_or((text, ""));
    let is_of_digits = [whole, fraction].iter().all(|part| part.bytes().all(|byte| byte.is_ascii_digit()));
    let may_be = is_of_digits && (whole.len() == 14 || fraction.is_empty() && matches!(whole.len(), 17 | 20));
    let within = |from: usize, to: usize, lowest: u32, highest: u32| {
        let number = whole.get(from..to).and_then(|part| part.parse().ok());
        number.is_some_and(|number: u32| (lowest..=highest).contains(&number))
    };
    let is_date = within(0, 4, 1990, 2100) && within(4, 6, 1, 12) && within(6, 8, 1, 31);
    let is_time = within(8, 10, 0, 23) && within(10, 12, 0, 59) && within(12, 14, 0, 59);
    let (seconds, finer) = whole.split_at_checked(14).filter(|_| may_be && is_date && is_time)?;
    Some(if finer.is_empty() { text.to_owned() } else { format!("{seconds}.{finer}") })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_that_are_a_date_and_a_time_get_their_marks() {
        for (text, marked) in [
            ("20260329T015900.020Z", "2026-03-29 01:59:00.020Z"),
            ("20260329_015900", "2026-03-29 01:59:00"),
            ("20260329015900", "2026-03-29 01:59:00"),
            ("20260329015900020", "2026-03-29 01:59:00.020"),
            ("20260329015900020500", "2026-03-29 01:59:00.020500"),
            ("20260329015900,02", "2026-03-29 01:59:00,02"),
        ] {
            assert_eq!(in_digits(text).as_deref(), Some(marked), "{text}");
        }
        // Epochs in ms, us, 100 ns and ns, counts, and what no calendar has.
        for text in [
            "1774749540020",
            "1774749540020000",
            "134192231400200000",
            "639103487400200000",
            "1774749540020000000",
            "20261329015900",
            "20260329245900",
            "2026032901590002",
            "20260329",
            "",
        ] {
            assert_eq!(in_digits(text), None, "{text}");
        }
    }
}
