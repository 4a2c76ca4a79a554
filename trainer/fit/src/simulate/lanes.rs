//! One bundle of rigs, each through a chain of arcs of its own.

use std::ops::Range;
use std::sync::Arc as Shared;

use model::plant::{Plant, Simulated, Simulation, UnobservedInitialState};
use proto::recording::PERIOD_S;

use super::arcs::{Flapper, share_of};
use super::chains::Chain;

/// A lane, and what runs in it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lane<'a> {
    /// The stretch that it runs through.
    pub(super) chain: &'a Chain<'a>,
    /// Added to the start of every arc, in kPa, by channel; empty for nothing.
    pub(super) shift_kpa: &'a [f64],
    /// Revolutions by which cranks stand past their zeros at the start.
    pub(super) crank_rev: f64,
    /// Where flappers lie, by the arc's number, where that is not what the arc says; empty for nothing.
    pub(super) flappers: &'a [Vec<Flapper>],
}

impl Lane<'_> {
    /// A command, counted from the chain's first row; the last one where it has ended.
    fn command(&self, input: usize, row: usize) -> f64 {
        let rows = self.chain.rows();
        let row = (rows.start + row).min(rows.end.saturating_sub(1));
        self.chain.columns.inputs.get(input).and_then(|column| column.get(row)).copied().unwrap_or(0.0)
    }

    /// Rows of commands before its start.
    fn rows_before(&self) -> usize {
        self.chain.columns.before.rows() + self.chain.rows().start
    }

    /// A command `rows` before its start (1 is the row before it), and 1; 0 and 0 where there was none.
    fn command_before(&self, input: usize, rows: usize) -> [f64; 2] {
        let columns = self.chain.columns;
        let start = self.chain.rows().start;
        let sent = match start.checked_sub(rows) {
            Some(row) => columns.inputs.get(input).and_then(|column| column.get(row)).copied(),
            None => {
                (columns.before.rows() + start).checked_sub(rows).and_then(|row| columns.before.command(input, row))
            }
        };
        sent.map_or([0.0, 0.0], |sent| [sent, 1.0])
    }

    /// The reading of a channel `rows` before its start, in kPa; that of its start where there is none.
    fn reading_before(&self, channel: usize, rows: usize) -> f64 {
        let before = self.chain.columns.before.reading_kpa(channel, rows);
        before.unwrap_or_else(|| self.start_kpa(0, channel))
    }

    /// The reading that one of its arcs starts from, in kPa; any where it has ended.
    fn start_kpa(&self, arc: usize, channel: usize) -> f64 {
        let arcs = self.chain.arcs();
        arcs.get(arc).or(arcs.last()).and_then(|(_, arc)| arc.start_kpa.get(channel)).copied().unwrap_or(f64::NAN)
    }

    /// Share that an unknown has at the start, if the lane or its arc says so.
    fn share(&self, unknown: &UnobservedInitialState) -> Option<f64> {
        let (number, arc) = self.chain.arcs().first()?;
        let own = self.flappers.get(*number).and_then(|flappers| share_of(flappers, &unknown.name));
        own.or_else(|| share_of(&arc.flappers, &unknown.name))
    }
}

/// The rows of a bundle's longest chain, which its other lanes are the beginnings of.
pub(super) fn span(lanes: &[Lane<'_>]) -> usize {
    lanes.iter().map(|lane| lane.chain.rows().len()).max().unwrap_or(0)
}

/// Runs a bundle, one lane per rig and chain; lanes beyond the last repeat it. All chains are of one kind
/// ([`super::chains::kinds`]).
///
/// `smooth` leaves the ripple of averaged pumps off. What is read comes out as `[channel][row]`, flattened, rows counted from the
/// chains' first; rows in no arc are not written.
pub(super) fn sweep<R: Simulated>(
    plant: &Shared<Plant<R>>,
    smooth: bool,
    ticks_per_row: u32,
    lanes: &[Lane<'_>],
) -> Vec<R> {
    let channels = plant.sensor_columns().len();
    let rows = span(lanes);
    let mut out = vec![R::splat(f64::NAN); channels * rows];
    let Some(longest) = lanes.iter().max_by_key(|lane| lane.chain.rows().len()) else { return out };
    let each = |number: &dyn Fn(&Lane<'_>) -> f64| {
        R::from_lanes(|lane| lanes.get(lane).or(lanes.last()).map_or(f64::NAN, number))
    };
    let sensors: Vec<usize> = (0..channels).collect();
    let mut simulation = Simulation::new(Shared::clone(plant));
    if smooth {
        simulation = simulation.smooth();
    }
    let unknowns: Vec<UnobservedInitialState> = simulation.unknowns().cloned().collect();
    let mut commands = vec![R::splat(0.0); plant.inputs().len()];
    let read = |row: usize, commands: &mut [R]| {
        for (input, slot) in commands.iter_mut().enumerate() {
            *slot = each(&|lane| lane.command(input, row));
        }
    };
    let first = longest.chain.rows().start;
    for (index, (_, arc)) in longest.chain.arcs().iter().enumerate() {
        let relative: Range<usize> = arc.rows.start - first..arc.rows.end - first;
        let recorded: Vec<R> = (0..channels).map(|c| each(&|lane| lane.start_kpa(index, c))).collect();
        let shift = |c: usize| each(&|lane| lane.shift_kpa.get(c).copied().unwrap_or(0.0));
        let start: Vec<R> = recorded.iter().enumerate().map(|(c, kpa)| *kpa + shift(c)).collect();
        read(relative.start, &mut commands);
        if arc.fresh {
            // Asked of the recorded pressures, not of the shifted ones: all runs must start alike.
            let how = simulation.start_for(&recorded);
            let crank_rev = each(&|lane| lane.crank_rev);
            let elapsed_s = longest.chain.elapsed_s();
            // Gas is as warm as what went before has made it; everything else is as the first row tells.
            let led = if simulation.has_gas_that_warms() { longest.chain.led_rows() } else { 0 };
            let warm = (led > 0).then(|| {
                let from: Vec<R> = (0..channels).map(|c| each(&|lane| lane.reading_before(c, led))).collect();
                let read_before = |rows: usize, sent: &mut [R]| {
                    for (input, slot) in sent.iter_mut().enumerate() {
                        *slot = each(&|lane| lane.command_before(input, rows)[0]);
                    }
                };
                let mut sent = commands.clone();
                read_before(led, &mut sent);
                let begins = simulation.start_for(&from);
                simulation.start_at(&from, &sent, begins, crank_rev, elapsed_s - led as f64 * PERIOD_S);
                for rows in (1..=led).rev() {
                    read_before(rows, &mut sent);
                    for _ in 0..ticks_per_row {
                        simulation.tick(&sent);
                    }
                }
                simulation.gas_temperatures_k()
            });
            simulation.start_at(&start, &commands, how, crank_rev, elapsed_s);
            if let Some(warm) = warm {
                simulation.set_gas_temperatures_k(&warm);
            }
            let before = lanes.iter().map(Lane::rows_before).max().unwrap_or(0);
            if before > 0 && simulation.has_coils_that_warm() {
                let ticks = ticks_per_row as usize;
                let ago = |tick: usize| before - tick / ticks;
                simulation.warm_coils(
                    before * ticks,
                    &|input, tick| each(&|lane| lane.command_before(input, ago(tick))[0]),
                    &|tick| each(&|lane| lane.command_before(0, ago(tick))[1]),
                );
            }
            for (slot, unknown) in unknowns.iter().enumerate() {
                if lanes.iter().any(|lane| lane.share(unknown).is_some()) {
                    simulation.set_unknown(slot, each(&|lane| lane.share(unknown).unwrap_or(unknown.usual)));
                }
            }
        } else {
            simulation.correct(&sensors, &start);
        }
        for row in relative {
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
    out
}
