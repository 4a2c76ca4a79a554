//! One bundle of rigs through one recording.

use std::sync::Arc as Shared;

use model::plant::{Plant, Simulated, Simulation, Unknown};

use super::arcs::Arc;
use crate::data::Record;

/// Runs a bundle through the arcs of one recording.
///
/// `shift_kpa` is added to the start of every arc, by channel; cranks start `crank_rev` revolutions on; `smooth` leaves
/// the ripple of averaged pumps off; `share` tells where flappers lie at the start of an arc. `out` is `[channel][row]`, flattened; rows in no arc are left as they are.
#[expect(clippy::too_many_arguments, reason = "a bundle, a recording, and how it starts")]
pub(super) fn sweep<'a, R: Simulated>(
    plant: &Shared<Plant<R>>,
    smooth: bool,
    ticks_per_row: u32,
    record: &Record,
    arcs: impl Iterator<Item = (usize, &'a Arc)>,
    shift_kpa: &[R],
    crank_rev: R,
    share: &dyn Fn(usize, &Arc, &Unknown) -> Option<R>,
    out: &mut [R],
) {
    let rows = record.time_s.len();
    let sensors: Vec<usize> = (0..plant.sensor_columns().len()).collect();
    let mut simulation = Simulation::new(Shared::clone(plant));
    if smooth {
        simulation = simulation.smooth();
    }
    let unknowns: Vec<Unknown> = simulation.unknowns().cloned().collect();
    let mut commands = vec![R::splat(0.0); record.inputs.len()];
    let mut start = vec![R::splat(0.0); sensors.len()];
    let read = |row: usize, commands: &mut [R]| {
        for (slot, column) in commands.iter_mut().zip(&record.inputs) {
            *slot = R::splat(column.get(row).copied().unwrap_or(0.0));
        }
    };
    for (number, arc) in arcs {
        for ((slot, kpa), shift) in start.iter_mut().zip(&arc.start_kpa).zip(shift_kpa) {
            *slot = R::splat(*kpa) + *shift;
        }
        read(arc.rows.start, &mut commands);
        if arc.fresh {
            // Asked of the recorded pressures, not of the shifted ones: all runs must start alike.
            let recorded: Vec<R> = arc.start_kpa.iter().map(|kpa| R::splat(*kpa)).collect();
            let how = simulation.start_for(&recorded);
            simulation.start_at(&start, &commands, how, crank_rev, record.elapsed_s(arc.rows.start));
            for (index, unknown) in unknowns.iter().enumerate() {
                if let Some(share) = share(number, arc, unknown) {
                    simulation.set_unknown(index, share);
                }
            }
        } else {
            simulation.correct(&sensors, &start);
        }
        for row in arc.rows.clone() {
            for (channel, reading) in simulation.readings_kpa().enumerate() {
                if let Some(slot) = out.get_mut(channel * rows + row) {
                    *slot = reading;
                }
            }
            read(row, &mut commands);
            for _ in 0..ticks_per_row {
                simulation.tick(&commands);
            }
        }
    }
}
