//! Terms that show while a pump stands, and those that show where the rig works.
//!
//! Recordings are cut where a pump was switched ([`fit::data::switched`]): pieces in which it stands show a leak and little else.

use fit::FitError;

use crate::bench::{Bench, Effort, Explanation};
use crate::error::DiagnoseError;
use crate::judge::evidence::evidence;
use crate::search::candidate::{Candidate, is_leak};
use crate::search::{starts, without};

/// Tells whether a pump stands in some recording, or some piece of one.
pub(crate) fn stands_somewhere(bench: &Bench<'_>) -> bool {
    (0..bench.records.records().len()).any(|record| !bench.pumps_run(record))
}

/// Effect that a mechanism must have where the rig works, in kPa, with all else as it is, to be what is missing, or worth an
/// experiment: less is below a thousandth of the 175 kPa that the pump spans.
pub(crate) const REACH_KPA: f64 = 0.175;

/// By how much readings would be off without the term that matters most to them: the largest of [`reaches_kpa`], 0 without terms.
///
/// # Errors
/// The rig cannot be simulated without a term.
pub(crate) fn reach_kpa(bench: &Bench<'_>, explanation: &Explanation) -> Result<f64, DiagnoseError> {
    Ok(reaches_kpa(bench, explanation)?.into_iter().fold(0.0, f64::max))
}

/// By how much readings would be off without each of the terms, all else as it is: root mean square in kPa of the pressure that
/// it moves most, in the middle one of the recordings in which no pump was switched. Infinite where there are none.
///
/// A shut chamber at the end of what the pump can do shows a leak of a thousandth of the vent's flow, and takes any other
/// error of the pump for one; commands over the whole range of a valve show what it does where nobody uses it. What moves
/// nothing by [`REACH_KPA`] where the rig works is not what is missing.
///
/// # Errors
/// The rig cannot be simulated without it for another reason than that its numbers leave, where it is infinite.
pub(crate) fn reaches_kpa(bench: &Bench<'_>, explanation: &Explanation) -> Result<Vec<f64>, DiagnoseError> {
    let records = bench.records.records();
    let whole = |record: &usize| records.iter().filter(|r| r.source == records[*record].source).count() == 1;
    let ordinary: Vec<usize> = (0..records.len()).filter(whole).collect();
    let given = bench.rig.mechanisms.len();
    let reach = |term: usize| {
        let mut rig = explanation.fitted.rig.clone();
        rig.mechanisms.remove(given + term);
        let without = match bench.free_run(&rig) {
            Ok(without) => without,
            // With all else as it was fitted beside the term, the rig is no rig without it.
            Err(DiagnoseError::Fit(FitError::NotFinite { .. })) => return Ok(f64::INFINITY),
            Err(other) => return Err(other),
        };
        let moved = |record: &usize| bench.most_moved_kpa(&explanation.trace, &without, *record..*record + 1);
        let mut moved: Vec<f64> = ordinary.iter().map(moved).collect();
        moved.sort_by(f64::total_cmp);
        // Of an even number the lower one: one of four is an experiment.
        Ok(moved.get(moved.len().saturating_sub(1) / 2).copied().unwrap_or(f64::INFINITY))
    };
    (0..explanation.terms.len()).map(reach).collect()
}

/// Log-likelihood that a term must gain where the pumps run.
const GAINED_AT_WORK: f64 = 5.0;

/// The explanation `best` without the terms that show while a pump stands and at no other time, everything else fitted
/// again: recordings, and pieces of them, in which all pumps run are asked by themselves. Leaks stay, for such holds are
/// made to show them.
///
/// A pump that stands has its cylinders somewhere along their stroke, each shut off at a pressure of its own: some tens of
/// millilitres that nobody knows, and that a wall which gives way, a gas that warms or a line can stand for.
///
/// # Errors
/// What is left cannot be fitted.
pub(crate) fn at_work(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    mut best: Explanation,
) -> Result<Explanation, DiagnoseError> {
    let records = bench.records;
    let (at_work, at_rest): (Vec<usize>, Vec<usize>) =
        (0..records.records().len()).partition(|record| bench.pumps_run(*record));
    let asked = best.terms.iter().copied().filter(|term| !is_leak(candidates, *term));
    let asked: Vec<usize> = asked.collect();
    if at_work.is_empty() || at_rest.is_empty() || asked.is_empty() {
        return Ok(best);
    }
    let whole = |record: &usize| records.records().get(*record).map(|r| (*record, 0..r.time_s.len()));
    let (records, places) = records.parts(&at_work.iter().filter_map(whole).collect::<Vec<_>>());
    let counted: Vec<f64> = places.iter().map(|place| bench.counted().get(*place).copied().unwrap_or(0.0)).collect();
    let at_work = bench.over(&records, &counted, bench.simulator.fidelity());
    for term in asked {
        let rest = without(&best.terms, term);
        // What was made up for the term may lead astray: from the priors' means as well.
        let fitted = |bench: &Bench<'_>, terms: &[usize]| {
            bench.fit(candidates, terms, &starts(bench, candidates, &best, terms, &[], true), Effort::Polish)
        };
        let (Ok(with), Ok(less)) = (fitted(&at_work, &best.terms), fitted(&at_work, &rest)) else { continue };
        let gained = evidence(&at_work, &with, &less);
        if gained.fitted + gained.chosen < GAINED_AT_WORK {
            best = fitted(bench, &rest)?;
        }
    }
    Ok(best)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::search::candidate::candidates;
    use fit::data::Records;
    use fit::data::switched::BehindChanges;
    use fit::simulate::{Fidelity, Simulator};
    use model::rig::Rig;
    use proto::recording::Recording;
    use proto::recording::csv::{Column, ColumnData};

    const ROWS: usize = 1000;

    /// A recording of these duties, its readings those of one rig while the pump runs, which it does where `on` is 1, and of
    /// another one while it stands; with noise.
    fn made(source: &str, duty: [Vec<f64>; 2], on: &dyn Fn(usize) -> f64, [at_work, at_rest]: [&Rig; 2]) -> Recording {
        let recorded = |kpa: [Vec<f64>; 2]| {
            let column =
                |name: &str, values: Vec<f64>| Column { name: name.to_owned(), data: ColumnData::Numbers(values) };
            let [pos, neg] = kpa;
            let columns = vec![
                column("u_pos", duty[0].clone()),
                column("u_neg", duty[1].clone()),
                column("p_pos_kpa", pos),
                column("p_neg_kpa", neg),
                column("pump_on", (0..ROWS).map(on).collect()),
            ];
            Recording::new(source, (0..ROWS).map(|k| 0.02 * k as f64).collect(), columns).unwrap()
        };
        let records = Records::new(at_work, &[recorded([vec![0.0; ROWS], vec![0.0; ROWS]])]).unwrap();
        let free = |rig: &Rig| {
            let simulator = Simulator::new(&records, Fidelity::Averaged);
            simulator.free(std::slice::from_ref(rig)).pop().unwrap().unwrap()
        };
        let (work, rest) = (free(at_work), free(at_rest));
        // Noise of 0.05 kPa, the same each time.
        let mut state = source.len() as u64;
        let mut noise = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            0.087 * ((state >> 33) as f64 / f64::from(1u32 << 30) - 1.0)
        };
        recorded([0, 1].map(|channel| {
            let rows = records.layout().channel(0, channel).enumerate();
            rows.map(|(row, i)| if on(row) < 0.5 { rest[i] } else { work[i] } + noise()).collect()
        }))
    }

    /// Filled with both valves shut, then left alone.
    fn shut_in(truths: [&Rig; 2]) -> Recording {
        made("shut_in.csv", [vec![0.0; ROWS], vec![0.0; ROWS]], &|row| f64::from(row < 200), truths)
    }

    fn named(all: &[Candidate], name: &str) -> usize {
        all.iter().position(|candidate| candidate.name() == name).unwrap()
    }

    /// A leak that a shut-in shows by a kPa, and that moves what was recorded with the valves at work by less than a tenth.
    #[test]
    fn what_only_a_shut_in_shows_does_not_reach_where_the_rig_works() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let all = candidates(&rig);
        let leak = named(&all, "chamber_leak:positive");
        let mut truth = rig.clone();
        truth.mechanisms.push(all[leak].attached(&[4e-17]));
        let working: Vec<f64> = (0..ROWS).map(|k| 0.78 + 0.1 * (0.013 * k as f64).sin()).collect();
        let ordinary = made("ordinary.csv", [working.clone(), working], &|_| 1.0, [&truth, &truth]);
        let shut_in = shut_in([&truth, &truth]);
        let of = |recordings: &[Recording]| {
            let cut = BehindChanges::of(&rig, &Records::new(&rig, recordings).unwrap()).unwrap().records;
            let usable = vec![1.0; cut.layout().len()];
            let bench = Bench::new(&rig, &cut, &usable, Fidelity::Averaged);
            let set = bench.set_of(&all, &[leak]).unwrap();
            let mut start = vec![0.0; set.len()];
            *start.last_mut().unwrap() = all[leak].parameters(0)[0].coordinate(4e-17);
            let explanation = bench.fit(&all, &[leak], &[start], Effort::Polish).unwrap();
            let without = bench.free_run(&rig).unwrap();
            let off = explanation.trace.iter().zip(&without).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            (reach_kpa(&bench, &explanation).unwrap(), off)
        };
        let (reach, most) = of(&[ordinary, shut_in.clone()]);
        assert!(reach > 0.0 && reach < 0.1 && most > 1.0, "{reach} {most}");
        // Where all was recorded with the pump switched, nothing says how far it reaches.
        assert_eq!(of(&[shut_in]).0, f64::INFINITY);
    }

    /// A chamber that seems to give way, once while the pump stands alone and once always, beside a leak.
    #[test]
    fn what_shows_while_the_pump_stands_alone_is_left_out_and_leaks_stay() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let all = candidates(&rig);
        let (leak, walls) = (named(&all, "cross_leak:positive"), named(&all, "volume_compliance:negative"));
        let mut terms = vec![leak, walls];
        terms.sort_unstable();
        let mut leaky = rig.clone();
        leaky.mechanisms.push(all[leak].attached(&[1e-15]));
        let mut both = leaky.clone();
        both.mechanisms.push(all[walls].attached(&[0.8]));
        // Over most of the range: the filling at the start, which shows walls best, does not count.
        let hold = |row: usize, length: usize| if (row / length).is_multiple_of(2) { 0.66 } else { 0.95 };
        let duty = || [(0..ROWS).map(|row| hold(row, 70)).collect(), (0..ROWS).map(|row| hold(row, 110)).collect()];
        let left = |at_work: &Rig| {
            let recordings = [made("ordinary.csv", duty(), &|_| 1.0, [at_work, at_work]), shut_in([at_work, &both])];
            let cut = BehindChanges::of(&rig, &Records::new(&rig, &recordings).unwrap()).unwrap().records;
            let usable = vec![1.0; cut.layout().len()];
            let bench = Bench::new(&rig, &cut, &usable, Fidelity::Averaged);
            let set = bench.set_of(&all, &terms).unwrap();
            let mut start = vec![0.0; bench.nominal.len()];
            for term in &terms {
                let value = if *term == leak { 1e-15 } else { 0.8 };
                start.extend(all[*term].parameters(0).first().map(|parameter| parameter.coordinate(value)));
            }
            assert_eq!(start.len(), set.len());
            let best = bench.fit(&all, &terms, &[start], Effort::Polish).unwrap();
            super::at_work(&bench, &all, best).unwrap().terms
        };
        assert_eq!(left(&leaky), [leak]);
        assert_eq!(left(&both), terms);
    }
}
