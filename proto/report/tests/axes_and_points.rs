//! Ticks are round and within the axis; thinned-out points keep every extreme.

use proptest::prelude::*;
use report::{decimate, ticks_linear, ticks_log};

/// Tells whether a value is 1, 2 or 5 times a power of ten, read from its decimal digits.
fn is_round(value: f64) -> bool {
    // Twelve digits: a difference of two ticks carries the rounding of both.
    let text = format!("{value:.11e}");
    let digits = text.split('e').next().unwrap_or_default().trim_end_matches('0').trim_end_matches('.');
    ["1", "2", "5"].contains(&digits)
}

proptest! {
    #[test]
    fn linear_ticks_are_round_even_and_within(
        middle in -1e4_f64..1e4,
        span_exponent in -3.0_f64..5.0,
        most in 2_usize..14,
    ) {
        let span = 10_f64.powf(span_exponent);
        let (low, high) = (middle - span / 2.0, middle + span / 2.0);
        let ticks = ticks_linear(low, high, most);
        prop_assert!(ticks.len() <= most, "{} of {most}", ticks.len());
        // The next finer step, at most 2.5 times as fine, gave more than `most`.
        prop_assert!(ticks.len() + 1 >= (most + 1) * 2 / 5, "{} of {most}", ticks.len());
        prop_assert!(ticks.iter().all(|tick| (low..=high).contains(tick)), "{ticks:?} in {low} {high}");
        for pair in ticks.windows(2) {
            let step = pair[1] - pair[0];
            // A difference of numbers of 1e4 is known to 2e-12; look at steps that stand above that.
            if step > 1e-2 {
                let rounded = (step * 1e6).round() / 1e6;
                prop_assert!(is_round(rounded), "step {step}");
                let multiple = pair[0] / rounded;
                prop_assert!((multiple - multiple.round()).abs() < 1e-6, "{} of {rounded}", pair[0]);
            }
        }
    }

    #[test]
    fn logarithmic_ticks_are_round_and_within(low_exponent in -9.0_f64..9.0, decades in 0.1_f64..20.0) {
        let (low, high) = (10_f64.powf(low_exponent), 10_f64.powf(low_exponent + decades));
        let ticks = ticks_log(low, high);
        prop_assert!(ticks.iter().all(|tick| (low..=high).contains(tick) && is_round(*tick)), "{ticks:?}");
        prop_assert!(ticks.is_sorted() && ticks.len() <= 12, "{ticks:?}");
        prop_assert!(decades < 1.0 || !ticks.is_empty());
    }

    #[test]
    fn ticks_of_any_numbers_end_and_stay_within(low: f64, high: f64, most in 0_usize..20) {
        let ticks = ticks_linear(low, high, most);
        prop_assert!(ticks.len() <= most.max(2));
        prop_assert!(ticks.iter().chain(&ticks_log(low, high)).all(|tick| (low..=high).contains(tick)));
    }

    #[test]
    fn decimation_keeps_every_columns_extremes_and_both_ends(
        y in proptest::collection::vec(-100.0_f64..100.0, 1..3_000),
        columns in 1_usize..300,
    ) {
        let x: Vec<f64> = (0..y.len()).map(|k| k as f64 * 0.02).collect();
        let kept = decimate(&x, &y, columns);
        prop_assert!(kept.len() <= (4 * columns).max(1), "{} for {columns}", kept.len());
        prop_assert!(kept.windows(2).all(|pair| pair[0] < pair[1]), "in order, none twice");
        prop_assert_eq!((kept.first(), kept.last()), (Some(&0), Some(&(y.len() - 1))));
        // The same columns, found the slow way.
        let width = (x[x.len() - 1] - x[0]) / columns as f64;
        let column_of = |index: usize| (((x[index] - x[0]) / width) as usize).min(columns - 1);
        let extremes = |indices: &mut dyn Iterator<Item = usize>, column: usize| {
            indices.filter(|index| column_of(*index) == column).fold((f64::MAX, f64::MIN), |(low, high), index| {
                (low.min(y[index]), high.max(y[index]))
            })
        };
        for column in 0..columns.min(40) {
            let all = extremes(&mut (0..y.len()), column);
            prop_assert_eq!(extremes(&mut kept.iter().copied(), column), all, "column {}", column);
        }
    }
}

#[test]
fn familiar_axes_get_familiar_ticks() {
    assert_eq!(
        ticks_linear(0.0, 60.0, 13),
        [0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0, 55.0, 60.0]
    );
    assert_eq!(ticks_linear(-0.25, 0.31, 6), [-0.2, -0.1, 0.0, 0.1, 0.2, 0.3]);
    assert_eq!(ticks_linear(-75.3, -69.1, 4), [-74.0, -72.0, -70.0]);
    assert_eq!(ticks_log(0.5, 2_000.0), [1.0, 10.0, 100.0, 1000.0]);
    assert_eq!(ticks_log(3.0, 60.0), [5.0, 10.0, 20.0, 50.0]);
    assert!(ticks_linear(1.0, 1.0, 5).is_empty() && ticks_linear(f64::NAN, 1.0, 5).is_empty());
    assert!(ticks_log(0.0, 10.0).is_empty() && ticks_log(-1.0, 10.0).is_empty());
}

#[test]
fn few_points_and_repeated_times_are_kept_whole() {
    assert_eq!(decimate(&[0.0, 1.0, 2.0], &[1.0, 2.0, 3.0], 10), [0, 1, 2]);
    assert_eq!(decimate(&[], &[], 10), [] as [usize; 0]);
    assert_eq!(decimate(&[5.0; 9], &[1.0; 9], 1).len(), 9);
}
