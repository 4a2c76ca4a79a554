//! Evidence that one explanation is better than another, and by how much more than chance and small errors allow.

use fit::data::Role;
use fit::objective::Score;

use crate::bench::{Bench, Explanation};
use crate::judge::FLOOR_KPA;

/// Evidence for one explanation against another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Evidence {
    /// Gain in log-likelihood on the rows that were fitted.
    pub fitted: f64,
    /// Standard error of that gain, from the scatter of 10 s blocks.
    pub fitted_se: f64,
    /// Gain in log-likelihood on the rows that choose, which nothing was fitted to.
    pub chosen: f64,
    /// Standard error of that gain.
    pub chosen_se: f64,
    /// Mean over standard error of the gains of blocks of 4 s, each limited to [`LIMIT`] either way: whether the gain is
    /// there throughout, not in one stretch alone.
    pub throughout: f64,
    /// By what the free run became better, all channels together: root of the drop in mean squared error, in kPa
    /// (negative if it became worse); where a flapper's jumps throw one of them off, in the middle one of all
    /// stretches of 2 s.
    pub removed_kpa: f64,
    /// Such a root for all rows of the recordings, and pieces of them, in which all pumps run, in kPa.
    pub removed_at_work_kpa: f64,
    /// Such a root for all rows of the recording in which it became better by most, in kPa: what an experiment is made to show is a
    /// small part of all that was recorded.
    pub removed_somewhere_kpa: f64,
    /// Share of the worse one's mean squared error beyond the noise that this is, all channels together.
    pub share: f64,
    /// Largest such share of a single channel, among those that became better by what shows (0.06 kPa): what another term's formula
    /// leaves in the other channel is no measure of what this one does.
    pub share_of_a_channel: f64,
    /// Gain of prior and likelihood together on the fitted rows.
    pub posterior: f64,
}

/// Mean square of all readings over that of the middle stretch from which on late jumps have thrown a free run off: twice the
/// error. (0.55 kPa for 0.20 where a few came late; 0.13 for 0.09 where none did, and a sensor's lag showed in quick changes.)
const THROWN_OFF: f64 = 4.0;

/// Share of the error from which on a term sets right nearly all that is wrong.
pub const NEARLY_ALL: f64 = 0.75;

impl Evidence {
    /// Tells whether something is certain to be there, whatever its size.
    pub fn is_certain(&self) -> bool {
        let [fitted_se, chosen_se] = CERTAIN_SE;
        self.fitted + self.chosen > CERTAIN
            && self.fitted > fitted_se * self.fitted_se
            && self.chosen > chosen_se * self.chosen_se
    }

    /// Tells whether it is there in every part of the recordings, and as large in those that nothing was fitted to.
    pub fn is_beyond_doubt(&self) -> bool {
        self.fitted > DOUBT && self.fitted > DOUBT_SE * self.fitted_se && self.throughout > DOUBT_SE
    }

    /// Tells whether it is certain and shows in some recording, be it in that one alone.
    pub fn shows_somewhere(&self) -> bool {
        self.is_certain() && self.removed_somewhere_kpa > SHOWS_KPA
    }
}

/// Log-likelihood, fitted and kept rows together, at which something is there however little it does.
pub const CERTAIN: f64 = 50.0;
/// Standard errors by which fitted rows must show it, and those that choose.
const CERTAIN_SE: [f64; 2] = [2.0, 1.0];
/// Log-likelihood that nothing small which is not there gains, and standard errors of it.
const DOUBT: f64 = 100.0;
const DOUBT_SE: f64 = 4.0;
/// Error that must be set right in a recording for something to show there, in kPa: several times what the formulas of a sound rig
/// are off by.
const SHOWS_KPA: f64 = 0.06;

/// Evidence for `better` against `worse`; slow errors of the size that `better` has count little.
pub fn evidence(bench: &Bench<'_>, better: &Explanation, worse: &Explanation) -> Evidence {
    let errors = better.errors(bench);
    let of = |e: &Explanation, role| bench.score(&e.trace, role, errors);
    let fit = [of(better, Role::Fit), of(worse, Role::Fit)];
    let select = [of(better, Role::Select), of(worse, Role::Select)];
    let (fitted, fitted_se) = fit[0].gain_over(&fit[1]);
    let (chosen, chosen_se) = select[0].gain_over(&select[1]);
    // A jump that comes an instant late is no evidence against what drives it, nor one set right by chance for anything.
    let squares = |in_the_middle: bool| [better, worse].map(|e| bench.squares_by_channel(&e.trace, in_the_middle));
    let (all, middle) = (squares(false), squares(true));
    let sum = |squares: &[f64]| squares.iter().sum::<f64>();
    let thrown_off = all.iter().zip(&middle).any(|(all, middle)| sum(all) > THROWN_OFF * sum(middle));
    let [after, before] = if (better.jumps || worse.jumps) && thrown_off { middle } else { all };
    let floors: Vec<f64> = bench.noise.iter().map(|noise| noise.floor_kpa().powi(2)).collect();
    let share_of_a_channel = share_of_a_channel(&before, &after, &floors);
    let [before, drop] = [sum(&before), sum(&before) - sum(&after)];
    let noise = sum(&floors);
    let [of_better, of_worse] = [better, worse].map(|e| bench.squares_by_recording(&e.trace));
    let drops = of_better.iter().zip(&of_worse).map(|(after, before)| before - after);
    Evidence {
        fitted,
        fitted_se,
        chosen,
        chosen_se,
        throughout: throughout(&bench.score_finely(&better.trace, errors), &bench.score_finely(&worse.trace, errors)),
        removed_kpa: root_of_drop(drop),
        removed_at_work_kpa: root_of_drop(bench.squares_at_work(&worse.trace) - bench.squares_at_work(&better.trace)),
        removed_somewhere_kpa: drops.map(root_of_drop).fold(f64::NEG_INFINITY, f64::max),
        share: drop / (before - noise).max(1e-12),
        share_of_a_channel,
        posterior: fitted + worse.prior_cost - better.prior_cost,
    }
}

/// [`Evidence::share_of_a_channel`] of mean squares in kPa², by channel: before, after, and of the noise.
fn share_of_a_channel(before: &[f64], after: &[f64], noise: &[f64]) -> f64 {
    let all = before.iter().zip(after).zip(noise);
    let that_show = all.filter(|((before, after), _)| root_of_drop(*before - *after) > FLOOR_KPA);
    that_show.map(|((before, after), noise)| (before - after) / (before - noise).max(1e-12)).fold(0.0, f64::max)
}

/// Signed root of a drop in mean squared error: negative if it rose.
pub fn root_of_drop(drop: f64) -> f64 {
    drop.abs().sqrt().copysign(drop)
}

/// Where the gain of a block stops counting for [`Evidence::throughout`].
pub const LIMIT: f64 = 10.0;

/// Mean over standard error of limited gains.
fn throughout(better: &Score, worse: &Score) -> f64 {
    let gains: Vec<f64> = better
        .blocks
        .iter()
        .zip(&worse.blocks)
        .map(|(a, b)| a.log_likelihood.iter().sum::<f64>() - b.log_likelihood.iter().sum::<f64>())
        .map(|gain| gain.clamp(-LIMIT, LIMIT))
        .collect();
    let n = gains.len() as f64;
    let mean = gains.iter().sum::<f64>() / n.max(1.0);
    let variance = gains.iter().map(|g| (g - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    // All blocks alike (all at the limit) must not divide by nothing.
    mean / (variance / n.max(1.0) + 1e-4).sqrt()
}

/// Least gain on the rows that choose, in standard errors, of what shows in one recording.
const IN_ONE_RECORDING: f64 = 1.0;

/// Bar that a term must pass before it is named.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bar {
    /// Least gain in log-likelihood on the fitted rows, on top of the logarithm of the number of candidates and half
    /// a unit per parameter and block (Schwarz 1978, blocks being what is independent).
    pub fitted: f64,
    /// Least gain on the rows that choose, in standard errors of [`Evidence::throughout`].
    pub standard_errors: f64,
    /// Least gain on them, in standard errors, where the term takes away nearly all that is wrong ([`NEARLY_ALL`]): what only an
    /// experiment excites (a leak past a shut valve) gains in that recording and in no other.
    pub standard_errors_of_all: f64,
    /// Least share of the free run that it must set right, in kPa: what is smaller is no physics worth a name.
    pub removed_kpa: f64,
    /// Least share of the free run for what is there beyond doubt, in kPa: in five sound rigs with small nuisances what came
    /// nearest set right 0.011 kPa.
    pub removed_beyond_doubt_kpa: f64,
}

impl Default for Bar {
    fn default() -> Self {
        Bar {
            fitted: 12.0,
            standard_errors: 2.0,
            standard_errors_of_all: 1.5,
            removed_kpa: 0.03,
            removed_beyond_doubt_kpa: 0.02,
        }
    }
}

impl Bar {
    /// Where pumps were switched, as experiments do: what they are made for shows in one hold out of many minutes, and need
    /// not show anywhere else.
    pub fn of_experiments() -> Self {
        Bar { standard_errors_of_all: f64::NEG_INFINITY, ..Bar::default() }
    }

    /// Tells whether evidence for `parameters` more parameters, chosen among `candidates`, passes.
    pub fn passed(&self, evidence: &Evidence, parameters: usize, candidates: usize, blocks: usize) -> bool {
        let penalty = (candidates.max(1) as f64).ln() + 0.5 * parameters as f64 * (blocks.max(1) as f64).ln();
        let least = if evidence.share > NEARLY_ALL { self.standard_errors_of_all } else { self.standard_errors };
        let worth = if evidence.is_beyond_doubt() { self.removed_beyond_doubt_kpa } else { self.removed_kpa };
        evidence.fitted - penalty > self.fitted
            && evidence.chosen > 3.0
            && (evidence.throughout > least && evidence.removed_kpa > worth
                || evidence.throughout > IN_ONE_RECORDING && evidence.shows_somewhere())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A valve that is throttled takes its channel from 0.12 to 0.07 kPa; what walls have left of 0.1 kPa in the other stays.
    #[test]
    fn what_is_set_right_is_measured_in_the_channel_where_it_shows() {
        let squares = |kpa: [f64; 2]| kpa.map(|kpa| kpa * kpa);
        let noise = squares([0.05, 0.05]);
        let share = |before, after| share_of_a_channel(&squares(before), &squares(after), &noise);
        let throttled = share([0.12, 0.1], [0.07, 0.1]);
        assert!((throttled - (0.0144 - 0.0049) / (0.0144 - 0.0025)).abs() < 1e-12, "{throttled}");
        // Nine tenths of next to nothing are nothing.
        assert_eq!(share([0.06, 0.1], [0.05, 0.1]), 0.0);
        assert_eq!(share([0.05, 0.1], [0.3, 0.1]), 0.0);
    }
}
