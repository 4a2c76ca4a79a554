//! Linear least squares with uncertainty.
//!
//! ```text
//! x = argmin |A x − b|²,     cov x = s² (AᵀA)⁻¹,     s² = |A x − b|²/(m − n)
//! ```

use nalgebra::{DMatrix, DVector};

use crate::FitError;

/// The solution of a linear least-squares problem.
#[derive(Debug, Clone, PartialEq)]
pub struct LinearFit {
    /// Coefficients.
    pub x: Vec<f64>,
    /// Their standard errors.
    pub sd: Vec<f64>,
    /// Root of the mean squared residual.
    pub rms: f64,
    /// Largest ratio of singular values of the scaled columns: above 1e4 some combination is a guess.
    pub condition: f64,
}

/// Solves `A x ≈ b`, columns of `A` given one by one.
///
/// # Errors
/// Fewer rows than columns, or columns that depend on each other (`what` names what was solved for).
pub fn solve(columns: &[Vec<f64>], b: &[f64], what: &str) -> Result<LinearFit, FitError> {
    let (m, n) = (b.len(), columns.len());
    let singular = |problem: &str| FitError::Singular { what: what.to_owned(), problem: problem.to_owned() };
    if m <= n {
        return Err(singular("fewer equations than unknowns; record more"));
    }
    let norms: Vec<f64> = columns.iter().map(|c| super::levenberg::dot(c, c).sqrt()).collect();
    if norms.iter().any(|norm| !(*norm > 0.0 && norm.is_finite())) {
        return Err(singular("a column is zero or not finite; the recordings do not excite it"));
    }
    let a = DMatrix::from_fn(m, n, |i, k| columns[k].get(i).copied().unwrap_or(0.0) / norms[k]);
    let svd = a.clone().svd(true, true);
    let (least, largest) =
        svd.singular_values.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), s| (l.min(*s), h.max(*s)));
    let condition = largest / least;
    // Relative to rounding, nothing is left of the smallest combination.
    if condition.is_nan() || condition >= 1e12 {
        return Err(singular("the columns depend on each other; the recordings do not tell them apart"));
    }
    let rhs = DVector::from_column_slice(b);
    let scaled = svd.solve(&rhs, 0.0).map_err(singular)?;
    let residual = &a * &scaled - &rhs;
    let variance = residual.norm_squared() / (m - n) as f64;
    let inverse = (a.transpose() * &a).try_inverse().ok_or_else(|| singular("the columns depend on each other"))?;
    Ok(LinearFit {
        x: scaled.iter().zip(&norms).map(|(x, norm)| x / norm).collect(),
        sd: norms.iter().enumerate().map(|(k, norm)| (variance * inverse[(k, k)]).max(0.0).sqrt() / norm).collect(),
        rms: (residual.norm_squared() / m as f64).sqrt(),
        condition,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The straight line through (0, 1), (1, 3), (2, 4): slope 3/2, offset 7/6, by hand.
    #[test]
    fn a_line_through_three_points() {
        let fit = solve(&[vec![1.0; 3], vec![0.0, 1.0, 2.0]], &[1.0, 3.0, 4.0], "line").unwrap();
        assert!((fit.x[0] - 7.0 / 6.0).abs() < 1e-14 && (fit.x[1] - 1.5).abs() < 1e-14, "{fit:?}");
        // Residuals ∓1/6, 1/3: s² = 1/6; sd of the slope √(s²/Σ(x − x̄)²) = √(1/12).
        assert!((fit.sd[1] - (1.0_f64 / 12.0).sqrt()).abs() < 1e-14);
    }

    #[test]
    fn dependent_columns_are_refused_in_words() {
        let message = solve(&[vec![1.0; 4], vec![2.0; 4]], &[1.0, 2.0, 3.0, 4.0], "valve").unwrap_err().to_string();
        assert!(message.starts_with("valve: ") && message.contains("depend on each other"), "{message}");
    }
}
