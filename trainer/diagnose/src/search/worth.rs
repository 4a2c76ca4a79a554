//! Worth of a further term: what it must show to be taken, and whether any could.

use fit::data::Role;

use super::SearchSettings;
use crate::bench::{Bench, Explanation};
use crate::judge::evidence::{Evidence, evidence};
use crate::judge::{FLOOR_KPA, left};
use crate::search::candidate::Candidate;
use crate::search::screen::Screening;

/// Error that a further term must set right, as a share of what is set right already: nobody's formula for the main effect is
/// exact, and what a tenth of it leaves behind looks like some small effect of another kind.
const BESIDE: f64 = 0.15;
/// Share of the mean squared error that is left.
const MOST_OF_THE_REST: f64 = 0.5;
/// Such a share for what is beyond doubt. Noise that wanders is not known to be noise and counts as left: of what any term could
/// set right this is more.
const MORE_THAN_A_THIRD: f64 = 0.4;

/// The noise may be this much less than it was taken for, as a share of its variance: what is left beyond it is then more.
const NOISE_DOUBT: f64 = 0.2;

/// Tells whether a further term could still earn its place beside those of `best`: none sets right more than all that is left
/// beyond the noise, and that less than it was taken for. A short search takes the noise for what it is, and asks for what is worth
/// a name without being beyond doubt.
pub(super) fn leaves_room(bench: &Bench<'_>, settings: &SearchSettings, best: &Explanation) -> bool {
    let noise: f64 = bench.sigma_kpa().iter().map(|sigma| sigma * sigma).sum();
    let beyond: f64 = left(bench, best).iter().map(|kpa| kpa * kpa).sum();
    let (doubt, least_kpa) = if settings.thorough {
        (NOISE_DOUBT, settings.bar.removed_beyond_doubt_kpa)
    } else {
        (0.0, settings.bar.removed_kpa)
    };
    (beyond + doubt * noise).sqrt() > least_kpa
}

/// Tells whether `with`, which has the evidence `found` against `without`, passes the bar, and is more than what the formulas of
/// the terms in `without` may have left of what the `nominal` rig misses: more than a share of it, or, where it shows or is beyond
/// doubt, most of what is left, be it in all channels together or in one where it shows. What a formula leaves is not what some
/// other physics does, and that explains a third of it at best. Nor is something slow what a slow ripple has left.
pub(super) fn earns_its_place(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    settings: &SearchSettings,
    found: &Evidence,
    [with, without, nominal]: [&Explanation; 3],
) -> bool {
    let mut new = with.terms.iter().filter(|term| !without.terms.contains(term));
    if bench.slow_ripple && found.removed_kpa < BESIDE_SLOW_RIPPLE_KPA && new.all(|term| candidates[*term].is_slow()) {
        return false;
    }
    let parameters = with.set.len().saturating_sub(without.set.len());
    let blocks = bench.blocks(Role::Fit).len();
    if !settings.bar.passed(found, parameters, candidates.len(), blocks) {
        return false;
    }
    let others = evidence(bench, without, nominal);
    found.removed_kpa > BESIDE * others.removed_kpa
        // A leak that a shut-in shows by a kPa is no measure of what is wrong while the pump runs.
        || found.removed_at_work_kpa > BESIDE * others.removed_at_work_kpa
            && (found.shows_somewhere() || found.is_beyond_doubt())
        || found.removed_kpa > FLOOR_KPA && found.share > MOST_OF_THE_REST
        || found.share > MORE_THAN_A_THIRD && found.is_beyond_doubt()
        || found.share_of_a_channel > MORE_THAN_A_THIRD && found.is_certain()
}

/// Error that something slow must set right beside a ripple that turned about once in a recording, in kPa: predicted to a tenth of
/// its height and a few degrees of its angle, it leaves a twentieth of a kPa that is as slow.
const BESIDE_SLOW_RIPPLE_KPA: f64 = 0.05;

/// Factor by which a term may come to gain more than the screen sees, to first order, where the rest is explained.
const BEYOND_THE_SCREEN: f64 = 5.0;

/// Tells whether anything on top of `base`, by what the screen sees in it, could set right `least_kpa` of the free run.
///
/// On `n` readings of a channel fitted with a scale `s`, a root of `k` in the drop of the mean square is a gain of `½ n (k/s)²`,
/// or more where the channel with the larger scale is the one. Where much is unexplained the screen's slopes lead nowhere,
/// and so does this.
pub(super) fn any_could_earn(bench: &Bench<'_>, base: &Explanation, screening: &Screening, least_kpa: f64) -> bool {
    if bench.is_much(&left(bench, base)) {
        return true;
    }
    let most =
        [&screening.single, &screening.double].into_iter().filter_map(|list| list.first()).map(|first| first.gain);
    let least = 0.5 * readings(bench, base).into_iter().fold(f64::INFINITY, f64::min) * least_kpa * least_kpa;
    BEYOND_THE_SCREEN * most.fold(0.0, f64::max) > least
}

/// Factor by which a fit to the end may come to gain more than a glance.
const BEYOND_A_GLANCE: f64 = 4.0;

/// Gain that something on top of `base` must have at a glance for a fit to the end to pass [`earns_its_place`]: a share of what the
/// terms in `base` set right of what the `nominal` rig misses, or of what is left in one channel, as a gain ([`any_could_earn`]).
pub(super) fn least_gain(bench: &Bench<'_>, nominal: &Explanation, base: &Explanation) -> f64 {
    let others = evidence(bench, base, nominal);
    let beside_kpa = BESIDE * f64::min(others.removed_kpa, others.removed_at_work_kpa).max(0.0);
    let of_channel = |(per_kpa2, left_kpa): (f64, f64)| {
        let third_kpa2 = f64::max(MORE_THAN_A_THIRD * left_kpa * left_kpa, FLOOR_KPA * FLOOR_KPA);
        0.5 * per_kpa2 * f64::min(beside_kpa * beside_kpa, third_kpa2)
    };
    let least = readings(bench, base).into_iter().zip(left(bench, base)).map(of_channel).fold(f64::INFINITY, f64::min);
    least / BEYOND_A_GLANCE
}

/// Fitted readings by channel over the square of its scale, in 1/kPa².
fn readings(bench: &Bench<'_>, base: &Explanation) -> Vec<f64> {
    let weights = bench.weighted(&base.fitted.scale_kpa);
    let mut readings = vec![0.0; bench.records.layout().channels()];
    for (_, channel, range) in bench.records.layout().all() {
        let of_channel = weights.get(range).unwrap_or_default();
        readings[channel] += of_channel.iter().map(|w| w * w).sum::<f64>();
    }
    readings
}
