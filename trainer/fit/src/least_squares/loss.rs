//! Cost of a residual: half its square, or less where it is far out.

/// The loss of a residual `r` in units of its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Loss {
    /// `ρ = r²/2`: least squares, the likelihood of Gaussian noise.
    Gaussian,
    /// `ρ = (ν + 1)/2 · ln(1 + r²/ν)`: the likelihood of Student's t with ν degrees of freedom, for which a few wild
    /// readings count no more than they tell (Lange, Little & Taylor 1989). 5 is a usual choice.
    Student {
        /// ν, above 2.
        freedom: f64,
    },
}

impl Loss {
    /// ρ(r).
    #[inline]
    pub fn cost(self, residual: f64) -> f64 {
        match self {
            Loss::Gaussian => 0.5 * residual * residual,
            Loss::Student { freedom } => 0.5 * (freedom + 1.0) * (residual * residual / freedom).ln_1p(),
        }
    }

    /// `ρ'(r)/r`: the weight of a residual in iteratively reweighted least squares.
    #[inline]
    pub fn weight(self, residual: f64) -> f64 {
        match self {
            Loss::Gaussian => 1.0,
            Loss::Student { freedom } => (freedom + 1.0) / (freedom + residual * residual),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weight_is_the_slope_over_the_residual() {
        let loss = Loss::Student { freedom: 5.0 };
        for r in [0.01, 0.7, 3.0, -40.0] {
            let h = 1e-5 * f64::max(1.0, f64::abs(r));
            let slope = (loss.cost(r + h) - loss.cost(r - h)) / (2.0 * h);
            // Central differences of a smooth function: h² ρ'''/6 and rounding of 1e-16/h.
            assert!((slope / r - loss.weight(r)).abs() < 1e-8, "{r}");
        }
        // Far inside both losses are alike up to the factor (ν + 1)/ν.
        assert!((loss.cost(1e-3) / Loss::Gaussian.cost(1e-3) - 1.2).abs() < 1e-6);
    }
}
