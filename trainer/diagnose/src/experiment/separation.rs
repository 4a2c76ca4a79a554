//! Distance between rivals in an experiment, all that they could still adjust allowed for.
//!
//! ```text
//! D_ij = min over δ_i, δ_j of  |(y_i + J_i δ_i − y_j − J_j δ_j)/σ|² + δ_iᵀ A_i δ_i + δ_jᵀ A_j δ_j
//! ```
//!
//! with `A` the information of what has been recorded already (and of the priors): the criterion of Hunter & Reiner
//! (1965) with the parameters' uncertainty of Buzzi-Ferraris & Forzatti (1983). `D/2` is what the log-likelihoods of
//! both will differ by on average. Sums over programmes add up, so programmes are chosen one by one.

use nalgebra::{DMatrix, DVector};

/// A rival's readings in one programme and how they move with its parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Predicted {
    /// Readings over σ.
    pub readings: Vec<f64>,
    /// Derivatives of `readings` by coordinate.
    pub jacobian: Vec<Vec<f64>>,
}

/// Evidence of one programme on one pair: sums that add up over programmes.
#[derive(Debug, Clone, PartialEq)]
pub struct PairSums {
    /// JᵀJ of both rivals' coordinates.
    normal: DMatrix<f64>,
    /// Jᵀd.
    gradient: DVector<f64>,
    /// dᵀd.
    squares: f64,
}

impl PairSums {
    /// The sums of two rivals in one programme.
    pub fn of(one: &Predicted, other: &Predicted) -> Self {
        let d: Vec<f64> = one.readings.iter().zip(&other.readings).map(|(a, b)| a - b).collect();
        let columns: Vec<(&[f64], f64)> = one
            .jacobian
            .iter()
            .map(|c| (c.as_slice(), 1.0))
            .chain(other.jacobian.iter().map(|c| (c.as_slice(), -1.0)))
            .collect();
        let n = columns.len();
        let dot = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(x, y)| x * y).sum() };
        let mut normal = DMatrix::zeros(n, n);
        let mut gradient = DVector::zeros(n);
        for (i, (column, sign)) in columns.iter().enumerate() {
            gradient[i] = sign * dot(column, &d);
            for (k, (other, other_sign)) in columns.iter().enumerate().take(i + 1) {
                let sum = sign * other_sign * dot(column, other);
                normal[(i, k)] = sum;
                normal[(k, i)] = sum;
            }
        }
        PairSums { normal, gradient, squares: dot(&d, &d) }
    }

    /// Both together.
    #[must_use]
    pub fn and(&self, other: &PairSums) -> PairSums {
        PairSums {
            normal: &self.normal + &other.normal,
            gradient: &self.gradient + &other.gradient,
            squares: self.squares + other.squares,
        }
    }

    /// D, given the information `a` on one rival's coordinates and `b` on the other's.
    pub fn divergence(&self, a: &DMatrix<f64>, b: &DMatrix<f64>) -> f64 {
        let (na, nb) = (a.nrows(), b.nrows());
        if na + nb != self.normal.nrows() {
            return 0.0;
        }
        let mut known = self.normal.clone();
        known.view_mut((0, 0), (na, na)).add_assign_from(a);
        known.view_mut((na, na), (nb, nb)).add_assign_from(b);
        match known.cholesky() {
            Some(c) => (self.squares - self.gradient.dot(&c.solve(&self.gradient))).max(0.0),
            None => 0.0,
        }
    }
}

/// In-place addition of a matrix into a view.
trait AddFrom {
    fn add_assign_from(&mut self, other: &DMatrix<f64>);
}

impl AddFrom for nalgebra::DMatrixViewMut<'_, f64> {
    fn add_assign_from(&mut self, other: &DMatrix<f64>) {
        for i in 0..other.nrows() {
            for k in 0..other.ncols() {
                self[(i, k)] += other[(i, k)];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two straight lines of which one may still move its offset: only what an offset cannot imitate counts.
    #[test]
    fn what_a_parameter_can_still_adjust_does_not_separate() {
        let x: Vec<f64> = (0..11).map(f64::from).collect();
        let flat = Predicted { readings: vec![0.0; 11], jacobian: vec![] };
        let rising = Predicted { readings: x.clone(), jacobian: vec![vec![1.0; 11]] };
        let sums = PairSums::of(&rising, &flat);
        let nothing = DMatrix::zeros(0, 0);
        let loose = sums.divergence(&DMatrix::from_element(1, 1, 1e-9), &nothing);
        let tight = sums.divergence(&DMatrix::from_element(1, 1, 1e9), &nothing);
        // Σ(x − 5)² = 110 and Σ x² = 385.
        assert!((loose - 110.0).abs() < 1e-5 && (tight - 385.0).abs() < 1e-5, "{loose} {tight}");
        let twice = sums.and(&sums).divergence(&DMatrix::from_element(1, 1, 1e-9), &nothing);
        assert!((twice - 220.0).abs() < 1e-5);
    }
}
