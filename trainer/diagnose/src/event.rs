//! Something that happened: a time span in which the rig was another one.
//!
//! A hose that was pinched, a knob that was turned, a plug that came off: not physics that a model leaves out, and no
//! mechanism explains it, for outside that span the same commands do what they ought to. With `e²` the mean squared error
//! of a free run over half a second, two levels of it, inside and outside one span of rows, are likelier than one by
//!
//! ```text
//! 2 ln Λ = n ln e²(all) − n_in ln e²(in) − n_out ln e²(out)
//! ```
//!
//! (a change of variance at two points: Inclán & Tiao, *J. Am. Stat. Assoc.* 89, 1994). The span that gains most is an
//! event if it stands out (`LOUDER`), if no span of its length outside, in any recording, is nearly as bad (`UNIQUE`; what comes
//! back with every breath is no event, nor are errors that add up wherever nothing empties a chamber), and if the commands outside
//! cover what they did inside and moved as far at once, so that the model was asked the same.
//!
//! Where it happened is asked of the span alone: each number of the rig is changed by itself, from a hundredth to a hundred
//! times, and what then remains of the error tells which change is likest.

pub(crate) mod changes;
pub mod other_rig;

use std::ops::Range;

use fit::data::Records;
use fit::simulate::Simulator;
use model::rig::Rig;

use crate::bench::Bench;
use crate::error::DiagnoseError;

/// Rows whose errors are taken together: half a second.
const BLOCK: usize = 25;
/// Fewest blocks of an event.
const SHORTEST: usize = 3;
/// Largest share of a recording that is an event; beyond, the rest is.
const LARGEST: f64 = 0.5;
/// By how much the mean squared error inside must exceed that outside.
const LOUDER: f64 = 8.0;
/// And that of any span of the same length outside.
const UNIQUE: f64 = 3.0;
/// Share of the mean squared error inside that the middle block of another file comes to where that file is bad throughout: the rig is
/// another one there, or it is asked what it is not here, and what happened in this file is told by the others.
const THROUGHOUT: f64 = 0.5;
/// Root mean square inside, in kPa, below which it is not worth a word.
const LEAST_KPA: f64 = 0.2;
/// Share of an input's range by which what it does inside may go beyond what it does outside.
const BEYOND: f64 = 0.1;
/// Factors by which a number is changed at first.
const FACTORS: [f64; 8] = [0.01, 0.03, 0.1, 0.3, 3.0, 10.0, 30.0, 100.0];
/// Rounds in which the best factor's neighbours are tried, at half the distance each.
const ROUNDS: usize = 5;
/// Share of the squared error inside that a change must take away to be named, and how many times what a change of any other
/// component does. A rig in trouble does more than change one number (valves chatter, meters saturate), so the share may be
/// small; that nothing else comes near it is what tells.
const NAMED: f64 = 0.2;
const ALONE: f64 = 1.5;

/// A time span in which something was different.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// The file.
    pub source: String,
    /// First and last time in s.
    pub time_s: [f64; 2],
    /// Rows in it.
    pub rows: usize,
    /// Root mean square error inside and outside, in kPa.
    pub rmse_kpa: [f64; 2],
    /// The number that changed, if one number's change explains the event.
    pub change: Option<Change>,
}

/// A number of the rig that was another one during an event.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    /// Path of the number.
    pub path: String,
    /// The component it belongs to.
    pub component: String,
    /// Unit of the number; empty where it has none.
    pub unit: &'static str,
    /// Value of the number outside the event.
    pub before: f64,
    /// Value of the number inside the event.
    pub during: f64,
    /// Share of the squared error that goes with it.
    pub share: f64,
    /// Share of the squared error that goes with the best change of any other component.
    pub next_share: f64,
}

/// A file's rows, however many pieces it was cut into: record and row of each.
fn rows_of(records: &Records, source: &str) -> Vec<(usize, usize)> {
    let of = records.records().iter().enumerate().filter(|(_, r)| r.source == source);
    of.flat_map(|(record, r)| (0..r.time_s.len()).map(move |row| (record, row))).collect()
}

/// Names of the files that recordings are of, each once, however many pieces it was cut into.
fn sources(records: &Records) -> Vec<&str> {
    let mut sources: Vec<&str> = Vec::new();
    for r in records.records() {
        if !sources.contains(&r.source.as_str()) {
            sources.push(&r.source);
        }
    }
    sources
}

/// The span in which a free run errs as nowhere else; `trace` is of the recordings' layout. In files that the rig explains
/// (`explained`) nothing happened: what errs there is what was found elsewhere.
pub fn find(bench: &Bench<'_>, trace: &[f64], explained: &[&str]) -> Option<Event> {
    let all: Vec<(&str, Vec<f64>)> = sources(bench.records)
        .into_iter()
        .map(|source| (source, energy(bench, trace, &rows_of(bench.records, source))))
        .collect();
    let asked = all.iter().filter(|(source, _)| !explained.contains(source));
    let found = asked.filter_map(|(source, own)| {
        let others: Vec<&[f64]> = all.iter().filter(|(other, _)| other != source).map(|(_, e)| &e[..]).collect();
        find_in(bench, trace, source, (own, &others))
    });
    found.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, event)| event)
}

/// Mean squared errors of a file's blocks, summed over its channels.
fn energy(bench: &Bench<'_>, trace: &[f64], rows: &[(usize, usize)]) -> Vec<f64> {
    let layout = bench.records.layout();
    let sigma = bench.sigma_kpa();
    let of = |block: &[(usize, usize)]| {
        let mut both = 0.0;
        for channel in 0..layout.channels() {
            let (mut sum, mut count) = (0.0, 0.0);
            for (record, row) in block {
                let i = layout.channel(*record, channel).start + row;
                if bench.counted().get(i).is_some_and(|w| *w != 0.0) {
                    let off = trace.get(i).unwrap_or(&0.0) - bench.records.readings_kpa().get(i).unwrap_or(&0.0);
                    sum += off * off;
                    count += 1.0;
                }
            }
            // Never below the noise, whose logarithm would otherwise decide.
            let noise = sigma.get(channel).map_or(0.0, |s| s * s).max(1e-8);
            both += f64::max(sum / f64::max(count, 1.0), noise);
        }
        both
    };
    rows.chunks_exact(BLOCK).map(of).collect()
}

/// Finds the span in one file, with what it gains, by the errors of its blocks and those of the other files'.
fn find_in(
    bench: &Bench<'_>,
    trace: &[f64],
    source: &str,
    (energy, others): (&[f64], &[&[f64]]),
) -> Option<(f64, Event)> {
    let layout = bench.records.layout();
    let rows = rows_of(bench.records, source);
    let (gain, span) = likeliest(energy, others)?;
    let within = span.start * BLOCK..span.end * BLOCK;
    let [inside, outside] = means(energy, &span).map(f64::sqrt);
    let time = |at: usize| {
        let (record, row) = rows.get(at)?;
        bench.records.records().get(*record)?.time_s.get(*row).copied()
    };
    let time_s = [time(within.start)?, time(within.end - 1)?];
    // What the model was asked: the commands, and the pressures that it came to.
    let input = |n: usize| {
        let of =
            rows.iter().filter_map(move |(record, row)| bench.records.records().get(*record)?.inputs.get(n)?.get(*row));
        of.copied().collect::<Vec<f64>>()
    };
    let simulated = |channel: usize| {
        let of = rows.iter().filter_map(move |(record, row)| trace.get(layout.channel(*record, channel).start + row));
        of.copied().collect::<Vec<f64>>()
    };
    let inputs: Vec<Vec<f64>> = (0..bench.records.inputs().len()).map(input).collect();
    let simulated: Vec<Vec<f64>> = (0..layout.channels()).map(simulated).collect();
    let asked =
        asked_outside(&inputs, &within) && asked_outside(&simulated, &within) && moved_outside(&inputs, &within);
    if inside < LEAST_KPA || !asked {
        return None;
    }
    let event =
        Event { source: source.to_owned(), time_s, rows: within.len(), rmse_kpa: [inside, outside], change: None };
    Some((gain, event))
}

/// Sums of the first blocks: of none, of one, and so on to all.
fn sums_of(energy: &[f64]) -> Vec<f64> {
    let running = energy.iter().scan(0.0, |sum, e| {
        *sum += e;
        Some(*sum)
    });
    std::iter::once(0.0).chain(running).collect()
}

/// Tells whether most blocks of a file are loud beside a mean squared error.
fn is_bad_throughout(energy: &[f64], mean: f64) -> bool {
    let loud = energy.iter().filter(|e| **e >= THROUGHOUT * mean).count();
    2 * loud > energy.len()
}

/// The span of blocks that stands out most, with its gain; `None` if none does, or the blocks of `others` are nearly as bad somewhere
/// and not throughout.
fn likeliest(energy: &[f64], others: &[&[f64]]) -> Option<(f64, Range<usize>)> {
    let n = energy.len();
    let sums = sums_of(energy);
    let total = *sums.last()?;
    let mut best: Option<(f64, Range<usize>)> = None;
    for start in 0..n {
        for end in start + SHORTEST..=n {
            let (inside, outside) = ((end - start) as f64, (n - (end - start)) as f64);
            if inside > LARGEST * n as f64 {
                break;
            }
            let sum = sums[end] - sums[start];
            let [a, b] = [sum / inside, (total - sum) / outside];
            let gain = n as f64 * (total / n as f64).ln() - inside * a.ln() - outside * b.ln();
            if a > LOUDER * b && best.as_ref().is_none_or(|(most, _)| gain > *most) {
                best = Some((gain, start..end));
            }
        }
    }
    let (gain, span) = best?;
    let length = span.len();
    let mean = (sums[span.end] - sums[span.start]) / length as f64;
    let apart = |start: &usize| start + length <= span.start || *start >= span.end;
    let nearly = (0..=n - length).filter(apart).map(|start| (sums[start + length] - sums[start]) / length as f64);
    let elsewhere = others.iter().filter(|other| !is_bad_throughout(other, mean)).map(|other| {
        let sums = sums_of(other);
        let spans = sums.iter().zip(sums.iter().skip(length));
        spans.map(|(before, after)| (after - before) / length as f64).fold(0.0, f64::max)
    });
    let worst = nearly.chain(elsewhere).fold(0.0, f64::max);
    (mean > UNIQUE * worst).then_some((gain, span))
}

/// Mean inside and outside.
fn means(energy: &[f64], span: &Range<usize>) -> [f64; 2] {
    let inside: f64 = energy.get(span.clone()).unwrap_or_default().iter().sum();
    let all: f64 = energy.iter().sum();
    [inside / span.len().max(1) as f64, (all - inside) / (energy.len() - span.len()).max(1) as f64]
}

/// Tells whether what every input does inside (but for its furthest twentieth) lies within what it does outside.
pub(crate) fn asked_outside(inputs: &[Vec<f64>], rows: &Range<usize>) -> bool {
    inputs.iter().all(|input| {
        let outside = || input.iter().enumerate().filter(|(row, _)| !rows.contains(row)).map(|(_, v)| *v);
        let (low, high) = outside().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        let mut inside: Vec<f64> = input.get(rows.clone()).unwrap_or_default().to_vec();
        inside.sort_by(f64::total_cmp);
        let at = |share: f64| inside.get((share * (inside.len() - 1) as f64) as usize).copied().unwrap_or(0.0);
        let slack = BEYOND * (high - low);
        !inside.is_empty() && at(0.05) >= low - slack && at(0.95) <= high + slack
    })
}

/// Tells whether no input moves further at once inside, over half a second, than it does outside: what answers slowly is worst
/// after the largest of all steps, and nothing happened to it.
fn moved_outside(inputs: &[Vec<f64>], rows: &Range<usize>) -> bool {
    inputs.iter().all(|input| {
        let furthest = |of: &dyn Fn(usize) -> bool| {
            let moves = moves(input).enumerate().filter(|(row, _)| of(row + BLOCK));
            moves.map(|(_, size)| size).fold(0.0, f64::max)
        };
        furthest(&|row| rows.contains(&row)) <= furthest(&|row| !rows.contains(&row)) + BEYOND * range(input)
    })
}

/// Sizes of an input's moves over half a second, from its first row on.
pub(crate) fn moves(input: &[f64]) -> impl Iterator<Item = f64> {
    input.iter().zip(input.iter().skip(BLOCK)).map(|(before, after)| (after - before).abs())
}

/// Largest less smallest of an input.
pub(crate) fn range(input: &[f64]) -> f64 {
    let (low, high) = input.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    high - low
}

/// Rows of every recording inside an event; empty where there are none.
fn inside(records: &Records, event: &Event) -> Vec<Range<usize>> {
    let [from, to] = event.time_s;
    let of = |r: &fit::data::Record| {
        if r.source != event.source {
            return 0..0;
        }
        r.time_s.partition_point(|t| *t < from)..r.time_s.partition_point(|t| *t <= to)
    };
    records.records().iter().map(of).collect()
}

/// The recordings without an event: what lies before and after it, each a recording of its own. And which of the old
/// readings the new ones are.
pub fn without(records: &Records, event: &Event) -> (Records, Vec<usize>) {
    let mut parts = Vec::new();
    for (record, inside) in inside(records, event).into_iter().enumerate() {
        let all = 0..records.layout().rows(record);
        if inside.is_empty() {
            parts.push((record, all));
        } else {
            parts.push((record, all.start..inside.start));
            parts.push((record, inside.end..all.end));
        }
    }
    records.parts(&parts)
}

/// The change of one number of `rig` that explains an event best.
///
/// # Errors
/// The rig itself cannot be simulated.
pub fn what_changed(bench: &Bench<'_>, rig: &Rig, event: &Event) -> Result<Option<Change>, DiagnoseError> {
    let parts: Vec<(usize, Range<usize>)> = inside(bench.records, event).into_iter().enumerate().collect();
    let (records, places) = bench.records.parts(&parts);
    let counted: Vec<f64> = places.iter().map(|i| bench.counted().get(*i).copied().unwrap_or(0.0)).collect();
    let simulator = Simulator::new(&records, bench.simulator.fidelity());
    let squares = |trace: &[f64]| -> f64 {
        let off = trace.iter().zip(records.readings_kpa()).zip(&counted);
        off.map(|((t, r), w)| w * (t - r).powi(2)).sum()
    };
    let unchanged = simulator.free(std::slice::from_ref(rig)).pop().unwrap_or_else(|| Ok(Vec::new()));
    let unchanged = squares(&unchanged.map_err(DiagnoseError::rig(rig))?);
    let mut changes: Vec<Change> = Vec::new();
    for parameter in rig.parameters() {
        let Some(component) = component_of(&parameter.path) else { continue };
        if parameter.value <= 0.0 {
            continue;
        }
        // Numbers that a factor leads out of their range are left out.
        let mut tried: Vec<(f64, f64)> = Vec::new();
        let mut next: Vec<f64> = FACTORS.to_vec();
        let mut reach = 3.0_f64.sqrt();
        for _ in 0..=ROUNDS {
            let with: Vec<(f64, Rig)> = next
                .iter()
                .filter_map(|factor| {
                    let mut changed = rig.clone();
                    changed.set_value(&parameter.path, factor * parameter.value).ok()?;
                    Some((*factor, changed))
                })
                .collect();
            let rigs: Vec<Rig> = with.iter().map(|(_, rig)| rig.clone()).collect();
            for ((factor, _), trace) in with.iter().zip(simulator.free(&rigs)) {
                if let Ok(trace) = trace {
                    let left = squares(&trace);
                    if left.is_finite() {
                        tried.push((left, *factor));
                    }
                }
            }
            let Some((_, factor)) = tried.iter().copied().min_by(|a, b| a.0.total_cmp(&b.0)) else { break };
            next = vec![factor / reach, factor * reach];
            reach = reach.sqrt();
        }
        let Some((left, factor)) = tried.iter().copied().min_by(|a, b| a.0.total_cmp(&b.0)) else { continue };
        changes.push(Change {
            component,
            unit: parameter.unit,
            before: parameter.value,
            during: factor * parameter.value,
            share: 1.0 - left / unchanged.max(1e-12),
            next_share: 0.0,
            path: parameter.path,
        });
    }
    changes.sort_by(|a, b| b.share.total_cmp(&a.share));
    let Some(best) = changes.first() else { return Ok(None) };
    let others = changes.iter().filter(|c| c.component != best.component).map(|c| c.share);
    let next_share = others.fold(0.0, f64::max);
    let named = best.share > NAMED && best.share > ALONE * next_share;
    Ok(named.then(|| Change { next_share, ..best.clone() }))
}

/// The component of a path such as `lines.hose.area_mm2`; none for the air and the gas, which no event changes.
fn component_of(path: &str) -> Option<String> {
    let (table, rest) = path.split_once('.')?;
    let name = rest.rsplit_once('.').map(|(name, _)| name)?;
    ["volumes", "pumps", "valves", "lines", "sources"].contains(&table).then(|| name.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 40 blocks of unit error with a louder stretch, and the same with peaks that come back.
    #[test]
    fn a_loud_stretch_is_an_event_and_a_peak_that_comes_back_is_none() {
        let quiet = |k: usize| 0.5 + 0.1 * (k % 7) as f64;
        let loud: Vec<f64> = (0..40).map(|k| if (12..21).contains(&k) { 20.0 * quiet(k) } else { quiet(k) }).collect();
        let (gain, span) = likeliest(&loud, &[]).unwrap();
        assert_eq!(span, 12..21);
        assert!(gain > 20.0);
        let peaks: Vec<f64> = (0..40).map(|k| if k % 10 < 3 { 30.0 } else { quiet(k) }).collect();
        assert_eq!(likeliest(&peaks, &[]), None);
        let calm: Vec<f64> = (0..40).map(quiet).collect();
        assert_eq!(likeliest(&calm, &[]), None);
        // Nothing happened if another recording is as bad somewhere; one that is as bad for a shorter time says nothing.
        assert_eq!(likeliest(&loud, &[&calm, &loud]), None);
        let short: Vec<f64> = (0..40).map(|k| if k < 2 { 20.0 * quiet(k) } else { quiet(k) }).collect();
        assert_eq!(likeliest(&loud, &[&calm, &short]).unwrap().1, 12..21);
        // Nor does one that is bad throughout, beside which nothing stands out; beside another that is as bad for a while it is none.
        let throughout: Vec<f64> = (0..60).map(|k| 15.0 * quiet(k)).collect();
        assert_eq!(likeliest(&loud, &[&calm, &throughout]).unwrap().1, 12..21);
        assert_eq!(likeliest(&loud, &[&throughout, &loud]), None);
    }

    #[test]
    fn what_was_never_asked_outside_is_no_event() {
        let ramp: Vec<f64> = (0..100).map(f64::from).collect();
        assert!(!asked_outside(&[ramp], &(70..100)));
        let wave: Vec<f64> = (0..100).map(|k| (0.5 * f64::from(k)).sin()).collect();
        assert!(asked_outside(&[wave], &(70..100)));
    }

    /// Holds of 100 rows between two levels, one of them reached in one step from the lowest level to the highest.
    #[test]
    fn a_step_beyond_all_others_is_no_event() {
        let levels = [0.8, 0.9, 0.8, 0.7, 0.8, 0.9, 0.7, 0.8, 0.9, 0.8];
        let held = |levels: &[f64]| -> Vec<f64> { levels.iter().flat_map(|level| [*level; 100]).collect() };
        assert!(!moved_outside(&[held(&levels)], &(550..700)));
        // Among steps of that size it is one of many, and so is any of the smaller ones.
        assert!(moved_outside(&[held(&[levels, levels].concat())], &(550..700)));
        assert!(moved_outside(&[held(&levels)], &(150..350)));
    }
}
