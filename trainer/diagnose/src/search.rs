//! Which terms belong into the model: added one by one, swapped, deleted.
//!
//! | file | subject |
//! | --- | --- |
//! | `course` | round after round |
//! | `additions` | a further term: every candidate tried on top of what is found |
//! | `believed` | a further term that parameters have given way to |
//! | `worth` | what a further term must show to be taken |
//! | `exchange` | terms in exchange for others |
//! | `late` | late valves and late sensors in exchange for one another |
//! | `usual` | all that is usual at once, where a search has ended far from the data |
//! | `refine` | fits that least squares from where things stand would miss |
//! | `stepped` | what moves in steps, or begins at a moment |
//! | `slips` | what sticks and slips, found in pieces that forget a slip that came late |
//! | `twin` | what was found on one side, on the other |
//! | `prior` | what is known of candidates' parameters beforehand |
//! | `terms` | which terms may stand beside which, and where their parameters lie |

pub mod candidate;
pub mod place;
pub mod quick_search;
pub mod screen;
pub mod single_mechanism;

mod additions;
mod believed;
mod course;
mod exchange;
mod late;
mod prior;
mod refine;
mod slips;
mod stepped;
mod terms;
mod twin;
mod usual;
mod worth;

use fit::simulate::Look;

use crate::bench::{Bench, Explanation};
use crate::judge::evidence::{Bar, Evidence};

pub(crate) use believed::{brings_back, has_given_way};
pub use course::search;
pub use exchange::twins;
pub(crate) use late::{LATE_SENSOR, LATE_VALVES, late_in_place_of};
pub(crate) use stepped::lying_where;
pub use terms::{is_open, kinds, open_beside, position_of, starts, values_of, with, without};

/// Settings of a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchSettings {
    /// The most kinds of terms ([`kinds`]): backlash, lag and delay of both valves and warm gas are seven terms of four kinds.
    pub most_kinds: usize,
    /// Number of the best candidates of a round that are fitted to the end.
    pub polished: usize,
    /// Number of them beside what was found, where that leaves much.
    pub polished_of_much: usize,
    /// Number of candidates, those that the screen puts first, that are fitted at all.
    pub glanced: usize,
    /// Number of pairs, those that it puts first, that are fitted.
    pub paired: usize,
    /// True where candidates are also tried from the priors' means.
    pub from_prior: bool,
    /// True where the search looks as well where much time seldom brings an answer to light: fits from the priors' means once
    /// nothing passes, mechanisms by themselves from the build sheet, a grid of bands for what moves in steps and is behind beside
    /// what was found, one term further than a pair, pairs in exchange for what was found on both sides that are far behind, or
    /// again after each term, what comes near the bar by a noise that is less than it was taken for. What else a short search
    /// leaves out is told where it is.
    pub thorough: bool,
    /// Bar that a term must pass.
    pub bar: Bar,
}

impl SearchSettings {
    /// The whole search, for a rig whose pump was switched in the recordings or not.
    pub fn whole(switched: bool) -> Self {
        let bar = if switched { Bar::of_experiments() } else { Bar::default() };
        SearchSettings {
            most_kinds: 4,
            glanced: 6,
            paired: 3,
            polished: 3,
            polished_of_much: 6,
            from_prior: true,
            thorough: true,
            bar,
        }
    }

    /// A short one: the same in most cases (docs/diagnose-hidden-suite.md), in two thirds of the time where a rig lacks one or two
    /// mechanisms.
    pub fn short(switched: bool) -> Self {
        SearchSettings { thorough: false, ..Self::whole(switched) }
    }

    /// Closeness with which the screen looks for where flappers lay.
    fn look(&self) -> Look {
        if self.thorough { Look::Evenly } else { Look::Roughly }
    }

    /// For a round that is only there to see whether something follows.
    fn looking_ahead(&self) -> Self {
        SearchSettings { polished: 1, polished_of_much: 1, paired: 1, ..*self }
    }
}

/// A round of additions.
#[derive(Debug, Clone, PartialEq)]
pub struct Round {
    /// Terms before the round.
    pub base: Vec<usize>,
    /// Candidates after a glance, best first.
    pub ranked: Vec<Ranked>,
    /// Terms that the best one after fits to the end adds, ascending.
    pub best: Vec<usize>,
    /// Evidence for the best one against the base.
    pub evidence: Option<Evidence>,
    /// True where the best one was taken.
    pub taken: bool,
}

impl Round {
    /// Notes the best that was fitted to the end, and its evidence.
    fn shows(&mut self, best: &Explanation, found: Evidence) {
        self.best = best.terms.iter().copied().filter(|term| !self.base.contains(term)).collect();
        self.evidence = Some(found);
    }
}

/// A candidate after a glance.
#[derive(Debug, Clone, PartialEq)]
pub struct Ranked {
    /// Which.
    pub candidate: usize,
    /// Gain in log-likelihood and prior.
    pub gain: f64,
    /// Values of its parameters there.
    pub values: Vec<f64>,
}

/// Result of a search.
pub struct Found {
    /// The rig with its parameters fitted and nothing added.
    pub nominal: Explanation,
    /// The best explanation.
    pub best: Explanation,
    /// Terms of it that are there since the same is on the other side, with the same number.
    pub by_likeness: Vec<usize>,
    /// The strongest candidate that was not taken, on top of the best explanation.
    pub next: Option<Explanation>,
    /// Rounds in order.
    pub rounds: Vec<Round>,
    /// Every explanation that was fitted to the end.
    pub tried: Vec<Explanation>,
}

/// Rounds of least squares of a glance.
pub const GLANCE_ROUNDS: usize = 6;
/// Rounds of a glance at a pair: two terms at a time are further from where they will end.
pub(crate) const PAIR_ROUNDS: usize = 12;
/// Drop in cost (half chi-square) that pays for a term, and for a reading of the pump's speed.
pub const PRICE: f64 = 20.0;
/// And for each of its parameters: a mechanism is not worth a richer shape for less.
pub const PRICE_OF_A_PARAMETER: f64 = 5.0;

/// Cost of an explanation: half chi-square (robust) and prior.
pub fn cost(bench: &Bench<'_>, explanation: &Explanation) -> f64 {
    explanation.fitted.comparable_cost(bench.records, bench.fit_weights())
}
