//! When something that begins later did so.
//!
//! What begins at `t₀` does from then on what it would do if it had been there all the time, save for a second or two after
//! it begins. So one run with it there all the time, its effect cut off before `t₀`, tells what it would gain for every `t₀`,
//! and no fit has to find its way from a wrong one: a volume that joins ten seconds off moves no reading near the right time.
//!
//! Where other physics is missing too, parameters have given way and slopes lead astray; but what joins in an instant is
//! heard then, and at the same time in every recording that lasts so long. Such a time, if there is one, is tried as well.

use fit::cores::side_by_side;
use fit::simulate::Run;
use proto::recording::PERIOD_S;

use super::Projector;
use crate::bench::{Bench, Explanation};
use crate::search::candidate::Candidate;
use crate::search::quick_search::weighted;

/// Time between two onsets that are tried, in s, and around the best of those.
const STEPS_S: [f64; 2] = [2.0, 0.25];
/// Onsets earlier than this are "there all the time", in s.
const EARLIEST_S: f64 = 1.0;

/// Rows whose errors are taken together when a common transient is looked for: half a second.
const BLOCK: usize = 25;
/// Least ratio of the mean squared error there to what is usual in its recording, in every recording.
const STANDS_OUT: f64 = 6.0;
/// Onsets that are tried around a common transient, in s after its block begins: a chamber rings on for a while.
const AROUND_S: [f64; 5] = [-0.75, -0.5, -0.25, 0.0, 0.25];

/// Starts of the `open` candidates that begin later: at the time that gains most, and at that of a transient that all
/// recordings have.
pub(super) fn starts(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    base: &Explanation,
    open: &[usize],
    projector: &Projector<'_>,
    weights: &[f64],
) -> Vec<(usize, Vec<f64>)> {
    let fitted = &base.fitted;
    let mut tries = Vec::new();
    let mut runs = vec![Run::from(fitted.rig.clone())];
    for k in open {
        let Some((candidate, at)) = candidates.get(*k).and_then(|c| Some((c, c.onset()?))) else { continue };
        for start in &candidate.starts {
            let mut from_the_start = start.clone();
            if let Some(slot) = from_the_start.get_mut(at) {
                // A hundredth of a second: from the first row on.
                *slot = 0.01;
            }
            if tries.iter().any(|(known, values, _)| known == k && *values == from_the_start) {
                continue;
            }
            let mut rig = fitted.rig.clone();
            rig.mechanisms.push(candidate.attached(&from_the_start));
            tries.push((*k, from_the_start, at));
            runs.push(Run::from(rig));
        }
    }
    if tries.is_empty() {
        return Vec::new();
    }
    let elapsed_s = elapsed_s(bench);
    let traces = bench.fast.run(&runs, &fitted.arcs);
    let Some((Ok(still), traces)) = traces.split_first() else { return Vec::new() };
    let begun = side_by_side(traces, |trace| {
        let effect = weighted(still, trace.as_ref().ok()?, &[], weights);
        if effect.iter().all(|e| e.is_finite()) { most(projector, &effect, &elapsed_s) } else { None }
    });
    let mut best: Vec<(usize, f64, Vec<f64>)> = Vec::new();
    for ((k, mut values, at), begun) in tries.into_iter().zip(begun) {
        let Some((gain, onset_s)) = begun else { continue };
        if let Some(slot) = values.get_mut(at) {
            *slot = onset_s;
        }
        match best.iter_mut().find(|known| known.0 == k) {
            Some(known) if known.1 >= gain => {}
            Some(known) => *known = (k, gain, values),
            None => best.push((k, gain, values)),
        }
    }
    let mut starts: Vec<(usize, Vec<f64>)> = best.into_iter().map(|(k, _, values)| (k, values)).collect();
    if let Some(heard_s) = common_transient(bench, &base.trace) {
        for k in open {
            let Some((candidate, at)) = candidates.get(*k).and_then(|c| Some((c, c.onset()?))) else { continue };
            for (start, after_s) in candidate.starts.iter().flat_map(|start| AROUND_S.map(|after_s| (start, after_s))) {
                let mut values = start.clone();
                if let Some(slot) = values.get_mut(at) {
                    *slot = (heard_s + after_s).max(EARLIEST_S);
                }
                if !starts.contains(&(*k, values.clone())) {
                    starts.push((*k, values));
                }
            }
        }
    }
    starts
}

/// The time since a file began at which every recording that lasts so long, two at least if there are several, has an error that is
/// far above its usual one.
fn common_transient(bench: &Bench<'_>, trace: &[f64]) -> Option<f64> {
    let records = bench.records.records();
    let mut files: Vec<(&str, Vec<Option<f64>>)> = Vec::new();
    for (index, record) in records.iter().enumerate() {
        let loudness = loudness(bench, trace, index);
        let first = (record.elapsed_s(0) / PERIOD_S).round().max(0.0) as usize / BLOCK;
        let at = files.iter().position(|(source, _)| *source == record.source).unwrap_or_else(|| {
            files.push((&record.source, Vec::new()));
            files.len() - 1
        });
        let Some((_, blocks)) = files.get_mut(at) else { continue };
        blocks.resize(blocks.len().max(first + loudness.len()), None);
        // The very first rows err where a start is guessed.
        for (slot, loud) in blocks.iter_mut().skip(first).zip(loudness).skip(2) {
            *slot = Some(loud);
        }
    }
    let longest = files.iter().map(|(_, blocks)| blocks.len()).max()?;
    let common = |block: usize| {
        let heard: Vec<f64> = files.iter().filter_map(|(_, blocks)| *blocks.get(block)?).collect();
        (heard.len() >= files.len().min(2)).then(|| heard.into_iter().fold(f64::INFINITY, f64::min))
    };
    let all = (0..longest).filter_map(|block| Some((common(block)?, block)));
    let (loudest, block) = all.max_by(|a, b| a.0.total_cmp(&b.0))?;
    (loudest > STANDS_OUT).then(|| (block * BLOCK) as f64 * PERIOD_S)
}

/// Ratio of the squared error of each block of a recording to the usual one, in the channel where that is most.
fn loudness(bench: &Bench<'_>, trace: &[f64], record: usize) -> Vec<f64> {
    let (layout, recorded) = (bench.records.layout(), bench.records.readings_kpa());
    let mut most: Vec<f64> = Vec::new();
    for channel in 0..layout.channels() {
        let errors = layout.channel(record, channel).map(|i| {
            let counts = bench.counted().get(i).is_some_and(|weight| *weight != 0.0);
            let off = trace.get(i).zip(recorded.get(i)).map_or(0.0, |(t, r)| t - r);
            if counts { off * off } else { 0.0 }
        });
        let squares: Vec<f64> = errors.collect::<Vec<_>>().chunks(BLOCK).map(|block| block.iter().sum()).collect();
        let mut ordered = squares.clone();
        ordered.sort_by(f64::total_cmp);
        let usual = ordered.get(ordered.len() / 2).copied().unwrap_or(0.0).max(1e-12);
        most.resize(squares.len(), 0.0);
        for (slot, square) in most.iter_mut().zip(squares) {
            *slot = f64::max(*slot, square / usual);
        }
    }
    most
}

/// Seconds since its file began, of every reading.
fn elapsed_s(bench: &Bench<'_>) -> Vec<f64> {
    let layout = bench.records.layout();
    let mut elapsed = vec![0.0; layout.len()];
    for (record, _, range) in layout.all() {
        let Some(of) = bench.records.records().get(record) else { continue };
        for (row, place) in range.enumerate() {
            if let Some(slot) = elapsed.get_mut(place) {
                *slot = of.elapsed_s(row);
            }
        }
    }
    elapsed
}

/// The onset at which an effect gains most, and what.
fn most(projector: &Projector<'_>, effect: &[f64], elapsed_s: &[f64]) -> Option<(f64, f64)> {
    let end = elapsed_s.iter().copied().fold(0.0, f64::max);
    let from = |onset_s: f64| {
        let cut = effect.iter().zip(elapsed_s).map(|(e, t)| if *t < onset_s { 0.0 } else { *e });
        (projector.most(cut.collect()), onset_s)
    };
    let [coarse, fine] = STEPS_S;
    let steps = (end / coarse) as usize;
    let onsets = (0..steps).map(|k| EARLIEST_S + coarse * k as f64);
    let (_, about) = onsets.map(from).max_by(|a, b| a.0.total_cmp(&b.0))?;
    let reach = (coarse / fine) as i32;
    let nearby = (-reach..=reach).map(|k| (about + fine * f64::from(k)).max(EARLIEST_S));
    nearby.map(from).max_by(|a, b| a.0.total_cmp(&b.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::made;
    use fit::data::Records;
    use model::rig::Rig;
    use proto::recording::Recording;

    fn recording(source: &str, seconds: usize) -> Recording {
        let column = |of: &dyn Fn(usize) -> f64| (0..seconds * 50).map(of).collect::<Vec<f64>>();
        // Valves that move, and what a converter makes of pressures at rest.
        let moves = |every: usize| column(&|row| 0.8 + 0.05 * (row / every % 2) as f64);
        let rests = |kpa: f64, by: usize| column(&|row| kpa + 0.03 * (row * by % 3) as f64);
        made::recording(source, &[moves(50), moves(70)], [rests(90.0, 7), rests(-60.0, 5)])
    }

    /// When a transient is heard that lies at 12.5 s in the first so many recordings of these lengths.
    fn heard_in(first: usize, seconds: &[usize]) -> Option<f64> {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let recordings: Vec<Recording> =
            seconds.iter().enumerate().map(|(n, s)| recording(&format!("{n}.csv"), *s)).collect();
        let records = Records::new(&rig, &recordings).unwrap();
        let bench = made::bench(&rig, &records);
        let mut trace: Vec<f64> =
            records.readings_kpa().iter().enumerate().map(|(i, kpa)| kpa + 0.05 * (1 + i % 3) as f64).collect();
        for record in 0..first {
            let rows = records.layout().channel(record, 0);
            trace[rows][625..650].iter_mut().for_each(|kpa| *kpa += 1.0);
        }
        common_transient(&bench, &trace)
    }

    #[test]
    fn what_joins_is_heard_in_recordings_that_last_so_long() {
        assert_eq!(heard_in(3, &[20, 20, 20]), Some(12.5));
        // An experiment that ends before says nothing of it.
        assert_eq!(heard_in(2, &[20, 20, 6]), Some(12.5));
        // One that lasts so long and has none says that it is none.
        assert_eq!(heard_in(2, &[20, 20, 20]), None);
        // Of a single one among others it is not known whether it is common.
        assert_eq!(heard_in(1, &[20, 6, 6]), None);
        assert_eq!(heard_in(1, &[20]), Some(12.5));
    }
}
