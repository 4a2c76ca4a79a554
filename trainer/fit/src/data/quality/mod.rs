//! Troubles of recordings, in plain words.
//!
//! | file | subject |
//! | --- | --- |
//! | `finding` | a finding: where, how bad, what it is, what to do |
//! | `shape` | too short, gaps, uneven time |
//! | `readings` | flat, stuck and clipped readings |
//! | `plateau` | readings clipped before the noise comes in, told by what the rig would do |
//! | `wild` | wild readings, and what goes in their place |
//! | `frozen` | readings that stand for long while all else moves, or the rig would |
//! | `excitation` | commands that never move, a pump that never runs |
//! | `against_model` | swapped pressures and wrong units, told by what the rig would do |
//! | `duties` | swapped and inverted duties, told by which chamber answers, and which way |
//! | `mistaken` | exchanged columns, commands turned round, an atmosphere too much, told by what the rig would do without them |
//! | `trials` | free runs for that, with columns taken for something else |
//! | `ranges` | readings outside what their sensor can tell |
//! | `relay` | pressures that rise while the relays say that every pump is off |
//! | `stood` | a pump that stood while the commands say that it ran |
//! | `expected` | what the rig would read, for those that ask it of all rows |
//! | `unmoved` | pressures that move in a rig that nothing moves |
//! | `counts` | raw counts of a converter |
//! | `counted_rows` | whole seconds that are a count of rows |
//! | `meaning` | units and scales that pressures are found in |
//! | `sign_trials` | signs of pressures that never stand, told by free runs |
//! | `mend` | the key of `[recording]` that says so |
//!
//! A fit to bad recordings does not fail, it names the wrong parameter. So the checks come first, and each says what a
//! person at the rig would: which file, which column, what it looks like, what to do. Rows that cannot be trusted
//! (stuck, clipped, wild) are masked; the rest of their recording is still good.

mod against_model;
mod counted_rows;
mod counts;
mod duties;
mod excitation;
mod expected;
mod finding;
mod frozen;
mod meaning;
mod mend;
mod mistaken;
mod plateau;
mod ranges;
pub(super) mod readings;
mod relay;
mod shape;
mod sign_trials;
mod stood;
mod trials;
mod unmoved;
pub(super) mod wild;

pub use counted_rows::seconds_are_no_count;
pub use finding::{Finding, Severity, Trouble};
pub use ranges::within_ranges;

use model::rig::Rig;
use wild::MOST_TOGETHER;

use super::{Noise, Record, Records};
use crate::FitError;

/// Findings of the checks, and which readings may be used.
#[derive(Debug, Clone, PartialEq)]
pub struct Quality {
    /// Findings, worst first.
    pub findings: Vec<Finding>,
    /// 1 at readings that may be used, 0 at others; of the recordings' layout.
    pub usable: Vec<f64>,
    /// By place in the recordings' layout, whether a reading is wild; empty where none is.
    wild: Vec<bool>,
}

impl Quality {
    /// Checks recordings against each other and against what `rig` would do.
    ///
    /// # Errors
    /// The rig cannot be compiled.
    pub fn of(rig: &Rig, records: &Records, noise: &[Noise]) -> Result<Self, FitError> {
        let mut findings = Vec::new();
        // Rows without a sample are no evidence, whatever stands in them.
        let mut usable = records.measured();
        shape::check(records, &mut findings);
        let readings::Seen { wild: places, smooth } = readings::check(rig, records, noise, &mut usable, &mut findings);
        let mut wild = vec![false; if places.is_empty() { 0 } else { usable.len() }];
        places.into_iter().for_each(|place| wild[place] = true);
        // Nothing that follows begins at a wild reading, or is judged by one.
        let without = (!wild.is_empty()).then(|| records.clone().without_readings(&wild));
        let records = without.as_ref().unwrap_or(records);
        // What hardly lasts hardly moves; that need not be told as well.
        if !findings.iter().any(|f| f.trouble == Trouble::TooShort && f.severity == Severity::Unusable) {
            excitation::check(rig, records, noise, &mut findings);
        }
        unmoved::check(rig, records, noise, &mut findings);
        relay::check(rig, records, noise, &mut findings);
        let sound = |findings: &[Finding]| findings.iter().all(|f| f.severity != Severity::Unusable);
        let expected = expected::Expected::new(rig, records);
        // A sensor at the open air may read the end of its range.
        if findings.iter().all(|f| f.severity != Severity::Unusable || f.trouble == Trouble::Clipped) {
            stood::check(rig, records, noise, &expected, &mut findings);
        }
        // A pump seems to stand as well where its command stands in another's place, or is turned round.
        if findings.iter().any(|f| f.trouble == Trouble::PumpStood) {
            mistaken::instead(rig, records, Trouble::PumpStood, &mut findings);
        }
        // Where the pump stood, or ran unseen, nothing is in another unit.
        if findings.iter().all(|f| !is_of_commands(f.trouble)) {
            let before = findings.len();
            frozen::check_by_model(records, &smooth, &expected, &mut usable, &mut findings);
            // What stands for most of a recording stands where some unit puts it by chance.
            let stands = findings.iter().skip(before).any(|f| f.severity == Severity::Unusable);
            let agreed = if stands { Vec::new() } else { against_model::check(rig, records, &mut findings)? };
            // What the model and the duties tell is the closer word.
            if sound(&findings) {
                ranges::check(rig, records, &agreed, &mut findings);
            }
            // What the rig would do is worth nothing while units or signs are wrong.
            if sound(&findings) {
                plateau::check(rig, records, noise, &expected, &mut usable, &mut findings);
            }
        }
        findings.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
        Ok(Quality { findings, usable, wild })
    }

    /// The recordings as runs go through them, and their quality: straight lines in place of wild readings, which are no evidence, and
    /// no rows before the first that a run can begin at ([`Quality::first_rows`]).
    pub fn sound(self, records: Records) -> (Self, Records) {
        let first_rows = self.first_rows(&records);
        let records = if self.wild.is_empty() { records } else { records.without_readings(&self.wild) };
        if first_rows.iter().all(|first| *first == 0) {
            return (self, records);
        }
        let rows = records.records().iter().map(|r| r.time_s.len());
        let parts: Vec<_> = rows.zip(&first_rows).map(|(rows, first)| *first..rows).enumerate().collect();
        let (records, places) = records.parts(&parts);
        (self.taken(&places), records)
    }

    /// This quality of the readings at some places.
    #[must_use]
    pub fn taken(mut self, places: &[usize]) -> Self {
        self.usable = places.iter().filter_map(|place| self.usable.get(*place)).copied().collect();
        if !self.wild.is_empty() {
            self.wild = places.iter().filter_map(|place| self.wild.get(*place)).copied().collect();
        }
        self
    }

    /// By recording, the first row that a run can begin at: 0, or the first behind wild readings, where these are more than are bridged
    /// and leave more than half of the rows.
    pub fn first_rows(&self, records: &Records) -> Vec<usize> {
        let first = |(record, r): (usize, &Record)| {
            let channels = 0..records.layout().channels();
            let wild = channels.filter_map(|channel| self.wild.get(records.layout().channel(record, channel)));
            let wild: Vec<&[bool]> = wild.collect();
            let is_sound = |row: &usize| wild.iter().all(|wild| !wild.get(*row).copied().unwrap_or(false));
            let rows = r.time_s.len();
            let samples: Vec<usize> = (0..rows).filter(|row| r.is_measured(*row)).collect();
            // A few are bridged by the first sound one: at a command that jumps in the first row it may be the rig itself that is far off.
            let sound_from = samples.iter().position(is_sound).filter(|unsound| *unsound > MOST_TOGETHER);
            sound_from.and_then(|at| samples.get(at)).copied().filter(|first| 2 * first < rows).unwrap_or(0)
        };
        records.records().iter().enumerate().map(first).collect()
    }

    /// Reasons that make the recordings unusable, all in one line; `None` if they can be used. What is wrong with
    /// several recordings in the same way is told of the first, with the number of the others.
    pub fn refusal(&self) -> Option<String> {
        let mut told: Vec<(&Finding, usize)> = Vec::new();
        for finding in self.findings.iter().filter(|f| f.severity == Severity::Unusable) {
            match told.iter_mut().find(|(f, _)| f.trouble == finding.trouble && f.column == finding.column) {
                Some((_, more)) => *more += 1,
                None => told.push((finding, 0)),
            }
        }
        let texts: Vec<String> = told
            .into_iter()
            .map(|(finding, more)| match more {
                0 => finding.to_string(),
                1 => format!("{finding} (and so in 1 more recording)"),
                _ => format!("{finding} (and so in {more} more recordings)"),
            })
            .collect();
        (!texts.is_empty()).then(|| texts.join("; "))
    }

    /// The findings that a result has to be read with.
    pub fn doubts(&self) -> impl Iterator<Item = &Finding> {
        self.findings.iter().filter(|f| f.severity == Severity::Doubtful)
    }

    /// Tells whether something of this kind was found.
    pub fn has(&self, trouble: Trouble) -> bool {
        self.findings.iter().any(|f| f.trouble == trouble)
    }
}

/// Tells whether this is about what was commanded, so that what the rig would do by the recorded commands tells nothing.
fn is_of_commands(trouble: Trouble) -> bool {
    matches!(trouble, Trouble::PumpStood | Trouble::InvertedDuty | Trouble::SwappedDuties)
}

/// The middle one of some numbers, the upper of two; 0 of nothing.
fn median(values: &[f64]) -> f64 {
    let mut values = values.to_vec();
    let middle = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_usable_and_what_is_wild_are_cut_alike() {
        let whole = Quality { findings: Vec::new(), usable: vec![1.0, 0.0, 1.0], wild: vec![false, true, false] };
        let cut = whole.taken(&[1, 2]);
        assert_eq!((cut.usable, cut.wild), (vec![0.0, 1.0], vec![true, false]));
    }
}
