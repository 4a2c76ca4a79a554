//! A rig compiled into flat arrays, and its simulation.
//!
//! | file | subject |
//! | --- | --- |
//! | `elements` | the compiled records |
//! | `assemble` | from a checked [`crate::rig::Rig`] to records |
//! | `command` | command path of a valve, tick by tick |
//! | `walls` | volumes and pistons, tick by tick |
//! | `rates` | mass and energy balances |
//! | `lag` | first-order lags over a step |
//! | `residual` | tabled flows and areas |
//! | `integrate` | RK4 over a tick |
//! | `ripple` | what averaged pumps add to the mean pressures |
//! | `dispatch` | instruction sets |
//! | `valve_model` | one valve forwards and backwards |
//! | `simulation` | a plant in motion |
//! | `unknown` | what recordings do not tell about their start |
//!
//! [`Plant`] never changes once made; [`State`] is a small `Copy` value, which is what lets MPObs roll ahead
//! from now and come back; scratch space is allocated with the simulation, so a tick allocates nothing.

mod assemble;
mod command;
mod dispatch;
mod elements;
mod integrate;
mod lag;
mod rates;
mod residual;
mod ripple;
mod sensor;
mod simulation;
mod unobserved;
mod valve_model;
mod walls;

pub(crate) use command::Samples;
pub use dispatch::{InstructionSet, Simulated};
pub(crate) use elements::lanes_of;
pub(crate) use sensor::SensorPath;
pub use simulation::{FreeRunStart, Simulation};
pub(crate) use simulation::{MOST_SENSED, SensorSystem};
pub use unobserved::UnobservedInitialState;
pub(crate) use valve_model::ValveModel;

use command::CommandPath;
pub(crate) use elements::{Cylinder, Drive};
pub(crate) use walls::WallTable;

use elements::{
    AveragedPump, Capillary, Compliant, Displacement, Feed, Given, Isothermal, Joined, Muscle, Parabolic, Passage, Sag,
    ShapedVent, SpringCheck, Thermal, Vent,
};
use residual::Residual;
use walls::Wall;

use crate::orifice::FlowFunction;
use crate::real::{Lanes, Real};

/// Slots for pressures and temperatures: states first, then places whose pressure is given.
pub(crate) const NODES: usize = 16;
/// The most states (pressures of chambers and cylinders, temperatures) a rig may have.
pub(crate) const MOST_STATES: usize = 12;
/// The most places whose pressure is given, the atmosphere included.
pub(crate) const MOST_GIVEN: usize = 4;
/// Numbers that command paths and sensors may remember.
pub(crate) const MEMORY: usize = 80;
/// The most piston pumps a rig may have.
pub(crate) const MOST_DRIVES: usize = 4;

/// Outflow functions a rig may use.
pub(crate) const LAWS: usize = 8;

/// Tabled flows and areas that a rig may have.
pub(crate) const MOST_RESIDUALS: usize = 4;

/// The number of states that the integrator is compiled for, given how many a rig has. Given pressures
/// follow right after. Only the smallest, the paper's, is compiled without what mechanisms add to the balances as well
/// (temperatures, springs, muscles, tables, averaged pumps): each size costs build time.
fn carried(states: usize) -> usize {
    match states {
        0..=4 => 4,
        5..=8 => 8,
        _ => MOST_STATES,
    }
}

/// Instants per integration step at which what is known ahead is tabled: RK4 needs three in a step, and three in
/// each half of one that is refined.
pub(crate) const INSTANTS_PER_STEP: usize = 4;

/// A named input of a rig: a duty, a switch or a prescribed signal.
#[derive(Debug, Clone, PartialEq)]
pub struct Input {
    /// The column of recordings that holds it.
    pub column: String,
    /// Value where a recording has no such column; `None` means the column must be there.
    pub default: Option<f64>,
}

/// A rig compiled for simulation, in SI units; `R` is one rig (`f64`) or several of one structure.
#[derive(Debug, Clone)]
pub struct Plant<R> {
    inputs: Vec<Input>,
    chamber_names: Vec<String>,
    sensor_columns: Vec<String>,
    step_s: f64,
    steps: usize,
    /// True where steps in which a one-way passage opens or shuts are taken again in two halves.
    refine: bool,
    states: usize,
    chambers: usize,
    gas_constant: R,
    heat_capacity_ratio: R,
    atmosphere_pa: R,
    /// Temperature by node in K; thermal chambers override theirs.
    temperature: [R; NODES],
    /// 1/√(R T) by node in s/m.
    inverse_speed: [R; NODES],
    laws: [FlowFunction<R>; LAWS],
    /// True where the balances hold anything beyond the paper's: what the integrator is compiled for.
    extended: bool,
    passages: Vec<Passage<R>>,
    spring_checks: Vec<SpringCheck<R>>,
    vents: Vec<Vent<R>>,
    shaped_vents: Vec<ShapedVent<R>>,
    capillaries: Vec<Capillary<R>>,
    parabolics: Vec<Parabolic<R>>,
    residuals: Vec<Residual<R>>,
    muscles: Vec<Muscle<R>>,
    joined: Vec<Joined<R>>,
    averaged: Vec<AveragedPump<R>>,
    /// True where duties are taken as their mean over a step: steps are long and duties may jump within them.
    mean_duties: bool,
    sags: Vec<Sag<R>>,
    displacements: Vec<Displacement<R>>,
    feeds: Vec<Feed<R>>,
    given: Vec<Given<R>>,
    isothermal: Vec<Isothermal<R>>,
    compliant: Vec<Compliant<R>>,
    thermal: Vec<Thermal<R>>,
    cylinders: Vec<Cylinder<R>>,
    drives: Vec<Drive<R>>,
    commands: Vec<CommandPath<R>>,
    sensors: Vec<SensorPath<R>>,
    /// Chambers without a sensor, each with the sensor whose pressure a free run starts it at.
    like: Vec<(usize, usize)>,
    unknowns: Vec<unobserved::Placed>,
}

impl<R: Real> Plant<R> {
    /// The inputs that [`Simulation::tick`] takes, in order.
    pub fn inputs(&self) -> &[Input] {
        &self.inputs
    }

    /// The chambers, in the order of the rig file.
    pub fn chambers(&self) -> &[String] {
        &self.chamber_names
    }

    /// The recording columns of the sensors, in the order of [`Simulation::readings_kpa`].
    pub fn sensor_columns(&self) -> &[String] {
        &self.sensor_columns
    }

    /// Length of a control tick in seconds.
    pub fn tick_s(&self) -> f64 {
        self.step_s * self.steps as f64
    }

    /// Time between two tabled instants in seconds.
    fn instant_s(&self) -> f64 {
        self.step_s / INSTANTS_PER_STEP as f64
    }

    /// Pressure of the atmosphere in Pa.
    pub fn atmosphere_pa(&self) -> R {
        self.atmosphere_pa
    }

    /// States that the integrator carries.
    fn carried_states(&self) -> usize {
        carried(self.states)
    }

    /// The inputs of the command paths as the driver puts them out for ever: all of them share the supply.
    fn supplied(&self, inputs: &[R]) -> Vec<R> {
        let sent = |path: &CommandPath<R>| inputs.get(path.input).copied().unwrap_or(R::splat(0.0));
        let total = self.commands.iter().filter(|p| p.on_supply).fold(R::splat(0.0), |sum, p| sum + sent(p));
        let factor = self.sags.iter().fold(R::splat(1.0), |factor, sag| factor * sag.left(total));
        self.commands.iter().map(|p| if p.on_supply { sent(p) * factor } else { sent(p) }).collect()
    }

    /// Volume that has joined a chamber by now, in m³.
    #[inline(always)]
    fn joined_to(&self, node: usize, x: &[R; NODES]) -> R {
        let here = self.joined.iter().filter(|joined| joined.node == node);
        here.fold(R::splat(0.0), |sum, joined| sum + x.get(joined.volume).copied().unwrap_or(sum))
    }

    /// States beside the pressures that stay as they are while something settles: temperatures, contractions, volumes.
    fn slow_states(&self) -> impl Iterator<Item = usize> + '_ {
        let temperatures = self.thermal.iter().map(|chamber| chamber.temperature);
        let contractions = self.muscles.iter().map(|muscle| muscle.contraction);
        temperatures.chain(contractions).chain(self.joined.iter().map(|joined| joined.volume))
    }

    /// Rise of a node's pressure per kilogram of gas at `temperature` K, in Pa/kg; 0 where it is given.
    fn pa_per_kg(&self, node: usize, x: &[R; NODES], temperature: R) -> R {
        let p = x.get(node).copied().unwrap_or(self.atmosphere_pa);
        if let Some(chamber) = self.isothermal.iter().find(|c| c.node == node) {
            chamber.pressure_per_mass
        } else if let Some(chamber) = self.compliant.iter().find(|c| c.node == node) {
            let volume = chamber.compliance.mul_add(p, chamber.volume_at_vacuum) + self.joined_to(node, x);
            chamber.rt / chamber.compliance.mul_add(p, volume)
        } else if let Some(chamber) = self.thermal.iter().find(|c| c.node == node) {
            // Too fast for the wall.
            let kappa = self.heat_capacity_ratio;
            let volume = chamber.compliance.mul_add(p, chamber.volume_at_vacuum) + self.joined_to(node, x);
            kappa * self.gas_constant * temperature / (kappa * chamber.compliance).mul_add(p, volume)
        } else {
            R::splat(0.0)
        }
    }

    #[inline(always)]
    fn law(&self, index: usize) -> &FlowFunction<R> {
        &self.laws[index % LAWS]
    }
}

/// Memory of a plant from tick to tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State<R> {
    /// Pressures in Pa (chambers, cylinders), temperatures in K, then given pressures.
    x: [R; NODES],
    /// Crank angle of each pump in revolutions, 0 … 1.
    phase: [R; MOST_DRIVES],
    /// Memory of command paths and sensors.
    memory: [R; MEMORY],
    /// Ticks since the start.
    ticks: u64,
}

impl<const N: usize> State<Lanes<N>> {
    /// Takes over one lane from another state of the same plant; a lane that there is not changes nothing.
    pub fn take_lane(&mut self, lane: usize, from: &Self) {
        let slots = self.x.iter_mut().chain(&mut self.phase).chain(&mut self.memory);
        for (slot, from) in slots.zip(from.x.iter().chain(&from.phase).chain(&from.memory)) {
            if let (Some(value), Some(new)) = (slot.0.get_mut(lane), from.0.get(lane)) {
                *value = *new;
            }
        }
    }
}

/// Space for what a tick works out before it integrates.
#[derive(Debug, Clone)]
pub struct Scratch<R> {
    duties: Vec<Samples<R>>,
    walls: WallTable<R>,
    speeds: Vec<R>,
    /// Switch of each drive: 1 for on, 0 for off.
    running: Vec<R>,
    /// Share of the way that each drive's speed has come from that at the start of the run to that in the end, 0 … 1.
    warmth: Vec<R>,
    displacements: Vec<R>,
    feeds: Vec<R>,
    /// Rates at which volumes join, in m³/s.
    joining: Vec<R>,
}

impl<R: Real> Scratch<R> {
    fn new(plant: &Plant<R>) -> Self {
        let zero = R::splat(0.0);
        Scratch {
            duties: vec![Samples::new(plant.steps); plant.commands.len()],
            walls: WallTable::new(plant.carried_states(), plant.drives.len(), plant.steps, &plant.isothermal),
            speeds: vec![zero; plant.drives.len()],
            running: vec![zero; plant.drives.len()],
            warmth: vec![zero; plant.drives.len()],
            displacements: vec![zero; plant.displacements.len()],
            feeds: vec![zero; plant.feeds.len()],
            joining: vec![zero; plant.joined.len()],
        }
    }

    #[inline(always)]
    fn duty(&self, command: usize, k: usize) -> R {
        self.duties.get(command).map_or(R::splat(0.0), |samples| samples.at(k))
    }

    #[inline(always)]
    fn walls<const STATES: usize>(&self, k: usize) -> &[Wall<R>; STATES] {
        self.walls.at(k)
    }

    #[inline(always)]
    fn running(&self, drive: usize) -> R {
        self.running.get(drive).copied().unwrap_or(R::splat(0.0))
    }

    #[inline(always)]
    fn warmth(&self, drive: usize) -> R {
        self.warmth.get(drive).copied().unwrap_or(R::splat(0.0))
    }

    #[inline(always)]
    fn displacement(&self, index: usize) -> R {
        self.displacements.get(index).copied().unwrap_or(R::splat(0.0))
    }

    #[inline(always)]
    fn feed(&self, index: usize) -> R {
        self.feeds.get(index).copied().unwrap_or(R::splat(0.0))
    }
}
