//! Readings that the rig would have under the recorded commands, for checks that ask for all rows. Run when first asked for: most
//! recordings give no cause.

use std::cell::OnceCell;

use model::rig::Rig;

use crate::data::Records;
use crate::simulate::{Arc, Arcs, Fidelity, Simulator};

/// Readings of the rig as given, from each recording's first readings on.
pub(super) struct Expected<'a> {
    rig: &'a Rig,
    records: &'a Records,
    trace: OnceCell<Option<Vec<f64>>>,
}

impl<'a> Expected<'a> {
    pub(super) fn new(rig: &'a Rig, records: &'a Records) -> Self {
        Expected { rig, records, trace: OnceCell::new() }
    }

    /// Readings of a channel by row, in gauge kPa; `None` of a rig that cannot be run, which is for others to say.
    pub(super) fn channel_kpa(&self, record: usize, channel: usize) -> Option<&[f64]> {
        let run = || {
            let simulator = Simulator::new(self.records, Fidelity::Coarse);
            simulator.one(self.rig, &Arcs::free(self.records)).ok()
        };
        self.trace.get_or_init(run).as_ref()?.get(self.records.layout().channel(record, channel))
    }
}

/// Least and most of a vector's readings by channel over the rows of an arc.
pub(super) fn extremes(records: &Records, arc: &Arc, vector: &[f64]) -> Vec<[f64; 2]> {
    let of = |channel: usize| {
        let part = records.layout().stretch(arc.record, channel, arc.rows.clone());
        let finite = vector.get(part).unwrap_or_default().iter().copied().filter(|value| value.is_finite());
        finite.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| [low.min(value), high.max(value)])
    };
    (0..records.layout().channels()).map(of).collect()
}
