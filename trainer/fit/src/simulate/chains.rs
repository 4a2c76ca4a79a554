//! Stretches of recordings that can lie side by side in the lanes of one simulation.
//!
//! What follows from one fresh start is a chain: an arc, and those after it that only set the pressures anew. Nothing else
//! passes from one chain to another, so chains of different recordings may run beside each other as rigs do, if they begin
//! alike and are set anew at the same rows. Free runs of several recordings do, and so do windows of one length.

use std::ops::Range;

use model::plant::FreeRunStart;

use super::arcs::{Arc, Arcs};
use crate::data::{Record, Records};

/// The most rows that lead to a start: 10 s. Gas in the paper's tank of 0.75 L forgets how warm it was in 2 s with a wall that takes 1 W/K
/// (`m c_v / h`, 1.7 g at 180 kPa).
const LED_ROWS: usize = 500;

/// Arcs of one recording that follow from one fresh start.
#[derive(Debug, Clone)]
pub(super) struct Chain<'a> {
    /// Index of the recording.
    pub(super) record: usize,
    /// Commands and times.
    pub(super) columns: &'a Record,
    /// The arcs with their numbers among all, in order; never empty.
    arcs: Vec<(usize, &'a Arc)>,
}

impl<'a> Chain<'a> {
    /// All chains of some recordings.
    pub(super) fn all(records: &'a Records, arcs: &'a Arcs) -> Vec<Chain<'a>> {
        let mut chains: Vec<Chain<'a>> = Vec::new();
        for (record, columns) in records.records().iter().enumerate() {
            let mut chain: Option<Chain<'a>> = None;
            for (number, arc) in arcs.numbered(record) {
                match &mut chain {
                    Some(chain) if !arc.fresh => chain.arcs.push((number, arc)),
                    _ => {
                        let next = Chain { record, columns, arcs: vec![(number, arc)] };
                        chains.extend(chain.replace(next));
                    }
                }
            }
            chains.extend(chain);
        }
        chains
    }

    /// Arcs of the chain with their numbers among all.
    pub(super) fn arcs(&self) -> &[(usize, &'a Arc)] {
        &self.arcs
    }

    /// The rows from the first of its first arc to the last of its last one.
    pub(super) fn rows(&self) -> Range<usize> {
        let first = self.arcs.first().map_or(0, |(_, arc)| arc.rows.start);
        first..self.arcs.last().map_or(first, |(_, arc)| arc.rows.end)
    }

    /// Seconds from the recording's beginning to its start.
    pub(super) fn elapsed_s(&self) -> f64 {
        self.columns.elapsed_s(self.rows().start)
    }

    /// Rows of the recording that lead to its start without a gap, and are run through for what no sensor shows: all, but not more
    /// than warm gas remembers.
    pub(super) fn led_rows(&self) -> usize {
        if self.rows().start == 0 { self.columns.before.leading().min(LED_ROWS) } else { 0 }
    }

    /// Start of the chain: everything anew, or pressures alone; at rest or running, here and where its lead begins; and when.
    fn start(&self) -> Option<(bool, [FreeRunStart; 2], usize, u64)> {
        let (_, first) = self.arcs.first()?;
        let led = self.led_rows();
        let before = |channel| self.columns.before.reading_kpa(channel, led);
        let leads: Vec<f64> =
            if led == 0 { Vec::new() } else { (0..first.start_kpa.len()).filter_map(before).collect() };
        let how = [FreeRunStart::for_readings(&first.start_kpa), FreeRunStart::for_readings(&leads)];
        Some((first.fresh, how, led, self.elapsed_s().to_bits()))
    }

    /// Tells whether it can lie beside a `longer` one.
    fn fits_beside(&self, longer: &Chain<'_>) -> bool {
        let relative = |chain: &Chain<'_>, index: usize| {
            let first = chain.rows().start;
            chain.arcs.get(index).map(|(_, arc)| arc.rows.start - first..arc.rows.end - first)
        };
        let last = self.arcs.len().saturating_sub(1);
        self.start() == longer.start()
            && (0..self.arcs.len()).all(|index| match (relative(self, index), relative(longer, index)) {
                (Some(own), Some(other)) if index == last => own.start == other.start && own.end <= other.end,
                (own, other) => own.is_some() && own == other,
            })
    }
}

/// Chains sorted into kinds that can lie side by side, the longest first in each.
pub(super) fn kinds(chains: &[Chain<'_>]) -> Vec<Vec<usize>> {
    let length = |index: &usize| chains.get(*index).map_or(0, |chain| chain.rows().len());
    let mut order: Vec<usize> = (0..chains.len()).collect();
    order.sort_by_key(|index| std::cmp::Reverse(length(index)));
    let mut kinds: Vec<Vec<usize>> = Vec::new();
    for index in order {
        let Some(chain) = chains.get(index) else { continue };
        // What fits beside the longest fits beside all: each is the beginning of it.
        let longest = |kind: &Vec<usize>| kind.first().and_then(|first| chains.get(*first));
        match kinds.iter_mut().find(|kind| longest(kind).is_some_and(|longest| chain.fits_beside(longest))) {
            Some(kind) => kind.push(index),
            None => kinds.push(vec![index]),
        }
    }
    kinds
}
