//! Levenberg-Marquardt with a prior, bounds, a robust loss, and several trial steps at once.
//!
//! ```text
//! minimise   Σ ρ(r_i(z)) + ½ Σ p_j z_j²     within   low ≤ z ≤ high
//! step       (JᵀWJ + P + λ) δ = −(JᵀW r + P z)
//! ```
//!
//! (Levenberg 1944; Marquardt 1963 for λ.) Coordinates `z` are in units of the prior's standard deviation, so a prior
//! weight `p_j` is 1 for a parameter with a prior and 0 without, and λ needs no scale of its own. Moré's (1978), the
//! diagonal of `JᵀWJ + P`, is wrong here: where parameters can stand in for each other, each alone moves readings a
//! thousand times more than the combination does that is left, and a λ that holds each by a thousandth holds that
//! combination for good. Because rigs are simulated side by side, one round of trials costs the same for one λ as for
//! several: the λ's are tried together and the best step is taken.

use nalgebra::{DMatrix, DVector};

use super::loss::Loss;
use crate::FitError;

/// Residuals and their derivatives at one point.
#[derive(Debug, Clone, PartialEq)]
pub struct Linearised {
    /// Residuals in units of their standard deviation.
    pub residuals: Vec<f64>,
    /// Derivatives of all residuals, by coordinate.
    pub jacobian: Vec<Vec<f64>>,
}

/// Something whose residuals are to be made small.
pub trait Problem {
    /// Residuals and Jacobian at a point.
    ///
    /// # Errors
    /// The point cannot be evaluated.
    fn linearise(&mut self, point: &[f64]) -> Result<Linearised, FitError>;

    /// Residuals at several points; `None` where one cannot be evaluated.
    fn residuals(&mut self, points: &[Vec<f64>]) -> Vec<Option<Vec<f64>>>;
}

/// Settings of a search.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// The loss.
    pub loss: Loss,
    /// Prior weight by coordinate: 1 with a prior (z is in its standard deviations), 0 without.
    pub prior: Vec<f64>,
    /// Lower and upper bound by coordinate.
    pub bounds: Vec<[f64; 2]>,
    /// The most Jacobians.
    pub rounds: usize,
    /// Steps tried at once.
    pub trials: usize,
    /// Done when a step lowers the cost by less than this.
    pub least_gain: f64,
    /// The cost that must be reached for the search to be of use: one that is not on its way there ends. Infinite for one
    /// that goes on whatever it comes to.
    pub needed: f64,
}

/// Reason why a search ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// A step gained next to nothing.
    Converged,
    /// No step lowered the cost, however short.
    Stuck,
    /// The most Jacobians were used up.
    Rounds,
    /// The cost that is needed was out of reach.
    Behind,
}

/// Where a search ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Coordinates.
    pub point: Vec<f64>,
    /// Cost with the prior's share.
    pub cost: f64,
    /// By how much the steps lowered it, all together.
    pub gained: f64,
    /// Reason why it ended there.
    pub stop: Stop,
    /// Jacobians worked out.
    pub rounds: usize,
    /// The last linearisation, at `point` or one step before it.
    pub linearised: Linearised,
}

/// λ at the start, in units of the prior's information.
const FIRST_DAMPING: f64 = 1.0;
/// Ratio of neighbouring λ's among the trials of a round.
const DAMPING_RATIO: f64 = 10.0;
/// Beyond this λ a step is too short to matter.
const MOST_DAMPING: f64 = 1e12;
/// Below this λ a step is not held back at all.
const LEAST_DAMPING: f64 = 1e-3;

/// Factor by which the steps to come may turn out better than the last one, before a search counts as out of reach of what is
/// needed. Steps of least squares mostly become smaller, the first ones of a long way excepted.
const HOPE: f64 = 2.0;

/// Searches from `start`.
///
/// # Errors
/// The start cannot be evaluated.
pub fn minimise(problem: &mut impl Problem, start: &[f64], settings: &Settings) -> Result<Outcome, FitError> {
    let mut point = start.to_vec();
    limit(&mut point, &settings.bounds);
    let mut linearised = problem.linearise(&point)?;
    let mut cost = cost(&linearised.residuals, &point, settings);
    let mut damping = FIRST_DAMPING;
    let mut rounds = 1;
    let mut gained = 0.0;
    loop {
        let (normal, gradient) = normal_equations(&linearised, &point, settings);
        let mut best: Option<(f64, Vec<f64>, f64)> = None;
        while best.is_none() && damping < MOST_DAMPING {
            let dampings: Vec<f64> = (0..settings.trials.max(1))
                .map(|k| damping * DAMPING_RATIO.powi(k as i32 - settings.trials as i32 / 2))
                .collect();
            let mut steps: Vec<(f64, Vec<f64>)> = Vec::new();
            for d in &dampings {
                let Some(to) = candidate(&normal, &gradient, &point, *d, settings) else { continue };
                if steps.last().is_none_or(|(_, last)| !is_alike(&normal, &point, last, &to)) {
                    steps.push((*d, to));
                }
            }
            let (dampings_tried, candidates): (Vec<f64>, Vec<Vec<f64>>) = steps.into_iter().unzip();
            let evaluated = problem.residuals(&candidates);
            for ((candidate, residuals), d) in candidates.into_iter().zip(evaluated).zip(&dampings_tried) {
                let Some(residuals) = residuals else { continue };
                let trial = self::cost(&residuals, &candidate, settings);
                if trial < cost && best.as_ref().is_none_or(|(least, ..)| trial < *least) {
                    best = Some((trial, candidate, *d));
                }
            }
            if best.is_none() {
                damping = dampings.last().copied().unwrap_or(damping) * DAMPING_RATIO;
            }
        }
        let Some((trial, candidate, d)) = best else {
            return Ok(Outcome { point, cost, gained, stop: Stop::Stuck, rounds, linearised });
        };
        let gain = cost - trial;
        gained += gain;
        (point, cost, damping) = (candidate, trial, (d / DAMPING_RATIO).max(LEAST_DAMPING));
        let left = settings.rounds.saturating_sub(rounds);
        let stop = if gain < settings.least_gain {
            Some(Stop::Converged)
        } else if left == 0 {
            Some(Stop::Rounds)
        } else if cost - HOPE * gain * left as f64 > settings.needed {
            Some(Stop::Behind)
        } else {
            None
        };
        if let Some(stop) = stop {
            return Ok(Outcome { point, cost, gained, stop, rounds, linearised });
        }
        linearised = problem.linearise(&point)?;
        // A problem may settle details anew when it linearises; its cost then is what the next step must beat.
        cost = self::cost(&linearised.residuals, &point, settings);
        rounds += 1;
    }
}

/// Share of a step by which two of them differ where damping does not tell them apart.
const ALIKE: f64 = 0.02;

/// Tells whether two steps from a point are one but for a hundredth or two, as the readings see them and in coordinates.
fn is_alike(normal: &DMatrix<f64>, point: &[f64], one: &[f64], other: &[f64]) -> bool {
    let between =
        |from: &[f64], to: &[f64]| DVector::from_iterator(from.len(), from.iter().zip(to).map(|(a, b)| b - a));
    let size = |step: &DVector<f64>| step.dot(&(normal * step)) + step.norm_squared();
    size(&between(one, other)) <= ALIKE * ALIKE * size(&between(point, one))
}

/// Loss and prior at a point; infinite where a residual is no number.
pub(crate) fn cost(residuals: &[f64], point: &[f64], settings: &Settings) -> f64 {
    let data: f64 = residuals.iter().map(|r| settings.loss.cost(*r)).sum();
    let prior: f64 = point.iter().zip(&settings.prior).map(|(z, p)| 0.5 * p * z * z).sum();
    let cost = data + prior;
    if cost.is_nan() { f64::INFINITY } else { cost }
}

/// `JᵀWJ + P` and `JᵀW r + P z`.
fn normal_equations(at: &Linearised, point: &[f64], settings: &Settings) -> (DMatrix<f64>, DVector<f64>) {
    let n = point.len();
    let weights: Vec<f64> = at.residuals.iter().map(|r| settings.loss.weight(*r)).collect();
    let (mut normal, mut gradient) = (DMatrix::zeros(n, n), DVector::zeros(n));
    for (i, column) in at.jacobian.iter().enumerate() {
        let weighted: Vec<f64> = column.iter().zip(&weights).map(|(j, w)| j * w).collect();
        gradient[i] = dot(&weighted, &at.residuals);
        for (k, other) in at.jacobian.iter().enumerate().take(i + 1) {
            let sum = dot(&weighted, other);
            normal[(i, k)] = sum;
            normal[(k, i)] = sum;
        }
    }
    for (i, (p, z)) in settings.prior.iter().zip(point).enumerate().take(n) {
        normal[(i, i)] += p;
        gradient[i] += p * z;
    }
    (normal, gradient)
}

/// The point that a damped step leads to, within bounds.
///
/// Coordinates that would go beyond a bound go to it, and the others are solved again with that: clamped alone, it would take
/// the others with it to where only the whole step leads, off the floor of a valley.
fn candidate(
    normal: &DMatrix<f64>,
    gradient: &DVector<f64>,
    point: &[f64],
    damping: f64,
    settings: &Settings,
) -> Option<Vec<f64>> {
    let n = point.len();
    let mut free: Vec<usize> = (0..n).collect();
    let mut moved = point.to_vec();
    for _ in 0..=n {
        let m = free.len();
        let mut a = DMatrix::zeros(m, m);
        let mut b = DVector::zeros(m);
        for (i, fi) in free.iter().enumerate() {
            for (k, fk) in free.iter().enumerate() {
                a[(i, k)] = normal[(*fi, *fk)];
            }
            // A coordinate without any effect and prior keeps its place instead of making the system singular.
            a[(i, i)] += damping + 1e-12 * (1.0 + normal[(*fi, *fi)]);
            // Those at their bounds have moved already.
            let given: f64 =
                (0..n).filter(|k| !free.contains(k)).map(|k| normal[(*fi, k)] * (moved[k] - point[k])).sum();
            b[i] = -gradient[*fi] - given;
        }
        let step = a.cholesky()?.solve(&b);
        let bounds = |fi: usize| settings.bounds.get(fi).copied().unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
        let inside = |to: f64, [low, high]: [f64; 2]| low <= to && to <= high;
        let (keep, beyond): (Vec<usize>, Vec<usize>) =
            (0..m).partition(|i| inside(point[free[*i]] + step[*i], bounds(free[*i])));
        for i in &keep {
            moved[free[*i]] = point[free[*i]] + step[*i];
        }
        for i in &beyond {
            let [low, high] = bounds(free[*i]);
            moved[free[*i]] = (point[free[*i]] + step[*i]).clamp(low, high);
        }
        if beyond.is_empty() {
            limit(&mut moved, &settings.bounds);
            return Some(moved);
        }
        free = keep.into_iter().map(|i| free[i]).collect();
    }
    None
}

fn limit(point: &mut [f64], bounds: &[[f64; 2]]) {
    for (z, [low, high]) in point.iter_mut().zip(bounds) {
        *z = z.clamp(*low, *high);
    }
}

/// Sum of products in four running sums, which the compiler turns into SIMD.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (a4, a_rest) = a.as_chunks::<4>();
    let (b4, b_rest) = b.as_chunks::<4>();
    for (x, y) in a4.iter().zip(b4) {
        for k in 0..4 {
            sums[k] += x[k] * y[k];
        }
    }
    sums.iter().sum::<f64>() + a_rest.iter().zip(b_rest).map(|(x, y)| x * y).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Residuals given as a function; Jacobian by central differences.
    struct Function<F>(F);

    impl<F: Fn(&[f64]) -> Vec<f64>> Problem for Function<F> {
        fn linearise(&mut self, point: &[f64]) -> Result<Linearised, FitError> {
            let h = 1e-6;
            let jacobian = (0..point.len())
                .map(|i| {
                    let at = |by: f64| {
                        let mut p = point.to_vec();
                        p[i] += by;
                        (self.0)(&p)
                    };
                    at(h).iter().zip(at(-h)).map(|(a, b)| (a - b) / (2.0 * h)).collect()
                })
                .collect();
            Ok(Linearised { residuals: (self.0)(point), jacobian })
        }

        fn residuals(&mut self, points: &[Vec<f64>]) -> Vec<Option<Vec<f64>>> {
            points.iter().map(|p| Some((self.0)(p))).collect()
        }
    }

    /// A unit prior, no bounds; done where a step gains less than a hundredth of what one standard error costs (½).
    fn with_prior(n: usize) -> Settings {
        Settings {
            loss: Loss::Gaussian,
            prior: vec![1.0; n],
            bounds: vec![[f64::NEG_INFINITY, f64::INFINITY]; n],
            rounds: 30,
            trials: 4,
            least_gain: 5e-3,
            needed: f64::INFINITY,
        }
    }

    fn flat(n: usize) -> Settings {
        Settings { prior: vec![0.0; n], least_gain: 1e-16, rounds: 200, ..with_prior(n) }
    }

    /// Rosenbrock's valley as a sum of squares: minimum 0 at (1, 1), from the classical start.
    #[test]
    fn finds_the_end_of_a_curved_valley() {
        let mut valley = Function(|p: &[f64]| vec![10.0 * (p[1] - p[0] * p[0]), 1.0 - p[0]]);
        let found = minimise(&mut valley, &[-1.2, 1.0], &flat(2)).unwrap();
        // Cost is quadratic in the distance and the search ends when it gains less than 1e-16.
        assert!((found.point[0] - 1.0).abs() < 1e-6 && (found.point[1] - 1.0).abs() < 1e-6, "{found:?}");
        assert!(found.rounds < 60, "{} rounds", found.rounds);
    }

    /// A valley with its end cut off: on the bound z₀ = 0.5 the best second coordinate is z₀².
    #[test]
    fn walks_along_a_bound() {
        let mut valley = Function(|p: &[f64]| vec![10.0 * (p[1] - p[0] * p[0]), 1.0 - p[0]]);
        let bounds = vec![[-2.0, 0.5], [-2.0, 2.0]];
        let found = minimise(&mut valley, &[-1.2, 1.0], &Settings { bounds, ..flat(2) }).unwrap();
        assert!((found.point[0] - 0.5).abs() < 1e-9 && (found.point[1] - 0.25).abs() < 1e-6, "{:?}", found.point);
    }

    /// One reading y of z with unit noise and a unit prior: the compromise is y/2.
    #[test]
    fn a_prior_pulls_as_much_as_a_reading() {
        let mut reading = Function(|p: &[f64]| vec![p[0] - 3.0]);
        let found = minimise(&mut reading, &[0.0], &with_prior(1)).unwrap();
        assert!((found.point[0] - 1.5).abs() < 1e-4, "{:?}", found.point);
    }

    /// The median-like estimate of Student's loss hardly notices one wild reading among eleven.
    #[test]
    fn a_wild_reading_counts_little_under_students_loss() {
        let readings: Vec<f64> = (0..10).map(|k| 0.1 * (k as f64 - 4.5)).chain([50.0]).collect();
        let at = |loss| {
            let mut mean = Function(|p: &[f64]| readings.iter().map(|y| p[0] - y).collect());
            minimise(&mut mean, &[1.0], &Settings { loss, ..flat(1) }).unwrap().point[0]
        };
        // 50/11 = 4.55 by least squares; ρ' of Student falls as 6/r, so the pull is about 6/50 / (10 · 1.2).
        assert!((at(Loss::Gaussian) - 50.0 / 11.0).abs() < 1e-6);
        assert!(at(Loss::Student { freedom: 5.0 }).abs() < 0.02);
    }

    /// A search that needs less than the valley's floor soon ends; one that needs what is there gets there by the same steps.
    #[test]
    fn a_search_ends_once_what_is_needed_is_out_of_reach() {
        let mut valley = Function(|p: &[f64]| vec![10.0 * (p[1] - p[0] * p[0]), 1.0 - p[0], 3.0]);
        let free = minimise(&mut valley, &[-1.2, 1.0], &Settings { rounds: 60, ..flat(2) }).unwrap();
        let needing = |needed| Settings { rounds: 60, needed, ..flat(2) };
        let reached = minimise(&mut valley, &[-1.2, 1.0], &needing(free.cost)).unwrap();
        assert_eq!(reached, free);
        let behind = minimise(&mut valley, &[-1.2, 1.0], &needing(1.0)).unwrap();
        assert_eq!(behind.stop, Stop::Behind);
        assert!(behind.rounds < free.rounds, "{} {}", behind.rounds, free.rounds);
    }

    #[test]
    fn a_region_that_cannot_be_evaluated_is_avoided() {
        struct Walled;
        impl Problem for Walled {
            fn linearise(&mut self, point: &[f64]) -> Result<Linearised, FitError> {
                Ok(Linearised { residuals: vec![point[0] - 2.0], jacobian: vec![vec![1.0]] })
            }
            fn residuals(&mut self, points: &[Vec<f64>]) -> Vec<Option<Vec<f64>>> {
                points.iter().map(|p| (p[0] < 1.0).then(|| vec![p[0] - 2.0])).collect()
            }
        }
        let found = minimise(&mut Walled, &[0.0], &flat(1)).unwrap();
        assert!(found.point[0] < 1.0 && found.point[0] > 0.5, "{:?}", found.point);
    }
}
