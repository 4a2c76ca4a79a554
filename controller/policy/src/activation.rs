//! Activation functions with the same bits on every machine.
//!
//! A libm's `tanhf` differs between C libraries and CPUs; a replay must not. Everything here is built
//! from IEEE 754 additions, multiplications and divisions in f64, rounded to f32 once at the end, with
//! no branch that depends on the CPU; loops have no calls, so that the compiler makes lanes of them.
//!
//! With `x = k ln 2 + r`, `|r| <= ln 2 / 2`, and the Taylor polynomial `P(r) = exp(r) - 1`:
//! ```text
//! exp(x)      = 2^k + 2^k P(r)
//! expm1(x)    = 2^k P(r) + (2^k - 1)
//! tanh(x)     = E / (E + 2),            E = expm1(2 x)
//! sigmoid(x)  = 1 / (1 + exp(-x))
//! softplus(x) = max(x, 0) + log1p(exp(-|x|)),   log1p(t) = 2 artanh(t / (2 + t))
//! ```
//! The polynomial has degree 11, its remainder is below 2e-14 of `r`: 1e6 times finer than f32, so a
//! result is the correctly rounded one but for one case in about a million, and then the next number.
//!
//! Every function gives NaN for NaN. `f32::max` would not, and neither do most ONNX runtimes.

/// A function applied to each value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Activation {
    Relu,
    LeakyRelu { slope: f32 },
    Elu { alpha: f32 },
    Tanh,
    Sigmoid,
    Softplus,
    Clip { low: f32, high: f32 },
}

impl Activation {
    /// The ONNX operator's name in lower case, for descriptions.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Relu => "relu",
            Self::LeakyRelu { .. } => "leaky relu",
            Self::Elu { .. } => "elu",
            Self::Tanh => "tanh",
            Self::Sigmoid => "sigmoid",
            Self::Softplus => "softplus",
            Self::Clip { .. } => "clip",
        }
    }

    /// Replaces every value by the function of it.
    ///
    /// # Real-time
    /// Bounded, allocates nothing.
    #[inline(always)]
    pub(crate) fn apply(self, values: &mut [f32]) {
        match self {
            Self::Relu => each(values, |x| if x < 0.0 { 0.0 } else { x }),
            Self::LeakyRelu { slope } => each(values, |x| if x < 0.0 { slope * x } else { x }),
            Self::Elu { alpha } => each(values, |x| elu(x, alpha)),
            Self::Tanh => each(values, tanh),
            Self::Sigmoid => each(values, sigmoid),
            Self::Softplus => each(values, softplus),
            Self::Clip { low, high } => each(values, |x| clip(x, low, high)),
        }
    }
}

#[inline(always)]
fn each(values: &mut [f32], f: impl Fn(f32) -> f32) {
    for x in values {
        *x = f(*x);
    }
}

#[inline(always)]
fn tanh(x: f32) -> f32 {
    // Beyond 20 the result is 1 to the last bit of an f64.
    let e = expm1(limited(2.0 * f64::from(x), 40.0));
    (e / (e + 2.0)) as f32
}

#[inline(always)]
fn sigmoid(x: f32) -> f32 {
    (1.0 / (1.0 + exp(limited(-f64::from(x), 110.0)))) as f32
}

#[inline(always)]
fn elu(x: f32, alpha: f32) -> f32 {
    let below = (f64::from(alpha) * expm1(limited(f64::from(x), 60.0))) as f32;
    if x < 0.0 { below } else { x }
}

#[inline(always)]
fn softplus(x: f32) -> f32 {
    let x = f64::from(x);
    let t = exp(limited(-x.abs(), 110.0));
    let s = t / (2.0 + t);
    let s2 = s * s;
    // artanh(s) / s - 1, s <= 1/3: the first term left out is s^26 / 27 = 1.5e-14.
    let mut series = 1.0 / 25.0;
    for n in [23.0, 21.0, 19.0, 17.0, 15.0, 13.0, 11.0, 9.0, 7.0, 5.0, 3.0] {
        series = series * s2 + 1.0 / n;
    }
    let log1p = 2.0 * s * (1.0 + s2 * series);
    ((if x < 0.0 { 0.0 } else { x }) + log1p) as f32
}

#[inline(always)]
fn clip(x: f32, low: f32, high: f32) -> f32 {
    let x = if x < low { low } else { x };
    if x > high { high } else { x }
}

/// `x` held within `-bound..=bound`; NaN stays NaN.
#[inline(always)]
fn limited(x: f64, bound: f64) -> f64 {
    let x = if x < -bound { -bound } else { x };
    if x > bound { bound } else { x }
}

/// `exp(x)` for `|x| <= 700`.
#[inline(always)]
fn exp(x: f64) -> f64 {
    let (power, p) = reduced(x);
    power * p + power
}

/// `exp(x) - 1` for `|x| <= 700`, without cancellation near zero.
#[inline(always)]
fn expm1(x: f64) -> f64 {
    let (power, p) = reduced(x);
    power * p + (power - 1.0)
}

/// `(2^k, exp(r) - 1)` of the argument reduction above.
#[inline(always)]
fn reduced(x: f64) -> (f64, f64) {
    // 1.5 * 2^52: adding it leaves the rounded integer in the low bits of the sum.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    // ln 2 in two parts: the first has 21 trailing zero bits, so that k times it is exact.
    const LN2_HIGH: f64 = f64::from_bits(0x3fe6_2e42_fee0_0000);
    const LN2_LOW: f64 = 1.908_214_929_270_587_7e-10;
    let shifted = x * std::f64::consts::LOG2_E + ROUND;
    let k = shifted - ROUND;
    let power = f64::from_bits(shifted.to_bits().wrapping_add(1023) << 52);
    let r = (x - k * LN2_HIGH) - k * LN2_LOW;
    let mut p = 1.0 / 39_916_800.0;
    for factorial in [3_628_800.0, 362_880.0, 40_320.0, 5_040.0, 720.0, 120.0, 24.0, 6.0, 2.0, 1.0] {
        p = p * r + 1.0 / factorial;
    }
    (power, p * r)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Distance in representable f32 numbers.
    fn ulps(a: f32, b: f32) -> u32 {
        let key = |x: f32| {
            let bits = x.to_bits() as i32;
            if bits < 0 { i32::MIN.wrapping_sub(bits) } else { bits }
        };
        key(a).wrapping_sub(key(b)).unsigned_abs()
    }

    /// Every 977th f32 of both signs, subnormals to infinity: 4.4 million values.
    fn sweep() -> impl Iterator<Item = f32> {
        (0..=f32::INFINITY.to_bits()).step_by(977).flat_map(|bits| {
            let x = f32::from_bits(bits);
            [x, -x]
        })
    }

    fn worst(ours: impl Fn(f32) -> f32, exact: impl Fn(f64) -> f64) -> (u32, f64) {
        let (mut most, mut differing, mut count) = (0, 0u32, 0u32);
        for x in sweep() {
            let off = ulps(ours(x), exact(f64::from(x)) as f32);
            most = most.max(off);
            differing += u32::from(off > 0);
            count += 1;
        }
        (most, f64::from(differing) / f64::from(count))
    }

    /// Against the C library in f64, itself good to 1e-16: at most the neighbouring f32, and that
    /// rarely (a correct f64 result falls the other side of a rounding boundary once in 1e8 or so).
    #[test]
    fn within_one_ulp_over_the_whole_line() {
        let ln1p_exp = |x: f64| x.max(0.0) + (-x.abs()).exp().ln_1p();
        let cases: [(&str, (u32, f64)); 4] = [
            ("tanh", worst(tanh, f64::tanh)),
            ("sigmoid", worst(sigmoid, |x| 1.0 / (1.0 + (-x).exp()))),
            ("softplus", worst(softplus, ln1p_exp)),
            ("elu", worst(|x| elu(x, 1.0), |x| if x < 0.0 { x.exp_m1() } else { x })),
        ];
        for (name, (ulps, share)) in cases {
            assert!(ulps <= 1 && share < 1e-5, "{name}: {ulps} ulp, {share:.1e} of values differ");
        }
    }

    /// Abramowitz & Stegun, tables 4.15 and 4.4: tanh 1 = 0.76159 41560, tanh 0.5 = 0.46211 71573,
    /// e^-1 = 0.36787 94412; ln 2 from the standard library.
    #[test]
    fn table_values() {
        assert_eq!(tanh(1.0), 0.761_594_156_0_f64 as f32);
        assert_eq!(tanh(-0.5), -0.462_117_157_3_f64 as f32);
        assert_eq!(sigmoid(0.0), 0.5);
        assert_eq!(softplus(0.0), std::f32::consts::LN_2);
        assert_eq!(elu(-1.0, 2.0), (2.0 * (0.367_879_441_2_f64 - 1.0)) as f32);
    }

    #[test]
    fn limits_and_signs() {
        for (x, t, s) in [(f32::INFINITY, 1.0, 1.0), (f32::NEG_INFINITY, -1.0, 0.0)] {
            assert_eq!(tanh(x), t);
            assert!((sigmoid(x) - s).abs() < 1e-40);
        }
        assert_eq!(tanh(1e-40), 1e-40, "subnormals pass through");
        assert_eq!(clip(3.0, 0.0, 1.0), 1.0);
        assert_eq!(clip(-3.0, 0.0, 1.0), 0.0);
        let mut x = [-2.0, 2.0];
        Activation::LeakyRelu { slope: 0.25 }.apply(&mut x);
        assert_eq!(x, [-0.5, 2.0]);
    }

    const ALL: [Activation; 7] = [
        Activation::Relu,
        Activation::LeakyRelu { slope: 0.1 },
        Activation::Elu { alpha: 1.0 },
        Activation::Tanh,
        Activation::Sigmoid,
        Activation::Softplus,
        Activation::Clip { low: 0.0, high: 1.0 },
    ];

    /// The compiler makes lanes of a long slice and single steps of its end; the bits must not differ.
    #[test]
    fn lanes_give_the_bits_of_single_values() {
        for activation in ALL {
            let values: Vec<f32> = (0..1003).map(|i| (i as f32 * 0.37).sin() * 12.0).collect();
            let mut together = values.clone();
            activation.apply(&mut together);
            for (value, together) in values.iter().zip(together) {
                let mut alone = std::hint::black_box([*value]);
                activation.apply(&mut alone);
                assert_eq!(alone[0].to_bits(), together.to_bits(), "{activation:?} of {value}");
            }
        }
    }

    #[test]
    fn nan_stays_nan() {
        for activation in ALL {
            let mut x = [f32::NAN; 9];
            activation.apply(&mut x);
            assert!(x.iter().all(|v| v.is_nan()), "{activation:?}");
        }
    }
}
