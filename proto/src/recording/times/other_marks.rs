//! Times whose parts stand between marks that few loggers use.

/// `2026-03-29_10:00:00.020` and `10:00:00;020` with the marks that others use; `None` of any other text.
pub(crate) fn with_usual_marks(text: &str) -> Option<String> {
    let is_of_marks = text.chars().all(|c| c.is_ascii_digit() || matches!(c, '-' | '/' | '.' | ':' | '_' | ';' | ' '));
    let count = |mark: char| text.matches(mark).count();
    // Behind a semicolon stand the milliseconds of a time of day; fewer digits are another cell, or hundredths, or frames of a film.
    let is_millisecond = |behind: &str| behind.len() == 3 && behind.bytes().all(|byte| byte.is_ascii_digit());
    let are_milliseconds = text.split_once(';').is_none_or(|(_, behind)| is_millisecond(behind));
    // A time of day has its colons.
    if !is_of_marks || !text.contains(':') || count('_') > 1 || !are_milliseconds || count('_') + count(';') == 0 {
        return None;
    }
    Some(text.replace('_', " ").replace(';', "."))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::times::timestamps::{column_s, is_timestamp};

    #[test]
    fn a_stamp_of_other_marks_is_a_time() {
        for (first, second) in [
            ("2026-03-29_09:00:00.980", "2026-03-29_09:00:01.000"),
            ("09:00:00;980", "09:00:01;000"),
            ("29.03.2026_09:00:00;980", "29.03.2026_09:00:01;000"),
        ] {
            assert!(is_timestamp(first), "{first}");
            let times = column_s(&[first, second]).unwrap();
            assert!((times[1] - times[0] - 0.02).abs() < 1e-6, "{first}: {times:?}");
        }
        for none in
            ["run_2", "1;2", "2026_03_29 09:00", "09:00:00", "a_09:00:00", "1_2:3;4;5", "10:00:00;5", "10:00:00;20"]
        {
            assert_eq!(with_usual_marks(none), None, "{none}");
        }
    }
}
