//! Information in a Jacobian: covariance, intervals, and combinations that the data do not determine.
//!
//! With coordinates in units of the prior's standard deviation the information of the data is `F = JᵀWJ` and that of
//! the prior is `P` (ones). Then
//!
//! ```text
//! model      cov = (F + P)⁻¹                                 right if residuals are independent
//! groups     cov = (F + P)⁻¹ (Σ_b g_b g_bᵀ + P) (F + P)⁻¹     g_b = J_bᵀ W r_b over groups of readings
//! ```
//!
//! The second (White 1982; Newey & West's idea with whole groups) stays right when residuals of a group
//! belong together, as they do wherever the model is a little wrong: of neighbouring rows, and of rows where the plant was in
//! the same state, for what a formula is off by comes back with it. An eigenvector of `F` with eigenvalue below one is
//! a combination of parameters on which the data say less than the prior did.

use nalgebra::{DMatrix, SymmetricEigen};

use super::levenberg::{Linearised, dot};
use super::loss::Loss;

/// A combination of parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Direction {
    /// Components in units of the prior's standard deviations; a unit vector.
    pub components: Vec<f64>,
    /// Information of the data along it: 1 is as much as the prior's.
    pub information: f64,
}

/// Information of data and prior on parameters at the minimum.
#[derive(Debug, Clone, PartialEq)]
pub struct Information {
    /// Information of the data alone.
    data: DMatrix<f64>,
    /// `(F + P)⁻¹`.
    covariance: DMatrix<f64>,
    /// Covariances that allow for residuals that belong together, by grouping.
    by_groups: Vec<DMatrix<f64>>,
}

impl Information {
    /// Works it out from residuals and Jacobian at the minimum; each of `groupings` holds the group of each residual (rows in
    /// none: `usize::MAX`).
    ///
    /// `None` if some combination is determined neither by the data nor by a prior.
    pub fn of(at: &Linearised, loss: Loss, prior: &[f64], groupings: &[Vec<usize>]) -> Option<Self> {
        let n = at.jacobian.len();
        let weights: Vec<f64> = at.residuals.iter().map(|r| loss.weight(*r)).collect();
        let weighted: Vec<Vec<f64>> =
            at.jacobian.iter().map(|column| column.iter().zip(&weights).map(|(j, w)| j * w).collect()).collect();
        let mut data = DMatrix::zeros(n, n);
        for (i, weighted) in weighted.iter().enumerate() {
            for (k, other) in at.jacobian.iter().enumerate().take(i + 1) {
                let sum = dot(weighted, other);
                data[(i, k)] = sum;
                data[(k, i)] = sum;
            }
        }
        let penalty = DMatrix::from_fn(n, n, |i, k| if i == k { prior.get(i).copied().unwrap_or(0.0) } else { 0.0 });
        let covariance = (&data + &penalty).cholesky()?.inverse();
        let by_groups = groupings
            .iter()
            .map(|groups| &covariance * (spread(&weighted, &at.residuals, groups) + &penalty) * &covariance)
            .collect();
        Some(Information { data, covariance, by_groups })
    }

    /// Standard errors if residuals are independent, in units of the prior's.
    pub fn sd(&self) -> Vec<f64> {
        self.covariance.diagonal().iter().map(|v| v.max(0.0).sqrt()).collect()
    }

    /// Standard errors that allow for residuals that belong together: the largest of all estimates, for few groups
    /// may chance to agree.
    pub fn cautious_sd(&self) -> Vec<f64> {
        let mut largest = self.sd();
        for covariance in &self.by_groups {
            for (sd, v) in largest.iter_mut().zip(covariance.diagonal().iter()) {
                *sd = sd.max(v.max(0.0).sqrt());
            }
        }
        largest
    }

    /// Standard error of a combination of coordinates, by its weights: as cautious as [`Information::cautious_sd`].
    pub fn cautious_sd_of(&self, weights: &[f64]) -> f64 {
        let along = |matrix: &DMatrix<f64>| quadratic(matrix, weights).max(0.0).sqrt();
        self.by_groups.iter().map(along).fold(along(&self.covariance), f64::max)
    }

    /// Information of the data along a vector, as much as the prior's where it is 1.
    pub fn along(&self, vector: &[f64]) -> f64 {
        quadratic(&self.data, vector) / dot(vector, vector).max(f64::MIN_POSITIVE)
    }

    /// Standard errors, in units of the priors' standard deviations, where priors count for this share of what they do: what is left of
    /// them where it is small is what the data say alone. `None` where that cannot be told.
    pub fn sd_with_priors_of(&self, share: f64) -> Option<Vec<f64>> {
        let n = self.data.nrows();
        let covariance = (&self.data + DMatrix::identity(n, n) * share).cholesky()?.inverse();
        Some(covariance.diagonal().iter().map(|v| v.max(0.0).sqrt()).collect())
    }

    /// All combinations that leave another one as it is, least determined first.
    pub fn directions_beside(&self, known: &[f64]) -> Vec<Direction> {
        let n = self.data.nrows();
        let length = dot(known, known).sqrt().max(f64::MIN_POSITIVE);
        let unit = DMatrix::from_fn(n, 1, |i, _| known.get(i).copied().unwrap_or(0.0) / length);
        let along = &unit * unit.transpose();
        let across = DMatrix::identity(n, n) - &along;
        // More than any combination has, so that it comes last.
        let most = 2.0 * self.data.trace() + 1.0;
        let mut directions = sorted(&across * &self.data * &across + along * most);
        directions.pop();
        directions
    }

    /// `(F + P)⁻¹`.
    pub fn covariance(&self) -> &DMatrix<f64> {
        &self.covariance
    }

    /// Information of the data alone.
    pub fn data(&self) -> &DMatrix<f64> {
        &self.data
    }

    /// All combinations, least determined first.
    pub fn directions(&self) -> Vec<Direction> {
        sorted(self.data.clone())
    }
}

/// Eigenvectors of an information matrix, least determined first.
fn sorted(information: DMatrix<f64>) -> Vec<Direction> {
    let eigen = SymmetricEigen::new(information);
    let mut directions: Vec<Direction> = eigen
        .eigenvalues
        .iter()
        .zip(eigen.eigenvectors.column_iter())
        .map(|(information, vector)| Direction {
            components: vector.iter().copied().collect(),
            information: information.max(0.0),
        })
        .collect();
    directions.sort_by(|a, b| a.information.total_cmp(&b.information));
    directions
}

/// `vᵀ M v`.
fn quadratic(matrix: &DMatrix<f64>, vector: &[f64]) -> f64 {
    let row = |(i, a): (usize, &f64)| a * matrix.row(i).iter().zip(vector).map(|(m, b)| m * b).sum::<f64>();
    vector.iter().enumerate().take(matrix.nrows()).map(row).sum()
}

/// `Σ_b g_b g_bᵀ` over groups of residuals.
fn spread(weighted: &[Vec<f64>], residuals: &[f64], groups: &[usize]) -> DMatrix<f64> {
    let n = weighted.len();
    let count = groups.iter().filter(|group| **group != usize::MAX).max().map_or(0, |group| group + 1);
    let mut scores = DMatrix::<f64>::zeros(count, n);
    for (i, column) in weighted.iter().enumerate() {
        for ((j, r), group) in column.iter().zip(residuals).zip(groups) {
            if *group < count {
                scores[(*group, i)] += j * r;
            }
        }
    }
    // With few groups the sum is short of the freedom that the fit used up.
    let correction = if count > n + 1 { count as f64 / (count - n) as f64 } else { 1.0 };
    scores.transpose() * &scores * correction
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    /// Two parameters of a line, fitted 4000 times to fresh noise: the spread of the fits is the covariance stated.
    #[test]
    fn covariance_is_the_spread_of_repeated_fits() {
        let x: Vec<f64> = (0..20).map(|k| 0.1 * k as f64).collect();
        let jacobian = vec![vec![1.0; 20], x.clone()];
        let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(7);
        let repeats = 4000;
        let mut fits = Vec::new();
        for _ in 0..repeats {
            let noise: Vec<f64> = (0..20).map(|_| StandardNormal.sample(&mut random)).collect();
            fits.push(super::super::solve(&jacobian, &noise, "line").unwrap().x);
        }
        let at = Linearised { residuals: vec![0.0; 20], jacobian };
        let stated = Information::of(&at, Loss::Gaussian, &[0.0, 0.0], &[]).unwrap();
        for i in 0..2 {
            for k in 0..2 {
                let spread = fits.iter().map(|f| f[i] * f[k]).sum::<f64>() / repeats as f64;
                let expected = stated.covariance()[(i, k)];
                let scale = (stated.covariance()[(i, i)] * stated.covariance()[(k, k)]).sqrt();
                // The standard error of a variance from 4000 draws is √(2/4000) = 2.2 %; four of them.
                assert!((spread - expected).abs() < 0.09 * scale, "{i}{k}: {spread} against {expected}");
            }
        }
    }

    /// A mean of correlated noise (every value ten times over): the block estimate sees that there are a tenth as many.
    #[test]
    fn blocks_see_residuals_that_belong_together() {
        let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(8);
        let (groups, size) = (400, 10);
        let residuals: Vec<f64> = (0..groups)
            .flat_map(|_| {
                let value: f64 = StandardNormal.sample(&mut random);
                std::iter::repeat_n(value, size)
            })
            .collect();
        let blocks: Vec<usize> = (0..groups * size).map(|k| k / size).collect();
        let at = Linearised { residuals, jacobian: vec![vec![1.0; groups * size]] };
        let information = Information::of(&at, Loss::Gaussian, &[0.0], &[blocks]).unwrap();
        let (naive, cautious) = (information.sd()[0], information.cautious_sd()[0]);
        assert!((naive - 1.0 / f64::sqrt(4000.0)).abs() < 1e-12);
        // √10 times as much; the standard error of a standard deviation from 400 groups is 3.5 %; three of them.
        assert!((cautious / naive / 10.0_f64.sqrt() - 1.0).abs() < 0.11, "{}", cautious / naive);
    }

    /// A slope fitted to what is curved: the same error in every period, so that none of the periods tells; states do.
    #[test]
    fn states_see_an_error_that_comes_back() {
        let (periods, size) = (50, 40);
        let x = |k: usize| (k % size) as f64 / size as f64 - 0.5 + 0.5 / size as f64;
        // The cubic less its own slope, ∫x⁴/∫x² = 3/20.
        let residuals: Vec<f64> = (0..periods * size).map(|k| 10.0 * (x(k).powi(3) - 0.15 * x(k))).collect();
        let at = Linearised { residuals, jacobian: vec![(0..periods * size).map(x).collect()] };
        let by_period = (0..periods * size).map(|k| k / size).collect::<Vec<_>>();
        let by_state = (0..periods * size).map(|k| k % size / 10).collect::<Vec<_>>();
        let sd = |groupings: &[Vec<usize>]| {
            Information::of(&at, Loss::Gaussian, &[0.0], groupings).unwrap().cautious_sd()[0]
        };
        let naive = sd(&[]);
        assert!(sd(std::slice::from_ref(&by_period)) < 1.01 * naive);
        assert!(sd(&[by_period, by_state]) > 2.0 * naive);
    }

    #[test]
    fn the_least_determined_combination_comes_first() {
        // Only the sum of both parameters is seen, 100 times.
        let at = Linearised { residuals: vec![0.0; 100], jacobian: vec![vec![1.0; 100], vec![1.0; 100]] };
        assert!(Information::of(&at, Loss::Gaussian, &[0.0, 0.0], &[]).is_none());
        let information = Information::of(&at, Loss::Gaussian, &[1.0, 1.0], &[]).unwrap();
        let directions = information.directions();
        assert!(directions[0].information < 1e-9 && (directions[1].information - 200.0).abs() < 1e-9);
        assert!((directions[0].components[0] + directions[0].components[1]).abs() < 1e-12, "the difference");
        // The sum has a variance of 2/(200 + 1), each of both hardly less than before; beside the sum there is the difference alone.
        let sum = information.cautious_sd_of(&[1.0, 1.0]);
        assert!((sum - (2.0_f64 / 201.0).sqrt()).abs() < 1e-12, "{sum}");
        assert!(information.along(&[1.0, -1.0]) < 1e-9 && (information.along(&[1.0, 1.0]) - 200.0).abs() < 1e-9);
        assert!(information.sd_with_priors_of(0.01).unwrap()[0] > 5.0);
        let beside = information.directions_beside(&[1.0, 1.0]);
        assert!(beside.len() == 1 && beside[0].information < 1e-9, "{beside:?}");
    }
}
