//! Statements of a rig file that contradict one another where recordings determine ratios alone.
//!
//! A fit believes what is stated of every part to the scatter of such parts. Where one statement is far off, its standard errors are
//! those of a size that nobody stated: every single one is then as much too small as the statements contradict one another.

use super::combinations::open_scaling;
use crate::least_squares::Information;
use crate::objective::{Estimate, FAR};

/// Share of the square of the largest contradiction from which on a statement may be the wrong one as well (chosen).
const AS_FAR: f64 = 0.5;
/// Least share of a combination's prior that is left without one of its parts: a combination of that one alone contradicts nothing.
const LEAST_REST: f64 = 1e-4;

/// Variances, by coordinate in units of the prior's, by which single parameters are known less well than what is stated says, where
/// recordings leave the size of the rig open and what is stated of it contradicts itself by far; `None` elsewhere.
///
/// Along an open combination `d` statements alone decide. Where one of them is wrong the fit, at coordinates `z`, shares its error out
/// among all others. Without statement `i` the others would have the rig elsewhere, by
///
/// ```text
/// cᵢ = dᵢ zᵢ / (1 − dᵢ²)      along d,      tᵢ = zᵢ / √(1 − dᵢ²)      standard deviations from where it has it
/// ```
///
/// Any of those that contradict the others about as much as the furthest one may be wrong, so that the size may be where each has it.
pub(super) fn contradicted(estimates: &[Estimate], information: &Information) -> Option<Vec<f64>> {
    let scaling = open_scaling(estimates, information)?;
    let length = scaling.iter().map(|part| part * part).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
    let parts: Vec<f64> = scaling.iter().map(|part| part / length).collect();
    let without = |(part, e): (&f64, &Estimate)| {
        let rest = (1.0 - part * part).max(LEAST_REST);
        if *part == 0.0 { (0.0, 0.0) } else { (part * e.shift / rest, e.shift * e.shift / rest) }
    };
    let each: Vec<(f64, f64)> = parts.iter().zip(estimates).map(without).collect();
    let furthest = each.iter().map(|(_, squared)| *squared).fold(0.0, f64::max);
    if furthest < FAR * FAR {
        return None;
    }
    let may_be_wrong = each.iter().filter(|(_, squared)| *squared > AS_FAR * furthest);
    let size = may_be_wrong.map(|(along, _)| along * along).fold(0.0, f64::max);
    Some(parts.iter().map(|part| part * part * size).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::combinations::tests::{cell, shown};

    /// Six times a chamber's stated volume, or a sixth of its stated flow: readings show ratios, and the fit is between what is stated of
    /// each. A standard error that holds the true size is as wide as they contradict one another, whichever is wrong.
    #[test]
    fn what_contradicts_itself_by_far_has_standard_errors_that_hold_the_truth() {
        let (mut estimates, information) = shown(cell(), &[&[-1.0, 1.0, 0.0, 0.0], &[1.0, 0.0, 1.0, 0.0]]);
        assert_eq!(contradicted(&estimates, &information), None);
        let deviations = [0.05, 0.3, 0.3_f64];
        let weights = deviations.map(|sd: f64| sd.powi(-2));
        for wrong in [0, 1] {
            // Logarithm of true over stated, of which one is other than nothing; the fit has all of them times the same factor.
            let truth = [0, 1, 2].map(|index| if index == wrong { 6.0_f64.ln() } else { 0.0 });
            let exponent = [1.0, 1.0, -1.0];
            let pulled: f64 = (0..3).map(|i| exponent[i] * weights[i] * truth[i]).sum();
            let off = pulled / weights.iter().sum::<f64>();
            for (index, estimate) in estimates.iter_mut().take(3).enumerate() {
                estimate.shift = (truth[index] - exponent[index] * off) / deviations[index];
            }
            let variances = contradicted(&estimates, &information).unwrap();
            for (index, sd) in deviations.iter().enumerate() {
                let stated = sd * estimates[index].undetermined;
                let known = stated.hypot(sd * variances[index].sqrt());
                assert!(off.abs() < 1.5 * known, "{wrong} {index}: off by {off}, known to {known}");
                // A volume that is wrong and stated to 5 % has all others off by many of what their standard errors were.
                assert!(wrong > 0 || off.abs() > 10.0 * stated, "{index}: off by {off}, {stated}");
            }
            // The atmosphere has nothing to do with it.
            assert_eq!(variances[3], 0.0);
        }
    }
}
