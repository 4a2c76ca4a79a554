//! The cRIO's rules as a state machine: no socket, no thread, no clock.
//!
//! ```text
//!            HELLO                first COMMAND
//!  no session ───► idle, vented ───────────────► running / holding / idle (by its mode)
//!      ▲             │                              │
//!      │ BYE, link   │ over-pressure, sensor,       │ also: no command for `ttl` ticks
//!      │ loss        │ operator                     ▼
//!      └──────────── └───────────────────────► tripped, vented; a new HELLO leads to idle
//! ```
//! The caller feeds it HELLO and COMMAND frames as they come and calls [`Crio::edge`] once a tick.
//! All that the protocol's page leaves open is listed in the module above.

use crate::wire::{
    Command, CrioState, Hello, HelloRefusal, MAX_TTL_TICKS, Mode, RATE_MILLIHERTZ, Sense, TripBits, VERSION, is_newer,
};

use super::sensors::{BROKEN_ABOVE_V, BROKEN_BELOW_V, PSE540A_R06, PSE541A_R06, SensorScale};

const VENTED: [f32; 2] = [1.0, 1.0];

/// Properties of the cRIO: its name, its channels, its own limits.
#[derive(Debug, Clone, PartialEq)]
pub struct CrioConfig {
    /// Name in its HELLO, at most 16 ASCII characters.
    pub name: String,
    /// Sensors it says it has.
    pub sensors: u8,
    /// Valves it says it has.
    pub valves: u8,
    /// Sample rate it says it has, mHz.
    pub rate_millihertz: u32,
    /// Lowest and highest protocol version it says it speaks.
    pub versions: [u8; 2],
    /// True with a pump relay; without one the pump always runs.
    pub pump_relay: bool,
    /// A reading of this much or more trips, kPa gauge.
    pub over_pressure_kpa: f64,
    /// Ticks in a row with a broken sensor that trip; `None`: it never trips for a sensor.
    pub broken_sensor_ticks: Option<u32>,
    /// The positive and the negative sensor.
    pub scales: [SensorScale; 2],
}

impl Default for CrioConfig {
    /// Two sensors, two valves, a pump relay, 300 kPa, three ticks for a broken sensor.
    fn default() -> Self {
        Self {
            name: "emulated cRIO".to_owned(),
            sensors: 2,
            valves: 2,
            rate_millihertz: RATE_MILLIHERTZ,
            versions: [VERSION, VERSION],
            pump_relay: true,
            over_pressure_kpa: 300.0,
            broken_sensor_ticks: Some(3),
            scales: [PSE540A_R06, PSE541A_R06],
        }
    }
}

/// Effect of the cRIO's outputs on the rig.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Actuation {
    /// Duty, 0 (closed) to 1 (open): positive valve, negative valve.
    pub duty: [f32; 2],
    /// True while the pump runs.
    pub pump_on: bool,
}

/// Why a COMMAND was not applied.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Rejection {
    /// No session is open, or the command is of another one.
    #[error("COMMAND of session {found:08X} while {} is open", Open(*.open))]
    Session {
        /// Session of the command.
        found: u32,
        /// The open session.
        open: Option<u32>,
    },
    /// A sequence number is not newer than the last one that counted.
    #[error("COMMAND {found} is not newer than {last}")]
    Sequence {
        /// Sequence number of the command.
        found: u32,
        /// The last one that counted.
        last: u32,
    },
    /// A duty is not finite or not in \[0, 1\].
    #[error("COMMAND asks for duty {} and {}; each must be a number from 0 to 1", .duty[0], .duty[1])]
    Duty {
        /// Duties of the command.
        duty: [f32; 2],
    },
    /// The cRIO is tripped; the command would have counted.
    #[error("COMMAND came while tripped ({trips}); only a new HELLO ends a trip")]
    Tripped {
        /// Why it is tripped.
        trips: TripBits,
    },
}

struct Open(Option<u32>);

impl std::fmt::Display for Open {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.0 {
            Some(session) => write!(f, "session {session:08X}"),
            None => f.write_str("none"),
        }
    }
}

/// The command now in force.
#[derive(Debug, Clone, Copy)]
struct InForce {
    sequence: u32,
    duty: [f32; 2],
    mode: Mode,
    ttl_ticks: u8,
    pump_on: bool,
}

#[derive(Debug, Clone)]
struct Session {
    id: u32,
    next_tick: u32,
    last_sequence: u32,
    in_force: Option<InForce>,
    // True where a command that counts came since the last edge.
    answered: bool,
    empty_ticks: u32,
    broken_ticks: u32,
    missed: u64,
    trips: TripBits,
}

/// The cRIO.
#[derive(Debug, Clone)]
pub struct Crio {
    config: CrioConfig,
    session: Option<Session>,
}

impl Crio {
    /// A cRIO with no session.
    #[must_use]
    pub const fn new(config: CrioConfig) -> Self {
        Self { config, session: None }
    }

    /// Properties of the cRIO.
    #[must_use]
    pub const fn config(&self) -> &CrioConfig {
        &self.config
    }

    /// The open session.
    #[must_use]
    pub fn session(&self) -> Option<u32> {
        self.session.as_ref().map(|session| session.id)
    }

    /// Opens the session of the daemon's HELLO and gives the answer, which carries this sequence
    /// number and clock.
    ///
    /// # Errors
    /// Why the HELLO is refused; an open session is ended then.
    pub fn hello(&mut self, hello: &Hello, sequence: u32, clock_ns: u64) -> Result<Hello, HelloRefusal> {
        self.session = None;
        hello.check()?;
        self.session = Some(Session {
            id: hello.session,
            next_tick: 0,
            last_sequence: hello.sequence,
            in_force: None,
            answered: false,
            empty_ticks: 0,
            broken_ticks: 0,
            missed: 0,
            trips: TripBits::NONE,
        });
        Ok(Hello {
            rate_millihertz: self.config.rate_millihertz,
            sensors: self.config.sensors,
            valves: self.config.valves,
            min_version: self.config.versions[0],
            max_version: self.config.versions[1],
            ..Hello::new(sequence, clock_ns, hello.session, &self.config.name)
        })
    }

    /// Ends the session (BYE, link loss): both vents open.
    pub fn end_session(&mut self) {
        self.session = None;
    }

    /// Takes a COMMAND that came whole; one that counts is in force from now on.
    ///
    /// # Errors
    /// Why it is not applied.
    pub fn command(&mut self, command: &Command) -> Result<(), Rejection> {
        let open = self.session();
        let Some(session) = self.session.as_mut().filter(|session| session.id == command.session) else {
            return Err(Rejection::Session { found: command.session, open });
        };
        if !is_newer(command.sequence, session.last_sequence) {
            return Err(Rejection::Sequence { found: command.sequence, last: session.last_sequence });
        }
        // A NaN is in no range.
        if !command.duty.iter().all(|duty| (0.0..=1.0).contains(duty)) {
            return Err(Rejection::Duty { duty: command.duty });
        }
        session.last_sequence = command.sequence;
        session.answered = true;
        if !session.trips.is_empty() {
            return Err(Rejection::Tripped { trips: session.trips });
        }
        session.in_force = Some(InForce {
            sequence: command.sequence,
            duty: if command.mode == Mode::Vent { VENTED } else { command.duty },
            mode: command.mode,
            ttl_ticks: command.ttl_ticks.clamp(1, MAX_TTL_TICKS),
            pump_on: command.pump_on(),
        });
        Ok(())
    }

    /// Trips for these reasons, as an operator's stop or a test does; nothing without a session.
    pub fn trip(&mut self, bits: TripBits) {
        if let Some(session) = self.session.as_mut()
            && !bits.is_empty()
        {
            session.trips = session.trips.with(bits);
            session.in_force = None;
        }
    }

    /// One sample edge: ends the tick before it, judges the volts, and gives SENSE with this sequence
    /// number and clock; `None` without a session.
    pub fn edge(&mut self, volts: [f32; 4], sequence: u32, clock_ns: u64) -> Option<Sense> {
        let judged = self.judge(volts);
        let broken_limit = self.config.broken_sensor_ticks;
        let session = self.session.as_mut()?;
        let mut trips = TripBits::NONE;
        // No tick came before the first edge of a session.
        if session.next_tick > 0 {
            if session.answered {
                session.empty_ticks = 0;
            } else {
                session.missed = session.missed.saturating_add(1);
                session.empty_ticks = session.empty_ticks.saturating_add(1);
            }
            if let Some(in_force) = session.in_force
                && session.empty_ticks >= u32::from(in_force.ttl_ticks)
            {
                trips = trips.with(TripBits::COMMAND_LOST);
            }
        }
        session.answered = false;
        if judged.over_pressure {
            trips = trips.with(TripBits::OVER_PRESSURE);
        }
        session.broken_ticks = if judged.broken { session.broken_ticks.saturating_add(1) } else { 0 };
        if broken_limit.is_some_and(|limit| session.broken_ticks >= limit.max(1)) {
            trips = trips.with(TripBits::SENSOR);
        }
        let (id, tick, missed) = (session.id, session.next_tick, session.missed);
        // 2³² ticks are 994 days; a session that long goes on from 1, for 0 means its first edge.
        session.next_tick = tick.checked_add(1).unwrap_or(1);
        self.trip(trips);
        let actuation = self.actuation();
        Some(Sense {
            sequence,
            clock_ns,
            session: id,
            tick,
            command_in_force: self.in_force().map_or(0, |command| command.sequence),
            volts,
            duty: actuation.duty,
            state: self.state(),
            pump_running: actuation.pump_on,
            trips: self.trips(),
            commands_missed: u16::try_from(missed).unwrap_or(u16::MAX),
        })
    }

    /// Effect of the outputs now.
    #[must_use]
    pub fn actuation(&self) -> Actuation {
        let in_force = self.in_force();
        Actuation {
            duty: in_force.map_or(VENTED, |command| command.duty),
            pump_on: !self.config.pump_relay || in_force.is_some_and(|command| command.pump_on),
        }
    }

    /// The state as SENSE reports it.
    #[must_use]
    pub fn state(&self) -> CrioState {
        if !self.trips().is_empty() {
            return CrioState::Tripped;
        }
        match self.in_force().map(|command| command.mode) {
            None | Some(Mode::Vent) => CrioState::Idle,
            Some(Mode::Run) => CrioState::Running,
            Some(Mode::Hold) => CrioState::Holding,
        }
    }

    /// Why it is tripped.
    #[must_use]
    pub fn trips(&self) -> TripBits {
        self.session.as_ref().map_or(TripBits::NONE, |session| session.trips)
    }

    /// Ticks of this session that ended without a command that counts.
    #[must_use]
    pub fn commands_missed(&self) -> u64 {
        self.session.as_ref().map_or(0, |session| session.missed)
    }

    /// The sequence number of the daemon's last frame that counted in this session.
    #[must_use]
    pub fn last_sequence(&self) -> Option<u32> {
        self.session.as_ref().map(|session| session.last_sequence)
    }

    fn in_force(&self) -> Option<InForce> {
        self.session.as_ref().and_then(|session| session.in_force)
    }

    fn judge(&self, volts: [f32; 4]) -> Judged {
        let mut judged = Judged { over_pressure: false, broken: false };
        for (volts, scale) in volts.into_iter().zip(self.config.scales) {
            judged.over_pressure |= scale.gauge_kpa(f64::from(volts)) >= self.config.over_pressure_kpa;
            judged.broken |= !(BROKEN_BELOW_V..=BROKEN_ABOVE_V).contains(&volts);
        }
        judged
    }
}

struct Judged {
    over_pressure: bool,
    broken: bool,
}
