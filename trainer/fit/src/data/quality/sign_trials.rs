//! Signs of pressures, told by free runs.
//!
//! A rig that goes up and down all the time, as one that breathes, stands nowhere long enough to say on which side of the atmosphere. It
//! follows its recording all the same where the numbers are taken for what they are. Units are not asked for in this way: a pump that
//! delivers eight times what the rig file says looks the same.

use model::rig::Rig;

use super::meaning::Meaning;
use super::mend::pressure_key;
use super::mistaken::{LEAST_OFF, MUCH_BETTER, not_followed};
use super::trials::{Taken, tried};
use super::{Finding, Severity, Trouble, median};
use crate::data::Records;

/// Share of what pressures move through that a rig is off at most where it follows numbers of another sign.
const FOLLOWS: f64 = 0.1;

/// Adds what free runs tell of the signs of sensors that nothing else tells.
pub(super) fn check(rig: &Rig, records: &Records, findings: &mut Vec<Finding>) {
    let told = not_followed(rig, records).into_iter();
    told.for_each(|record| findings.extend(found(rig, records, record)));
}

/// Tells of the sensors of one recording; of nothing where no sign explains them.
fn found(rig: &Rig, records: &Records, record: usize) -> Vec<Finding> {
    let everywhere: Vec<usize> = (0..records.sensors().len()).collect();
    let together = (everywhere.len() > 1).then(|| everywhere.clone());
    let sets: Vec<Vec<usize>> = together.into_iter().chain(everywhere.iter().map(|channel| vec![*channel])).collect();
    let taken = sets.iter().map(|set| Taken::SensorsMeant(set.clone(), Meaning::Unsigned));
    let trials: Vec<Taken> = std::iter::once(Taken::AsItStands).chain(taken).collect();
    let outcomes = tried(rig, records, record, &trials).unwrap_or_default();
    let Some((as_it_stands, outcomes)) = outcomes.split_first() else { return Vec::new() };
    // All together come first: what explains all of them is one fault.
    let explained = sets.iter().zip(outcomes).filter(|(set, outcome)| {
        let (before, off) = (as_it_stands.off(set), outcome.off(set));
        before > LEAST_OFF && off < FOLLOWS && off < MUCH_BETTER * before
    });
    let mut channels: Vec<usize> = explained.flat_map(|(set, _)| set).copied().collect();
    if channels.starts_with(&everywhere) {
        channels.truncate(everywhere.len());
    }
    channels.into_iter().filter_map(|channel| told(rig, records, record, channel)).collect()
}

/// The complaint about a channel of a recording.
fn told(rig: &Rig, records: &Records, record: usize, channel: usize) -> Option<Finding> {
    let column = records.sensors().get(channel)?;
    let of = records.records().get(record)?;
    let sensor = rig.sensor_of(column).map(|(_, sensor)| sensor);
    let expected_kpa = -median(records.channel_kpa(record, channel));
    let is = Meaning::Unsigned.words(sensor, expected_kpa, rig.atmosphere.pressure_kpa_abs);
    let key = pressure_key(rig, column, Meaning::Unsigned, of.file_unit(column));
    Some(Finding {
        source: of.source.clone(),
        column: column.clone(),
        severity: Severity::Unusable,
        trouble: Trouble::WrongUnit,
        text: format!("{is}: that is what the rig would do, and as it stands it is not: {key}"),
    })
}
