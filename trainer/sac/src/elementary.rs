//! Elementary functions of f32 without branches, so that a loop over lanes becomes vector code, and with fused
//! products throughout, so that it gives the same bits at any width. The polynomials are those of Cephes (Moshier).

use std::f32::consts::LOG2_E;

/// `ln 2` in two parts, the first exact in few bits.
const LN_2_HIGH: f32 = 0.693_359_4;
const LN_2_LOW: f32 = -2.121_944_4e-4;

/// `Σ c_i xⁱ` with the highest power first.
#[inline(always)]
fn polynomial<const N: usize>(x: f32, coefficients: [f32; N]) -> f32 {
    coefficients.into_iter().fold(0.0, |sum, c| sum.mul_add(x, c))
}

/// `eˣ` for `x` within ±87, beyond which it stays at the value there; relative error below 2e-7.
#[inline(always)]
pub(crate) fn exp(x: f32) -> f32 {
    // Written as comparisons, which keep a NaN.
    let x = if x > 87.0 { 87.0 } else { x };
    let x = if x < -87.0 { -87.0 } else { x };
    let n = nearest(x * LOG2_E);
    let r = (-n).mul_add(LN_2_LOW, (-n).mul_add(LN_2_HIGH, x));
    const SERIES: [f32; 6] = [1.987_569_1e-4, 1.398_2e-3, 8.333_452e-3, 4.166_579_6e-2, 0.166_666_65, 0.5];
    let e = (r * r).mul_add(polynomial(r, SERIES), r) + 1.0;
    e * f32::from_bits(((as_integer(n) + 127) << 23) as u32)
}

/// The logarithm of a positive normal number; relative error below 2e-7.
#[inline(always)]
pub(crate) fn ln(x: f32) -> f32 {
    let bits = x.to_bits() as i32;
    // The mantissa in [√½, √2): what is taken off the exponent there goes to the mantissa.
    let shifted = bits - 0x3f35_04f3;
    let exponent = (shifted >> 23) as f32;
    let m = f32::from_bits((bits - (shifted & !0x7f_ffff)) as u32) - 1.0;
    const SERIES: [f32; 9] = [
        7.037_683_6e-2,
        -0.115_146_1,
        0.116_769_984,
        -0.124_201_41,
        0.142_493_23,
        -0.166_680_57,
        0.200_007_14,
        -0.249_999_94,
        0.333_333_3,
    ];
    let square = m * m;
    let tail = (m * square).mul_add(polynomial(m, SERIES), exponent.mul_add(LN_2_LOW, -0.5 * square));
    exponent.mul_add(LN_2_HIGH, m + tail)
}

/// `tanh x`; absolute error below 1.2e-7, relative error as small near zero.
#[inline(always)]
pub(crate) fn tanh(x: f32) -> f32 {
    let size = x.abs();
    let e = exp(-2.0 * size);
    let far = ((1.0 - e) / (1.0 + e)).copysign(x);
    let square = x * x;
    const SERIES: [f32; 5] = [-5.704_988_7e-3, 2.063_909e-2, -5.373_971_6e-2, 0.133_314_42, -0.333_332_8];
    let near = (square * polynomial(square, SERIES)).mul_add(x, x);
    if size < 0.625 { near } else { far }
}

/// `ln(1 − tanh² x) = 2 (ln 2 − |x| − ln(1 + e^(−2|x|)))`, finite for every finite `x`.
#[inline(always)]
pub(crate) fn ln_tanh_slope(x: f32) -> f32 {
    let size = x.abs();
    2.0 * (std::f32::consts::LN_2 - size - ln(1.0 + exp(-2.0 * size)))
}

/// `(sin, cos)` of `turns` whole turns, `0 ≤ turns ≤ 1`; absolute error below 2e-7.
#[inline(always)]
pub(crate) fn sin_cos_of_turns(turns: f32) -> (f32, f32) {
    let quarters = nearest(4.0 * turns);
    // Within an eighth of a turn, in radians.
    let r = (turns - 0.25 * quarters) * std::f32::consts::TAU;
    let square = r * r;
    let sin = (square * r).mul_add(polynomial(square, [-1.951_529_6e-4, 8.332_161e-3, -0.166_666_55]), r);
    const COSINE: [f32; 3] = [2.443_315_7e-5, -1.388_731_6e-3, 4.166_664_6e-2];
    let cos = (square * square).mul_add(polynomial(square, COSINE), (-0.5f32).mul_add(square, 1.0));
    let quarter = as_integer(quarters);
    let (s, c) = if quarter & 1 == 0 { (sin, cos) } else { (cos, sin) };
    let s = if quarter & 2 == 0 { s } else { -s };
    let c = if (quarter + 1) & 2 == 0 { c } else { -c };
    (s, c)
}

/// Adding and subtracting this rounds to a whole number (within ±2²²) in any vector unit.
const WHOLE: f32 = 12_582_912.0;

/// The nearest whole number, ties to even.
#[inline(always)]
fn nearest(x: f32) -> f32 {
    (x + WHOLE) - WHOLE
}

/// A whole number within ±2²² as an integer.
#[inline(always)]
fn as_integer(whole: f32) -> i32 {
    (whole + WHOLE).to_bits() as i32 - WHOLE.to_bits() as i32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest error of `ours` over a grid, against f64, in the measure given.
    fn worst(range: (f64, f64), ours: impl Fn(f32) -> f32, true_value: impl Fn(f64) -> f64, relative: bool) -> f64 {
        let points = 200_001;
        let at = |i: usize| (range.0 + (range.1 - range.0) * i as f64 / (points - 1) as f64) as f32;
        let error = |x: f32| {
            let (a, b) = (f64::from(ours(x)), true_value(f64::from(x)));
            if relative { ((a - b) / b).abs() } else { (a - b).abs() }
        };
        (0..points).map(at).filter(|&x| !relative || true_value(f64::from(x)) != 0.0).map(error).fold(0.0, f64::max)
    }

    // The bounds are a few units in the last place (6e-8), as the documentation of each function says.
    #[test]
    fn errors_are_a_few_units_in_the_last_place() {
        assert!(worst((-80.0, 80.0), exp, f64::exp, true) < 2e-7);
        assert!(worst((1e-7, 3.0), ln, f64::ln, false) < 1.2e-6);
        assert!(worst((0.9, 1.1), ln, f64::ln, true) < 2e-7);
        assert!(worst((-12.0, 12.0), tanh, f64::tanh, false) < 1.2e-7);
        assert!(worst((-0.7, 0.7), tanh, f64::tanh, true) < 2.5e-7);
        let slope = |x: f64| -2.0 * x.cosh().ln();
        assert!(worst((-12.0, 12.0), ln_tanh_slope, slope, false) < 2e-6);
        assert!(worst((0.0, 1.0), |t| sin_cos_of_turns(t).0, |t| (t * std::f64::consts::TAU).sin(), false) < 2e-7);
        assert!(worst((0.0, 1.0), |t| sin_cos_of_turns(t).1, |t| (t * std::f64::consts::TAU).cos(), false) < 2e-7);
    }

    #[test]
    fn a_nan_stays_one() {
        assert!(exp(f32::NAN).is_nan() && tanh(f32::NAN).is_nan() && ln_tanh_slope(f32::NAN).is_nan());
    }

    #[test]
    fn far_out_values_are_limits() {
        assert_eq!(tanh(100.0), 1.0);
        assert_eq!(tanh(-100.0), -1.0);
        assert!(ln_tanh_slope(1e4).is_finite() && exp(1e4).is_finite() && exp(-1e4) > 0.0);
    }
}
