//! All that is usual at once, where a search has ended far from the data.
//!
//! Terms come in one at a time, or two. Where several are there, none of which sets much right without the others, parameters stand in
//! for them, and what comes in next is wrong. Valves of every rig are late a little, by their coils and by what drives them, and gas warms
//! as it is compressed: all of that is put beside what was found and fitted together, and what is not needed is taken out again
//! (backward elimination behind forward selection: Draper and Smith, *Applied Regression Analysis*, 1998, chapter 15).

use super::SearchSettings;
use super::additions::is_cheaper;
use super::late::{LATE_SENSOR, LATE_VALVES};
use super::terms::{is_open, kinds, starts, with};
use super::worth::earns_its_place;
use crate::bench::{Bench, Effort, Explanation};
use crate::judge::evidence::evidence;
use crate::judge::left;
use crate::search::candidate::Candidate;

/// Mechanism of gas that warms; it comes behind late valves where there is no room for all.
const WARM_GAS: &str = "chamber_thermal";

/// The terms of `best` and all that is usual in place of late sensors, which stand in for late valves, fitted together; `None` where that
/// is no better than `best`, or leaves much: so many terms fit a part of whatever is wrong.
pub(super) fn usual_at_once(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    [best, nominal]: [&Explanation; 2],
    settings: &SearchSettings,
    tell: &mut dyn FnMut(&str, f64),
) -> Option<Explanation> {
    let mut terms: Vec<usize> = best.terms.iter().copied().filter(|term| candidates[*term].id != LATE_SENSOR).collect();
    let mut new = Vec::new();
    for id in LATE_VALVES.into_iter().chain([WARM_GAS]) {
        for k in (0..candidates.len()).filter(|k| candidates[*k].id == id) {
            let more = with(&terms, k);
            if is_open(bench, candidates, &terms, k) && kinds(candidates, &more) <= settings.most_kinds {
                new.push((k, candidates[k].middle_start()));
                terms = more;
            }
        }
    }
    if new.is_empty() {
        return None;
    }
    tell("trying all that is usual at once", 0.0);
    let starts = starts(bench, candidates, best, &terms, &new, true);
    let all = bench.fit(candidates, &terms, &starts, Effort::Polish).ok()?;
    if bench.is_much(&left(bench, &all)) || !is_cheaper(bench, &all, best) {
        return None;
    }
    let found = evidence(bench, &all, best);
    earns_its_place(bench, candidates, settings, &found, [&all, best, nominal]).then_some(all)
}
