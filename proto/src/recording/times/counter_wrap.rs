//! Counters of ms or µs that begin anew when their bits are used up: at zero, as `millis()` of a small computer does, or at the most
//! negative number, where they were written with a sign.

/// Bits of such counters.
const BITS: [u32; 2] = [16, 32];
/// Usual steps within which a counter goes over its end; a run that begins anew stops anywhere.
const NEAR_STEPS: f64 = 8.0;

/// Takes the jumps back out of a counter's numbers; the bits that it has, and how often it began anew.
pub(crate) fn unwrapped(numbers: &mut [f64]) -> Option<(u32, usize)> {
    if numbers.iter().any(|x| x.fract() != 0.0) {
        return None;
    }
    let step = crate::recording::rows::resample::median_step(numbers).filter(|step| *step > 0.0)?;
    let bits = BITS.into_iter().find(|bits| wraps(numbers, 2.0_f64.powi(*bits as i32), step))?;
    let whole = 2.0_f64.powi(bits as i32);
    let (mut shift, mut times, mut before) = (0.0, 0, None);
    for x in numbers.iter_mut() {
        if before.is_some_and(|before| *x < before) {
            shift += whole;
            times += 1;
        }
        before = Some(*x);
        *x += shift;
    }
    Some((bits, times))
}

/// Tells whether numbers go back somewhere, and each time from the end of such a counter to its beginning.
fn wraps(numbers: &[f64], whole: f64, step: f64) -> bool {
    let mut back = numbers.windows(2).filter(|pair| pair[1] < pair[0]).peekable();
    let over_the_end = |pair: &[f64]| pair[1] + whole - pair[0] <= NEAR_STEPS * step;
    let lies_in = |from: f64| numbers.iter().all(|x| (from..from + whole).contains(x));
    back.peek().is_some() && back.all(over_the_end) && (lies_in(0.0) || lies_in(-0.5 * whole))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_counter_goes_on_over_its_end_and_a_second_run_does_not() {
        let mut ms: Vec<f64> = (0..100).map(|k| f64::from((64_900 + 20 * k) % 65_536)).collect();
        assert_eq!(unwrapped(&mut ms), Some((16, 1)));
        assert!(ms.windows(2).all(|pair| pair[1] - pair[0] == 20.0));
        let mut us: Vec<f64> = (0..100_u64).map(|k| ((4_294_000_000 + 20_000 * k) % 4_294_967_296) as f64).collect();
        assert_eq!(unwrapped(&mut us), Some((32, 1)));
        let mut signed: Vec<f64> = (0..100).map(|k| f64::from((32_000 + 20 * k + 32_768) % 65_536 - 32_768)).collect();
        assert_eq!(unwrapped(&mut signed), Some((16, 1)));
        assert!(signed.windows(2).all(|pair| pair[1] - pair[0] == 20.0));
        let mut again: Vec<f64> = (0..100).map(|k| f64::from(20 * (k % 50))).collect();
        assert_eq!(unwrapped(&mut again), None);
        assert_eq!(unwrapped(&mut [0.0, 1.0, 2.0]), None);
    }
}
