//! Numbers as people read them: one way of writing each quantity, everywhere.

/// A count with a separator after each three digits: `180,000`.
pub(crate) fn count(number: u64) -> String {
    let digits = number.to_string();
    let mut out = String::with_capacity(digits.len() + digits.len() / 3);
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

/// A count with the right form of its noun: `1 fault`, `2 faults`, `no faults`.
pub(crate) fn counted(number: u64, one: &str, many: &str) -> String {
    match number {
        0 => format!("no {many}"),
        1 => format!("1 {one}"),
        _ => format!("{} {many}", count(number)),
    }
}

/// A number with so many decimals, or `n/a`.
pub(crate) fn number(value: Option<f64>, decimals: usize) -> String {
    match value.filter(|value| value.is_finite()) {
        Some(value) => format!("{value:.decimals$}"),
        None => "n/a".to_owned(),
    }
}

/// A number with its sign and so many decimals, or `n/a`.
pub(crate) fn signed(value: Option<f64>, decimals: usize) -> String {
    match value.filter(|value| value.is_finite()) {
        Some(value) => format!("{value:+.decimals$}"),
        None => "n/a".to_owned(),
    }
}

/// A time in milliseconds, in whole microseconds below 1 ms: `0.312 ms`, `12.4 ms`, or `n/a`.
pub(crate) fn time_ms(us: Option<f64>) -> String {
    match us.filter(|us| us.is_finite()) {
        Some(us) if us < 9_999.5 => format!("{:.3} ms", us / 1e3),
        Some(us) => format!("{:.1} ms", us / 1e3),
        None => "n/a".to_owned(),
    }
}

/// A time as short as one can say it: `310 µs`, `2.8 ms`.
pub(crate) fn short_time(us: Option<f64>) -> String {
    match us.filter(|us| us.is_finite()) {
        Some(us) if us < 99.95 => format!("{us:.1} µs"),
        Some(us) if us < 999.5 => format!("{us:.0} µs"),
        Some(us) if us < 99_950.0 => format!("{:.1} ms", us / 1e3),
        Some(us) => format!("{:.0} ms", us / 1e3),
        None => "n/a".to_owned(),
    }
}

/// Seconds, with one decimal below 100 s.
pub(crate) fn seconds(time_s: f64) -> String {
    if time_s < 99.95 { format!("{time_s:.1} s") } else { format!("{time_s:.0} s") }
}

/// An instant of RFC 3339 in UTC to the second, as one reads it: `2026-11-28 06:12:58 UTC`.
pub(crate) fn instant(rfc3339: &str) -> String {
    let (date, time) = rfc3339.trim_end_matches('Z').split_once('T').unwrap_or((rfc3339, ""));
    let time = time.split('.').next().unwrap_or_default();
    if time.is_empty() { date.to_owned() } else { format!("{date} {time} UTC") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_well() {
        assert_eq!([0, 7, 999, 1_000, 1_234_567].map(count), ["0", "7", "999", "1,000", "1,234,567"]);
        assert_eq!([0, 1, 3_000].map(|n| counted(n, "tick", "ticks")), ["no ticks", "1 tick", "3,000 ticks"]);
        assert_eq!([Some(0.126), Some(f64::NAN), None].map(|v| number(v, 2)), ["0.13", "n/a", "n/a"]);
        assert_eq!(signed(Some(-0.004), 2), "-0.00");
        assert_eq!([312.4, 9_999.4, 9_999.6].map(|us| time_ms(Some(us))), ["0.312 ms", "9.999 ms", "10.0 ms"]);
        assert_eq!(
            [1.24, 310.2, 999.4, 999.6, 99_940.0, 99_960.0].map(|us| short_time(Some(us))),
            ["1.2 µs", "310 µs", "999 µs", "1.0 ms", "99.9 ms", "100 ms"]
        );
        assert_eq!(["2026-11-28T06:12:58.227Z", "", "n/a"].map(instant), ["2026-11-28 06:12:58 UTC", "", "n/a"]);
        assert_eq!([0.52, 99.94, 99.96].map(seconds), ["0.5 s", "99.9 s", "100 s"]);
    }
}
