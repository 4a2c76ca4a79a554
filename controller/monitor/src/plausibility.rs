//! All checks of one tick: a frame in, conditions and believed pressures out.

use model::observation::{CHANNELS, Pair};
use model::plant::Plant;
use model::predict::{DualPressurePorts, DualPressureRig};
use model::rig::{Rig, RigError};
use model::steady::SteadyMap;
use proto::wire::Sense;
use supervisor::{Condition, ConditionSet};

use crate::command_echo::{CommandEcho, SentCommand};
use crate::frozen_reading::FrozenReading;
use crate::lagged_command::LaggedCommand;
use crate::model_residual::{Limits, ModelResidual, Worth};
use crate::tracking::Tracking;
use crate::vent_check::VentCheck;

/// How far a chamber may read on the wrong side of the atmosphere, in kPa: offset of the sensor and of its wire (chosen).
const WRONG_SIDE_KPA: f64 = 5.0;
/// Lower end of what the negative chamber can read, in kPa gauge: a vacuum, less [`WRONG_SIDE_KPA`].
const BELOW_VACUUM_KPA: f64 = -101.325 - WRONG_SIDE_KPA;
/// Conditions by channel.
const MODEL: [Condition; CHANNELS] = [Condition::ModelPositive, Condition::ModelNegative];
const FROZEN: [Condition; CHANNELS] = [Condition::FrozenPositive, Condition::FrozenNegative];

/// Whether the valves were being controlled in the tick before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// They were.
    Controlled,
    /// Both vents were open.
    Vented,
}

/// Whether readings are held against the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Foresight {
    /// They are: under closed-loop control a wrong reading drives the true pressure away.
    Judged,
    /// They are not: commands are played open loop, often to find out where the model is wrong.
    Unjudged,
}

/// A frame and what the sensors' scales made of it.
#[derive(Debug, Clone, Copy)]
pub struct Frame<'a> {
    /// The frame.
    pub sense: &'a Sense,
    /// Readings in kPa gauge; `None` for a voltage that no sound sensor gives.
    pub readings_kpa: [Option<f64>; CHANNELS],
    /// Whether the valves were being controlled.
    pub phase: Phase,
}

/// The monitor with everything it remembers.
pub struct Monitor {
    /// The model under the commands as sent, and under those of a slow valve.
    models: [DualPressureRig; 2],
    slow: LaggedCommand,
    residuals: [ModelResidual; CHANNELS],
    frozen: [FrozenReading; CHANNELS],
    echo: CommandEcho,
    tracking: Tracking,
    tracked: ConditionSet,
    vent: VentCheck,
    /// Whether the model's state comes from the tick before.
    foresees: bool,
    foresight: Foresight,
}

impl Monitor {
    /// A monitor whose model is the given rig.
    ///
    /// # Errors
    /// If the rig cannot be flown: unsound, or without the valves and sensors the controller needs.
    pub fn new(rig: &Rig, foresight: Foresight) -> Result<Self, RigError> {
        let relay = Plant::<f64>::new(rig)?.inputs().iter().any(|i| i.column == DualPressurePorts::PUMP_ON);
        // Without a relay the pump runs on, into open valves.
        let rest = if relay { None } else { SteadyMap::new(rig)?.settled_kpa([1.0; CHANNELS]) };
        Ok(Monitor {
            models: [DualPressureRig::new(rig)?, DualPressureRig::new(rig)?],
            slow: LaggedCommand::settled([1.0; CHANNELS]),
            residuals: [ModelResidual::new(Limits::POSITIVE), ModelResidual::new(Limits::NEGATIVE)],
            frozen: [FrozenReading::new(); CHANNELS],
            echo: CommandEcho::new(),
            tracking: Tracking::new(),
            tracked: ConditionSet::EMPTY,
            vent: VentCheck::new(rest.unwrap_or([0.0; CHANNELS])),
            foresees: false,
            foresight,
        })
    }

    /// Takes another model, twice, and hands the old ones back to be dropped outside the tick.
    pub fn exchange_models(&mut self, models: [DualPressureRig; 2]) -> [DualPressureRig; 2] {
        self.foresees = false;
        std::mem::replace(&mut self.models, models)
    }

    /// Holds readings against the model from now on, or no more; the model runs along either way.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn set_foresight(&mut self, foresight: Foresight) {
        self.foresight = foresight;
    }

    /// Sets other limits for residuals: for figures of what residuals a rig has.
    pub fn set_limits(&mut self, limits: Limits) {
        self.residuals = [ModelResidual::new(limits); CHANNELS];
    }

    /// A new session: what was sent before counts no more.
    pub fn session_opened(&mut self) {
        self.echo = CommandEcho::new();
        self.vent.end();
        self.foresees = false;
    }

    /// The rig is armed.
    pub fn armed(&mut self) {
        self.residuals.iter_mut().for_each(ModelResidual::restart);
        self.tracking = Tracking::new();
        self.tracked = ConditionSet::EMPTY;
        self.vent.end();
    }

    /// The vents are commanded open from now on.
    pub fn vented(&mut self, measured_kpa: Pair) {
        self.tracked = ConditionSet::EMPTY;
        self.vent.begin(measured_kpa);
    }

    /// Checks a frame, and answers the pressures to go by: the readings, or the model's where a reading is in doubt.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn observe(&mut self, frame: &Frame<'_>, found: &mut ConditionSet) -> [Option<f64>; CHANNELS] {
        ranges(frame.readings_kpa, found);
        self.echo.judge(frame.sense, found);
        self.vent.judge(frame.sense.duty, frame.readings_kpa, found);
        for (c, volts) in frame.sense.volts.iter().take(CHANNELS).enumerate() {
            if let Some(ticks) = self.frozen[c].push(*volts) {
                found.insert(FROZEN[c], f64::from(ticks));
            }
        }
        for condition in self.tracked.iter() {
            found.insert(condition, self.tracked.value(condition));
        }
        self.against_the_model(frame, found)
    }

    fn against_the_model(&mut self, frame: &Frame<'_>, found: &mut ConditionSet) -> [Option<f64>; CHANNELS] {
        let [fast, slow] = [0, 1].map(|n: usize| self.models[n].readings_kpa());
        let finite = fast.iter().chain(&slow).all(|p| p.is_finite());
        let mut believed = frame.readings_kpa;
        let judged = self.foresees && self.foresight == Foresight::Judged && frame.phase == Phase::Controlled && finite;
        for c in 0..CHANNELS {
            let Some(reading) = frame.readings_kpa[c].filter(|_| judged) else { continue };
            // Between both forecasts nothing is contradicted.
            let nearest = reading.clamp(fast[c].min(slow[c]), fast[c].max(slow[c]));
            match self.residuals[c].push(reading - nearest) {
                Worth::Agrees => {}
                Worth::Suspect { kpa } => {
                    found.insert(Condition::ReadingSuspect, kpa);
                    believed[c] = Some(nearest);
                }
                Worth::Contradicts { kpa } => {
                    found.insert(MODEL[c], kpa);
                    believed[c] = Some(nearest);
                }
            }
        }
        if let [Some(positive), Some(negative)] = believed {
            for model in &mut self.models {
                if finite {
                    model.correct([positive, negative]);
                } else {
                    model.start_from([positive, negative], [1.0; CHANNELS]);
                }
            }
            self.foresees = true;
        } else {
            self.foresees = false;
        }
        believed
    }

    /// Takes the references and what was decided for them.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn decided(&mut self, reference_kpa: Pair, measured_kpa: Pair, duty: Pair) {
        self.tracked = ConditionSet::EMPTY;
        if reference_kpa.iter().all(|p| p.is_finite()) {
            self.tracking.judge(reference_kpa, measured_kpa, duty, &mut self.tracked);
        }
    }

    /// Remembers the command that went out.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn sent(&mut self, command: SentCommand) {
        self.echo.sent(command);
    }

    /// Moves the model on through the tick; after the command is out.
    ///
    /// # Real-time
    /// Runs in the tick: two ticks of the model.
    pub fn advance(&mut self, duty: Pair, pump_on: bool) {
        let slow = self.slow.follow(duty);
        for (model, duty) in self.models.iter_mut().zip([duty, slow]) {
            model.tick(duty, pump_on);
        }
    }

    /// Sums of the residuals beyond the model's own, and their limits, per channel in kPa: for the figures.
    pub fn figures_kpa(&self) -> [[f64; 4]; CHANNELS] {
        self.residuals.map(|r| r.figures_kpa())
    }
}

fn ranges(readings_kpa: [Option<f64>; CHANNELS], found: &mut ConditionSet) {
    if let [Some(positive), _] = readings_kpa
        && positive < -WRONG_SIDE_KPA
    {
        found.insert(Condition::RangePositive, positive);
    }
    if let [_, Some(negative)] = readings_kpa
        && !(BELOW_VACUUM_KPA..=WRONG_SIDE_KPA).contains(&negative)
    {
        found.insert(Condition::RangeNegative, negative);
    }
}
