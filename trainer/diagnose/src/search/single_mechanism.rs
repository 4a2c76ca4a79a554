//! Share of a rig's mismatch that a single mechanism explains while all parameters stay as they were given.
//!
//! Where re-identified parameters reach the noise, the likelihood has nothing left to say: a leak past an open valve
//! is a constant area, and so is a shift of the valve's spring. What remains is parsimony. If one number of one
//! mechanism takes away nearly all of the mismatch that the rig as given has, it explains what was seen as well as a
//! shift of many parameters does, and neither may be called the answer before an experiment has decided. If no
//! mechanism can, the shift stands alone.
//!
//! This is a rule of prudence, not a test: a leak behind random shifts of all parameters by 1-5 % mostly looks like one
//! more shift. Of 14 such shifts without a leak 2 passed 0.97 on 50 s of random holds, of 14 with a leak of
//! 1e-15 kg/(s Pa²) 5 did, of 14 with 3e-15 2. Only a valve held shut tells for sure.
//!
//! ```text
//! share = 1 − min over a of |r + a s|² / |r|²      r: given rig less recorded; s: effect at a first magnitude
//! ```

use fit::cores::side_by_side;
use fit::data::Role;
use fit::simulate::{Arcs, Run, refined_starts};
use model::rig::Rig;

use crate::bench::{Bench, Effort, Explanation};
use crate::error::DiagnoseError;
use crate::search::candidate::Candidate;
use crate::search::quick_search::{Footing, Glanced};
use crate::search::screen::AMPLITUDE;
use crate::search::{has_given_way, open_beside, starts, with};

/// Share of the given rig's mismatch that some mechanism must explain alone before moved parameters are doubted.
const ALL_BUT: f64 = 0.97;
/// Share above which a mechanism is a rival once they are: parameters are always off a little beside it.
const MOST_OF_IT: f64 = 0.8;
/// Rounds of a glance that a fit follows only where it comes close: it starts far off.
const ROUNDS: usize = 10;

/// A candidate by itself, and what it explains alone.
#[derive(Debug, Clone, PartialEq)]
pub struct Alone {
    /// The candidate.
    pub candidate: usize,
    /// Share of the mean squared mismatch that goes with it, 0 … 1.
    pub share: f64,
    /// Values at which it does.
    pub start: Vec<f64>,
}

/// The share of each candidate in `open`, largest first, of what `rig` is off by.
///
/// # Errors
/// The rig cannot be simulated.
pub fn alone(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    rig: &Rig,
    open: &[usize],
) -> Result<Vec<Alone>, DiagnoseError> {
    let arcs = refined_starts(&bench.fast, rig, &Arcs::led(bench.records))?;
    let mut runs = vec![Run::from(rig.clone())];
    let mut tries: Vec<(usize, &Vec<f64>)> = Vec::new();
    for (k, candidate) in open.iter().filter_map(|k| Some((*k, candidates.get(*k)?))) {
        for start in &candidate.starts {
            let mut with = rig.clone();
            with.mechanisms.push(candidate.attached(start));
            tries.push((k, start));
            runs.push(Run::from(with));
        }
    }
    let mut traces = bench.fast.run(&runs, &arcs).into_iter();
    let Some(Ok(still)) = traces.next() else { return Ok(Vec::new()) };
    // Nothing is fitted here, but what is held out stays so.
    let held_out = bench.split.weights(bench.records.layout(), Role::HeldOut);
    let weights: Vec<f64> = bench
        .counted()
        .iter()
        .zip(&held_out)
        .map(|(counted, held)| if *held != 0.0 { 0.0 } else { *counted })
        .collect();
    let mismatch: Vec<f64> = still.iter().zip(bench.records.readings_kpa()).map(|(s, r)| s - r).collect();
    let dot = |a: &[f64], b: &[f64]| -> f64 {
        a.iter().zip(b).zip(&weights).map(|((a, b), w)| if *w == 0.0 { 0.0 } else { a * b }).sum()
    };
    let all = dot(&mismatch, &mismatch);
    let mut found: Vec<Alone> = Vec::new();
    for ((candidate, start), trace) in tries.into_iter().zip(traces) {
        let Ok(trace) = trace else { continue };
        let effect: Vec<f64> = trace.iter().zip(&still).map(|(t, s)| t - s).collect();
        let (size, along) = (dot(&effect, &effect), dot(&effect, &mismatch));
        if size.is_nan() || size <= 0.0 || all <= 0.0 {
            continue;
        }
        let a = (-along / size).clamp(AMPLITUDE[0], AMPLITUDE[1]);
        let share = -(2.0 * a * along + a * a * size) / all;
        let of = |of: &Candidate| of.scaled(start, a);
        let alone = || Alone { candidate, share, start: candidates.get(candidate).map_or_else(|| start.clone(), of) };
        match found.iter_mut().find(|f| f.candidate == candidate) {
            Some(known) if known.share >= share => {}
            Some(known) => *known = alone(),
            None => found.push(alone()),
        }
    }
    found.sort_by(|a, b| b.share.total_cmp(&a.share));
    Ok(found)
}

/// Mechanisms that explain most of the given rig's mismatch by themselves.
#[derive(Default)]
pub(crate) struct ByThemselves {
    /// One of each name, with the rig's own parameters fitted.
    pub(crate) fitted: Vec<Explanation>,
    /// True where one of them explains all but a little before anything is fitted.
    pub(crate) nearly_all: bool,
}

/// Mechanisms that explain most of the given rig's mismatch by themselves, or beside the terms of `base`, at most `most`, fitted from
/// the rig as it was given with those terms: what explains its mismatch alone need move none of its numbers far. None where none
/// explains all but a little and the parameters of `base` have not given way either.
///
/// # Errors
/// The rig as given, with those terms, cannot be simulated.
pub(crate) fn by_themselves(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    base: &Explanation,
    most: usize,
) -> Result<ByThemselves, DiagnoseError> {
    let open = open_beside(bench, candidates, &base.terms);
    let given = base.set.rig_at(&base.as_given(bench)).map_err(DiagnoseError::rig(base.set.rig()))?;
    let lone = alone(bench, candidates, &given, &open)?;
    let nearly_all = lone.iter().any(|lone| lone.share > ALL_BUT);
    if !nearly_all && !has_given_way(bench, base) {
        return Ok(ByThemselves::default());
    }
    let footing = Footing::of_given(bench, base)?;
    let mut close: Vec<(String, usize, Glanced)> = Vec::new();
    let most_of_it: Vec<Alone> = lone.into_iter().filter(|lone| lone.share > MOST_OF_IT).collect();
    let glance = |Alone { candidate: k, start, .. }: &Alone| -> Result<Option<Glanced>, DiagnoseError> {
        let terms = with(&base.terms, *k);
        let set = bench.set_of(candidates, &terms)?;
        let from = starts(bench, candidates, base, &terms, &[(*k, start.clone())], true);
        Ok(footing.contender(bench, &set, &from.into_iter().skip(1).collect::<Vec<_>>(), ROUNDS))
    };
    let glances = side_by_side(&most_of_it, glance).into_iter().collect::<Result<Vec<_>, _>>()?;
    for (Alone { candidate: k, .. }, glanced) in most_of_it.into_iter().zip(glances) {
        let (Some(glanced), Some(candidate)) = (glanced, candidates.get(k)) else { continue };
        let name = candidate.name();
        match close.iter_mut().find(|(known, ..)| *known == name) {
            Some((.., best)) if best.cost <= glanced.cost => {}
            Some(known) => *known = (name, k, glanced),
            None => close.push((name, k, glanced)),
        }
    }
    close.truncate(most);
    let fitted = side_by_side(&close, |(_, term, glanced)| {
        bench.fit(candidates, &with(&base.terms, *term), std::slice::from_ref(&glanced.point), Effort::Polish).ok()
    });
    Ok(ByThemselves { fitted: fitted.into_iter().flatten().collect(), nearly_all })
}
