//! Counters of ms or µs that begin anew when their bits are used up: at zero, as `millis()` of a small computer does, or at the most
//! negative number, where they were written with a sign; and clocks that begin anew with each minute, hour, day or week, whose larger parts
//! were not written.

/// Bits of such counters.
const BITS: [u32; 3] = [16, 24, 32];
/// Numbers at which such clocks begin anew, in s and in ms.
const PERIODS: [(f64, &str); 10] = [
    (60.0, "minute"),
    (6e4, "minute"),
    (3600.0, "hour"),
    (3.6e6, "hour"),
    (43_200.0, "half day"),
    (4.32e7, "half day"),
    (86_400.0, "day"),
    (8.64e7, "day"),
    (604_800.0, "week"),
    (6.048e8, "week"),
];
/// Usual steps within which a counter goes over its end; a run that begins anew stops anywhere.
const NEAR_STEPS: f64 = 8.0;

/// Takes the jumps back out of numbers that begin anew; what they are, in words, and how often they did.
pub(crate) fn unwrapped(numbers: &mut [f64]) -> Option<(String, usize)> {
    let step = crate::recording::rows::resample::median_step(numbers).filter(|step| *step > 0.0)?;
    let of_bits = || {
        let is_count = numbers.iter().all(|x| x.fract() == 0.0);
        let mut wholes = BITS.into_iter().filter(|_| is_count).map(|bits| (2.0_f64.powi(bits as i32), bits));
        let begins = |whole: f64| lie_in(numbers, 0.0, whole) || lie_in(numbers, -0.5 * whole, whole);
        wholes
            .find(|(whole, _)| wraps(numbers, *whole, step) && begins(*whole))
            .map(|(whole, bits)| (whole, format!("a counter of {bits} bits")))
    };
    let of_clock = || {
        // A run that begins at nought may well last a minute, and a second one follow it.
        let began_before = numbers.first().is_some_and(|first| *first > NEAR_STEPS * step);
        PERIODS
            .into_iter()
            .find(|(whole, _)| began_before && wraps(numbers, *whole, step) && lie_in(numbers, 0.0, *whole))
            .map(|(whole, period)| (whole, format!("a clock of one {period}")))
    };
    let (whole, words) = of_bits().or_else(of_clock)?;
    let (mut shift, mut times, mut before) = (0.0, 0, None);
    for x in numbers.iter_mut() {
        if before.is_some_and(|before| *x < before) {
            shift += whole;
            times += 1;
        }
        before = Some(*x);
        *x += shift;
    }
    Some((words, times))
}

/// Tells whether numbers go back somewhere, and each time from the end of what is counted to its beginning.
fn wraps(numbers: &[f64], whole: f64, step: f64) -> bool {
    let mut back = numbers.windows(2).filter(|pair| pair[1] < pair[0]).peekable();
    let over_the_end = |pair: &[f64]| pair[1] + whole - pair[0] <= NEAR_STEPS * step;
    back.peek().is_some() && back.all(over_the_end)
}

/// Tells whether all numbers are among so many from one on.
fn lie_in(numbers: &[f64], from: f64, whole: f64) -> bool {
    numbers.iter().all(|x| (from..from + whole).contains(x))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_counter_goes_on_over_its_end_and_a_second_run_does_not() {
        let mut ms: Vec<f64> = (0..100).map(|k| f64::from((64_900 + 20 * k) % 65_536)).collect();
        assert_eq!(unwrapped(&mut ms), Some(("a counter of 16 bits".to_owned(), 1)));
        assert!(ms.windows(2).all(|pair| pair[1] - pair[0] == 20.0));
        let mut us: Vec<f64> = (0..100_u64).map(|k| ((4_294_000_000 + 20_000 * k) % 4_294_967_296) as f64).collect();
        assert_eq!(unwrapped(&mut us), Some(("a counter of 32 bits".to_owned(), 1)));
        let mut signed: Vec<f64> = (0..100).map(|k| f64::from((32_000 + 20 * k + 32_768) % 65_536 - 32_768)).collect();
        assert_eq!(unwrapped(&mut signed), Some(("a counter of 16 bits".to_owned(), 1)));
        assert!(signed.windows(2).all(|pair| pair[1] - pair[0] == 20.0));
        let mut again: Vec<f64> = (0..100).map(|k| f64::from(20 * (k % 50))).collect();
        assert_eq!(unwrapped(&mut again), None);
        assert_eq!(unwrapped(&mut [0.0, 1.0, 2.0]), None);
    }

    #[test]
    fn a_clock_of_one_minute_goes_on_and_a_second_run_of_a_minute_does_not() {
        let within = |from_s: f64, whole_s: f64, factor: f64| -> Vec<f64> {
            (0..4000).map(|k| factor * ((from_s + 0.02 * f64::from(k)) % whole_s)).collect()
        };
        for (from_s, whole_s, factor, words, times) in [
            (45.01, 60.0, 1.0, "a clock of one minute", 2),
            (45.0, 60.0, 1e3, "a clock of one minute", 2),
            (3590.0, 3600.0, 1.0, "a clock of one hour", 1),
            (86_390.0, 86_400.0, 1.0, "a clock of one day", 1),
            (604_790.0, 604_800.0, 1.0, "a clock of one week", 1),
        ] {
            let mut found = within(from_s, whole_s, factor);
            assert_eq!(unwrapped(&mut found), Some((words.to_owned(), times)));
            assert!(found.windows(2).all(|pair| (pair[1] - pair[0] - 0.02 * factor).abs() < 1e-6 * factor), "{words}");
        }
        assert_eq!(unwrapped(&mut within(0.0, 60.0, 1.0)), None, "two runs of a minute each, or one");
        assert_eq!(unwrapped(&mut within(45.0, 59.0, 1.0)), None, "a second run");
        let mut us: Vec<f64> = (0..100).map(|k| f64::from((16_000_000 + 20_000 * k) % 16_777_216)).collect();
        assert_eq!(unwrapped(&mut us), Some(("a counter of 24 bits".to_owned(), 1)));
    }
}
