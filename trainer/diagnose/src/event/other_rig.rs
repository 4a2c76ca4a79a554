//! Recordings in which the rig was another one from beginning to end.
//!
//! A hose that was off for one flight, a valve that was exchanged between two: no one rig explains all files then, and a search over
//! them finds a term that is wrong in each. The rig as it was given tells such files apart before anything is fitted. Where it explains
//! some to within their noise it is the rig of those; a file that it errs in, throughout and although the same was asked of it
//! there, was recorded of another one. That is asked of the commands, the pressures they lead to, and how far they move at
//! once: an experiment that shows what ordinary recordings do not is no other rig.

use std::ops::Range;

use fit::data::Records;
use fit::simulate::Fidelity;
use model::rig::Rig;

use super::{asked_outside, moves, range, sources};
use crate::bench::Bench;
use crate::error::DiagnoseError;
use crate::recordings::pieces::taken;

/// Rows of a stretch: 5 s.
const STRETCH: usize = 250;
/// Share of such stretches in which another rig shows. What happened in a span, or changed at a moment, leaves others at the noise.
const THROUGHOUT: f64 = 0.9;
/// Multiple of the noise's mean square up to which a file is explained: an error beyond the noise that is no larger than it.
const EXPLAINED: f64 = 2.0;
/// Share of a command's range by which a file's largest move may exceed that of the others. Chosen: the largest steps of two files that were
/// drawn alike differ by more than their ranges do.
const MOVES_BEYOND: f64 = 0.2;

/// Files that were recorded of the rig as it was given, and others that were not.
#[derive(Debug, Clone, PartialEq)]
pub struct OtherRig {
    /// Files that the rig as it was given explains to within their noise.
    pub explained: Vec<String>,
    /// Files in which it errs throughout.
    pub differing: Vec<Differing>,
}

/// A file that was recorded of another rig.
#[derive(Debug, Clone, PartialEq)]
pub struct Differing {
    /// The file.
    pub source: String,
    /// Error there of the rig as it was given, in the channel where it is largest: root mean square in kPa.
    pub rmse_kpa: f64,
}

impl OtherRig {
    /// Looks for files of another rig than `rig`; `usable` is 1 at readings that count. `None` where there are none, or where some
    /// file is neither plainly of the rig nor plainly of another.
    ///
    /// # Errors
    /// The rig cannot be simulated.
    pub fn find(rig: &Rig, records: &Records, usable: &[f64]) -> Result<Option<Self>, DiagnoseError> {
        if sources(records).len() < 2 {
            return Ok(None);
        }
        let bench = Bench::new(rig, records, usable, Fidelity::Detailed);
        let trace = bench.free_run(rig)?;
        Ok(Self::told(&bench, &trace))
    }

    /// Files of another rig than the one of a free run.
    fn told(bench: &Bench<'_>, trace: &[f64]) -> Option<Self> {
        let known = explained(bench, trace);
        let others: Vec<&str> = sources(bench.records).into_iter().filter(|source| !known.contains(source)).collect();
        // The rig is that of most files, or the rig file is not the rig's.
        if known.is_empty() || others.is_empty() || others.len() > known.len() {
            return None;
        }
        let alike: Vec<Part> = known.iter().flat_map(|source| parts_of(bench.records, source)).collect();
        let of = |source: &&str| {
            let parts = parts_of(bench.records, source);
            let squares = squares(bench, trace, &parts);
            let differs = bench.is_much(&beyond_noise(bench, &squares))
                && is_off_throughout(bench, trace, &parts)
                && is_asked_alike(bench, trace, &parts, &alike);
            let largest = squares.into_iter().flatten().fold(0.0, f64::max);
            differs.then(|| Differing { source: (*source).to_owned(), rmse_kpa: largest.sqrt() })
        };
        let differing = others.iter().map(of).collect::<Option<Vec<_>>>()?;
        Some(OtherRig { explained: known.into_iter().map(str::to_owned).collect(), differing })
    }

    /// The recordings that are of the rig as it was given, and which of their readings count.
    pub(crate) fn left_out(&self, records: &Records, usable: &[f64]) -> (Records, Vec<f64>) {
        let kept: Vec<Part> = self.explained.iter().flat_map(|source| parts_of(records, source)).collect();
        let (rest, places) = records.parts(&kept);
        let usable = taken(usable, &places);
        (rest, usable)
    }

    /// Tells whether a file is one of those of another rig.
    pub(crate) fn is_other(&self, source: &str) -> bool {
        self.differing.iter().any(|file| file.source == source)
    }

    /// The finding in words; `shown` gives the name under which a file is shown.
    pub(crate) fn in_words(&self, shown: impl Fn(&str) -> String) -> String {
        let explained: Vec<String> = self.explained.iter().map(|source| shown(source)).collect();
        let off: Vec<String> = self
            .differing
            .iter()
            .map(|file| format!("{} is off by {:.2} kPa", shown(&file.source), file.rmse_kpa))
            .collect();
        format!(
            "The rig as given explains {} down to {} noise; {}: the rig was another one there, and the rest of this answer leaves that out.",
            and(&explained),
            if explained.len() > 1 { "their" } else { "its" },
            and(&off)
        )
    }
}

/// Words in a row: `a, b and c`.
fn and(words: &[String]) -> String {
    match words {
        [first @ .., last] if !first.is_empty() => format!("{} and {last}", first.join(", ")),
        words => words.concat(),
    }
}

/// Files that a free run explains to within their noise, in every channel.
pub(crate) fn explained<'r>(bench: &Bench<'r>, trace: &[f64]) -> Vec<&'r str> {
    let all = sources(bench.records).into_iter();
    all.filter(|source| is_explained(bench, &squares(bench, trace, &parts_of(bench.records, source)))).collect()
}

/// Files that a free run explains to within their noise in each stretch of 5 s: nothing happened in them.
pub(crate) fn explained_throughout<'r>(bench: &Bench<'r>, trace: &[f64]) -> Vec<&'r str> {
    let all = |source: &&str| stretches(bench, trace, &parts_of(bench.records, source)).iter().all(|off| !off);
    explained(bench, trace).into_iter().filter(all).collect()
}

/// A recording, or a piece of one, and rows of it.
type Part = (usize, Range<usize>);

/// All rows of a file, however many pieces it was cut into.
fn parts_of(records: &Records, source: &str) -> Vec<Part> {
    let of = records.records().iter().enumerate().filter(|(_, record)| record.source == source);
    of.map(|(at, record)| (at, 0..record.time_s.len())).collect()
}

/// Mean square of what a trace is off by, by channel in kPa², over the readings of some rows that count; `None` where none does.
fn squares(bench: &Bench<'_>, trace: &[f64], parts: &[Part]) -> Vec<Option<f64>> {
    let layout = bench.records.layout();
    let of = |values: &[f64], i: usize| values.get(i).copied().unwrap_or(0.0);
    let of_channel = |channel: usize| {
        let all = parts.iter().flat_map(|(record, rows)| layout.stretch(*record, channel, rows.clone()));
        let counted = all.filter(|i| of(bench.counted(), *i) != 0.0);
        let off = counted.map(|i| of(trace, i) - of(bench.records.readings_kpa(), i));
        let (sum, rows) = off.fold((0.0, 0.0), |(sum, rows), off| (sum + off * off, rows + 1.0));
        (rows > 0.0).then_some(sum / rows)
    };
    (0..layout.channels()).map(of_channel).collect()
}

/// Tells whether such mean squares are those of the noise; readings of which none counts explain nothing.
fn is_explained(bench: &Bench<'_>, squares: &[Option<f64>]) -> bool {
    let sigma = bench.sigma_kpa();
    squares.iter().zip(sigma).all(|(square, sigma)| square.is_some_and(|square| square <= EXPLAINED * sigma * sigma))
}

/// Errors beyond the noise, by channel in kPa.
fn beyond_noise(bench: &Bench<'_>, squares: &[Option<f64>]) -> Vec<f64> {
    let both = squares.iter().zip(bench.sigma_kpa());
    both.map(|(square, sigma)| (square.unwrap_or(0.0) - sigma * sigma).max(0.0).sqrt()).collect()
}

/// Tells of each stretch of 5 s of a file in which readings count whether a trace errs in it by more than the noise.
fn stretches(bench: &Bench<'_>, trace: &[f64], parts: &[Part]) -> Vec<bool> {
    let stretches = parts.iter().flat_map(|(record, rows)| {
        let end = rows.end;
        rows.clone().step_by(STRETCH).map(move |from| (*record, from..(from + STRETCH).min(end)))
    });
    let counted = stretches.map(|part| squares(bench, trace, &[part])).filter(|all| all.iter().any(Option::is_some));
    let is_off = |squares: Vec<Option<f64>>| {
        let mut channels = squares.into_iter().zip(bench.sigma_kpa());
        channels.any(|(square, sigma)| square.is_some_and(|square| square > EXPLAINED * sigma * sigma))
    };
    counted.map(is_off).collect()
}

/// Tells whether a trace errs by more than the noise in nearly all stretches of 5 s of a file.
fn is_off_throughout(bench: &Bench<'_>, trace: &[f64], parts: &[Part]) -> bool {
    let off = stretches(bench, trace, parts);
    off.iter().filter(|off| **off).count() as f64 >= THROUGHOUT * off.len() as f64
}

/// Tells whether a file asks nothing of the rig that others do not: commands, simulated pressures, and moves of commands at once.
fn is_asked_alike(bench: &Bench<'_>, trace: &[f64], file: &[Part], others: &[Part]) -> bool {
    let (records, layout) = (bench.records, bench.records.layout());
    let all: Vec<Part> = others.iter().chain(file).cloned().collect();
    let rows = |parts: &[Part]| parts.iter().map(|(_, rows)| rows.len()).sum::<usize>();
    let of_file = rows(others)..rows(&all);
    let input = |n: usize, (record, rows): &Part| -> &[f64] {
        let input = records.records().get(*record).and_then(|record| record.inputs.get(n));
        input.and_then(|input| input.get(rows.clone())).unwrap_or_default()
    };
    let commands: Vec<Vec<f64>> =
        (0..records.inputs().len()).map(|n| all.iter().flat_map(|part| input(n, part)).copied().collect()).collect();
    let pressures: Vec<Vec<f64>> = (0..layout.channels())
        .map(|channel| {
            let of = |(record, rows): &Part| trace.get(layout.stretch(*record, channel, rows.clone()));
            all.iter().filter_map(of).flatten().copied().collect()
        })
        .collect();
    let furthest = |n: usize, parts: &[Part]| parts.iter().flat_map(|part| moves(input(n, part))).fold(0.0, f64::max);
    let moved_alike = commands
        .iter()
        .enumerate()
        .all(|(n, command)| furthest(n, file) <= furthest(n, others) + MOVES_BEYOND * range(command));
    asked_outside(&commands, &of_file) && asked_outside(&pressures, &of_file) && moved_alike
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::made::two_chambers::{SIGMA_KPA, holds, recorded, rig};
    use crate::search::candidate::candidates;

    /// The rig with a leak of its first chamber that moves a pressure by some tenths of a kPa.
    fn leaking(rig: &Rig) -> Rig {
        let mut leaking = rig.clone();
        let leaks = candidates(rig);
        let leak = leaks.iter().find(|c| c.id == "chamber_leak" && c.component == "a").unwrap();
        leaking.mechanisms.push(leak.attached(&[3e-16]));
        leaking
    }

    /// Answer on three files; what leaks in which of them.
    fn found(files: [(&Rig, Vec<f64>); 3]) -> Option<OtherRig> {
        let rig = rig();
        let recordings: Vec<_> =
            (0..).zip(&files).map(|(n, (of, drive))| recorded(of, &format!("run{n}.csv"), drive, n)).collect();
        let records = Records::new(&rig, &recordings).unwrap();
        OtherRig::find(&rig, &records, &vec![1.0; records.layout().len()]).unwrap()
    }

    #[test]
    fn a_file_of_a_rig_that_leaks_is_told_from_two_of_one_that_does_not() {
        let (sound, leaks) = (rig(), leaking(&rig()));
        // The same is asked in all three, whose noises differ.
        let drive = holds(1500, [0.1, 0.9], 0);
        for other in 0..3 {
            let of = |n: usize| (if n == other { &leaks } else { &sound }, drive.clone());
            let told = found([of(0), of(1), of(2)]).unwrap();
            let [differing] = &told.differing[..] else { panic!("{told:?}") };
            assert_eq!((differing.source.clone(), told.explained.len()), (format!("run{other}.csv"), 2));
            assert!(differing.rmse_kpa > 10.0 * SIGMA_KPA, "{differing:?}");
            let said = told.in_words(str::to_owned);
            assert!(said.contains(&format!("run{other}.csv is off by {:.2} kPa", differing.rmse_kpa)), "{said}");
        }
        assert_eq!(found([&sound; 3].map(|rig| (rig, drive.clone()))), None);
        // No file is of the rig as it was given.
        assert_eq!(found([&leaks; 3].map(|rig| (rig, drive.clone()))), None);
    }

    /// Physics that shows only under a drive which no other file has may be missing from the rig of all of them.
    #[test]
    fn a_file_that_asks_more_of_the_rig_is_not_of_another() {
        let (sound, leaks) = (rig(), leaking(&rig()));
        let low = |seed| holds(1500, [0.05, 0.4], seed);
        assert_eq!(found([(&sound, low(1)), (&sound, low(2)), (&leaks, holds(1500, [0.5, 0.9], 3))]), None);
    }

    /// A change for a while in one file is an event of its rig.
    #[test]
    fn a_file_that_is_off_for_a_while_is_of_the_same_rig() {
        let rig = rig();
        let drive = |seed| holds(1500, [0.1, 0.9], seed);
        let recordings: Vec<_> = (0..3).map(|n| recorded(&rig, &format!("run{n}.csv"), &drive(n), n)).collect();
        let records = Records::new(&rig, &recordings).unwrap();
        let mut readings = records.readings_kpa().to_vec();
        let pinched = records.layout().stretch(2, 0, 700..1000);
        readings[pinched].iter_mut().for_each(|kpa| *kpa += 2.0);
        let records = records.with_readings(readings).unwrap();
        let usable = vec![1.0; records.layout().len()];
        assert_eq!(OtherRig::find(&rig, &records, &usable).unwrap(), None);
        let bench = Bench::new(&rig, &records, &usable, Fidelity::Detailed);
        let trace = bench.free_run(&rig).unwrap();
        assert_eq!(explained_throughout(&bench, &trace), ["run0.csv", "run1.csv"]);
        let event = crate::event::find(&bench, &trace, &["run0.csv", "run1.csv"]).unwrap();
        assert_eq!(event.source, "run2.csv");
        assert_eq!(crate::event::find(&bench, &trace, &["run2.csv"]), None);
    }
}
