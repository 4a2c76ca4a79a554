//! Errors of a free run: mean squares by channel, by recording, at work.

use std::ops::Range;

use fit::data::Role;

use super::Bench;

/// Rows of a short stretch: 2 s.
const SHORT_ROWS: usize = 100;

impl Bench<'_> {
    /// Mean square of what a trace is off on the rows of a role, channels together, in kPa².
    pub fn squares(&self, trace: &[f64], role: Role) -> f64 {
        let layout = self.records.layout();
        let weights = self.split.weights(layout, role);
        let off = trace.iter().zip(self.records.readings_kpa()).zip(weights.iter().zip(&self.counted));
        let counts = off.filter(|(_, (w, counted))| **w != 0.0 && **counted != 0.0);
        let (sum, rows) = counts.fold((0.0, 0.0), |(sum, rows), ((p, r), _)| (sum + (p - r).powi(2), rows + 1.0));
        sum / f64::max(rows, 1.0)
    }

    /// Error of a trace on validation data, channels together: root mean square in kPa on the rows kept back, or on all where none
    /// are.
    pub fn validation_kpa(&self, trace: &[f64]) -> f64 {
        let roles = if self.split.rows(Role::HeldOut) > 0 { &[Role::HeldOut][..] } else { &[Role::Fit, Role::Select] };
        let rows: Vec<f64> = roles.iter().map(|role| self.split.rows(*role) as f64).collect();
        let sum: f64 = roles.iter().zip(&rows).map(|(role, rows)| rows * self.squares(trace, *role)).sum();
        (sum / rows.iter().sum::<f64>().max(1.0)).sqrt()
    }

    /// Mean square of what a trace is off by channel on the rows that are fitted or choose, in kPa²; `in_the_middle`, that of the
    /// middle one of all stretches of 2 s.
    pub fn squares_by_channel(&self, trace: &[f64], in_the_middle: bool) -> Vec<f64> {
        let of_channel = |channel: usize| {
            let all = self.squares_of_those(trace, channel, |_| true);
            if in_the_middle {
                let mut means: Vec<f64> = all.iter().map(|(sum, rows)| sum / rows).collect();
                means.sort_by(f64::total_cmp);
                means.get(means.len() / 2).copied().unwrap_or(0.0)
            } else {
                mean_of(&all)
            }
        };
        (0..self.records.layout().channels()).map(of_channel).collect()
    }

    /// Root mean square difference of two traces over some recordings, in the pressure where it is largest, in kPa.
    pub fn most_moved_kpa(&self, one: &[f64], other: &[f64], recordings: Range<usize>) -> f64 {
        let layout = self.records.layout();
        let off = |i: usize| one.get(i).zip(other.get(i)).map_or(0.0, |(a, b)| (a - b).powi(2));
        let of = |channel: usize| {
            let rows = || recordings.clone().flat_map(|record| layout.channel(record, channel));
            (rows().map(off).sum::<f64>() / rows().count().max(1) as f64).sqrt()
        };
        (0..layout.channels()).map(of).fold(0.0, f64::max)
    }

    /// Tells whether all pumps run throughout a recording, or a piece of one.
    pub fn pumps_run(&self, record: usize) -> bool {
        self.records.relays(self.rig, record).iter().flatten().all(|on| *on)
    }

    /// Mean square of what a trace is off by, all channels added up, in kPa², on the rows that are fitted or choose, of the recordings
    /// and pieces in which all pumps run; of all of them where there are none.
    pub fn squares_at_work(&self, trace: &[f64]) -> f64 {
        let runs: Vec<bool> = (0..self.records.records().len()).map(|record| self.pumps_run(record)).collect();
        let none = runs.iter().all(|runs| !runs);
        self.mean_squares_of(trace, |record| none || runs.get(record) == Some(&true))
    }

    /// Mean square of what a trace is off by, all channels added up, in kPa², on the rows that are fitted or choose: of each recording by
    /// itself, pieces of one together.
    pub fn squares_by_recording(&self, trace: &[f64]) -> Vec<f64> {
        let records = self.records.records();
        let mut sources: Vec<&str> = records.iter().map(|record| record.source.as_str()).collect();
        sources.dedup();
        let is_of = |source: &str, record: usize| records.get(record).is_some_and(|record| record.source == source);
        sources.into_iter().map(|source| self.mean_squares_of(trace, |record| is_of(source, record))).collect()
    }

    /// Mean square of what a trace is off by in some recordings, all channels added up.
    fn mean_squares_of(&self, trace: &[f64], asked: impl Fn(usize) -> bool) -> f64 {
        let channels = 0..self.records.layout().channels();
        channels.map(|channel| mean_of(&self.squares_of_those(trace, channel, &asked))).sum()
    }

    /// Sum of squares of what a trace is off in a channel, and readings that count, for every stretch of 2 s of the rows of some
    /// recordings that are fitted or choose.
    fn squares_of_those(&self, trace: &[f64], channel: usize, asked: impl Fn(usize) -> bool) -> Vec<(f64, f64)> {
        let layout = self.records.layout();
        let known = self.split.stretches().iter().filter(|s| s.role != Role::HeldOut && asked(s.record));
        let pieces = known.flat_map(|s| {
            s.rows.clone().step_by(SHORT_ROWS).map(|from| (s.record, from..s.rows.end.min(from + SHORT_ROWS)))
        });
        let squares = |(record, rows): (usize, Range<usize>)| -> (f64, f64) {
            let of = |values: &[f64], i: usize| values.get(i).copied().unwrap_or(0.0);
            let counted = layout.stretch(record, channel, rows).filter(|i| of(&self.counted, *i) != 0.0);
            let off = counted.map(|i| of(trace, i) - of(self.records.readings_kpa(), i));
            off.fold((0.0, 0.0), |(sum, rows), off| (sum + off * off, rows + 1.0))
        };
        pieces.map(squares).filter(|(_, rows)| *rows > 0.0).collect()
    }
}

/// Mean of squares that are told as sums and their rows.
fn mean_of(stretches: &[(f64, f64)]) -> f64 {
    let (sum, rows) = stretches.iter().fold((0.0, 0.0), |(sum, rows), (s, r)| (sum + s, rows + r));
    sum / f64::max(rows, 1.0)
}
