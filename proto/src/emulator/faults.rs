//! The fault script: which frames, links and sensors to spoil, and when. TOML.
//!
//! ```toml
//! seed = 1                       # of every throw of the dice; default 0
//!
//! [[fault]]
//! kind = "lose"                  # lose | delay | corrupt | repeat | drop_link | sensor | trip
//! frame = "command"              # sense, command, hello_in, hello_out, bye_in, bye_out
//! ticks = [100, 101, 102]        # at these ticks
//!
//! [[fault]]
//! kind = "delay"
//! frame = "sense"
//! by_ms = 30                     # or by_ticks
//! first = 200                    # from this tick (default 0)
//! last = 400                     # to this one (default: for ever)
//! every = 10                     # every tenth of them (default 1)
//! probability = 0.5              # and of those every second, by the dice (default 1)
//! ```
//!
//! | kind | keys of its own |
//! | --- | --- |
//! | `lose` | `frame` |
//! | `delay` | `frame`; `by_ms` or `by_ticks` |
//! | `corrupt` | `frame`; `byte` (from 0; default: by the dice), `xor` (1 to 255; default: by the dice) |
//! | `repeat` | `frame`; `times` (default 1): so many copies more |
//! | `drop_link` | `refuse_s` (default 0): and reset every new connection for so long, wall clock |
//! | `sensor` | `sensor` (`positive`, `negative`); `effect` (`broken_wire`, `stuck`, `nan`, `reading`, `offset`); `kpa` for the last two |
//! | `trip` | `reason` (`over_pressure`, `command_lost`, `sensor`, `operator_stop`) |
//!
//! When: `ticks`, or any of `first`, `last`, `every`, `probability`; one of these keys must be there.
//! Ticks are counted from the emulator's first SENSE and go on over sessions, so that a link dropped
//! at tick 500 is dropped once. A frame the cRIO sends or receives between edge k and edge k+1 is of
//! tick k. Throws of the dice hang on seed, fault and tick alone. In lockstep a delay counts in whole
//! ticks: `by_ms = 30` is one tick, `by_ms = 15` none.

use std::ops::Range;
use std::path::Path;
use std::time::Duration;

use serde::Deserialize;
use toml::Spanned;

use crate::regular_file;
use crate::wire::{FrameType, MAX_LENGTH, TripBits};

use super::fault_outcome::{Action, Fault, When, Wire};
use super::pace::TICK;
use super::sensors::SensorFault;

/// The largest fault script that is read, in bytes.
const MOST_BYTES: u64 = 1 << 20;

/// A fault script that has been checked.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FaultScript {
    pub(super) seed: u64,
    pub(super) faults: Vec<Fault>,
}

/// Problem of a fault script.
#[derive(Debug, thiserror::Error)]
pub enum FaultScriptError {
    /// The file cannot be read.
    #[error("{file}: cannot read the fault script: {source}")]
    Read {
        /// The file.
        file: String,
        /// The system's word.
        source: std::io::Error,
    },
    /// Not TOML, an unknown key or word, or a value of the wrong type.
    #[error("{file}:{line}:{column}: {message}")]
    Syntax {
        /// The file.
        file: String,
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// The parser's word, in one line.
        message: String,
    },
    /// A fault whose keys make no sense together.
    #[error("{file}:{line}: fault {number}: key `{key}`: {problem}")]
    Fault {
        /// The file.
        file: String,
        /// Line of the fault, from 1.
        line: usize,
        /// Number of the fault in the file, from 1.
        number: usize,
        /// The key.
        key: &'static str,
        /// Problem, and the mend.
        problem: &'static str,
    },
}

impl FaultScript {
    /// A script without a fault.
    #[must_use]
    pub fn none() -> Self {
        Self::default()
    }

    /// Number of faults.
    #[must_use]
    pub fn len(&self) -> usize {
        self.faults.len()
    }

    /// True without a fault.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.faults.is_empty()
    }

    /// Reads a script from a file.
    ///
    /// # Errors
    /// The file cannot be read, or what [`Self::from_toml`] finds.
    pub fn read(path: &Path) -> Result<Self, FaultScriptError> {
        let file = path.display().to_string();
        let text = regular_file::read_text(path, MOST_BYTES)
            .map_err(|source| FaultScriptError::Read { file: file.clone(), source })?;
        Self::from_toml(&text, &file)
    }

    /// Reads a script from TOML; `file` names it in errors.
    ///
    /// # Errors
    /// The first thing that is wrong, with its line.
    pub fn from_toml(text: &str, file: &str) -> Result<Self, FaultScriptError> {
        let script: RawScript = toml::from_str(text).map_err(|error| syntax_error(&error, text, file))?;
        let mut faults = Vec::with_capacity(script.fault.len());
        for (index, raw) in script.fault.iter().enumerate() {
            let fault = raw.get_ref().checked().map_err(|Problem { key, problem }| FaultScriptError::Fault {
                file: file.to_owned(),
                line: line_and_column(text, raw.span()).0,
                number: index + 1,
                key,
                problem,
            })?;
            faults.push(fault);
        }
        Ok(Self { seed: script.seed, faults })
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawScript {
    #[serde(default)]
    seed: u64,
    #[serde(default)]
    fault: Vec<Spanned<RawFault>>,
}

#[derive(Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Kind {
    Lose,
    Delay,
    Corrupt,
    Repeat,
    DropLink,
    Sensor,
    Trip,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "snake_case")]
enum RawFrameKind {
    Sense,
    Command,
    HelloIn,
    HelloOut,
    ByeIn,
    ByeOut,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "snake_case")]
enum RawSensor {
    Positive,
    Negative,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Effect {
    BrokenWire,
    Stuck,
    Nan,
    Reading,
    Offset,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Reason {
    OverPressure,
    CommandLost,
    Sensor,
    OperatorStop,
}

/// A fault as it stands in the file; which keys go with which kind is checked after reading, so that
/// the message can name the key.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawFault {
    kind: Kind,
    ticks: Option<Vec<u64>>,
    first: Option<u64>,
    last: Option<u64>,
    every: Option<u64>,
    probability: Option<f64>,
    frame: Option<RawFrameKind>,
    by_ms: Option<f64>,
    by_ticks: Option<u32>,
    byte: Option<usize>,
    xor: Option<u8>,
    times: Option<u32>,
    refuse_s: Option<f64>,
    sensor: Option<RawSensor>,
    effect: Option<Effect>,
    kpa: Option<f64>,
    reason: Option<Reason>,
}

struct Problem {
    key: &'static str,
    problem: &'static str,
}

const fn problem<T>(key: &'static str, problem: &'static str) -> Result<T, Problem> {
    Err(Problem { key, problem })
}

impl RawFault {
    fn checked(&self) -> Result<Fault, Problem> {
        self.check_keys()?;
        let when = self.when()?;
        let action = match self.kind {
            Kind::Lose => Action::Lose(self.wire()?),
            Kind::Delay => Action::Delay(self.wire()?, self.delay()?),
            Kind::Corrupt => self.corruption()?,
            Kind::Repeat => match self.times {
                Some(0) => return problem("times", "must be at least 1; leave the fault out for none"),
                Some(101..) => return problem("times", "must be at most 100"),
                times => Action::Repeat(self.wire()?, times.unwrap_or(1)),
            },
            Kind::DropLink => Action::DropLink(seconds("refuse_s", self.refuse_s.unwrap_or(0.0), 1.0)?),
            Kind::Sensor => self.sensor_fault()?,
            Kind::Trip => Action::Trip(match self.reason {
                None => return problem("reason", "is missing; say why the cRIO trips"),
                Some(Reason::OverPressure) => TripBits::OVER_PRESSURE,
                Some(Reason::CommandLost) => TripBits::COMMAND_LOST,
                Some(Reason::Sensor) => TripBits::SENSOR,
                Some(Reason::OperatorStop) => TripBits::OPERATOR_STOP,
            }),
        };
        Ok(Fault { when, action })
    }

    /// Every key that is there must go with the kind.
    fn check_keys(&self) -> Result<(), Problem> {
        use Kind::{Corrupt, Delay, DropLink, Lose, Repeat, Sensor, Trip};
        let own: [(&'static str, bool, &[Kind]); 11] = [
            ("frame", self.frame.is_some(), &[Lose, Delay, Corrupt, Repeat]),
            ("by_ms", self.by_ms.is_some(), &[Delay]),
            ("by_ticks", self.by_ticks.is_some(), &[Delay]),
            ("byte", self.byte.is_some(), &[Corrupt]),
            ("xor", self.xor.is_some(), &[Corrupt]),
            ("times", self.times.is_some(), &[Repeat]),
            ("refuse_s", self.refuse_s.is_some(), &[DropLink]),
            ("sensor", self.sensor.is_some(), &[Sensor]),
            ("effect", self.effect.is_some(), &[Sensor]),
            ("kpa", self.kpa.is_some(), &[Sensor]),
            ("reason", self.reason.is_some(), &[Trip]),
        ];
        match own.iter().find(|(_, there, kinds)| *there && !kinds.contains(&self.kind)) {
            Some((key, ..)) => problem(key, "does not go with this kind; take it out"),
            None => Ok(()),
        }
    }

    fn when(&self) -> Result<When, Problem> {
        let span = self.first.is_some() || self.last.is_some() || self.every.is_some() || self.probability.is_some();
        if let Some(ticks) = &self.ticks {
            if span {
                return problem("ticks", "cannot stand beside first, last, every or probability; keep one way");
            }
            if ticks.is_empty() {
                return problem("ticks", "is empty; name at least one tick");
            }
            let mut ticks = ticks.clone();
            ticks.sort_unstable();
            return Ok(When::Ticks(ticks));
        }
        if !span {
            return problem("ticks", "is missing; say when, by ticks or by first, last, every, probability");
        }
        let (first, last) = (self.first.unwrap_or(0), self.last.unwrap_or(u64::MAX));
        if last < first {
            return problem("last", "is before first");
        }
        let every = self.every.unwrap_or(1);
        if every == 0 {
            return problem("every", "must be at least 1");
        }
        let probability = self.probability.unwrap_or(1.0);
        if !(probability > 0.0 && probability <= 1.0) {
            return problem("probability", "must be above 0 and at most 1");
        }
        Ok(When::Span { first, last, every, probability })
    }

    fn wire(&self) -> Result<Wire, Problem> {
        Ok(match self.frame {
            None => return problem("frame", "is missing; say which frame, such as \"sense\" or \"command\""),
            Some(RawFrameKind::Sense) => Wire { kind: FrameType::Sense, outgoing: true },
            Some(RawFrameKind::Command) => Wire { kind: FrameType::Command, outgoing: false },
            Some(RawFrameKind::HelloIn) => Wire { kind: FrameType::Hello, outgoing: false },
            Some(RawFrameKind::HelloOut) => Wire { kind: FrameType::Hello, outgoing: true },
            Some(RawFrameKind::ByeIn) => Wire { kind: FrameType::Bye, outgoing: false },
            Some(RawFrameKind::ByeOut) => Wire { kind: FrameType::Bye, outgoing: true },
        })
    }

    fn delay(&self) -> Result<Duration, Problem> {
        match (self.by_ms, self.by_ticks) {
            (Some(ms), None) => seconds("by_ms", ms, 1e-3),
            (None, Some(ticks)) => Ok(TICK.saturating_mul(ticks)),
            (Some(_), Some(_)) => problem("by_ms", "cannot stand beside by_ticks; keep one of them"),
            (None, None) => problem("by_ms", "is missing; say by how much, by_ms or by_ticks"),
        }
    }

    fn corruption(&self) -> Result<Action, Problem> {
        let wire = self.wire()?;
        if self.byte.is_some_and(|byte| byte >= wire.kind.length()) {
            return problem("byte", "is beyond the end of that frame (SENSE 64, COMMAND 44, HELLO 52, BYE 32 bytes)");
        }
        if self.xor == Some(0) {
            return problem("xor", "of 0 changes nothing; take 1 to 255");
        }
        debug_assert!(wire.kind.length() <= MAX_LENGTH);
        Ok(Action::Corrupt { wire, byte: self.byte, xor: self.xor })
    }

    fn sensor_fault(&self) -> Result<Action, Problem> {
        let channel = match self.sensor {
            None => return problem("sensor", "is missing; say \"positive\" or \"negative\""),
            Some(RawSensor::Positive) => 0,
            Some(RawSensor::Negative) => 1,
        };
        let fault = match (self.effect, self.kpa) {
            (None, _) => return problem("effect", "is missing; broken_wire, stuck, nan, reading or offset"),
            (Some(Effect::Reading | Effect::Offset), None) => {
                return problem("kpa", "is missing; reading and offset need a gauge pressure in kPa");
            }
            (Some(Effect::Reading | Effect::Offset), Some(kpa)) if !kpa.is_finite() => {
                return problem("kpa", "must be a finite number");
            }
            (Some(Effect::Reading), Some(kpa)) => SensorFault::Reading(kpa),
            (Some(Effect::Offset), Some(kpa)) => SensorFault::Offset(kpa),
            (Some(_), Some(_)) => return problem("kpa", "goes with reading and offset only; take it out"),
            (Some(Effect::BrokenWire), None) => SensorFault::BrokenWire,
            (Some(Effect::Stuck), None) => SensorFault::Stuck,
            (Some(Effect::Nan), None) => SensorFault::NotANumber,
        };
        Ok(Action::Sensor { channel, fault })
    }
}

/// A time in units of `unit_s`, from 0 to an hour.
fn seconds(key: &'static str, value: f64, unit_s: f64) -> Result<Duration, Problem> {
    if !(value >= 0.0 && value * unit_s <= 3600.0) {
        return problem(key, "must be from 0 to one hour");
    }
    Ok(Duration::from_secs_f64(value * unit_s))
}

fn syntax_error(error: &toml::de::Error, text: &str, file: &str) -> FaultScriptError {
    let (line, column) = error.span().map_or((1, 1), |span| line_and_column(text, span));
    let message = error.message().lines().map(str::trim).collect::<Vec<_>>().join("; ");
    FaultScriptError::Syntax { file: file.to_owned(), line, column, message }
}

fn line_and_column(text: &str, span: Range<usize>) -> (usize, usize) {
    let before = text.get(..span.start.min(text.len())).unwrap_or(text);
    let line = before.matches('\n').count() + 1;
    let column = before.rsplit('\n').next().map_or(0, |rest| rest.chars().count()) + 1;
    (line, column)
}
