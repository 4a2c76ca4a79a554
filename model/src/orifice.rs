//! Mass flow through an orifice, from standstill to choking, for one branch and no power function.
//!
//! The paper's eq. (3) (Blackburn, Reethof & Shearer; Ben-Dov & Salcudean):
//!
//! ```text
//! ṁ = A · P_up / √(R T_up) · Φ(p),      p = P_down / P_up
//! Φ(p) = √(κ (2/(κ+1))^((κ+1)/(κ−1)))                     p ≤ p_cr    (choked)
//!      = √(2κ/(κ−1)) √(p^(2/κ) − p^((κ+1)/κ))      p_cr < p ≤ 1
//!      = 0                                              p > 1
//! ```
//!
//! `A` is the effective area `C·S` in m². Two observations make it cheap:
//!
//! * With `d = 1 − p`, `Φ² = d · g(d)` where `g` is analytic on the whole working range
//!   `0 ≤ d ≤ 1 − p_cr` (its nearest singularity is at `d = 1`). A polynomial of degree 11 through
//!   Chebyshev nodes reproduces it to better than 1e-10 relative, so the powers vanish and the root
//!   singularity at `p = 1` is kept exactly.
//! * Limiting `d` to `[0, 1 − p_cr]` *is* the case distinction: `d ≤ 0` gives zero flow (a one-way
//!   element), `d ≥ 1 − p_cr` gives the choked value.
//!
//! The ISO 6358 law with another critical ratio `b`, `Φ = Φ* √(1 − ((p−b)/(1−b))²)`, has the same
//! form with a polynomial `g` of degree one, so it is the same code with other coefficients.

use crate::real::Real;

/// Number of coefficients of the polynomial `g(d)`.
const TERMS: usize = 12;

/// The outflow function `Φ(p)` of one kind of orifice, as `Φ² = d·g(d)` with `d = 1 − p`.
#[derive(Debug, Clone, Copy)]
pub struct FlowFunction<R> {
    coefficients: [R; TERMS],
    /// Largest useful `d`: one minus the critical pressure ratio.
    choking_drop: R,
    /// `Φ` when choked.
    choked: R,
}

/// The critical pressure ratio of an ideal nozzle, `(2/(κ+1))^(κ/(κ−1))`; 0.5283 for air.
pub fn critical_ratio(heat_capacity_ratio: f64) -> f64 {
    (2.0 / (heat_capacity_ratio + 1.0)).powf(heat_capacity_ratio / (heat_capacity_ratio - 1.0))
}

/// `Φ` of an ideal nozzle when choked, `√(κ (2/(κ+1))^((κ+1)/(κ−1)))`; 0.6847 for air.
pub fn choked_value(heat_capacity_ratio: f64) -> f64 {
    let k = heat_capacity_ratio;
    (k * (2.0 / (k + 1.0)).powf((k + 1.0) / (k - 1.0))).sqrt()
}

impl FlowFunction<f64> {
    /// The ideal nozzle of eq. (3) for a gas with heat-capacity ratio κ > 1 (dimensionless).
    pub fn nozzle(heat_capacity_ratio: f64) -> Self {
        let k = heat_capacity_ratio;
        let choking_drop = 1.0 - critical_ratio(k);
        let g = |d: f64| {
            // (1 − p^((κ−1)/κ)) / d by expm1, which keeps all digits as d → 0.
            let log_p = (-d).ln_1p();
            let bracket = -((k - 1.0) / k * log_p).exp_m1() / d;
            2.0 * k / (k - 1.0) * (2.0 / k * log_p).exp() * bracket
        };
        Self::through(g, choking_drop)
    }

    /// The ISO 6358 ellipse with critical ratio `b` in (0, 1), scaled to the nozzle's choked value.
    pub fn iso_6358(heat_capacity_ratio: f64, b: f64) -> Self {
        let choked = choked_value(heat_capacity_ratio);
        let span = 1.0 - b;
        // 1 − ((p−b)/(1−b))² = d (2(1−b) − d) / (1−b)²
        Self::through(|d| choked * choked * (2.0 * span - d) / (span * span), span)
    }

    /// Interpolates `g` on `[0, choking_drop]` at Chebyshev nodes and stores it in powers of `d`.
    fn through(g: impl Fn(f64) -> f64, choking_drop: f64) -> Self {
        let mut nodes = [0.0; TERMS];
        let mut divided = [0.0; TERMS];
        for (i, (node, value)) in nodes.iter_mut().zip(&mut divided).enumerate() {
            let angle = std::f64::consts::PI * (i as f64 + 0.5) / TERMS as f64;
            *node = 0.5 * choking_drop * (1.0 - angle.cos());
            *value = g(*node);
        }
        // Newton's divided differences, then expanded to powers from the innermost bracket out.
        for order in 1..TERMS {
            for i in (order..TERMS).rev() {
                divided[i] = (divided[i] - divided[i - 1]) / (nodes[i] - nodes[i - order]);
            }
        }
        let mut coefficients = [0.0; TERMS];
        for i in (0..TERMS).rev() {
            for j in (1..TERMS).rev() {
                coefficients[j] = coefficients[j - 1] - nodes[i] * coefficients[j];
            }
            coefficients[0] = divided[i] - nodes[i] * coefficients[0];
        }
        let mut function = FlowFunction { coefficients, choking_drop, choked: 0.0 };
        // Evaluated by the same arithmetic, so that the shortcut for choked flow has the same bits.
        function.choked = function.unchoked(choking_drop);
        function
    }
}

impl<R: Real> FlowFunction<R> {
    /// Puts one function per lane side by side; lanes beyond the last repeat it.
    pub fn from_lanes(functions: &[FlowFunction<f64>]) -> Self {
        let pick = |f: &dyn Fn(&FlowFunction<f64>) -> f64| {
            R::from_lanes(|lane| functions.get(lane).or(functions.last()).map_or(f64::NAN, f))
        };
        FlowFunction {
            coefficients: std::array::from_fn(|i| pick(&|f| f.coefficients[i])),
            choking_drop: pick(&|f| f.choking_drop),
            choked: pick(&|f| f.choked),
        }
    }

    /// `Φ` for a relative pressure drop `d = 1 − P_down/P_up` of any size and sign.
    #[inline(always)]
    pub fn at_drop(&self, d: R) -> R {
        if d.all_at_least(self.choking_drop) {
            return self.choked;
        }
        self.unchoked(d.limited(R::splat(0.0), self.choking_drop))
    }

    /// Estrin's scheme: the chain of dependent operations is four deep instead of eleven.
    #[inline(always)]
    fn unchoked(&self, d: R) -> R {
        let c = &self.coefficients;
        let d2 = d * d;
        let d4 = d2 * d2;
        let d8 = d4 * d4;
        let p01 = c[1].mul_add(d, c[0]);
        let p23 = c[3].mul_add(d, c[2]);
        let p45 = c[5].mul_add(d, c[4]);
        let p67 = c[7].mul_add(d, c[6]);
        let p89 = c[9].mul_add(d, c[8]);
        let pab = c[11].mul_add(d, c[10]);
        let p03 = p23.mul_add(d2, p01);
        let p47 = p67.mul_add(d2, p45);
        let p8b = pab.mul_add(d2, p89);
        let p07 = p47.mul_add(d4, p03);
        let g = p8b.mul_add(d8, p07);
        (d * g).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Eq. (3) as printed, with powers.
    fn printed(k: f64, p: f64) -> f64 {
        if p > 1.0 {
            0.0
        } else if p <= critical_ratio(k) {
            choked_value(k)
        } else {
            (2.0 * k / (k - 1.0)).sqrt() * (p.powf(2.0 / k) - p.powf((k + 1.0) / k)).sqrt()
        }
    }

    #[test]
    fn polynomial_reproduces_the_printed_formula() {
        for k in [1.3, 1.4, 1.667] {
            let f = FlowFunction::nozzle(k);
            for i in 0..=10_000 {
                let p = f64::from(i) / 9_500.0;
                let (ours, exact) = (f.at_drop(1.0 - p), printed(k, p));
                // Near p = 1 the printed difference of powers itself loses digits; hence the absolute part.
                assert!((ours - exact).abs() < 1e-10 * exact + 3e-9, "κ {k}, p {p}: {ours} against {exact}");
            }
        }
    }

    #[test]
    fn iso_6358_reproduces_the_ellipse() {
        let (k, b) = (1.4, 0.3);
        let f = FlowFunction::iso_6358(k, b);
        for i in 0..=1000 {
            let p = f64::from(i) / 1000.0;
            let exact = if p <= b { 1.0 } else { (1.0 - ((p - b) / (1.0 - b)).powi(2)).sqrt() } * choked_value(k);
            assert!((f.at_drop(1.0 - p) - exact).abs() < 1e-12, "p {p}");
        }
    }

    #[test]
    fn choked_flow_of_air_has_the_textbook_value() {
        assert!((critical_ratio(1.4) - 0.528_281_787_7).abs() < 1e-9);
        assert!((FlowFunction::nozzle(1.4).at_drop(0.9) - 0.684_731_456_4).abs() < 1e-9);
    }

    #[test]
    fn reverse_pressure_gives_exactly_nothing() {
        let f = FlowFunction::nozzle(1.4);
        assert_eq!(f.at_drop(-0.5), 0.0);
        assert_eq!(f.at_drop(0.0), 0.0);
    }
}
