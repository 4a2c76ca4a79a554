//! A rig's model let loose on a recording: it starts at the first row's pressures, then only the commands count.
//!
//! Row k holds the reading at t_k and the commands from t_k to t_{k+1}, so row k of the free run is read
//! before the commands of row k act. A gap in the recording starts the run anew at its next row. Time is
//! the rig's: 20 ms from row to row, whatever jitter stands in `time_s`.
//!
//! What recordings do not tell is guessed in one place, [`Simulation::start_from`]: cylinders at atmospheric
//! pressure where the first row is, periodic ones otherwise; commands as if the first row's had long been
//! in force. Where the flappers of valves with play or friction lay may be told by the caller ([`Began`]); where it is not,
//! they lie where the first pressures would hold, as near to that as the first commands allow: a rig that is recorded has
//! mostly settled under some command before.

pub mod refine;

use std::cell::OnceCell;
use std::ops::ControlFlow;
use std::sync::Arc;

use fit::simulate::{Flapper, Room, rooms};
use model::plant::{FreeRunStart, Plant, Simulation};
use model::predict::DualPressurePorts;
use model::rig::{Rig, RigError};
use model::steady::SteadyMap;
use proto::recording::{PERIOD_S, Recording, RecordingError};

/// A compiled rig that runs freely over recordings.
#[derive(Debug)]
pub struct FreeRun {
    simulation: Simulation<f64>,
    ticks_per_row: u32,
    /// Valves of the paper's rig whose flappers have room to lie anywhere in, each with its channel.
    rooms: Vec<(usize, Room)>,
    rig: Rig,
    /// Which duties hold which pressures, made when it is first asked; nothing where a rig of another kind has no such map.
    steady: OnceCell<Option<SteadyMap>>,
}

/// Result of a free run.
#[derive(Debug)]
pub struct Trace {
    /// Simulated readings in gauge kPa: one column per sensor of the rig, one number per row.
    pub readings_kpa: Vec<Vec<f64>>,
    /// Start of the first stretch.
    pub start: FreeRunStart,
    /// True where the recording had pressures to start from.
    pub pressures_given: bool,
}

/// Where flappers lay at the first row of each stretch of a recording; empty where nothing is known of it.
pub type Began = Vec<Vec<Flapper>>;

/// Reason why a recording cannot be run.
#[derive(Debug, thiserror::Error)]
pub enum FreeRunError {
    /// A column that the rig asks for is missing or is text.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The caller broke the run off.
    #[error("the simulation was stopped")]
    Stopped,
    /// Nothing tells where the rig was behind a gap.
    #[error(
        "{file}: a gap before {time_s} s and no pressures to start from again; add column {column} or close the gap"
    )]
    GapWithoutPressures {
        /// The recording.
        file: String,
        /// When the run would begin anew (s).
        time_s: f64,
        /// The rig's pressures.
        column: String,
    },
    /// The rig's numbers let the simulation diverge.
    #[error("{file}: column {column}: the simulation left the numbers at {time_s} s; check the rig's parameters")]
    NotFinite {
        /// The recording.
        file: String,
        /// Time of the row (s).
        time_s: f64,
        /// The pressure.
        column: String,
    },
}

/// Rows between two calls of `advanced`.
const ROWS_AT_ONCE: usize = 64;

impl FreeRun {
    /// A free run of a rig, and of what it was compiled to.
    ///
    /// # Errors
    /// The rig's tick does not divide the 20 ms between rows.
    pub fn new(rig: &Rig, plant: Arc<Plant<f64>>) -> Result<Self, RigError> {
        let ticks = PERIOD_S / plant.tick_s();
        // Ticks are written in ms with a few digits.
        if ticks < 0.5 || (ticks - ticks.round()).abs() > 1e-6 {
            let problem = format!(
                "rows are {} ms apart, which is no whole number of ticks of {} ms; use {} ms",
                PERIOD_S * 1e3,
                plant.tick_s() * 1e3,
                PERIOD_S * 1e3
            );
            return Err(RigError::at("integrator.tick_ms", problem));
        }
        let channel = |room: &Room| {
            let command = &rig.valves.get(&room.valve)?.command;
            DualPressurePorts::DUTY.iter().position(|duty| duty == command)
        };
        let open = rooms(rig).into_iter().filter(|room| room.half_duty > 0.0);
        let rooms: Vec<_> = open.filter_map(|room| Some((channel(&room)?, room))).collect();
        // Between 1 and 20: a rig's tick is at least 1 ms.
        let ticks_per_row = ticks.round() as u32;
        let simulation = Simulation::new(plant);
        Ok(FreeRun { simulation, ticks_per_row, rooms, rig: rig.clone(), steady: OnceCell::new() })
    }

    /// The compiled rig.
    pub fn plant(&self) -> Arc<Plant<f64>> {
        Arc::clone(self.simulation.plant())
    }

    /// Tells whether some valve's flapper may lie anywhere in a room of its own when a recording begins.
    pub fn has_flappers(&self) -> bool {
        !self.rooms.is_empty()
    }

    /// Runs over a recording from the first row of each stretch, flappers where they `began`.
    ///
    /// A recording without any of the rig's pressures starts at rest, if it has no gap. `advanced` is told of rows that are done,
    /// some at a time.
    ///
    /// # Errors
    /// A command column is missing or is text, some but not all pressures are missing, a gap without
    /// pressures, a simulation that diverges, or `advanced` breaks it off.
    pub fn over(
        &mut self,
        recording: &Recording,
        began: &Began,
        mut advanced: impl FnMut(u64) -> ControlFlow<()>,
    ) -> Result<Trace, FreeRunError> {
        let plant = Arc::clone(self.simulation.plant());
        let inputs = inputs(&plant, recording)?;
        let has = |column: &String| recording.names().any(|name| name == column);
        let pressures_given = plant.sensor_columns().iter().any(has);
        let pressures = if pressures_given {
            recording.require_all(plant.sensor_columns().iter().map(String::as_str))?
        } else {
            self.refuse_gaps(recording)?;
            Vec::new()
        };
        let mut readings_kpa = vec![Vec::with_capacity(recording.rows()); plant.sensor_columns().len()];
        let mut first_start = None;
        let mut commands = vec![0.0; inputs.len()];
        for (number, rows) in recording.segments().iter().enumerate() {
            read_row(&inputs, rows.start, &mut commands);
            let start = self.start(&pressures, rows.start, &commands);
            let guessed = || match start {
                FreeRunStart::Running => self.settled_before(&pressures, rows.start, &commands),
                FreeRunStart::AtRest => Vec::new(),
            };
            for flapper in began.get(number).cloned().unwrap_or_else(guessed) {
                let index = self.simulation.unknowns().position(|unknown| unknown.name == flapper.unknown);
                if let Some(index) = index {
                    self.simulation.set_unknown(index, flapper.share);
                }
            }
            first_start.get_or_insert(start);
            for row in rows.clone() {
                for ((column, reading), name) in
                    readings_kpa.iter_mut().zip(self.simulation.readings_kpa()).zip(plant.sensor_columns())
                {
                    if !reading.is_finite() {
                        return Err(FreeRunError::NotFinite {
                            file: recording.source().to_owned(),
                            time_s: recording.time_s().get(row).copied().unwrap_or(f64::NAN),
                            column: name.clone(),
                        });
                    }
                    column.push(reading);
                }
                read_row(&inputs, row, &mut commands);
                for _ in 0..self.ticks_per_row {
                    self.simulation.tick(&commands);
                }
                if (row + 1) % ROWS_AT_ONCE == 0 && advanced(ROWS_AT_ONCE as u64).is_break() {
                    return Err(FreeRunError::Stopped);
                }
            }
        }
        Ok(Trace { readings_kpa, start: first_start.unwrap_or(FreeRunStart::AtRest), pressures_given })
    }

    /// Starts a stretch at its first row.
    fn start(&mut self, pressures: &[&[f64]], row: usize, inputs: &[f64]) -> FreeRunStart {
        let sensors = self.simulation.plant().sensor_columns().len();
        let first: Vec<f64> = if pressures.is_empty() {
            vec![0.0; sensors]
        } else {
            pressures.iter().filter_map(|column| column.get(row)).copied().collect()
        };
        let start = self.simulation.start_for(&first);
        self.simulation.start_from(&first, inputs, start);
        start
    }

    /// Where flappers lie if the pressures of a row had settled before its commands came.
    fn settled_before(&self, pressures: &[&[f64]], row: usize, inputs: &[f64]) -> Vec<Flapper> {
        if self.rooms.is_empty() {
            return Vec::new();
        }
        // Without a map flappers begin in the middle.
        let Some(steady) = self.steady.get_or_init(|| SteadyMap::new(&self.rig).ok()) else { return Vec::new() };
        let plant = self.simulation.plant();
        let reading = |name: &str| {
            let at = plant.sensor_columns().iter().position(|column| column == name)?;
            pressures.get(at)?.get(row).copied()
        };
        let command = |name: &str| {
            let at = plant.inputs().iter().position(|input| input.column == name)?;
            inputs.get(at).copied()
        };
        let ([Some(pos), Some(neg)], [Some(u_pos), Some(u_neg)]) =
            (DualPressurePorts::READING.map(reading), DualPressurePorts::DUTY.map(command))
        else {
            return Vec::new();
        };
        let (holding, commanded) = (steady.duty_for([pos, neg], [0.0; 2]), [u_pos, u_neg]);
        let lies = |(channel, room): &(usize, Room)| {
            let off = holding.get(*channel)? - commanded.get(*channel)?;
            // Where no duty holds the pressures, they had not settled.
            let share = (off / room.half_duty).clamp(-1.0, 1.0);
            share.is_finite().then(|| Flapper { unknown: room.unknown.clone(), share })
        };
        self.rooms.iter().filter_map(lies).collect()
    }

    fn refuse_gaps(&self, recording: &Recording) -> Result<(), FreeRunError> {
        let Some(second) = recording.segments().get(1) else { return Ok(()) };
        Err(FreeRunError::GapWithoutPressures {
            file: recording.source().to_owned(),
            time_s: recording.time_s().get(second.start).copied().unwrap_or(f64::NAN),
            column: self.simulation.plant().sensor_columns().join(" and "),
        })
    }
}

/// Where the values of one input come from.
#[derive(Debug)]
enum Values<'a> {
    Column(&'a [f64]),
    Constant(f64),
}

impl Values<'_> {
    fn at(&self, row: usize) -> f64 {
        match self {
            // Columns have as many numbers as the recording has rows.
            Values::Column(numbers) => numbers.get(row).copied().unwrap_or(f64::NAN),
            Values::Constant(value) => *value,
        }
    }
}

/// Reads the commands of one row.
fn read_row(inputs: &[Values<'_>], row: usize, commands: &mut [f64]) {
    for (slot, input) in commands.iter_mut().zip(inputs) {
        *slot = input.at(row);
    }
}

/// The rig's inputs: columns of the recording, or the default where the recording has none.
fn inputs<'a>(plant: &Plant<f64>, recording: &'a Recording) -> Result<Vec<Values<'a>>, RecordingError> {
    let values = |input: &model::plant::Input| match input.default {
        Some(value) if recording.names().all(|name| name != input.column) => Ok(Values::Constant(value)),
        _ => recording.require([input.column.as_str()]).map(|[numbers]| Values::Column(numbers)),
    };
    plant.inputs().iter().map(values).collect()
}
