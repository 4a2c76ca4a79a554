//! All checks of one tick: a frame in, conditions and believed pressures out.

use model::observation::{CHANNELS, Pair};
use model::rig::{Rig, RigError};
use proto::wire::Sense;
use supervisor::{Condition, ConditionSet};

use crate::command_echo::{CommandEcho, SentCommand};
use crate::frozen_reading::FrozenReading;
use crate::hypothesis::Contradiction;
use crate::jump::{JUMP_KPA, Jump, Worth};
use crate::lagged_command::LaggedCommand;
use crate::model_residual::Limits;
use crate::monitor_models::{HYPOTHESES, MonitorModels};
use crate::reference_motion::ReferenceMotion;
use crate::tracking::Tracking;
use crate::vent_check::VentCheck;

/// How far a chamber may read on the wrong side of the atmosphere, in kPa: offset of the sensor and of its wire (chosen).
const WRONG_SIDE_KPA: f64 = 5.0;
/// Lower end of what the negative chamber can read, in kPa gauge: a vacuum, less [`WRONG_SIDE_KPA`].
const BELOW_VACUUM_KPA: f64 = -101.325 - WRONG_SIDE_KPA;
/// Conditions by channel.
const MODEL: [Condition; CHANNELS] = [Condition::ModelPositive, Condition::ModelNegative];
const SUSPECT: [Condition; CHANNELS] = [Condition::SuspectPositive, Condition::SuspectNegative];
const FROZEN: [Condition; CHANNELS] = [Condition::FrozenPositive, Condition::FrozenNegative];

/// Limits of the residuals by channel.
const LIMITS: [Limits; CHANNELS] = [Limits::POSITIVE, Limits::NEGATIVE];

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
    models: MonitorModels,
    slow: LaggedCommand,
    /// By hypothesis and channel.
    contradictions: [[Contradiction; CHANNELS]; HYPOTHESES],
    jumps: [Jump; CHANNELS],
    /// Last readings that were believed, kPa gauge.
    believed_kpa: Pair,
    frozen: [FrozenReading; CHANNELS],
    echo: CommandEcho,
    motion: ReferenceMotion,
    tracking: Tracking,
    tracked: ConditionSet,
    vent: VentCheck,
    /// Whether the models' state comes from the tick before.
    foresees: bool,
    foresight: Foresight,
    /// Phase of the newest frame.
    phase: Phase,
}

impl Monitor {
    /// A monitor whose model is the given rig.
    ///
    /// # Errors
    /// If the rig cannot be flown: unsound, or without the valves and sensors the controller needs.
    pub fn new(rig: &Rig, foresight: Foresight) -> Result<Self, RigError> {
        let models = MonitorModels::new(rig)?;
        Ok(Monitor {
            slow: LaggedCommand::settled([1.0; CHANNELS]),
            contradictions: [LIMITS.map(Contradiction::new); HYPOTHESES],
            jumps: [Jump::default(); CHANNELS],
            believed_kpa: [0.0; CHANNELS],
            frozen: [FrozenReading::new(); CHANNELS],
            echo: CommandEcho::new(),
            motion: ReferenceMotion::RESTING,
            tracking: Tracking::new(),
            tracked: ConditionSet::EMPTY,
            vent: VentCheck::new(models.vent),
            models,
            foresees: false,
            foresight,
            phase: Phase::Vented,
        })
    }

    /// Takes other models in exchange for its own; what was recorded of the old ones' errors is forgotten.
    ///
    /// # Real-time
    /// Runs in the tick: a swap, nothing is made or freed.
    pub fn exchange_models(&mut self, models: &mut MonitorModels) {
        std::mem::swap(&mut self.models, models);
        self.vent.set_model(self.models.vent);
        let fresh = if self.phase == Phase::Controlled { Contradiction::compared } else { Contradiction::new };
        self.contradictions = [LIMITS.map(fresh); HYPOTHESES];
        self.foresees = false;
    }

    /// Holds readings against the models from now on, or no more; the models run along either way.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn set_foresight(&mut self, foresight: Foresight) {
        self.foresight = foresight;
    }

    /// A new session: what was sent before counts no more.
    pub fn session_opened(&mut self) {
        self.echo = CommandEcho::new();
        self.vent.end();
        self.foresees = false;
    }

    /// The rig is armed.
    pub fn armed(&mut self) {
        self.contradictions.as_flattened_mut().iter_mut().for_each(Contradiction::restart);
        self.jumps.iter_mut().for_each(Jump::restart);
        self.motion = ReferenceMotion::RESTING;
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
        self.phase = frame.phase;
        ranges(frame.readings_kpa, found);
        self.echo.judge(frame.sense, found);
        // A pump that runs on, for want of a relay, holds the chambers under pressure with both vents open.
        if frame.phase == Phase::Vented && !frame.sense.pump_running {
            self.vent.begin_as_found(frame.readings_kpa);
        }
        self.vent.judge(frame.sense.duty, frame.readings_kpa, found);
        for (c, volts) in frame.sense.volts.iter().take(CHANNELS).enumerate() {
            if let Some(ticks) = self.frozen[c].push(*volts) {
                found.insert(FROZEN[c], f64::from(ticks));
            }
        }
        for condition in self.tracked.iter() {
            found.insert(condition, self.tracked.value(condition));
        }
        let judged = self.foresees && self.foresight == Foresight::Judged && frame.phase == Phase::Controlled;
        let mut believed = frame.readings_kpa;
        let mut suspect = [false; CHANNELS];
        if judged {
            suspect = self.jumped(&mut believed, found);
        }
        if let [Some(positive), Some(negative)] = believed {
            self.against_the_models([positive, negative], suspect.map(|suspect| judged && !suspect), found);
            self.believed_kpa = [positive, negative];
            self.foresees = true;
        } else {
            self.foresees = false;
        }
        believed
    }

    /// Puts what a reading could be at the least in the place of one that jumped; which did.
    fn jumped(&mut self, believed: &mut [Option<f64>; CHANNELS], found: &mut ConditionSet) -> [bool; CHANNELS] {
        let [fast, slow] = self.models.hypotheses[0].as_ref().map_or([self.believed_kpa; 2], |h| h.foreseen_kpa());
        std::array::from_fn(|c| {
            let Some(reading) = believed[c] else { return false };
            match self.jumps[c].judge(reading, [self.believed_kpa[c], fast[c], slow[c]], JUMP_KPA) {
                Worth::Believed => false,
                Worth::Suspect { kpa, instead_kpa } => {
                    found.insert(SUSPECT[c], kpa);
                    believed[c] = Some(instead_kpa);
                    true
                }
                Worth::Wrong { kpa, instead_kpa } => {
                    found.insert(MODEL[c], kpa);
                    believed[c] = Some(instead_kpa);
                    true
                }
            }
        })
    }

    /// Takes readings into all models; a reading that every hypothesis contradicts, and all in one direction, is found.
    fn against_the_models(&mut self, readings_kpa: Pair, judged: [bool; CHANNELS], found: &mut ConditionSet) {
        let motion = self.motion.felt();
        let mut against: [Option<f64>; CHANNELS] = [None; CHANNELS];
        let mut explained = [false; CHANNELS];
        for (models, contradictions) in self.models.hypotheses.iter_mut().zip(&mut self.contradictions) {
            let Some(models) = models else { continue };
            let ways = models.take(readings_kpa);
            for c in (0..CHANNELS).filter(|c| judged[*c]) {
                match (contradictions[c].judge(ways[c], motion), against[c]) {
                    (None, _) => explained[c] = true,
                    (Some(kpa), Some(before)) => explained[c] |= kpa * before < 0.0,
                    (Some(kpa), None) => against[c] = Some(kpa),
                }
            }
        }
        for c in 0..CHANNELS {
            if let Some(kpa) = against[c].filter(|_| !explained[c]) {
                found.insert(MODEL[c], kpa);
            }
        }
    }

    /// Takes the references and what was decided for them.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn decided(&mut self, reference_kpa: Pair, measured_kpa: Pair, duty: Pair) {
        self.tracked = ConditionSet::EMPTY;
        self.motion.follow(reference_kpa);
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

    /// Moves the models on through the tick; after the command is out.
    ///
    /// # Real-time
    /// Runs in the tick: up to four ticks of the model.
    pub fn advance(&mut self, duty: Pair, pump_on: bool) {
        let slow = self.slow.follow(duty);
        for models in self.models.hypotheses.iter_mut().flatten() {
            models.advance([duty, slow], pump_on);
        }
    }

    /// Sums of the residuals beyond the model's own, and their limits, by hypothesis and channel, in kPa: for the figures.
    pub fn figures_kpa(&self) -> [[[f64; 4]; CHANNELS]; HYPOTHESES] {
        self.contradictions.map(|channels| channels.map(|c| c.sums.figures_kpa()))
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
