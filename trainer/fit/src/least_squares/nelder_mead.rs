//! The simplex method (Nelder & Mead, *Comput. J.* 7, 308 (1965)): no derivatives, few parameters.
//!
//! The paper finds the two check-valve coefficients with it. Coefficients are the usual ones: reflection 1, expansion
//! 2, contraction ½, shrinkage ½. It can stall on a simplex that has collapsed (McKinnon 1998), which is why
//! [`nelder_mead`] starts again from the best point with a fresh simplex until that gains nothing.

/// Settings of a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Simplex {
    /// First distance along each coordinate.
    pub step: f64,
    /// Done when the simplex is smaller than this in every coordinate.
    pub tolerance: f64,
    /// The most evaluations.
    pub evaluations: usize,
}

impl Default for Simplex {
    fn default() -> Self {
        Simplex { step: 0.1, tolerance: 1e-4, evaluations: 400 }
    }
}

/// The lowest point found and its value.
///
/// Values that are not numbers count as infinite, so regions where `f` cannot be evaluated are avoided.
pub fn nelder_mead(mut f: impl FnMut(&[f64]) -> f64, start: &[f64], settings: Simplex) -> (Vec<f64>, f64) {
    let mut left = settings.evaluations;
    let mut value = |x: &[f64], left: &mut usize| {
        *left = left.saturating_sub(1);
        let v = f(x);
        if v.is_nan() { f64::INFINITY } else { v }
    };
    let mut best = (start.to_vec(), value(start, &mut left));
    let mut step = settings.step;
    while left > start.len() {
        let found = descend(&mut value, &mut left, &best, step, settings.tolerance);
        let (gained, moved) = (best.1 - found.1, distance(&best.0, &found.0));
        best = found;
        // A restart that stays within the tolerance has nothing to find.
        if gained.is_nan() || gained <= 0.0 || moved < 4.0 * settings.tolerance {
            break;
        }
        step = settings.step.min(moved.max(4.0 * settings.tolerance));
    }
    best
}

type Vertex = (Vec<f64>, f64);

fn descend(
    value: &mut impl FnMut(&[f64], &mut usize) -> f64,
    left: &mut usize,
    start: &Vertex,
    step: f64,
    tolerance: f64,
) -> Vertex {
    let n = start.0.len();
    let mut simplex = vec![start.clone()];
    for i in 0..n {
        let mut x = start.0.clone();
        if let Some(slot) = x.get_mut(i) {
            *slot += step;
        }
        let v = value(&x, left);
        simplex.push((x, v));
    }
    loop {
        simplex.sort_by(|a, b| a.1.total_cmp(&b.1));
        let (Some(best), Some(worst), Some(second)) =
            (simplex.first().cloned(), simplex.last().cloned(), simplex.get(n.saturating_sub(1)).cloned())
        else {
            return start.clone();
        };
        let size = simplex.iter().map(|v| distance(&v.0, &best.0)).fold(0.0, f64::max);
        if size < tolerance || *left == 0 {
            return best;
        }
        let centre: Vec<f64> = (0..n)
            .map(|i| simplex.iter().take(n).map(|v| v.0.get(i).copied().unwrap_or(0.0)).sum::<f64>() / n as f64)
            .collect();
        let along = |t: f64| -> Vec<f64> { centre.iter().zip(&worst.0).map(|(c, w)| c + t * (c - w)).collect() };
        let reflected = along(1.0);
        let at_reflected = value(&reflected, left);
        let replacement = if at_reflected < best.1 {
            let expanded = along(2.0);
            let at_expanded = value(&expanded, left);
            Some(if at_expanded < at_reflected { (expanded, at_expanded) } else { (reflected, at_reflected) })
        } else if at_reflected < second.1 {
            Some((reflected, at_reflected))
        } else {
            let inside = at_reflected >= worst.1;
            let contracted = along(if inside { -0.5 } else { 0.5 });
            let at_contracted = value(&contracted, left);
            (at_contracted < at_reflected.min(worst.1)).then_some((contracted, at_contracted))
        };
        match (replacement, simplex.last_mut()) {
            (Some(vertex), Some(last)) => *last = vertex,
            _ => {
                for vertex in simplex.iter_mut().skip(1) {
                    for (x, b) in vertex.0.iter_mut().zip(&best.0) {
                        *x = b + 0.5 * (*x - b);
                    }
                    vertex.1 = value(&vertex.0, left);
                }
            }
        }
    }
}

/// The largest difference of a coordinate.
fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn search(f: impl FnMut(&[f64]) -> f64, start: &[f64]) -> Vec<f64> {
        nelder_mead(f, start, Simplex { step: 0.5, tolerance: 1e-8, evaluations: 5000 }).0
    }

    /// Minima known in closed form. The function is flat to 1e-16 within 1e-8 of a quadratic minimum of scale one.
    #[test]
    fn finds_known_minima() {
        let bowl = search(|x| (x[0] - 3.0).powi(2) + 10.0 * (x[1] + 1.0).powi(2), &[0.0, 0.0]);
        assert!((bowl[0] - 3.0).abs() < 1e-6 && (bowl[1] + 1.0).abs() < 1e-6, "{bowl:?}");
        let rosenbrock = |x: &[f64]| 100.0 * (x[1] - x[0] * x[0]).powi(2) + (1.0 - x[0]).powi(2);
        let valley = search(rosenbrock, &[-1.2, 1.0]);
        assert!((valley[0] - 1.0).abs() < 1e-5 && (valley[1] - 1.0).abs() < 1e-5, "{valley:?}");
        // Himmelblau's function from near its minimum at (3, 2).
        let himmelblau = |x: &[f64]| (x[0] * x[0] + x[1] - 11.0).powi(2) + (x[0] + x[1] * x[1] - 7.0).powi(2);
        let found = search(himmelblau, &[2.0, 2.0]);
        assert!((found[0] - 3.0).abs() < 1e-6 && (found[1] - 2.0).abs() < 1e-6, "{found:?}");
    }

    #[test]
    fn stays_out_of_what_cannot_be_evaluated_and_within_its_budget() {
        let mut calls = 0;
        let f = |x: &[f64]| {
            calls += 1;
            if x[0] < 0.0 { f64::NAN } else { x[0] + x[1] * x[1] }
        };
        let (x, _) = nelder_mead(f, &[1.0, 1.0], Simplex { step: 0.5, tolerance: 1e-6, evaluations: 300 });
        assert!((0.0..1e-3).contains(&x[0]) && x[1].abs() < 0.1, "{x:?}");
        // The last round of a shrinking simplex may take n evaluations more.
        assert!(calls <= 303, "{calls}");
    }
}
