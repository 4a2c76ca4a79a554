//! Levels of a command that no recording came down to.
//!
//! A dead zone is told by commands below and above it. Where all commands were above, what shows is that the flow is no straight
//! line through zero: a line that begins later fits that, and so does a flow that bends with its command. The level is then where the
//! line would end, which is an extrapolation, and it is told as one.

use model::rig::{Pump, Rig};

use crate::bench::{Bench, Explanation};
use crate::report::wording::three;
use crate::search::candidate::Candidate;
use crate::search::values_of;

/// Keys of levels of a component's own command. (A cracking pressure is a difference that every stroke goes through, and no level
/// of a pressure that is recorded.)
const LEVELS: [&str; 1] = ["closed_duty"];
/// Rows that a command must lie between nothing and the level for the level to show: half a second.
const ROWS: usize = 25;

/// A level of a named term that no recording came down to.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Extrapolated {
    /// The term.
    term: usize,
    /// Column of the command.
    command: String,
    /// The level that fits.
    level: f64,
    /// Least command above nothing that was recorded.
    least: f64,
}

impl Extrapolated {
    /// Tells whether it is the number with this key of a term.
    pub(crate) fn is_of(&self, term: usize, key: &str) -> bool {
        self.term == term && LEVELS.contains(&key)
    }

    /// The finding in words, with what to record.
    pub(crate) fn in_words(&self) -> String {
        let Extrapolated { command, level, least, .. } = self;
        format!(
            "The level {} is an extrapolation: `{command}` was never between 0 and it for {} s in all (the least was {}), and a flow \
             that bends with its command would look the same. Record with `{command}` between {} and {} as well, and ask again with \
             that recording beside the others.",
            three(*level),
            ROWS as f64 * proto::recording::PERIOD_S,
            three(*least),
            three(0.5 * level),
            three(1.5 * level)
        )
    }
}

/// Levels among the numbers of `named` terms of `best` that no recording came down to.
pub(crate) fn extrapolated(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    best: &Explanation,
    named: &[usize],
) -> Vec<Extrapolated> {
    let of = |term: &usize| {
        let candidate = candidates.get(*term)?;
        let place = candidate.keys().position(|key| LEVELS.contains(&key))?;
        let level = *values_of(bench, candidates, best, *term)?.get(place)?;
        let command = command_of(bench.rig, &candidate.component)?;
        let records = 0..bench.records.records().len();
        let all: Vec<f64> =
            records.filter_map(|record| bench.records.input(record, command)).flatten().copied().collect();
        let driven = || all.iter().copied().filter(|duty| *duty > 0.0);
        let reached = driven().filter(|duty| *duty <= level).count() >= ROWS;
        let least = driven().fold(f64::INFINITY, f64::min);
        (!reached && least.is_finite()).then(|| Extrapolated { term: *term, command: command.to_owned(), level, least })
    };
    named.iter().filter_map(of).collect()
}

/// Column of the command of a valve or a pump.
fn command_of<'r>(rig: &'r Rig, component: &str) -> Option<&'r str> {
    if let Some(valve) = rig.valves.get(component) {
        return Some(&valve.command);
    }
    match rig.pumps.get(component)? {
        Pump::Flow(pump) => pump.command.as_deref(),
        Pump::Piston(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use fit::data::Records;
    use fit::simulate::Fidelity;

    use super::*;
    use crate::bench::Effort;
    use crate::made::two_chambers::{holds, recorded, rig};
    use crate::search::candidate::candidates;

    /// What is said of a dead zone at a level, where the pump was driven between two others.
    fn said(level: f64, driven: [f64; 2]) -> Vec<String> {
        let rig = rig();
        let all = candidates(&rig);
        let at = all.iter().position(|candidate| candidate.id == "dead_zone").unwrap();
        let mut truth = rig.clone();
        truth.mechanisms.push(all[at].attached(&[level]));
        let records = Records::new(&rig, &[recorded(&truth, "run.csv", &holds(1500, driven, 5), 5)]).unwrap();
        let bench = Bench::new(&rig, &records, &vec![1.0; records.layout().len()], Fidelity::Averaged);
        let mut start = vec![0.0; bench.nominal.len()];
        start.extend(all[at].parameters(0).iter().map(|parameter| parameter.coordinate(level)));
        let best = bench.fit(&all, &[at], &[start], Effort::Polish).unwrap();
        extrapolated(&bench, &all, &best, &[at]).iter().map(Extrapolated::in_words).collect()
    }

    #[test]
    fn a_dead_zone_below_every_command_is_an_extrapolation() {
        let [said_of_it] = &said(0.1, [0.2, 0.9])[..] else { panic!("nothing is said of it") };
        assert!(said_of_it.contains("`drive` was never between 0 and it"), "{said_of_it}");
        assert!(said_of_it.contains("the least was 0.200"), "{said_of_it}");
        assert_eq!(said(0.3, [0.1, 0.9]), Vec::<String>::new());
    }
}
