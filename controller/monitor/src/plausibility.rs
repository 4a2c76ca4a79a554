//! All checks of one tick: a frame in, conditions and believed pressures out.

use model::observation::{CHANNELS, Pair};
use model::rig::{Rig, RigError};
use proto::wire::Sense;
use supervisor::{Condition, ConditionSet};

use crate::command_echo::{CommandEcho, SentCommand};
use crate::frozen_reading::FrozenReading;
use crate::hypothesis::{Contradiction, Way};
use crate::jump::{JUMP_KPA, Jump, Worth};
use crate::lagged_command::LaggedCommand;
use crate::model_residual::{Limits, Measure};
use crate::monitor_models::{HYPOTHESES, MonitorModels};
use crate::reference_motion::{Excitation, ReferenceMotion};
use crate::tracking::Tracking;
use crate::vent_check::VentCheck;

/// Distance that a chamber may read on the wrong side of the atmosphere, in kPa: offset of the sensor and of its wire (chosen).
const WRONG_SIDE_KPA: f64 = 5.0;
/// Lower end of what the negative chamber can read, in kPa gauge: a vacuum, less [`WRONG_SIDE_KPA`].
const BELOW_VACUUM_KPA: f64 = -101.325 - WRONG_SIDE_KPA;
/// Conditions by channel.
const MODEL: [Condition; CHANNELS] = [Condition::ModelPositive, Condition::ModelNegative];
const SUSPECT: [Condition; CHANNELS] = [Condition::SuspectPositive, Condition::SuspectNegative];
const FROZEN: [Condition; CHANNELS] = [Condition::FrozenPositive, Condition::FrozenNegative];

/// Phase of the tick before: controlled or not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// The valves were being controlled.
    Controlled,
    /// Both vents were open.
    Vented,
}

/// Use of the model: whether readings are held against it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Foresight {
    /// Readings are held against it: under closed-loop control a wrong reading drives the true pressure away.
    Judged,
    /// Readings are not held against it: commands are played open loop, often to find out where the model is wrong.
    Unjudged,
}

/// A frame and what the sensors' scales made of it.
#[derive(Debug, Clone, Copy)]
pub struct Frame<'a> {
    /// The frame.
    pub sense: &'a Sense,
    /// Readings in kPa gauge; `None` for a voltage that no sound sensor gives.
    pub readings_kpa: [Option<f64>; CHANNELS],
    /// Phase of the tick before.
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
    /// True where the models' state comes from the tick before.
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
            contradictions: [Limits::BY_CHANNEL.map(Contradiction::new); HYPOTHESES],
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
        self.contradictions = [Limits::BY_CHANNEL.map(fresh); HYPOTHESES];
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

    /// Finds what one frame decides without any other: readings that no such chamber can have, and trip bits without a trip.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn judge_alone(sense: &Sense, readings_kpa: [Option<f64>; CHANNELS], found: &mut ConditionSet) {
        ranges(readings_kpa, found);
        CommandEcho::judge_trip_bits(sense, found);
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
        let ways = self.models.hypotheses.each_mut().map(|models| models.as_mut().map(|m| m.take(readings_kpa)));
        self.contradicted(ways, judged, found);
    }

    /// Finds the readings that contradict every hypothesis, by the ways that the chambers made in this tick: by hypothesis, channel and
    /// command.
    fn contradicted(
        &mut self,
        ways: [Option<[[Way; 2]; CHANNELS]>; HYPOTHESES],
        judged: [bool; CHANNELS],
        found: &mut ConditionSet,
    ) {
        let motion = self.motion.felt();
        let mut against: [Option<f64>; CHANNELS] = [None; CHANNELS];
        let mut explained = [false; CHANNELS];
        let mut by_long_sums = judged;
        for (ways, contradictions) in ways.iter().zip(&mut self.contradictions) {
            let Some(ways) = ways else { continue };
            for c in (0..CHANNELS).filter(|c| judged[*c]) {
                let Some(excess) = contradictions[c].judge(ways[c], motion) else {
                    explained[c] = true;
                    continue;
                };
                by_long_sums[c] &= excess.by == Measure::LongSum;
                match against[c] {
                    Some(before) => explained[c] |= excess.kpa * before < 0.0,
                    None => against[c] = Some(excess.kpa),
                }
            }
        }
        for c in 0..CHANNELS {
            let Some(kpa) = against[c].filter(|_| !explained[c]) else { continue };
            // Long sums that are within their limits say nothing of what another measure found.
            let named = if by_long_sums[c] && judged[1 - c] { self.named(c) } else { c };
            let kpa = if named == c { kpa } else { self.contradictions[0][named].sums.long_kpa() };
            found.insert(MODEL[named], kpa);
        }
    }

    /// Channel that explains why this one's reading contradicts the models: itself, or the other one, which the pump couples to it.
    fn named(&self, found: usize) -> usize {
        let present = self.models.hypotheses.iter().zip(&self.contradictions).filter(|(models, _)| models.is_some());
        let sums_kpa = present.map(|(_, channels)| std::array::from_fn(|c| channels[c].sums.long_kpa()));
        self.models.coupling.named(found, sums_kpa)
    }

    /// Takes the references and what was decided for them, and what was added to that.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn decided(&mut self, reference_kpa: Pair, measured_kpa: Pair, duty: Pair, excitation: Excitation) {
        self.tracked = ConditionSet::EMPTY;
        self.motion.follow(reference_kpa, excitation);
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A tick in which the models foresaw no way, and each channel made this one, in kPa.
    fn left(monitor: &mut Monitor, left_kpa: Pair) -> ConditionSet {
        let mut found = ConditionSet::EMPTY;
        let ways = left_kpa.map(|actual_kpa| [Way { actual_kpa, foreseen_kpa: 0.0 }; 2]);
        monitor.contradicted([Some(ways); HYPOTHESES], [true; CHANNELS], &mut found);
        found
    }

    /// A monitor that has seen good models for 20 s, so that the limits are the narrowest: 4 kPa in five ticks, 5 and 8 kPa in half a
    /// second.
    fn recorded() -> Monitor {
        let mut monitor = Monitor::new(&Rig::builtin("dual_pressure").unwrap(), Foresight::Judged).unwrap();
        for _ in 0..1_000 {
            assert_eq!(left(&mut monitor, [0.0; CHANNELS]), ConditionSet::EMPTY);
        }
        monitor
    }

    /// The positive channel's sum over half a second is 1 kPa behind the step, which -4 kPa of the negative channel would explain.
    #[test]
    fn a_step_that_the_short_sum_finds_is_named_where_it_is() {
        let mut monitor = recorded();
        for _ in 0..24 {
            assert_eq!(left(&mut monitor, [-0.2, -0.16]), ConditionSet::EMPTY, "a harmless rest");
        }
        let found = left(&mut monitor, [6.0, -0.16]);
        let [positive, negative] = monitor.contradictions[0].map(|c| c.sums.long_kpa());
        assert!((positive - 1.2).abs() < 0.3 && (negative + 4.0).abs() < 0.3, "{positive} {negative}");
        assert_eq!(monitor.named(0), 1, "by the long sums alone");
        assert!(found.contains(Condition::ModelPositive) && !found.contains(Condition::ModelNegative), "{found:?}");
        assert!((found.value(Condition::ModelPositive) - 5.2).abs() < 0.3, "the sum over five ticks: {found:?}");
    }

    /// Sums as a drifting negative reading leaves them: the positive channel passes its limit first.
    #[test]
    fn a_drift_that_the_long_sum_finds_is_named_where_it_comes_from() {
        let mut monitor = recorded();
        let found =
            (0..50).map(|_| left(&mut monitor, [-0.24, 0.37])).find(|found| *found != ConditionSet::EMPTY).unwrap();
        assert!(found.contains(Condition::ModelNegative) && !found.contains(Condition::ModelPositive), "{found:?}");
    }
}
