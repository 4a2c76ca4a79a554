//! Which mechanism lets a rig's parameters stay near what was stated, where without one they have to go far.
//!
//! Springs on the inlet valves of a pump move both pressures by 3 kPa, and a pump whose inlet is half as wide again, warmer, at
//! a height where the air is 2 kPa thinner does the same to 0.03 kPa. No free run tells them apart, but nobody misreads three
//! data sheets by seven standard deviations. From such parameters there is no way back by slopes: what stands in for the
//! springs there is something else. So every mechanism is asked from the rig as it was given, to first order, how near the
//! parameters could stay with it:
//!
//! ```text
//! gain = min over z of Q(z, 0) − min over z, a of Q(z, a),      Q(z, a) = |r + J z + a s|²/(2 σ²) + |z|²/2
//! ```
//!
//! with the given rig's mismatch `r`, slopes `J` there, the effect `s` of a mechanism at a first magnitude, and a σ that holds
//! what is not in proportion: a share of the mismatch itself. The best are fitted from where that leads them.

use fit::least_squares::Linearised;

use crate::alone::effects_on_given;
use crate::bench::{Bench, Effort, Explanation};
use crate::candidate::Candidate;
use crate::error::DiagnoseError;
use crate::glance::Footing;
use crate::screen::{Answered, Projector};
use crate::search::starts_from;

/// Share of the mismatch of the rig as given that first order is off by.
const OUT_OF_PROPORTION: f64 = 0.05;
/// Gain from which on a mechanism is worth a fit.
const WORTH_A_FIT: f64 = 2.0;

/// Mechanisms with which the parameters could stay near what was given, at most `most` of different names, fitted from there;
/// beside the fitted `nominal` parameters.
///
/// # Errors
/// The rig as given cannot be simulated.
pub(crate) fn near_given(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    nominal: &Explanation,
    most: usize,
) -> Result<Vec<Explanation>, DiagnoseError> {
    let bare = Footing::of_given(bench, nominal)?;
    let origin = vec![0.0; nominal.set.len()];
    let at = bare.linearised(bench, &nominal.set, &origin)?;
    let counted = at.residuals.iter().filter(|r| **r != 0.0).count().max(1);
    let mean_square = at.residuals.iter().map(|r| r * r).sum::<f64>() / counted as f64;
    let scale = 1.0 / (1.0 + OUT_OF_PROPORTION * OUT_OF_PROPORTION * mean_square).sqrt();
    let scaled = |values: &Vec<f64>| values.iter().map(|v| scale * v).collect::<Vec<f64>>();
    let at = Linearised { residuals: scaled(&at.residuals), jacobian: at.jacobian.iter().map(scaled).collect() };
    let Some(projector) = Projector::weighing(&at, vec![1.0; at.residuals.len()], &nominal.set.prior(), &origin) else {
        return Ok(Vec::new());
    };
    let mut ranked: Vec<(usize, &[f64], Answered)> = Vec::new();
    for (k, start, effect_kpa) in effects_on_given(bench, candidates, &bare.arcs)? {
        let effect: Vec<f64> = effect_kpa.iter().zip(&bare.weights).map(|(e, w)| scale * e * w).collect();
        let Some(candidate) = candidates.get(k).filter(|_| effect.iter().all(|e| e.is_finite())) else { continue };
        let answered = projector.answer(effect);
        match ranked.iter_mut().find(|(known, ..)| candidates[*known].name() == candidate.name()) {
            Some((.., known)) if known.gain >= answered.gain => {}
            Some(known) => *known = (k, start, answered),
            None => ranked.push((k, start, answered)),
        }
    }
    ranked.sort_by(|a, b| b.2.gain.total_cmp(&a.2.gain));
    let worth = ranked.into_iter().filter(|(.., answered)| answered.gain > WORTH_A_FIT).take(most);
    let fitted = worth.filter_map(|(k, start, answered)| {
        let values = candidates.get(k)?.scaled(start, answered.amplitude);
        let from = starts_from(bench, candidates, &answered.step, &[k], &[(k, values)]);
        bench.fit(candidates, &[k], &[from], Effort::Polish).ok()
    });
    Ok(fitted.collect())
}
