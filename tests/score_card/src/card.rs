//! Figures over all cases.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use hidden_rig::truth::Class;

use crate::case::CaseScore;
use crate::free_run::root_mean_square;
use crate::judge::Outcome;
use crate::worth::Worth;

/// Share of cases.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Share {
    /// Cases that count.
    pub of_them: usize,
    /// Cases that could.
    pub all: usize,
}

impl Share {
    /// Counts the cases for which something holds.
    pub fn count<'a>(cases: impl Iterator<Item = &'a CaseScore>, holds: impl Fn(&CaseScore) -> bool) -> Self {
        cases.fold(Self::default(), |share, case| Self {
            of_them: share.of_them + usize::from(holds(case)),
            all: share.all + 1,
        })
    }

    /// As a fraction; none of none is nothing.
    pub fn fraction(self) -> Option<f64> {
        (self.all > 0).then(|| self.of_them as f64 / self.all as f64)
    }
}

/// Three points of a distribution.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Number of values.
    pub count: usize,
    /// A tenth lie below.
    pub tenth: f64,
    /// Half lie below.
    pub median: f64,
    /// Nine tenths lie below.
    pub ninetieth: f64,
}

impl Spread {
    /// Spread of these values, if there are any.
    pub fn of(values: impl Iterator<Item = f64>) -> Option<Self> {
        let mut values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
        values.sort_by(f64::total_cmp);
        let last = values.len().checked_sub(1)?;
        // Linear between the two values around the place.
        let at = |share: f64| {
            let place = share * last as f64;
            let low = place.floor() as usize;
            let high = (low + 1).min(last);
            values[low] + (values[high] - values[low]) * (place - low as f64)
        };
        Some(Self { count: values.len(), tenth: at(0.1), median: at(0.5), ninetieth: at(0.9) })
    }
}

/// Programs and cases of a card.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// The command line.
    pub command: String,
    /// Name of the suite and its seed.
    pub suite: String,
    /// The seed.
    pub seed: String,
    /// Commit of the checkout, with `+` if files had been changed since.
    pub commit: String,
    /// Cores of the machine.
    pub cores: usize,
}

/// The score card.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Card {
    /// Programs and cases.
    pub provenance: Provenance,
    /// Cases scored.
    pub cases: usize,
    /// Cases without an answer.
    pub failed: usize,
    /// Nulls in which something was named: goal none in 30.
    pub false_names_on_nulls: Share,
    /// Nulls that were left undecided: no false name, but no answer either.
    pub undecided_nulls: Share,
    /// Right at strengths where the oracle separates: goal at least 95 %.
    pub right_where_separable: Share,
    /// Share of right answers by class.
    pub right_by_class: BTreeMap<String, Share>,
    /// False names where the oracle cannot separate: there, silence or `undecided` is honest.
    pub false_where_inseparable: Share,
    /// Outside the library: `unknown_mechanism`, or the member that stands next to it.
    pub outside_seen: Share,
    /// Undecided answers whose rivals hold the truth.
    pub rivals_hold_truth: Share,
    /// Those among them that the proposed experiment decides rightly.
    pub experiment_decides: Share,
    /// Experiments that kept to the bounds.
    pub safe_experiments: Share,
    /// Share of the achievable gain: goal a median of at least 0.95.
    pub gain: Option<Spread>,
    /// Share of the gain where the answer was right.
    pub gain_where_right: Option<Spread>,
    /// Relative error of parameters.
    pub parameter_error: Option<Spread>,
    /// Intervals that hold the truth: goal 85 to 95 %.
    pub coverage: Share,
    /// Time of a diagnosis on the wall (s).
    pub wall_s: Option<Spread>,
    /// Processor time (s).
    pub cpu_s: Option<Spread>,
    /// Held-out error (kPa, root of the mean of both channels' squares) of rig as given, refit and answer.
    pub held_out_kpa: BTreeMap<String, Spread>,
    /// Worth of answers, by what they say.
    pub worth: Worth,
    /// Outcomes of last answers, by class.
    pub outcomes: BTreeMap<String, BTreeMap<String, usize>>,
    /// The confusion table: what is concealed, what was answered last, how often.
    pub confusion: BTreeMap<String, BTreeMap<String, usize>>,
}

/// A class in words.
pub fn class_name(class: Class) -> &'static str {
    match class {
        Class::Nothing => "nothing",
        Class::ParametersMoved => "parameters moved",
        Class::Single => "single",
        Class::Pair => "pair",
        Class::Triple => "triple",
        Class::Outside => "outside",
    }
}

fn in_library(case: &CaseScore) -> bool {
    matches!(case.class, Class::Single | Class::Pair | Class::Triple)
}

impl Card {
    /// Sums up.
    pub fn of(cases: &[CaseScore], provenance: Provenance) -> Self {
        let nulls = || cases.iter().filter(|case| case.is_null());
        let separable = || cases.iter().filter(|case| in_library(case) && case.separable);
        let undecided = || cases.iter().filter(|case| in_library(case) && case.first_answer == "undecided");
        let mut right_by_class: BTreeMap<String, Share> = BTreeMap::new();
        let mut outcomes: BTreeMap<String, BTreeMap<String, usize>> = BTreeMap::new();
        let mut confusion: BTreeMap<String, BTreeMap<String, usize>> = BTreeMap::new();
        for case in cases {
            let class = class_name(case.class).to_owned();
            *outcomes.entry(class.clone()).or_default().entry(case.last.as_str().to_owned()).or_default() += 1;
            *confusion.entry(case.concealed.clone()).or_default().entry(case.answer.clone()).or_default() += 1;
            if case.is_null() || case.class == Class::Outside || case.separable {
                let share = right_by_class.entry(class).or_default();
                share.all += 1;
                share.of_them += usize::from(case.right());
            }
        }
        let mut held_out_kpa = BTreeMap::new();
        for (name, pick) in [
            ("1 rig as given", (|case: &CaseScore| case.held_out.nominal_kpa) as fn(&CaseScore) -> Option<[f64; 2]>),
            ("2 parameters fitted", |case| case.held_out.refit_kpa),
            ("3 with what was found", |case| case.held_out.extended_kpa),
        ] {
            if let Some(spread) = Spread::of(cases.iter().filter_map(pick).map(root_mean_square)) {
                held_out_kpa.insert(name.to_owned(), spread);
            }
        }
        let gains = |cases: &mut dyn Iterator<Item = &CaseScore>| {
            // A ripple out of step is in nobody's floor: those cases have no share.
            Spread::of(cases.filter(|case| !case.ripple_is_lost()).filter_map(|case| case.held_out.share()))
        };
        let numbers = || cases.iter().flat_map(|case| &case.numbers);
        let intervals: Vec<bool> = numbers().filter_map(|number| number.covered).collect();
        let experiments = || cases.iter().flat_map(|case| &case.experiments);
        Self {
            provenance,
            cases: cases.len(),
            failed: cases.iter().filter(|case| case.first == Outcome::Failed).count(),
            false_names_on_nulls: Share::count(nulls(), CaseScore::falsely_named),
            undecided_nulls: Share::count(nulls(), |case| case.answer == "undecided"),
            right_where_separable: Share::count(separable(), CaseScore::right),
            right_by_class,
            false_where_inseparable: Share::count(
                cases.iter().filter(|case| in_library(case) && !case.separable),
                CaseScore::falsely_named,
            ),
            outside_seen: Share::count(cases.iter().filter(|case| case.class == Class::Outside), |case| {
                matches!(case.last, Outcome::Right | Outcome::Adjacent)
            }),
            rivals_hold_truth: Share::count(undecided(), |case| case.first == Outcome::Undecided),
            experiment_decides: Share::count(undecided().filter(|case| case.first == Outcome::Undecided), |case| {
                case.last == Outcome::Right
            }),
            safe_experiments: Share {
                of_them: experiments().filter(|experiment| experiment.safe).count(),
                all: experiments().count(),
            },
            gain: gains(&mut cases.iter().filter(|case| in_library(case))),
            gain_where_right: gains(&mut cases.iter().filter(|case| in_library(case) && case.right())),
            parameter_error: Spread::of(numbers().map(|number| number.relative_error)),
            coverage: Share { of_them: intervals.iter().filter(|covered| **covered).count(), all: intervals.len() },
            wall_s: Spread::of(cases.iter().map(|case| case.took.wall_s).filter(|wall_s| *wall_s > 0.0)),
            cpu_s: Spread::of(cases.iter().filter_map(|case| case.took.cpu_s)),
            held_out_kpa,
            worth: Worth::of(cases),
            outcomes,
            confusion,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_textbook() {
        let spread = Spread::of((0..=10).map(f64::from)).map(|s| [s.tenth, s.median, s.ninetieth]);
        assert_eq!(spread, Some([1.0, 5.0, 9.0]));
        assert_eq!(Spread::of([7.0].into_iter()).map(|s| [s.tenth, s.ninetieth]), Some([7.0, 7.0]));
        assert_eq!(Spread::of(std::iter::empty()), None);
    }
}
