//! Where simulations start: once per recording, or anew in every window.
//!
//! An arc is a run of rows simulated from a start of its own; the commands alone decide the rest of it. One arc per
//! segment is a free run, arcs of 0.5 s are multiple shooting (Bock 1981: shorter arcs forget a wrong parameter
//! before it has driven the simulation out of reach of a linear step), arcs of 1 s and 10 s measure how fast a
//! model goes astray. Within a segment only the chamber pressures start anew; what no sensor shows (cylinders, crank
//! angle, memories of mechanisms) is carried on from the arc before.

use std::ops::Range;

use crate::data::Records;

/// Rows simulated from one start.
#[derive(Debug, Clone, PartialEq)]
pub struct Arc {
    /// Index of the recording.
    pub record: usize,
    /// Rows of the arc.
    pub rows: Range<usize>,
    /// The readings it starts from, in gauge kPa, by channel.
    pub start_kpa: Vec<f64>,
    /// True where everything starts anew (at a segment's first row), false where the chamber pressures alone do.
    pub fresh: bool,
    /// Where flappers lie at a fresh start; what is not listed starts as usual.
    pub flappers: Vec<Flapper>,
}

/// Where a flapper with play or friction lies at the start of a run: the readings do not tell.
#[derive(Debug, Clone, PartialEq)]
pub struct Flapper {
    /// Name of the unknown ([`model::plant::UnobservedInitialState`]): `play:valve_pos`, `stick:valve_pos`.
    pub unknown: String,
    /// Share of the room that it has, −1 … 1.
    pub share: f64,
}

/// The share that a list has for an unknown.
pub(crate) fn share_of(flappers: &[Flapper], unknown: &str) -> Option<f64> {
    flappers.iter().find(|flapper| flapper.unknown == unknown).map(|flapper| flapper.share)
}

/// Arcs in the order of recordings and rows; they do not overlap.
#[derive(Debug, Clone, PartialEq)]
pub struct Arcs {
    arcs: Vec<Arc>,
}

impl Arcs {
    /// One arc per segment, each from the first row's readings: free runs.
    pub fn free(records: &Records) -> Self {
        let mut arcs = Vec::new();
        for (record, r) in records.records().iter().enumerate() {
            for rows in &r.segments {
                let start_kpa = at(records, record, rows.start);
                arcs.push(Arc { record, rows: rows.clone(), start_kpa, fresh: true, flappers: Vec::new() });
            }
        }
        Arcs { arcs }
    }

    /// Free runs behind leads ([`crate::data::Record::lead_rows`]): after its lead a segment's pressures start anew, and a late valve is
    /// where its commands have put it.
    pub fn led(records: &Records) -> Self {
        let mut arcs = Vec::new();
        for arc in Self::free(records).arcs {
            let lead = records.records().get(arc.record).map_or(0, |record| record.lead_rows(arc.rows.start));
            let behind = arc.rows.start + lead;
            if lead > 0 {
                let start_kpa = at(records, arc.record, behind);
                let rest = Arc { rows: behind..arc.rows.end, start_kpa, fresh: false, ..arc.clone() };
                arcs.extend([Arc { rows: arc.rows.start..behind, ..arc }, rest]);
            } else {
                arcs.push(arc);
            }
        }
        Arcs { arcs }
    }

    /// Windows of `rows` rows, each from `smoothed_kpa` (a vector of the recordings' layout) at its first row.
    ///
    /// A remainder shorter than half a window joins the one before.
    pub fn windows(records: &Records, rows: usize, smoothed_kpa: &[f64]) -> Self {
        let layout = records.layout();
        let mut arcs = Vec::new();
        for (record, r) in records.records().iter().enumerate() {
            for segment in &r.segments {
                let count = ((segment.len() as f64 / rows.max(1) as f64).round() as usize).max(1);
                for window in 0..count {
                    let start = segment.start + window * rows;
                    let end = if window + 1 == count { segment.end } else { start + rows };
                    let start_kpa = (0..layout.channels())
                        .map(|channel| {
                            let index = layout.channel(record, channel).start + start;
                            smoothed_kpa.get(index).copied().unwrap_or(f64::NAN)
                        })
                        .collect();
                    let rows = start..end;
                    arcs.push(Arc { record, rows, start_kpa, fresh: window == 0, flappers: Vec::new() });
                }
            }
        }
        Arcs { arcs }
    }

    /// Arcs made by hand, in the order of recordings and rows, not overlapping.
    pub fn from_arcs(arcs: Vec<Arc>) -> Self {
        Arcs { arcs }
    }

    /// These arcs, those that start at or after `end[record]` left out and the last ones cut there: rows that nothing
    /// is asked of cost no time.
    #[must_use]
    pub fn until(mut self, end: &[usize]) -> Self {
        let end_of = |arc: &Arc| end.get(arc.record).copied().unwrap_or(usize::MAX);
        self.arcs.retain(|arc| arc.rows.start < end_of(arc));
        for arc in &mut self.arcs {
            arc.rows.end = arc.rows.end.min(end_of(arc));
        }
        self
    }

    /// These arcs with flappers where they lie in `other` at the starts that both have.
    #[must_use]
    pub fn with_flappers_of(mut self, other: &Arcs) -> Self {
        for arc in &mut self.arcs {
            let like = other.arcs.iter().find(|like| like.record == arc.record && like.rows.start == arc.rows.start);
            if let Some(like) = like {
                arc.flappers.clone_from(&like.flappers);
            }
        }
        self
    }

    /// The arcs, in order.
    pub fn arcs(&self) -> &[Arc] {
        &self.arcs
    }

    /// The arcs, to move their starts.
    pub fn arcs_mut(&mut self) -> &mut [Arc] {
        &mut self.arcs
    }

    /// Rows from the start of an arc to where everything starts anew; none of an arc that does not start so itself.
    pub(crate) fn chained(&self, number: usize) -> Range<usize> {
        let Some(first) = self.arcs.get(number).filter(|arc| arc.fresh) else { return 0..0 };
        let behind = self.arcs.iter().skip(number + 1).take_while(|arc| arc.record == first.record && !arc.fresh);
        first.rows.start..behind.last().unwrap_or(first).rows.end
    }

    /// The arcs of one recording.
    pub(crate) fn of(&self, record: usize) -> impl Iterator<Item = &Arc> + Clone {
        self.numbered(record).map(|(_, arc)| arc)
    }

    /// The arcs of one recording with their numbers among all.
    pub(crate) fn numbered(&self, record: usize) -> impl Iterator<Item = (usize, &Arc)> + Clone {
        self.arcs.iter().enumerate().filter(move |(_, arc)| arc.record == record)
    }
}

/// The readings of one row.
fn at(records: &Records, record: usize, row: usize) -> Vec<f64> {
    (0..records.layout().channels())
        .map(|channel| records.channel_kpa(record, channel).get(row).copied().unwrap_or(f64::NAN))
        .collect()
}
