//! Programmes in which a vent passes backwards.
//!
//! A leak takes a chamber beyond the air while the pump stands, and its open vent lets the difference out the other way. No
//! recording of a running pump shows how wide a vent is backwards: a flapper that the flow pushes shut is not the nozzle that it
//! leaves open. A rival's prediction there rests on nothing, and what is recorded there would be taken for something missing.

use fit::data::Records;
use fit::simulate::{Arcs, Simulator};
use model::rig::{ATMOSPHERE, Rig};

use crate::bench::Explanation;
use crate::error::DiagnoseError;
use crate::search::candidate::reads_wrong;

/// Pressure beyond the air that a chamber may have with its vent open, in kPa: at less hardly anything passes.
const BEYOND_KPA: f64 = 0.05;

/// Tells which of the programmes (one a recording of the simulator) take a chamber beyond the air with its vent open, by some rival.
///
/// `predicted_kpa` are their free runs; those of rivals whose sensors read wrong are run again without that.
///
/// # Errors
/// A rival cannot be simulated.
pub(super) fn backwards(
    simulator: &Simulator<'_>,
    rivals: &[&Explanation],
    predicted_kpa: &[&[f64]],
) -> Result<Vec<bool>, DiagnoseError> {
    let records = simulator.records();
    let mut found = vec![false; records.records().len()];
    for (rival, predicted) in rivals.iter().zip(predicted_kpa) {
        let mut rig = rival.fitted.rig.clone();
        let all = rig.mechanisms.len();
        rig.mechanisms.retain(|m| !reads_wrong(m.mechanism.id()));
        let right = if rig.mechanisms.len() == all { None } else { Some(simulator.one(&rig, &Arcs::free(records))?) };
        let trace = right.as_deref().unwrap_or(predicted);
        for (programme, found) in found.iter_mut().enumerate() {
            *found |= passes_backwards(&rig, records, programme, trace);
        }
    }
    Ok(found)
}

/// Tells whether a vent of the rig is commanded open in some row of a programme while its chamber is beyond the air.
fn passes_backwards(rig: &Rig, records: &Records, programme: usize, trace_kpa: &[f64]) -> bool {
    let column = |name: &str| records.inputs().iter().position(|input| input.column == name);
    let channel = |volume: &str| {
        let sensors = rig.sensors.values().filter(|sensor| sensor.volume == volume);
        sensors.filter_map(|sensor| records.sensors().iter().position(|name| *name == sensor.column)).next()
    };
    rig.valves.values().any(|valve| {
        let (volume, sign) = match (valve.from.as_str(), valve.to.as_str()) {
            (volume, ATMOSPHERE) => (volume, -1.0),
            (ATMOSPHERE, volume) => (volume, 1.0),
            _ => return false,
        };
        let (Some(input), Some(channel)) = (column(&valve.command), channel(volume)) else { return false };
        let commands = records.records().get(programme).and_then(|record| record.inputs.get(input));
        let readings = trace_kpa.get(records.layout().channel(programme, channel)).unwrap_or_default();
        commands
            .is_some_and(|duties| duties.iter().zip(readings).any(|(duty, kpa)| *duty > 0.0 && sign * kpa > BEYOND_KPA))
    })
}
