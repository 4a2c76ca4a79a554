//! Rig that an answer is written as: the one that was given, or what a fit made of it.

use fit::identify::no_worse_than;
use proto::diagnosis::{RigKind, Verdict};

use crate::bench::Bench;
use crate::judge::{Judgement, have_moved};
use crate::report::figures::Figures;
use crate::report::summary::noise_kpa;
use crate::search::Found;
use crate::unknown::UnknownTerm;

/// Rig that is written. What is worse on validation data than the rig as it was given is no answer: it loses its name, and the given
/// rig stays. What is named has its evidence, which may lie in rows that validation data lack, so that only more than chance counts
/// against it; moved parameters and what has no name have nothing but these figures to speak for them.
pub(crate) fn kind_of_rig(
    bench: &Bench<'_>,
    found: &Found,
    unknown: Option<&UnknownTerm>,
    [given, extended]: [&Figures; 2],
    judgement: &mut Judgement,
    notes: &mut Vec<String>,
) -> RigKind {
    if unknown.is_none() {
        with_nothing_left(bench, found, [given, extended], judgement);
    }
    if judgement.verdict == Verdict::Adequate {
        return RigKind::AsGiven;
    }
    let [before_kpa, after_kpa] = [given, extended].map(Figures::total_rmse_kpa);
    let is_named = match judgement.verdict {
        Verdict::MissingPhysics => true,
        Verdict::Undecided => !found.best.terms.is_empty(),
        _ => false,
    };
    let most_kpa = if is_named { no_worse_than(before_kpa, noise_kpa(bench)) } else { before_kpa };
    if after_kpa <= most_kpa {
        let extends = unknown.is_some() || !found.best.terms.is_empty();
        return if extends { RigKind::Extended } else { RigKind::Fitted };
    }
    let what = if found.best.terms.is_empty() && unknown.is_none() {
        "the rig with its parameters fitted"
    } else {
        "what was found"
    };
    notes.push(format!(
        "{what} is off by {after_kpa:.3} kPa on validation data where the rig as it was given is off by {before_kpa:.3} kPa: worse \
         than before, so the rig as given is kept"
    ));
    if judgement.verdict != Verdict::Undecided {
        let much = bench.is_much(&given.beyond_noise_kpa(&bench.sigma_kpa()));
        let unnamed = judgement.clone().of_no_name();
        let verdict = if much { Verdict::UnknownMechanism } else { Verdict::Adequate };
        *judgement = Judgement { verdict, ..unnamed };
    }
    RigKind::AsGiven
}

/// Takes back that something unknown is missing where the recordings as they are show nothing of it. A search runs on readings
/// without the pump's strokes; where a pump is switched on, the cylinders' own start is left in these, and looks like something.
fn with_nothing_left(bench: &Bench<'_>, found: &Found, [given, extended]: [&Figures; 2], judgement: &mut Judgement) {
    if judgement.verdict != Verdict::UnknownMechanism || !judgement.named.is_empty() {
        return;
    }
    let sigma_kpa = bench.sigma_kpa();
    let [before_kpa, left_kpa] = [given, extended].map(|figures| figures.beyond_noise_kpa(&sigma_kpa));
    if left_kpa.iter().zip(&sigma_kpa).any(|(left, sigma)| left > sigma) {
        return;
    }
    let traces = [&given.trace[..], &extended.trace[..]];
    let moved = have_moved(bench, &found.nominal, [&before_kpa, &left_kpa], traces);
    judgement.verdict = if moved { Verdict::ParametersMoved } else { Verdict::Adequate };
}

#[cfg(test)]
mod tests {
    use fit::data::Records;

    use super::*;
    use crate::made::{self, judged, made_after, moved};
    use crate::report::figures::figures;

    /// Parameters that were fitted to a sound rig, and by chance are a little worse on validation data: the rig as given stays.
    #[test]
    fn moved_parameters_that_are_worse_are_not_written() {
        let (rig, _) = moved(&[]);
        let records = Records::new(&rig, &made_after(0, 1000, &rig, 1, 5)).unwrap();
        let bench = made::bench(&rig, &records);
        let (found, judgement) = judged(&bench, &[]);
        let given = figures(&bench, &rig, bench.close.fidelity(), false).unwrap();
        let of = |[before, after]: [f64; 2], verdict: Verdict| {
            let [given, extended] = [before, after].map(|factor| {
                let mut figures = given.clone();
                figures.free.iter_mut().for_each(|error| error.rmse_kpa *= factor);
                figures
            });
            let (mut judgement, mut notes) = (Judgement { verdict, ..judgement.clone() }, Vec::new());
            let kind = kind_of_rig(&bench, &found, None, [&given, &extended], &mut judgement, &mut notes);
            (kind, judgement.verdict, notes.len())
        };
        assert_eq!(of([1.0, 1.01], Verdict::ParametersMoved), (RigKind::AsGiven, Verdict::Adequate, 1));
        assert_eq!(of([1.0, 0.99], Verdict::ParametersMoved), (RigKind::Fitted, Verdict::ParametersMoved, 0));
        // What the pump's ripple told is no matter of chance on these rows.
        assert_eq!(of([1.0, 1.01], Verdict::MissingPhysics).0, RigKind::Fitted);
        // Nothing unknown is missing where nothing is left.
        let unknown = Verdict::UnknownMechanism;
        assert_eq!(of([1.0, 1.01], unknown), (RigKind::AsGiven, Verdict::Adequate, 0));
        assert_eq!(of([20.0, 1.0], unknown), (RigKind::Fitted, Verdict::ParametersMoved, 0));
        assert_eq!(of([20.0, 5.0], unknown), (RigKind::Fitted, unknown, 0));
        assert_eq!(of([20.0, 21.0], unknown).0, RigKind::AsGiven);
    }
}
