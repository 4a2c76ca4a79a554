//! The look ahead, the bisection toward vent, and the slew limit.

use model::observation::{CHANNELS, MOST_CHANGE_DUTY, Pair, TICKS_PER_S};
use model::plant::State;
use model::predict::DualPressureRig;
use model::real::Real;
use model::rig::{Rig, RigError};

use crate::actuator_path::{ActuatorPath, Eight, PathSettings};
use crate::hypotheses;

/// Both vents open: the backup controller.
const VENT: Pair = [1.0; CHANNELS];
/// Ticks that are looked ahead: one under the command, then vented until the slowest hypothesis has turned round (two
/// ticks of delay, and the 1.4 time constants of 100 ms that a valve takes from shut to the 0.75 of duty that balances
/// the pump at the limit: nine ticks), with half as many again.
const LOOK_AHEAD_TICKS: usize = 14;
/// Halvings of λ: the command is bent by at most 1/64 of the way to vent more than it must be.
const BISECTIONS: usize = 6;
/// Step of the averaged model in ms: RK4 with half a tick is within 0.01 kPa of a tenth of it here.
const STEP_MS: f64 = 10.0;
/// Last ticks that are run through again where the rigs begin anew, so that valves and gas stand where these have put them: half a
/// second, more than a delay and a coil's lag take (chosen).
const PAST_TICKS: usize = 25;
/// Ticks over which the pressures' rates are taken, for hypotheses with a sensor that lags.
const RATE_TICKS: usize = 5;

/// Pressures that must not be left, in kPa gauge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Envelope {
    /// Highest positive pressure.
    pub max_pos_kpa: f64,
    /// Lowest negative pressure.
    pub min_neg_kpa: f64,
}

impl Envelope {
    /// The daemon's limits where nothing else is configured.
    pub const DEFAULT: Envelope = Envelope { max_pos_kpa: 160.0, min_neg_kpa: -95.0 };
}

/// Limit on how far a duty moves in a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SlewLimit {
    /// By so much at most.
    DutyPerTick(f64),
    /// As far as it likes: for commands that must be played as they are.
    None,
}

impl SlewLimit {
    /// As the laws expect it: [`MOST_CHANGE_DUTY`].
    pub const DEFAULT: SlewLimit = SlewLimit::DutyPerTick(MOST_CHANGE_DUTY);
}

/// Change of a command, and its reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
#[repr(u8)]
pub enum Intervention {
    /// It was not changed.
    #[default]
    None = 0,
    /// It moved too fast.
    Slew = 1,
    /// It would have left the envelope, and was bent toward vent.
    Envelope = 2,
    /// Not even vent keeps every hypothesis within the envelope; vent was sent.
    Vent = 3,
}

impl Intervention {
    /// The number that recordings carry: 0 none, 1 slew, 2 envelope, 3 vent.
    pub const fn code(self) -> u8 {
        self as u8
    }
}

/// A command as it may be sent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Filtered {
    /// Duties, within 0 … 1.
    pub duty: Pair,
    /// Change that was made to it.
    pub intervention: Intervention,
}

/// The filter with its model and everything it remembers.
pub struct SafetyFilter {
    envelope: Envelope,
    slew: SlewLimit,
    /// The hypotheses' rigs, running along with the real one.
    rigs: DualPressureRig<Eight>,
    /// A sound state of theirs, vented at rest, to begin from.
    at_rest: State<Eight>,
    settings: PathSettings,
    paths: [ActuatorPath; CHANNELS],
    reading_error_kpa: [Eight; CHANNELS],
    sensor_lag_s: Eight,
    /// Readings of the last ticks, the newest first, in kPa gauge.
    readings_kpa: [Pair; RATE_TICKS + 1],
    last: Pair,
    /// Reading in kPa gauge and duty of the last ticks, the newest first.
    past: [(Pair, Pair); PAST_TICKS],
    interventions: u64,
}

impl SafetyFilter {
    /// A filter that looks ahead on `model` and on worse rigs around it.
    ///
    /// # Errors
    /// If the rig cannot be compiled or lacks a port of a dual-pressure rig.
    ///
    /// # Real-time
    /// Allocates and works out tables of pumps, some tens of ms; not for the tick.
    pub fn new(model: &Rig, envelope: Envelope, slew: SlewLimit) -> Result<Self, RigError> {
        let mut rigs = DualPressureRig::averaged_side_by_side(&hypotheses::rigs(model), STEP_MS)?;
        rigs.start_from([0.0; CHANNELS].map(Eight::splat), VENT.map(Eight::splat));
        Ok(SafetyFilter {
            envelope,
            slew,
            at_rest: rigs.state(),
            rigs,
            settings: PathSettings::new(),
            paths: VENT.map(ActuatorPath::at_rest),
            reading_error_kpa: [0, 1].map(|c: usize| hypotheses::lanes(|h| h.reading_error_kpa[c])),
            sensor_lag_s: hypotheses::lanes(|h| h.sensor_lag_s),
            readings_kpa: [[0.0; CHANNELS]; RATE_TICKS + 1],
            last: VENT,
            past: [([0.0; CHANNELS], VENT); PAST_TICKS],
            interventions: 0,
        })
    }

    /// Goes on where another filter, on another model, stands: limits, readings, commands and counts.
    ///
    /// # Real-time
    /// As much as two looks ahead; may run in the tick.
    pub fn continue_from(&mut self, other: &Self) {
        self.envelope = other.envelope;
        self.slew = other.slew;
        self.readings_kpa = other.readings_kpa;
        self.paths = other.paths;
        self.last = other.last;
        self.past = other.past;
        self.interventions = other.interventions;
        self.begin_anew();
        self.rigs.correct(self.readings_kpa[0].map(Eight::splat));
    }

    /// Sets how far a duty may move in a tick from now on.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn set_slew(&mut self, slew: SlewLimit) {
        self.slew = slew;
    }

    /// Takes in what was measured at this tick, in kPa gauge.
    ///
    /// # Real-time
    /// As much as two looks ahead where a model has diverged; may run in the tick.
    pub fn observe(&mut self, measured_kpa: Pair) {
        self.readings_kpa.rotate_right(1);
        self.readings_kpa[0] = measured_kpa;
        let oldest = self.readings_kpa[RATE_TICKS];
        let per_s = TICKS_PER_S / RATE_TICKS as f64;
        let rates: Pair = std::array::from_fn(|c| (measured_kpa[c] - oldest[c]) * per_s);
        // A lag hides what a pressure has moved since; only the way outwards is worse than what is read.
        let outwards = [rates[0].max(0.0), rates[1].min(0.0)];
        let truth = std::array::from_fn(|c| {
            Eight::splat(measured_kpa[c]) + self.reading_error_kpa[c] + self.sensor_lag_s * Eight::splat(outwards[c])
        });
        self.rigs.correct(truth);
        if !self.is_sound() {
            // A model that has diverged would refuse everything from now on.
            self.begin_anew();
            self.rigs.correct(truth);
        }
    }

    /// Runs through the last ticks again, from rest. A rig at rest has its valves open: one that lags would be looked ahead on as if it
    /// still let air out.
    fn begin_anew(&mut self) {
        self.rigs.restore(&self.at_rest);
        let mut paths = self.past[PAST_TICKS - 1].1.map(ActuatorPath::at_rest);
        for (reading_kpa, duty) in self.past.into_iter().rev() {
            self.rigs.correct(std::array::from_fn(|c| Eight::splat(reading_kpa[c]) + self.reading_error_kpa[c]));
            let duties = step(&mut paths, duty, &self.settings);
            self.rigs.tick(duties, true);
        }
        if !self.is_sound() {
            // Among the last ticks may be what made a model diverge.
            self.rigs.restore(&self.at_rest);
        }
    }

    fn is_sound(&self) -> bool {
        self.rigs.readings_kpa().iter().all(|kpa| kpa.is_finite())
    }

    /// Gives the command that may be sent in place of `asked`, which is counted where it differs.
    ///
    /// # Real-time
    /// One look ahead where nothing is wrong, nine at most; each is 14 ticks of the averaged model in eight lanes.
    /// Allocation-free and bounded.
    pub fn limit(&mut self, asked: Pair) -> Filtered {
        let filtered = self.within(asked);
        self.interventions += u64::from(filtered.intervention != Intervention::None);
        filtered
    }

    /// Moves on through the tick with what was sent.
    ///
    /// # Real-time
    /// One tick of the averaged model; may run in the tick, after the command is out.
    pub fn sent(&mut self, duty: Pair) {
        let duties = step(&mut self.paths, duty, &self.settings);
        self.rigs.tick(duties, true);
        self.last = duty;
        self.past.rotate_right(1);
        self.past[0] = (self.readings_kpa[0], duty);
    }

    /// Commands that were changed since the filter was made.
    pub fn interventions(&self) -> u64 {
        self.interventions
    }

    /// The limits that it keeps.
    pub fn envelope(&self) -> Envelope {
        self.envelope
    }

    fn within(&mut self, asked: Pair) -> Filtered {
        if !asked.iter().all(|u| u.is_finite()) {
            return Filtered { duty: VENT, intervention: Intervention::Vent };
        }
        let asked = asked.map(|u| u.clamp(0.0, 1.0));
        let slewed = self.slewed(asked);
        let left = self.leaves(slewed);
        if left == [false; CHANNELS] {
            let intervention = if slewed == asked { Intervention::None } else { Intervention::Slew };
            return Filtered { duty: slewed, intervention };
        }
        // The channel that leaves is bent alone if that is enough: the other one is on its reference.
        for bent in [left, [true; CHANNELS]] {
            if self.leaves(toward_vent(slewed, bent, 1.0)) == [false; CHANNELS] {
                let duty = self.least_bent(slewed, bent);
                return Filtered { duty, intervention: Intervention::Envelope };
            }
        }
        Filtered { duty: VENT, intervention: Intervention::Vent }
    }

    fn slewed(&self, asked: Pair) -> Pair {
        match self.slew {
            SlewLimit::DutyPerTick(most) => {
                std::array::from_fn(|c| asked[c].clamp(self.last[c] - most, self.last[c] + most))
            }
            SlewLimit::None => asked,
        }
    }

    /// The command on the way from `asked` to vent that is bent the least, where vent itself is known to do.
    fn least_bent(&mut self, asked: Pair, bent: [bool; CHANNELS]) -> Pair {
        let (mut leaves, mut stays) = (0.0, 1.0);
        for _ in 0..BISECTIONS {
            let share = 0.5 * (leaves + stays);
            if self.leaves(toward_vent(asked, bent, share)) == [false; CHANNELS] {
                stays = share;
            } else {
                leaves = share;
            }
        }
        toward_vent(asked, bent, stays)
    }

    /// Pressure that leaves the envelope on any hypothesis under `duty` for a tick and vent from then on.
    fn leaves(&mut self, duty: Pair) -> [bool; CHANNELS] {
        let (now, mut paths) = (self.rigs.state(), self.paths);
        let highest = Eight::splat(self.envelope.max_pos_kpa);
        let lowest = Eight::splat(self.envelope.min_neg_kpa);
        let mut left = [false; CHANNELS];
        for tick in 0..LOOK_AHEAD_TICKS {
            let command = if tick == 0 { duty } else { VENT };
            let duties = step(&mut paths, command, &self.settings);
            self.rigs.tick(duties, true);
            let [pos, neg] = self.rigs.readings_kpa();
            // Written so that a number that is none counts as outside.
            left[0] |= !highest.all_at_least(pos);
            left[1] |= !neg.all_at_least(lowest);
        }
        self.rigs.restore(&now);
        left
    }
}

/// The share of the way to vent, on the channels that are bent.
fn toward_vent(duty: Pair, bent: [bool; CHANNELS], share: f64) -> Pair {
    std::array::from_fn(|c| if bent[c] { duty[c] + share * (1.0 - duty[c]) } else { duty[c] })
}

fn step(paths: &mut [ActuatorPath; CHANNELS], command: Pair, settings: &PathSettings) -> [Eight; CHANNELS] {
    let [pos, neg] = paths;
    [pos.step(command[0], settings), neg.step(command[1], settings)]
}
