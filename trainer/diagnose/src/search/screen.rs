//! Which candidates are worth a fit: each one's effect, less what the free parameters could do instead.
//!
//! What an effect gains is told by [`Projector`], from two runs per first magnitude.
//!
//! The second run is of the rig whose parameters have given way, by the Jacobian's word, where they can take up most of the effect. Rings
//! that blow by shift a pressure by 3 kPa of which other parameters take up all but 0.03; what they do not do in proportion is
//! as much as that, and would hide it.

use fit::cores::side_by_side;
use fit::simulate::{Look, Run, flappers_of};
use model::rig::Rig;

use crate::bench::{Bench, Explanation};
use crate::search::candidate::Candidate;
use crate::search::quick_search::weighted;
use crate::search::with;

mod foreseen;
mod onset;
mod projector;

use foreseen::Seen;
use projector::Effect;
pub use projector::{AMPLITUDE, Projector, Size};

/// Finding of the screen on a candidate, or on one at two places.
#[derive(Debug, Clone, PartialEq)]
pub struct Screened {
    /// Candidates, each with values at which its effect is as large as is wanted, to first order.
    pub terms: Vec<(usize, Vec<f64>)>,
    /// Gain in log-likelihood at the best first magnitude, to first order.
    pub gain: f64,
    /// Shifts by which the base's coordinates give way.
    pub shift: Vec<f64>,
}

impl Screened {
    /// Terms of an explanation with these beside its own.
    pub(crate) fn beside(&self, terms: &[usize]) -> Vec<usize> {
        self.terms.iter().fold(terms.to_vec(), |terms, (k, _)| with(&terms, *k))
    }
}

/// Candidates by what they gain, strongest first.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Screening {
    /// Each on its own.
    pub single: Vec<Screened>,
    /// Mechanisms at two places at once, where that gains more than either alone: valves of one make are warm, slow or
    /// sticky together, and what one of them does to both channels may hide what each does to its own.
    pub double: Vec<Screened>,
    /// Effects of each of them.
    seen: Seen,
}

/// Gain in log-likelihood, to first order, that a second place must promise to be tried.
const SECOND_PLACE: f64 = 20.0;

/// Share of an effect's square that parameters must leave for it to be seen well enough without a second run: what they do out of
/// proportion is a small part of what they take up.
const TAKEN_UP: f64 = 0.3;

/// Screens candidates on top of an explanation, looking so for where flappers lay that are new to it.
pub fn screen(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    base: &Explanation,
    open: &[usize],
    look: Look,
) -> Screening {
    let prior = base.set.prior();
    let fitted = &base.fitted;
    let Some(projector) = Projector::of(fitted, &prior) else {
        return Screening::default();
    };
    let weights = bench.weighted(&fitted.scale_kpa);
    let later = onset::starts(bench, candidates, base, open, &projector, &weights);
    let offered = |k: &usize| candidates.get(*k).into_iter().flat_map(|candidate| &candidate.starts);
    let mut tries: Vec<(usize, &Vec<f64>)> =
        open.iter().flat_map(|k| offered(k).map(move |start| (*k, start))).collect();
    tries.extend(later.iter().map(|(k, start)| (*k, start)));
    let mut runs = vec![Run::from(fitted.rig.clone())];
    for (k, start) in &tries {
        let mut rig: Rig = fitted.rig.clone();
        rig.mechanisms.extend(candidates.get(*k).map(|candidate| candidate.attached(start)));
        runs.push(Run::from(rig));
    }
    // A flapper that is new to the rig lies where its first seconds fit best.
    let lying = flappers_of(&bench.fast, &runs, &fitted.arcs, look);
    for (run, flappers) in runs.iter_mut().zip(&lying) {
        run.flappers.clone_from(flappers);
    }
    let traces = bench.fast.run(&runs, &fitted.arcs);
    let Some((Ok(still), traces)) = traces.split_first() else { return Screening::default() };
    let of = |trace: &[f64]| -> Option<Vec<f64>> {
        let effect = weighted(still, trace, &[], &weights);
        effect.iter().all(|e| e.is_finite()).then_some(effect)
    };
    let seen = side_by_side(traces, |trace| Some(projector.seen(of(trace.as_ref().ok()?)?)));
    let seen = tries.into_iter().zip(seen).zip(lying.into_iter().skip(1));
    let seen = seen.filter_map(|(((k, start), effect), lying)| Some(((k, start, effect?), lying)));
    let (mut effects, lying): (Vec<Try<'_>>, Vec<_>) = seen.unzip();
    // Once more where the parameters have given way to it.
    let mut shifts: Vec<(usize, Vec<f64>)> = Vec::new();
    let mut runs: Vec<Run> = Vec::new();
    for ((at, (k, start, effect)), lying) in effects.iter().enumerate().zip(lying) {
        if effect.size > TAKEN_UP * projector.whole(effect) {
            continue;
        }
        let point = base.moved(effect.shift.as_slice());
        let (Some(candidate), Ok(mut rig)) = (candidates.get(*k), base.set.rig_at(&point)) else { continue };
        rig.mechanisms.push(candidate.attached(start));
        shifts.push((at, point.iter().zip(&fitted.point).map(|(to, from)| to - from).collect()));
        runs.push(Run { flappers: lying, ..Run::from(rig) });
    }
    let traces: Vec<_> = shifts.iter().zip(bench.fast.run(&runs, &fitted.arcs)).collect();
    let again = side_by_side(&traces, |((_, shift), trace)| {
        let effect = of(trace.as_ref().ok()?)?;
        Some(projector.seen(projector.without_shift(effect, shift)))
    });
    for ((at, _), again) in shifts.iter().zip(again) {
        let Some(again) = again else { continue };
        if let Some(known) = effects.get_mut(*at)
            && again.most().0 > known.2.most().0
        {
            known.2 = again;
        }
    }
    Screening { seen: Seen::of(&effects, &fitted.scale_kpa), ..ranked(candidates, &projector, &effects) }
}

/// Candidates by what their effects gain, alone and at two places.
fn ranked(candidates: &[Candidate], projector: &Projector<'_>, effects: &[Try<'_>]) -> Screening {
    let scaled = |k: usize, start: &[f64], a: f64| {
        (k, candidates.get(k).map_or_else(|| start.to_vec(), |candidate| candidate.scaled(start, a)))
    };
    let mut single: Vec<Screened> = Vec::new();
    for (k, start, effect) in effects {
        let (gain, a) = effect.most();
        let shift = effect.shift.iter().map(|by| a * by).collect();
        keep_best(&mut single, Screened { terms: vec![scaled(*k, start, a)], gain, shift });
    }
    let alone = |k: usize| single.iter().find(|s| s.terms.iter().any(|t| t.0 == k)).map_or(0.0, |s| s.gain);
    let mut double: Vec<Screened> = Vec::new();
    for (at, (k, start, effect)) in effects.iter().enumerate() {
        for (other, other_start, other_effect) in effects.iter().skip(at + 1) {
            let elsewhere = |(a, b): (&Candidate, &Candidate)| a.is_like(b) && a.component != b.component;
            let twins = candidates.get(*k).zip(candidates.get(*other)).is_some_and(elsewhere);
            if !twins || start != other_start {
                continue;
            }
            let (gain, [a, b]) = projector.most_of_both(effect, other_effect);
            if gain > alone(*k).max(alone(*other)) + SECOND_PLACE {
                let shifts = effect.shift.iter().zip(&other_effect.shift);
                let shift = shifts.map(|(one, other)| a * one + b * other).collect();
                let terms = vec![scaled(*k, start, a), scaled(*other, start, b)];
                keep_best(&mut double, Screened { terms, gain, shift });
            }
        }
    }
    for list in [&mut single, &mut double] {
        list.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    }
    Screening { single, double, seen: Seen::default() }
}

/// Keeps the best start of the same candidates.
fn keep_best(list: &mut Vec<Screened>, new: Screened) {
    let same = |known: &Screened| known.terms.iter().map(|t| t.0).eq(new.terms.iter().map(|t| t.0));
    match list.iter_mut().find(|known| same(known)) {
        Some(known) if known.gain >= new.gain => {}
        Some(known) => *known = new,
        None => list.push(new),
    }
}

/// A candidate at one of its starts, and what that does.
type Try<'t> = (usize, &'t Vec<f64>, Effect);
